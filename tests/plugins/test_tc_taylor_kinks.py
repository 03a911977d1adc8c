"""tc_taylor where formulas have kinks: sizes, signs, roots of sums of squares."""

import numpy as np
import pytest
from mechanics import Mechanical, rubbed
from scipy.integrate import solve_ivp

import tcbench
from tcbench import Scenario
from tcbench.plugins import find_integrator


class Rough(Mechanical):
    """Oscillators in quadratic drag: |v| v has a kink at each turn."""

    name = "rough"
    variables = dict.fromkeys("qps", ("node",))
    constants = {"drag": ("node",)}

    def energy(self, z):
        return (2 * z.q**2 + z.p**2 / 2 + np.exp(z.s)).sum()

    def irreversible(self, z, dE, dS):
        return rubbed(self.drag * abs(dE.p) * dE.p, dE)


TRUTH = {}  # by system: each has one start here


def truth(scenario):
    """The end, by a solver whose steps no feature is shorter than."""
    if scenario.system not in TRUTH:
        span, field = [0.0, scenario.t_end], scenario.model.vector_field
        found = solve_ivp(lambda t, z: field(z), span, scenario.z0, "DOP853", rtol=1e-12, atol=1e-13, max_step=0.01)
        TRUTH[scenario.system] = found.y[:, -1]
    return TRUTH[scenario.system]


@pytest.mark.parametrize("most", [0, 1000])
def test_steps_end_at_kinks(most, monkeypatch):
    """Errors follow the tolerance, and fixed steps have their order, across fifty turns, nine of them at the start."""
    monkeypatch.setattr("tcbench_plugins.tc_taylor.orders.MOST_VARIABLES", most)
    k = np.arange(9.0)  # as few as are traced on arrays
    start, drag = {"q": np.cos(k), "p": 0 * k, "s": 0.1 * k}, {"drag": 0.2 + 0.1 * k}
    scenario = tcbench.Scenario(f"rough {most}", Rough, drag, initial=start, t_end=10.0, dt=0.1)
    model, span, exact = scenario.model, np.array([0.0, scenario.t_end]), truth(scenario)
    for tolerance in (1e-3, 1e-9):
        states, cost = find_integrator("tc_taylor").adaptive(model, scenario.z0, span, tolerance, tolerance)
        assert np.abs(states[-1] - exact).max() < tolerance and cost["steps"] < 200
    runs = [tcbench.simulate("tc_taylor[order=4]", scenario, dt=h) for h in (0.1, 0.05)]
    coarse, fine = (np.abs(run.z[-1] - exact).max() for run in runs)
    assert coarse > 13.0 * fine
    assert all(run.summary.energy_error_max < 1e-13 and run.summary.entropy_increment_min >= 0.0 for run in runs)


class Cornered(Rough):
    """Its forces have signs in them, written as derivatives and roots of squares give them."""

    name = "cornered"

    def energy(self, z):
        q = z.q
        kinks = (q + abs(q)) ** 2 + np.sqrt((q - 0.2) ** 2) ** 3 + abs(abs(q) - 0.5) * (abs(q) - 0.5)
        return (kinks + q**2 + z.p**2 / 2 + np.exp(z.s)).sum()

    def irreversible(self, z, dE, dS):
        return rubbed(self.drag * dE.p, dE)


@pytest.mark.parametrize("most", [0, 1000])
def test_signs_are_those_of_where_a_step_begins(most, monkeypatch):
    """The quotient x/|x| behind a kink, and the series of a root that goes on below 0, led elsewhere with status ok."""
    monkeypatch.setattr("tcbench_plugins.tc_taylor.orders.MOST_VARIABLES", most)
    k = np.arange(9.0)
    start = {"q": 0.5 * np.cos(k) * (k != 1), "p": 0.8 * np.sin(k), "s": 0 * k}
    scenario = tcbench.Scenario(f"cornered {most}", Cornered, {"drag": 0.2 + 0 * k}, initial=start, t_end=3.0, dt=0.05)
    model, span, exact = scenario.model, np.array([0.0, scenario.t_end]), truth(scenario)
    states, _ = find_integrator("tc_taylor").adaptive(model, scenario.z0, span, 1e-9, 1e-9)
    assert np.abs(states[-1] - exact).max() < 1e-8
    run = tcbench.simulate("tc_taylor[order=6]", scenario)
    assert run.ok and np.abs(run.z[-1] - exact).max() < 1e-6


class Pulled(Mechanical):
    """Points in the plane, drawn to the origin by their distances from there."""

    name = "pulled"
    variables = {"q": ("node", 2), "p": ("node", 2), "s": ()}
    constants = {"mass": ("node",), "half": ()}

    def distance(self, q):
        return np.sqrt((q * q).sum(axis=1))

    def energy(self, z):
        return self.distance(z.q).sum() + (z.p * z.p / self.mass[:, None]).sum() / 2 + np.exp(z.s)


class ByHypot(Pulled):
    name = "by_hypot"

    def distance(self, q):
        return np.hypot(q[:, 0], q[:, 1])


class ByPower(Pulled):
    name = "by_power"

    def distance(self, q):
        return (q * q).sum(axis=1) ** 1.5 / (q * q).sum(axis=1)


class ByConstant(Pulled):
    name = "by_constant"

    def distance(self, q):
        return (q * q).sum(axis=1) ** self.half


@pytest.mark.parametrize(
    ("kind", "most", "beside"),
    [(Pulled, 0, 1e-7), (Pulled, 1000, 0.0), (ByHypot, 1000, 0.0), (ByPower, 1000, 1e-7), (ByConstant, 1000, 0.0)],
)  # fmt: skip
def test_a_root_that_touches_zero_turns_there(kind, most, beside, monkeypatch):
    """Its series goes on below 0: with status ok points on their way through the origin were wrong by 0.2."""
    monkeypatch.setattr("tcbench_plugins.tc_taylor.orders.MOST_VARIABLES", most)
    along, across = np.array([[1.0, 0.0], [0.6, 0.8]]), np.array([[0.0, 1.0], [-0.8, 0.6]])
    start = {"q": beside * across - along, "p": along, "s": 0.0}
    scenario = tcbench.Scenario(
        f"{kind.name} {most}", kind, {"mass": [1.0, 1.0], "half": 0.5}, initial=start, t_end=2.0, dt=0.1
    )
    through = np.sqrt(3.0)  # the speed at the origin, which is reached after through - 1
    exact = (through * (3.0 - through) - (3.0 - through) ** 2 / 2) * along  # beside it by 10 times as much
    for name in ("tc_taylor", "tc_auto"):
        for tolerance in (1e-3, 1e-9):
            states, cost = find_integrator(name).adaptive(
                scenario.model, scenario.z0, np.array([0.0, 2.0]), tolerance, tolerance
            )
            assert np.abs(states[-1][:4].reshape(2, 2) - exact).max() < 5 * tolerance + 100 * beside
            assert cost["steps"] < 100


@pytest.mark.parametrize(("order", "steps"), [(4, 1000), (8, 64), (20, 16)])
def test_fixed_steps_keep_their_digits_behind_the_zero_of_a_root(order, steps):
    """Rounding made coefficients of 1e50 there: a state was wrong by 0.8 with status ok, and more with more steps."""
    along = np.array([[1.0, 0.0], [0.6, 0.8]])
    constants, start = {"mass": [1.0, 1.0], "half": 0.5}, {"q": -along, "p": along, "s": 0.0}
    scenario = tcbench.Scenario("through", Pulled, constants, initial=start, t_end=2.0, dt=2.0 / steps)
    through = np.sqrt(3.0)
    exact = (through * (3.0 - through) - (3.0 - through) ** 2 / 2) * along
    run = tcbench.simulate(f"tc_taylor[order={order}]", scenario)
    # a force that jumps by 2 does so 2e-10 of a step too late
    assert run.ok and np.abs(run.z[-1][:4].reshape(2, 2) - exact).max() < 1e-10


def test_at_the_zero_of_a_root_a_run_does_not_begin():
    start = {"q": [[0.0, 0.0]], "p": [[1.0, 0.0]], "s": 0.0}
    scenario = tcbench.Scenario("pulled", Pulled, {"mass": [1.0], "half": 0.5}, initial=start, t_end=2.0, dt=0.1)
    assert not tcbench.simulate("tc_taylor", scenario).ok


class Sliding(Rough):
    """On the edge of a valley, which dry friction slows down: both ways lead back to where formulas jump."""

    name = "sliding"

    def energy(self, z):
        return (abs(z.q) + 0.3 * z.q + z.p**2 / 2 + np.exp(z.s)).sum()

    def irreversible(self, z, dE, dS):
        return rubbed(self.drag * dE.p / (abs(dE.p) + 1e-300), dE)


@pytest.mark.parametrize(("at", "drag"), [(0.0, 0.0), (-1.0, 1.5)])
def test_a_run_that_slides_ends(at, drag):
    """The implicit method, which was to take over from explicit steps that led nowhere, went on without end."""
    start = {"q": [at], "p": [0.0], "s": [0.0]}
    scenario = tcbench.Scenario("sliding", Sliding, {"drag": [drag]}, initial=start, t_end=20.0, dt=0.1)
    for name in ("tc_taylor", "tc_auto"):
        assert "too short" in tcbench.simulate(name, scenario).failure


class Grazing(Rough):
    """A spring each that is met at `wall`, which an oscillator passes for a small part of a step."""

    name = "grazing"
    constants = {"k": ("node",), "wall": ("node",)}

    def energy(self, z):
        u = z.q - self.wall
        return ((z.p**2 + z.q**2) / 2 + self.k * ((u + abs(u)) / 2) ** 2 / 2 + np.exp(z.s)).sum()

    def irreversible(self, z, dE, dS):
        return {"s": 0 * dE.s}


@pytest.mark.parametrize(("most", "beyond"), [(0, 1e-4), (1000, 1e-3), (1000, 1e-6)])
def test_a_kink_that_is_passed_twice_within_a_step_is_seen(beyond, most, monkeypatch):
    """They were looked for an eighth of a step apart: a contact that had ended by then was missed, at any tolerance."""
    monkeypatch.setattr("tcbench_plugins.tc_taylor.orders.MOST_VARIABLES", most)
    k, wall, n = 1e3, 1.0 - beyond, 9  # as few as are traced on arrays
    meets, w, centre = np.arccos(-wall), np.sqrt(1 + k), k * wall / (1 + k)
    speed = np.sqrt(beyond * (2.0 - beyond))
    back = meets + 2 * np.arctan2(speed / w, wall - centre) / w  # the time at which it leaves the wall
    start = {"q": np.full(n, -1.0), "p": np.zeros(n), "s": np.zeros(n)}
    scenario = tcbench.Scenario(
        "grazing", Grazing, {"k": [k] * n, "wall": [wall] * n}, initial=start, t_end=6.0, dt=0.1
    )
    exact = wall * np.cos(6.0 - back) - speed * np.sin(6.0 - back)
    for tolerance in (1e-4, 1e-6, 1e-10):
        run = tcbench.simulate("tc_taylor", scenario, tolerance=tolerance, times=[6.0])
        assert abs(scenario.model.state(run.z[-1]).q - exact).max() < 10 * tolerance, tolerance


class Held(Mechanical):
    """Dry friction, which holds the body where the spring pulls less."""

    name = "held"
    constants = {"c": ()}

    def energy(self, z):
        return z.p**2 / 2 + z.q**2 / 2 + 300.0 * z.s

    def irreversible(self, z, dE, dS):
        return rubbed(self.c * np.sign(dE.p), dE)


@pytest.mark.parametrize("tolerance", [1e-3, pytest.param(1e-6, marks=pytest.mark.thorough)])
def test_where_dry_friction_holds_a_body_the_sentence_says_so(tolerance):
    """The body stops at t = pi. `controlled` divided steps for minutes, and the sentence named no cause."""
    scenario = Scenario("held", Held, {"c": 0.4}, initial={"q": 1.0, "p": 0.0, "s": 0.0}, t_end=6.3, dt=0.1)
    for method in ("tc_taylor", "tc_auto", "tc_gauss_adaptive", "controlled", "projected[method=scipy_dop853]"):
        run = tcbench.simulate(method, scenario, tolerance=tolerance)
        assert run.status == "nonconverged" and "sticks (dry friction)" in run.failure, (method, run.failure)
        if not method.startswith("projected"):  # whose solver gives states one by one, up to a turn in its kink
            assert run.t[-1] == pytest.approx(np.pi, abs=0.04), method  # states up to there are kept
            assert run.z[-1, 0] == pytest.approx(-0.2, abs=2e-3), method
