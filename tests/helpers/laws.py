"""What a run owes to the laws that its method claims."""

import numpy as np

EPS = np.finfo(float).eps


def assert_laws(run, energy=1e-12, entropy=1e-13, invariants=1e-12, claims=None, ended=True):
    """The run ended well, if it has to (`ended`), and each law that is claimed holds to these bounds.

    energy: of |E - E0| over the exergy, thousands of converged solves; entropy: what one of them may leave over;
    invariants: relative to where they begin, or to 1. Theorem 6: with both laws E - theta_ref S never increases.
    """
    claims = run.integrator.claims if claims is None else claims
    assert run.ok or not ended, (run.integrator.name, run.scenario.name, run.failure)
    where = run.integrator.name, run.scenario.name, run.summary
    if "energy" in claims:
        assert run.summary.energy_error_max <= energy, where
    if "entropy" in claims:
        assert run.summary.entropy_increment_min >= -entropy, where
    if {"energy", "entropy"} <= set(claims):
        assert run.summary.lyapunov_increment_max <= energy, where
    if "angular_momentum" in claims:
        # adaptive methods made of others add states up without the loops' compensation: some eps a step
        left = invariants + (16 * EPS * run.steps if run.integrator.kind == "adaptive" else 0.0)
        for name, error in run.summary.invariant_error_max.items():
            assert error <= left * max(1.0, abs(run.invariants[name][0])), (name, error, where)
