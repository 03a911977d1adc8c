"""Systems with constraints: chains, loops and bodies of rigid rods, `rods[n=3]`; bodies and rods in directors."""

from tcbench import ScenarioFamily, hookimpl

from .sources import BETSCH, DIRECTORS


def rods_of(n):
    from . import rods  # imported when one is asked for, not when plugins are listed

    return rods.chain_of(n)


def loop_of(n):
    from . import rods

    return rods.loop_of(n)


def four_masses_of(spin):
    from . import rods

    return rods.four_masses_of(spin)


def director_body_of(spin):
    from . import directors

    return directors.body_of(spin)


def director_rod_of(n):
    from . import directors

    return directors.rod_of(n)


@hookimpl
def tcbench_scenarios():
    return [
        ScenarioFamily(*each)
        for each in (
            ("rods", rods_of, {"n": "3"}, "rigid rods: a pendulum of n links whose joints rub and warm", BETSCH),
            ("rod_loop", loop_of, {"n": "6"}, "a closed loop of rigid rods, which rubs itself stiff", BETSCH),
            ("four_masses", four_masses_of, {"spin": "1"}, "a rigid body: four masses and six rigid rods", BETSCH),
            (
                "director_body",
                director_body_of,
                {"spin": "1"},
                "a rigid body in directors with a liquid core",
                DIRECTORS,
            ),
            ("director_rod", director_rod_of, {"n": "4"}, "a warm rod in directors bends and twists", DIRECTORS),
        )
    ]
