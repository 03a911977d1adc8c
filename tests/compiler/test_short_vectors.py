"""Short vectors in kernels: compiled as in plain Python, and refused with a sentence where a text makes no sense."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tcbench.compiler.kernels import Kernel, namespace
from tcbench.compiler.values import TranslationError

TEXT = """def kernel(a, b, out):
    x = row(a, 0, 3)
    y = vector(a[3], 2.0, a[4])
    z = pick(x, y, 5, 0, 1, 4)
    w = -(x * y + 2.0) / (3.0 - y * a[5])
    put(out, 0, w - x)
    put(out, 3, z * vector(1.0, -1.0, 0.5, 0.0))
    out[7] = w[2] + z[0]
    out[8] = max(abs(w[0]), x[1])
    v = vector(exp(x[0]), sqrt(abs(x[1]))) * 0.25
    put(out, 9, v)
"""


def in_python(text: str, a: np.ndarray, size: int) -> np.ndarray:
    scope, out = dict(namespace()), np.empty(size)
    exec(text, scope)
    scope["kernel"](a, a, out)
    return out


@given(st.lists(st.floats(0.1, 2.0), min_size=6, max_size=6))
def test_compiled_vectors_are_those_of_plain_python(numbers):
    a = np.array(numbers) * [1, -1, 1, 1, -1, 0.2]
    assert np.allclose(Kernel(TEXT, 11)(a, a), in_python(TEXT, a, 11), rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize(
    "line, why",
    [
        ("x = row(a, 0, 3) + row(a, 0, 2)", "have no common kind"),
        ("x = row(a, 0, 3) % 2.0", "of vectors"),
        ("x = row(a, 0, a[0])", "length of a vector"),
        ("x = pick(row(a, 0, 2), row(a, 0, 2), 4)", "takes two vectors"),
        ("x = pick(row(a, 0, 2), row(a, 0, 3), 0)", "takes two vectors"),
        ("put(out, 0, a[0])", "where a vector is needed"),
        ("x = a[0]\n    y = row(x, 0, 2)", "no row of numbers"),
        ("x = row(a, 0, 2)\n    y = x[2]", "no such lane"),
        ("x = row(a, 0, 2)\n    out[0] = x", "a vector stands where"),
    ],
)
def test_what_makes_no_sense_is_refused(line, why):
    with pytest.raises(TranslationError, match=why):
        Kernel(f"def kernel(a, b, out):\n    {line}\n", 1)(np.ones(4), np.ones(4))


EDGES = np.array(
    [0.0, -0.0, 1.0, -1.0, 0.5, 1e-310, 5e-324, 1e300, 709.7, 709.8, -708.3, -740.0, np.inf, -np.inf, np.nan, 2.0]
)


@pytest.mark.parametrize("width", [2, 3, 4])
@pytest.mark.parametrize("name", ["exp", "log", "sqrt", "abs", "sin", "tanh", "expm1"])
def test_functions_of_vectors_are_those_of_their_lanes(name, width):
    """To an ulp or two, at the limits of numbers, too; exp is 0 where it would be below the smallest normal number."""
    text = f"def kernel(a, b, out):\n    put(out, 0, {name}(row(a, 0, {width})))\n"
    of_vector, function = Kernel(text, width), getattr(np, name)
    random = np.random.default_rng(1).uniform(-700.0, 700.0, 60)
    for start in range(0, 60, width):
        for x in (np.roll(EDGES, start)[:width], random[start : start + width], np.exp(random[start : start + width])):
            x = np.resize(x, width)
            with np.errstate(all="ignore"):
                expected = function(x)
            found = of_vector(x, x)
            tiny = 2.3e-308 if name == "exp" else 0.0
            assert np.allclose(found, expected, rtol=1e-15, atol=tiny, equal_nan=True), (x, found, expected)
            assert np.allclose(in_python(text, x, width), expected, rtol=1e-15, atol=tiny, equal_nan=True)


def test_a_function_of_a_vector_and_a_number_takes_the_number_in_every_lane():
    text = "def kernel(a, b, out):\n    put(out, 0, pow(row(a, 0, 2), 3.0))\n"
    assert np.allclose(Kernel(text, 2)(np.array([2.0, 3.0]), np.ones(1)), [8.0, 27.0])
