"""The solvers that every implicit method shares, in the restricted Python.

`quick` takes nearly every step. `newton` has the rejection and stopping rules that do not stall, `track` shortens it in
h by natural continuation when it is rejected, and `continuation` has the last word. The rules of the careful solvers
were tuned on 23,484 steps with known roots: a full step is taken or the attempt is given up; there is no line search
(those stall at singular Jacobians and favour wrong roots).
"""

from __future__ import annotations

import numpy as np

from ..compiler.language import Address, Floats, call, copy_into, fill, late, rare
from .flow import CompiledFlow
from .linear_algebra import SOLVED, STEEPEST, solve_pivoted
from .sparse import FINEST, FIRST, FLOOR, SHARE, sparse_iterate

ACCEPTED, REJECTED = 0, 1
MAX_ITERATIONS = 8
# sizes of corrections, each number over that of its unknown; tuned by hand, but for those that are round-off
ROUND_OFF = 4e-16  # a correction below this changes nothing
CONVERGED = 1e-10  # a correction below this that no longer shrinks is round-off of the equations: the root is found
QUADRATIC = 1e-8  # the same, of one that is a thousandth of the one before
MOST_LOST = 4.0  # linear systems that are not solved, after which a step is given up: each takes long
CHORD = 1e-2  # below this `newton` follows with a correction by the same factors, whose size tells the error left
QUICK = 0.3  # below this `quick` tries corrections with the factors that it has
SQUARED = 1e-11  # below this the error left is below round-off, for curvatures (error over correction^2) up to 1e6
CHORD_FLOOR = 1e-14  # a correction by old factors that no longer shrinks is round-off below this
NEGLIGIBLE = 1e-16  # predicted error that no further correction would change
SMALL_PIVOT = 1e-7  # a least pivot below this: the elimination is repeated with pivoting
# `foresee` extrapolates the roots of earlier steps
MOST_DEGREE = 8  # degree of the polynomial through the last roots at most; ...
ENOUGH_DEGREE = 1e-8  # ... it is raised while its highest difference is larger than this
NEAR_GUESS = 0.1  # of the size of an unknown: a guess farther from the last root is not taken
LEAST_CURVATURE = 1e-3  # least curvature believed: one correction may show that of one direction only
LEARNED = 1e-6  # as SQUARED, with a curvature that an earlier step has shown; ...
LEARNED_ROUGHLY = 1e-3  # ... where no more is asked of the root than what corrections leave: see compiled_loop.mended
SHOWN = 1e-17  # a second correction below this is round-off and shows no curvature
DOUBT = 1.25  # factor by which the curvature is assumed to grow in a step that does not show it

PLAIN_ITERATIONS = 20

TRACK_FIRST = 0.4  # first fraction of h after the whole step was rejected
TRACK_MIN = 1e-5
TRACK_TRIES = 400
TRACK_OFF = 0.9  # distance of an iterate from the prediction, over those between it and the last two roots
TRACK_ENOUGH = 1e-4  # predicted error of a root on the way: the next one begins from it, and nothing else


def set_step(flow: CompiledFlow, fraction: float) -> None:
    """Prepare the flow over this fraction of its step, from `start`."""
    flow.c[0] = fraction * flow.h
    call(flow.prologue, flow.start, flow.c, flow.w)


@rare
def stuck(flow: CompiledFlow) -> bool:
    """Is an equation with too steep a slope, in units of the unknowns, not solved? Newton's correction is 0 there."""
    scale = flow.inverse_sizes
    for i in range(flow.nx):
        steepest = 0.0
        for j in range(flow.nx):
            steepest = max(steepest, abs(flow.jacobian[i, j]) * (scale[i] / scale[j]))
        if steepest > STEEPEST and abs(flow.residual[i]) * scale[i] > SOLVED:
            return True
    return False


@rare
def largest_residual(flow: CompiledFlow, kernel: Address, x: Floats) -> float:
    """Scaled, at x, as this kernel gives it."""
    most = 0.0
    call(kernel, flow.w, x, flow.derivatives)
    for i in range(flow.nx):
        most = max(most, abs(flow.residual[i]) * flow.inverse_sizes[i])
    return most


def solved(flow: CompiledFlow, x: Floats) -> bool:
    """Are the equations at x, by what is left of them?"""
    return largest_residual(flow, flow.polish if flow.ns > 0 else flow.full, x) <= SOLVED


@late
def pivoted_correction(flow: CompiledFlow) -> float:
    """Newton correction into d[:nx] through the dense Jacobian; returns the sign of its determinant, 0: none."""
    n = flow.nx
    call(flow.full, flow.w, flow.x, flow.derivatives)
    if flow.steep and stuck(flow):
        return 0.0
    for i in range(n):
        flow.bordered[i, n] = -flow.residual[i]
        for j in range(n):
            flow.bordered[i, j] = flow.jacobian[i, j]
    sign = solve_pivoted(flow.bordered, n, n + 1)
    for i in range(n):
        flow.d[i] = flow.bordered[i, n]
    return sign


def finish(flow: CompiledFlow) -> int:
    """Increments of the state from the unknowns; REJECTED if it is not finite (a non-positive temperature, say)."""
    call(flow.finish, flow.w, flow.x, flow.dz)
    zero = 0.0  # 0 times anything that is not finite is NaN
    for i in range(flow.n):
        zero += 0.0 * flow.dz[i]
    return ACCEPTED if zero == 0.0 else REJECTED


def forget(flow: CompiledFlow) -> None:
    """What is known of earlier steps is of another run."""
    flow.foreseen.degree, flow.foreseen.near, flow.foreseen.curvature = 0, False, 0.0
    flow.foreseen.enough = 0.0
    flow.kept.made_in, flow.kept.cost, flow.kept.pause = 0.0, 0.0, 0.0
    flow.kept.stopped, flow.kept.slowest, flow.kept.noise = 0.0, 0.0, 0.0


@late
def foresee(flow: CompiledFlow) -> None:
    """From the root in x that of the next step, if it is near: where a polynomial through the last roots points to.

    One root says nothing of the next: at a large step Newton would find another root from there. The degree grows while
    the differences of the highest one shrink.
    """
    x, past = flow.x, flow.past
    degree = flow.foreseen.degree
    off, highest, last = 0.0, 0.0, 0.0
    for i in range(flow.nx):
        difference, before, ahead = x[i], 0.0, 0.0
        for k in range(degree):
            before = difference
            difference -= past[i, k]
            past[i, k] = before
            ahead += difference
        past[i, degree] = difference
        x[i] += ahead
        size = flow.inverse_sizes[i]
        off = max(off, abs(ahead) * size)
        highest = max(highest, abs(difference) * size)
        last = max(last, abs(before) * size)
    flow.foreseen.near = degree > 0 and off < NEAR_GUESS
    if highest < last or degree < 2:
        flow.foreseen.degree = min(degree + 1, MOST_DEGREE) if highest > ENOUGH_DEGREE else degree
    elif degree > 2:
        flow.foreseen.degree = degree - 1


@late
def quick(flow: CompiledFlow, guess: Floats) -> tuple[int, int]:
    """Shamanskii's form of Newton from a near guess, into x: after each iteration, corrections with its factors
    as long as they pay; returns (ACCEPTED or REJECTED, iterations).

    A correction with old factors costs half an iteration and shrinks the error by `contraction`, estimated from
    the corrections seen. Whatever is doubtful is rejected: the careful solvers begin again.
    """
    w, x, d = flow.w, flow.x, flow.d
    n = flow.nx
    previous, curvature = np.inf, flow.foreseen.curvature
    enough = max(NEGLIGIBLE, flow.foreseen.enough)
    small = SQUARED
    if curvature > 0.0:
        small = LEARNED if enough <= NEGLIGIBLE else LEARNED_ROUGHLY
    here = guess
    for iteration in range(1, MAX_ITERATIONS + 1):
        call(flow.iterate, w, here, d)
        delta = flow.size_and_least[0]
        # NaN fails every comparison; a small or negative pivot needs pivoting or is on the wrong side of a fold
        if not (delta <= 0.5 * previous and flow.size_and_least[1] > SMALL_PIVOT):
            return REJECTED, iteration
        for i in range(n):
            x[i] = here[i] + d[i]
        near = iteration > 1 or flow.foreseen.near
        if flow.steep and delta < ROUND_OFF and not near and not solved(flow, x):
            here, previous = x, 2.0 * ROUND_OFF  # where a slope is steep the next one will be larger
            continue
        if delta < small and curvature * delta * delta < enough:
            if flow.foresees:
                flow.foreseen.curvature *= DOUBT
            return finish(flow), iteration
        here = x
        last, bent, seen = delta, 0.0, False
        while last < QUICK:
            call(flow.polish, w, x, d)
            correction = flow.polished[0]
            bent = max(bent, correction)
            if flow.foresees and not seen:
                shown = 2.0 * max(correction, SHOWN) / max(delta, SQUARED) ** 2
                flow.foreseen.curvature = max(LEAST_CURVATURE, max(shown, 0.25 * flow.foreseen.curvature))
            if not correction < 0.1 * last:
                if correction < CHORD_FLOOR:
                    return finish(flow), iteration
                break
            for i in range(n):
                x[i] += d[i]
            likely = max(4.0 * correction / delta, correction / last if seen else 0.0)
            # the first correction does not show how its parts shrink: the one that curves most may be a small one
            contraction = likely if seen else max(likely, 0.25 * delta)
            last, seen = correction, True
            if contraction * correction < enough:
                return finish(flow), iteration
            if likely * likely * correction > enough:
                break
        # from z0 the first correction is the linearly implicit step, a guess as any other: the next may be as large
        previous, curvature = (2.0 * last if flow.foresees and not near else last), max(1.0, bent / (delta * delta))
    return REJECTED, MAX_ITERATIONS


@rare
def take_correction(flow: CompiledFlow, scale: Floats) -> tuple[float, float]:
    """x += d; returns the sum of d, which carries NaN and infinity that a maximum would drop, and the scaled size."""
    x, d = flow.x, flow.d
    total, delta = 0.0, 0.0
    for i in range(flow.nx):
        total += d[i]
        x[i] += d[i]
    for i in range(len(scale)):
        size = abs(d[i]) * scale[i]
        delta = size if size > delta else delta
    return total, delta


def polish(flow: CompiledFlow) -> float:
    """One correction with the factors of the last iterate, in place; returns its size."""
    call(flow.polish, flow.w, flow.x, flow.d)
    total, delta = take_correction(flow, flow.scale)
    return delta if abs(total) < np.inf else np.inf


def newton_correction(flow: CompiledFlow, tolerance: float, fresh: bool) -> tuple[float, float]:
    """Newton correction into d; returns the sign of its Jacobian's determinant and its smallest pivot, 0: none.

    Where that is small it comes from an elimination with pivoting, and polish() has no factors to use again. tolerance,
    fresh: of a sparse linear system.
    """
    if flow.ns > 0:
        return sparse_iterate(flow, tolerance, fresh), 0.0
    call(flow.iterate, flow.w, flow.x, flow.d)
    sign, smallest = 1.0, np.inf
    for i in range(flow.nx):
        pivot = flow.pivots[i]
        if pivot < 0.0:
            sign = -sign
        size = abs(pivot)
        smallest = size if size < smallest else smallest
    if smallest < SMALL_PIVOT:
        sign = pivoted_correction(flow)
    elif not flow.size_and_least[0] < np.inf:
        call(flow.full, flow.w, flow.x, flow.derivatives)
        sign = 0.0 if stuck(flow) else sign
    return sign, smallest


@rare
def newton(flow: CompiledFlow, enough: float, slope: float, careful: bool) -> tuple[int, int]:
    """Newton at fixed h from `x`, in place; returns (ACCEPTED or REJECTED, iterations), increments of the state in dz.

    enough : predicted error that ends it, NEGLIGIBLE for a root that is kept. slope : of the line through `old` and
    `last` on which it begins, and from which it must not leap; 0: there is none.
    Corrections are measured by delta = max |d_i| * scale_i. Rejected at once: a value that is not finite, a
    non-positive temperature, a negative determinant (a root on the wrong side of a fold), delta that does not halve.
    It ends where the next correction would be below round-off, by how the last one shrank, or where corrections near a
    root shrink no more. That one is small does not do: next to a spring of length l equations curve as 1/l. Sparse
    linear systems are solved as exactly as a correction deserves, with incomplete factors of the first.

    careful : else as textbooks have it, for comparison: every correction is taken in full, whatever its size and the
    sign of the determinant, until one is below 1e-10; it fails on a value that is not finite, or after 20 iterations.
    """
    x = flow.x
    most = MAX_ITERATIONS if careful else PLAIN_ITERATIONS
    previous, near, left = np.inf, False, FIRST if flow.ns > 0 else 0.0
    for iteration in range(1, most + 1):
        sign, smallest = newton_correction(flow, left if careful else FINEST, iteration == 1 or not careful)
        total, delta = take_correction(flow, flow.scale)
        if not (abs(total) < np.inf) or sign == 0.0:
            return REJECTED, iteration
        if not careful:
            if delta < CONVERGED:
                return finish(flow), iteration
            continue
        if sign < 0.0:
            return REJECTED, iteration
        for i in range(flow.npos):
            if not flow.temperatures[i] > 0.0:
                return REJECTED, iteration
        if flow.steep and delta < ROUND_OFF and iteration == 1 and not solved(flow, x):
            previous = 2.0 * ROUND_OFF  # as in `quick`
            continue
        if delta <= ROUND_OFF or (near and delta > 0.25 * previous):
            return finish(flow), iteration
        if delta > 0.5 * previous:
            return REJECTED, iteration
        contraction = delta / previous
        if slope > 0.0 and leaps(flow, slope):
            return REJECTED, iteration
        seen = previous < np.inf
        if flow.ns > 0:  # a linear system leaves what it may, beside what curves
            contraction = max(max(1.0, contraction / previous) * delta, left)
            left = max(FLOOR, min(FIRST, SHARE * delta))
        if seen and contraction * delta < enough:
            return finish(flow), iteration
        near = near or delta < CONVERGED or (seen and contraction < 1e-3 and delta < QUADRATIC)
        previous = delta
        if seen and contraction < 0.1 and delta < CHORD and smallest >= SMALL_PIVOT:
            previous = polish(flow)
            if max(contraction * contraction, previous / delta) * previous < enough:
                return finish(flow), iteration
    return (finish(flow) if near else REJECTED), most


@rare
def leaps(flow: CompiledFlow, slope: float) -> bool:
    """Is x far from the line through `old` and `last`, as a root on another branch is?

    Measured by sums of squares: they turn with the axes.
    """
    off, moved = 0.0, 0.0
    for i in range(flow.nx):
        step, last = (flow.x[i] - flow.last[i]) * flow.scale[i], (flow.last[i] - flow.old[i]) * flow.scale[i]
        off += (step - slope * last) ** 2
        moved += step * step + last * last
    return off > TRACK_OFF * TRACK_OFF * moved + TRACK_ENOUGH * TRACK_ENOUGH


@rare
def track(flow: CompiledFlow) -> tuple[int, int, int]:
    """Follow the root from h = 0 to h by natural continuation; returns (code, iterations, tries).

    Secant predictor in h; the increment doubles (or grows 1.2-fold after a hard solve) and shrinks to 0.4, also where
    Newton's iterates leave the line that was predicted: past a fold there are other roots.
    """
    x, old, last = flow.x, flow.old, flow.last
    n = flow.nx
    done, step = 0.0, TRACK_FIRST
    before = 0.0  # fraction of the root in `old`
    iterations = 0
    fill(last, 0.0)  # increments vanish at h = 0
    fill(old, 0.0)
    for attempt in range(1, TRACK_TRIES + 1):
        if step < TRACK_MIN or flow.kept.lost > MOST_LOST:
            return REJECTED, iterations, attempt
        target = min(1.0, done + step)
        set_step(flow, target)
        slope = (target - done) / (done - before) if done > before else 0.0
        for i in range(n):
            x[i] = last[i] + slope * (last[i] - old[i])
        code, count = newton(flow, TRACK_ENOUGH if target < 1.0 else NEGLIGIBLE, slope, True)
        iterations += count
        if code == ACCEPTED:
            if target >= 1.0:
                return ACCEPTED, iterations, attempt
            copy_into(old, last)
            copy_into(last, x)
            before, done = done, target
            step *= 2.0 if count <= 2 else 1.2
        else:
            step *= 0.4
    return REJECTED, iterations, TRACK_TRIES
