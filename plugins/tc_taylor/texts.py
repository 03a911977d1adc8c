"""Text of two kernels: the Taylor coefficients of a state to some order, and the polynomial that they make at h."""

from __future__ import annotations

from tcbench import System
from tcbench.compiler import derivatives as trace
from tcbench.compiler.array_states import entries
from tcbench.compiler.derivatives import Symbol
from tcbench.compiler.kernels import Kernel, of_lines

from .lanes import WIDTH, kinks
from .rates import rates
from .series import Series
from .writer import Writer

BESIDE = 2  # numbers between a state and its slopes: see `memory.Work.end`
WORK = 0.2  # time of a product, over that of an operation which waits for the one before


def series_kernels(system: System, order: int, first: int) -> tuple[Kernel, Kernel, Kernel, list[Symbol], float]:
    """(series, polynomial, rates, constants, `time_of` the series) of one structure of system; nothing is compiled yet.

    series(y, given) -> coefficients 0 .. order of y, each of the size of y; the squared sizes of the last two: see
        `squared_size`; coefficients 0 .. order of what has kinks. The constants of the list stand in `given` from
        `first` on.
    polynomial(coefficients, (h,)) -> y after h
    rates(y, given) -> y, its rates: coefficients 0 and 1
    """
    sym = system.symbolic
    variables, rate = rates(sym, sym.state(trace.variables("y", system.size)))
    size = system.size
    writer, stored = coefficients(variables, rate, order, first)
    for at, k in enumerate((order - 1, order)):
        stored.append(f"out[{(order + 1) * size + at}] = {squared_size(writer, system, variables, k)}")
    turns = [writer.value((u,), k) or "0.0" for k in range(order + 1) for u in kinks(rate)]
    stored += [f"out[{(order + 1) * size + 2 + i}] = {turn}" for i, turn in enumerate(turns)]
    series = of_lines([*writer.lines, *stored], (order + 1) * size + 2 + len(turns))
    field, more = rates_kernel(variables, rate, first + len(writer.given))
    return series, polynomial_kernel(order, size), field, [*writer.given, *more], time_of(writer)


def rates_kernel(variables: list[Series], rate: list[Series], first: int) -> tuple[Kernel, list[Symbol]]:
    """A state and its rates, and constants: coefficients 0 and 1 of the same series."""
    writer, stored = coefficients(variables, rate, 1, first)
    return of_lines([*writer.lines, *stored], 2 * len(variables)), writer.given


def coefficients(variables: list[Series], rate: list[Series], order: int, first: int) -> tuple[Writer, list[str]]:
    """All of them, and the lines that store those of the variables."""
    writer = Writer(variables, dict(enumerate(rate)), first)
    return writer, [line for k in range(order + 1) for line in stores(writer, variables, k)]


def time_of(writer: Writer) -> float:
    """In operations that wait for each other: their longest chain, and what all products add."""
    return max(writer.ready.values()) + WORK * sum(line.count("*") for line in writer.lines)


def squared_size(writer: Writer, system: System, variables: list[Series], k: int) -> str:
    """Of coefficient k: the sum of its squares over least^2 + y^2."""
    sym = system.symbolic
    least = [x * x for x in entries(sym.magnitudes_of(sym.state(trace.variables("y", system.size))))]
    squares: dict[int, list[tuple[str, ...]]] = {}  # by the number of lanes
    for pack in dict.fromkeys(writer.packs.home[id(x)][0] for x in variables):
        y, value = writer.value(pack, 0), writer.value(pack, k)
        weight = writer.name(f"1.0 / ({writer.weights([least[x.index] for x in pack])} + {y} * {y})")
        if value:
            squares.setdefault(len(pack), []).append((writer.name(f"{value} * {weight}"), value))
    sums = [writer.lane(str(writer.sum_of(x)), width, lane) for width, x in squares.items() for lane in range(width)]
    while len(sums) > 1:
        sums = [writer.name(" + ".join(sums[i : i + 2])) for i in range(0, len(sums), 2)]
    return sums[0] if sums else "0.0"


def stores(writer: Writer, variables: list[Series], k: int) -> list[str]:
    """Coefficient k of the variables into its place."""
    size, lines = len(variables), []
    for pack in dict.fromkeys(writer.packs.home[id(x)][0] for x in variables):
        places, name = [k * size + x.index for x in pack], writer.value(pack, k)
        if name and len(pack) > 1 and places == list(range(places[0], places[0] + len(pack))):
            lines.append(f"put(out, {places[0]}, {name})")
        else:
            lines += [f"out[{place}] = {writer.coefficient(x, k)}" for place, x in zip(places, pack, strict=True)]
    return lines


def polynomial_kernel(order: int, size: int) -> Kernel:
    """The polynomials of all numbers, some at a time; in Estrin's order: short chains of operations."""
    lines = powers(order)
    for i in range(0, size, WIDTH):
        lines += stored_sum(terms(order, size, i), i, i, min(WIDTH, size - i))
    return of_lines(lines, size)


def slopes_kernel(order: int, size: int) -> Kernel:
    """The same, and behind two more numbers their slopes."""
    lines, behind = powers(order), size + BESIDE
    for i in range(0, size, WIDTH):
        count = min(WIDTH, size - i)
        texts = [f"c{k}_{i}" for k in range(order + 1)]
        lines += [f"{name} = {text}" for name, text in zip(texts, terms(order, size, i), strict=True)]
        lines += stored_sum(texts, i, i, count)
        slopes = [text if k == 1 else f"{float(k)} * {text}" for k, text in enumerate(texts)]
        lines += stored_sum(slopes[1:], behind + i, behind + i, count)
    return of_lines(lines, behind + size)


def powers(order: int) -> list[str]:
    return ["h1 = b[0]"] + [f"h{2 * k} = h{k} * h{k}" for k in (2**i for i in range(order.bit_length() - 1))]


def terms(order: int, size: int, i: int) -> list[str]:
    """Coefficients of some numbers from i on."""
    count = min(WIDTH, size - i)
    return [f"row(a, {k * size + i}, {count})" if count > 1 else f"a[{k * size + i}]" for k in range(order + 1)]


def stored_sum(texts: list[str], name: int, at: int, count: int) -> list[str]:
    """Lines that store the polynomial with these coefficients."""
    power = 1
    while len(texts) > 1:
        pairs = [f"({low} + {high} * h{power})" for low, high in zip(texts[::2], texts[1::2], strict=False)]
        texts, power = pairs + texts[len(pairs) * 2 :], 2 * power
    return [f"t{name} = {texts[0]}", f"put(out, {at}, t{name})" if count > 1 else f"out[{at}] = t{name}"]
