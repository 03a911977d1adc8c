"""The compiled time loop: flows one after the other, observables in the same pass, nothing allocated per step."""

from __future__ import annotations

import numpy as np

from .jit import call, compiled
from .newton import (
    ACCEPTED,
    FULL,
    ND,
    NW,
    NX,
    PROLOGUE,
    REJECTED,
    finish,
    newton,
    set_scale,
    track,
)

# why a run ended (Trajectory turns these into statuses and sentences)
OK, NONCONVERGED, NO_ROOT, NONFINITE, COLLAPSED, COLD, BLOWUP = range(7)

# entries of the summary, filled over completed steps
(
    ENERGY_ERROR, SUM_T, SUM_TT, SUM_E, SUM_TE, ENTROPY_MIN, VIOLATIONS, FIRST_FALL, LYAPUNOV_MAX, RESIDUAL_MAX,
    ITERATIONS, RETRIED, TRACKED, TRACK_TRIES_SUM, MOMENTA,
) = range(15)  # fmt: skip  (MOMENTA and following: largest departure of each invariant)

# entries of the limits (float64)
V0, REFERENCE, ENTROPY_TOLERANCE, ENTROPY_FALL, LIMITS_SIZE = range(5)

# entries of the shape (int64)
N_POSITIONS, N_ELEMENTS, N_INVARIANTS, OBSERVE, CONTINUE, RESIDUALS, RECORD_EVERY, SHAPE_SIZE = range(8)

E, S, FIRST_INVARIANT = 0, 1, 2  # in a row of observables


@compiled
def solve_flow(flow, blocks, z0, dz, c, h, shape, w, x, scale, d, full, old, summary):  # type: ignore[no-untyped-def]
    """Increments dz of one flow of one step from z0; returns (code, Newton iterations)."""
    n = flow[NX]
    c[0] = h
    call(flow[PROLOGUE], z0, c, w)
    if n == 0:  # explicit
        return finish(flow, w, x, dz), 0
    set_scale(flow, blocks, z0, w, shape[N_POSITIONS], scale)
    total = 0
    code = REJECTED
    if shape[CONTINUE]:
        x[:n] = 0.0  # the explicit drift: nearer than z0, and it saves an iteration
        code, total = newton(flow, w, x[:n], scale, d, full, dz)
    if code != ACCEPTED:
        for i in range(n):
            x[i] = w[i]  # z1 = z0
        code, count = newton(flow, w, x[:n], scale, d, full, dz)
        total += count
        if shape[CONTINUE] and code == ACCEPTED:
            summary[RETRIED] += 1
    if code != ACCEPTED and shape[CONTINUE]:
        code, count, tries = track(flow, z0, dz, c, h, w, x[:n], scale, d, full, old[:n])
        total += count
        summary[TRACKED] += 1
        summary[TRACK_TRIES_SUM] += tries
    if code != ACCEPTED:
        return code, total
    if shape[RESIDUALS]:
        call(flow[FULL], w, x, full)
        for i in range(n):
            summary[RESIDUAL_MAX] = max(summary[RESIDUAL_MAX], abs(full[i]) * scale[i])
    return ACCEPTED, total


@compiled
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


@compiled
def verdict(z, now, first, limits, shape):  # type: ignore[no-untyped-def]
    """Why the run cannot go on from this state, or OK."""
    for value in z:
        if not abs(value) < np.inf:
            return NONFINITE
    temperatures = FIRST_INVARIANT + shape[N_INVARIANTS]
    for i in range(shape[N_ELEMENTS]):
        if not now[temperatures + i] > 0.0:
            return COLD
        if not now[temperatures + shape[N_ELEMENTS] + i] > 0.0:
            return COLLAPSED
    for value in now:
        if not abs(value) < np.inf:
            return NONFINITE
    if abs(now[E] - first[E]) > limits[V0]:
        return BLOWUP
    return OK


@compiled
def add_compensated(z, dz, carry):  # type: ignore[no-untyped-def]
    """z += dz, with what rounding drops kept in `carry` (Neumaier): momenta stay exact over thousands of steps."""
    for i in range(len(z)):
        term = dz[i] + carry[i]
        total = z[i] + term
        back = total - z[i]
        carry[i] = (z[i] - (total - back)) + (term - back)
        z[i] = total


@compiled
def monitor(step, z, c, h, limits, shape, observables, states, records, summary):  # type: ignore[no-untyped-def]
    """Observe, judge and record the state after a step; returns (why the run ends or OK, completed steps).

    A state that is not finite does not count as completed. The row of the last record is kept up to date, so that
    the last completed state is always there.
    """
    call(shape[OBSERVE], z, c, observables[2])
    reason = verdict(z, observables[2], observables[0], limits, shape)
    if reason == NONFINITE:
        return reason, step - 1
    accumulate(step, h, observables[2], observables[1], observables[0], limits, shape, summary)
    observables[1] = observables[2]
    row = (step - 1) // shape[RECORD_EVERY] + 1
    states[row] = z
    records[row] = observables[2]
    return reason, step


@compiled
def march(  # type: ignore[no-untyped-def]
    flows, fractions, blocks, z, carry, c, h, start, stop, limits, shape, observables, states, records, counts, summary
):
    """Steps start+1 .. stop from `z` + `carry`, in place; returns (why it ended, completed steps).

    observables: rows (first, before, now); counts: Newton iterations since the last record.
    """
    size = most = longest = 0
    for k in range(len(flows)):
        size = max(size, flows[k, NX])
        most = max(most, flows[k, NW])
        longest = max(longest, flows[k, ND])
    w, d = np.empty(most), np.empty(longest)
    x, old, scale = np.empty(size), np.empty(size), np.empty(longest)
    full = np.empty(size * size + 2 * size)
    a, dz, trial = z.copy(), np.empty_like(z), np.empty_like(z)
    for step in range(start + 1, stop + 1):
        iterations = 0
        a[:] = z
        trial[:] = carry
        for k in range(len(flows)):
            code, count = solve_flow(
                flows[k], blocks, a, dz, c, fractions[k] * h, shape, w, x, scale, d, full, old, summary
            )
            iterations += count
            if code != ACCEPTED:
                summary[ITERATIONS] += iterations
                return NONCONVERGED, step - 1
            add_compensated(a, dz, trial)
        summary[ITERATIONS] += iterations
        reason, done = monitor(step, a, c, h, limits, shape, observables, states, records, summary)
        if done == step:
            counts[(step - 1) // shape[RECORD_EVERY]] += iterations
            z[:] = a
            carry[:] = trial
        if reason != OK:
            return reason, done
    return OK, stop


