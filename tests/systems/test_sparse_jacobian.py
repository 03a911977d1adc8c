"""The sparse Jacobian is the dense one, however the system is traced, and implicit solvers of others take it."""

import numpy as np
import pytest
from tcbench_plugins.chain.chain import chain
from tcbench_plugins.net.net import net

import tcbench
from tcbench.systems.sparse_jacobian import sparse_jacobian
from tcbench.systems.system import System
from tcbench.systems.traced import Traced

SCENARIOS = [tcbench.scenarios()["short_term"], chain(3), net(4, 3), chain(12)]


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda s: s.name)
def test_it_is_the_dense_one(scenario):
    model, z = scenario.model, np.array(scenario.z0) + 1e-2 * np.cos(np.arange(scenario.model.size))
    kernel, shape = Traced._kernel(model, System.jacobian.__wrapped__, (model.size,))
    dense = kernel(z, model.constant_values).reshape(shape)
    found = sparse_jacobian(model)(z)
    assert np.abs(found.toarray() - dense).max() < 1e-12 * np.abs(dense).max()
    assert found.nnz < 0.6 * model.size**2


@pytest.mark.parametrize("method", ["solve_ivp_bdf", "solve_ivp_radau"])
def test_solvers_of_others_run_on_a_net(method):
    run = tcbench.simulate(method, net(5, 5), t_end=0.5, tolerance=1e-8)
    fine = tcbench.simulate("gauss2", net(5, 5), dt=0.05, t_end=0.5)
    assert run.ok and np.abs(run.z[-1] - fine.z[-1]).max() < 1e-5
