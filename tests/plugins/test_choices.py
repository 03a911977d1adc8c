"""np.where, np.maximum and their like on single numbers, as on arrays: every method takes and sees them."""

import numpy as np
import pytest
from mechanics import Mechanical
from scipy.integrate import solve_ivp

import tcbench
from tcbench import Scenario, TcbenchError
from tcbench.building_blocks import divided_difference, divided_differences
from tcbench.systems.pendulum import Pendulum

CHOICES = {
    "maximum, minimum": lambda q: q**2 + 3 * np.maximum(q - 0.3, 0.0) ** 2 - 0.3 * np.minimum(q + 0.4, 0.0) ** 3,
    "of two forces": lambda q: np.maximum(q**2 / 2, 2 * (q - 0.2) ** 2 - 0.1),
    "where, clip": lambda q: np.where(q > 0.1, 2 * (q - 0.1) ** 2, (q - 0.1) ** 2 / 2) + np.clip(q, -0.25, 0.5) ** 3,
    "where not, sign": lambda q: np.where(~(q < -0.2), 0.0, (q + 0.2) ** 4) + q**2 * (1.5 + np.sign(q)),
    "where both, where one": lambda q: (
        q**2 / 2
        + np.where((q > 0) & (q <= 0.5), q**2 * (q - 0.5) ** 2 * 9, 0.0)
        + np.where((q >= 0.7) | (q < 0.2), (q - 0.7) ** 2 * (q - 0.2) ** 2, 0.0)
    ),
    "a factor": lambda q: q**2 / 2 + (q > 0.4) * (q - 0.4) ** 2,
}


def moved(potential, t, start=(0.9, 0.2)):
    """(q, p) at t by forces that are differences of the potential of plain numbers."""

    def rate(t, z):
        return z[1], -float(potential(z[0] + 1e-6) - potential(z[0] - 1e-6)) / 2e-6

    return solve_ivp(rate, (0.0, t), start, "DOP853", max_step=2e-3, rtol=1e-10, atol=1e-10).y[:, -1]


@pytest.mark.parametrize("choice", CHOICES)
def test_choices_on_numbers_are_followed_from_one_side_to_the_other(choice):
    potential = CHOICES[choice]

    class Chosen(Mechanical):
        name = "chosen"

        def energy(self, z):
            return z.p**2 / 2 + potential(z.q) + 300.0 * z.s

    scenario = Scenario("chosen", Chosen, {}, initial={"q": 0.9, "p": 0.2, "s": 0.0}, t_end=4.0, dt=0.05)
    exact = moved(potential, 4.0)
    for method in ("tc_taylor", "tc_auto", "tc_gauss_adaptive", "controlled", "scipy_dop853"):
        run = tcbench.simulate(method, scenario, tolerance=1e-6)
        allowed = 1e-3 if method == "scipy_dop853" else 3e-5  # which locates no kinks
        assert run.ok and np.abs(run.z[-1, :2] - exact).max() < allowed, (method, run.failure)
    for method in ("tc_monolithic", "tc_gonzalez", "tc_itoh_abe"):
        run = tcbench.simulate(method, scenario)
        assert run.ok and run.summary.energy_error_max < 1e-12, (method, run.failure)


class Stop(Pendulum):
    """Springs with a harder one behind a length."""

    name = "stop"

    def element_energy(self, pi, s):
        return super().element_energy(pi, s) + 3 * np.maximum(pi - 1.03, 0.0) ** 2


def test_energies_of_elements_may_choose():
    given = tcbench.scenarios()["short_term"]
    scenario = Scenario(
        "stop", Stop, given.constants, positions=given.positions, momenta=given.momenta,
        temperatures=given.temperatures, t_end=2.0, dt=0.1,
    )  # fmt: skip
    ends = [
        tcbench.simulate(m, scenario, tolerance=1e-7).z[-1] for m in ("tc_taylor", "tc_gauss_adaptive", "scipy_dop853")
    ]
    assert np.abs(ends[0] - ends[1]).max() < 1e-6 and np.abs(ends[0] - ends[2]).max() < 1e-4
    for method in ("tc_monolithic", "tc_strang", "tc_staggered"):
        assert tcbench.simulate(method, scenario).summary.energy_error_max < 1e-12


TURNS = [
    ((0.3, -1.0), (1e-9, 2e-9)),
    ((1e-9, -1.0), (1e-9, -0.5)),
    ((1.0, 1.0), (-0.5, -3.0)),
    ((2.0, 0.1), (-1.0, 7.0)),
]


@pytest.mark.parametrize(("start", "step"), TURNS)
def test_the_divided_difference_of_an_angle_has_all_its_digits(start, step):
    (y, x), (dy, dx) = start, step
    by_y, by_x = divided_differences(np.arctan2, start, (y + dy, x + dx))
    turned = np.arctan2(x * dy - y * dx, x * (x + dx) + y * (y + dy))
    assert by_y * dy + by_x * dx == pytest.approx(turned, rel=1e-7 if abs(dy) < 1e-8 else 1e-13)
    if max(map(abs, step)) < 1e-8:
        assert (by_y, by_x) == pytest.approx((x / (x * x + y * y), -y / (x * x + y * y)), rel=1e-8)


def test_an_energy_of_angles_is_kept_also_across_the_cut():
    class Turning(Mechanical):
        name = "turning"
        variables = {"q": (2,), "p": (2,), "s": ()}

        def energy(self, z):
            x, y = z.q
            return (z.p @ z.p + (np.hypot(x, y) - 1) ** 2) / 2 + np.cos(3 * np.arctan2(y, x)) + 300.0 * z.s

    initial = {"q": [-1.0, 0.1], "p": [0.1, -2.0], "s": 0.0}
    scenario = Scenario("turning", Turning, {}, initial=initial, t_end=8.0, dt=0.1)
    for method in ("tc_monolithic", "tc_gonzalez", "tc_itoh_abe"):
        run = tcbench.simulate(method, scenario)
        assert run.ok and (run.z[:, 1] < 0).any() and run.summary.energy_error_max < 1e-12, method


@pytest.mark.parametrize(("a", "b"), [(-1.0, 1.0), (0.2, 0.5), (0.35, 0.35 + 1e-9), (0.5, 0.2), (0.05, 0.2)])
def test_the_divided_difference_of_a_choice_is_that_of_its_values(a, b):
    def f(x):
        squares = np.where(x > 0.3, (x - 0.3) ** 2, 0.0) + np.maximum(x, 0.1) ** 2
        return squares - np.clip(x, -0.2, 0.4) + np.sign(x) * x**2

    assert divided_difference(f, a, b) == pytest.approx((f(b) - f(a)) / (b - a), rel=1e-13 if b - a > 1e-3 else 1e-6)


@pytest.mark.parametrize(
    ("formula", "told"),
    [(lambda q: max(q, 0.0), "a branch"), (lambda q: q if q > 0 else -q, "a branch"),
     (lambda q: np.where(q == 0, q, 1.0), "whether they are equal")],
)  # fmt: skip
def test_what_is_no_formula_is_still_refused_at_its_line(formula, told):
    class Branching(Mechanical):
        name = "branching"

        def energy(self, z):
            return z.p**2 / 2 + formula(z.q) + 300.0 * z.s

    scenario = Scenario("branching", Branching, {}, initial={"q": 0.9, "p": 0.2, "s": 0.0}, t_end=1.0, dt=0.1)
    with pytest.raises(TcbenchError, match=rf"test_choices.py, line \d+: .*{told}"):
        tcbench.simulate("tc_monolithic", scenario)


@pytest.mark.parametrize("p", [1.3, 1.5, 1.7, 2.2, 2.5, 3.5])
def test_walls_of_any_power_are_met_from_their_flat_side(p):
    """Of a slope that was 1e-17 for 0 beside an infinite one a Jacobian had 1e147: tc_gauss and controlled stood still,
    with status ok; tc_taylor ended at the start, where the base of a power is 0."""

    class Walls(Mechanical):
        name = "walls"
        constants = {"a": ()}  # terms that cancel are symbols

        def energy(self, z):
            return z.p**2 / 2 + np.maximum(z.q - self.a, 0.0) ** p + np.maximum(-z.q - 0.4, 0.0) ** 1.7 + 300.0 * z.s

    scenario = Scenario("walls", Walls, {"a": 0.5}, initial={"q": 0.0, "p": 1.0, "s": 0.0}, t_end=4.0, dt=0.05)
    exact = tcbench.simulate("scipy_dop853", scenario, tolerance=1e-11).z[-1]
    for method in ("tc_taylor", "tc_auto", "tc_gauss_adaptive", "controlled"):
        run = tcbench.simulate(method, scenario, tolerance=1e-6)
        assert run.ok and np.abs(run.z[-1] - exact).max() < 2e-5, (method, run.failure)
    step = tcbench.stepper("tc_gauss", scenario)
    states = [scenario.z0]
    for _ in range(40):
        states.append(step(states[-1], 0.01))
    assert states[-1][0] == pytest.approx(0.4, rel=1e-12)


@pytest.mark.parametrize("condition", [
    lambda q, c: q, lambda q, c: np.sin(q), lambda q, c: q - 0.3, lambda q, c: np.logical_and(q, q > 0),
    lambda q, c: np.logical_or(q > 0, q), lambda q, c: ~q, lambda q, c: (q > 0) + (q > 1), lambda q, c: c,
    lambda q, c: 1 - (q > 0) * q, lambda q, c: np.maximum(q, 0.0),
])  # fmt: skip
def test_a_number_is_no_condition(condition):
    """np.where(q, a, b) was q (a - b) + b, where numpy asks whether q is 0."""

    class Asked(Mechanical):
        name = "asked"
        constants = {"c": ()}

        def energy(self, z):
            return z.p**2 / 2 + np.where(condition(z.q, self.c), z.q**2, 1.0) + z.s

    with pytest.raises(TcbenchError, match=r"a condition is a number. Write a comparison"):
        Asked(c=2.0).gradient(np.zeros(3))


@pytest.mark.parametrize("condition", [
    lambda q: q > 0, lambda q: ~(q > 0), lambda q: (q > 0) * (q < 1), lambda q: (q > 0) & ~((q > 2) | (q < 1)),
    lambda q: np.logical_not(np.logical_or(q > 0.5, -q > 0.5)), lambda q: 2, lambda q: np.array(3.0), lambda q: True,
    lambda q: np.bool_(False), lambda q: 0.0, lambda q: (q > 0) & True,
])  # fmt: skip
def test_comparisons_joined_are_conditions(condition):
    class Asked(Mechanical):
        name = "asked"

        def energy(self, z):
            return z.p**2 / 2 + np.where(condition(z.q), z.q**2, 1.0 - z.q) + z.s

    system = Asked()
    for q in (-0.7, 0.3, 0.8, 1.4, 2.5):
        slope = 2 * q if condition(np.float64(q)) else -1.0
        assert system.gradient(np.array([q, 0.0, 0.0]))[0] == pytest.approx(slope), q


@pytest.mark.parametrize("n", [1.5, 2.5, 3.0, 4.0])
@pytest.mark.parametrize("base", [
    lambda q: abs(q), lambda q: np.maximum(q, 0), lambda q: abs(abs(q) + q) / 2, lambda q: 2 * np.sqrt(q**2),
    lambda q: np.hypot(q, q), lambda q: np.maximum(q, 0) + abs(q) * 0.1,
])  # fmt: skip
def test_a_power_with_a_constant_of_the_system_as_exponent_passes_zero(base, n):
    """Hertz's contact with the exponent among the constants: the logarithm of 0 left a step without a root."""

    class Contact(Mechanical):
        name = "contact"
        constants = {"n": ()}

        def energy(self, z):
            return z.p**2 / 2 + base(z.q) ** self.n + z.q**2 / 9 + z.s

    for q in (0.0, 0.5):
        scenario = Scenario("contact", Contact, {"n": n}, initial={"q": q, "p": 1.0, "s": 0.0}, t_end=3.0, dt=0.02)
        exact = moved(lambda x: base(np.float64(x)) ** n + x**2 / 9, 3.0, (q, 1.0))
        for method in ("tc_monolithic", "tc_strang"):
            run = tcbench.simulate(method, scenario)
            assert run.ok and run.summary.energy_error_max < 1e-12, (method, q, run.failure)
            assert np.abs(run.z[-1, :2] - exact).max() < 0.02, (method, q)
