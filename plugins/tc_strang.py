"""TC Strang: Romero (2009), remark 3.2. Half a reversible step, an irreversible one, half a reversible one; order 2."""

from tcbench import Integrator, hookimpl

from .tc_staggered import irreversible, reversible


@hookimpl
def tcbench_integrators():
    return [
        Integrator(
            name="tc_strang",
            order=2,
            claims={"energy", "entropy", "angular_momentum"},
            source="Romero (2009), remark 3.2",
            flows=[(reversible, 1 / 2), (irreversible, 1), (reversible, 1 / 2)],
        )
    ]
