"""Random double pendulums, `random[seed=7]`: every constant over two to four decades, every initial value.

Eight scenarios picked by hand prove little; the study `ensemble` runs hundreds of these (docs/ensembles.md). The seed
gives the numbers, the same everywhere and for ever. A range can be changed: `random[seed=7,stiffness=10:300]`.
"""

from tcbench import Range, Scenario, ScenarioFamily, hookimpl
from tcbench.systems.pendulum import Pendulum
from tcbench.systems.sampling import rounded
from tcbench.systems.scenario_family import around

from . import damped_oscillator, heavy_top, reaction, rigid_body, rubbing_piston, viscous_pendulum

RANGES = {
    "stiffness": Range(0.03, 300, log=True),  # of each spring
    "masses": Range(0.3, 3, log=True),
    "natural_lengths": Range(0.5, 3, log=True),
    "conductivity": Range(0.1, 3000, log=True),
    "heat_capacity": Range(1, 20, log=True),
    "coupling": Range(0, 1),
    "temperatures": Range(0.7, 1.4),  # over the reference temperature
    "lengths": Range(0.4, 2.5),  # over the natural ones
    "momenta": Range(0.3, 3, log=True),  # factor of four normal numbers
    "t_end": Range(25, 25),
}
REFERENCE_TEMPERATURE = 300.0


def sample(draw):
    constants = {name: draw(name, 2) for name in ("stiffness", "masses", "natural_lengths")}
    constants |= {name: draw(name) for name in ("conductivity", "heat_capacity", "coupling")}
    temperatures, lengths = rounded(REFERENCE_TEMPERATURE * draw("temperatures", 2)), draw("lengths", 2)
    springs = (lengths * constants["natural_lengths"])[:, None] * draw.directions(2)
    momenta = rounded(draw("momenta") * draw.normals(4))
    return Scenario(
        name="random", system=Pendulum, constants=constants | {"reference_temperature": REFERENCE_TEMPERATURE},
        positions=rounded([*springs[0], *(springs[0] + springs[1])]), momenta=momenta, temperatures=temperatures,
        t_end=draw("t_end"), dt=0.1, shows="what holds beyond scenarios picked by hand", source="beyond the paper",
    )  # fmt: skip


AROUND = (damped_oscillator, viscous_pendulum, rubbing_piston, rigid_body, heavy_top, reaction)


@hookimpl
def tcbench_scenarios():
    return [
        ScenarioFamily("random", sample=sample, ranges=RANGES, shows="random pendulums", source="docs/ensembles.md"),
        *(around(x) for plugin in AROUND for x in plugin.tcbench_scenarios() if isinstance(x, Scenario)),
    ]
