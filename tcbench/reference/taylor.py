"""Taylor series in double-double arithmetic on a tape, eight runs side by side: a lane that ends takes the next run.

Coefficients below order `wide` are double-doubles. Those above need only their high parts: |c_k h^k| has fallen there
to a millionth of a millionth of the solution. The step makes the last two coefficients as small as the tolerance.
"""

from __future__ import annotations

from ..compiler.language import Address, Floats, Ints, Matrix, call, exact, row
from ..compiler.library import Library
from ..compiler.records import Record, sized
from .double_double import INVERSE_LN2, LN2, ROUND, add, eight, mul, power_of_two, rough_log
from .recurrences import begin, high_order, keep, wide_order
from .tape import FIELDS, LANES, PAIR

INSIDE = 0.618  # of a step: where the series are compared with the equations
LONG = 4096.0  # a time beyond is counted in a small unit, and rates are small
SHORTEST = 1e-13
CHECKED = 8  # every so many steps of a run


class Work(Record):
    """Memory of a batch of runs. `memory` has what the tape says, then 1/k for each k, as pairs of vectors."""

    order: int
    wide: int
    variables: int
    inputs: int
    length: int  # of `setup`
    steps: int  # numbers in `code`
    size: int  # of memory
    runs: int
    ends: int
    constants: int
    most: int
    rate: Address
    setup: Ints = sized("length")
    code: Ints = sized("steps")
    memory: Floats = sized("size")
    rates: Ints = sized("variables")
    moving: Ints = sized("variables")
    places: Ints = sized("inputs")
    values: Matrix = sized("runs", "inputs")  # of each run: constants of the tape,
    given: Matrix = sized("runs", "constants")  # and of the compiled equations;
    least: Matrix = sized("runs", "variables")  # sizes of their variables
    tolerances: Floats = sized("runs")
    times: Matrix = sized("runs", "ends")
    states: Matrix = sized("runs", "(ends + 1) * 2 * variables")  # where it starts and at each time, high and low parts
    taken: Ints = sized("runs")  # steps, negative where it did not arrive
    defects: Floats = sized("runs")  # largest departure from the compiled equations
    lanes: Floats = sized("8 * LANES")  # t, its low part, step, its low part
    which: Ints = sized("3 * LANES")  # run, next time, what becomes of it after this step
    probe: Floats = sized("3 * variables")


# series ---------------------------------------------------------------------------------------------------------------


@exact
def series(j: Work) -> None:
    """All coefficients of all results, from coefficient 0 of the variables."""
    w, stride = j.memory, PAIR * (j.order + 1)
    inverse = j.size - stride
    begin(j.code, j.steps // FIELDS, w)
    for k in range(1, j.order + 1):
        one = inverse + PAIR * k
        for i in range(j.variables):
            at, rate = stride * i + PAIR * k, j.rates[i]
            if j.moving[i] == 1 or k == 1:
                rate += PAIR * (k - 1) * j.moving[i]
                h, l = mul(row(w, rate, 8), row(w, rate + LANES, 8), row(w, one, 8), row(w, one + LANES, 8))
                keep(w, at, h, l)
            else:
                keep(w, at, eight(0.0), eight(0.0))
        if k < j.wide:
            wide_order(j.code, j.steps // FIELDS, w, k, one)
        else:
            high_order(j.code, j.steps // FIELDS, w, k, one)


# steps ----------------------------------------------------------------------------------------------------------------


@exact
def rough_exp(x: float) -> float:
    """e^x to a few ulp, of |x| < 600."""
    k = (x * INVERSE_LN2 + ROUND) - ROUND
    r, total = x - k * LN2, 1.0
    for i in range(16, 0, -1):
        total = 1.0 + r * total / i
    return total * power_of_two(k)


@exact
def longest_step(j: Work, lane: int, run: int) -> float:
    """At which the last two coefficients, over least + |y|, are as small as the tolerance; NaN of what is no number."""
    tolerance = j.tolerances[run]
    w, stride, last, before, sound = j.memory, PAIR * (j.order + 1), 1e-300, 1e-300, 0.0
    for i in range(j.variables):
        size = j.least[run, i] + abs(w[stride * i + lane])
        top, below = w[stride * (i + 1) - PAIR + lane], w[stride * (i + 1) - 2 * PAIR + lane]
        last, before = max(last, abs(top) / size), max(before, abs(below) / size)
        sound += (top - top) + (below - below)
    by_last = (rough_log(tolerance) - rough_log(last)) / j.order
    by_before = (rough_log(tolerance) - rough_log(before)) / (j.order - 1)
    return rough_exp(min(by_last, by_before)) + sound


@exact
def load(j: Work, lane: int, run: int) -> None:
    """A run begins in a lane."""
    w, stride = j.memory, PAIR * (j.order + 1)
    j.which[lane], j.which[LANES + lane] = run, 0
    for i in range(j.inputs):
        w[j.places[i] + lane], w[j.places[i] + LANES + lane] = j.values[run, i], 0.0
    for i in range(j.variables):
        w[stride * i + lane], w[stride * i + LANES + lane] = j.states[run, i], j.states[run, j.variables + i]
    for i in range(4):
        j.lanes[LANES * i + lane] = 0.0


@exact
def choose(j: Work, lane: int) -> None:
    """The step of a lane, and what becomes of it then: 0 goes on, 1 has arrived at a time, 2 has failed, 3 is idle."""
    run, lanes = j.which[lane], j.lanes
    lanes[2 * LANES + lane] = lanes[3 * LANES + lane] = 0.0
    if run < 0:
        j.which[2 * LANES + lane] = 3
        return
    t, end = lanes[lane], j.times[run, j.which[LANES + lane]]
    left = end - t
    back = left - end
    low = ((end - (left - back)) + (-t - back)) - lanes[LANES + lane]  # the digits that the difference lost
    h = longest_step(j, lane, run)
    j.taken[run] += 1
    if not h > SHORTEST * end or j.taken[run] > j.most:
        j.which[2 * LANES + lane] = 2
    elif h >= left + low:
        lanes[2 * LANES + lane], lanes[3 * LANES + lane] = left, low
        j.which[2 * LANES + lane] = 1
    else:
        lanes[2 * LANES + lane] = h
        j.which[2 * LANES + lane] = 0


@exact
def compare(j: Work, lane: int) -> None:
    """Inside the step of a lane, the derivative of the series against the compiled equations, in doubles."""
    w, stride, n = j.memory, PAIR * (j.order + 1), j.variables
    run, s, probe = j.which[lane], INSIDE * j.lanes[2 * LANES + lane], j.probe
    for i in range(n):
        at = stride * i + lane
        value, slope = w[at + PAIR * j.order], 0.0
        for k in range(j.order - 1, -1, -1):
            slope = slope * s + value
            value = value * s + w[at + PAIR * k]
        probe[i], probe[n + i] = value, slope
    call(j.rate, probe, j.given[run], probe[2 * n : 3 * n])
    size, off = min(1.0, LONG / j.times[run, j.ends - 1]), 0.0
    for i in range(n):
        size = max(size, abs(probe[2 * n + i]) / j.least[run, i])
        off = max(off, abs(probe[2 * n + i] - probe[n + i]) / j.least[run, i])
    if not off / size <= j.defects[run]:
        j.defects[run] = off / size


@exact
def advance(j: Work) -> None:
    """The variables after the steps of all lanes, in their coefficients 0."""
    w, stride = j.memory, PAIR * (j.order + 1)
    h, l = row(j.lanes, 2 * LANES, 8), row(j.lanes, 3 * LANES, 8)
    for i in range(j.variables):
        at = stride * i
        top = row(w, at + PAIR * j.order, 8)
        for k in range(j.order - 1, j.wide - 1, -1):
            top = top * h + row(w, at + PAIR * k, 8)
        s, e = top, eight(0.0)
        for k in range(j.wide - 1, -1, -1):
            s, e = mul(s, e, h, l)
            s, e = add(s, e, row(w, at + PAIR * k, 8), row(w, at + PAIR * k + LANES, 8))
        keep(w, at, s, e)


@exact
def arrive(j: Work, lane: int) -> bool:
    """The time of a lane after its step; whether its run is over."""
    w, stride, n, lanes = j.memory, PAIR * (j.order + 1), j.variables, j.lanes
    run, at, state = j.which[lane], j.which[LANES + lane], j.which[2 * LANES + lane]
    if state == 3:
        return False
    if state == 0:
        t, h = lanes[lane], lanes[2 * LANES + lane]
        s = t + h
        back = s - t
        lanes[lane], lanes[LANES + lane] = s, lanes[LANES + lane] + ((t - (s - back)) + (h - back))
        return False
    if state == 2:
        j.taken[run] = -j.taken[run]
        return True
    for i in range(n):
        j.states[run, 2 * n * (at + 1) + i] = w[stride * i + lane]
        j.states[run, 2 * n * (at + 1) + n + i] = w[stride * i + LANES + lane]
    lanes[lane], lanes[LANES + lane] = j.times[run, at], 0.0
    j.which[LANES + lane] = at + 1
    over: bool = at + 1 == j.ends
    return over


@exact
def march(j: Work) -> int:
    """Every run to its last time; how many steps of eight lanes that took."""
    following, steps = 0, 0
    for lane in range(LANES):
        load(j, lane, min(lane, j.runs - 1))  # what is idle computes, too
        following += 1
        if lane >= j.runs:
            j.which[lane] = -1
            following = j.runs
    running = min(following, j.runs)
    begin(j.setup, j.length // FIELDS, j.memory)
    while running > 0:
        series(j)
        steps += 1
        for lane in range(LANES):
            choose(j, lane)
            if j.which[2 * LANES + lane] < 2 and j.taken[j.which[lane]] % CHECKED == 1:
                compare(j, lane)
        advance(j)
        loaded = False
        for lane in range(LANES):
            if arrive(j, lane):
                j.which[lane] = -1
                running -= 1
                if following < j.runs:
                    load(j, lane, following)
                    following, running, loaded = following + 1, running + 1, True
        if loaded:
            begin(j.setup, j.length // FIELDS, j.memory)
    return steps


LIBRARY = Library("references", march)
