"""The principal root of one implicit flow: pseudo-arclength continuation in (x, h) from (0, 0), through folds.

The roots x(eta h) of the residual, 0 <= eta, form a curve that starts at x = 0, eta = 0. Where the curve first reaches
eta = 1 lies THE root of the step. Let J be the Jacobian by x and B = [J, dR/d eta; t] the matrix bordered with the
tangent t of the curve. By Cramer's rule the eta-component of t is det J / det B up to a positive factor, and det B does
not change sign on a regular curve. Hence, counting folds (sign changes of the eta-component) from the start, where both
are positive: det J > 0 after an even number of folds, when eta grows, and det J < 0 after an odd number, when it falls.
To reach eta = 1 for the first time is to reach it from below, so the principal root has det J > 0 whatever the number
of folds on the way, and Newton's rule that rejects det J < 0 never rejects it. (If eta = 1 is exactly on a fold, det J
is 0 and two roots merge.) A curve that comes back to eta near 0 does so with det J < 0 and x far from 0, because x = 0
is the only finite root at eta = 0: that branch has no root at eta = 1, the principal one is lost.

On the way back the momenta grow like 1/eta and the midpoint of a spring collapses. A spring whose force depends on its
temperature has a tiny length of equilibrium there, about which the curve may turn within 1e-8 of its size, to sheets of
spurious roots with that spring collapsed. What passes such a point and is not back within the steps allowed is lost as
well, provided that on the way back its exergy rose by ten times the scenario's V0. A TC method cannot be called lost
that way: each of its roots has V(z1) <= V(z0).

A step of a method that keeps both laws has a root for every h (docs/physics.md, section 8). Where its curve cannot be
followed, because a weak spring collapses at the start of it and the curve turns within less than double precision can
tell, `detour` follows others: the roots of R(x, eta h) + (1 - eta) b, with some vector b, a push that lets the spring
swing past its end. They begin at the one root of R(x, 0) + b, end at the same equations, and what was said of signs
holds for them: where one of them first reaches eta = 1, det J > 0. Whether the method is of this kind is seen from the
root that is found, never from what it claims: one that breaks a law is no root of such a step, and is not taken.

Unknowns are scaled as in Newton's stopping test, u = (x * scale, eta); nothing is allocated inside the loops.
"""

from __future__ import annotations

import numpy as np

from ..compiler.language import Floats, call, copy_into, fill, rare
from .flow import CompiledFlow
from .linear_algebra import solve_pivoted
from .newton import ACCEPTED, NEGLIGIBLE, newton, set_step
from .sparse import FINEST, sparse_bordered, sparse_iterate

FOUND, UNDETERMINED, LOST, COLD_ROOT = range(4)

COARSE, MEDIUM, FINE = 0.2, 0.05, 0.01  # predictor error over step: a lost branch is confirmed at all three
ARC_STEPS = 3000
NEAR_ZERO = 1e-2  # eta, over the highest that was reached, at which a branch that has turned back counts as lost
ON_CURVE = 1e-7  # corrector's last correction (less where steps are short): its square is what is left
SMALLEST = 1e-12  # step over 1 + |u|: turns are as sharp as a collapsing spring is short
RUN_AWAY = 10.0  # rise of the exergy over V0 after which a falling branch is on spurious sheets
CORRECTIONS = 6
FIRST_STEP = 0.25
BISECTIONS = 40
DETOURS = 24
LAWFUL_ROOT = 1e-7  # energy and entropy of a root of a method with both laws, and next to a collapsed spring


@rare
def linearise(flow: CompiledFlow, v: Floats, t: Floats) -> float:
    """At v: the Newton correction perpendicular to t in `correction` and the tangent, not normalised, in `direction`.

    Returns the sign of det B; B has t as its last row.
    """
    A, scale = flow.bordered, flow.scale
    n = flow.nx
    m = n + 1
    for i in range(n):
        flow.x[i] = v[i] / scale[i]
    set_step(flow, v[n])
    if flow.ns > 0:
        return sparse_bordered(flow, t, v[n])
    call(flow.full, flow.w, flow.x, flow.derivatives)
    for i in range(n):
        for j in range(n):
            A[i, j] = flow.jacobian[i, j] / scale[j]
        A[i, n] = flow.by_h[i] * flow.h - flow.shift[i]
        A[i, m] = -(flow.residual[i] + (1.0 - v[n]) * flow.shift[i])
        A[i, m + 1] = 0.0
    copy_into(A[n], t)
    A[n, m] = 0.0
    A[n, m + 1] = 1.0
    sign = solve_pivoted(A, m, m + 2)
    for i in range(m):
        flow.correction[i], flow.direction[i] = A[i, m], A[i, m + 1]
    return sign


def tangent(flow: CompiledFlow, t: Floats) -> float:
    """The tangent that `linearise` left in `direction`, normalised, into t.

    Returns its cosine with the tangent that borders the matrix: the product of that one with the column is 1.
    """
    norm = 0.0
    for i in range(len(t)):
        norm += flow.direction[i] ** 2
    cosine = float(1.0 / np.sqrt(norm))
    for i in range(len(t)):
        t[i] = flow.direction[i] * cosine
    return cosine


@rare
def correct(flow: CompiledFlow, v: Floats, t: Floats, limit: float, close: float) -> tuple[float, int]:
    """Newton from the predicted point v, in place, perpendicular to t; `direction` as `linearise` leaves it.

    Converged when a correction is below `close`, rejected when one is beyond `limit`. Returns (first correction,
    iterations); the first correction is infinite when the step must be shortened.
    """
    n = flow.nx
    first, previous = np.inf, np.inf
    for iteration in range(1, CORRECTIONS + 1):
        sign = linearise(flow, v, t)
        delta, total = 0.0, 0.0
        for i in range(n + 1):
            step = flow.correction[i]
            total += abs(step) + abs(flow.direction[i])
            delta = abs(step) if abs(step) > delta else delta
            v[i] += step
        if sign <= 0.0 or not (total < np.inf) or delta > limit or delta > 0.5 * previous:
            return np.inf, iteration
        if iteration == 1:
            first = delta
        if delta < close:
            return first, iteration
        previous = delta
    return np.inf, CORRECTIONS


def hermite(a: float, b: float, slope_a: float, slope_b: float, ds: float, s: float) -> float:
    """Cubic in the fraction s of the step ds, through a and b with these slopes."""
    r = 1.0 - s
    return r * r * (1.0 + 2.0 * s) * a + s * s * (3.0 - 2.0 * s) * b + ds * s * r * (r * slope_a - s * slope_b)


def first_crossing(u: Floats, v: Floats, t: Floats, t_new: Floats, cosine: float, ds: float) -> float:
    """Fraction of the step at which eta reaches 1 on the interpolating cubic; negative if it does not."""
    n = len(u) - 1
    low, high = 0.0, 1.0
    if v[n] < 1.0:
        if t[n] <= 0.0 or t_new[n] >= 0.0:
            return -1.0
        highest = 0.0
        for k in range(1, 32):  # a fold inside the step: does its top pass eta = 1?
            eta = hermite(u[n], v[n], t[n], t_new[n] / cosine, ds, k / 32.0)
            if eta > highest:
                highest, high = eta, k / 32.0
        if highest < 1.0:
            return -1.0
    for _ in range(BISECTIONS):
        s = 0.5 * (low + high)
        if hermite(u[n], v[n], t[n], t_new[n] / cosine, ds, s) < 1.0:
            low = s
        else:
            high = s
    return high


def land(flow: CompiledFlow, cosine: float, ds: float, s: float) -> tuple[int, int]:
    """Newton at eta = 1 from the interpolated point; returns (FOUND, COLD_ROOT or UNDETERMINED, iterations).

    The root is in x and the increments of the state in dz. A root farther off than the step belongs to another sheet.
    """
    x, scale, n = flow.x, flow.scale, flow.nx
    u, v, t, t_new = flow.points[0], flow.points[1], flow.points[2], flow.points[3]
    set_step(flow, 1.0)
    for i in range(n):
        x[i] = hermite(u[i], v[i], t[i], t_new[i] / cosine, ds, s) / scale[i]
    if flow.ns > 0:
        sparse_iterate(flow, FINEST, True)
    else:
        call(flow.iterate, flow.w, x, flow.d)
    for i in range(flow.npos):
        if not flow.temperatures[i] > 0.0:
            return COLD_ROOT, 1
    code, iterations = newton(flow, NEGLIGIBLE, 0.0, True)
    if code != ACCEPTED:
        return UNDETERMINED, iterations
    for i in range(n):
        if abs(x[i] * scale[i] - hermite(u[i], v[i], t[i], t_new[i] / cosine, ds, s)) > 0.5 * ds:
            return UNDETERMINED, iterations
    return FOUND, iterations


@rare
def observe_ends(flow: CompiledFlow) -> None:
    """Energy and entropy at the start and at the unknowns x (w is at their h) into `seen`; leaves z1 in dz."""
    z1, seen = flow.dz, flow.seen
    call(flow.finish, flow.w, flow.x, z1)
    for i in range(flow.n):
        z1[i] += flow.start[i]
    call(flow.observe, flow.start, flow.c, seen[0])
    call(flow.observe, z1, flow.c, seen[1])


@rare
def exergy_rise(flow: CompiledFlow, v: Floats) -> float:
    """V(z1) - V(z0) at the point v of the curve (w is at its h); NaN where z1 has no temperatures."""
    seen = flow.seen
    for i in range(flow.nx):
        flow.x[i] = v[i] / flow.scale[i]
    observe_ends(flow)
    return float((seen[1, 0] - seen[0, 0]) - flow.reference * (seen[1, 1] - seen[0, 1]))


@rare
def lawful(flow: CompiledFlow) -> bool:
    """Does the root in x keep the energy, and not lower the entropy? Its increments are in dz."""
    seen = flow.seen
    observe_ends(flow)
    call(flow.finish, flow.w, flow.x, flow.dz)
    energy, entropy = float(seen[0, 0]), float(seen[0, 1])
    kept = abs(seen[1, 0] - energy) <= LAWFUL_ROOT * (flow.least_energy + abs(energy))
    return kept and float(seen[1, 1]) - entropy >= -LAWFUL_ROOT * (flow.least_entropy + abs(entropy))


@rare
def follow(flow: CompiledFlow, tolerance: float, shifted: bool) -> tuple[int, int, int]:
    """Follow the curve once, at one tolerance; returns (code, Jacobians, folds). shifted: that of a detour."""
    n = flow.nx
    u, v, t, t_new = flow.points[0], flow.points[1], flow.points[2], flow.points[3]
    fill(u, 0.0)
    fill(t, 0.0)
    t[n] = 1.0
    jacobians, folds, run_away = 1, 0, False
    if linearise(flow, u, t) <= 0.0:
        return UNDETERMINED, jacobians, folds
    if shifted or flow.constrained:
        first, jacobians = correct(flow, u, t, np.inf, ON_CURVE)
        if not first < np.inf or linearise(flow, u, t) <= 0.0:
            return UNDETERMINED, jacobians, folds
    tangent(flow, t)
    ds, size, highest = FIRST_STEP * tolerance / COARSE, 0.0, 0.0
    for _ in range(ARC_STEPS):
        if not ds > SMALLEST * (1.0 + size):
            break
        for i in range(n + 1):
            v[i] = u[i] + ds * t[i]
        close = max(min(ON_CURVE, 1e-3 * ds), 1e-14 * (1.0 + size))
        first, count = correct(flow, v, t, tolerance * ds, close)
        jacobians += count
        if not first < np.inf:
            ds *= 0.4
            continue
        cosine = tangent(flow, t_new)
        if cosine < 1.0 - 4.0 * tolerance * tolerance:
            ds *= 0.5
            continue
        s = first_crossing(u, v, t, t_new, cosine, ds)
        if s >= 0.0:
            code, count = land(flow, cosine, ds, s)
            jacobians += count
            if code != UNDETERMINED:
                return code, jacobians, folds
            if v[n] >= 1.0 or ds > 1e-6:  # a fold that only touches eta = 1 is passed by in the end
                ds *= 0.4
                continue
        if (t_new[n] > 0.0) != (t[n] > 0.0):
            folds += 1
        size = 0.0
        for i in range(n + 1):
            u[i], t[i] = v[i], t_new[i]
            size = max(size, abs(u[i]))
        highest = max(highest, u[n])  # not 1: where h is long, everything happens at small eta
        if folds % 2 == 1:
            if u[n] < NEAR_ZERO * highest:
                return LOST, jacobians, folds
            rise = exergy_rise(flow, u)
            run_away = run_away or rise > RUN_AWAY * flow.bound
        ds *= min(2.0, max(0.5, 0.6 * tolerance * ds / (first + 1e-300)))
        ds = min(ds, 2.5 * tolerance * (1.0 + size))
    return (LOST if run_away else UNDETERMINED), jacobians, folds


@rare
def arc(flow: CompiledFlow) -> tuple[int, int, int]:
    """The principal root of the flow over its step, into x, and its increments into dz; (code, Jacobians, folds).

    FOUND; LOST: the branch turns back for good, at all three tolerances; COLD_ROOT: the root has a non-positive
    temperature; UNDETERMINED otherwise. The flow is prepared for its whole step on return.
    """
    total, lost, folds = 0, 0, 0
    for level in range(3):
        tolerance = COARSE if level == 0 else MEDIUM if level == 1 else FINE
        code, jacobians, folds = follow(flow, tolerance, False)
        total += jacobians
        if code in (FOUND, COLD_ROOT):
            return code, total, folds
        if code == LOST:
            lost += 1
    set_step(flow, 1.0)
    return (LOST if lost == 3 else UNDETERMINED), total, folds


@rare
def detour(flow: CompiledFlow) -> tuple[int, int]:
    """A lawful root of the flow over its step where `arc` is undetermined; (FOUND or UNDETERMINED, Jacobians)."""
    total, found = 0, UNDETERMINED
    for attempt in range(1, DETOURS + 1):
        size = 0.1 * 2.0 ** (attempt % 6)  # of b, beside the unknowns; its directions are as good as random
        for i in range(flow.nx):
            flow.shift[i] = size * np.cos(1.7 * attempt * (i + 1.0) + 0.4 * attempt) / flow.scale[i]
        code, jacobians, _ = follow(flow, MEDIUM, True)
        total += jacobians
        if code == FOUND:
            found = FOUND if lawful(flow) else UNDETERMINED
            break
    fill(flow.shift, 0.0)
    if found != FOUND:
        set_step(flow, 1.0)
    return found, total
