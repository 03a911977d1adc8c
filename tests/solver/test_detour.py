"""Steps whose curve of roots cannot be followed in double precision: a detour finds a root, which the laws admit."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from one_flow import OneFlow

import tcbench
from tcbench.integrator import Integrator
from tcbench.simulation.run import simulate
from tcbench.solver.continuation import FOUND, UNDETERMINED

SCENARIO = tcbench.scenarios()["short_term"]
# found by benchmarks/audit_steps.py: a weak spring, which its coupling to the temperature pulls to nothing
COLLAPSING = SCENARIO.replace(
    name="collapsing", masses=(0.94, 0.6), stiffness=(134.0, 0.0528), natural_lengths=(2.06, 0.84), conductivity=0.54,
    coupling=0.43, heat_capacity=14.7, positions=(1.65, -2.88, 2.03, -3.16), momenta=(1.01, 1.31, 1.34, 0.37),
    temperatures=(418.0, 222.0), t_end=3.0,
)  # fmt: skip


def audit():
    path = Path(__file__).parents[2] / "benchmarks" / "audit_steps.py"
    spec = importlib.util.spec_from_file_location("audit_steps", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_where_the_arc_is_undetermined_a_detour_finds_a_root_that_the_laws_admit():
    method = tcbench.integrators()["tc_monolithic"]
    flow = OneFlow(method, COLLAPSING, 3.0)
    assert flow.arc()[0] == UNDETERMINED
    code, jacobians = flow.detour()
    assert code == FOUND and jacobians > 10 and not flow.record.shift.any()
    model = COLLAPSING.model
    z0, z1 = model.state(COLLAPSING.z0), model.state(COLLAPSING.z0 + flow.dz)
    residual = np.asarray(method.flows[0].residual(z0, z1, 3.0, model))
    assert np.abs(residual).max() < 1e-6 * (1 + np.abs(z1).max())
    run = simulate(method, COLLAPSING, dt=3.0)
    assert run.ok and run.solver.arcs == 1 and run.summary.second_law_violations == 0
    assert run.summary.energy_error_max < 1e-9 * COLLAPSING.initial_exergy
    assert run.summary.lyapunov_increment_max < 1e-9 * COLLAPSING.initial_exergy


def test_claims_change_no_number():
    """What a method does decides whether a detour's root is taken; what its author says of it does not."""
    formula = tcbench.integrators()["tc_monolithic"].flows[0].residual
    silent = Integrator(name="silent", order=2, flows=formula)
    said, unsaid = (simulate(method, COLLAPSING, dt=3.0) for method in ("tc_monolithic", silent))
    assert said.ok and np.array_equal(said.z, unsaid.z) and said.solver == unsaid.solver


@pytest.mark.parametrize("claims", [set(), {"energy", "entropy"}])
def test_a_root_that_breaks_a_law_is_not_taken(claims):
    """A method that loses energy may have no root: what the arc leaves open stays open."""

    def leaking(z0, z1, h, system):
        DE = system.discrete_gradient(z0, z1)
        return z1 - z0 - h * (system.L @ DE + system.dissipation(DE.s) - 1e-4 * system.DS)

    run = simulate(Integrator(name="leaking", order=2, flows=leaking, claims=claims), COLLAPSING, dt=3.0)
    assert run.status == "nonconverged" and run.solver.arcs == 1


@pytest.mark.parametrize("name", ["tc_monolithic", "tc_staggered"])
def test_no_step_is_lost(name):
    counts, lost = audit().audit(name, 7, range(1))
    assert not lost and counts["steps"] == 10_000 and counts["arcs"] > 100


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tc_monolithic", "tc_staggered", "tc_strang"])
def test_none_of_many_steps_is_lost(name):
    counts, lost = audit().audit(name, 8, range(30))
    assert not lost and counts["detours"] > 0
