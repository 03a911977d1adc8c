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
