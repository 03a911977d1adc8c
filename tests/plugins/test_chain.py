"""The chain: the pendulum is n = 2, the banded step is the traced one, and its cost is linear in n."""

import numpy as np
import pytest
from tcbench_plugins.chain import banded
from tcbench_plugins.chain.chain import chain, chain_system

import tcbench
from tcbench import TcbenchError
from tcbench.engine.planning import plan_job
from tcbench.plugins import find_integrator, find_scenario

PENDULUM = tcbench.scenarios()["bound_equilibrium"]


def test_two_masses_are_the_pendulum():
    data = {name: getattr(PENDULUM, name) for name in ("positions", "momenta", "temperatures")}
    scenario = chain(2, **PENDULUM.constants, **data, t_end=6.0, dt=0.3)
    one, two = tcbench.simulate("tc_strang", scenario), tcbench.simulate("tc_strang", PENDULUM, t_end=6.0)
    assert np.allclose(one.z, two.z, rtol=1e-12, atol=1e-12)
    assert np.allclose(one.angular_momentum, two.angular_momentum, rtol=1e-14)


@pytest.mark.parametrize("n", [2, 3])
def test_the_banded_step_is_the_traced_one(n):
    scenario = chain(n, t_end=5.0)
    traced, fast = tcbench.simulate("tc_monolithic", scenario, dt=0.1), tcbench.simulate("tc_banded", scenario, dt=0.1)
    assert np.allclose(fast.z, traced.z, rtol=1e-12, atol=1e-12)
    assert np.allclose(fast.energy, traced.energy, rtol=1e-14) and np.allclose(fast.entropy, traced.entropy, atol=1e-13)


def test_the_banded_jacobian_agrees_with_differences():
    n, rng = 6, np.random.default_rng(1)
    scenario = chain(n, masses=np.linspace(1, 2, n), stiffness=np.linspace(5, 20, n))
    model, z = scenario.model, scenario.model.state(scenario.z0)
    r0, p = model.springs(z.q), np.asarray(z.p).reshape(n, 2)

    def system(u):
        dq, ds = u.reshape(n, 3)[:, :2], u.reshape(n, 3)[:, 2]
        dr = np.diff(dq, axis=0, prepend=np.zeros((1, 2)))
        return banded.newton_system(model, p, np.asarray(z.s), 0.1, r0, dr, dq, ds)

    u = 0.05 * rng.normal(size=3 * n)
    diagonals, found = system(u)[1], np.zeros((3 * n, 3 * n))
    for i, j in np.ndindex(found.shape):
        if -banded.ABOVE <= i - j <= banded.BELOW:
            found[i, j] = diagonals[banded.ABOVE + i - j, j]
    steps = 1e-6 * np.eye(3 * n)
    differences = np.stack([(system(u + e)[0] - system(u - e)[0]).ravel() / 2e-6 for e in steps], axis=1)
    assert np.abs(found - differences).max() < 1e-8 * np.abs(found).max()


def test_the_laws_hold_at_every_length():
    for n in (10, 1000):
        run = tcbench.simulate("tc_banded", f"chain[n={n}]", dt=0.2, t_end=4.0)
        assert np.abs(run.energy - run.energy[0]).max() < 1e-13 * abs(run.energy[0])
        assert np.diff(run.entropy).min() > -1e-13 * np.abs(run.entropy).max()
        q, p = run.z[:, : 2 * n].reshape(-1, n, 2), run.z[:, 2 * n : 4 * n].reshape(-1, n, 2)
        J = (q[..., 0] * p[..., 1] - q[..., 1] * p[..., 0]).sum(axis=1)
        assert np.abs(J - J[0]).max() < 1e-12 * np.abs(q[0] * p[0][:, ::-1]).sum()


def test_cost_is_linear_in_the_number_of_masses():
    def fastest(n):
        return min(tcbench.simulate("tc_banded", f"chain[n={n}]", t_end=0.3).wall_time_s for _ in range(3))

    assert fastest(10_000) < 8 * fastest(2500)  # 4 if nothing else ran; a dense factorisation would give 64


def test_what_is_no_chain_is_refused_with_a_sentence():
    with pytest.raises(TcbenchError, match="written for chains"):
        banded.increments(PENDULUM.z0, 0.1, PENDULUM.model)
    with pytest.raises(TcbenchError, match="at least 2"):
        chain(1)
    for name, message in (("chain[n=x]", "whole number"), ("chain[m=3]", "No parameter"), ("chian", "mean 'chain'")):
        with pytest.raises(TcbenchError, match=message):
            find_scenario(name)
    with pytest.raises(TcbenchError, match="too large for formulas"):
        tcbench.simulate("tc_monolithic", "chain[n=1000]")
    with pytest.raises(TcbenchError, match="too large for formulas"):
        assert find_scenario("chain[n=1000]").model.observer
    with pytest.raises(TcbenchError, match="'short_term': it is written for chain only, not for pendulum"):
        tcbench.simulate("tc_banded", "short_term")
    assert tcbench.simulate("tc_banded", chain(5, t_end=1e7), dt=1e6).status == "nonfinite"


def test_workers_find_the_class_of_a_chain_by_name(tmp_path):
    results = tcbench.run(["tc_monolithic"], [chain(3, t_end=1.0)], ["conservation"], output=tmp_path, dt=[0.1])
    assert list(results.tables["conservation"]["status"]) == ["ok"]
    import tcbench_plugins.chain.chain as module

    assert module.Chain3 is chain_system(3) and not hasattr(module, "Chainx")


def test_chains_run_by_name_and_only_where_a_method_fits(tmp_path):
    job = plan_job(
        ["tc_banded", "tc_monolithic"], ["chain[n=3]", "chain[n=1000]", "short_term"], ["conservation"], dt=[0.1]
    )
    pairs = {(cell.integrator, cell.scenario) for cell in job.cells}
    assert pairs == {
        ("tc_banded", "chain[n=3]"), ("tc_banded", "chain[n=1000]"),
        ("tc_monolithic", "chain[n=3]"), ("tc_monolithic", "short_term"),
    }  # fmt: skip
    assert not job.context["scenarios"], "a scenario that has a name must not travel as data"
    results = tcbench.run(["tc_banded"], ["chain[n=40]"], ["conservation"], output=tmp_path, dt=[0.5])
    table = results.tables["conservation"]
    assert list(table["status"]) == ["ok"] and table["energy_error_max"].max() <= 1e-12
    assert find_integrator("tc_banded").systems == {"chain"} and "chain" not in tcbench.scenarios()


def test_long_chains_are_evaluated_as_short_ones_are():
    """Whole arrays beyond LONGEST_TRACED, compiled formulas below it: the same numbers."""
    scenario = chain(5)
    model, z = scenario.model, np.array([scenario.z0, scenario.z0 + 1e-3])
    plain = type("Plain5", (type(model),), {"by_arrays": True})(**scenario.constants)
    for name in ("energy", "entropy", "momenta", "temperatures", "observe", "exergy", "shapes"):
        assert np.allclose(getattr(plain, name)(z), getattr(model, name)(z), rtol=1e-13), name
        assert np.allclose(getattr(plain, name)(z[0]), getattr(model, name)(z[0]), rtol=1e-13), name
