"""Steps of consistent collocation (step.py): fixed ones, and adaptive ones that hold the defect to a tolerance."""

from __future__ import annotations

import math

from tcbench.compiler.language import Floats, Matrix, call, copy_into, fill, late, rare
from tcbench.compiler.library import Library
from tcbench.compiler.polling import to_end
from tcbench.solver.linear_algebra import add_compensated

from .memory import LONG, SOLVED_TO, Work
from .newton_matrix import damp, rate_of
from .step import COARSE, CONVERGED, FAILED, SOLVED, begin_step, extrapolate, mend, try_step

UNSEEN = 2.0  # see `turn`
STEEPER = 1.5  # than at both ends may be what passes 0 between
RISE = 2.0  # of an exponent: e^2 times as large as at the ends may be what is not seen from there
# Exponents, from where their exponential is e^-20, that change by so much between two nodes: what the nodes miss is
# then no higher power of the step than the defect.
FAINT, STEEP = 16.0, 2.0
LITTLE = 1e-3  # of the largest number with a kink: what others do has not come to it yet
CLOSER = 40  # looks between two nodes at what may pass 0 there
MOST_TURNS = 4000  # steps with a kink, before a run is given up: it slides along one
ADD_UP = 64.0  # steps with a kink, from which on what they miss adds up: each may miss as much less
SHORTEST, MOST_FAILED = 2.0**-24, 300  # part of a step, and parts that fail, before it is given up
SAFETY, GROW, SHRINK, ACCEPT = 0.85, 2.0, 0.2, 4.0
HALF = 0.5  # of a step without a solution in reach
BEST = 0.135  # contraction for which a unit of time costs least: it grows as h^2, and h log(1/h^2) is largest at e^-2
RETREAT, ADVANCE = 0.7, 1.1  # of a step that is too long for the quadrature, and of the bound that one leaves behind
# of the ideal length, up to which that bound comes at once: where the solution has smoothed it is soon gone
FREE = 0.33
FIRST = 4.0  # times the fastest decay time: see first_step
# An initial layer: its size, and the decay times in a step, from which on it is divided; the first part, in these.
LAYER, FAST, DECAYS = 1e-2, 4.0, 0.5
TURNS = 12  # of the power method that finds it
LEVELLED = 100.0  # times what the energy misses, by which part mending may move a state: it waits where that rests
COARSEST = 0  # level of quadrature
SAVED = 40.0  # iterations that may be saved up, of a budget: see advance
FAR = 2.5  # ratio of steps up to which the last polynomials are extrapolated


def largest_defect(w: Work, h: float) -> float:
    """Of the derivative's polynomial where the rates are known, at both ends; stiff parts are damped by the flow."""
    m, largest = w.m, 0.0
    for i in range(m):
        w.sides[i, 0], w.sides[i, 1] = w.sums[m + i] - w.start[i], w.sums[2 * m + i] - w.end[i]
    if w.solve.stiff:
        damp(w, h)
    for i in range(m):
        for side in range(2):
            r = abs(w.sides[i, side]) * w.inverse_sizes[i]
            largest = r if r > largest or r != r else largest
    return largest


@late
def jump_at_kinks(w: Work, h: float) -> float:
    """The largest jump of the rates at a kink in this step, times the time between two nodes, over the sizes of the
    variables; -1: the step meets no kink. Nodes on both sides of a narrow window do not see what is in it."""
    a, before, here, largest, x = w.numbers, w.start, 0, -1.0, 0.0
    copy_into(w.here, w.z)
    for j in range(w.k):
        for i in range(w.m):
            total = 0.0
            for l in range(w.k):
                total += a.A[j, l] * w.U[i, l]
            w.now[i] = w.z[i] + h * total
        call(w.to_start, w.now, w.c, w.inside[here])
        largest = larger(largest, jump_between(w, before, w.inside[here], h * (a.nodes[j] - x)))
        before, here, x = w.inside[here], 1 - here, a.nodes[j]
        for i in range(w.m):
            w.here[i] = w.now[i]
    for i in range(w.m):
        w.now[i] = w.z1[i]
    return larger(largest, jump_between(w, before, w.end, h * (1.0 - x)))


def larger(x: float, y: float) -> float:
    """The larger one; NaN if y is."""
    return y if y > x or y != y else x


def jump_between(w: Work, before: Floats, after: Floats, h: float) -> float:
    """`jump_at_kinks` between two states a time h apart, `here` and `now`; 0 also without a kink where exponents are
    steep; infinite where values and slopes do not tell whether a kink is met.

    before, after : rates and, last, the numbers u of `formulas.kinks_of` and their slopes at both states, (n_ends,).
    Where u has one sign at both and may pass 0 and come back, it is looked at where it is least, up to CLOSER times.
    """
    n = w.n_kinks // 2
    first, largest, size = w.n_ends - w.n_kinks, -1.0, 0.0
    for i in range(first, first + w.n_jumping):
        size = max(size, abs(before[i]), abs(after[i]))
    for i in range(first, first + w.n_jumping):
        left, right, u, v = 0.0, 1.0, before[i], after[i]
        down, up, looks = h * before[i + n], h * after[i + n], 0
        while looks < CLOSER:
            s = turn(u, v, (right - left) * down, (right - left) * up)
            if s < 0.0 or (s == UNSEEN and max(abs(u), abs(v), abs(down), abs(up)) < LITTLE * size):
                break
            if s == UNSEEN:
                return math.inf
            x = left + (s if looks % 2 == 0 else 0.5) * (right - left)
            largest = larger(largest, defect_between(w, before, after, x, h))
            middle, slope = w.inside[2, i], h * w.inside[2, i + n]
            looks = looks + 1 if u * v > 0.0 and u * middle > 0.0 else CLOSER
            if u * slope < 0.0:
                left, u, down = x, middle, slope
            else:
                right, v, up = x, middle, slope
    for i in range(first + w.n_jumping, first + n):
        if is_hidden(w, before, after, i, h):
            return math.inf
        if max(before[i], after[i]) > FAINT and abs(after[i] - before[i]) > STEEP:
            largest = larger(largest, 0.0)
    return largest


def turn(u: float, v: float, slope: float, last: float) -> float:
    """The place, as a part of an interval, where a number that goes from u to v changes its sign or may; -1: nowhere.

    slope, last : its slopes at both ends, times the length of the interval. Where lines STEEPER than these meet on the
    other side of 0, it may pass 0 and come back: the place is that where its slope would be 0. UNSEEN: it may do so
    anywhere, since the mean of the slopes misses v - u by more than the number is from 0, and it does not only go away
    from 0.
    """
    if not u * v > 0.0 and u != v:
        part = u / (u - v)
        return part if part >= 0.0 else 0.5  # of what is no number
    way = 1.0 if u > 0.0 else -1.0
    down, up = STEEPER * way * slope, STEEPER * way * last
    if down < 0.0 and up > 0.0 and meeting(way * u, way * v, down, up)[1] < 0.0:
        return down / (down - up)
    leaves = u == 0.0 or (down >= 0.0 and up >= 0.0 and way * (v - u) >= 0.0)
    return UNSEEN if not leaves and abs(v - u - 0.5 * (slope + last)) > min(abs(u), abs(v)) else -1.0


def is_hidden(w: Work, before: Floats, after: Floats, i: int, h: float) -> bool:
    """Does number i, positive where rates are not flat, become positive between two states and larger than at both by
    RISE, so that these show nothing of what is there? Or is it flat at one of them, and more than FAINT at the other?
    Arguments as of `jump_between`."""
    n = w.n_kinks // 2
    if min(before[i], after[i]) < 0.0 and max(before[i], after[i]) > FAINT:
        return True
    left, right, seen = 0.0, 1.0, max(before[i], after[i]) + RISE
    x = summit(before[i], after[i], h * before[i + n], h * after[i + n], seen)
    if x < 0.0:
        return False
    for _ in range(CLOSER):
        defect_between(w, before, after, x, h)
        if w.inside[2, i] > max(seen, 0.0):
            return True
        if w.inside[2, i + n] > 0.0:
            left = x
        else:
            right = x
        x = 0.5 * (left + right)
    return False


def summit(u: float, v: float, slope: float, last: float, seen: float) -> float:
    """The place where a number that goes from u to v may be largest, as a part of the interval; slope, last : as of
    `turn`. -1: it stays below 0 or below `seen`, also under lines STEEPER than its slopes."""
    if not (slope > 0.0 and last < 0.0):
        return -1.0
    x, top = meeting(u, v, STEEPER * slope, STEEPER * last)
    return min(max(x, 0.1), 0.9) if top > max(seen, 0.0) else -1.0


def meeting(u: float, v: float, slope: float, last: float) -> tuple[float, float]:
    """Where a line from u at the beginning meets one to v at the end, as a part of the interval, and the value there.

    slope, last : of the lines, times the interval's length. The value is computed from the smaller end: beside 1e30 at
    the other nothing would be left of its digits.
    """
    x = (u - v + last) / (last - slope)
    return x, u + slope * x if abs(u) < abs(v) else v - last * (1.0 - x)


def defect_between(w: Work, before: Floats, after: Floats, s: float, h: float) -> float:
    """The largest |h rate - slope| over sizes, on the cubic from `here` to `now` at the part s of the time h between.
    before, after : as of `jump_between`. What the first kernel gives there is left in `inside[2]`."""
    largest = 0.0
    for i in range(w.m):
        d, p, q = w.now[i] - w.here[i], h * before[i], h * after[i]
        second, third = 3.0 * d - 2.0 * p - q, p + q - 2.0 * d
        w.dropped[i] = w.here[i] + s * (p + s * (second + s * third))
        w.forces[i] = p + s * (2.0 * second + 3.0 * s * third)
    call(w.to_start, w.dropped, w.c, w.inside[2])
    for i in range(w.m):
        largest = larger(largest, abs(h * w.inside[2, i] - w.forces[i]) * w.inverse_sizes[i])
    return largest


@rare
def first_part(w: Work, h: float) -> float:
    """The part of a step, a power of 1/2, to take first where it begins with an initial layer: as long as the fastest
    decay takes. The state is in such a layer where (I - hM)^-1 leaves little of its rates; else the part is 1."""
    before, after = 0.0, 0.0
    for i in range(w.m):
        w.sides[i, 0], w.sides[i, 1] = w.start[i], 0.0
    damp(w, h)
    for i in range(w.m):
        if w.sides[i, 0] != w.start[i]:
            before = max(before, abs(w.start[i]) * w.inverse_sizes[i])
            after = max(after, abs(w.sides[i, 0]) * w.inverse_sizes[i])
    part, layer = 1.0, before > FAST * after and abs(h) * after > LAYER
    while layer and part * before > DECAYS * after and part > SHORTEST:
        part *= 0.5
    return part


@late
def halving_step(w: Work, h: float, z0: Floats, dz_total: Floats) -> int:
    """Increments of one step of length h. One without a solution in reach is taken in halves, and one that begins with
    an initial layer in parts that grow as it decays.

    Misses of the quadrature that are round-off of a step may have one sign: where they have added up to more than that
    beside the energy of the run, it is mended.
    """
    z, carry = w.z, w.carry
    w.budget.limit, w.solve.leaves = math.inf, w.constrained
    copy_into(z, z0)
    fill(dz_total, 0.0)
    fill(carry, 0.0)
    call(w.to_start, z, w.c, w.start)
    done, part, failed = 0.0, 1.0, 0
    while done < 1.0:
        begin_step(w, part * h, z)
        if part == 1.0 and w.solve.stiff:
            part = first_part(w, h)
            if part < 1.0:
                begin_step(w, part * h, z)
        code = try_step(w, part * h, z, False, COARSEST, CONVERGED)
        if code != SOLVED:
            part *= 0.5
            w.counts.halved += 1
            failed += 1
            if part < SHORTEST or failed > MOST_FAILED:
                return FAILED
            continue
        w.counts.steps += 1
        missing = abs(w.end_energy[0] - w.run[0])
        if missing > w.miss[0] and not w.constrained:
            restore_level(w, z, LEVELLED * missing / (w.least_energy + abs(w.run[0])))
        add_compensated(dz_total, w.dz, carry)
        for i in range(len(z)):
            z[i] = z0[i] + dz_total[i]
        copy_into(w.start, w.end)
        done += part
        while part < 1.0 and done % (2.0 * part) == 0.0:  # both halves are done
            part *= 2.0
    return SOLVED


def restore_level(w: Work, z: Floats, limit: float) -> None:
    """The end of a step that was solved, with the energy of the run, and an entropy that is no less than at the start,
    nor than after the last of these."""
    call(w.to_laws, z, w.c, w.now)
    w.least_entropy[0] = max(w.least_entropy[0], w.now[w.m + 1])
    mend(w, limit)


def first_step(w: Work, tolerance: float, whole: float) -> float:
    """A length for the first step of a time: a part of the fastest decay, where rates are far from its equilibrium."""
    h = 0.5 * tolerance ** (1.0 / (w.k + 1)) * max(1.0, whole / LONG)
    fastest = max(rate_of(w, w.z, TURNS, TURNS - 1), 1e-300)
    largest = 0.0
    for i in range(w.m):
        largest = max(largest, abs(w.start[i]) * w.inverse_sizes[i])
    return min(h, FIRST * h / fastest) if largest > tolerance * fastest else h


def run(w: Work, tolerance: float, residual: float) -> int:
    """States at the times that the record has been lent, from the first state; SOLVED or FAILED. The steps are chosen
    so that the defect stays at the tolerance, and are solved to the residual."""
    begin(w, w.states[0])
    w.budget.worth, w.budget.most = 0.0, math.inf
    row, w.budget.t, _ = advance(w, w.times, tolerance, residual, w.states, 1, w.times[0], 0.0)
    return SOLVED if row == len(w.times) else FAILED


def begin(w: Work, z: Floats) -> None:
    """A run from z: nothing spent, and energy and invariants of z as those to be kept."""
    w.counts.steps, w.counts.rejected, w.counts.iterations = 0, 0, 0
    go_to(w, z)
    call(w.to_laws, w.z, w.c, w.laws)


def go_to(w: Work, z: Floats) -> None:
    """On from z; what is to be kept stays."""
    copy_into(w.z, z)
    fill(w.carry, 0.0)
    call(w.to_start, w.z, w.c, w.start)


@late
def advance(
    w: Work, times: Floats, tolerance: float, residual: float, states: Matrix, row: int, t: float, h: float
) -> tuple[int, float, float]:
    """States at times[row:] from the state at t on; returns (row that is next, t, the next step).

    It ends early where steps become too short (then the last is 0), and where they owe more iterations than `budget`
    allows: those that they take beyond what the time that they cover is worth.
    h : of the first step; 0: to be found.
    """
    k = w.k
    z, carry = w.z, w.carry
    worth, most, owed, spent = w.budget.worth, w.budget.most, 0.0, w.counts.iterations
    last, whole, turned = 0.0, times[len(times) - 1] - times[0], 0
    # what steps that began from the polynomials of others have shown to be too long, and too long for the coarsest
    # quadrature to keep the energy
    longest, roughest = math.inf, math.inf
    while row < len(times) and owed <= most:
        while t < times[row] and owed <= most:
            if to_end(w.watch, t):
                return row, t, 0.0
            if h == 0.0:
                h = min(times[row] - t, first_step(w, tolerance, whole))
            left = times[row] - t
            step = left if left <= 1.01 * h else min(h, 0.5 * left) if left < 2.0 * h else h
            known = last > 0.0 and step <= FAR * last
            if known:
                extrapolate(w, step / last)
            w.budget.limit = spent + most - owed + worth * step
            begin_step(w, step, z)
            lowest = w.least_entropy[0]
            code = try_step(w, step, z, known, COARSEST + (step > roughest), residual)
            owed += w.counts.iterations - spent
            spent = w.counts.iterations
            error, factor = 0.0, 0.0
            if code == SOLVED:
                error = step * largest_defect(w, step)
                factor = SAFETY * (tolerance / max(error, 1e-300)) ** (1.0 / (k + 1))
                jump = jump_at_kinks(w, step) if w.n_kinks > 0 else -1.0
                if not jump < 0.0:
                    turned += jump > 0.0
                    error *= ACCEPT * tolerance * SOLVED_TO / residual * (1.0 + turned / ADD_UP)
                    factor = min(factor, SAFETY * math.sqrt(tolerance / max(error, 1e-300)))
                    if not jump <= tolerance:  # the ends, and perhaps the nodes, are outside of what it jumps in
                        error, factor = math.inf, HALF
                factor = min(factor, math.sqrt(max(BEST, w.sparse.bound) / max(w.solve.contraction, 1e-3)))
            if code != SOLVED or not error <= ACCEPT * tolerance:
                w.counts.rejected += 1
                w.least_entropy[0] = lowest  # that the next step may not fall below
                h = step * (HALF if code == FAILED else RETREAT if code == COARSE else max(SHRINK, factor))
                longest = h if known else longest
                copy_into(w.rates, w.kept)  # shorter, the next one is nearer to them
                if turned > MOST_TURNS or not h > 1e-12 * max(min(1.0, whole), abs(t)):
                    return row, t, 0.0
                continue
            w.counts.steps += 1
            add_compensated(z, w.dz, carry)
            copy_into(w.start, w.end)
            copy_into(w.kept, w.rates)
            t = times[row] if step == left else t + step
            last = step
            h = max(h, step * factor) if step < h and factor >= 1.0 else step * min(GROW, factor)
            roughest = step * RETREAT if step <= roughest and w.solve.level > 0 else roughest * ADVANCE
            longest *= max(ADVANCE, FREE * factor)
            h = min(h, longest)
            owed = max(-SAVED, owed - worth * step)
        if t == times[row]:
            copy_into(states[row], z)
            row += 1
    return row, t, h


def fixed_steps(w: Work, h: float, z0: Floats, increments: Matrix) -> int:
    """Increments of as many steps as there are rows, or of those before the first without a solution; how many."""
    copy_into(w.here, z0)
    fill(w.dropped, 0.0)
    for i in range(len(increments)):
        if halving_step(w, h, w.here, increments[i]) != SOLVED:
            return i
        add_compensated(w.here, increments[i], w.dropped)
    return len(increments)


LOOPS = Library("collocation", begin, fixed_steps, run)
