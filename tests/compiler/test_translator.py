"""The restricted Python: compiled functions against the same text run by Python, and what is refused."""

from __future__ import annotations

import importlib.util
import math
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tcbench.compiler import language, library
from tcbench.compiler.language import (
    Cube,
    Floats,
    Ints,
    Matrix,
    ShortFloats,
    ShortInts,
    bits,
    copy_into,
    fill,
    from_bits,
    late,
)
from tcbench.compiler.library import Library
from tcbench.compiler.records import Record, Rows, sized
from tcbench.compiler.translator import Module
from tcbench.compiler.values import TranslationError

pytestmark = pytest.mark.skipif(language.PLAIN, reason="everything is plain")
SCALE, LIMIT = 2.5, 3
DOUBLED = 2**52  # in bits


class Tally(Record, mutable=True):
    count: int
    total: float
    seen: bool


class Part(Record):
    n: int
    weight: float
    wanted: bool
    x: Floats = sized("n")
    grid: Matrix = sized("n", "n + LIMIT")


class Whole(Record):
    parts: Rows[Part]
    n_parts: int
    tally: Tally
    marks: Ints = sized("n_parts")


def whole_numbers(a: int, b: int) -> tuple[int, int, int, float, bool]:
    return a // b, a % b, abs(a - b) * -b, a / b, a < b


def float_arithmetic(x: float, y: float) -> tuple[float, float, float, float, float]:
    top = max(x, y, SCALE)
    return x % y, top, min(x, -y), (x - y) ** 2 + abs(x) ** 0.5, math.exp(-abs(x)) + math.sqrt(y * y) * np.inf


def logic(x: float, y: float, flag: bool) -> tuple[bool, bool, bool, int, float]:
    a = x < y and not flag
    b = x > 1.0 or y > 1.0 or (flag and x == y)
    n = 2 if a else 1 if b else 0
    return a, b, n in (0, 2), n, x if n not in (1, 2) else n


def ways_out(n: int, stop: int) -> tuple[int, int, int]:
    total, rounds, left = 0, 0, n
    for i in range(n, -1, -1):
        if i == stop:
            break
        if i % 2 == 0:
            continue
        total += i
    while True:
        rounds += 1
        if left <= 0 or rounds > 40:
            break
        left -= rounds
    while left < 0:
        left += 3
    for i in range(1, n, 2):
        for j in range(i):
            total += i * j
    return total, rounds, left


def arrays(x: Floats, m: Matrix, c: Cube, marks: Ints) -> float:
    fill(x[1:3], SCALE)
    copy_into(m[0], x)
    fill(x[-2:-1], LIMIT * 1.5)
    for i in range(len(m)):
        for j in range(len(m[i])):
            m[i, j] += c[i, 0, j] * i
            m[i, j], c[i, 1, j] = c[i, 1, j], m[i, j]
    x[-1] = first = 7.0
    marks[0] += 2
    swapped, other = m[0], m[1]
    swapped, other = other, swapped
    return swapped[2] + len(x) * first + other[-1] * marks[0]


def records(whole: Whole, by: float) -> float:
    tally, last = whole.tally, 0.0
    for k in range(whole.n_parts):
        part = whole.parts[k]
        if not part.wanted:
            continue
        for i in range(part.n):
            part.x[i] += by * part.weight
            part.grid[i, i + LIMIT - 1] = part.x[i] * len(part.grid[0])
            tally.total += part.x[i]
        tally.count += 1
        tally.seen = tally.seen or by > 1.0
        whole.marks[k] = tally.count
        last = part.grid[0, LIMIT - 1]
    return last


class Short(Record):
    n: int
    where: ShortInts = sized("n")
    factors: ShortFloats = sized("n")
    behind: Floats = sized("n")


def short_numbers(short: Short, where: ShortInts, factors: ShortFloats) -> tuple[int, float]:
    total, last = 0.0, 0
    for i in range(len(where)):
        last = int(where[len(where) - 1 - i]) * DOUBLED // DOUBLED
        short.factors[last] += factors[i] / 3.0
        short.where[i] -= last + short.n
        short.behind[i], total = short.factors[i], total + short.factors[last] * short.where[i]
    return last, total


def parts_of_numbers(x: float, exponent: int) -> tuple[int, float, float]:
    return bits(x), from_bits(bits(x)), from_bits((exponent + 1023) * DOUBLED)


LIBRARY = Library(
    "tests of the translator",
    parts_of_numbers,
    whole_numbers,
    float_arithmetic,
    logic,
    ways_out,
    arrays,
    records,
    short_numbers,
)
NUMBERS = st.integers(-50, 50)
FLOATS = st.one_of(st.floats(-1e3, 1e3), st.sampled_from([0.0, -0.0, math.inf, -math.inf, math.nan, 1.0]))


def agree(found, expected):
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_allclose(float(a), float(b), rtol=1e-13)


@given(NUMBERS, NUMBERS.filter(bool))
def test_whole_numbers_are_python_s_also_where_they_are_negative(a, b):
    found = LIBRARY.whole_numbers(a, b)
    assert found == whole_numbers(a, b) and [type(x) for x in found] == [int, int, int, float, int]


@given(FLOATS, FLOATS.filter(bool))
def test_floats_are_numpy_s(x, y):
    with np.errstate(all="ignore"):
        agree(LIBRARY.float_arithmetic(x, y), float_arithmetic(np.float64(x), np.float64(y)))


@given(st.floats(5e-324, math.inf, allow_nan=False), st.integers(-1022, 1023))
def test_bits_of_numbers(x, exponent):
    found = LIBRARY.parts_of_numbers(x, exponent)
    assert found == parts_of_numbers(x, exponent) and found[1] == x and found[2] == 2.0**exponent


@given(FLOATS, FLOATS, st.booleans())
def test_logic_is_python_s_also_of_nan(x, y, flag):
    agree(LIBRARY.logic(x, y, flag), logic(x, y, flag))


@given(st.integers(-2, 15), st.integers(-2, 15))
def test_loops_and_their_ways_out(n, stop):
    assert LIBRARY.ways_out(n, stop) == ways_out(n, stop)


def test_arrays_and_their_parts():
    rng = np.random.default_rng(1)
    both = []
    for function in (LIBRARY.arrays, arrays):
        rng = np.random.default_rng(1)
        given_ = rng.normal(size=4), rng.normal(size=(3, 4)), rng.normal(size=(3, 2, 4)), np.arange(2)
        both.append((function(*given_), *given_))
    for found, expected in zip(*both, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-13)
    with pytest.raises(TypeError, match="contiguous array of float64 with 2 axes"):
        LIBRARY.arrays(np.ones(4), np.ones((3, 4)).T, np.ones((3, 2, 4)), np.arange(2))


def test_records_are_read_and_written_as_in_python():
    both = []
    for function in (LIBRARY.records, records):
        parts = [Part(n=n, weight=0.5 * n, wanted=n != 2, x=np.arange(float(n))) for n in (3, 2, 1)]
        whole = Whole(parts=Rows(parts), n_parts=3, tally=Tally(total=1.0), marks=np.zeros(3, dtype=np.int64))
        last = function(whole, 1.25)
        tally = whole.tally
        both.append([last, tally.count, tally.total, tally.seen, *whole.marks])
        both[-1] += [x for part in parts for x in (*part.x, *part.grid.ravel())]
    agree(*both)
    assert both[0][1] == 2 and both[0][4:7] == [1, 0, 2]


def test_numbers_of_32_bits_are_widened_where_they_are_read():
    both = []
    for function in (LIBRARY.short_numbers, short_numbers):
        short, given_ = Short(n=3), (np.array([2, 0, 1], np.int32), np.array([1.5, -7.0, 1e30], np.float32))
        both.append([*function(short, *given_), *short.where, *short.factors, *short.behind])
    np.testing.assert_allclose(*both, rtol=1e-6)
    short.behind[:] = 7.0
    assert (short.where.dtype, short.factors.dtype) == (np.int32, np.float32) and short.where.tolist() == [-4, -3, -5]
    with pytest.raises(TypeError, match="contiguous array of int32 with 1 axes"):
        LIBRARY.short_numbers(short, np.arange(3), np.zeros(3, np.float32))
    with pytest.raises(TypeError, match="contiguous array of ShortInts"):
        Short(n=3, where=np.arange(3))


def test_records_say_what_does_not_fit():
    with pytest.raises(TypeError, match=r"x has shape \(2,\), declared is \(3,\)"):
        Part(n=3, weight=1.0, wanted=True, x=np.zeros(2))
    with pytest.raises(TypeError, match="contiguous array of Floats"):
        Part(n=3, weight=1.0, wanted=True, x=np.zeros(3, dtype=np.float32))
    with pytest.raises(AttributeError, match="is given when the record is made"):
        Part(n=3, weight=1.0, wanted=True).x = np.zeros(3)
    with pytest.raises(TypeError, match="has no field 'y'"):
        Part(n=3, weight=1.0, wanted=True, y=1.0)
    with pytest.raises(TypeError, match="something else of that name"):
        type("Bad", (Record,), {"__annotations__": {"address": "int"}, "__module__": __name__})
    with pytest.raises(TypeError, match="needs sized"):
        type("Bad", (Record,), {"__annotations__": {"x": "Floats"}, "__module__": __name__})


INT, G = "def f(n: int) -> int:\n", "def g(n: int) -> int:\n    return n\n\n"
REFUSED = {
    "unset": (INT + "    if n > 0:\n        a = 1\n    return a\n", "'a' is not set on every way"),
    "unset by a loop": (INT + "    for i in range(n):\n        a = i\n    return a\n", "'a' is not set"),
    "unset loop variable": (INT + "    for i in range(n):\n        pass\n    return i\n", "'i' is not set"),
    "end": (INT + "    if n > 0:\n        return 1\n", "run off its end"),
    "end of a loop": (INT + "    while n > 0:\n        return 1\n", "run off its end"),
    "recursion": (INT + "    return f(n - 1)\n", "calls itself"),
    "circle": ("def g(n: int) -> int:\n    return f(n)\n\ndef f(n: int) -> int:\n    return g(n)\n", "calls itself"),
    "kind": ("def f(n: int) -> float:\n    a = n\n    a = 0.5\n    return a\n", "'a' is an int above and a float here"),
    "argument": ("def f(n) -> int:\n    return 1\n", "an argument is annotated"),
    "result": ("def f(n: int):\n    return 1\n", "annotated with what it returns"),
    "results": ("def f(n: int) -> tuple[int, int]:\n    return n, n, n\n", "2 results are annotated"),
    "truth": (INT + "    return 1 if n else 2\n", "a bool is needed: compare it"),
    "chain": ("def f(n: int) -> bool:\n    return 0 < n < 3\n", "a chain of comparisons"),
    "list": (INT + "    return [n][0]\n", "not translated"),
    "comprehension": (INT + "    return sum(i for i in range(n))\n", "is not translated"),
    "unknown name": (INT + "    return n + m\n", "'m' is not known"),
    "unknown function": ("def f(n: int) -> float:\n    return print(n)\n", "'print' is not translated"),
    "never": (INT + "    return 1\n    n = 2\n", "never reached"),
    "with": (INT + "    try:\n        return 1\n    finally:\n        n = 2\n", "this kind of statement"),
    "arrays": ("def f(x: Floats) -> int:\n    x += 1.0\n    return 1\n", "arithmetic of whole arrays"),
    "indices": ("def f(x: Floats) -> float:\n    return x[0, 1]\n", "has no 2 indices"),
    "index from the end": ("def f(x: Floats, i: int) -> float:\n    return x[-1 - i]\n", "counts from the end"),
    "negated index": ("def f(x: Floats, i: int) -> float:\n    return x[-i]\n", "counts from the end"),
    "slice from the end": ("def f(x: Floats, i: int) -> int:\n    return len(x[: -i + 2])\n", "from the end"),
    "step": (INT + "    for i in range(0, 9, n):\n        n += i\n    return n\n", "must be a constant"),
    "shifts": (INT + "    return n << 2\n", "this operation is not translated"),
    "float floor": ("def f(x: float) -> float:\n    return x // 2.0\n", "this operation is not translated"),
    "narrowing": (G + "def f(x: float) -> int:\n    return g(x)\n", "a float stands where an int"),
    "count": (G + INT + "    return g(n, n)\n", "g\\(\\) takes n"),
    "else": (INT + "    while n < 0:\n        n += 1\n    else:\n        n = 2\n    return n\n", "else of a loop"),
    "array": ("import numpy\nV = numpy.ones(3)\n\n" + INT + "    return V[n]\n", "is passed as an argument"),
    "keyword default": ("def f(n: int, *m: int) -> int:\n    return n\n", "arguments by position"),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_not_translated_is_refused_with_function_line_and_text(what, tmp_path):
    text, why = REFUSED[what]
    path = tmp_path / "texts.py"
    path.write_text("from __future__ import annotations\nfrom tcbench.compiler.language import Floats\n\n" + text)
    spec = importlib.util.spec_from_file_location(f"texts_{abs(hash(what))}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    with pytest.raises(TranslationError, match=why) as caught:
        Module().function(module.f)
    assert "texts.py, line " in str(caught.value) and ("f()" in str(caught.value) or "g()" in str(caught.value))


@late
def total_of(x: Floats, by: float) -> tuple[float, int]:
    total = 0.0
    for i in range(len(x)):
        total += by * x[i]
    return total, len(x)


@late
def twice(x: Floats) -> float:
    total, n = total_of(x, 2.0)
    return total + n


def perhaps(x: Floats, wanted: bool) -> float:
    found = 0.0
    if wanted:
        found = twice(x)
    return found


def test_a_late_function_is_compiled_when_it_is_first_called_and_calls_others(monkeypatch):
    made = []
    linked = library._linked
    monkeypatch.setattr(library, "_linked", lambda module, names: made.append(names) or linked(module, names))
    of, x = Library("perhaps", perhaps), np.array([1.0, 2.0, 4.0])
    before = library.compiled_late()  # which is taken from the time of a run
    assert of.perhaps(x, False) == 0.0 and made == [["entry.0"]] and library.compiled_late() == before
    assert (
        of.perhaps(x, True) == 17.0 and library.compiled_late() > before and made[1:] == [["0.twice"], ["0.total_of"]]
    )
    assert of.perhaps(2 * x, True) == 31.0 and Library("again", perhaps).perhaps(x, True) == 17.0
    assert len(made) == 4  # the other library of its own, and no late function again


def test_an_interrupt_while_a_late_function_is_compiled_is_told_when_compiled_code_is_left(monkeypatch):
    @late
    def added(x: float) -> float:
        return x + 1.0

    def caller(x: float) -> float:
        return added(x)

    def interrupted(module, names):
        monkeypatch.setattr(library, "_linked", linked)
        raise KeyboardInterrupt

    linked = library._linked
    of = Library("caller", caller)
    _ = of.caller  # compiled before
    monkeypatch.setattr(library, "_linked", interrupted)
    with pytest.raises(KeyboardInterrupt):
        of.caller(1.0)
        time.sleep(0.1)
    assert of.caller(1.0) == 2.0
