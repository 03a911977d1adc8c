"""The arc: the first crossing of h, through folds, and the verdict that a branch is lost."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from one_flow import OneFlow
from scalar import CUBIC, cubic, parabola, scalar
from states import admissible_states

import tcbench
from tcbench.simulation.run import simulate
from tcbench.solver.continuation import FOUND, LOST

SCENARIOS = tcbench.scenarios()
SCENARIO = SCENARIOS["short_term"]
PARABOLA, CUBIC_METHOD = scalar("parabola", parabola), scalar("cubic", cubic)


@pytest.mark.parametrize("h", [0.05, 0.3, 0.49, 0.4999])
def test_arc_finds_the_root_below_the_fold(h):
    work = OneFlow(PARABOLA, SCENARIO, h)
    code, _, folds = work.arc()
    assert (code, folds) == (FOUND, 0)
    # next to the fold the root moves by the square root of the round-off in h
    assert work.x[0] == pytest.approx((1 - np.sqrt(1 - 4 * h * h)) / (2 * h), rel=1e-11)


@pytest.mark.parametrize("h", [0.5001, 0.6, 2.0, 30.0])
def test_arc_is_lost_beyond_the_fold(h):
    code, _, folds = OneFlow(PARABOLA, SCENARIO, h).arc()
    assert (code, folds) == (LOST, 1)


@pytest.mark.parametrize(("h", "folds"), [(0.3, 0), (0.5, 0), (0.63, 0), (0.64, 2), (0.7, 2), (5.0, 2)])
def test_the_root_is_the_first_crossing(h, folds):
    """Between the folds of the cubic there are three roots, and the first sheet holds THE root; beyond 0.636 the arc
    reaches the third sheet through both folds. Either way the determinant there is positive."""
    work = OneFlow(CUBIC_METHOD, SCENARIO, h)
    code, _, found = work.arc()
    assert (code, found) == (FOUND, folds)
    roots = np.roots([*CUBIC, -h])
    real = np.sort(roots.real[abs(roots.imag) < 1e-9])
    assert work.x[0] == pytest.approx(real[0], rel=1e-9)
    assert np.polyval(np.polyder([*CUBIC, -h]), work.x[0]) > 0


def test_a_lost_branch_becomes_the_status_no_root():
    run = simulate(PARABOLA, SCENARIO, dt=0.6)
    assert run.status == "no_root" and "principal branch" in run.failure and "step 1" in run.failure
    assert run.steps == 0 and run.solver.arcs == 1 and run.solver.folds == 1
    assert simulate(PARABOLA, SCENARIO, dt=0.6, continuation=False).status == "nonconverged"


def test_a_branch_of_the_paper_s_own_method_ends():
    run = simulate("midpoint_temperature", "cold_spring", dt=2 ** (-107 / 64))  # 0.3138
    assert run.status == "no_root" and run.solver.folds > 0


def principal_root(integrator, scenario, h):
    work = OneFlow(integrator, scenario, h)
    code, _, folds = work.arc()
    return code, folds, work.z + work.dz


def test_a_fold_is_a_singular_jacobian():
    """Independently of the arc's own counting: at the end of the branch of midpoint_temperature the smallest singular
    value of the residual's Jacobian, by differences of the formula on plain floats, vanishes like the square root of
    the distance to the fold."""
    integrator, dt = tcbench.integrators()["midpoint_temperature"], 2 ** (-107 / 64)
    run = simulate(integrator, "cold_spring", dt=dt)
    model, z = run.scenario.model, run.z[-1]
    scenario = run.scenario.replace(positions=z[:4], momenta=z[4:8], temperatures=model.temperatures(z))
    low, high = 0.5 * dt, dt
    assert principal_root(integrator, scenario, low)[0] == FOUND
    for _ in range(40):
        middle = 0.5 * (low + high)
        if principal_root(integrator, scenario, middle)[0] == FOUND:
            low = middle
        else:
            high = middle

    def smallest(distance):
        h = low * (1 - distance)
        y0 = np.asarray(model.temperature_variables(scenario.z0))
        y1 = np.asarray(model.temperature_variables(principal_root(integrator, scenario, h)[2]))
        residual = integrator.flows[0].residual
        steps = 1e-6 * np.maximum(1.0, abs(y1))
        columns = []
        for j, step in enumerate(steps):
            e = np.zeros_like(y1)
            e[j] = step
            states = [model.state(y0), model.state(y1 + e), model.state(y1 - e)]
            up, down = (np.asarray(residual(states[0], y, h, model)) for y in states[1:])
            columns.append((up - down) / (2 * step))
        return np.linalg.svd(np.array(columns).T, compute_uv=False)[-1]

    near, far = smallest(1e-6), smallest(1e-4)
    assert near / far == pytest.approx(0.1, rel=0.2)  # sqrt(1e-6 / 1e-4)


def random_scenario(y, h):
    return SCENARIO.replace(positions=y[:4], momenta=y[4:8], temperatures=y[8:], t_end=h)


@pytest.mark.parametrize("name", ["tc_monolithic", "tc_staggered", "tc_strang"])
@settings(max_examples=30)
@given(y=admissible_states(), log_h=st.floats(-1.0, 1.0))
def test_a_tc_step_has_a_root_for_every_h(name, y, log_h):
    """Its roots obey V(z1) <= V(z0), so the branch cannot be lost: `no_root` would be a fault of the tracker."""
    h = 10.0**log_h
    run = simulate(name, random_scenario(y, h), dt=h)
    assert run.status in ("ok", "nonconverged")


@settings(max_examples=30)
@given(y=admissible_states(), log_h=st.floats(-1.0, 0.5))
def test_the_arc_s_root_solves_the_step(y, log_h):
    """The formula on plain floats, at the root that the arc found."""
    h = 10.0**log_h
    scenario, integrator = random_scenario(y, h), tcbench.integrators()["tc_monolithic"]
    code, _, z1 = principal_root(integrator, scenario, h)
    if code == FOUND and scenario.model.shapes(z1).min() > 1e-2:  # a collapsing spring leaves no digits to check with
        model = scenario.model
        residual = integrator.flows[0].residual(model.state(scenario.z0), model.state(z1), h, model)
        assert abs(np.asarray(residual)).max() < 1e-8 * (1 + h) * (1 + abs(z1).max())


def wave(d, h):
    """0.2 d + sin(d)^2 = h: flat at 0, so that plain Newton jumps over the first root to one of the many beyond."""
    return 0.2 * d + np.sin(d) ** 2 - h


def test_the_audit_counts_roots_that_are_not_principal():
    """It says of each accepted root what a scan of the equation for its first root says."""
    method, d = scalar("wave", wave), np.linspace(0.0, 12.0, 200_001)
    counts = []
    for h in np.linspace(0.1, 1.9, 20):
        run = simulate(method, SCENARIO.replace(t_end=h), dt=h, continuation=False, audit_roots=True)
        if run.status == "nonconverged":
            assert run.solver.audited == run.solver.wrong_roots == 0
            continue
        first = d[np.argmax(wave(d, h) >= 0)]
        assert run.solver.audited == 1
        assert run.solver.wrong_roots == (abs(run.z[1, 4] - run.z[0, 4] - first) > 1e-3)
        counts.append(run.solver.wrong_roots)
    assert 0 in counts and 1 in counts


@pytest.mark.parametrize("name", ["tc_monolithic", "tc_strang"])
def test_an_audit_does_not_change_the_run(name):
    for dt in (0.3, 2.0):
        run, same = simulate(name, "stiff_spring", dt=dt, audit_roots=True), simulate(name, "stiff_spring", dt=dt)
        assert np.array_equal(run.z, same.z) and same.solver.audited == 0
        assert run.solver.audited == len(run.integrator.flows) * run.steps
        assert dt > 1 or run.solver.wrong_roots == 0
