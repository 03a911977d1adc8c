"""Which invariants a step of L DE + M DS keeps by itself, between any two states; and which a method has to hold.

DJ . (L DE + M DS) vanishes identically where J is quadratic and DE is as invariant as E: evaluated between random
states, with random constants, it is round-off then.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..compiler import derivatives as trace
from ..compiler.derivatives import Symbol, const
from ..compiler.library import evaluate
from ..systems.state import blocks_of
from ..systems.system import System
from .mending import product

SAMPLES, TRIES = 3, 30  # states at which the laws and their slopes are numbers; random ones among which there are these
KEPT = 1e-9  # of the terms: so much less is round-off, the cancellation of differences included


def to_hold(system: System) -> tuple[str, ...]:
    """Names of the invariants that a move along slopes has to hold, of a system with symbols for constants: none where
    all are kept by themselves; else those that are not, then the others, without what follows from those before."""
    kept, gradients = _sampled(system)
    return () if kept.all() else _independent(system.invariant_names, kept, gradients)


def independent_invariants(system: System) -> tuple[str, ...]:
    """The same of a method that keeps none by itself: all but what follows from the others, energy and entropy."""
    return _independent(system.invariant_names, *_sampled(system))


def _sampled(system: System) -> tuple[Any, list[Any]]:
    """Which invariants are kept by themselves, (m,); gradients of E, S and each at some random states, (m + 2, n)."""
    names, net = system.invariant_names, system.by_arrays if system.large else system
    if not names:
        return np.ones(0, bool), []
    with trace.tracing():
        z0, z1 = net.unknowns("x"), net.unknowns("y")
        DE, DS = net.discrete_gradients(z0, z1)
        mid = (z0 + z1) / 2
        v = net.reversible(mid, DE, DS) + net.irreversible(mid, DE, DS)
        found = [x for DJ in net.momenta_discrete_gradients(z0, z1) for x in (product(net, DJ, v), size(net, DJ, v))]
        slopes = [net.gradient(z0), net.entropy_gradient(z0), *net.momenta_gradients(z0)]
        kernel: Any = net.compiled([z0, z1], [*found, *slopes])
        kernel = kernel.kernel(system.mesh) if system.large else kernel
    rng, kept, gradients = np.random.default_rng(0), np.ones(len(names), bool), list[Any]()
    out, end = np.zeros(kernel.size), 2 * len(names)
    for k in range(TRIES):
        states = rng.uniform(0.5, 1.5, 2 * system.size)
        evaluate(kernel.address, states, rng.uniform(0.5, 1.5, system.n_constant_values), out)
        if not np.isfinite(out).all() and k < TRIES - SAMPLES + len(gradients):
            continue
        kept &= np.abs(out[:end:2]) <= KEPT * out[1:end:2]
        gradients.append(out[end : end + (2 + len(names)) * system.size].reshape(-1, system.size).copy())
        if len(gradients) == SAMPLES:
            break
    return kept, gradients


def _independent(names: Sequence[str], kept: Any, gradients: Sequence[Any]) -> tuple[str, ...]:
    held, rows = [], [0, 1]
    for k in np.argsort(kept, kind="stable"):
        if not all(_follows(each[rows], each[2 + k]) for each in gradients):
            held.append(names[k])
            rows.append(2 + k)
    return tuple(held)


def _follows(rows: Any, row: Any) -> bool:
    """Is a slope made of others?"""
    if not np.all(np.isfinite([*rows, row])):
        return False
    left = row - rows.T @ np.linalg.lstsq(rows.T, row, rcond=None)[0]
    return bool(np.abs(left).max() <= KEPT * np.abs(row).max())


def size(system: System, x: Any, y: Any) -> Symbol:
    """The size of the terms of x . y."""
    pairs = zip(blocks_of(system, x), blocks_of(system, y), strict=True)
    return sum((trace.lifted(np.sum(abs(a * b))) for a, b in pairs), const(0.0))
