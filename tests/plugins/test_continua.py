"""Solids, rods, rings, gases and phases: both laws and the momenta, order 2, and what the field knows of them."""

import numpy as np
import pytest
from tcbench_plugins.continua.gas_tube import gas_tube
from tcbench_plugins.continua.ring import ring
from tcbench_plugins.continua.solid import l_block, solid

import tcbench
from tcbench import TcbenchError, plugins
from tcbench.analysis.theorems import operators
from tcbench.compiler.library import evaluate
from tcbench.solver.array_flow import array_flow

skfem = pytest.importorskip("skfem")
CASES = {  # name: how long, step, invariants that are kept to the order of the method only
    "solid[n=1,viscosity=0.5]": (0.4, 0.1, ()),
    "rod[n=6]": (0.4, 0.04, ("spin",)), "ring[n=8]": (0.5, 0.05, ()),
    "gas_tube[n=30]": (0.05, 0.005, ()), "cahn_hilliard[n=5]": (0.05, 0.01, ()),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_both_laws_and_the_momenta_are_exact(name):
    t_end, dt, approximate = CASES[name]
    run = tcbench.simulate("tc_monolithic", name, t_end=t_end, dt=dt)
    assert run.ok, run.failure
    assert run.summary.energy_error_max < 1e-13 and run.summary.entropy_increment_min > 0
    for kind, error in run.summary.invariant_error_max.items():
        if kind in approximate:
            assert 1e-12 < error < 1e-3
        else:
            assert error < 2e-15, (kind, error)


@pytest.mark.parametrize("method", ["tc_monolithic", "tc_taylor"])
def test_phases_that_part_keep_the_energy(method):
    """Errors of one sign add up: those of old factors over the steps, what a correction may miss over the cells."""
    run = tcbench.simulate(method, "cahn_hilliard", t_end=0.1)
    assert run.ok and run.summary.energy_error_max < 1e-13


def test_a_ring_is_of_order_two():
    end = {n: tcbench.simulate("tc_monolithic", ring(8, t_end=0.5, dt=0.5 / n)).z[-1] for n in (40, 80, 160)}
    errors = [np.abs(end[n] - end[2 * n]).max() for n in (40, 80)]
    assert 1.8 < np.log2(errors[0] / errors[1]) < 2.2


def test_the_error_of_a_ring_falls_with_the_square_of_its_mesh():
    end = {n: tcbench.simulate("tc_monolithic", ring(n, t_end=1.0, dt=0.01)) for n in (12, 24, 48, 192)}
    places = {n: np.asarray(run.scenario.model.state(run.z[-1]).q)[:: n // 12] for n, run in end.items()}
    errors = [np.abs(places[n] - places[192]).max() for n in (12, 24, 48)]
    assert errors[2] < 3e-3 and 1.6 < np.log2(errors[0] / errors[2]) / 2 < 2.4


def test_steps_of_many_times_the_explicit_limit_keep_the_energy():
    scenario = solid(1)
    limit = 2 / np.sqrt(np.abs(np.linalg.eigvals(stiffness(scenario))).max())
    run = tcbench.simulate("tc_monolithic", scenario, dt=20 * limit, t_end=60 * limit)
    assert run.ok and run.summary.energy_error_max < 1e-13


def stiffness(scenario):
    """-d(p')/dq M^-1 at rest, places in the order of the nodes, by differences of fourth order."""
    model, z, mass = scenario.model, np.array(scenario.z0), np.repeat(scenario.constants["mass"], 3)
    n, h = len(mass), 1e-3
    z[n:] = 0
    moved = z + np.array([-2, -1, 1, 2])[:, None, None] * h * np.eye(n, len(z))
    slopes = np.asarray(model.gradient(moved))[..., :n]
    return np.einsum("k,kij->ji", [1, -8, 8, -1], slopes) / (12 * h) / mass[:, None]


@pytest.mark.parametrize("element", ["tet", "hex"])
def test_elastic_frequencies_are_those_of_scikit_fem(element):
    from skfem.models.elasticity import linear_elasticity
    from skfem.models.poisson import mass

    scenario, mesh = solid(1, element).replace(expansion=0.0), l_block(1, element)
    scalar = skfem.ElementHex1() if element == "hex" else skfem.ElementTetP1()
    basis = skfem.Basis(mesh, skfem.ElementVector(scalar), intorder=2)
    K = linear_elasticity(20.0, 10.0).assemble(basis).toarray()
    lumped = mass.assemble(skfem.Basis(mesh, scalar, intorder=2)).sum(axis=1)
    place = basis.nodal_dofs.T.ravel()  # of scikit-fem's numbers, the order of the nodes
    expected = K[np.ix_(place, place)] / np.repeat(np.asarray(lumped).ravel(), 3)[:, None]
    ours = stiffness(scenario)
    assert np.allclose(ours, expected, atol=1e-9 * np.abs(expected).max())
    first, other = (np.sort(np.linalg.eigvals(x).real)[6:10] for x in (ours, expected))  # six motions are rigid
    assert np.allclose(np.sqrt(first), np.sqrt(other), rtol=1e-9)


def test_the_gas_behind_sods_shock_has_the_speed_and_pressure_that_are_known():
    """0.92745 and 0.30313 between the contact and the shock (Toro 2009, section 4.3.3)."""
    scenario = gas_tube(100)
    z = scenario.model.state(tcbench.simulate("tc_monolithic", scenario).z[-1])
    speed = z.p / np.asarray(scenario.constants["mass"])
    width = np.diff(np.r_[0.0, z.x, 1.0])
    rho = np.asarray(scenario.constants["gas"]) / width
    p = rho**1.4 * np.exp(0.4 * z.s / np.asarray(scenario.constants["gas"]))
    middle = (z.x > 0.72) & (z.x < 0.8)
    assert np.allclose(speed[middle], 0.92745, rtol=0.02) and np.allclose(p[:-1][middle], 0.30313, rtol=0.02)


def test_the_matrix_of_newton_is_that_of_differences_where_sums_are_unknowns_of_it():
    """Temperatures of nodes, sums over elements that elements read again, are rows of their own; condensed they are the
    Jacobian of the residual, whose kernel keeps the sums."""
    scenario = solid(1)
    model, (flow,) = scenario.model, tcbench.integrators()["tc_monolithic"].flows
    kernels = array_flow(flow, model.by_arrays)(model.mesh)
    n, shared, pattern = kernels.n_unknowns, kernels.n_shared, kernels.pattern
    constants = np.array(model.constant_values)
    constants[0] = scenario.dt
    opened = np.empty(kernels.opening.size + kernels.opening.room)
    z0 = np.array(scenario.z0)
    evaluate(kernels.opening.address, z0, np.concatenate([constants, np.zeros(2 * len(z0))]), opened)

    def iterate(x):
        out = np.empty(kernels.iterate.size + kernels.iterate.room)
        evaluate(kernels.iterate.address, opened, x, out)
        return out[:n], out[n : n + pattern.nnz]

    x = opened[:n] + 0.005 * np.cos(np.arange(n))
    A, rows = np.zeros((n, n)), np.repeat(np.arange(n), np.diff(pattern.first))
    A[pattern.order[rows], pattern.order[pattern.columns]] = iterate(x)[1]
    own, other = slice(n - shared), slice(n - shared, n)
    condensed = A[own, own] - A[own, other] @ np.linalg.solve(A[other, other], A[other, own])
    moved = [[iterate(x + k * 1e-3 * e)[0][own] for k in (-2, -1, 1, 2)] for e in np.eye(n)[own]]
    differences = np.einsum("k,jki->ij", [1, -8, 8, -1], moved) / 12e-3
    assert shared == len(scenario.constants["mass"])
    assert np.allclose(condensed, differences, atol=1e-11 * np.abs(differences).max())


@pytest.mark.parametrize(
    "name",
    [pytest.param("gas_tube[n=100]", marks=pytest.mark.thorough), "gas_tube[n=25]", "rod[n=6]", "cahn_hilliard[n=5]"],
)
def test_check_finds_the_conditions_of_continua_kept(name):
    """Also of states with thin cells: a hundredth of such a state is many of their widths."""
    rows = operators(tcbench.integrators()["tc_monolithic"], plugins.find_scenario(name))
    assert not [row.claim for row in rows if not row.agrees and row.agrees is not None]


def test_what_is_no_solid_is_refused_with_a_sentence():
    for name, sentence in (("solid[element=cube]", "one of tet, hex"), ("solid[n=0]", "1 to 40"),
                           ("solid[viscosity=thick]", "is a number"),
                           ("rod[n=1]", "from 2 to"), ("ring[n=x]", "whole number")):  # fmt: skip
        with pytest.raises(TcbenchError, match=sentence):
            tcbench.simulate("tc_monolithic", name)
