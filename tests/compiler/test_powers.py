"""Powers above 1 of what may be 0: their slopes there are 0, in derivatives and in divided differences."""

import numpy as np
import pytest

from tcbench.building_blocks import divided_difference
from tcbench.compiler.chain_rule import discrete_gradient
from tcbench.compiler.derivatives import jacobian, variables
from tcbench.compiler.kernels import kernel
from tcbench.errors import TraceError

ENDS = [(0.0, 0.7), (0.7, 0.0), (1e-40, 2.0), (2.0, 1e-9), (0.3, 0.3 + 1e-12), (1.0, 1.0), (3.0, 0.5)]
POWERS = [1.5, 2.5, 7.5, 1.3, 2 + 1 / 3, 40.5]


@pytest.mark.parametrize("p", POWERS)
def test_slopes_at_zero(p):
    mp = pytest.importorskip("mpmath")
    assert abs(divided_difference(lambda x: x**p, 0.0, 0.0)) < 1e-17
    assert abs(divided_difference(lambda x: abs(x) ** p, 0.0, 0.0)) < 1e-17
    (x, a, d) = inputs = variables("x", 3)
    of_systems = kernel({s: f"a[{i}]" for i, s in enumerate(inputs)}, discrete_gradient(x**p, [x], [a], [d]))
    for a, b in ENDS:
        with mp.workdps(60):
            x, y = mp.mpf(a), mp.mpf(b)
            expected = float((y**p - x**p) / (y - x) if a != b else p * x ** (p - 1))
        assert divided_difference(lambda x: x**p, a, b) == pytest.approx(expected, rel=2e-14)
        assert of_systems(np.array([0.0, a, b - a]), np.zeros(1)) == pytest.approx([expected], rel=4e-14)


@pytest.mark.parametrize("p", POWERS)
def test_derivatives_at_zero(p):
    (x,) = z = variables("x", 1)
    (((slope,),),) = [jacobian([x**p], z)]
    (((even,),),) = [jacobian([abs(x) ** p], z)]
    found = kernel({x: "a[0]"}, [x**p, slope, even])
    assert found(np.zeros(1), np.zeros(1)) == pytest.approx(np.zeros(3), abs=1e-29)
    assert found(np.array([0.3]), np.zeros(1))[:2] == pytest.approx([0.3**p, p * 0.3 ** (p - 1)], rel=1e-14)


@pytest.mark.parametrize("p", [66, 101, -67, 1025, 1026])
@pytest.mark.parametrize("a, b", [(-0.7, 0.4), (0.9, -0.8), (-0.6, -0.9), (0.8, 0.8)])
def test_whole_powers_beyond_what_is_multiplied_out_take_either_sign(p, a, b):
    (x, start, step) = inputs = variables("x", 3)
    of_systems = kernel({s: f"a[{i}]" for i, s in enumerate(inputs)}, discrete_gradient(x**p, [x], [start], [step]))
    expected = (b**p - a**p) / (b - a) if a != b else p * a ** (p - 1)
    assert of_systems(np.array([0.0, a, b - a]), np.zeros(1)) == pytest.approx([expected], rel=1e-12)


@pytest.mark.parametrize(
    "of", [lambda x: x**-12, lambda x: 1 / x**12, lambda x: (3 * x) ** -6, lambda x: 2 / (x * x * x)]
)
@pytest.mark.parametrize("a, b", [(0.9, 0.1), (0.1, 0.9), (0.4, 0.4)])
def test_what_falls_by_many_orders_keeps_the_digits_of_its_discrete_gradient(of, a, b):
    """Repulsion of atoms: as 1 over a power, of which the end is what is left of the start, 9 digits were lost."""
    (x, start, step) = inputs = variables("x", 3)
    found = kernel({s: f"a[{i}]" for i, s in enumerate(inputs)}, discrete_gradient(of(x), [x], [start], [step]))
    slope = (of(b) - of(a)) / (b - a) if a != b else (of(a + 1e-6) - of(a - 1e-6)) / 2e-6
    assert found(np.array([0.0, a, b - a]), np.zeros(1)) == pytest.approx([slope], rel=1e-13 if a != b else 1e-8)


@pytest.mark.parametrize("p", [1.3, 1.5, 1.7, 2.5])
def test_the_flat_side_of_a_kink_has_no_slope_at_all(p):
    """A sign was x times 1/|x|, in one place of nine not quite 1: beside infinite slopes that made 1e147 of 0."""
    (x,) = z = variables("x", 1)
    (((curvature,),),) = [jacobian([p * np.maximum(x - 0.5, 0.0) ** (p - 1) * 0.5 * (1 + np.sign(x - 0.5))], z)]
    found = kernel({x: "a[0]"}, [curvature])
    places = np.random.default_rng(1).uniform(-2.0, 0.5, 300)
    assert all(found(np.array([place]), np.zeros(1))[0] == 0.0 for place in places)


@pytest.mark.parametrize("p", [1.3, 1.5, 2.2, 2.75])
@pytest.mark.parametrize("a, b", [(0.3, -0.7), (-0.7, 0.3), (1 / 3, -0.1), (0.7, -1e-9), (-0.2, -0.1)])
def test_powers_of_a_positive_part_have_their_slopes_across_its_end(p, a, b):
    """That end is 0 up to round-off, of either sign."""
    (x, start, step) = inputs = variables("x", 3)
    f = discrete_gradient(((abs(x) + x) / 2) ** p, [x], [start], [step])
    found = kernel({s: f"a[{i}]" for i, s in enumerate(inputs)}, f)(np.array([0.0, a, b - a]), np.zeros(1))
    assert found == pytest.approx([(max(b, 0.0) ** p - max(a, 0.0) ** p) / (b - a)], rel=1e-12, abs=1e-15)


def test_a_root_written_as_a_power():
    assert divided_difference(lambda x: x**0.5, 0.0, 4.0) == divided_difference(np.sqrt, 0.0, 4.0) == 0.5


def test_magnitudes():
    assert divided_difference(abs, -1.0, 2.0) == divided_difference(np.abs, -1.0, 2.0) == pytest.approx(1 / 3)
    assert divided_difference(lambda x: abs(+x), -3.0, -1.0) == -1.0


BRANCHES = [lambda x: x if x > 0 else -x, lambda x: max(x, 0.0), lambda x: x // 1, round, float, lambda x: x * (x == 0)]


@pytest.mark.parametrize("function", BRANCHES)
def test_what_is_no_arithmetic_is_said(function):
    with pytest.raises(TraceError, match="There are rules for"):
        divided_difference(function, 1.0, 2.0)


STEEP = {
    "sigmoid": lambda x, e, l: 1 / (1 + e(-60 * x)),
    "its quotient": lambda x, e, l: e(60 * x) / (1 + e(60 * x)),
    "softplus": lambda x, e, l: l(1 + e(-60 * x)),
    "log-sum-exp": lambda x, e, l: l(e(-60 * x) + 2 * e(60 * x)),
    "tanh written out": lambda x, e, l: (e(60 * x) - e(-60 * x)) / (e(60 * x) + e(-60 * x)),
    "Bose": lambda x, e, l: x / (e(60 * (x + 1)) - 1),
    "its energy": lambda x, e, l: (2 * e(-40 * x) + 3 * e(-90 * x)) / (1 + e(-40 * x) + e(-90 * x)),
    "a power": lambda x, e, l: (1 + e(40 * x)) ** -2.5,
    "a whole one": lambda x, e, l: (1 + e(40 * x)) ** -3,
    "a root": lambda x, e, l: 1 / (1 + e(70 * x)) ** 0.5,
    "a product": lambda x, e, l: e(50 * x) * e(-45 * x),
    "a pole far away": lambda x, e, l: 1 / (1 + (x + 1) ** 40 * 9.0**40),
    "a base": lambda x, e, l: (1 + e(30 * x)) ** (x - 2),
    "polynomials": lambda x, e, l: (1 + 1e9 * (x + 1) ** 8) / (1 + 1e9 * (x + 1) ** 6),
}


@pytest.mark.parametrize("name", STEEP)
@pytest.mark.parametrize("a, b", [(-0.6, 0.4), (0.4, -0.6), (-0.97, -0.9), (0.2, 0.2 + 1e-9), (0.01, 0.01)])
def test_what_grows_by_many_orders_within_a_quotient_keeps_the_digits_of_its_discrete_gradient(name, a, b):
    """A smooth step 1/(1 + exp(-60 x)): tc_monolithic lost 0.4 of the energy across it, with status ok."""
    mp = pytest.importorskip("mpmath")
    (x, start, step) = inputs = variables("x", 3)
    slope = discrete_gradient(STEEP[name](x, np.exp, np.log), [x], [start], [step])
    by = jacobian(slope, [start, step])[0]
    found = kernel({s: f"a[{i}]" for i, s in enumerate(inputs)}, [*slope, *by])(np.array([0.0, a, b - a]), np.zeros(1))
    with mp.workdps(150):
        p, d, h = mp.mpf(a), mp.mpf(b - a) if a != b else mp.mpf(10) ** -60, mp.mpf(10) ** -75

        def exact(p, d):
            return (STEEP[name](p + d, mp.exp, mp.log) - STEEP[name](p, mp.exp, mp.log)) / d

        slopes = [
            exact(p, d),
            (exact(p + h, d) - exact(p - h, d)) / (2 * h),
            (exact(p, d + h) - exact(p, d - h)) / (2 * h),
        ]
    assert found[0] == pytest.approx(float(slopes[0]), rel=1e-12, abs=1e-13)
    of_numbers = divided_difference(lambda x: STEEP[name](x, np.exp, np.log), a, a + float(b - a))
    assert of_numbers == pytest.approx(float(slopes[0]), rel=1e-12, abs=1e-13)
    if a != b:
        assert found[1:] == pytest.approx([*map(float, slopes[1:])], rel=1e-8, abs=1e-8)
