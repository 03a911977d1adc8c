"""The compiled time loop: flows one after the other, observables in the same pass, nothing allocated per step."""

from __future__ import annotations

import numpy as np

from ..compiler.jit import call, copy_into, inlined, lean
from ..solver.continuation import COLD_ROOT, FOUND, LOST, UNDETERMINED, arc
from ..solver.linear_algebra import move
from ..solver.newton import (
    ACCEPTED,
    FULL,
    NE,
    NOW,
    NX,
    OPENING,
    PROLOGUE,
    REJECTED,
    finish,
    newton,
    plain_newton,
    quick,
    track,
)

# why a run ended (Trajectory turns these into statuses and sentences)
OK, NONCONVERGED, NO_ROOT, NONFINITE, COLLAPSED, COLD, BLOWUP, NO_WARM_ROOT, FOLDED = range(9)

# entries of the summary, filled over completed steps
(
    ENERGY_ERROR,
    SUM_T,
    SUM_TT,
    SUM_E,
    SUM_TE,
    ENTROPY_MIN,
    VIOLATIONS,
    FIRST_FALL,
    LYAPUNOV_MAX,
    RESIDUAL_MAX,
    ITERATIONS,
    RETRIED,
    TRACKED,
    TRACK_TRIES_SUM,
    ARCS,
    FOLDS,
    AUDITED,
    WRONG_ROOTS,
    MOMENTA,
) = range(19)  # fmt: skip  (MOMENTA and following: largest departure of each invariant)

# entries of the limits (float64)
V0, REFERENCE, ENTROPY_TOLERANCE, ENTROPY_FALL, LIMITS_SIZE = range(5)

# entries of the shape (int64)
(
    N_POSITIONS, N_ELEMENTS, N_INVARIANTS, OBSERVE, CONTINUE, RESIDUALS, RECORD_EVERY, AUDIT, OF_STEP, SHAPE_SIZE,
) = range(10)  # fmt: skip

# what follows the arc at every step: the audit counts accepted roots that are not the principal one; the other two take
# the arc's root itself, and the last ends the run at the first fold
NO_AUDIT, COUNT_WRONG, PRINCIPAL, STOP_AT_FOLD = range(4)
SAME_ROOT = 1e-6  # scaled distance below which two roots are one

E, S, FIRST_INVARIANT = 0, 1, 2  # in a row of observables


@lean
def solve_flow(  # type: ignore[no-untyped-def]
    flow, z0, dz, c, h, limits, shape, w, x, scale, d, full, old, known, accepted, seen, points, A, summary, solved
):
    """Increments dz of one flow of one step from z0; returns (OK or why there are none, Newton iterations).

    solved: `quick` has done it, and its root, in x, is only to be audited.
    """
    n = flow[NX]
    c[0] = h
    call(flow[PROLOGUE], z0, c, w)
    for i in range(n + flow[NE]):
        scale[i] = w[2 * n + i]
    code, total = ACCEPTED if solved else REJECTED, 0
    if shape[AUDIT] >= PRINCIPAL or solved:
        pass  # the arc's root, whatever Newton would find
    elif shape[CONTINUE]:
        copy_into(x[:n], w[:n])  # z1 = z0
        code, total = newton(flow, w, x[:n], scale, d, full, dz)
        if code == ACCEPTED:
            summary[RETRIED] += 1
        else:
            code, count, tries = track(flow, z0, dz, c, h, w, x[:n], scale, d, full, old[:n], known[:n])
            total += count
            summary[TRACKED] += 1
            summary[TRACK_TRIES_SUM] += tries
    else:
        copy_into(x[:n], w[:n])
        code, total = plain_newton(flow, w, x[:n], scale, d, full, dz)
    reason = OK if code == ACCEPTED else NONCONVERGED
    if (code != ACCEPTED and shape[CONTINUE]) or shape[AUDIT] != NO_AUDIT:
        reason, count = by_arc(
            flow,
            z0,
            dz,
            c,
            h,
            limits,
            shape,
            w,
            x[:n],
            scale,
            d,
            full,
            old[:n],
            accepted,
            seen,
            points[:, : n + 1],
            A[: n + 1, : n + 3],
            summary,
            reason,
        )
        total += count
    return reason, total


@lean
def by_arc(  # type: ignore[no-untyped-def]
    flow, z0, dz, c, h, limits, shape, w, x, scale, d, full, old, accepted, seen, points, A, summary, reason
):
    """The arc's root into x and dz; returns (OK, FOLDED or why there is none, Jacobians).

    Where plain Newton gave up, or a root was accepted and is being audited, the arc's answer is only counted: x, dz and
    `reason` stay as they were. An arc that is undetermined proves nothing: such a root does not count as audited.
    """
    copy_into(old, x)
    copy_into(accepted, dz)
    code, jacobians, folds = arc(
        flow, z0, dz, c, h, w, x, scale, d, full, shape[OBSERVE], limits[REFERENCE], limits[V0], seen, points, A
    )
    summary[FOLDS] += folds
    if shape[AUDIT] >= PRINCIPAL or (reason != OK and shape[CONTINUE]):
        summary[ARCS] += 1
        if folds > 0 and shape[AUDIT] == STOP_AT_FOLD:
            return FOLDED, jacobians
        if code == FOUND:
            summary[AUDITED] += shape[AUDIT] == COUNT_WRONG  # the principal root by construction
            return OK, jacobians
        if code == LOST:
            return NO_ROOT, jacobians
        return (NO_WARM_ROOT if code == COLD_ROOT else NONCONVERGED), jacobians
    if reason == OK and code != UNDETERMINED:
        summary[AUDITED] += 1
        wrong = code != FOUND
        for i in range(flow[NX]):
            if abs(old[i] - x[i]) * scale[i] > SAME_ROOT:
                wrong = True
        if wrong:
            summary[WRONG_ROOTS] += 1
    copy_into(x, old)
    copy_into(dz, accepted)
    return reason, 0


@lean
def accumulate(step, h, now, before, first, limits, shape, summary):  # type: ignore[no-untyped-def]
    """Add one completed step to the summary."""
    t = step * h
    error = now[E] - first[E]
    summary[ENERGY_ERROR] = max(summary[ENERGY_ERROR], abs(error))
    summary[SUM_T] += t
    summary[SUM_TT] += t * t
    summary[SUM_E] += error
    summary[SUM_TE] += t * error
    rise = now[S] - before[S]
    summary[ENTROPY_MIN] = min(summary[ENTROPY_MIN], rise)
    if rise < -limits[ENTROPY_TOLERANCE] * max(1.0, abs(now[S])):
        summary[VIOLATIONS] += 1
    if rise < -limits[ENTROPY_FALL] and summary[FIRST_FALL] == 0.0:
        summary[FIRST_FALL] = step
    lyapunov = (now[E] - before[E]) - limits[REFERENCE] * rise
    summary[LYAPUNOV_MAX] = max(summary[LYAPUNOV_MAX], lyapunov)
    for i in range(shape[N_INVARIANTS]):
        departure = abs(now[FIRST_INVARIANT + i] - first[FIRST_INVARIANT + i])
        summary[MOMENTA + i] = max(summary[MOMENTA + i], departure)


@lean
def verdict(z, now, first, limits, shape):  # type: ignore[no-untyped-def]
    """Why the run cannot go on from this state, or OK."""
    temperatures = FIRST_INVARIANT + shape[N_INVARIANTS]
    zero, least = 0.0, np.inf  # 0 times anything that is not finite is NaN
    for i in range(len(z)):
        zero += 0.0 * z[i]
    for i in range(len(now)):
        zero += 0.0 * now[i]
    for i in range(temperatures, len(now)):
        least = now[i] if now[i] < least else least
    if zero == 0.0 and least > 0.0:
        return BLOWUP if abs(now[E] - first[E]) > limits[V0] else OK
    for i in range(len(z)):
        if not abs(z[i]) < np.inf:
            return NONFINITE
    for i in range(shape[N_ELEMENTS]):
        if not now[temperatures + i] > 0.0:
            return COLD
        if not now[temperatures + shape[N_ELEMENTS] + i] > 0.0:
            return COLLAPSED
    return NONFINITE


@inlined
def judge(step, z, now, h, limits, shape, observables, summary):  # type: ignore[no-untyped-def]
    """Judge the state after a step, of which the observables are `now`; returns (why the run ends or OK, steps).

    A state that is not admissible (its energy need not exist) does not count as completed.
    """
    reason = verdict(z, now, observables[0], limits, shape)
    if reason != OK and reason != BLOWUP:
        return reason, step - 1
    accumulate(step, h, now, observables[1], observables[0], limits, shape, summary)
    copy_into(observables[1], now)
    return reason, step


@lean
def monitor(first, rows, c, h, limits, shape, observables, states, records, summary):  # type: ignore[no-untyped-def]
    """`judge` for states that come from Python, of step `first` and the next, up to one that ends the run.

    They are observed here, if there is a kernel for that; if not, observables[2] holds those of the only row.
    """
    reason, done = OK, first - 1
    for i in range(len(rows)):
        if shape[OBSERVE]:
            call(shape[OBSERVE], rows[i], c, observables[2])
        reason, done = judge(first + i, rows[i], observables[2], h, limits, shape, observables, summary)
        if done == first + i:
            row = (done - 1) // shape[RECORD_EVERY] + 1  # of the last record kept up to date: it may be the last state
            copy_into(states[row], rows[i])
            copy_into(records[row], observables[2])
        if reason != OK:
            break
    return reason, done


@lean
def open_step(flows, fractions, z, c, h, works, of_step):  # type: ignore[no-untyped-def]
    """Prologue of the first flow and the observables of z, in one kernel: they share their logarithms."""
    if of_step:  # the start of the whole step: behind the constants, before the first state
        for i in range(len(z)):
            c[len(c) - 2 * len(z) + i] = z[i]
    c[0] = fractions[0] * h
    call(flows[0, OPENING], z, c, works[0])


@lean
def measure_residual(flow, w, x, full, summary):  # type: ignore[no-untyped-def]
    """Keep the largest scaled residual of an accepted step."""
    call(flow[FULL], w, x, full)
    n = flow[NX]
    for i in range(n):
        summary[RESIDUAL_MAX] = max(summary[RESIDUAL_MAX], abs(full[i]) * w[2 * n + i])


@inlined
def one_step(  # type: ignore[no-untyped-def]
    flows, fractions, z, carry, c, h, limits, shape, summary,
    works, x, d, dz, a, trial, scale, full, old, known, accepted, seen, points, A,
):  # fmt: skip
    """All flows from `z` + `carry`, opened, to `a` + `trial`; returns (OK or why there is no step, iterations)."""
    iterations = 0
    here, dropped = z, carry
    for k in range(len(flows)):
        flow, w = flows[k], works[k]
        n = flow[NX]
        if k > 0:
            c[0] = fractions[k] * h
            call(flow[PROLOGUE], a, c, w)
            here, dropped = a, trial
        if n == 0:  # explicit
            if finish(flow, w, x, dz) != ACCEPTED:
                return NONFINITE, iterations
            move(here, dropped, dz, a, trial)
            continue
        code, count = REJECTED, 0
        if shape[CONTINUE] and shape[AUDIT] < PRINCIPAL:
            for i in range(n):
                x[i] = w[n + i]
            code, count = quick(flow, w, x, d, dz)
            iterations += count
        if code != ACCEPTED or shape[AUDIT] != NO_AUDIT:
            reason, count = solve_flow(
                flow, here, dz, c, fractions[k] * h, limits, shape, w, x, scale, d, full, old, known,
                accepted, seen, points, A, summary, code == ACCEPTED,
            )  # fmt: skip
            iterations += count
            if reason != OK:
                return reason, iterations
        if shape[RESIDUALS]:
            measure_residual(flow, w, x, full, summary)
        move(here, dropped, dz, a, trial)
    return OK, iterations


@lean
def march(  # type: ignore[no-untyped-def]
    flows, fractions, z, carry, c, h, start, stop, limits, shape, observables, states, records, counts, summary,
    works, x, d, dz, a, trial, scale, full, old, known, accepted, seen, points, A,
):  # fmt: skip
    """Steps start+1 .. stop from `z` + `carry`, in place; returns (why it ended, completed steps).

    observables: rows (first, before); counts: Newton iterations since the last record. The last line of arguments is
    workspace: works[k] belongs to flow k and holds what the prologue hoists.
    """
    now = works[0, flows[0, NOW] : flows[0, NOW] + observables.shape[1]]
    every = shape[RECORD_EVERY]
    row, left = start // every, every - start % every  # the last full record, and steps to the next
    reason, done = OK, start
    home, home_carry = z, carry
    open_step(flows, fractions, z, c, h, works, shape[OF_STEP])
    for step in range(start + 1, stop + 1):
        reason, iterations = one_step(
            flows, fractions, z, carry, c, h, limits, shape, summary,
            works, x, d, dz, a, trial, scale, full, old, known, accepted, seen, points, A,
        )  # fmt: skip
        summary[ITERATIONS] += iterations
        if reason != OK:
            break
        open_step(flows, fractions, a, c, h, works, shape[OF_STEP])
        reason, done = judge(step, a, now, h, limits, shape, observables, summary)
        if done == step:
            counts[row] += iterations
            z, a, carry, trial = a, z, trial, carry
            left -= 1
            if left == 0:
                row, left = row + 1, every
                copy_into(states[row], z)
                copy_into(records[row], now)
        if reason != OK:
            break
    if left < every and done > start:  # the last completed state is a record, too
        copy_into(states[row + 1], z)
        copy_into(records[row + 1], observables[1])
    copy_into(home, z)
    copy_into(home_carry, carry)
    return reason, done
