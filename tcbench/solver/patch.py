"""A flow traced on one element for all, compared with the whole trace on a small network.

Some formulas look alike for all entries and are not: a mean that divides by the number of representatives, a length
that is used as a number. Their kernels would be wrong without a word.
"""

from __future__ import annotations

import uuid
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import derivatives as trace
from ..compiler.derivatives import const
from ..compiler.formula_hash import formula_hash
from ..compiler.kernels import namespace, straight_line
from ..compiler.library import evaluate
from ..compiler.sentences import MixedSpaces
from ..integrator import Flow
from ..systems.network import Network
from ..systems.same_for_all import AGREE, TRIES, random_state, small_network
from .flow_kernels import further, traced
from .normal_rows import normalised
from .reduction import reduce

PARTS = ("residual", "Jacobian", "slope in h", "new state", "energy")  # that are compared

Floats = NDArray[np.float64]
_COMPARED: set[tuple[str, ...]] = set()


def compare(made: Any, flow: Flow, example: Network) -> None:
    """Raise MixedSpaces where the kernels of a `SpaceFlow` are not what the whole trace of the flow gives."""
    hashed = formula_hash(flow.residual) or uuid.uuid4().hex
    texts = (hashed, made.opening.text, made.iterate.text, made.finish.text, repr(made.terms), repr(made.which))
    if texts in _COMPARED:
        return
    small = small_network(example)
    whole = _Whole(flow, small, made)
    rng = np.random.default_rng(0)
    for attempt in range(TRIES):
        z0 = random_state(small, rng, attempt)
        if z0 is None:
            continue
        found = _by_loops(made, small, z0, flow, rng)
        expected = whole(*found.inputs)
        if all(np.all(np.isfinite(x)) for x in expected):
            for name, x, y in zip(PARTS, found.results, expected, strict=True):
                if x.shape != y.shape or not np.all(np.abs(x - y) <= AGREE * (1.0 + np.abs(y).max(initial=0.0))):
                    raise MixedSpaces(
                        f"{flow.residual.__name__!r} gives another {name} on {len(small.elements)} elements than "
                        "traced on one element for all"
                    )
            _COMPARED.add(texts)
            return
    raise MixedSpaces(f"no state was found at which {flow.residual.__name__!r} has a value")


class _Result:
    def __init__(self, inputs: tuple[Floats, ...], results: list[Floats]) -> None:
        self.inputs, self.results = inputs, results


def _by_loops(made: Any, small: Network, z0: Floats, flow: Flow, rng: np.random.Generator) -> _Result:
    """Residual, Jacobian, d residual/dh and z1 - z0 by the kernels that any size uses, at random unknowns."""
    h, kernels = 0.05, made.kernels(small.mesh)
    n, pattern = kernels.n_unknowns, kernels.pattern
    later = [z0 + 1e-3 * rng.normal(size=len(z0)) for _ in range(flow.memory or 2)]
    c = np.concatenate([[h], small.constant_values[1:], *later])
    w = np.zeros(kernels.opening.size)
    evaluate(kernels.opening.address, z0, c, w)
    x = 1e-2 * rng.normal(size=n) / w[2 * n : 3 * n]
    out = np.zeros(kernels.iterate.size)
    evaluate(kernels.iterate.address, w, x if n else w, out)
    jacobian = np.zeros((n, n))
    if pattern is not None:
        rows = np.repeat(np.arange(n), np.diff(pattern.first))
        jacobian[pattern.order[rows], pattern.order[pattern.columns]] = out[n : n + pattern.nnz]
    nnz = pattern.nnz if pattern is not None else 0
    dz = np.zeros(small.size)
    evaluate(kernels.finish.address, w, x if n else w, dz)
    seen = w[kernels.opening.size - (2 + len(small.invariant_names) + 2 * small.n_elements) :]
    return _Result((z0, c, x), [out[:n], jacobian, out[n + nnz : 2 * n + nnz], dz, seen])


class _Whole:
    """The same by the whole trace, run as Python."""

    def __init__(self, flow: Flow, small: Network, made: Any) -> None:
        sym, n, m = small.symbolic, small.n_positions, small.n_elements
        size = small.size
        first = [0, n, 2 * n]
        with trace.tracing():
            h, z0 = trace.variable("h"), trace.variables("z", size)
            d = trace.variables("d", size * (1 + flow.stages))
            start = trace.variables("start", size * (flow.memory or 2))
            y0 = sym.in_variables(flow.variables, z0)
            rows = normalised(traced(flow, sym, y0, d, h, further(flow, sym, z0, h, start)), d, h)
            index = [
                size * (block // 3) + first[block % 3] + i
                for block in made.which for i in range(m if block % 3 == 2 else n)
            ]  # fmt: skip
            kept = {d[i] for i in index}
            reduction = reduce(rows, list(d), sweep=True, only={s for s in d if s not in kept})
            if set(reduction.unknowns) != kept:
                raise MixedSpaces("other unknowns are eliminated than in the whole trace")
            row_of = dict(zip(reduction.unknowns, reduction.rows, strict=True))
            x = [d[i] for i in index]
            ordered = [row_of[s] for s in x]
            slopes = trace.jacobian(ordered, x) if x else np.zeros((0, 0), dtype=object)
            by_h = [row.get(0, const(0.0)) for row in trace.sparse_jacobian(ordered, [h])]
            increments = np.array(reduction.increments(d), dtype=object)[:size]
            if flow.variables != "entropy":
                ds = sym.entropy_increments(flow.variables, y0, sym.state(np.asarray(y0) + increments))
                increments = np.concatenate([increments[: 2 * n], ds])
            inputs = {s: f"a[{i}]" for i, s in enumerate([*z0, *x])}
            inputs |= {h: "b[0]", **sym.constant_symbols()}
            at = len(small.constant_values)
            inputs |= {s: f"b[{at + i}]" for i, s in enumerate(start)}
            outputs = [trace.lifted(v) for v in [*ordered, *slopes.ravel(), *by_h, *increments, *sym.observe(z0)]]
            scope = dict(namespace())
            exec(compile(straight_line(inputs, outputs), "<whole>", "exec"), scope)
        self.run, self.count, self.n, self.size = scope["kernel"], len(outputs), len(x), size

    def __call__(self, z0: Floats, c: Floats, x: Floats) -> list[Floats]:
        out, n = np.zeros(self.count), self.n
        with np.errstate(all="ignore"):
            self.run(np.concatenate([z0, x]), c, out)
        parts = np.split(out, np.cumsum([n, n * n, n, self.size]))
        return [parts[0], parts[1].reshape(n, n), *parts[2:]]


__all__ = ["AGREE", "TRIES", "compare", "random_state", "small_network"]
