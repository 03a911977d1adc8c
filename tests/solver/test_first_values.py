"""Where Newton begins: near the root at short steps, harmless at long ones, and elsewhere for plain Newton."""

import numpy as np
import pytest
from mechanics import Mechanical, OfEntropies
from one_flow import OneFlow

import tcbench

METHODS = ("tc_monolithic", "tc_staggered", "midpoint_entropy", "midpoint_temperature")
SCENARIO = tcbench.scenarios()["bound_equilibrium"]


def starts(method, h, scenario=SCENARIO):
    """(the flow, the near start, the plain one)."""
    flow = OneFlow(tcbench.integrators()[method], scenario, h)
    n = flow.record.nx
    return flow, flow.record.w[n : 2 * n].copy(), flow.record.w[:n].copy()


@pytest.mark.parametrize("method", METHODS)
def test_at_rest_nothing_is_divided_by_zero(method):
    """No momenta, no forces: springs at their natural lengths and reference temperature."""
    rest = SCENARIO.replace(positions=(2, 0, 3, 0), momenta=(0, 0, 0, 0), temperatures=(300, 300))
    _, near, _ = starts(method, 0.3, rest)
    assert np.abs(near).max() < 1e-13
    run = tcbench.simulate(method, rest, dt=0.3, t_end=30.0)
    assert run.ok and run.solver.retried == 0 and np.abs(run.z - run.z[0]).max() < 1e-12


def test_the_first_newton_is_enough_at_short_steps():
    """From the drift alone, half of these steps took a second Jacobian; at long steps nothing is lost."""
    for method, most in (("tc_monolithic", 1.05), ("tc_staggered", 2.05), ("midpoint_temperature", 1.05)):
        solver = tcbench.simulate(method, SCENARIO, dt=0.05, t_end=20.0).solver
        assert solver.newton_iterations <= most * 400 and solver.retried == solver.tracked == 0


@pytest.mark.parametrize("name", ["damped_oscillator", "rigid_body", "heavy_top"])
def test_the_last_roots_of_any_system_foretell_the_next(name):
    """From z1 = z0 up to every step took a second Jacobian; of another run nothing is known."""
    scenario = tcbench.scenarios()[name]
    first = tcbench.simulate("tc_monolithic", scenario, dt=scenario.dt / 3, t_end=50 * scenario.dt)
    assert first.ok and first.solver.newton_iterations <= 1.1 * first.steps
    assert tcbench.simulate("tc_monolithic", scenario, dt=scenario.dt, t_end=20 * scenario.dt).ok
    again = tcbench.simulate("tc_monolithic", scenario, dt=scenario.dt / 3, t_end=50 * scenario.dt)
    assert np.array_equal(first.z, again.z)


@pytest.mark.parametrize("method", ["tc_monolithic", "tc_gonzalez"])
def test_at_a_large_step_one_root_is_not_where_the_next_is_looked_for(method):
    """From the first root Newton found another than from z1 = z0: dq = 0.8 where a single step has -6.5."""
    scenario = tcbench.scenarios()["damped_oscillator"]
    scenario = scenario.replace(**scenario.model.initial_of(scenario.model.state((2.2, 0.07, 0.03))))
    run, step = tcbench.simulate(method, scenario, dt=5.0, t_end=10.0), tcbench.stepper(method, scenario)
    assert run.ok and np.abs(step(run.z[1], 5.0) - run.z[2]).max() < 1e-9


class Rubbed(Mechanical):
    """A mass on a spring that is not linear, friction, and heat that flows."""

    name = "rubbed"
    variables = {"q": (), "p": (), "s": (2,)}
    constants = {"m": (), "rate": ()}

    def energy(self, z):
        heat = 300.0 * self.m * np.exp(z.s / self.m).sum()
        return z.p**2 / (2 * self.m) + self.m * (z.q**2 / 2 + z.q**4 / 4) + heat

    def irreversible(self, z, DE, DS):
        (a, b), force = DE.s, self.rate * self.m * DE.p
        flow = 0.5 * self.m * (b - a)
        return {"p": -force, "s": np.array([force * DE.p / a + flow / a, -flow / b])}


@pytest.mark.parametrize(("method", "rate"), [("tc_strang", 2.0), ("tc_staggered", 0.1), ("tc_monolithic", 2.0)])
def test_where_a_unit_makes_a_state_small_its_step_is_solved_all_the_same(method, rate):
    """A first correction of 1e-26 was nothing beside 1, and the energy missed as much as half of what moves."""
    end = []
    for m in (1.0, 1e-12, 1e-26, 1e-60, 1e10):
        start = {"q": 1.2, "p": 0.1 * m, "s": [0.0, 0.3 * m]}
        scenario = tcbench.Scenario("r", Rubbed, {"m": m, "rate": rate}, initial=start, dt=0.5, t_end=10.0)
        run = tcbench.simulate(method, scenario)
        assert run.ok and np.abs(run.energy - run.energy[0]).max() < 1e-10 * m
        end.append(run.z[-1, 0])
    assert np.allclose(end, end[0], rtol=0, atol=1e-12)


class Turned(OfEntropies):
    """A charge in a field, with friction."""

    name = "turned"
    variables = {"q": (2,), "p": (2,), "s": ()}
    constants = {"m": (), "k": (), "field": (), "rate": (), "heat": ()}

    def energy(self, z):
        return z.p @ z.p / (2 * self.m) + self.k * (z.q @ z.q) / 2 + self.heat * np.exp(z.s / self.heat)

    def reversible(self, z, DE, DS):
        return {"q": DE.p, "p": -DE.q + self.field * np.stack([DE.p[1], -DE.p[0]])}

    def irreversible(self, z, DE, DS):
        return {"p": -self.rate * DE.p, "s": self.rate * (DE.p @ DE.p) / DE.s}


@pytest.mark.parametrize("method", ["tc_monolithic", "tc_strang", "tc_itoh_abe", "bdf2"])
@pytest.mark.parametrize("mass, length, time", [(1, 2**-20, 1), (1, 1, 2**20), (2**-30, 1, 1), (2**-40, 2**-20, 2**-8)])
def test_a_unit_decides_no_number_of_a_step(method, mass, length, time):
    """Corrections were small beside 1 where entropies are 1e-12: positions were wrong by 1e-4, energy by 1e-5."""
    runs = []
    for M, L, T in ((1, 1, 1), (mass, length, time)):
        constants = {
            "m": 0.7 * M,
            "k": 1.3 * M / T**2,
            "field": 1.9 * M / T,
            "rate": 0.2 * M / T,
            "heat": M * L**2 / T**2,
        }
        start = {"q": [0.9 * L, -0.4 * L], "p": [0.0, 0.3 * M * L / T], "s": 0.0}
        scenario = tcbench.Scenario("turned", Turned, constants, initial=start, dt=0.2 * T, t_end=8.0 * T)
        run = tcbench.simulate(method, scenario)
        assert run.ok
        runs.append(run.z / np.repeat([L, M * L / T, M * L**2 / T**2], [2, 2, 1]))
    assert np.abs(runs[1] - runs[0]).max() < 1e-13


class Near(Turned):
    """A spring that is measured from where it rests, and heat whose energy at the start is 0."""

    reference_temperature = 1.0

    def energy(self, z):
        e = np.log((1 + z.q[0]) ** 2 + z.q[1] ** 2) / 2
        return z.p @ z.p / 2 + 10 * e**2 / 2 + 3 * (np.exp(z.s / 3 - 0.1 * e) - 1) + 0.3 * e


@pytest.mark.parametrize("method", ["tc_monolithic", "midpoint_entropy"])
def test_next_to_rest_what_is_left_of_large_terms_is_no_unit(method):
    """Beside p = 1e-9 the round-off of 1 + q is large, and no smaller correction can be asked for."""
    for p in (1e-5, 1e-8, 1e-10, 1e-14, 0.0):
        constants = dict.fromkeys(Turned.constants, 0.1)
        start = {"q": [0.0, 0.0], "p": [p, p], "s": 0.0}
        run = tcbench.simulate(method, tcbench.Scenario("near", Near, constants, initial=start, dt=0.2, t_end=20.0))
        assert run.ok and run.solver.retried == 0 and np.abs(run.z).max() <= 20 * p + 1e-14


@pytest.mark.parametrize("factor", [100.0, 200.0, 300.0])
def test_stiff_conduction_of_a_general_system_is_solved_from_z0_without_continuation(factor):
    """Two corrections of 14 and 13 times the sizes begin a step there: the first is but the linearly implicit guess."""
    scenario = tcbench.scenarios()["viscous_pendulum"]
    run = tcbench.simulate("tc_monolithic", scenario.replace(conductivity=10.0 * factor), 0.3, 30.0)
    assert run.ok and run.solver.tracked == run.solver.retried == 0
    assert abs(np.ptp(run.energy)) < 1e-13 * abs(run.energy[0]) and np.diff(run.entropy).min() > -1e-12
