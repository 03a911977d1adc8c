"""Which invariants a step of L DE + M DS keeps by itself, between any two states; for methods that hold the others.

DJ . (L DE + M DS) vanishes identically where J is quadratic and DE is as invariant as E: evaluated between random
states, with random constants, it is round-off then.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiler import derivatives as trace
from ..compiler.derivatives import Symbol, const
from ..compiler.library import evaluate
from ..systems.state import blocks_of
from ..systems.system import System
from .mending import product

SAMPLES = 3
KEPT = 1e-9  # of the terms: so much less is round-off, the cancellation of differences included


def lost_invariants(system: System) -> tuple[str, ...]:
    """Names of those that are not kept by themselves, of a system with symbols for constants."""
    names = system.invariant_names
    if not names:
        return ()
    net: Any = system.by_arrays if system.large else system
    with trace.tracing():
        z0, z1 = net.unknowns("x"), net.unknowns("y")
        DE, DS = net.discrete_gradients(z0, z1)
        mid = (z0 + z1) / 2
        v = net.reversible(mid, DE, DS) + net.irreversible(mid, DE, DS)
        found = [x for DJ in net.momenta_discrete_gradients(z0, z1) for x in (product(net, DJ, v), size(net, DJ, v))]
        kernel = net.compiled([z0, z1], found)
        if system.large:
            kernel = kernel.kernel(system.mesh)
    rng, kept = np.random.default_rng(0), np.ones(len(names), bool)
    for _ in range(SAMPLES):
        one = rng.uniform(0.5, 1.5, (2, system.size))
        with np.errstate(all="ignore"):
            out = np.empty(kernel.size)
            evaluate(kernel.address, one.ravel(), rng.uniform(0.5, 1.5, system.n_constant_values), out)
            kept &= np.abs(out[: 2 * len(names) : 2]) <= KEPT * out[1 : 2 * len(names) : 2]
    return tuple(name for name, fine in zip(names, kept, strict=True) if not fine)


def size(system: System, x: Any, y: Any) -> Symbol:
    """The size of the terms of x . y."""
    pairs = zip(blocks_of(system, x), blocks_of(system, y), strict=True)
    return sum((trace.lifted(np.sum(abs(a * b))) for a, b in pairs), const(0.0))
