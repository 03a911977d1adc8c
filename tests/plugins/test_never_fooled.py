"""Adaptive methods where a series sees nothing of what comes: errors are of the tolerance.

Truth has closed forms, or comes from SciPy with steps that no feature is shorter than."""

import numpy as np
import pytest
from mechanics import Mechanical, rubbed
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import tcbench
from tcbench import Scenario

METHODS = ("tc_taylor", "tc_auto")
ALLOWED = 100.0  # tolerances, times what the motion makes of them


class Moving(Mechanical):
    """p^2/2 + potential(q), friction c p, heat 300 s."""

    name = "moving"
    constants = {"k": (), "at": (), "width": (), "c": ()}

    def energy(self, z):
        return z.p**2 / 2 + self.potential(z.q) + 300.0 * z.s

    def irreversible(self, z, dE, dS):
        return rubbed(self.c * dE.p, dE)


class Power(Moving):
    def potential(self, q):
        return self.k * q**self.N / self.N


class Gap(Power):
    """From the middle the series begins with terms of orders 1, 8, 15, ..."""

    N = 8


class MixedGaps(Moving):
    def potential(self, q):
        return self.k * (1e-3 * q**4 + q**18 / 18)


class Lacunary(Power):
    """The first term that is not that of free motion has an order above that of any series here."""

    N = 40


class Hill(Moving):
    def potential(self, q):
        return self.k * np.exp(-(((q - self.at) / self.width) ** 2))


class Front(Moving):
    def potential(self, q):
        return self.k * np.tanh((q - self.at) / self.width)


def truth(scenario, tolerance=1e-12):
    t = np.linspace(0.0, scenario.t_end, 201)
    field = scenario.model.vector_field
    solution = solve_ivp(lambda t, z: field(z), t[[0, -1]], scenario.z0, "DOP853", t, rtol=tolerance, atol=tolerance,
                      max_step=scenario.t_end / 500)  # fmt: skip
    return solution.y.T


@pytest.mark.parametrize(
    ("kind", "k", "at", "width", "c", "t_end"),
    [
        (Gap, 1.0, 0.0, 1.0, 0.0, 10.0),
        (MixedGaps, 3.0, 0.0, 1.0, 0.0, 9.0),
        (Lacunary, 1.0, 0.0, 1.0, 0.0, 7.0),
        (Hill, 0.3, 12.0, 1.0, 0.01, 30.0),
        (Front, 0.2, 6e3, 150.0, 0.0, 1e4),
    ],
)
def test_what_a_series_does_not_see_is_not_stepped_over(kind, k, at, width, c, t_end):
    """Errors of order 1 at every tolerance, with status ok: the last two terms were all that was asked."""
    scenario = unseen(kind, k, at, width, c, t_end)
    exact = truth(scenario)
    size = np.maximum(1.0, np.abs(exact).max(axis=0))
    for method in METHODS:
        run = tcbench.simulate(method, scenario, tolerance=1e-4)
        assert run.ok, run.failure
        assert (np.abs(run.z - exact) / size).max() < ALLOWED * 1e-4, method


class Ball(Moving):
    def potential(self, q):
        return 9.81 * q + self.k / 2 * ((abs(q) - q) / 2) ** 2


def bounced(t, g=9.81, k=1e6):
    """The ball from 1, which stays in the floor for (pi + 2 atan(g / (w v))) / w, w = sqrt(k)."""
    v, w = np.sqrt(2 * g), np.sqrt(k)
    flight, contact = v / g, (np.pi + 2 * np.arctan(g / (w * v))) / w
    t = (t + flight) % (2 * flight + contact) - flight
    if t <= flight:
        return np.array([1.0 - g * t * t / 2, -g * t])
    x = w * (t - flight)
    return np.array([-g / k * (1.0 - np.cos(x)) - v / w * np.sin(x), -g / w * np.sin(x) - v * np.cos(x)])


@pytest.mark.parametrize("method", METHODS)
def test_the_state_at_a_time_does_not_depend_on_how_long_the_run_goes_on(method):
    """A ball on a stiff floor, learn-multibody-dynamics, pull request 158: the place of a kink was found to a
    part of the step that was tried, which of free flight is the whole run."""
    constants = {"k": 1e6, "at": 0.0, "width": 1.0, "c": 0.0}
    scenario = Scenario("ball", Ball, constants, initial={"q": 1.0, "p": 0.0, "s": 0.0}, t_end=1.0, dt=0.01)
    for end in (2.5, 10.0, 100.0):
        run = tcbench.simulate(method, scenario.replace(t_end=end), tolerance=1e-3, times=[1.0, end])
        assert run.ok and np.abs(run.z[1, :2] - bounced(1.0)).max() < 1e-4


def test_a_step_backwards_undoes_a_step():
    """It held the entropy, which falls on the way back, and was wrong by 1e-4."""
    scenario = tcbench.scenarios()["damped_oscillator"]
    step = tcbench.stepper("tc_taylor[order=8]", scenario.model)
    there = step(scenario.z0, 0.05)
    assert np.abs(step(there, -0.05) - scenario.z0).max() < 1e-11


class Notch(Moving):
    """A force k on one side and k width on the other: the motion comes to rest in ever shorter arcs."""

    def potential(self, q):
        u = q - self.at
        return self.k * ((1.0 + self.width) * abs(u) + (1.0 - self.width) * u) / 2


def at_rest_in_notch(k, at, width, c, left):
    """(q, p) at that time, from q = at + 0.5 at rest, arc by arc."""
    u, p, side = 0.5, 0.0, 1.0
    while True:
        drift = k / c if side > 0.0 else -k * width / c

        def place(x, u=u, p=p, drift=drift):
            return u - (p + drift) * np.expm1(-c * x) / c - drift * x

        arc = left
        if side * place(left) < 0.0:
            arc = brentq(place, 0.0 if u else abs(p / (c * drift)), left, xtol=1e-300, rtol=1e-15)
        p, place_then = (p + drift) * np.exp(-c * arc) - drift, place(arc)
        if arc == left:
            return at + place_then, p
        u, left, side = 0.0, left - arc, -side


@pytest.mark.parametrize(
    ("k", "at", "width", "c", "tolerance"),
    [
        (1.15, 1.46, 1.0, 1.0, 1e-4),
        (1.0, 0.0, 0.4, 0.5, 1e-8),
        (3.0, -0.7, 1.0, 0.8, 1e-8),
        (20.0, 0.1, 0.7, 0.3, 1e-4),
    ],
)
def test_hundreds_of_kinks_in_ever_shorter_arcs_miss_no_more_than_one(k, at, width, c, tolerance):
    """A step ended up to a tolerance behind its kink, with the force of before: the phase missed 250 tolerances."""
    constants, t_end = {"k": k, "at": at, "width": width, "c": c}, 8.0
    scenario = Scenario("notch", Notch, constants, initial={"q": at + 0.5, "p": 0.0, "s": 0.0}, t_end=t_end, dt=0.1)
    run = tcbench.simulate("tc_taylor", scenario, tolerance=tolerance)
    assert run.ok, run.failure
    assert np.abs(run.z[-1, :2] - at_rest_in_notch(k, at, width, c, t_end)).max() < 10 * tolerance


class Flat(Moving):
    def potential(self, q):
        return 1e-3 * q**self.N / self.N + self.k * q**self.M / self.M


class Pulse(Moving):
    """On a clock of its own."""

    variables = {"q": (), "p": (), "tau": (), "g": (), "s": ()}

    def energy(self, z):
        pulse = np.exp(-(((z.tau - self.at) / self.width) ** 2))
        return z.p**2 / 2 + z.q**2 / 8 - self.k * z.q * pulse + z.g + 300.0 * z.s

    def reversible(self, z, dE, dS):
        return {"q": dE.p, "p": -dE.q, "tau": dE.g, "g": -dE.tau}


def unseen(kind, k=1.0, at=0.0, width=1.0, c=0.0, t_end=10.0, **powers):
    system = type(kind.__name__, (kind,), powers)
    initial = {"q": 0.0, "p": 1.0, "s": 0.0} | ({"tau": 0.0, "g": 0.0} if issubclass(kind, Pulse) else {})
    return Scenario("unseen", system, {"k": k, "at": at, "width": width, "c": c}, initial=initial, t_end=t_end,
                    dt=t_end / 200)  # fmt: skip


UNSEEN = [
    unseen(Flat, 30.0, N=8, M=22, t_end=40.0), unseen(Flat, 3.0, N=6, M=16, t_end=25.0), unseen(Flat, N=10, M=30),
    unseen(Gap), unseen(Lacunary, t_end=20.0), unseen(Hill, 0.3, 12.0, c=0.01, t_end=30.0),
    unseen(Hill, 0.23, 55.0, 1.7, t_end=100.0), unseen(Front, 0.2, 60.0, 1.5, c=0.002, t_end=100.0),
    unseen(Pulse, 2.0, 6.0, 0.3), unseen(Pulse, 1.0, 40.0, 1.0, t_end=50.0), unseen(Notch, 2.0, 0.3, c=0.3),
]  # fmt: skip


@pytest.mark.parametrize("scenario", UNSEEN, ids=lambda s: f"{s.system.__name__} {s.t_end:g}")
def test_the_projection_of_a_solver_errs_as_the_solver_does(scenario):
    """Energy that was lost on all the way went into what moved since the last output, where the energy is flat: 656
    tolerances, or no state near had it."""
    exact = truth(scenario)
    alone, moved = (
        tcbench.simulate(name, scenario, tolerance=1e-6) for name in ("scipy_dop853", "projected[method=scipy_dop853]")
    )
    assert moved.ok, moved.failure
    missed, with_laws = (np.abs(run.z - exact)[:, :2].max() for run in (alone, moved))
    assert with_laws < 2 * missed + 1e-5
    assert moved.summary.energy_error_max < 1e-11


KINKED = {  # force, friction, what the rates are multiplied by
    "a wall": (lambda q: q**2 / 2 + 8 * np.maximum(q - 0.3, 0.0) ** 2, None, None),
    "a stiff floor": (lambda q: 9.81 * q + 1.5e4 * np.maximum(-q, 0.0) ** 2, None, None),
    "a floor of springs": (lambda q: 9.81 * q + 1e4 * np.maximum(-q, 0.0) ** 2.5, lambda q, v: 0.02 * v, None),
    "a box": (lambda q: 5e2 * np.maximum(np.abs(q) - 0.8, 0.0) ** 2 + q / 4, None, None),
    "a notch": (lambda q: q**2 / 2 + 0.3 * np.abs(q - 0.2), None, None),
    "a power": (lambda q: np.abs(q) ** 1.7 + 0.02 * q, None, None),
    "two materials": (lambda q: np.where(q > 0.1, 3 * (q - 0.1) ** 2, (q - 0.1) ** 2 / 2), None, None),
    "quadratic drag": (lambda q: q**2 / 2 + q**4, lambda q, v: 0.3 * np.abs(v) * v, None),
    "drag behind a place": (lambda q: 1 - np.cos(q), lambda q, v: v * np.where(q > 0.2, 0.6, 0.05), None),
    "a limit": (lambda q: 2 * q**2, lambda q, v: np.sign(v) * np.maximum(np.abs(v) - 0.4, 0.0), None),
    "rates of two sides": (lambda q: 1 - np.cos(q) + q**2 / 20, None, lambda q: 1 + 0.5 * np.abs(q)),
}


@pytest.mark.parametrize("name", KINKED)
def test_a_projected_solver_stops_at_kinks(name):
    """Its own estimates pass them by: with status ok 15 times what is allowed at the stiff floor."""
    potential, friction, factor = KINKED[name]

    class Kinked(Moving):
        def potential(self, q):
            return potential(q)

        def reversible(self, z, dE, dS):
            rate = factor(z.q) if factor else 1.0
            return {"q": rate * dE.p, "p": -rate * dE.q}

        def irreversible(self, z, dE, dS):
            return rubbed(friction(z.q, dE.p), dE) if friction else {}

    constants = {"k": 1.0, "at": 0.0, "width": 1.0, "c": 0.0}
    scenario = Scenario("kinked", Kinked, constants, initial={"q": 0.7, "p": 0.3, "s": 0.0}, t_end=5.0, dt=0.05)
    times = np.linspace(0.0, 5.0, 26)
    moved = scenario.replace(initial={"q": 0.7 + 1e-7, "p": 0.3, "s": 0.0})
    exact, beside = (tcbench.simulate("tc_auto", x, tolerance=1e-12, times=times).z for x in (scenario, moved))
    condition = max(1.0, np.abs(beside - exact).max() / 1e-7)
    for tolerance in (1e-4, 1e-9):
        run = tcbench.simulate("projected[method=scipy_dop853]", scenario, tolerance=tolerance, times=times)
        assert run.ok and run.summary.energy_error_max < 1e-11, run.failure
        assert np.abs(run.z - exact).max() < ALLOWED * tolerance * condition, tolerance


@pytest.mark.parametrize("scenario", UNSEEN[:-1], ids=lambda s: f"{s.system.__name__} {s.t_end:g}")
def test_no_size_is_larger_than_what_a_run_moves_a_variable_by(scenario):
    """Where the energy is flat a size was 8192, or that of a clock 4e34: tolerances and moves were measured by it."""
    assert (scenario.model.state_magnitudes <= 2 * max(1.0, scenario.t_end)).all()


@pytest.mark.parametrize(
    ("N", "k", "p", "t_end", "tolerance"),
    [(40, 1.0, 0.8, 20.0, 1e-6), (30, 1.0, 2.0, 9.0, 1e-4), (18, 3.0, 1.0, 12.0, 1e-6)],
)
def test_a_step_that_a_method_halves_by_itself_is_compared_with_others(N, k, p, t_end, tolerance):
    """Both halves of a step were what the whole one had been made of: no gap, and 1e3 tolerances at any tolerance."""
    initial = {"q": 0.3, "p": p, "s": 0.0}
    scenario = unseen(Power, k, t_end=t_end, N=N).replace(initial=initial, dt=t_end / 25)
    times = np.linspace(0.0, t_end, 26)
    beside = scenario.replace(initial=initial | {"q": 0.3 + 1e-7})
    exact, moved = (
        tcbench.simulate("tc_gauss_adaptive", x, tolerance=1e-11, times=times).z for x in (scenario, beside)
    )
    condition = max(1.0, np.abs(moved - exact).max() / 1e-7)
    run = tcbench.simulate("controlled", scenario, tolerance=tolerance, times=times)
    assert run.ok and np.abs(run.z - exact).max() < ALLOWED * tolerance * condition


class Switched(Pulse):
    """The energy jumps with the force, which no method can follow: it would have to be told where it goes."""

    def energy(self, z):
        return z.p**2 / 2 + z.q**2 / 2 - self.k * z.q * np.sign(z.tau - self.at) + z.g + 300.0 * z.s


@pytest.mark.parametrize(("k", "at"), [(0.6, 3.0), (2.0, 7.7)])
def test_an_energy_that_jumps_is_told(k, at):
    """projected moved the state onto the energy of before: 5e3 to 3e8 tolerances, with status ok."""
    for method in ("tc_taylor", "tc_auto", "tc_gauss_adaptive", "controlled", "projected[method=scipy_dop853]"):
        run = tcbench.simulate(method, unseen(Switched, k, at), tolerance=1e-7)
        assert run.status in ("nonconverged", "nonfinite"), method


@pytest.mark.parametrize(
    ("potential", "right", "left"),
    [
        (lambda q: -0.7 * np.abs(q), -0.7, 0.7), (lambda q: 0.3 * np.abs(q), 0.3, -0.3),
        (lambda q: 2 * np.maximum(q, 0.0), 2.0, 0.0), (lambda q: np.minimum(q, 3 * q), 1.0, 3.0),
        (lambda q: np.where(q > 0, q, -2 * q), 1.0, -2.0),
    ],
)  # fmt: skip
def test_a_run_may_begin_exactly_in_a_kink(potential, right, left):
    """The matrix of collocation had the slope of the jump, 1e60, and no step was short enough."""

    class Edge(Moving):
        def potential(self, q):
            return potential(q)

    constants = {"k": 1.0, "at": 0.0, "width": 1.0, "c": 0.0}
    for side, slope in ((1.0, right), (-1.0, left)):
        scenario = Scenario("edge", Edge, constants, initial={"q": 0.0, "p": side, "s": 0.0}, t_end=0.4, dt=0.1)
        place = side * 0.4 - slope * 0.08
        for method in ("tc_taylor", "tc_auto", "tc_gauss_adaptive", "controlled"):
            run = tcbench.simulate(method, scenario, tolerance=1e-6)
            assert run.ok and run.z[-1, 0] == pytest.approx(place, abs=1e-5), (method, run.failure)
        assert tcbench.simulate("tc_gauss", scenario).z[-1, 0] == pytest.approx(place, abs=1e-12)


class Wall(Moving):
    def potential(self, q):
        return self.k * np.exp((q - self.at) / self.width)


@pytest.mark.parametrize(("k", "at", "width"), [(0.1, 21.0, 0.5), (1.0, 9.0, 0.1), (1e-3, 60.0, 0.7)])
def test_a_wall_far_away_gives_a_size_to_what_moves_towards_it(k, at, width):
    """The place was measured by 4e-183: a move to behind the wall, where the energy is 1e203, was scaled down."""
    scenario = unseen(Wall, k, at, width, t_end=1.5 * at)
    assert scenario.model.state_magnitudes.tolist() == [1.0, 1.0, 1.0]
    for method in ("tc_taylor", "tc_auto", "tc_gauss_adaptive"):
        run = tcbench.simulate(method, scenario, tolerance=1e-6)
        assert run.ok and run.z[-1, 1] == pytest.approx(-1.0, abs=1e-4), (method, run.failure)


FORMS = {
    "abs": lambda x, w: np.abs(x) < w, "square": lambda x, w: x**2 < w**2, "both": lambda x, w: (x > -w) & (x < w),
    "fourth": lambda x, w: x**4 < w**4, "gaussian": lambda x, w: np.exp(-((x / w) ** 2)) > np.exp(-1.0),
}  # fmt: skip


def window(form):
    class Window(Moving):
        """A spring whose friction is 0.02, and c in a narrow window."""

        def potential(self, q):
            return q**2 / 2

        def irreversible(self, z, dE, dS):
            return rubbed(np.where(FORMS[form](z.q - self.at, self.width), self.c, 0.02) * dE.p, dE)

    return Window


def passed_through(at, width, c, z, t, t_end):
    """(q, p) at the end, piece by piece between the edges."""

    def edge(k):
        return lambda t, y: y[0] - at - k * width

    edges = edge(-1.0), edge(1.0)
    edges[0].terminal = edges[1].terminal = True
    while t < t_end:
        b = c if abs(z[0] - at) < width else 0.02
        piece = solve_ivp(
            lambda t, y, b=b: [y[1], -y[0] - b * y[1]], (t, t_end), z, "DOP853", rtol=1e-12, atol=1e-13, events=edges
        )
        t, z = piece.t[-1], piece.y[:, -1] + [np.sign(piece.y[1, -1]) * 1e-12, 0.0]  # over the edge
    return z


@pytest.mark.parametrize(
    ("form", "at", "width", "c"),
    [
        ("abs", 0.7, 0.002, 40.0),
        ("square", -0.4, 0.001, 40.0),
        ("both", 0.1, 0.003, 20.0),
        ("fourth", 0.3, 1e-4, 500.0),
        ("gaussian", 0.5, 0.002, 40.0),
    ],
)
def test_no_method_steps_over_a_narrow_window_of_friction(form, at, width, c):
    """Nodes on both sides of a window saw nothing of it: errors of 0.1 with status ok, at every tolerance."""
    scenario = unseen(window(form), at=at, width=width, c=c, t_end=6.0)
    exact = passed_through(at, width, c, np.array([0.0, 1.0]), 0.0, 6.0)
    for method in (*METHODS, "tc_gauss_adaptive", "controlled"):
        for tolerance in (1e-3, 1e-6):
            run = tcbench.simulate(method, scenario, tolerance=tolerance)
            assert run.ok and np.abs(run.z[-1, :2] - exact).max() < ALLOWED * tolerance, (method, tolerance)
