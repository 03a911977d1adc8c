"""Steps whose curve of roots cannot be followed in double precision: a detour finds a root, which the laws admit."""

import numpy as np
import pytest
from one_flow import OneFlow

import tcbench
from tcbench.compiler.library import evaluate
from tcbench.integrator import Integrator
from tcbench.simulation.prepared import Prepared
from tcbench.simulation.run import simulate
from tcbench.solver.continuation import FOUND, UNDETERMINED
from tcbench.solver.implicit_step import OK, compiled_flows

SCENARIO = tcbench.scenarios()["short_term"]
# found by random steps: a weak spring, which its coupling to the temperature pulls to nothing
COLLAPSING = SCENARIO.replace(
    name="collapsing", masses=(0.94, 0.6), stiffness=(134.0, 0.0528), natural_lengths=(2.06, 0.84), conductivity=0.54,
    coupling=0.43, heat_capacity=14.7, positions=(1.65, -2.88, 2.03, -3.16), momenta=(1.01, 1.31, 1.34, 0.37),
    temperatures=(418.0, 222.0), t_end=3.0,
)  # fmt: skip


def lost_steps(name, batch, count=10_000):
    """Steps of random pendulums that are lost, though each has a root (docs/physics.md, 8), and what all of them took.

    h is log-uniform from 0.01 to 10, and constants span up to three decades."""
    method, model = tcbench.integrators()[name], SCENARIO.model
    ready = Prepared(model, method, compiled_flows(method.flows, model.symbolic))
    entropies, exergy = (model.kernel(n)[0] for n in ("entropy_variables", "exergy"))
    rng, z, V0 = np.random.default_rng([7, batch]), np.zeros(10), np.zeros(1)

    def spread(low, high, *shape):
        return np.exp(rng.uniform(np.log(low), np.log(high), (count, *shape)))

    natural, angle = rng.uniform(0.5, 3.0, (count, 2)), rng.uniform(0.0, 2 * np.pi, (count, 2))
    arms = (natural * spread(0.4, 2.5, 2))[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    q, p = np.cumsum(arms, axis=1).reshape(count, 4), rng.normal(size=(count, 4)) * spread(0.1, 10.0, 1)
    y = np.concatenate([q, p, 300.0 * rng.uniform(0.7, 1.4, (count, 2))], axis=1)
    constants = {
        "masses": rng.uniform(0.3, 3.0, (count, 2)), "stiffness": spread(0.03, 300.0, 2), "natural_lengths": natural,
        "conductivity": spread(0.1, 3000.0, 1), "reference_temperature": np.full((count, 1), 300.0),
        "coupling": rng.uniform(0.0, 1.0, (count, 1)), "heat_capacity": rng.uniform(1.0, 20.0, (count, 1)),
    }  # fmt: skip
    values, lost = np.concatenate([constants[n] for n in model.constants], axis=1), []
    for i, h in enumerate(spread(0.01, 10.0).tolist()):
        run = ready.run
        run.c[1 : 1 + values.shape[1]] = values[i]
        evaluate(entropies.address, y[i], run.c, z)
        evaluate(exergy.address, z, run.c, V0)
        for flow, _, _ in ready.flows:
            flow.bound = max(float(V0[0]), 1e-10)
        ready.set_length(h)
        lost += [] if ready.step(z) == OK else [(h, y[i].tolist(), values[i].tolist())]
    return lost, ready.tally.as_numbers()


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
    lost, tally = lost_steps(name, 0)
    assert not lost and tally.arcs > 100


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tc_monolithic", "tc_staggered", "tc_strang"])
def test_none_of_many_steps_is_lost(name):
    assert not [step for batch in range(1, 31) for step in lost_steps(name, batch)[0]]
