"""tc_gauss on networks: formulas traced on arrays are those of the whole trace, and keep its promises."""

import numpy as np
import pytest
from collocation import matrix_of
from tcbench_plugins.chain.chain import chain
from tcbench_plugins.net.net import net
from tcbench_plugins.tc_gauss import conduction, formulas, sparse
from tcbench_plugins.tc_gauss.method import GaussMethod, prepared

import tcbench


def traced_as_a_whole_up_to(elements, monkeypatch, scenario):
    """Formulas are made anew for the scenario's system."""
    monkeypatch.setattr(formulas, "MOST_ELEMENTS", elements)
    forget()


def forget():
    for function in (formulas.formulas, formulas.iteration, formulas.on_vectors, prepared):
        function.cache_clear()


@pytest.fixture(autouse=True)
def afresh():
    yield
    forget()


@pytest.mark.parametrize("method", ["tc_gauss", "tc_gauss[k=1]", "tc_gauss_adaptive[k=4]"])
@pytest.mark.parametrize("scenario", [net(3, 3), chain(6)], ids=["net", "chain"])
def test_states_are_those_of_the_whole_trace(method, scenario, monkeypatch):
    settings = {"tolerance": 1e-8} if "adaptive" in method else {"dt": 0.05}
    scenario = scenario.replace(t_end=0.5)
    traced_as_a_whole_up_to(1, monkeypatch, scenario)
    run = tcbench.simulate(method, scenario, **settings)
    assert GaussMethod(scenario.model, 2).work.large  # on arrays
    traced_as_a_whole_up_to(32, monkeypatch, scenario)
    assert GaussMethod(scenario.model, 2).work.to_iterate  # on vectors
    expected = tcbench.simulate(method, scenario, **settings)
    assert run.ok and expected.ok
    assert np.abs(run.z - expected.z).max() < (1e-7 if "adaptive" in method else 1e-11) * np.abs(expected.z).max()


@pytest.mark.parametrize("method", ["tc_gauss[k=1]", "tc_gauss[k=2]", "tc_gauss"])
def test_orders_and_laws_on_a_net(method):
    scenario, order = net(6, 6), tcbench.plugins.find_integrator(method).order
    fine = tcbench.simulate("tc_gauss[k=4]", scenario, dt=0.0125, t_end=0.4).z[-1]
    steps = (0.05, 0.025) if order < 6 else (0.1, 0.05)
    runs = [tcbench.simulate(method, scenario, dt=h, t_end=0.4) for h in steps]
    errors = [np.abs(run.z[-1] - fine).max() for run in runs]
    assert abs(np.log2(errors[0] / errors[1]) - order) < 0.5
    for run in runs:
        assert run.ok and run.summary.energy_error_max < 1e-12 and run.summary.entropy_increment_min > -1e-13


@pytest.mark.parametrize("name", ["chain[n=500]", "net[nx=20,ny=20]"])
def test_large_systems_step_and_keep_the_laws(name):
    for run in (
        tcbench.simulate("tc_gauss[k=2]", name, dt=0.05, t_end=0.25),
        tcbench.simulate("tc_gauss_adaptive", name, t_end=0.5, tolerance=1e-6),
    ):
        assert run.ok and run.summary.energy_error_max < 1e-11 and run.summary.entropy_increment_min > -1e-12
        for name_of, error in run.summary.invariant_error_max.items():
            assert error < 1e-11 * np.abs(run.z[0, : 2 * 500]).max() * 500, name_of


def stiff_net(times=1e4):
    scenario = net(3, 3)
    return scenario.replace(conductivity=times * scenario.constants["conductivity"], t_end=5.0)


def test_the_matrix_of_the_conduction_is_its_derivative():
    scenario = stiff_net()
    model, method = scenario.model, GaussMethod(scenario.model, 3)
    n, e = model.n_positions, model.n_elements
    conduction.set_matrix(method.work, scenario.z0)
    matrix = matrix_of(method.work)
    for j in range(e):
        step = np.zeros(model.size)
        step[2 * n + j] = 1e-5
        slope = (model.vector_field(scenario.z0 + step) - model.vector_field(scenario.z0 - step))[2 * n :] / 2e-5
        assert np.abs(matrix[:, j] - slope).max() < 1e-6 * np.abs(slope).max()
    exact = np.abs(np.linalg.eigvals(matrix)).max()
    assert 0.8 * exact < conduction.rate_of(method.work, scenario.z0, 12, 11) < 1.01 * exact


@pytest.mark.parametrize("k", [1, 2, 3, 4, 7])
def test_corrections_solve_the_linear_system_of_all_stages(k):
    scenario, h = stiff_net(), 0.1
    w = GaussMethod(scenario.model, k).work
    n, e = w.n, w.e
    conduction.prepare(w, h, scenario.z0)
    assert w.stiff[2] == 1.0
    before, new = np.random.default_rng(k).normal(size=(2, e, k))
    w.U[n:, :k] = before
    conduction.keep(w)
    w.U[n:, :k] = 7.0  # what an iteration leaves there does not count
    w.N[n:, :k] = new
    conduction.correct(w)
    whole = np.eye(e * k) - h * np.kron(matrix_of(w), w.numbers.A)
    expected = before + np.linalg.solve(whole, (new - before).ravel()).reshape(e, k)
    assert np.abs(w.U[n:, :k] - expected).max() < 1e-10  # the eigenvectors of A, k = 7, have a condition of 2e3
    defects = new[:, 0].copy()
    sparse.factor(w.sparse, w.numbers.pairs, h, 0.0)
    conduction.damp(w, defects)
    assert np.abs(defects - np.linalg.solve(np.eye(e) - h * matrix_of(w), new[:, 0])).max() < 1e-12


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["tc_gauss_adaptive", "tc_auto"])
def test_stiff_conduction_of_a_net_costs_no_steps(name):
    scenario, tolerance = stiff_net(), 1e-6
    run = tcbench.simulate(name, scenario, tolerance=tolerance)
    assert run.ok and run.steps < 400  # of which 200 are between output times; explicit ones are 100,000
    assert run.summary.energy_error_max < 1e-12 * scenario.initial_exergy and run.summary.entropy_increment_min > -1e-13
    times = np.array([0.0, scenario.t_end])
    _, cost = tcbench.integrators()[name].adaptive(scenario.model, scenario.z0, times, 1e-4, 1e-4)
    assert cost["steps"] < 90  # 187, were the defect not damped by the conduction
    fine = tcbench.simulate("tc_gauss_adaptive", scenario, tolerance=1e-8).z[-1]
    assert np.abs(run.z[-1] - fine).max() < 1e3 * tolerance


@pytest.mark.parametrize("k", [1, 2, 3, 4])
def test_stiff_conduction_of_a_net_is_solved_at_a_fixed_step(k):
    scenario = stiff_net()
    run = tcbench.simulate(f"tc_gauss[k={k}]", scenario, dt=0.05, t_end=1.0)
    assert run.ok
    assert run.summary.energy_error_max < 1e-11 and run.summary.entropy_increment_min > -1e-13
