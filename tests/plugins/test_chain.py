"""The chain: the pendulum is n = 2; of any length, lawful, and its cost linear in n."""

import numpy as np
import pytest
from tcbench_plugins.chain.chain import chain

import tcbench
from tcbench import TcbenchError
from tcbench.plugins import find_scenario
from tcbench.systems.traced import Traced

PENDULUM = tcbench.scenarios()["bound_equilibrium"]


def test_two_masses_are_the_pendulum():
    data = {name: getattr(PENDULUM, name) for name in ("positions", "momenta", "temperatures")}
    scenario = chain(2, **PENDULUM.constants, **data, t_end=6.0, dt=0.3)
    one, two = tcbench.simulate("tc_strang", scenario), tcbench.simulate("tc_strang", PENDULUM, t_end=6.0)
    assert np.allclose(one.z, two.z, rtol=1e-12, atol=1e-12)
    assert np.allclose(one.angular_momentum, two.angular_momentum, rtol=1e-14)


def test_the_laws_hold_of_many_masses():
    n = 1000
    run = tcbench.simulate("tc_monolithic", f"chain[n={n}]", dt=0.2, t_end=2.0)
    assert run.ok and run.summary.energy_error_max < 1e-12
    assert np.diff(run.entropy).min() > -1e-13 * np.abs(run.entropy).max()
    q, p = run.z[:, : 2 * n].reshape(-1, n, 2), run.z[:, 2 * n : 4 * n].reshape(-1, n, 2)
    J = (q[..., 0] * p[..., 1] - q[..., 1] * p[..., 0]).sum(axis=1)
    assert np.abs(J - J[0]).max() < 1e-12 * np.abs(q[0] * p[0][:, ::-1]).sum()
    assert np.allclose(run.angular_momentum, J, rtol=1e-12)


def test_the_work_of_a_step_is_linear_in_the_number_of_masses():
    """Iterations do not grow, nor do entries of the Jacobian a mass."""
    runs = {n: tcbench.simulate("tc_monolithic", f"chain[n={n}]", t_end=0.5) for n in (50, 500)}
    counts = {n: run.solver.newton_iterations / run.steps for n, run in runs.items()}
    assert counts[500] <= counts[50] + 1 and all("loops over the elements" in run.solver.way for run in runs.values())


def test_what_is_no_chain_is_refused_with_a_sentence():
    with pytest.raises(TcbenchError, match="at least 2"):
        chain(1)
    for name, message in (("chain[n=x]", "whole number"), ("chain[m=3]", "No parameter"), ("chian", "mean 'chain'")):
        with pytest.raises(TcbenchError, match=message):
            find_scenario(name)


def test_derived_functions_are_those_of_the_whole_trace():
    scenario = chain(30)
    model, z = scenario.model, np.array([scenario.z0, scenario.z0 + 1e-3])
    for name in ("energy", "entropy", "momenta", "temperatures", "observe", "exergy", "shapes", "vector_field"):
        kernel, shape = Traced._kernel(model, getattr(type(model), name).__wrapped__, (model.size,))
        expected = [kernel(x, model.constant_values).reshape(shape) for x in z]
        assert np.allclose(getattr(model, name)(z), expected, rtol=1e-13, atol=1e-13), name
