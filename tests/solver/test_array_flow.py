"""Formulas traced on arrays: equal to the whole trace, their Jacobians exact, and refused where they do not treat all
alike."""

import numpy as np
import pytest
from tcbench_plugins.net.net import net

import tcbench
from tcbench.analysis import theorems
from tcbench.compiler.library import evaluate
from tcbench.plugins import find_integrator
from tcbench.solver.flow_kernels import build
from tcbench.systems import traced

from ..helpers.networks import NETWORKS, N

LATER = pytest.mark.thorough
OF_ELEMENTS = ["midpoint_temperature[reading=a5_literal]", "tc_strang_exact",
               *(pytest.param(name, marks=LATER) for name in ("tc_mean_value", "bdf2"))]  # fmt: skip
PAIRS = [("tc_strang", "dashpots"), ("tc_monolithic", "reactions"),
         pytest.param("tc_gonzalez", "shared_bath", marks=LATER)]  # fmt: skip
NET = net(2, 2)  # of 22 variables: what a whole trace and its elimination cost grows with their square
LOOPS = "in loops over the elements"


@pytest.fixture(autouse=True)
def arrays_from_twenty_variables_on(monkeypatch):
    monkeypatch.setattr(traced, "ENTRY_BY_ENTRY", 20)


@pytest.fixture
def whole(monkeypatch):
    """Trace entry by entry, whatever the size."""

    def run(method, scenario, **options):
        with monkeypatch.context() as m:
            m.setattr(traced, "ENTRY_BY_ENTRY", 10**6)
            found = tcbench.simulate(method, scenario.replace(name="whole"), **options)
        assert LOOPS not in found.solver.way
        return found

    return run


class Insulated(type(NET.model)):
    """Springs that conduct no heat, which is known in closed form."""

    name = "insulated"

    def conduction(self, theta):
        return 0.0 * theta

    def conduction_flow(self, theta, t):
        return 0.0 * t * theta, theta


@pytest.mark.parametrize("method", OF_ELEMENTS)
def test_flows_of_elements_are_those_of_the_whole_trace(method, whole):
    model, net = NET.model, NET.replace(t_end=0.3)
    if find_integrator(method).needs:
        constants = {name: getattr(model, name) for name in [*model.constants, *model.tables]}
        net = tcbench.Scenario("insulated", Insulated, constants, **model.initial_of(NET.z0), dt=NET.dt, t_end=0.3)
    run, expected = tcbench.simulate(method, net), whole(method, net)
    assert run.ok and LOOPS in run.solver.way
    assert np.abs(run.z - expected.z).max() < 1e-13


@pytest.mark.parametrize(("method", "name"), PAIRS)
def test_flows_of_any_system_are_those_of_the_whole_trace(method, name, whole):
    scenario = NETWORKS[name]
    run, expected = tcbench.simulate(method, scenario, t_end=0.2), whole(method, scenario, t_end=0.2)
    assert run.ok and LOOPS in run.solver.way
    assert np.abs(run.z - expected.z).max() < 1e-13
    assert run.summary.entropy_increment_min > 0.0
    assert run.summary.energy_error_max < 1e-13 or not method.startswith("tc_")


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["row"])
def test_a_number_that_all_share_does_not_end_an_iteration(name):
    """Where nothing has moved yet the factor of Gonzalez's projection is 0/0. Its first correction was 1e16, beside
    which the second seemed to be the last: of a hundred steps three were wrong, by up to 1.7 of the energy, and ok."""
    runs = theorems.random_steps(find_integrator("tc_gonzalez"), NETWORKS[name])
    assert all(run.steps == 1 for run in runs)
    assert max(map(theorems.energy_defect, runs)) < theorems.SOLVED


@pytest.mark.parametrize("method", ["ybaby", "mybaby"])
def test_a_method_that_takes_numbers_one_by_one_says_that_arrays_are_not_for_it(method):
    with pytest.raises(tcbench.TcbenchError, match="take the numbers of a state one by one"):
        tcbench.simulate(method, NETWORKS["drag"])


@pytest.mark.parametrize(
    ("method", "name"), [*(("tc_monolithic", name) for name in NETWORKS), ("gauss2", "shared_bath")]
)
def test_jacobians_are_those_of_differences(method, name):
    scenario = NETWORKS[name]
    model = scenario.model
    kernels = build(tcbench.integrators()[method].flows[0], model)
    n, pattern = kernels.n_unknowns, kernels.pattern
    c = np.concatenate([[0.1], model.constant_values[1:], scenario.z0, scenario.z0])
    w, out = (np.zeros(k.size + k.room) for k in (kernels.opening, kernels.iterate))
    evaluate(kernels.opening.address, np.array(scenario.z0), c, w)
    x = w[:n] + 1e-3 * np.cos(np.arange(n))

    def residual(x):
        evaluate(kernels.iterate.address, w, np.ascontiguousarray(x), out)
        return out[:n].copy()

    step = 1e-5
    differences = np.array([(residual(x + step * e) - residual(x - step * e)) / (2 * step) for e in np.eye(n)]).T
    residual(x)
    found = np.zeros((n, n))
    rows = np.repeat(np.arange(n), np.diff(pattern.first))
    found[pattern.order[rows], pattern.order[pattern.columns]] = out[n : n + pattern.nnz]
    m = n - int(
        (differences == 0.0).all(axis=1).sum()
    )  # behind: numbers that all entries read, as the others make them
    assert (m < n) == (name == "shared_bath")
    differences, shared = differences[:m, :m], np.linalg.solve(found[m:, m:], found[m:, :m])
    found = found[:m, :m] - found[:m, m:] @ shared
    assert np.abs(found - differences).max() < 1e-9 * max(1.0, np.abs(found).max())


def test_what_belongs_to_a_spring_alone_is_condensed():
    ways = [tcbench.simulate("tc_monolithic", NETWORKS[n], t_end=0.1).solver.way for n in ("row", "dashpots")]
    assert ways == [f"sparse: {3 * N} unknowns, in loops over the elements"] * 2


def mixing(z0, z1, h, system):
    return z1 - z0 - h * system.vector_field(z0) + 1e-3 * (z0.q[0] - z0.q[1])


def by_length(z0, z1, h, system):
    return z1 - z0 - h * system.vector_field(z0) * (len(z0.q) / 100.0)


def by_place(z0, z1, h, system):
    return (z1 - z0) - h * system.vector_field(z0) * np.linspace(1.0, 2.0, NET.model.size)


@pytest.mark.parametrize(
    ("formula", "sentence"),
    [(mixing, "positions are asked for by number. x"), (by_length, "how many positions there are is not known"),
     (by_place, "a whole state meets an array")],
)  # fmt: skip
def test_what_does_not_treat_all_alike_is_refused_at_its_line(formula, sentence):
    method = tcbench.Integrator(name="odd", order=1, flows=formula)
    line = formula.__code__.co_firstlineno + 1
    with pytest.raises(tcbench.TcbenchError, match=rf"test_array_flow.py, line {line}: .*{sentence}"):
        tcbench.simulate(method, NET, dt=0.01, t_end=0.02)


def with_mean(z0, z1, h, system):
    return z1 - z0 - h * system.vector_field(z0) * (system.temperatures(z0).mean() / 300.0)


def by_count(z0, z1, h, system):
    return z1 - z0 - h * system.vector_field(z0) * (np.sum(system.temperatures(z0)) / system.n_elements / 300.0)


@pytest.mark.parametrize("formula", [with_mean, by_count])
def test_means_are_taken_over_all(formula, whole):
    method = tcbench.Integrator(name="mean", order=1, flows=formula)
    run, expected = tcbench.simulate(method, NET, t_end=0.3), whole(method, NET, t_end=0.3)
    assert LOOPS in run.solver.way and np.abs(run.z - expected.z).max() < 1e-13
