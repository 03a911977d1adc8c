"""Formulas that rise with an infinite slope where a run begins."""

import numpy as np
import pytest
from mechanics import Mechanical, OfEntropies, rubbed

import tcbench


class Weight(OfEntropies):
    """A mass that is pulled away from a point, by 2, and back by what `height` gives; beside it an oscillator."""

    name = "weight"
    variables = {"q": (), "p": (), "x": (), "y": (), "s": ()}

    def height(self, q):
        return abs(q)

    def energy(self, z):
        return z.p**2 / 2 + self.height(z.q) - 2 * z.q + z.y**2 / 2 + z.x**2 / 2 + z.x**4 / 4 + np.exp(z.s)

    def reversible(self, z, DE, DS):
        return {"q": DE.p, "p": -DE.q, "x": DE.y, "y": -DE.x}

    def irreversible(self, z, DE, DS):
        return {}


class Rooted(Weight):
    def height(self, q):
        return q**1.5


class Weights(Weight):
    """Many of them, whose equations are sparse."""

    name = "weights"
    variables = dict.fromkeys("qpxys", ("weight",))
    constants = {"share": ("weight",)}

    def energy(self, z):
        beside = (z.y**2 / 2 + z.x**2 / 2 + z.x**4 / 4).sum()
        return z.p @ z.p / 2 + self.share @ self.height(z.q) - 2 * z.q.sum() + beside + np.exp(z.s).sum()

    def entropy(self, z):
        return z.s.sum()


class ManyRooted(Weights):
    height = Rooted.height


@pytest.mark.parametrize(
    ("name", "system"),
    [*((name, Rooted) for name in ("midpoint_entropy", "tc_monolithic", "gauss2", "cpg")), ("tc_monolithic", Weight),
     ("midpoint_entropy", Weights), ("tc_monolithic", ManyRooted), ("midpoint_entropy", ManyRooted)],
)  # fmt: skip
def test_a_start_with_an_infinite_slope_is_left(name, system):
    """There every correction of Newton is 0, and where it began is no root: steps stood still, the energy kept, the
    whole run where an oscillator beside it converged.

    q = t^2/2, and t^2 (1 - t/8)^2 by p^2/2 = 2 q - q^1.5.
    """
    constants = {name: np.ones(40) for name in system.constants}
    start = {name: np.zeros(40 if constants else ()) for name in system.variables}
    end = 0.765625 if "Rooted" in system.__name__ else 0.5
    for beside in (0.0, 1.0):
        start["x"] += beside
        scenario = tcbench.Scenario("weight", system, constants=constants, initial=start, dt=0.01, t_end=1.0)
        run = tcbench.simulate(name, scenario)
        assert run.ok and run.z[-1, 0] == pytest.approx(end, abs=1e-4)


class Contact(Mechanical):
    """Two masses in free flight until they touch a wall and each other, as Hertz's spheres do."""

    name = "contact"
    variables = {"q": (2,), "p": (2,), "s": ()}

    def energy(self, z):
        pressed = (np.array([z.q[0], z.q[1] - z.q[0]]) + abs(np.array([z.q[0], z.q[1] - z.q[0]]))) / 2
        return z.p @ z.p / 2 + (pressed**2.5).sum() + np.exp(z.s)

    def irreversible(self, z, DE, DS):
        return {"p": -0.1 * DE.p, "s": 0.1 * DE.p @ DE.p / DE.s}


class Relativistic(Mechanical):
    name = "relativistic"
    constants = {"m": (), "C": ()}

    def energy(self, z):
        kinetic = 2.0 * np.sqrt(z.p**2 + 4.0 * self.m**2)
        return kinetic + self.m * (z.q**2 / 2 + z.q**4 / 4) + 300.0 * self.C * np.exp(z.s / self.C)

    def irreversible(self, z, DE, DS):
        return rubbed(0.01 * self.m * DE.p, DE)


@pytest.mark.parametrize("name", ["midpoint_entropy", "cpg", "tc_monolithic"])
def test_a_slope_that_units_make_steep_is_none(name):
    """That of positions by momenta is 1e26 times as large where a mass is 1e-26."""
    end = []
    for m, heat in ((1.0, 1.0), (1e-26, 1.38e-23)):
        start = {"q": 1.2, "p": 0.0, "s": 0.0}
        scenario = tcbench.Scenario("spring", Relativistic, {"m": m, "C": heat}, initial=start, dt=0.01, t_end=0.5)
        run = tcbench.simulate(name, scenario)
        assert run.ok
        end.append(run.z[-1, 0])
    assert end[1] == pytest.approx(end[0], abs=1e-3)  # friction differs by what heat does to the temperature


class Ring(Relativistic):
    """Many of them, next to each other, whose equations are sparse."""

    name = "ring"
    variables = dict.fromkeys("qps", ("body",))
    tables = {"next": ("body", 2, "body")}

    def energy(self, z):
        a, b = z.q[self.next].T
        kinetic = 2.0 * np.sqrt(z.p**2 + 4.0 * self.m**2)
        springs = self.m * (z.q**2 / 2 + z.q**4 / 4 + (a - b) ** 2 / 10)
        return (kinetic + springs + 300.0 * self.C * np.exp(z.s / self.C)).sum()


def test_a_slope_that_units_make_steep_is_none_of_many():
    """That of momenta by positions, in the method whose equations keep both; a factor for all is an unknown there."""
    k, end = np.arange(40), []
    for m in (1.0, 1e20):
        start = {"q": 1.2 + 0.1 * np.sin(k), "p": np.full(40, 0.1 * m), "s": np.full(40, 0.1 * m)}
        constants = {"m": m, "C": m, "next": np.stack([k, (k + 1) % 40], axis=1)}
        scenario = tcbench.Scenario("ring", Ring, constants, initial=start, dt=0.01, t_end=0.05)
        run = tcbench.simulate("tc_gonzalez", scenario)
        assert run.ok
        end.append(run.z[-1, :40])
    assert np.allclose(*end, rtol=1e-12)


@pytest.mark.parametrize("dt", [0.01, 0.005])
def test_steps_whose_start_solves_their_equations_are_taken(dt):
    """Also where round-off is all that Newton corrects, and a formula has roots."""
    start = {"q": [-0.1, 0.1], "p": [0.0, 0.3], "s": 0.0}
    run = tcbench.simulate("tc_monolithic", tcbench.Scenario("contact", Contact, {}, initial=start, dt=dt, t_end=1.0))
    assert run.ok


class Dragged(Mechanical):
    """A mass on a spring, and friction whose slope at rest is 0 though a factor of it has an infinite one."""

    name = "dragged"
    constants = {"power": ()}

    def energy(self, z):
        return np.sum(z.p**2 + z.q**2) / 2 + np.sum(np.exp(z.s))

    def irreversible(self, z, DE, DS):
        return rubbed(DE.p * self.drag(DE.p), DE)

    def drag(self, v):
        return abs(v) ** 0.3


class DraggedByRoot(Dragged):
    def drag(self, v):
        return np.sqrt(abs(v))


class DraggedByPower(Dragged):
    def drag(self, v):
        return abs(v) ** self.power


class DraggedInThePlane(Dragged):
    def drag(self, v):
        return np.hypot(v, 2.0 * v)


class ManyDragged(Dragged):
    variables = dict.fromkeys("qps", ("body",))
    constants = {"power": ("body",)}


@pytest.mark.parametrize("system", [Dragged, DraggedByRoot, DraggedByPower, DraggedInThePlane, ManyDragged])
def test_friction_begins_at_rest(system):
    """0 times an infinite slope was no number, and the solver found no root: v |v|^0.3."""
    still = np.zeros(60 if system is ManyDragged else ())
    for at, name in ((0.0, "tc_monolithic"), (1.0, "tc_monolithic"), (1.0, "midpoint_entropy")):
        start = {"q": still + at, "p": still, "s": still}
        scenario = tcbench.Scenario("dragged", system, {"power": still + 0.3}, initial=start, dt=0.1, t_end=1.0)
        run = tcbench.simulate(name, scenario)
        assert run.ok and abs(run.energy[-1] - run.energy[0]) < 1e-5 * len(run.z[0])
        assert (run.z[-1, 0] == 0.0) if at == 0.0 else (0.5 < run.z[-1, 0] < 0.8)


class Raised(Dragged):
    name = "raised"

    def energy(self, z):
        return z.p**2 / 2 + z.q**self.power + np.exp(z.s)


@pytest.mark.parametrize("power", [1.0, 1.5, 2.0, 5.0])
def test_a_power_that_is_a_constant_has_the_slope_of_one_that_is_written(power):
    """At 0 it was 2e40 where the exponent is 2, and of 1e-8 to the 8th twice what it is."""
    model = Raised(power=power)
    for q in (0.0, 1e-30, 1e-8, 0.7):
        for n in (power, power + 3.0):
            rate = Raised(power=n).vector_field([q, 0.0, 0.0])
            assert rate[:2] == pytest.approx([0.0, -n * q ** (n - 1)], rel=1e-14, abs=1e-49)
        assert np.isfinite(model.jacobian([max(q, 1e-30), 0.0, 0.0])).all()


class Edge(Weight):
    def height(self, q):
        return 2 * q + np.sqrt(q)


@pytest.mark.parametrize("name", ["solve_ivp_rk45", "scipy_dopri5", "tc_gauss", "tc_taylor"])
def test_an_infinite_rate_stays_one(name):
    """A slope of 1e60 in its place kept an explicit solver looking for its first step, and lost a law's energy."""
    start = {"q": 0.0, "p": 1.0, "x": 0.0, "y": 0.0, "s": 0.0}
    assert not tcbench.simulate(name, tcbench.Scenario("edge", Edge, {}, initial=start, dt=0.05, t_end=1.0)).ok


class EdgeOfPower(Weight):
    constants = {"power": ()}

    def height(self, q):
        return 6 * q + q**self.power


def test_a_steep_start_excuses_no_energy():
    """With an exponent that is a constant the slope at 0 is 1e24, and round-off of what it multiplies was taken for the
    energy's: 7e-4 of it went in the first step, with status ok."""
    start = {"q": 0.0, "p": 1.0, "x": 0.0, "y": 0.0, "s": 0.0}
    run = tcbench.simulate(
        "tc_gauss", tcbench.Scenario("e", EdgeOfPower, {"power": 0.9}, initial=start, dt=0.01, t_end=0.1)
    )
    assert not run.ok or abs(run.energy - run.energy[0]).max() < 1e-12


class Bouncing(Mechanical):
    """A weight over a floor: the depth to which it is pressed, (|q| - q)/2, is 0 above it, and never less."""

    name = "bouncing"
    constants = {"drag": ()}

    def energy(self, z):
        depth = (abs(z.q) - z.q) / 2
        return z.p**2 / 2 + z.q + 50 * depth**2.5 + np.exp(z.s)

    def irreversible(self, z, DE, DS):
        return rubbed(self.drag * DE.p, DE)


@pytest.mark.parametrize("name", ["tc_monolithic", "tc_gonzalez", "relaxation"])
def test_what_is_nothing_above_a_floor_has_a_root(name):
    """Divided differences made it less than 0 by a last digit, of which there is no root."""
    start = {"q": 1.0, "p": 0.0, "s": 0.0}
    run = tcbench.simulate(name, tcbench.Scenario("b", Bouncing, {"drag": 0.1}, initial=start, t_end=1.2, dt=0.02))
    assert run.ok and run.summary.energy_error_max < 1e-14
