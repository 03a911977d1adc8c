"""tc_gauss on arrays: networks of springs and any system over spaces, by the formulas of small ones."""

import numpy as np
import pytest
from collocation import matrix_of
from laws import assert_laws
from tcbench_plugins.chain.chain import chain
from tcbench_plugins.net.net import net
from tcbench_plugins.tc_gauss import method as methods
from tcbench_plugins.tc_gauss import newton_matrix, sparse
from tcbench_plugins.tc_gauss.method import GaussMethod, prepared

import tcbench
from tcbench.plugins import find_integrator
from tcbench.systems import traced

from ..helpers.networks import NETWORKS


@pytest.fixture
def afresh():
    """Methods are set up anew."""
    prepared.cache_clear()
    yield
    prepared.cache_clear()


def large(scenario):
    return bool(GaussMethod(scenario.model, 2).work.large)


@pytest.mark.parametrize("method", ["tc_gauss[k=1]", "tc_gauss_adaptive[k=2]"])
def test_states_of_springs_are_those_of_the_whole_trace(method, afresh, monkeypatch):
    settings, runs = {"tolerance": 1e-8} if "adaptive" in method else {"dt": 0.05}, []
    for most in (1, 32):
        monkeypatch.setattr(methods, "MOST_ELEMENTS", most)
        prepared.cache_clear()
        scenario = chain(6).replace(t_end=0.5)
        assert large(scenario) == (most == 1)
        runs.append(tcbench.simulate(method, scenario, **settings))
    assert runs[0].ok and np.abs(runs[0].z - runs[1].z).max() < 1e-7 * np.abs(runs[1].z).max()
    assert "adaptive" in method or np.abs(runs[0].z - runs[1].z).max() < 1e-11 * np.abs(runs[1].z).max()


@pytest.mark.parametrize("name", [n if n == "reactions" else pytest.param(n, marks=pytest.mark.slow) for n in NETWORKS])
def test_states_of_any_system_are_those_of_the_whole_trace(name, monkeypatch):
    scenario, settings = NETWORKS[name], {"tc_gauss": {"dt": 0.1}, "tc_gauss_adaptive": {"tolerance": 1e-6}}
    runs = [tcbench.simulate(method, scenario, **more) for method, more in settings.items()]
    assert large(scenario)
    monkeypatch.setattr(traced, "ENTRY_BY_ENTRY", 10**6)
    whole = scenario.replace(name="whole")
    assert not large(whole)
    for run, (method, more), apart in zip(runs, settings.items(), (1e-13, 1e-9), strict=True):
        assert_laws(run)
        assert np.abs(run.z - tcbench.simulate(method, whole, **more).z).max() < apart


@pytest.mark.parametrize("name", NETWORKS)
def test_matrix_and_factors_are_those_of_differences(name):
    scenario = NETWORKS[name]
    model, z, eps = scenario.model, scenario.z0, 1e-5
    n, w = model.size, GaussMethod(model, 2).work
    newton_matrix.set_matrix(w, z)
    s, whole = w.sparse, -matrix_of(w)
    M = whole[:n, n:] @ np.linalg.solve(whole[n:, n:], whole[n:, :n]) - whole[:n, :n]  # without the shared numbers
    field = model.vector_field(np.concatenate([z + eps * np.eye(n), z - eps * np.eye(n)]))
    differences = (field[:n] - field[n:]).T / (2 * eps)
    assert np.abs(M - differences).max() < 2e-9 * np.abs(M).max()
    right = np.random.default_rng(0).normal(size=(2, n))
    x, y = right.copy()
    sparse.factor(s, 0, 0.3, 0.2)
    sparse.solve(s, 0, x, y)
    expected = np.linalg.solve(np.eye(n) - (0.3 + 0.2j) * M, right[0] + 1j * right[1])
    assert np.abs(x + 1j * y - expected).max() < 1e-12 * np.abs(expected).max() * np.linalg.cond(M)
    exact = np.abs(np.linalg.eigvals(M)).max()
    assert 0.3 * exact < sparse.fastest(s, 8, 4) < 3.0 * exact


def stiff_net(times=1e4):
    scenario = net(3, 3)
    return scenario.replace(conductivity=times * scenario.constants["conductivity"], t_end=5.0)


@pytest.mark.parametrize("k", [pytest.param(1, marks=pytest.mark.thorough), 3])
def test_corrections_solve_the_linear_system_of_all_stages(k):
    scenario, h = stiff_net(), 0.1
    w = GaussMethod(scenario.model, k).work
    m, w.n_lanes = w.m, 0
    newton_matrix.prepare(w, h, scenario.z0)
    assert w.solve.stiff
    before, new = np.random.default_rng(k).normal(size=(2, m, k))
    w.before[:], w.N[:, :k] = before, new
    newton_matrix.solve_stages(w)
    whole = np.eye(m * k) - h * np.kron(matrix_of(w), w.numbers.A)
    expected = before + np.linalg.solve(whole, (new - before).ravel()).reshape(m, k)
    assert np.abs(w.U[:, :k] - expected).max() < 1e-9 * np.abs(expected).max()
    w.sides[:, :2] = new[:, [0, -1]]
    newton_matrix.damp(w, h)
    assert np.abs(w.sides[:, :2] - np.linalg.solve(np.eye(m) - h * matrix_of(w), new[:, [0, -1]])).max() < 1e-9


NET = net(6, 6).replace(t_end=0.4)
CASES = [(NET, "tc_gauss[k=1]", (0.05, 0.025)), (NET, "tc_gauss", (0.1, 0.05)),
         (NETWORKS["dashpots"].replace(t_end=0.8), "tc_gauss[k=2]", (0.2, 0.1))]  # fmt: skip


@pytest.mark.parametrize(("scenario", "method", "steps"), CASES, ids=str)
def test_orders_and_laws(scenario, method, steps):
    fine = tcbench.simulate("tc_gauss[k=4]", scenario, dt=0.0125).z[-1]
    runs = [tcbench.simulate(method, scenario, dt=h) for h in steps]
    errors = [np.abs(run.z[-1] - fine).max() for run in runs]
    assert abs(np.log2(errors[0] / errors[1]) - find_integrator(method).order) < 0.5
    for run in runs:
        assert_laws(run)


def test_tolerances_are_met():
    scenario = NETWORKS["shared_bath"].replace(t_end=2.0)
    fine = tcbench.simulate("tc_gauss", scenario, dt=0.02).z[-1]
    for tolerance in (1e-4, 1e-8):
        run = tcbench.simulate("tc_gauss_adaptive", scenario, tolerance=tolerance)
        assert_laws(run)
        assert np.abs(run.z[-1] - fine).max() < 10 * tolerance


def test_large_systems_step_and_keep_the_laws():
    assert_laws(tcbench.simulate("tc_gauss[k=2]", "net[nx=20,ny=20]", dt=0.05, t_end=0.25), 1e-11, 1e-12, 1e-8)
    assert_laws(tcbench.simulate("tc_gauss_adaptive", "chain[n=500]", t_end=0.5, tolerance=1e-6), 1e-11, 1e-12, 1e-8)


@pytest.mark.parametrize("fill", [10_000, 0])
def test_what_is_stiff_is_solved(fill, afresh, monkeypatch):
    """Conduction of 0.02 s through elements of 1/60, 70 decay times; with incomplete factors, too, which are exact in a
    row. And of a net ten thousand times as fast as it ships, by springs."""
    monkeypatch.setattr(sparse, "FILLED", fill)
    monkeypatch.setattr(sparse, "NARROW", 0.0)
    assert_laws(tcbench.simulate("tc_gauss", "bar[n=60]", dt=0.02, t_end=0.2))
    assert_laws(tcbench.simulate("tc_gauss_adaptive", "bar[n=60]", tolerance=1e-5, t_end=0.2))
    assert_laws(tcbench.simulate("tc_gauss", stiff_net(), dt=0.05, t_end=1.0), 1e-11)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["tc_gauss_adaptive", "tc_auto"])
def test_stiff_conduction_of_a_net_costs_no_steps(name):
    scenario, tolerance = stiff_net(), 1e-6
    run = tcbench.simulate(name, scenario, tolerance=tolerance)
    assert run.ok and run.steps < 400  # of which 200 are between output times; explicit ones are 100,000
    assert run.summary.energy_error_max < 1e-12 * scenario.initial_exergy and run.summary.entropy_increment_min > -1e-13
    times = np.array([0.0, scenario.t_end])
    _, cost = find_integrator(name).adaptive(scenario.model, scenario.z0, times, 1e-4, 1e-4)
    assert cost["steps"] < 90  # 187, were the defect not damped by the conduction
    fine = tcbench.simulate("tc_gauss_adaptive", scenario, tolerance=1e-8).z[-1]
    assert np.abs(run.z[-1] - fine).max() < 1e3 * tolerance


def test_a_shared_system_is_worked_on_by_each_method_alone():
    scenario = NETWORKS["drag"]
    used, fresh = (GaussMethod(scenario.model, 2) for _ in range(2))
    used.adaptive(scenario.z0, np.array([0.0, 1.0]), 1e-6)
    assert np.array_equal(used.increments(scenario.z0, 0.3), fresh.increments(scenario.z0, 0.3))
