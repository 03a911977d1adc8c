"""Methods with a memory: the formula sees earlier states, a starter does the first steps, orders are as in theory."""

import numpy as np
import pytest

import tcbench
from tcbench import Flow, Integrator, TcbenchError
from tcbench.analysis.theorems import steps as random_claims
from tcbench.simulation.python_loop import Monitor
from tcbench.studies import convergence

SCENARIO = tcbench.scenarios()["bound_equilibrium"]


def bdf2(z0, z1, h, system, before):
    return z1 - z0 - (z0 - before[0]) / 3 - 2 / 3 * h * system.vector_field(z1)


def bdf3(z0, z1, h, system, before):
    return z1 - (18 * z0 - 9 * before[0] + 2 * before[1]) / 11 - 6 / 11 * h * system.vector_field(z1)


def adams(z0, z1, h, system, before):
    return z1 - z0 - h * (1.5 * system.vector_field(z0) - 0.5 * system.vector_field(before[0]))


def adams_step(z, h, system, before):
    return z + h * (1.5 * system.vector_field(z) - 0.5 * system.vector_field(before[0]))


def made(name, order, **ways):
    return Integrator(name=name, order=order, memory=order - 1, starter="tc_monolithic", source="x", **ways)


METHODS = [
    made("bdf2", 2, flows=bdf2), made("bdf3", 3, flows=bdf3), made("adams", 2, flows=adams),
    made("adams_step", 2, step=adams_step),
]  # fmt: skip


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
def test_the_order_is_that_of_theory(method):
    steps = [SCENARIO.t_converge / 2**k for k in range(4, 10)]
    row = convergence.measure(method, SCENARIO, {"dt": steps})
    fit = next(item for item in row["orders"] if item["variable"] == "all")
    assert fit["verdict"] == "as declared" and abs(fit["order"] - method.order) < 0.02, fit


@pytest.mark.parametrize("method", METHODS[:2], ids=lambda m: m.name)
def test_every_step_satisfies_the_formula_and_the_first_ones_are_the_starters(method):
    h, k = 0.05, method.memory
    run = tcbench.simulate(method, SCENARIO, dt=h, t_end=1.0)
    start = tcbench.simulate("tc_monolithic", SCENARIO, dt=h, t_end=k * h)
    assert run.steps == 20 and np.array_equal(run.z[: k + 1], start.z)
    system = SCENARIO.model
    for i in range(k, 20):
        before = tuple(system.state(run.z[i - j]) for j in range(1, k + 1))
        left = method.flows[0].residual(system.state(run.z[i]), system.state(run.z[i + 1]), h, system, before)
        assert np.abs(np.asarray(left)).max() < 1e-12


def test_a_formula_and_a_step_function_agree_and_temperatures_are_temperatures():
    def heat(z0, z1, h, system, before):
        assert before[0].shape == z0.shape
        return z1 - z0 - h * (1.5 * system.temperature_field(z0) - 0.5 * system.temperature_field(before[0]))

    formula, function = (tcbench.simulate(method, SCENARIO, dt=0.02, t_end=2.0) for method in METHODS[2:])
    assert formula.ok and np.allclose(formula.z, function.z, rtol=0, atol=1e-13)
    warm = tcbench.simulate(made("heat", 2, flows=heat, variables="temperature"), SCENARIO, dt=0.001, t_end=0.2)
    fine = tcbench.simulate("tc_gauss", SCENARIO, dt=0.01, t_end=0.2)
    assert warm.ok and np.abs(warm.z[-1] - fine.z[-1]).max() < 1e-5


def test_large_steps_are_followed_from_zero():
    """BDF2 on its own would start Newton from a state that is no root at h = 0; the earlier state moves with h."""
    run = tcbench.simulate(METHODS[0], "stiff_spring", dt=1.0, t_end=10.0)
    assert run.status in ("ok", "blowup") and run.solver.tracked > 0, run


def test_a_run_shorter_than_the_memory_and_a_starter_that_fails():
    short = tcbench.simulate(METHODS[1], SCENARIO, dt=0.1, t_end=0.1)
    assert short.ok and short.steps == 1

    def broken(z, h, system):
        raise ArithmeticError("no")

    starter = Integrator(name="broken", order=1, step=broken)
    for ways in ({"flows": bdf2}, {"step": adams_step}):
        failed = tcbench.simulate(Integrator(name="x", order=2, memory=1, starter=starter, **ways), SCENARIO)
        assert failed.status == "nonconverged" and "starter broken" in failed.failure and failed.steps == 0


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"memory": 1, "flows": bdf2}, "starter="),
        ({"starter": "tc_monolithic", "flows": bdf2}, "memory="),
        ({"memory": -1, "starter": "tc_monolithic", "flows": bdf2}, "number of earlier states"),
        ({"memory": 1, "starter": "tc_monolithic", "adaptive": bdf2}, "equal"),
        ({"memory": 1, "starter": "tc_monolithic", "flows": [(bdf2, 0.5), (bdf2, 0.5)]}, "one formula"),
        ({"memory": 1, "starter": "tc_monolithic", "flows": Flow(bdf2, of_step=True)}, "one formula"),
    ],
)
def test_what_makes_no_multistep_method_is_refused(given, words):
    with pytest.raises(TcbenchError, match=words):
        Integrator(name="x", order=2, **given)


def test_a_starter_that_does_not_exist_is_named():
    with pytest.raises(TcbenchError, match="tc_monolithic"):
        tcbench.simulate(Integrator(name="x", order=2, memory=1, starter="tc_monolitic", flows=bdf2), SCENARIO)


@pytest.mark.parametrize(
    ("starter", "words"),
    [("scipy_dop853", "adaptive solver"), ("tc_auto", "adaptive solver"), ("controlled", "adaptive solver"),
     (METHODS[0], "multistep method"), ("tc_staggered", "of order 1: take a one-step method of order 2 or more")],
)  # fmt: skip
@pytest.mark.parametrize("ways", [{"flows": bdf3}, {"step": adams_step}], ids=["flows", "step"])
def test_a_starter_that_takes_no_equal_steps_is_refused(starter, words, ways):
    method = Integrator(name="x", order=3, memory=2, starter=starter, source="x", **ways)
    with pytest.raises(TcbenchError, match=words):
        tcbench.simulate(method, SCENARIO)


@pytest.mark.parametrize(("every", "first"), [(1, 1), (3, 1), (1, 5), (7, 4)])
def test_more_rows_than_steps_are_not_written_behind_the_records(every, first):
    """Whoever gives them: the rows that a run has room for are kept, and the memory behind them stays as it is."""
    monitor = Monitor(SCENARIO, 0.1, 10, every)
    n, run, room = len(SCENARIO.z0), monitor.run, monitor.run.n_rows
    memory = np.full((room + 200) * n, 7.0)
    run.lend("states", memory[: room * n].reshape(room, n))
    reason, done = monitor.add(first, np.tile(SCENARIO.z0, (200, 1)))
    assert reason == 0 and done == (room - 1) * every and (memory[room * n :] == 7.0).all()


def test_claims_are_measured_on_steps_of_the_formula_itself():
    """Its starter keeps the energy; BDF2, which claims it here, does not."""
    liar = Integrator(name="liar", order=2, memory=1, starter="tc_monolithic", claims={"energy"}, flows=bdf2)
    found = list(random_claims(liar, SCENARIO))
    assert "energy" in found[0].claim and not found[0].agrees
