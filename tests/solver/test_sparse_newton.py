"""Newton on a sparse matrix has the rules, the tracking, the arc and the verdicts of the unrolled one."""

import numpy as np
import pytest
from mechanics import Mechanical
from tcbench_plugins.chain.chain import chain
from tcbench_plugins.net.net import net

import tcbench
from tcbench.solver import flow_kernels, implicit_step
from tcbench.solver import pattern as patterns
from tcbench.solver.pattern import Pattern

CASES = [
    ("tc_monolithic", "cold_spring", 2.5), ("tc_monolithic", "stiff_spring", 2.5), ("tc_strang", "long_term", 1.0),
    ("midpoint_entropy", "stiff_spring", 0.3), ("midpoint_temperature", "cold_spring", 1.0),
    ("tc_staggered", "gas_containers", 0.3),
]  # fmt: skip


@pytest.mark.parametrize(("method", "scenario", "h"), CASES)
def test_statuses_and_states_are_those_of_the_unrolled_elimination(method, scenario, h, monkeypatch):
    runs = []
    for limit in (24, 0):
        monkeypatch.setattr(flow_kernels, "UNROLLED", limit)
        implicit_step._compiled_flows.cache_clear()
        runs.append(tcbench.simulate(method, scenario, dt=h, t_end=min(25.0, 20 * h)))
    implicit_step._compiled_flows.cache_clear()
    unrolled, sparse = runs
    assert "unrolled" in unrolled.solver.way and "sparse" in sparse.solver.way
    assert (unrolled.status, unrolled.failure, unrolled.steps) == (sparse.status, sparse.failure, sparse.steps)
    first = min(4, len(sparse.z))
    assert np.abs(unrolled.z[:first] - sparse.z[:first]).max() < 1e-11


def test_a_pattern_has_every_entry_and_the_diagonal():
    rng = np.random.default_rng(1)
    rows, columns = rng.integers(0, 20, (2, 60))
    pattern = Pattern(20, rows, columns)
    values = rng.normal(size=60)
    entries = np.zeros(pattern.nnz)
    np.add.at(entries, pattern.places, values)
    dense = np.zeros((20, 20))
    for i in range(20):
        for k in range(pattern.first[i], pattern.first[i + 1]):
            dense[pattern.order[i], pattern.order[pattern.columns[k]]] = entries[k]
    expected = np.zeros((20, 20))
    np.add.at(expected, (rows, columns), values)
    assert np.array_equal(dense, expected)
    assert np.array_equal(pattern.columns[pattern.diagonal], np.arange(20))


@pytest.mark.parametrize("n", [15, 120])  # by LAPACK, by SuperLU
@pytest.mark.parametrize("seed", range(2))
def test_a_factorisation_has_both_solutions_and_the_sign_of_the_determinant(seed, n):
    rng = np.random.default_rng(seed)
    A = np.where(rng.uniform(size=(n, n)) < 0.3, rng.normal(size=(n, n)), 0.0) + np.diag(rng.normal(size=n))
    rows, columns = np.nonzero(A)
    pattern = Pattern(n, rows, columns)
    entries = np.zeros(pattern.nnz)
    np.add.at(entries, pattern.places, A[rows, columns])
    right, out = rng.normal(size=2 * n), np.zeros(2 * n + 1)
    pattern._factorise(entries, right, out)
    permuted = A[np.ix_(pattern.order, pattern.order)]
    for k in range(2):
        assert np.allclose(permuted @ out[k * n : (k + 1) * n], right[k * n : (k + 1) * n], atol=1e-8)
    assert out[-1] == np.sign(np.linalg.det(A))


@pytest.mark.parametrize("n", [3, 101])
def test_a_singular_matrix_says_so(n):
    pattern, out = Pattern(n, range(n), range(n)), np.ones(2 * n + 1)
    pattern._factorise(np.r_[1.0, 0.0, np.ones(n - 2)], np.ones(2 * n), out)
    assert not out.any()


def test_factors_of_earlier_steps_lead_to_the_roots_of_new_ones():
    """In one run most steps use factors that an earlier step has made; each step as a run of its own makes new ones."""
    scenario = net(4, 4)
    steps, n = 12, scenario.model.n_positions
    whole = tcbench.simulate("tc_monolithic", scenario, dt=0.1, t_end=0.1 * steps)
    z, corrections = scenario.z0, 0
    for _ in range(steps):
        theta = scenario.model.temperatures(z)
        start = scenario.replace(positions=z[:n], momenta=z[n : 2 * n], temperatures=theta)
        one = tcbench.simulate("tc_monolithic", start, dt=0.1, t_end=0.1)
        z, corrections = one.z[-1], corrections + one.solver.newton_iterations
    assert np.abs(whole.z[-1] - z).max() < 1e-13
    assert whole.solver.newton_iterations != corrections


def test_what_old_factors_leave_of_a_root_does_not_add_up_in_the_energy():
    """2e-14 with whole corrections; 2e-12 where each root was left 1e-15 of its size away."""
    assert tcbench.simulate("tc_strang", net(5, 5), dt=0.1, t_end=20.0).summary.energy_error_max < 2e-13


@pytest.mark.thorough
def test_far_from_the_origin_corrections_that_stop_at_round_off_have_found_the_root():
    """Positions of 4e4 are rounded by 1e-11: six of ten steps were solved again."""
    run = tcbench.simulate("tc_monolithic", chain(40_000), dt=0.1, t_end=1.0, record_every=None)
    assert run.ok and run.solver.retried == 0 and run.summary.energy_error_max < 1e-13


@pytest.mark.parametrize("method", ["tc_monolithic", "tc_strang"])
def test_an_audit_leaves_the_factors_that_the_next_steps_go_on_with(method):
    settings = {"dt": 0.1, "t_end": 2.0}
    run, same = (tcbench.simulate(method, chain(8), audit_roots=audit, **settings) for audit in (True, False))
    assert np.array_equal(run.z, same.z) and run.solver.audited and "sparse" in run.solver.way


class Row(Mechanical):
    """Masses in a row, whose bonds are not linear; friction."""

    name = "row"
    variables = {"q": (26,), "p": (26,), "s": ()}
    constants = {"mass": (), "rate": ()}

    def energy(self, z):
        d = z.q[1:] - z.q[:-1] - 1
        return z.p @ z.p / (2 * self.mass) + (d**2 / 2 + d**4 / 4).sum() + 300 * np.exp(z.s)

    def irreversible(self, z, DE, DS):
        force = 0.1 * self.rate * self.mass * DE.p
        return {"p": -force, "s": force @ DE.p / DE.s}


def row(unit):
    start = {"q": np.arange(26.0), "p": np.sin(2 * np.arange(26)) / unit, "s": 0}
    return tcbench.Scenario("row", Row, {"mass": unit**-2, "rate": unit}, initial=start, dt=0.5 / unit, t_end=5 / unit)


def quicker(unit):
    one = chain(9)
    changed = {"masses": np.divide(one.constants["masses"], unit**2), "momenta": np.divide(one.momenta, unit)}
    rate = one.constants["conductivity"] * unit
    return one.replace(dt=one.dt / unit, t_end=5 * one.dt / unit, conductivity=rate, **changed)


@pytest.mark.parametrize("made", [row, quicker])
@pytest.mark.parametrize("name", ["tc_staggered", "tc_strang"])
def test_small_momenta_are_solved_for_as_positions_that_they_move(made, name):
    """In a unit of time that makes them 1e-15 beside positions of 1, a ten-thousandth of the energy went."""
    for unit in (1.0, 2.0**50):
        run = tcbench.simulate(name, made(unit))
        assert run.ok and "sparse" in run.solver.way and run.summary.energy_error_max < 1e-13


def test_a_mesh_in_space_has_more_iterations_and_what_would_fill_memory_is_told_with_the_cure(monkeypatch):
    pytest.importorskip("skfem")
    few, many = (
        Pattern(999, range(999), range(999)),
        Pattern(999, *np.random.default_rng(0).integers(0, 999, (2, 4000))),
    )
    assert few.krylov_steps == patterns.KRYLOV_STEPS < many.krylov_steps
    monkeypatch.setattr(patterns, "KRYLOV_STEPS", 1)
    monkeypatch.setattr(patterns, "A_BAND", 0.0)
    run = tcbench.simulate("tc_monolithic", "solid[n=2]", dt=0.3, t_end=0.3)
    assert run.ok, run.failure  # one iteration is not enough, and the matrix is factorised
    monkeypatch.setattr(patterns, "MOST_FILL", 0.0)
    run = tcbench.simulate("tc_monolithic", "solid[n=2,viscosity=1]", dt=0.3, t_end=0.3)
    assert not run.ok and "too many to be factorised; a shorter dt is needed" in run.failure
