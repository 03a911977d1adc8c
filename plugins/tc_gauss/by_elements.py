"""The formulas of a large network: traced on one element for all, as loops; see `formulas.Formulas`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tcbench.compiler import derivatives as trace
from tcbench.compiler import spaces
from tcbench.compiler.kernels import Kernel
from tcbench.compiler.space_kernels import SCALAR, Slot, SpaceKernel, space_kernel
from tcbench.compiler.symbols import mixed_up
from tcbench.solver.patch import AGREE, TRIES, random_state, small_network
from tcbench.systems.network import Network, blocks, state_slots

from .formulas import iterated, noise_of, whole_formulas

ITERATED = (  # spaces of the values of each of `iterated`
    ("element",),
    ("element", "element"),
    ("position", "element"),
)


def formulas_of(network: Network) -> list[Kernel]:
    """Kernels start, motion, slopes, forces and mending of a network of any size."""
    net = network.by_spaces
    with trace.tracing():
        z = net.fresh_state("z")
        made = [_kernel(net, state_slots(z), _start(net, z))]
        for (inputs, values), kinds in zip(iterated(net), ITERATED, strict=True):
            slots = [Slot(x.space.name, x) for x in inputs[:: spaces.REPRESENTATIVES]]
            made.append(_kernel(net, slots, [Slot(k, x) for k, x in zip(kinds, blocks(values), strict=True)]))
        made.append(_kernel(net, state_slots(z), _unmended(net, z)))
    _compare(made, network.example)  # type: ignore[attr-defined]
    return [k.kernel(network.mesh) for k in made]


def _compare(made: Sequence[SpaceKernel], example: Network) -> None:
    """MixedSpaces where the kernels (but mending) are not those of the whole trace, on a part of the network."""
    small = small_network(example)
    n, e, rng = small.n_positions, small.n_elements, np.random.default_rng(0)
    with trace.tracing():
        whole = whole_formulas(small.symbolic, small.constant_symbols())
    c = small.constant_values
    states = (random_state(small, rng, attempt) for attempt in range(TRIES))
    z = next((z for z in states if z is not None), None)
    if z is None:
        raise mixed_up("no state was found at which its formulas have values")
    pi, theta = small.shapes(z), small.temperatures(z)
    motion = np.concatenate([z[n : 2 * n], z[:n]])
    inputs = [z, motion, np.concatenate([pi, z[2 * n :]]), np.concatenate([motion, rng.normal(size=e), theta])]
    for ours, theirs, x in zip(made, whole.kernels, inputs, strict=False):
        found, expected = ours.kernel(small.mesh)(x, c), theirs(x, np.concatenate([c, whole.setup(c, c)]))
        known = slice(None) if ours is not made[0] else slice(n + 2 * e + 2)  # of what is stiff there is no question
        gap = np.abs(found[known] - expected[known])
        if not np.all(gap <= AGREE * (1.0 + np.abs(expected[known]).max())):
            raise mixed_up("it gives something else on some elements than traced on one for all")


def _kernel(net: Network, slots: list[Slot], outputs: list[Slot]) -> Any:
    return space_kernel({"a": slots, "b": net.constant_slots()}, outputs)


def _start(net: Network, z: Any) -> list[Slot]:
    """As `formulas._start`, with nothing treated as stiff."""
    state, zero = net.state(z), trace.const(0.0)
    rate = blocks(list(net.vector_field(z)))[1:]
    energy = net.energy(z)
    found = [Slot("position", rate[0]), Slot("element", rate[1])]
    found.append(Slot("element", spaces.symmetric(list(net.shape(state.q)))))
    found += [Slot(SCALAR, trace.lifted(x)) for x in (energy, noise_of(net, z, energy), zero)]
    return [*found, Slot("element", zero), Slot("element", zero)]


def _unmended(net: Network, z: Any) -> list[Slot]:
    """As `formulas._mending` where that cannot be done: adaptive steps are solved to round-off instead."""
    momenta = net.momenta(z)
    numbers = [trace.const(np.inf), *(trace.lifted(x) for x in momenta)]
    return [Slot("position", trace.const(0.0)), *(Slot(SCALAR, x) for x in numbers)]
