"""The kernels of a flow on a `Network`, from a formula that is traced on one element for all of them.

As `flow_kernels`, with arrays in place of numbers. A formula that does not treat all entries alike is refused
(MixedSpaces) and traced as a whole; what is accepted is compared once, on a small network, with the whole trace.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import derivatives as trace
from ..compiler import spaces
from ..compiler.derivatives import Symbol, const
from ..compiler.kernels import Kernel, kernel
from ..compiler.sentences import mixed_up
from ..compiler.space_kernels import SCALAR, Mesh, Slot, SpaceKernel, space_kernel
from ..compiler.spaces import Term
from ..errors import TraceError
from ..integrator import Flow
from ..systems.network import Network, blocks, state_slots
from .elimination import ZERO_PIVOT
from .flow_kernels import FlowKernels, further, hoisted_values, traced
from .normal_rows import normalised
from .pattern import Pattern
from .reduction import Reduction, reduce

KINDS = ("position", "position", "element")  # blocks of a state
ENTRIES = "entries"


@dataclass(frozen=True)
class SpaceFlow:
    """A flow without a size: texts, and where the terms of the Jacobian belong."""

    opening: SpaceKernel
    iterate: SpaceKernel
    finish: SpaceKernel
    unknowns: tuple[str, ...]  # spaces of the blocks of unknowns
    which: tuple[int, ...]  # of each block its place among the blocks of increments, those of stages included
    terms: tuple[tuple[int, int, Term], ...]  # block of rows, block of columns, and which entries
    n_positive: int  # blocks of temperatures that have to be positive

    def kernels(self, mesh: Mesh) -> FlowKernels:
        """For a network of this mesh."""
        offsets = mesh.offsets([Slot(space, None) for space in self.unknowns])
        n = offsets[-1]
        pattern, places = self._pattern(mesh, offsets) if n else (None, [])
        sized = Mesh({**mesh.sizes, ENTRIES: pattern.nnz if pattern else 0}, mesh.maps)
        opening = self.opening.kernel(mesh)
        iterate = self.iterate.kernel(sized, places, extra=1)
        empty = kernel({}, [])
        positive = self.n_positive * mesh.sizes["element"]
        return FlowKernels(
            setup=empty, prologue=opening, opening=opening, iterate=iterate, polish=empty,
            finish=self.finish.kernel(mesh), full=iterate, n_unknowns=n, n_eliminated=0, n_positive=positive,
            pattern=pattern, way=(f"sparse: {n} unknowns" if n else "explicit") + ", in loops over the elements",
        )  # fmt: skip

    def _pattern(self, mesh: Mesh, offsets: Sequence[int]) -> tuple[Pattern, list[NDArray[np.int64]]]:
        rows, columns, valid = [], [], []
        for i, j, term in self.terms:
            r, c = (_along(mesh, term.over, path) for path in (term.rows, term.columns))
            fixed = _fixed(mesh, term.rows, r) | _fixed(mesh, term.columns, c)
            rows.append(offsets[i] + r)
            columns.append(offsets[j] + c)
            valid.append(~fixed)
        if not valid:
            raise TraceError(ZERO_PIVOT)
        good = np.concatenate(valid)
        pattern = Pattern(offsets[-1], np.concatenate(rows)[good], np.concatenate(columns)[good])
        if len(np.setdiff1d(pattern.diagonal, pattern.places)):
            raise TraceError(ZERO_PIVOT)
        behind = pattern.nnz + offsets[-1] + self.n_positive * mesh.sizes["element"]  # what fixed places get
        flat = np.full(len(good), behind, np.int64)
        flat[good] = pattern.places
        return pattern, np.split(flat, np.cumsum([len(v) for v in valid])[:-1])


def _along(mesh: Mesh, space: str, path: spaces.Path) -> NDArray[np.int64]:
    return mesh.along(path) if path else np.arange(mesh.sizes[space])


def _fixed(mesh: Mesh, path: spaces.Path, index: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Entries that lead to a fixed coordinate."""
    ends_in = path[-1].target if path else ""
    return index >= mesh.sizes["position"] if ends_in == "position" else np.zeros(len(index), bool)


def space_flow(flow: Flow, network: Network) -> SpaceFlow:
    """Trace, reduce and differentiate one flow; MixedSpaces where it does not do the same with all entries, or where
    its kernels are not what the whole trace gives on a small network."""
    from .patch import compare

    with trace.tracing():
        made = _space_flow(flow, network.symbolic.by_spaces)
    compare(made, flow, network.symbolic.example)
    return made


def _space_flow(flow: Flow, net: Network) -> SpaceFlow:
    h, z0 = trace.variable("h"), net.fresh_state("z")
    d = np.concatenate([net.fresh_state(f"d{k}") for k in range(1 + flow.stages)])
    y0 = net.in_variables(flow.variables, z0)
    start = np.concatenate([net.fresh_state(f"start{k}") for k in range(flow.memory or 2)])
    given = blocks(traced(flow, net, net.state(y0), d, h, further(flow, net, z0, h, start)))
    first = d[:: spaces.REPRESENTATIVES]
    rows = normalised(given, first, h, _own_slopes)
    reduction = reduce(rows, list(first), sweep=True)
    x = reduction.unknowns
    terms = spaces.jacobian_terms(reduction.rows, x)
    d_dh = spaces.along(reduction.rows, {h: const(1.0)})
    made = reduction.increments(first)[: len(KINDS)]
    both = [v for block in made for v in (block, spaces.twin(block))]
    y1 = net.state(np.asarray(y0) + np.array([*both, None], dtype=object)[:-1])
    dz = list(made)
    if flow.variables != "entropy":
        dz[2] = spaces.symmetric(list(net.entropy_increments(flow.variables, y0, y1)))
    positive = [spaces.symmetric(list(y1.s))] if flow.variables == "temperature" else []
    place = {s: i for i, s in enumerate(first)}
    kinds = [KINDS[place[s] % len(KINDS)] for s in x]
    flat = [(i, term, slope) for i, row in enumerate(terms) for term, slope in row.items()]
    slopes = [slope for _, _, slope in flat]
    sized = [_scale(place[s] % len(KINDS), net, z0, y0, flow.variables) for s in x]
    fixed = [*_start(reduction), *[const(0.0)] * len(x), *sized]
    hoisted = hoisted_values([*reduction.rows, *slopes, *d_dh, *positive, *dz], x)
    kept = [Slot(v.space.name if v.space else SCALAR, v) for v in hoisted]
    observed = np.asarray(net.observe(z0))
    seen, at = [], 0
    for space in net.output_spaces("observe", observed):
        seen.append(Slot(space, trace.lifted(observed[at])))
        at += 1 if space == SCALAR else spaces.REPRESENTATIVES
    constants = net.constant_slots()
    inputs = {"a": state_slots(z0), "b": [Slot(SCALAR, h), *constants[1:], *_states(start)]}
    opening = [Slot(k, v) for k, v in zip(kinds * 3, fixed, strict=True)]
    reads = {
        "a": [*(Slot(k, None) for k in kinds * 3), *kept],
        "b": [Slot(k, s) for k, s in zip(kinds, x, strict=True)],
    }
    out = [Slot(k, row) for k, row in zip(kinds, reduction.rows, strict=True)]
    out += [Slot(ENTRIES, None), *(Slot(k, v) for k, v in zip(kinds, d_dh, strict=True))]
    out += [Slot("element", v) for v in positive]
    columns = {s.number: i for i, s in enumerate(x)}
    return SpaceFlow(
        opening=space_kernel(inputs, [*opening, *kept, *seen]),
        iterate=space_kernel(reads, out, [(term, slope) for _, term, slope in flat], terms_at=len(x)),
        finish=space_kernel(reads, [Slot(k, v) for k, v in zip(KINDS, dz, strict=True)]),
        unknowns=tuple(kinds), which=tuple(place[s] for s in x),
        terms=tuple((i, columns[term.unknown.number], term) for i, term, _ in flat), n_positive=len(positive),
    )  # fmt: skip


def _own_slopes(rows: Sequence[Symbol], unknowns: Sequence[Symbol]) -> list[dict[int, Symbol]]:
    """Slopes of blocks by the entries of the same place, as `sparse_jacobian` has them."""
    place = {x.number: j for j, x in enumerate(unknowns)}
    terms = spaces.jacobian_terms(rows, list(unknowns))
    return [{place[t.unknown.number]: slope for t, slope in row.items() if not (t.rows or t.columns)} for row in terms]


def _states(flat: Any) -> list[Slot]:
    size = len(KINDS) * spaces.REPRESENTATIVES
    return [slot for k in range(0, len(flat), size) for slot in state_slots(flat[k : k + size])]


def _scale(block: int, net: Network, z0: Any, y0: Any, variables: str) -> Symbol:
    """1/size of a block of unknowns: of positions and momenta max(1, largest), else as `first_values.scales_of`."""
    two = spaces.REPRESENTATIVES
    if block < 2:
        largest = spaces.over_all("max", abs(z0[block * two]))
        return trace.reciprocal(trace.maximum(const(1.0), largest))
    if variables == "temperature":
        return trace.reciprocal(y0[2 * two])
    size = trace.lifted(np.ravel(net.entropy_scale() * np.ones(two))[0])
    return trace.reciprocal(size * net.temperatures(z0)[0] if variables == "energy" else size)


def _start(reduction: Reduction) -> list[Symbol]:
    """Unknowns for which the eliminated increments vanish: Newton from z1 = z0. As `flow_kernels`."""
    x, zero = reduction.unknowns, const(0.0)
    start = dict.fromkeys(x, zero)
    for formula in reduction.eliminated.values():
        (found,) = spaces.jacobian_terms([formula], x)
        if len(found) == 1 and all(not term.rows and not term.columns for term in found):
            ((term, slope),) = found.items()
            (offset,) = trace.substitute([formula], dict.fromkeys(x, zero))
            start[term.unknown] = trace.neg(trace.mul(offset, trace.reciprocal(slope)))
    return [start[s] for s in x]


__all__ = ["Kernel", "SpaceFlow", "mixed_up", "space_flow"]
