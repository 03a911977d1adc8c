"""Chains of n masses, `chain[n=8]`: a system that grows; the pendulum is n = 2."""

from tcbench import ScenarioFamily, hookimpl


@hookimpl
def tcbench_scenarios():
    return [
        ScenarioFamily(
            "chain", f"{__name__}.chain:dashed_chain", {"n": "8", "viscosity": ""}, "cost against size",
            "Romero (2009), section 4, n masses", takes={"n": (2, 100_000), "viscosity": float},
        )
    ]  # fmt: skip
