"""Systems with constraints: chains, loops and bodies of rigid rods, `rods[n=3]`; bodies and rods in directors."""

from tcbench import ScenarioFamily, hookimpl

from .sources import BETSCH, DIRECTORS

FAMILIES = (  # name, what makes it, its parameter and which it may be, what it shows, source
    ("rods", "rods:chain", {"n": "3"}, {"n": (1, 100_000)},
     "rigid rods: a pendulum of n links whose joints rub and warm", BETSCH),
    ("rod_loop", "rods:loop", {"n": "6"}, {"n": (5, 100_000)}, "a closed loop of rigid rods, which rubs itself stiff",
     BETSCH),  # with joints that differ
    ("four_masses", "rods:four_masses", {"spin": "1"}, {"spin": float}, "a rigid body: four masses and six rigid rods",
     BETSCH),
    ("director_body", "directors:body", {"spin": "1"}, {"spin": float}, "a rigid body in directors with a liquid core",
     DIRECTORS),
    ("director_rod", "directors:rod", {"n": "4"}, {"n": (2, 100_000)}, "a warm rod in directors bends and twists",
     DIRECTORS),
)  # fmt: skip


@hookimpl
def tcbench_scenarios():
    return [
        ScenarioFamily(name, f"{__name__}.{make}", settings, *told, takes=takes)
        for name, make, settings, takes, *told in FAMILIES
    ]
