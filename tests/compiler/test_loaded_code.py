# no `from __future__ import annotations`: these annotations are objects, and to be understood as such
"""What compiled code is made of: the functions as they are loaded, with their closures and annotations."""

import types

import numpy as np
import pytest

from tcbench import TcbenchError
from tcbench.compiler import language
from tcbench.compiler.language import Floats, Ints, Matrix
from tcbench.compiler.library import Library
from tcbench.compiler.records import Record, Rows, sized

pytestmark = pytest.mark.skipif(language.PLAIN, reason="nothing is compiled")
n, LIMIT = 7.0, 2.0


class Part(Record):
    size: int
    x: Floats = sized("size")


class Whole(Record):
    count: int
    parts: Rows[Part]
    m: Matrix = sized("count", "2")


def total(x: Floats, m: Matrix, marks: Ints, by: float) -> tuple[float, int]:
    result = 0.0
    for i in range(len(x)):
        result += x[i] * m[i, 1]
    return result * by, marks[0]


def of_records(whole: Whole) -> float:
    return whole.parts[1].x[0] + whole.m[1, 1]


def shift(x: float) -> "float":
    return x + LIMIT


elsewhere = types.ModuleType("elsewhere")
elsewhere.LIMIT = 2.0


def seen_elsewhere(x: float) -> float:
    return x + elsewhere.LIMIT


def times(n):
    def f(x: float) -> float:
        return x * n

    return f


def twice(inner):
    def f(x: float) -> float:
        return inner(inner(x))

    return f


def test_annotations_may_be_objects():
    x, m, marks = np.arange(3.0), np.ones((3, 2)), np.array([5, 6])
    library = Library("objects", total, of_records, shift)
    assert library.total(x, m, marks, 2.0) == total(x, m, marks, 2.0) == (6.0, 5)
    parts = Rows([Part(size=1, x=np.array([value])) for value in (1.0, 2.0)])
    assert library.of_records(Whole(count=2, parts=parts, m=np.ones((2, 2)))) == 3.0
    assert library.shift(1.0) == 3.0


def test_an_annotation_without_a_rank_is_refused():
    def f(x: np.ndarray) -> float:
        return x[0]

    with pytest.raises(TcbenchError, match="an argument is annotated int, float, bool, Floats"):
        Library("unclear", f).f  # noqa: B018


def test_a_closure_reads_the_function_around_it_not_a_global_of_the_same_name():
    assert n == 7.0
    for value in (2.0, 3.0):
        assert Library("closure", times(value)).f(10.0) == 10 * value
    assert Library("closures", twice(times(3.0))).f(1.0) == 9.0  # two functions of one name
    assert Library("closures", twice(twice(times(3.0)))).f(1.0) == 81.0


def test_a_closure_that_is_not_filled_yet_is_refused():
    def f(x: float) -> float:
        return x * later

    with pytest.raises(TcbenchError, match="has no value yet"):
        Library("early", f).f  # noqa: B018
    later = 2.0


def test_code_that_is_in_no_file_is_refused():
    scope: dict = {}
    exec("def f(x: float) -> float:\n    return x + 1.0", scope)
    with pytest.raises(TcbenchError, match=r"f\(\), as it was imported, is not in this file"):
        Library("nowhere", scope["f"]).f  # noqa: B018


@pytest.mark.parametrize("name", ["code", "name"])
def test_a_name_that_a_library_has_itself_is_refused(name):
    def f(x: float) -> float:
        return x

    f.__name__ = name
    with pytest.raises(TcbenchError, match=f"cannot have a function '{name}'"):
        Library("taken", f)
    with pytest.raises(TcbenchError, match="the name is taken"):
        Library("twice", shift, shift)
