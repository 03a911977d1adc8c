"""Newton-like iterations for a sparse Jacobian J (n, n), with the incomplete LU factors of an earlier step kept on.

At usual steps h, J = I + O(h) hardly changes from step to step, and its ILU(0) factors are nearly its LU factors. So
x <- x - (LU)^-1 R(x) is iterated with old factors as long as it contracts; else come new factors, then `newton`. One
such correction costs a fifth of a Jacobian with new factors. In the restricted Python.
"""

from __future__ import annotations

import numpy as np

from ..compiler.language import call, copy_into, late, rare
from .flow import CompiledFlow
from .newton import ACCEPTED, CONVERGED, NEGLIGIBLE, REJECTED, finish, newton
from .sparse import SOLUTION, backward, forward, incomplete_factors

POOR = 0.15  # contraction by incomplete factors, above which Newton with whole corrections costs less
CHORD_ROUND_OFF = 1e-13  # a correction with them that no longer shrinks is round-off below this, ...
NOISY = 4.0  # ... or below so many times what whole corrections made of a root where such ones had stopped
LEFT = 1e-17  # predicted error: what many steps leave with one sign is still below the round-off of their energies
SHOWN = 0.9  # of the contraction that earlier steps have shown: first corrections do not show how their parts shrink
MOST_CHORDS = 20  # corrections with incomplete factors
RENEWAL = 5.0  # of them cost as much as a Jacobian and its factors
PAUSED = 20.0  # steps in which they are not tried, once they have failed


@late
def quick_sparse(flow: CompiledFlow) -> tuple[int, int]:
    """`newton.quick` where the Jacobian is sparse."""
    n, kept = flow.nx, flow.kept
    copy_into(flow.x, flow.guess)
    copy_into(flow.scale, flow.inverse_sizes)
    if kept.pause > 0.0:
        kept.pause -= 1.0
        return newton(flow, NEGLIGIBLE, 0.0, True)
    code, count = by_old_factors(flow)
    if code == ACCEPTED:
        return code, count
    kept.made_in, kept.pause = 0.0, PAUSED
    copy_into(flow.last, flow.x)
    copy_into(flow.x, flow.guess)
    code, more = newton(flow, NEGLIGIBLE, 0.0, True)
    if code == ACCEPTED and kept.stopped < CONVERGED:
        off = 0.0
        for i in range(n):
            off = max(off, abs(flow.x[i] - flow.last[i]) * flow.inverse_sizes[i])
        if off < kept.stopped:  # they had found the root: what they stopped at is round-off
            kept.noise, kept.pause = max(kept.noise, kept.stopped), 0.0
    return code, count + more


@rare
def by_old_factors(flow: CompiledFlow) -> tuple[int, int]:
    """Corrections with incomplete factors alone, of this or of an earlier step; returns (ACCEPTED or REJECTED, how
    many). New ones are made where the old ones contract poorly, or have cost as much in further corrections."""
    x, d, kept, solution, n, order = flow.x, flow.derivatives, flow.kept, flow.krylov[SOLUTION], flow.nx, flow.order
    scale = flow.inverse_sizes
    new, made, floor = kept.made_in == 0.0, 0, max(CHORD_ROUND_OFF, NOISY * kept.noise)
    previous, slowest, kept.stopped = np.inf, SHOWN * kept.slowest, 0.0
    for iteration in range(1, MOST_CHORDS + 1):
        behind = n
        if new:
            call(flow.iterate, flow.w, x, d)
            behind += flow.nnz
            if not incomplete_factors(flow):
                return REJECTED, iteration
            new, made, previous = False, iteration, np.inf
        else:
            call(flow.polish, flow.w, x, d)
        for i in range(behind, behind + flow.npos):
            if not d[i] > 0.0:
                return REJECTED, iteration
        for i in range(n):
            solution[i] = forward(flow, i, -d[order[i]], solution)
        total, delta = 0.0, 0.0
        for i in range(n - 1, -1, -1):
            at, step = order[i], backward(flow, i, solution)
            solution[i] = step
            if at >= flow.n_own:
                continue  # as in `corrected`
            size = abs(step) * scale[at]
            delta = size if size > delta else delta
            total += step
            x[at] += step
        if flow.steep and iteration == 1 and delta < CONVERGED:
            new = True  # as in `newton.quick`
            continue
        kept.stopped = delta if delta > 0.5 * previous else 0.0
        if not (abs(total) < np.inf and delta <= max(previous, floor)):
            return REJECTED, iteration
        slowest = max(slowest, delta / previous if previous > 0.0 else 0.0)  # 0/0 at rest
        stalled = delta > POOR * previous
        if not stalled:
            kept.slowest = slowest
        if stalled and delta > floor:
            if made > 0:
                return REJECTED, iteration
            new, slowest = True, 0.0
        elif stalled or (previous < np.inf and slowest * delta < LEFT):
            if made > 0:
                kept.made_in, kept.cost = iteration - made + 1, 0.0
            else:
                kept.cost += max(0.0, iteration - kept.made_in)
                kept.made_in = kept.made_in if kept.cost < RENEWAL else 0.0
            return finish(flow), iteration
        previous = delta
    return REJECTED, MOST_CHORDS
