"""A run holds its own memory: other runs in between, and failures, change no bit."""

import contextlib
import math

import pytest

import tcbench
from tcbench import Integrator, TcbenchError
from tcbench.plugins import find_scenario
from tcbench.simulation import metrics

from ..helpers.every_kind import KINDS, adams, bdf2, method_of, richardson, settings, simulate, variants

# one after the other ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", KINDS)
def test_other_runs_in_between_and_runs_that_fail_change_nothing(name):
    first, second, third = variants("bound_equilibrium")
    method = method_of(name)
    alone = simulate(name, first)
    simulate(name, second)
    simulate(name, first, dt=0.05, tolerance=1e-3)
    stiff = first.replace(stiffness=[1e4, 1e4])
    tcbench.simulate(method, stiff, **settings(method, dt=0.25, tolerance=0.1))  # however it ends
    simulate(name, third)
    assert simulate(name, first) == alone


STEPPED = [name for name in KINDS if method_of(name).kind != "adaptive" and not method_of(name).memory]


@pytest.mark.parametrize("name", STEPPED)
def test_a_step_is_a_function_of_its_start_and_length(name):
    """Also from where the last one ended, after others and after those that fail."""
    scenario = find_scenario("bound_equilibrium")
    step, h = tcbench.stepper(method_of(name), scenario), 0.05
    z = scenario.z0
    for _ in range(10):
        z = step(z, h)
    on = step(z, h).tobytes()
    for disturbance in (lambda: step(scenario.z0, 2 * h), lambda: step(1e3 * scenario.z0, 1e6), lambda: None):
        with contextlib.suppress(ArithmeticError):
            disturbance()
        assert step(z, h).tobytes() == on
    assert tcbench.stepper(method_of(name), scenario)(z, h).tobytes() == on


@pytest.mark.parametrize(
    ("inner", "error"),
    [("tc_monolithic", KeyboardInterrupt), ("tc_gauss", ArithmeticError), ("tc_taylor[order=8]", SystemExit)],
)
def test_a_run_that_was_interrupted_leaves_nothing_behind(inner, error):
    def stops(z, h, system):
        step = tcbench.stepper(inner, system)
        z1 = step(step(z, h / 2), h / 2)
        if z is not scenario.z0 and z[0] != scenario.z0[0]:
            raise error
        return z1

    scenario = find_scenario("bound_equilibrium").replace(t_end=0.5)
    alone = simulate(inner, scenario), simulate("controlled[method=tc_monolithic]", scenario, tolerance=1e-3)
    with contextlib.suppress(error):
        tcbench.simulate(Integrator(name="stops", order=1, step=stops), scenario, dt=0.1)
    again = simulate(inner, scenario), simulate("controlled[method=tc_monolithic]", scenario, tolerance=1e-3)
    assert again == alone


# workspaces ---------------------------------------------------------------------------------------------------------


def test_a_workspace_is_made_for_each_run_and_given_to_step_and_march():
    made = []

    def workspace(system):
        made.append([system.size])
        return made[-1]

    def step(z, h, system, held):
        held.append(h)
        return z + h * system.vector_field(z)

    def march(z, h, count, system, held):
        return [z := step(z, h, system, held) for _ in range(count)]

    scenario = find_scenario("bound_equilibrium").replace(t_end=0.1)
    for ways in ({}, {"march": march}):
        method = Integrator(name="held", order=1, step=step, workspace=workspace, **ways)
        for _ in range(2):
            tcbench.simulate(method, scenario, dt=0.01)
    assert made == [[scenario.model.size, *[0.01] * 10]] * 4


def test_a_multistep_method_has_its_workspace_behind_the_earlier_states():
    def step(z, h, system, before, held):
        held.append(len(before))
        return adams(z, h, system, before)

    held = []
    method = Integrator(name="held", order=2, memory=1, starter="tc_gauss", step=step, workspace=lambda system: held)
    tcbench.simulate(method, find_scenario("bound_equilibrium"), dt=0.01, t_end=0.05)
    assert held == [1] * 4


def test_a_workspace_without_a_step_is_refused():
    for ways in ({"flows": bdf2}, {"adaptive": lambda *a: None}):
        with pytest.raises(TcbenchError, match="workspace= without step="):
            Integrator(name="a", order=1, workspace=list, **ways)
    with pytest.raises(TcbenchError, match="workspace must be a function or nothing, not 3"):
        Integrator(name="a", order=1, step=richardson, workspace=3)


# what a method does inside of a step ---------------------------------------------------------------------------------


def test_steps_that_a_method_divides_are_counted():
    """tc_gauss takes a step that it cannot solve in halves: its rows say so, or they would pass for whole steps."""
    run = tcbench.simulate("tc_gauss", "stiff_spring", dt=1.2)
    assert run.solver.inner_steps > 5 * run.steps and run.solver.newton_iterations > run.solver.inner_steps
    assert metrics.conservation(run)["inner_steps_mean"] == run.solver.inner_steps / run.steps
    assert tcbench.simulate("tc_gauss", "reaction").solver.inner_steps == find_scenario("reaction").steps(0.2)
    formula = tcbench.simulate("tc_monolithic", "stiff_spring", dt=1.2)
    assert metrics.conservation(formula)["inner_steps_mean"] == 1.0


def test_a_workspace_tells_what_a_run_took_and_one_without_cost_tells_nothing():
    class Halves:
        taken = 0

        def cost(self):
            return {"steps": self.taken}

    def step(z, h, system, work):
        work.taken += 2
        return z + h * system.vector_field(z + h / 2 * system.vector_field(z))

    method = Integrator(name="halves", order=2, step=step, workspace=lambda system: Halves())
    run = tcbench.simulate(method, "reaction", t_end=1.0, dt=0.1)
    assert metrics.inner_steps_mean(run) == 2.0 and math.isnan(metrics.newton_iterations(run))
    silent = Integrator(name="silent", order=2, step=lambda z, h, system: step(z, h, system, Halves()))
    assert math.isnan(metrics.inner_steps_mean(tcbench.simulate(silent, "reaction", t_end=1.0, dt=0.1)))


@pytest.mark.parametrize(
    ("cost", "status"), [(7, "ok"), (lambda: [1], "exception"), (lambda: {"steps": math.nan}, "exception")]
)
def test_what_cost_is_or_returns_may_be_anything_and_is_a_row(cost, status):
    work = type("Work", (), {"cost": staticmethod(cost) if callable(cost) else cost})
    method = Integrator(name="m", order=1, step=lambda z, h, system, _: z, workspace=lambda system: work())
    run = tcbench.simulate(method, "reaction", t_end=1.0, dt=0.1)
    assert (
        run.status == status
        and run.steps == 10
        and ("cost()" in run.failure or "NaN" in run.failure) == (status == "exception")
    )
