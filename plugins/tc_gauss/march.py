"""Steps of consistent collocation (collocate.py): fixed ones, and adaptive ones that hold the defect to a tolerance."""

from __future__ import annotations

import math

import numpy as np

from tcbench.compiler.jit import call, compiled, copy_into, fill, inlined, lean
from tcbench.solver.linear_algebra import add_compensated

from . import formulas as kernels
from .memory import MEND, N_E, N_Q, STAGES, START, unpack
from .step import COARSE, CONVERGED, FAILED, HALVED, REJECTED_STEPS, SOLVED, STEPS, extrapolate, try_step

SHORTEST = 2.0**-24  # of a step, before it is given up
SAFETY, GROW, SHRINK, ACCEPT = 0.85, 2.0, 0.2, 4.0
BEST = 0.135  # contraction for which a unit of time costs least: it grows as h^2, and h log(1/h^2) is largest at e^-2
RETREAT, ADVANCE = 0.7, 1.1  # of a step that is too long for the quadrature, and of the bound after steps that failed
FIRST = 4.0  # times the decay time of the conduction: see first_step
# levels of quadrature, and choices; as numpy's numbers, since numba would compile try_step for each of Python's
COARSEST, ON_VECTORS, ALL = np.int64(0), np.int64(kernels.ON_VECTORS), np.int64(len(kernels.POINTS))
NO, YES = np.bool_(False), np.bool_(True)
FAR = 2.5  # ratio of steps up to which the last polynomials are extrapolated


@inlined
def error_estimate(plan, w, h):  # type: ignore[no-untyped-def]
    """h times the largest defect of the derivative's polynomial at both ends; stiff parts are damped by the flow."""
    n, e = plan[N_Q], plan[N_E]
    decay = w.start[n + 2 * e + 2]
    first = n + 2 * e + 3
    largest = 0.0
    for side in range(2):
        known = w.start if side == 0 else w.end
        here = 2 * n + e + side * (n + e)
        stiff = 0.0
        for i in range(n):
            r = abs(w.sums[here + i] - known[i]) * w.scale[0]
            largest = r if not r <= largest else largest
        for i in range(e):
            stiff += w.start[first + e + i] * (w.sums[here + n + i] - known[n + i])
        stiff = stiff / decay if decay < 0.0 else 0.0
        for i in range(e):
            part = w.start[first + i] * stiff
            r = abs(w.sums[here + n + i] - known[n + i] - part) + abs(part) / (1.0 - h * decay)
            largest = r if not r <= largest else largest
    return h * largest


@inlined
def set_scale(plan, w, z):  # type: ignore[no-untyped-def]
    """1/(1 + |p|) for forces, 1 for entropies."""
    largest = 0.0
    for i in range(plan[N_Q], 2 * plan[N_Q]):
        largest = max(largest, abs(z[i]))
    w.scale[0], w.scale[1] = 1.0 / (1.0 + largest), 1.0


@lean
def halving_step(plan, a, w, h, z0, dz_total, counts):  # type: ignore[no-untyped-def]
    """Increments of one step of length h; a step without a solution in reach is taken in halves."""
    z, carry = w.z, w.carry
    copy_into(z, z0)
    fill(dz_total, 0.0)
    fill(carry, 0.0)
    call(plan[START], z, w.c, w.start)
    done, part = 0.0, 1.0
    while done < 1.0:
        set_scale(plan, w, z)
        code = try_step(plan, a, w, part * h, z, NO, YES, COARSEST, ALL, CONVERGED, counts)
        if code != SOLVED:
            part *= 0.5
            counts[HALVED] += 1
            if part < SHORTEST:
                return FAILED
            continue
        counts[STEPS] += 1
        add_compensated(dz_total, w.dz, carry)
        for i in range(len(z)):
            z[i] = z0[i] + dz_total[i]
        copy_into(w.start, w.end)
        done += part
        while part < 1.0 and done % (2.0 * part) == 0.0:  # both halves are done
            part *= 2.0
    return SOLVED


@inlined
def first_step(plan, w, tolerance):  # type: ignore[no-untyped-def]
    """A length for the first step: a part of the decay of the conduction, where that is far from its equilibrium."""
    n, e = plan[N_Q], plan[N_E]
    h = 0.5 * tolerance ** (1.0 / (plan[STAGES] + 1))
    fastest = -w.start[n + 2 * e + 2]
    heat = 0.0
    for i in range(n, n + e):
        heat = max(heat, abs(w.start[i]))
    return min(h, FIRST * h / fastest) if fastest > 0.0 and heat > tolerance * fastest else h


@inlined
def remember_laws(plan, w, z):  # type: ignore[no-untyped-def]
    """Note the energy and the invariants of a state, which the ends of all steps are given."""
    n, size = plan[N_Q], len(z)
    copy_into(w.laws, z)
    call(plan[MEND], w.laws, w.c, w.mended)  # for the invariants of z, which stand last
    w.run[0] = w.start[n + 2 * plan[N_E]]
    for i in range(len(w.mended) - n - 1):
        w.laws[size + 2 + i] = w.mended[n + 1 + i]


@lean
def adaptive_steps(plan, a, w, z0, times, tolerance, residual, states, counts):  # type: ignore[no-untyped-def]
    """States at `times` from z0; SOLVED or FAILED. The steps are chosen so that the defect stays at the tolerance, and
    are solved to the residual."""
    k = plan[STAGES]
    z, carry = w.z, w.carry
    copy_into(z, z0)
    fill(carry, 0.0)
    call(plan[START], z, w.c, w.start)
    remember_laws(plan, w, z)
    copy_into(states[0], z)
    t, h, last = times[0], 0.0, 0.0
    # for which the iteration converges, and the coarsest quadrature keeps the energy, as far as is known
    longest, roughest = math.inf, math.inf
    for row in range(1, len(times)):
        while t < times[row]:
            set_scale(plan, w, z)
            if h == 0.0:
                h = min(times[row] - t, first_step(plan, w, tolerance))
            left = times[row] - t
            step = left if left <= 1.01 * h else min(h, 0.5 * left) if left < 2.0 * h else h
            known = last > 0.0 and step <= FAR * last
            if known:
                extrapolate(plan, a, w, step / last)
            code = try_step(plan, a, w, step, z, known, NO, COARSEST + (step > roughest), ON_VECTORS, residual, counts)
            if code == SOLVED:
                error = error_estimate(plan, w, step)
                factor = SAFETY * (tolerance / max(error, 1e-300)) ** (1.0 / (k + 1))
                factor = min(factor, math.sqrt(BEST / max(w.seen[0], 1e-3)))
            if code != SOLVED or not error <= ACCEPT * tolerance:
                counts[REJECTED_STEPS] += 1
                h = step * (0.4 if code == FAILED else RETREAT if code == COARSE else max(SHRINK, factor))
                longest = h if code != SOLVED else longest
                last = 0.0
                if not h > 1e-12 * max(1.0, abs(t)):
                    return FAILED
                continue
            counts[STEPS] += 1
            add_compensated(z, w.dz, carry)
            copy_into(w.start, w.end)
            t = times[row] if step == left else t + step
            last = step
            h = max(h, step * factor) if step < h and factor >= 1.0 else step * min(GROW, factor)
            roughest = step * RETREAT if step <= roughest and w.seen[1] > 0.0 else roughest * ADVANCE
            longest *= ADVANCE
            h = min(h, longest)
        copy_into(states[row], z)
    return SOLVED


@compiled
def fixed_steps(plan, memory, at, h, z0, increments, counts):  # type: ignore[no-untyped-def]
    """Increments of as many steps as there are rows, or of those before the first without a solution; how many."""
    a, w = unpack(plan, memory, at)
    copy_into(w.here, z0)
    fill(w.dropped, 0.0)
    for i in range(len(increments)):
        if halving_step(plan, a, w, h, w.here, increments[i], counts) != SOLVED:
            return i
        add_compensated(w.here, increments[i], w.dropped)
    return len(increments)


@compiled
def adaptive(plan, memory, at, z0, times, tolerance, residual, states, counts):  # type: ignore[no-untyped-def]
    a, w = unpack(plan, memory, at)
    return adaptive_steps(plan, a, w, z0, times, tolerance, residual, states, counts)
