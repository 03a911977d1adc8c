"""Least sizes of variables: what an author adds to the energy moves nothing, and units are found out."""

import numpy as np
import pytest
from mechanics import Mechanical, OfEntropies

import tcbench
from tcbench import Scenario
from tcbench.reference.lookup import reference_for

LENGTH, MOMENTUM, ENTROPY, ENERGY, TIME = range(5)


class Pendulum(OfEntropies):
    """In any unit, its energy counted from anywhere."""

    name = "any_pendulum"
    variables = {"q": (), "p": (), "s": ()}
    constants = {"sizes_of": (5,), "beyond": ()}

    def energy(self, z):
        q, p, s = z.q / self.sizes_of[LENGTH], z.p / self.sizes_of[MOMENTUM], z.s / self.sizes_of[ENTROPY]
        return self.sizes_of[ENERGY] * (p**2 / 2 + 2 * (1 - np.cos(q)) + np.exp(s) + self.beyond)

    def reversible(self, z, dE, dS):
        u = self.sizes_of
        speed = u[LENGTH] * u[MOMENTUM] / u[ENERGY] / u[TIME]
        return {"q": speed * dE.p, "p": -speed * dE.q}

    def irreversible(self, z, dE, dS):
        u = self.sizes_of
        force = 0.1 * u[MOMENTUM] ** 2 / u[ENERGY] / u[TIME] * dE.p
        return {"p": -force, "s": force * dE.p / dE.s}

    def temperature(self, z, dE, dS):
        return dE.s


def pendulum(units, beyond=0.0):
    start = {"q": 1.2 * units[LENGTH], "p": 0.3 * units[MOMENTUM], "s": 0.1 * units[ENTROPY]}
    constants = {"sizes_of": units, "beyond": beyond}
    return Scenario("any", Pendulum, constants, initial=start, t_end=3 * units[TIME], dt=0.1 * units[TIME])


ONE, SMALL = (1.0,) * 5, (2.0**-20, 2.0**-12, 2.0**-10, 2.0**-20, 2.0**-10)
PLAIN = pendulum(ONE)


@pytest.mark.parametrize(("beyond", "units"), [(1e3, SMALL), (1e5, ONE), (-1e8, ONE), (1e8, SMALL)])
@pytest.mark.parametrize("method", ["solve_ivp_bdf", "tc_taylor", "controlled[method=tc_monolithic]"])
def test_an_energy_counted_from_elsewhere_costs_no_digits(method, units, beyond):
    """With 1e8 joules added a tolerance of 1e-6 let entropies miss 0.1 with status ok: 1e8 joules move them so far."""
    scenario, size = pendulum(units, beyond), np.array(units[:3])
    exact = reference_for(PLAIN, [3.0]).states[0]
    missed = [
        np.abs(tcbench.simulate(method, s, tolerance=1e-6).z[-1] / unit - exact).max()
        for s, unit in ((PLAIN, 1.0), (scenario, size))
    ]
    assert missed[1] < 20 * max(missed[0], 1e-6)


@pytest.mark.parametrize("exponent", range(-60, 61, 24))
def test_sizes_are_within_a_factor_of_32_of_the_unit(exponent):
    """A move that is short beside 1 showed no curvature where momenta are of 2^30: their size was 2^7 times that."""
    units = np.exp2(np.array([-20.0, 0.0, -5.0, 0.0, 0.0]) + [0.0, exponent / 2, 0.0, exponent, 0.0])
    off = np.log2(pendulum(tuple(units)).model.magnitudes[:3] / units[:3])
    usual = pendulum(tuple(units)).model.magnitudes[:3] == 1.0
    assert (np.abs(off[~usual]) <= 5).all()


@pytest.mark.parametrize("exponent", range(-50, -13, 12))
def test_a_short_period_is_not_skipped(exponent):
    """Moves over many periods changed the energy little by chance: a size was 4 million periods."""
    scenario = pendulum((2.0**exponent, 1.0, 1.0, 1.0, 1.0))
    assert abs(np.log2(scenario.model.magnitudes[0]) - exponent) <= 5


class Bonds(Mechanical):
    """Two bonds whose forces cancel at rest, in a mass between walls; their heat is in themselves, or in a bath."""

    name = "bonds_at_rest"
    variables = {"q": (), "p": (), "s": (2,)}
    constants = {"own": ()}

    def energy(self, z):
        heat = self.own * np.exp(z.s - 0.3 * np.stack([z.q, -z.q])) + (1 - self.own) * z.s
        return z.p**2 / 2 + np.exp(-z.q) + np.exp(z.q) + heat.sum()

    def irreversible(self, z, dE, dS):
        a, b = dE.s[0], dE.s[1]
        force = 0.1 * dE.p
        return {"p": -force, "s": np.stack([(b - a) / a + force * dE.p / a, (a - b) / b])}


@pytest.mark.parametrize(("off", "own"), [(1e-14, 1.0), (1e-12, 0.0), (1e-10, 1.0), (1e-8, 0.0)])
@pytest.mark.parametrize("method", ["tc_monolithic", "tc_gonzalez", "controlled"])
def test_a_start_next_to_rest_is_solved(method, off, own):
    """Its slopes are what is left of larger ones: sizes of 1e-23 were told from them, below all round-off, and no step
    of most methods converged."""
    scenario = Scenario("next", Bonds, {"own": own}, initial={"q": off, "p": 0, "s": [0, 0]}, t_end=3, dt=0.1)
    run = tcbench.simulate(method, scenario)
    assert run.ok, run.failure
    assert np.abs(run.z).max() < 2 * off + 1e-14
