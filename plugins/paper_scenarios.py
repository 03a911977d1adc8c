"""The scenarios of Romero (2009), section 6, and scenarios that change as few of their numbers as they can."""

from tcbench import Scenario, hookimpl
from tcbench.systems.pendulum import Pendulum

PRINTED = {  # section 6; no units are given
    "masses": (1, 2),
    "stiffness": (0.1, 1),
    "natural_lengths": (2, 1),
    "conductivity": 300,
    "reference_temperature": 300,
    "coupling": 0.2,
    "heat_capacity": 5,
}
SHORT = {"positions": (1, 0, 2.2, 0), "momenta": (0, 2, 1, 0), "temperatures": (380, 310)}  # eq. (44)
LONG = {"positions": (12, 0, 2.2, 0), "momenta": (0, 2, 1, -2), "temperatures": (290, 442)}  # eq. (45)
BOUND = {"positions": (2.2, 0, 3.4, 0), "momenta": (0, 2, 0, 4), "temperatures": (330, 300)}


def scenario(name, initial, t_end, shows, source="beyond the paper", **changed):
    settings = {k: changed.pop(k) for k in ("t_converge",) if k in changed}
    initial = {**initial, **{k: changed.pop(k) for k in ("temperatures",) if k in changed}}
    return Scenario(
        name=name, system=Pendulum, constants=PRINTED | changed, **initial, t_end=t_end, dt=0.3,
        shows=shows, source=source, **settings,
    )  # fmt: skip


@hookimpl
def tcbench_scenarios():
    return [
        scenario("short_term", SHORT, 25, "figures 2 to 5", "Romero (2009), eq. (44)"),
        scenario("long_term", LONG, 500, "figures 6 to 8", "Romero (2009), eq. (45)"),
        scenario("relative_equilibrium", LONG, 1500, "figure 9", "Romero (2009), eq. (45)"),
        scenario(
            "bound_equilibrium", BOUND, 1500, "really converges to a relative equilibrium",
            stiffness=(10, 20), conductivity=10,
        ),
        scenario("stiff_spring", SHORT, 25, "midpoint rules blow up, TC methods do not", stiffness=(0.1, 300)),
        scenario(
            "cold_spring", SHORT, 25, "all three kinds of limit: physical, branch, solver",
            temperatures=(280, 310),
        ),
        scenario(
            "fast_conduction", SHORT, 25, "no stability limit, yet wrong temperatures: the two laws are not accuracy",
            conductivity=3000,
        ),
    ]  # fmt: skip
