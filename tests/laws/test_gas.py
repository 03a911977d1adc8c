"""The gas containers: the printed equations and data. Integrators are written against System, and run unchanged."""

import ast
from pathlib import Path

import numpy as np
import pytest

import tcbench

SCENARIO = tcbench.scenarios()["gas_containers"]


def printed(z, alpha=0.5):
    """The equations as printed, in plain numpy."""
    q, p, s1, s2 = z
    E1, E2 = (np.exp(s1) / q) ** (2 / 3), (np.exp(s2) / (2 - q)) ** (2 / 3)
    heat = [9 * alpha / (4 * E1) * (1 / E1 - 1 / E2), 9 * alpha / (4 * E2) * (1 / E2 - 1 / E1)]
    return np.array([p, 2 / 3 * (E1 / q - E2 / (2 - q)), *heat])


def test_the_field_and_the_energies_are_the_printed_ones():
    rng = np.random.default_rng(9)
    for _ in range(20):
        z = np.array([rng.uniform(0.2, 1.8), *rng.uniform(-1, 1, 3)])
        assert np.allclose(SCENARIO.model.vector_field(z), printed(z), rtol=1e-12, atol=1e-12)
        jacobian = np.stack([printed(z + 1j * 1e-30 * e).imag / 1e-30 for e in np.eye(4)], axis=-1)
        assert np.allclose(SCENARIO.model.jacobian(z), jacobian, rtol=1e-10, atol=1e-10)
    # E1 = E2 = 2 and p = 2 at the start: E = 4 + 2; the exergy is the kinetic energy
    assert SCENARIO.model.energy(SCENARIO.z0) == pytest.approx(6.0, rel=1e-15)
    assert SCENARIO.initial_exergy == pytest.approx(2.0, rel=1e-13)
    told = SCENARIO.t_end, SCENARIO.positions, SCENARIO.momenta, SCENARIO.constants["conductivity"]
    assert told == (30, (1,), (2,), 0.5)


def test_the_wall_comes_to_rest_in_the_middle_at_one_temperature():
    run = tcbench.simulate("tc_monolithic", SCENARIO.replace(name="long", t_end=1000.0))
    q, p, *_ = run.z[-1]
    # E = 6 is all heat in the end: E1 = E2 = 3, theta = 2
    assert abs(q - 1) < 1e-6 and abs(p) < 1e-6 and np.allclose(run.temperatures[-1], 2.0, atol=1e-6)


def test_no_integrator_names_a_system():
    """The contract is right: formulas are written against System, never against the pendulum or the gas."""
    files = [*(Path(__file__).parents[2] / "plugins").glob("*.py")]
    assert len(files) > 10
    for path in files:
        text = path.read_text()
        if "tcbench_integrators" in text:
            modules = [n.module for n in ast.walk(ast.parse(text)) if isinstance(n, ast.ImportFrom)]
            assert "tcbench.systems.pendulum" not in modules and "gas" not in text.lower(), path.name


def test_methods_that_ask_for_a_closed_form_are_left_out_of_its_runs():
    from tcbench.runner.plan import plan_job

    scenarios = ["gas_containers", "short_term"]
    cells = {(c.integrator, c.scenario) for c in plan_job(None, scenarios, ["conservation"]).cells}
    asking = {name for name, i in tcbench.integrators().items() if i.needs}
    assert {(name, "short_term") for name in asking} <= cells
    assert not {(name, "gas_containers") for name in asking} & cells and ("tc_strang", "gas_containers") in cells
