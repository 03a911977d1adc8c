"""Kernels on vectors: their exp, log and reductions against numpy, and a step of collocation against scalar code."""

import math

import numpy as np
import pytest
from collocation import matrix_of
from hypothesis import given
from hypothesis import strategies as st
from random_laws import random_start
from tcbench_plugins.tc_gauss.formulas import formulas
from tcbench_plugins.tc_gauss.lanes import WIDTH, Lanes
from tcbench_plugins.tc_gauss.method import GaussMethod

import tcbench
from tcbench.compiler import language
from tcbench.compiler.library import evaluate

pytestmark = pytest.mark.skipif(language.PLAIN, reason="plain Python has no vectors: the scalar code runs")


def rows(values):
    return st.lists(values, min_size=WIDTH, max_size=WIDTH).map(np.array)


def run(build, *inputs):
    """What `build(lanes, *rows)` computes of WIDTH numbers each; a list of vectors and scalars."""
    lanes = Lanes()
    results = build(lanes, *(lanes.row(lanes.a, WIDTH * i) for i in range(len(inputs))))
    for i, value in enumerate(results):
        lanes.store(value, WIDTH * i)
    out = np.full(WIDTH * len(results), -1.0)
    evaluate(lanes.kernel().address, np.concatenate(inputs).astype(float), np.zeros(1), out)
    return out.reshape(-1, WIDTH)


@given(rows(st.floats(-708.3, 709.78)))
def test_exp_is_within_two_ulps(x):
    (found,) = run(lambda lanes, row: [lanes.of(f"exp({row})", row)], x)
    assert np.all(np.abs(found - np.exp(x)) <= 2 * np.spacing(np.exp(x)))


@given(rows(st.floats(0.0, math.inf)))
def test_log_is_within_two_ulps(x):
    (found,) = run(lambda lanes, row: [lanes.of(f"log({row})", row)], x)
    with np.errstate(all="ignore"):
        np.testing.assert_allclose(found, np.log(x), rtol=5e-16, atol=0)


def test_beyond_their_domains_they_are_numpys():
    hard = np.array(
        [0.0, -1.0, math.nan, -0.0, math.inf, 1e308, -math.inf, 5e-324, 2e-308, 709.79, -708.4, 710, -1e5, 1, -3, 2]
    )
    for x in (hard[:WIDTH], hard[WIDTH:]):
        log, exp = run(lambda lanes, row: [lanes.of(f"log({row})", row), lanes.of(f"exp({row})", row)], x)
        with np.errstate(all="ignore"):
            np.testing.assert_allclose(log, np.log(x), rtol=5e-16)
            np.testing.assert_allclose(exp, np.exp(x), rtol=5e-16, atol=2.3e-308)  # subnormal ones are 0


@given(rows(st.floats(0, 1e9)), st.integers(0, WIDTH - 1), st.booleans())
def test_reductions(x, where, broken):
    if broken:
        x[where] = math.nan
    top, total, few = run(lambda lanes, row: [lanes.largest([row]), lanes.sum(row), lanes.first(3, row)], x)
    assert top[0] == pytest.approx(x.max(), rel=1e-15) or (broken and math.isnan(top[0]))
    assert total[0] == pytest.approx(x.sum(), nan_ok=True)
    np.testing.assert_array_equal(few, [*x[:3], *[0.0] * (WIDTH - 3)])


CASES = [("stiff_spring", 1, 1), ("short_term", 1, 3), ("gas_containers", 1, 2), ("stiff_spring", 1, 6),
         ("heavy_top", 1000, 1), ("reaction", 1000, 4)]  # fmt: skip


@pytest.mark.parametrize(("name", "times", "k"), CASES)
def test_a_step_on_vectors_is_that_of_the_loops(name, times, k):
    """There positions are iterated, too, and the whole Jacobian is solved for."""
    scenario = random_start(name, 0, times) if times > 1 else tcbench.scenarios()[name]
    fast, slow = GaussMethod(scenario.model, k), GaussMethod(scenario.model, k)
    assert fast.work.n_lanes == scenario.model.size
    slow.work.n_lanes = 0
    evaluate(slow.work.to_matrix, scenario.z0, slow.work.c, slow.work.sparse.values)
    h = 0.2 / abs(np.linalg.eigvals(matrix_of(slow.work))).max()
    dz, same = fast.increments(scenario.z0, h), slow.increments(scenario.z0, h)
    assert fast.counts.halved == slow.counts.halved == 0
    np.testing.assert_allclose(dz, same, rtol=0, atol=1e-12 * max(1.0, np.abs(same).max()))
    span = np.array([0.0, 16.0 * h])
    (states, counts), (same, expected) = (m.adaptive(scenario.z0, span, 1e-7) for m in (fast, slow))
    np.testing.assert_allclose(states, same, rtol=1e-7, atol=1e-7)
    assert counts["steps"] <= 1.5 * expected["steps"] + 2


def test_what_iterations_on_vectors_solve_for():
    """Positions are driven by momenta; entropies act back on themselves, momenta only by way of the positions."""
    made = formulas(tcbench.scenarios()["short_term"].model.symbolic)
    assert made.driven == [0, 1, 2, 3] and made.own == [8, 9]
