"""Taylor series in double-double arithmetic on a tape, eight runs side by side: a lane that ends takes the next run.

Coefficients below order `wide` are double-doubles. Those above need only their high parts: |c_k h^k| has fallen there
to a millionth of a millionth of the solution. The step makes the last two coefficients as small as the tolerance.
"""

from __future__ import annotations

import math

from ..compiler.language import Address, Floats, Ints, Matrix, bits, call, exact, from_bits, row
from ..compiler.library import Library
from ..compiler.records import Record, sized
from .double_double import EXPONENT, INVERSE_LN2, LN2, ROUND, add, eight, mul, power_of_two, rough_log
from .recurrences import ABS, SQRT, begin, high_order, keep, wide_order
from .tape import FIELDS, LANES, PAIR

INSIDE = 0.618  # part of a step at which the series are compared with the equations
LONG = 4096.0  # t_end beyond which the unit of time is scaled
SHORTEST = 1e-13
CHECKED = 8  # steps of a run between two such comparisons
SHORTEST_LOOK = 2.0**-14  # of a step: shorter dips of a series below 0 are not seen
# Parts of the way to a turn: a step ends BEFORE it, where it is seen with all digits; the next one BEHIND it.
BEFORE, BEHIND = 2.0**-43, 2.0**-46
FURTHER = 2.0**-94  # of the time, beyond BEHIND; twice as far after each short step
APPROACHES, LANDS = 1.0, 2.0
HELD = 100  # short steps in a row at most: several numbers may turn at once, and series end at the last turn


class Work(Record):
    """Memory of a batch of runs. `memory` has the tape's coefficients, then 1/k for each k, as pairs of vectors."""

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
    values: Matrix = sized("runs", "inputs")  # constants of the tape, by run
    system_constants: Matrix = sized("runs", "constants")  # constants of the compiled equations
    magnitudes: Matrix = sized("runs", "variables")  # of the variables, by run
    tolerances: Floats = sized("runs")
    times: Matrix = sized("runs", "ends")
    states: Matrix = sized("runs", "(ends + 1) * 2 * variables")  # at the start and at each time, high and low parts
    taken: Ints = sized("runs")  # steps; negative where the run did not arrive
    defects: Floats = sized("runs")  # largest departure from the compiled equations
    run: Ints = sized("LANES")  # run of each lane; -1: none
    following: Ints = sized("LANES")  # number of its next time
    state: Ints = sized("LANES")  # result of the step: see `choose`
    t: Floats = sized("LANES")
    t_low: Floats = sized("LANES")
    step: Floats = sized("LANES")
    step_low: Floats = sized("LANES")
    short: Floats = sized("LANES")  # short steps in a row
    turn: Floats = sized("LANES")  # APPROACHES or LANDS where the step ends at a turn
    turned: Floats = sized("LANES")
    unit: Floats = sized("LANES")  # of time in coefficients, a power of 2: those of short series would be too large
    probe: Floats = sized("3 * variables")  # a state, the slope of its series, what the compiled equations give
    slope: Floats = sized("variables", of="probe", at="variables")
    compiled_rate: Floats = sized("variables", of="probe", at="2 * variables")


# series ---------------------------------------------------------------------------------------------------------------


@exact
def series(j: Work) -> None:
    """Compute all coefficients of all results, from coefficient 0 of the variables."""
    w, stride = j.memory, PAIR * (j.order + 1)
    inverse, unit = j.size - stride, row(j.unit, 0, 8)
    begin(j.code, j.steps // FIELDS, w)
    for k in range(1, j.order + 1):
        one = inverse + PAIR * k
        for i in range(j.variables):
            at, rate = stride * i + PAIR * k, j.rates[i]
            if j.moving[i] == 1 or k == 1:
                rate += PAIR * (k - 1) * j.moving[i]
                h, l = mul(row(w, rate, 8), row(w, rate + LANES, 8), row(w, one, 8), row(w, one + LANES, 8))
                keep(w, at, h * unit, l * unit)
            else:
                keep(w, at, eight(0.0), eight(0.0))
        if k < j.wide:
            wide_order(j.code, j.steps // FIELDS, w, k, one)
        else:
            high_order(j.code, j.steps // FIELDS, w, k, one)


# steps ----------------------------------------------------------------------------------------------------------------


@exact
def rough_exp(x: float) -> float:
    """e^x to a few ulp for |x| < 600."""
    k = (x * INVERSE_LN2 + ROUND) - ROUND
    r, total = x - k * LN2, 1.0
    for i in range(16, 0, -1):
        total = 1.0 + r * total / i
    return total * power_of_two(k)


@exact
def longest_step(j: Work, lane: int, run: int) -> float:
    """The step at which the last two coefficients, over magnitude + |y|, are at the tolerance; NaN where one is NaN.

    Behind a turn many are 0 but for round-off, so that all of high order count.
    """
    log_tolerance, low = rough_log(j.tolerances[run]), math.inf
    w, stride, sound = j.memory, PAIR * (j.order + 1), 0.0
    for k in range(j.order, j.order - 2 if j.unit[lane] == 1.0 else j.wide, -1):
        largest = 1e-300
        for i in range(j.variables):
            size, c = j.magnitudes[run, i] + abs(w[stride * i + lane]), w[stride * i + PAIR * k + lane]
            largest = max(largest, abs(c) / size)
            sound += c - c
        low = min(low, (log_tolerance - rough_log(largest)) / k)
    return rough_exp(low) + sound


@exact
def load(j: Work, lane: int, run: int) -> None:
    """Begin a run in a lane."""
    w, stride = j.memory, PAIR * (j.order + 1)
    j.run[lane], j.following[lane] = run, 0
    for i in range(j.inputs):
        w[j.places[i] + lane], w[j.places[i] + LANES + lane] = j.values[run, i], 0.0
    for i in range(j.variables):
        w[stride * i + lane], w[stride * i + LANES + lane] = j.states[run, i], j.states[run, j.variables + i]
    j.t[lane], j.t_low[lane], j.step[lane], j.step_low[lane] = 0.0, 0.0, 0.0, 0.0
    j.short[lane], j.turn[lane], j.turned[lane], j.unit[lane] = 0.0, 0.0, 0.0, 1.0


@exact
def value_at(j: Work, at: int, s: float) -> float:
    """The value at s of the series whose coefficients begin at `at`."""
    value: float = j.memory[at + PAIR * j.order]
    for k in range(j.order - 1, -1, -1):
        value = value * s + j.memory[at + PAIR * k]
    return value


@exact
def first_zero(j: Work, at: int, h: float) -> float:
    """The first zero within h, to all digits, of a series that begins above 0; h where there is none.

    Each iteration goes as far as the series must remain above 0, by its slope and a bound of its curvature.
    """
    w, moved, bent = j.memory, 0.0, 0.0
    for k in range(j.order, 0, -1):
        size = abs(w[at + PAIR * k])
        moved = (moved + size) * h
        bent = bent * h + size * k * (k - 1) if k > 1 else bent
    if moved < w[at] or moved == 0.0:
        return h
    low, high, value = 0.0, 0.0, w[at]
    if value == 0.0:  # at the start
        high = BEHIND * h
        value = value_at(j, at, high)
    while high < h and value > 0.0:
        slope, low = 0.0, high
        for k in range(j.order, 0, -1):
            slope = slope * low + k * w[at + PAIR * k]
        root = math.sqrt(slope * slope + 2.0 * bent * value)
        sure = 2.0 * value / (root - slope) if root > slope else h
        high = min(h, low + max(sure, SHORTEST_LOOK * h))
        value = value_at(j, at, high)
    if value > 0.0:
        return h
    middle = 0.5 * (low + high)
    while low < middle and middle < high:
        if value_at(j, at, middle) > 0.0:
            low = middle
        else:
            high = middle
        middle = 0.5 * (low + high)
    return high


@exact
def to_turn(j: Work, lane: int, h: float) -> float:
    """The step, shortened to just before the point where |x| comes to 0 and turns, and the next one to just behind it.

    The series of |x| goes on below 0, and so does that of a root of squares: both runs could agree on a wrong solution.
    0 for a root: so near a branch point its series has no digits.
    """
    before = j.turn[lane]
    unit: float = j.unit[lane]
    whole = h / unit
    first = whole
    for i in range(j.steps // FIELDS):
        op, at = j.code[FIELDS * i], j.code[FIELDS * i + 1] + lane
        if op == ABS:
            first = first_zero(j, at, first)
        elif op == SQRT and first_zero(j, at, first) < first:
            return 0.0
    if not first < whole:
        j.turn[lane] = 0.0
        return h
    j.turned[lane] = 1.0
    j.turn[lane] = LANDS if before == APPROACHES else APPROACHES
    if before != APPROACHES:
        return unit * first * (1.0 - BEFORE)
    again = power_of_two(j.short[lane])  # where round-off hides the side of a flat turn
    end: float = unit * first * (1.0 + BEHIND) + FURTHER * again * j.t[lane]
    return end


@exact
def next_unit(j: Work, lane: int) -> None:
    """Set the unit of time for the next step of a lane."""
    h, turn = j.step[lane], j.turn[lane]
    if turn > 0.0 or j.unit[lane] < 1.0:
        reach = h * BEFORE if turn == APPROACHES else h * BEHIND if turn == LANDS else max(h, j.unit[lane])
        j.unit[lane] = min(1.0, from_bits(bits(reach) // EXPONENT * EXPONENT))


@exact
def choose(j: Work, lane: int) -> None:
    """Choose the step of a lane and its state after it: 0 goes on, 1 has arrived at a time, 2 has failed, 3 is idle."""
    run = j.run[lane]
    j.step[lane] = j.step_low[lane] = 0.0
    if run < 0:
        j.state[lane] = 3
        return
    t, end = j.t[lane], j.times[run, j.following[lane]]
    left = end - t
    back = left - end
    low = ((end - (left - back)) + (-t - back)) - j.t_low[lane]  # the digits that the difference lost
    h = longest_step(j, lane, run) * j.unit[lane]
    if h > 0.0:
        h = to_turn(j, lane, min(h, left + low))
    short = j.short[lane] + 1.0 if not h > SHORTEST * end else 0.0
    j.short[lane] = short
    j.taken[run] += 1
    sound = short == 0.0 or (h > 0.0 and j.turned[lane] > 0.0 and short < HELD)
    if not sound or j.taken[run] > j.most:
        j.state[lane] = 2
    elif h >= left + low:
        j.step[lane], j.step_low[lane] = left, low
        j.state[lane] = 1
    else:
        j.step[lane] = h
        j.state[lane] = 0


@exact
def compare(j: Work, lane: int) -> None:
    """Compare the derivative of the series inside the step of a lane with the compiled equations, in doubles."""
    w, stride, n = j.memory, PAIR * (j.order + 1), j.variables
    run, unit, probe = j.run[lane], j.unit[lane], j.probe
    s = INSIDE * j.step[lane] / unit
    for i in range(n):
        at = stride * i + lane
        value, slope = w[at + PAIR * j.order], 0.0
        for k in range(j.order - 1, -1, -1):
            slope = slope * s + value
            value = value * s + w[at + PAIR * k]
        probe[i], j.slope[i] = value, slope / unit
    call(j.rate, probe, j.system_constants[run], j.compiled_rate)
    size, off = min(1.0, LONG / j.times[run, j.ends - 1]), 0.0
    for i in range(n):
        size = max(size, abs(j.compiled_rate[i]) / j.magnitudes[run, i])
        off = max(off, abs(j.compiled_rate[i] - j.slope[i]) / j.magnitudes[run, i])
    if not off / size <= j.defects[run]:
        j.defects[run] = off / size


@exact
def advance(j: Work) -> None:
    """Set coefficients 0 of the variables to their values after the steps of all lanes."""
    w, stride = j.memory, PAIR * (j.order + 1)
    unit = row(j.unit, 0, 8)
    h, l = row(j.step, 0, 8) / unit, row(j.step_low, 0, 8) / unit
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
    """Advance the time of a lane by its step; is its run over?"""
    w, stride, n = j.memory, PAIR * (j.order + 1), j.variables
    run, at, state = j.run[lane], j.following[lane], j.state[lane]
    if state == 3:
        return False
    if state < 2:
        next_unit(j, lane)
    if state == 0:
        t, h = j.t[lane], j.step[lane]
        s = t + h
        back = s - t
        j.t[lane], j.t_low[lane] = s, j.t_low[lane] + ((t - (s - back)) + (h - back))
        return False
    if state == 2:
        j.taken[run] = -j.taken[run]
        return True
    for i in range(n):
        j.states[run, 2 * n * (at + 1) + i] = w[stride * i + lane]
        j.states[run, 2 * n * (at + 1) + n + i] = w[stride * i + LANES + lane]
    j.t[lane], j.t_low[lane] = j.times[run, at], 0.0
    j.following[lane] = at + 1
    over: bool = at + 1 == j.ends
    return over


@exact
def march(j: Work) -> int:
    """March every run to its last time; returns the number of steps of eight lanes."""
    following, steps = 0, 0
    for lane in range(LANES):
        load(j, lane, min(lane, j.runs - 1))  # idle lanes compute, too
        following += 1
        if lane >= j.runs:
            j.run[lane] = -1
            following = j.runs
    running = min(following, j.runs)
    begin(j.setup, j.length // FIELDS, j.memory)
    while running > 0:
        series(j)
        steps += 1
        for lane in range(LANES):
            choose(j, lane)
            short = j.short[lane] > 0.0  # an error of the state is a large rate over such a step
            if j.state[lane] < 2 and j.taken[j.run[lane]] % CHECKED == 1 and not short:
                compare(j, lane)
        advance(j)
        loaded = False
        for lane in range(LANES):
            if arrive(j, lane):
                j.run[lane] = -1
                running -= 1
                if following < j.runs:
                    load(j, lane, following)
                    following, running, loaded = following + 1, running + 1, True
        if loaded:
            begin(j.setup, j.length // FIELDS, j.memory)
    return steps


LIBRARY = Library("references", march)
