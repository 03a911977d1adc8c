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
