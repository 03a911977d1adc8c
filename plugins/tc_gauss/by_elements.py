"""The formulas of a large system of elements, traced on arrays; see `formulas.Formulas`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tcbench.compiler import derivatives as trace
from tcbench.compiler.array_kernels import array_kernel
from tcbench.compiler.array_mesh import Block
from tcbench.compiler.array_states import Blocks
from tcbench.compiler.arrays import NUMBER
from tcbench.compiler.kernels import Kernel

from .formulas import iterated, noise_of


def formulas_of(system: Any) -> list[Kernel]:
    """Kernels start, motion, slopes, forces and mending of a system of any size."""
    net = system.by_arrays
    with trace.tracing():
        z = net.fresh_state("z")
        bodies = [(z.blocks, _start(net, z)), *iterated(net), (z.blocks, _unmended(net, z))]
        made = [_kernel(net, *body) for body in bodies]
    return [k.kernel(system.mesh) for k in made]


def _kernel(net: Any, inputs: Sequence[Any], outputs: Sequence[Any]) -> Any:
    constants = [Block(NUMBER, (None,)), *net.constant_blocks()]
    return array_kernel({"a": net.blocks(Blocks(inputs)), "b": constants}, net.blocks(Blocks(outputs)))


def _start(net: Any, z: Any) -> list[Any]:
    """As `formulas._start`, with nothing treated as stiff."""
    rate, energy, still = net.vector_field(z), net.energy(z), 0.0 * z.s
    return [rate.p, rate.s, net.shape(z.q), energy, noise_of(net, z, energy), trace.const(0.0), still, still]


def _unmended(net: Any, z: Any) -> list[Any]:
    """As `formulas._mending` where that cannot be done: adaptive steps are solved to round-off instead."""
    return [0.0 * z.q, trace.const(np.inf), *net.momenta(z)]
