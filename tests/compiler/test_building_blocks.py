"""The public building blocks: exact identities at any increment, on numbers, arrays and symbols."""

import numpy as np
import pytest

import tcbench
from tcbench import Integrator
from tcbench.building_blocks import directional, divided_difference, divided_differences, log1p_ratio, phi
from tcbench.errors import TraceError

STEPS = [0.0, 1e-300, 1e-12, -1e-8, 1e-3, 0.7, -0.4]


@pytest.mark.parametrize("d", STEPS)
def test_quotients_keep_their_digits(d):
    mp = pytest.importorskip("mpmath")
    with mp.workdps(700):
        x = mp.mpf(d)
        expected = (mp.expm1(x) / x, mp.log1p(x) / x) if d else (mp.mpf(1), mp.mpf(1))
        a, b = mp.mpf(2.5), mp.mpf(2.5) + x  # the increment is that of doubles, b - a
        b = mp.mpf(2.5 + d)
        log = (mp.log(b) - mp.log(a)) / (b - a) if b != a else 1 / a
    assert phi(d) == pytest.approx(float(expected[0]), rel=4e-16)
    assert log1p_ratio(d) == pytest.approx(float(expected[1]), rel=4e-16)
    assert divided_difference(np.log, 2.5, 2.5 + d) == pytest.approx(float(log), rel=1e-15)


def test_arrays_are_taken_entry_by_entry():
    assert np.array_equal(phi([[0.0, 1.0]]), [[1.0, phi(1.0)]])
    found = divided_difference(lambda x: x**3, np.array([1.0, 2.0]), np.array([1.0, 3.0]))
    assert np.allclose(found, [3.0, 19.0], rtol=1e-15)
    assert divided_difference(lambda x: x * x, 1, np.array([1.0, 2.0])).shape == (2,)


def test_two_slopes_add_up_to_the_difference():
    def f(x, y):
        return x * np.exp(y / 3) + np.sqrt(x) * y

    rng = np.random.default_rng(1)
    for size in (1.0, 1e-6, 0.0):
        (x0, y0), (dx, dy) = rng.uniform(1, 2, 2), size * rng.uniform(-0.5, 0.5, 2)
        first, second = divided_differences(f, (x0, y0), (x0 + dx, y0 + dy))
        exact = f(x0 + dx, y0 + dy) - f(x0, y0)
        assert abs(first * dx + second * dy - exact) < 1e-15 * max(1, abs(exact)) * 4
    slopes = divided_differences(f, (1.5, 0.3), (1.5, 0.3))
    gradient = (np.exp(0.1) + 0.3 / (2 * np.sqrt(1.5)), 0.5 * np.exp(0.1) + np.sqrt(1.5))
    assert np.allclose(slopes, gradient, rtol=1e-15)


def test_what_has_no_rule_is_named():
    with pytest.raises(
        TraceError, match=r"test_building_blocks.py, line \d+: 'arcsinh' has no divided-difference rule"
    ):
        divided_difference(lambda x: np.arcsinh(x), 1.0, 2.0)


def own_gradient(z0, z1, h, system):
    """A discrete gradient made of the building blocks: logarithmic springs, as the pendulum has them."""
    pi0, pi1 = system.shapes(z0), system.shapes(z1)
    stress, theta = divided_differences(system.element_energy, (pi0, z0.s), (pi1, z1.s))
    q = (z0.q + z1.q) / 2
    by_q = stress @ system.shape_gradient(q)
    p = (z0.p + z1.p) / 2
    return np.concatenate(
        [z1.q - z0.q - h * p / system.inertia(), z1.p - z0.p + h * by_q, z1.s - z0.s - h * system.conduction(theta)]
    )


def test_a_method_made_of_them_is_the_papers():
    """And it starts where nothing moves: Newton's first point is z1 = z0."""
    method = Integrator(name="own", order=2, flows=own_gradient)
    own = tcbench.simulate(method, "short_term", dt=0.3)
    theirs = tcbench.simulate("tc_monolithic", "short_term", dt=0.3)
    assert own.ok and np.abs(own.z - theirs.z).max() < 1e-9
    assert own.summary.energy_error_max < 1e-12 * max(1, abs(own.energy[0]))
    large = tcbench.simulate(method, "net[nx=4,ny=4]", dt=0.1, t_end=0.5)  # on arrays
    assert large.ok and large.summary.energy_error_max < 1e-12


def test_a_function_of_arrays_is_of_each_entry_alone():
    system = tcbench.scenarios()["short_term"].model  # its constants are one of each element
    (x0, y0), (x1, y1) = (np.array([1.0, 2.0]), np.array([0.1, 0.2])), (np.array([1.5, 2.0]), np.array([0.1, 0.4]))
    first, second = divided_differences(system.element_energy, (x0, y0), (x1, y1))
    gone = system.element_energy(x1, y1) - system.element_energy(x0, y0)
    assert np.allclose(first * (x1 - x0) + second * (y1 - y0), gone, rtol=1e-14)
    for function, told in (
        (lambda x, y: y * x.sum(), "mixes entries"),
        (lambda x, y: x[:1] * y[:1], r"shape \(1,\) of shape \(2,\)"),
        (lambda x, y: x[0] * np.ones(2), "cannot take it"),
    ):
        with pytest.raises(TraceError, match=told):
            divided_differences(function, (x0, y0), (x1, y1))


def test_gonzalez_of_the_whole_state_keeps_the_energy_and_stands_still_where_nothing_moves():
    """On a state of several units, as one formula: the quotient is 0/0 for what rests, and is the gradient there."""
    gradient, step, exact = np.array([1.0, -2.0, 0.5]), np.array([0.3, 0.0, -0.1]), np.array([1.5, 9.0, 0.25])
    weights = np.array([1.0, 4.0, 0.01])
    found = directional(gradient, step, exact, weights)
    assert found @ step == pytest.approx(exact @ step, rel=1e-14) and found[1] == gradient[1]
    assert np.array_equal(directional(gradient, 0 * step, exact), gradient)

    def whole(z0, z1, h, system):
        middle = (z0 + z1) / 2
        DE = directional(system.gradient(middle), z1 - z0, system.discrete_gradient(z0, z1))
        DS = system.entropy_gradient(z0)
        return z1 - z0 - h * (system.reversible(middle, DE, DS) + system.irreversible(middle, DE, DS))

    method = tcbench.Integrator(name="gonzalez_whole", order=2, flows=whole)
    run = tcbench.simulate(method, "short_term", dt=0.1, t_end=5)
    assert run.ok and abs(run.energy - run.energy[0]).max() < 1e-10 * run.scenario.initial_exergy
