"""Chains of n masses, `chain[n=8]`, and the monolithic method with a banded Newton, at a cost linear in n."""

from tcbench import Integrator, ScenarioFamily, hookimpl

from .chain import chain_of


def step(z, h, system):
    from .banded import increments  # SciPy is imported when something runs, not when plugins are listed

    return increments(z, h, system)


@hookimpl
def tcbench_scenarios():
    return [ScenarioFamily("chain", chain_of, {"n": "8"}, "cost against size", "Romero (2009), section 4, n masses")]


@hookimpl
def tcbench_integrators():
    return [
        Integrator(
            name="tc_banded",
            order=2,
            claims={"energy", "entropy", "angular_momentum"},
            source="Romero (2009), eq. (A1), on a chain",
            step=step,
            increments=True,
            systems={"chain"},
        )
    ]
