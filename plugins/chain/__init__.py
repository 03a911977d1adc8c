"""Chains of n masses, `chain[n=8]`: a system that grows; the pendulum is n = 2."""

from tcbench import ScenarioFamily, hookimpl

from .chain import chain_of


@hookimpl
def tcbench_scenarios():
    return [ScenarioFamily("chain", chain_of, {"n": "8"}, "cost against size", "Romero (2009), section 4, n masses")]
