"""tc_gauss on arrays: any system over spaces, by the same formulas as a small one and with sparse factors."""

import numpy as np
import pytest
from collocation import matrix_of
from tcbench_plugins.tc_gauss import conduction, sparse
from tcbench_plugins.tc_gauss.method import GaussMethod, prepared

import tcbench
from tcbench.systems import traced

from ..helpers.networks import NETWORKS


def kept(run):
    assert run.ok and run.summary.energy_error_max < 1e-12 and run.summary.entropy_increment_min > -1e-13
    assert max(run.summary.invariant_error_max.values(), default=0.0) < 1e-12


@pytest.mark.parametrize("name", NETWORKS)
def test_states_are_those_of_the_whole_trace(name, monkeypatch):
    scenario, settings = NETWORKS[name], {"tc_gauss": {"dt": 0.1}, "tc_gauss_adaptive": {"tolerance": 1e-6}}
    runs = [tcbench.simulate(method, scenario, **more) for method, more in settings.items()]
    assert GaussMethod(scenario.model, 3).work.large
    monkeypatch.setattr(traced, "FEW", 10**6)
    whole = scenario.replace(name="whole")
    assert not GaussMethod(whole.model, 3).work.large
    for run, (method, more), apart in zip(runs, settings.items(), (1e-13, 1e-9), strict=True):
        kept(run)
        expected = tcbench.simulate(method, whole, **more)
        assert np.abs(run.z - expected.z).max() < apart


@pytest.mark.parametrize("name", NETWORKS)
def test_matrix_and_factors_are_those_of_differences(name):
    scenario = NETWORKS[name]
    model, z, step = scenario.model, scenario.z0, 1e-5
    n, w = model.size, GaussMethod(model, 2).work
    conduction.set_matrix(w, z)
    s = w.sparse
    whole = -matrix_of(w)
    M = whole[:n, n:] @ np.linalg.solve(whole[n:, n:], whole[n:, :n]) - whole[:n, :n]  # without the shared numbers
    field = model.vector_field(np.concatenate([z + step * np.eye(n), z - step * np.eye(n)]))
    differences = (field[:n] - field[n:]).T / (2 * step)
    assert np.abs(M - differences).max() < 2e-9 * np.abs(M).max()
    right = np.random.default_rng(0).normal(size=(2, n))
    x, y = right.copy()
    sparse.factor(s, 0, 0.3, 0.2)
    sparse.solve(s, 0, x, y)
    expected = np.linalg.solve(np.eye(n) - (0.3 + 0.2j) * M, right[0] + 1j * right[1])
    assert np.abs(x + 1j * y - expected).max() < 1e-12 * np.abs(expected).max() * np.linalg.cond(M)
    exact = np.abs(np.linalg.eigvals(M)).max()
    assert 0.3 * exact < sparse.fastest(s, 8, 4) < 3.0 * exact


@pytest.mark.parametrize("k", [1, 2, 3])
def test_orders(k):
    scenario = NETWORKS["dashpots"].replace(t_end=0.8)
    fine = tcbench.simulate("tc_gauss[k=5]", scenario, dt=0.05).z[-1]
    method = "tc_gauss" if k == 3 else f"tc_gauss[k={k}]"
    runs = [tcbench.simulate(method, scenario, dt=h) for h in ((0.4, 0.2) if k == 3 else (0.2, 0.1))]
    errors = [np.abs(run.z[-1] - fine).max() for run in runs]
    assert abs(np.log2(errors[0] / errors[1]) - 2 * k) < 0.5


def test_tolerances_are_met():
    scenario = NETWORKS["shared_bath"].replace(t_end=2.0)
    fine = tcbench.simulate("tc_gauss[k=5]", scenario, dt=0.05).z[-1]
    for tolerance in (1e-4, 1e-8):
        run = tcbench.simulate("tc_gauss_adaptive", scenario, tolerance=tolerance)
        kept(run)
        assert np.abs(run.z[-1] - fine).max() < 10 * tolerance


@pytest.mark.parametrize("fill", ["whole", "none"])
def test_what_is_stiff_is_solved(fill, monkeypatch):
    """Conduction of 0.02 s through elements of 1/60, 70 decay times; with incomplete factors, too, which are exact in a
    row."""
    monkeypatch.setattr(sparse, "FILLED", 10_000 if fill == "whole" else 0)
    monkeypatch.setattr(sparse, "NARROW", 0.0)
    prepared.cache_clear()
    kept(tcbench.simulate("tc_gauss", "bar[n=60]", dt=0.02, t_end=0.2))
    run = tcbench.simulate("tc_gauss_adaptive", "bar[n=60]", tolerance=1e-5, t_end=0.2)
    kept(run)
    prepared.cache_clear()


def test_a_shared_system_is_worked_on_by_each_method_alone():
    scenario = NETWORKS["drag"]
    used, fresh = (GaussMethod(scenario.model, 2) for _ in range(2))
    used.adaptive(scenario.z0, np.array([0.0, 1.0]), 1e-6)
    assert np.array_equal(used.increments(scenario.z0, 0.3), fresh.increments(scenario.z0, 0.3))
