"""The rules of the shared Newton, one by one, on equations with one unknown whose roots are known."""

import numpy as np
import pytest
from one_flow import OneFlow
from scalar import CUBIC, cubic, logarithm, parabola, scalar

import tcbench
from tcbench.simulation.run import simulate
from tcbench.solver.linear_algebra import solve_pivoted
from tcbench.solver.newton import ACCEPTED, MAX_ITERATIONS, PLAIN_ITERATIONS, REJECTED

SCENARIO = tcbench.scenarios()["short_term"]
PARABOLA, CUBIC_METHOD, LOGARITHM = scalar("parabola", parabola), scalar("cubic", cubic), scalar("logarithm", logarithm)


@pytest.mark.parametrize("n", [1, 2, 6, 10])
def test_solve_pivoted_agrees_with_numpy(n):
    rng = np.random.default_rng(n)
    for _ in range(20):
        whole = rng.normal(size=(n + 1, n + 3))  # more than is looked at
        A, b, solved = whole[:n, :n], whole[:n, n : n + 2], whole.copy()
        sign = solve_pivoted(solved, n, n + 2)
        # the residual of an LU solve, in units of round-off
        assert abs(A @ solved[:n, n : n + 2] - b).max() < 1e-12 * np.linalg.cond(A)
        assert sign == np.sign(np.linalg.det(A))
        assert np.array_equal(solved[n], whole[n]) and np.array_equal(solved[:, n + 2], whole[:, n + 2])


def test_solve_pivoted_needs_its_pivoting_and_reports_a_singular_matrix():
    A = np.array([[0.0, 1.0, 1.0], [1.0, 0.0, 2.0]])
    assert solve_pivoted(A, 2, 3) == -1.0
    assert A[:, 2].tolist() == [2.0, 1.0]
    assert solve_pivoted(np.ones((2, 3)), 2, 3) == 0.0


@pytest.mark.parametrize("h", [0.1, 0.3, 0.45])
def test_newton_finds_the_root_to_round_off(h):
    work = OneFlow(PARABOLA, SCENARIO, h)
    code, iterations = work.newton(0.0)
    assert code == ACCEPTED and iterations <= 6
    assert work.x[0] == pytest.approx((1 - np.sqrt(1 - 4 * h * h)) / (2 * h), rel=1e-14)
    assert work.dz[4] == work.x[0] and not np.delete(work.dz, 4).any()


def test_newton_stops_before_the_confirming_iteration():
    """Quadratic convergence predicts a next correction below round-off: one iteration less than a bare test needs."""
    work = OneFlow(PARABOLA, SCENARIO, 0.1)
    _, stopped = work.newton(0.0)
    root = work.x[0]
    _, confirmed = work.plain_newton(0.0)
    assert stopped < confirmed and work.x[0] == pytest.approx(root, rel=1e-15)


def test_newton_rejects_a_root_with_negative_determinant_that_plain_newton_accepts():
    """At h = 0.5 the cubic has the roots 0.293, 1 and 1.707; the middle one lies between two folds."""
    work = OneFlow(CUBIC_METHOD, SCENARIO, 0.5)
    assert work.newton(1.05) == (REJECTED, 1)
    assert work.plain_newton(1.05)[0] == ACCEPTED
    assert work.x[0] == pytest.approx(1.0)
    roots = np.sort(np.roots([*CUBIC, -0.5]).real)
    for start, root in ((0.2, roots[0]), (1.8, roots[2])):
        assert work.newton(start)[0] == ACCEPTED
        assert work.x[0] == pytest.approx(root, rel=1e-13)


def test_newton_gives_up_at_once_where_corrections_do_not_halve():
    work = OneFlow(PARABOLA, SCENARIO, 0.6)  # no root
    code, iterations = work.newton(0.0)
    assert code == REJECTED and iterations < MAX_ITERATIONS
    assert work.plain_newton(0.0) == (REJECTED, PLAIN_ITERATIONS)


@pytest.mark.parametrize("solver", ["newton", "plain_newton"])
def test_newton_rejects_values_that_are_not_finite(solver):
    solve = getattr(OneFlow(LOGARITHM, SCENARIO, 0.1), solver)
    assert solve(-2.0) == (REJECTED, 1)
    assert solve(0.0)[0] == ACCEPTED


def test_newton_rejects_non_positive_temperatures():
    """midpoint_temperature solves for temperatures; from a start below zero it stops at the first iterate that is not
    admissible, whatever the corrections would do later."""
    work = OneFlow(tcbench.integrators()["midpoint_temperature"], SCENARIO, 0.1)
    start = np.zeros(len(work.x))
    start[:2] = -2000.0  # entropies come first among the unknowns, here temperatures
    assert work.newton(start) == (REJECTED, 1)


def test_plain_newton_is_the_one_of_the_literature():
    """The example of the specification: on short_term, started at z0, TC monolithic fails near h = 0.62 and at 2.5,
    works at 2 and at 3. With continuation it works at all of them."""
    for dt, status in ((0.6, "ok"), (0.63, "nonconverged"), (2.0, "ok"), (2.5, "nonconverged"), (3.0, "ok")):
        assert simulate("tc_monolithic", SCENARIO, dt=dt, continuation=False).status == status
        assert simulate("tc_monolithic", SCENARIO, dt=dt).status == "ok"


@pytest.mark.parametrize("method", ["tc_monolithic", "tc_staggered", "tc_strang"])
def test_a_correction_whose_square_is_below_round_off_is_the_last(method):
    """Late in this run first corrections are some 1e-12 and nothing looks at the residual again: it is round-off."""
    run = tcbench.simulate(method, "long_term", dt=0.3, residuals=True, record_every=None)
    assert run.ok and run.summary.residual_max < 5e-14


@pytest.mark.parametrize("method", ["tc_monolithic", "tc_staggered", "tc_strang"])
def test_a_root_that_is_foreseen_and_not_looked_at_again_is_one(method):
    """Where Newton's error is known to be round-off no further correction is made: believing a curvature that one
    direction shows by chance costs heavy_top's energy 6e-14."""
    run = tcbench.simulate(method, "heavy_top")
    assert run.ok and run.summary.energy_error_max < 1e-14
