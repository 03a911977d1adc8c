"""Measures that others use: each tells what it is to tell apart."""

import math

import numpy as np
import pytest
from mechanics import OfEntropies
from tiers import tiers

import tcbench
from tcbench.plugins import find_integrator, find_scenario
from tcbench.simulation.metrics import evaluations
from tcbench.studies.cost import reach
from tcbench.studies.measures import (
    STUDY,
    energy_growth,
    path_errors,
    reversibility_defect,
    substep_laws,
    symplecticity_defect,
)

GAS = {"dt": 0.1}


class ByMatrices(OfEntropies):
    name = "by_matrices"
    variables = {"q": (), "p": (), "s": ()}
    constants = {"rub": ()}

    def energy(self, z):
        return (z.q**2 + z.p**2) / 2 + np.exp(z.s)

    def poisson(self, z):
        return np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 0]])

    def friction(self, z):
        v = np.array([0, np.exp(z.s), -z.p])
        return self.rub * v[:, None] * v[None, :] * np.exp(-z.s)


BY_MATRICES = tcbench.Scenario("m", ByMatrices, {"rub": 0.1}, initial={"q": 1, "p": 0, "s": 0}, t_end=1, dt=0.1)


SYMPLECTIC = {"midpoint_entropy": True, "ybaby": True, "variational": True, "tc_monolithic": False}


@pytest.mark.parametrize("method", tiers(SYMPLECTIC, ("midpoint_entropy", "tc_monolithic")))
def test_the_symplecticity_defect_knows_symplectic_methods(method):
    """By differences 1e-8 is none; a discrete gradient is not symplectic."""
    for name in ("gas_containers", "damped_oscillator", "viscous_pendulum")[: 2 if method == "ybaby" else 3]:
        defect = symplecticity_defect(find_integrator(method), find_scenario(name), GAS)
        assert (defect < 1e-8) is SYMPLECTIC[method] and math.isfinite(defect)


def test_what_dissipates_is_no_matter_of_its_name():
    """Of a plugin's system the measure was empty."""
    by_name, by_matrices = (
        symplecticity_defect(find_integrator("midpoint_entropy"), scenario, GAS)
        for scenario in (find_scenario("damped_oscillator"), BY_MATRICES)
    )
    assert by_name < 1e-8 and by_matrices < 1e-8
    (table,) = STUDY.tabulate([{"integrator": "a", "scenario": "b", "symplecticity_defect": math.nan}]).values()
    assert "symplecticity_defect" not in table


def test_a_linear_bracket_counts_as_well():
    """L(m) = m x: Gauss collocation keeps it to its order only."""
    found = [
        symplecticity_defect(find_integrator("gauss2"), find_scenario("rigid_body"), {"dt": h}) for h in (0.6, 1.2)
    ]
    assert found[1] > 10 * found[0] > 1e-9


def test_the_growth_of_the_energy_error_tells_drift_from_what_is_bounded():
    """Symplectic: bounded. An explicit method of order two gains energy by a power of t near 1."""
    gas = find_scenario("gas_containers")
    bounded = energy_growth(find_integrator("midpoint_entropy"), gas, {"dt": 0.02})
    heun = tcbench.Integrator(name="heun", order=2, flows=heun_step)
    drifting = energy_growth(heun, gas, {"dt": 0.02})
    assert abs(bounded["energy_growth_exponent"]) < 0.2 < 0.8 < drifting["energy_growth_exponent"] < 1.2
    exact = energy_growth(find_integrator("tc_monolithic"), gas, {"dt": 0.1})
    assert exact["energy_growth_end"] < 1e-12


def heun_step(z0, z1, h, system):
    first = system.vector_field(z0)
    return z1 - z0 - h / 2 * (first + system.vector_field(z0 + h * first))


def test_both_laws_and_a_tenth_of_the_entropy():
    """fast_conduction at h = 1.2: energy and entropy obey their laws, and what is produced is too little."""
    row = path_errors(find_integrator("tc_monolithic"), find_scenario("fast_conduction"), {"dt": 1.2})
    assert row["status"] == "ok" and row["error_entropy_produced"] > 0.5 and row["error_theta"] > 0.01
    assert row["error_path_max"] >= row["error_end"] and row["error_path_max"] >= row["error_path_rms"]


def test_a_row_of_a_solver_and_of_a_failure():
    row = STUDY.measure(find_integrator("scipy_dop853"), find_scenario("gas_containers"), {"tolerance": 1e-6})
    assert row["error_path_max"] < 1e-2 and math.isnan(row["energy_growth_exponent"])
    lost = STUDY.measure(find_integrator("ybaby"), find_scenario("stiff_spring"), {"dt": 1.2})
    assert lost["status"] != "ok" and lost["failure"] and len(STUDY.tabulate([row, lost])["measures"]) == 2


def test_symmetric_methods_go_back_to_where_they_began_and_their_sub_steps_keep_the_laws():
    """(A1) is its own adjoint with dissipation, too; of a splitting that order of its parts decides it."""
    scenario = find_scenario("damped_oscillator")
    assert reversibility_defect(find_integrator("tc_monolithic"), scenario, {"dt": 0.3}) < 1e-14
    assert reversibility_defect(find_integrator("tc_strang"), scenario, {"dt": 0.3}) < 1e-14
    assert reversibility_defect(find_integrator("tc_staggered"), scenario, {"dt": 0.3}) > 1e-4
    heun = tcbench.Integrator(name="heun", order=2, flows=heun_step)
    assert reversibility_defect(heun, scenario, {"dt": 0.3}) > 1e-4
    assert math.isnan(reversibility_defect(find_integrator("scipy_dop853"), scenario, {"tolerance": 1e-6}))
    kept = substep_laws(find_integrator("tc_strang"), scenario, {"dt": 0.3})
    assert kept["substep_energy_error_max"] < 1e-14 and kept["substep_entropy_fall_max"] == 0.0
    assert substep_laws(find_integrator("ybaby"), scenario, {"dt": 0.3})["substep_energy_error_max"] > 1e-3
    assert substep_laws(find_integrator("tc_monolithic"), scenario, {"dt": 0.3}) == {}


def test_evaluations_are_counted_alike_on_every_machine():
    gas = find_scenario("gas_containers").replace(t_end=1.0)
    run = tcbench.simulate("tc_strang", gas)
    assert evaluations(run) == run.solver.newton_iterations > 0
    assert evaluations(tcbench.simulate("ybaby", gas)) == 3 * 10  # three explicit flows
    assert evaluations(tcbench.simulate("scipy_odeint", gas, tolerance=1e-6)) > 10
    points = [{"status": "ok", "error": e, "steps": n, "wall_time_min_s": 1.0} for e, n in ((1e-2, 10), (1e-4, 100))]
    assert reach(points, "error", 1e-3, "steps") == pytest.approx(10**1.5)
    assert math.isnan(reach(points, "error", 1e-3, "evaluations"))
