"""Chains of n masses, `chain[n=8]`: a system that grows; the pendulum is n = 2."""

from tcbench import ScenarioFamily, hookimpl


def chain_of(n, viscosity):
    from . import chain  # networks are imported when one is asked for, not when plugins are listed

    return chain.chain_of(n, viscosity)


@hookimpl
def tcbench_scenarios():
    return [
        ScenarioFamily(
            "chain", chain_of, {"n": "8", "viscosity": ""}, "cost against size", "Romero (2009), section 4, n masses"
        )
    ]
