"""Brings the rows of a residual into one order, sign and scale, whichever its author chose.

"The function whose root is z1" has many forms: z0 + h f - z1, (z1 - z0)/h - f, the blocks in another order, mixtures of
rows. At h = 0 they all say A (z1 - z0) = 0. The solvers rely on A being the identity or near it: determinants are
positive at h = 0, small pivots are suspicious, a row gives its own unknown. So rows are ordered and scaled by A.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np

from ..errors import TraceError
from . import derivatives as trace
from . import symbols
from .array_jacobian import jacobian_terms
from .derivatives import Symbol, const

Slopes = list[dict[int, Symbol]]  # of each row: place of an unknown -> slope
MIXED = 64  # unknowns up to which linear combinations of rows are resolved


def normalised(rows: Sequence[Symbol], unknowns: Iterable[Symbol], h: Symbol) -> list[Symbol]:
    """The equations in the order of their unknowns, each with a positive slope by its own at h = 0.

    Rows that are in this form stay as they are.
    """
    unknowns = list(unknowns)
    moving = trace.depends_on(rows, unknowns)
    rows = [cancelled(_without_factors(row, moving)) for row in rows]
    slopes = _at_zero(rows, unknowns, h)
    if slopes is None:  # h is a divisor
        multiplied = [cancelled(_times(row, h)) for row in rows]
        slopes = _at_zero(multiplied, unknowns, h)
        if slopes is None:
            return rows
        rows = multiplied
    order = _matched(slopes)
    if order is None:  # at h = 0 an unknown is not determined: the rows stay as written
        return rows
    slopes = [slopes[i] for i in order]
    scaled = [_scaled(rows[i], slopes[j][j]) for j, i in enumerate(order)]
    return _unmixed(scaled, slopes)


def _without_factors(row: Symbol, moving: Collection[int]) -> Symbol:
    """The one factor of a product that depends on the unknowns, which has to vanish."""
    while row.op in ("mul", "neg"):
        factors = [a for a in row.args if a.number in moving]
        if len(factors) != 1:
            break
        (row,) = factors
    return row


def _terms(row: Symbol, sign: int = 1) -> list[tuple[int, Symbol]]:
    """The row as a sum: (1 or -1, term), in the author's order."""
    terms, waiting = [], [(sign, row)]
    while waiting:
        sign, node = waiting.pop()
        if node.op in ("add", "sub"):
            waiting.append((-sign if node.op == "sub" else sign, node.args[1]))
            waiting.append((sign, node.args[0]))
        elif node.op == "neg":
            waiting.append((-sign, node.args[0]))
        else:
            terms.append((sign, node))
    return terms


def _total(terms: Sequence[tuple[int, Symbol]]) -> Symbol:
    """The sum of the terms, positive ones first."""
    total = const(0.0)
    for sign, term in sorted(terms, key=lambda item: -item[0]):
        total = trace.add(total, term) if sign > 0 else trace.sub(total, term)
    return total


def cancelled(row: Symbol) -> Symbol:
    """The row without terms that cancel: z0 + h f - z1 becomes h f - (z1 - z0), which keeps its digits."""
    terms = _terms(row)
    counts: dict[Symbol, int] = {}
    for sign, term in terms:
        counts[term] = counts.get(term, 0) + sign
    if sum(map(abs, counts.values())) == len(terms):
        return row
    left = [(1 if n > 0 else -1, term) for term, n in counts.items() for _ in range(abs(n))]
    return _total(left)


def _scaled(row: Symbol, slope: Symbol) -> Symbol:
    """The row over its slope; over its sign where the slope is a formula of one sign."""
    sign = _sign(slope)
    if slope.op != "const" and not sign:
        return trace.mul(row, trace.reciprocal(slope))
    row = _total(_terms(row, -1)) if sign < 0 else row
    size = abs(slope.value) if slope.op == "const" else 1.0
    return row if size == 1.0 else trace.mul(const(1.0 / size), row)


def _times(row: Symbol, h: Symbol) -> Symbol:
    """h times the row, in which divisions by h cancel."""
    inverse = [node for node in trace.topological([row]) if node.op == "recip" and node.args[0] is h]
    divided = trace.depends_on([row], inverse)

    def times(node: Symbol) -> Symbol:
        if node.number in divided:
            if node.op == "recip":
                return const(1.0)
            if node.op in ("add", "sub", "neg"):
                sum_of: Symbol = trace.rebuild(node.op, tuple(times(a) for a in node.args))
                return sum_of
            if node.op == "mul":
                left, right = node.args if node.args[0].number in divided else node.args[::-1]
                return trace.mul(times(left), right)
        return trace.mul(h, node)

    return times(row)


def _at_zero(rows: Sequence[Symbol], unknowns: Sequence[Symbol], h: Symbol) -> Slopes | None:
    """Slopes at h = 0 and increments 0; of arrays by their own entries only. None where h is a divisor. Traced apart,
    for the numbers of new expressions would change the order of others."""
    place = {x.number: j for j, x in enumerate(unknowns)}
    with trace.tracing(symbols.expressions()):
        try:
            still = trace.substitute(rows, {h: const(0.0)})
            here = trace.Substitution(dict.fromkeys(unknowns, const(0.0)))
            return [
                {place[t.unknown.number]: here(slope) for t, slope in row.items() if not (t.rows or t.columns)}
                for row in jacobian_terms(still, unknowns)
            ]
        except (TraceError, ArithmeticError, ValueError):
            return None


def _matched(slopes: Slopes) -> list[int] | None:
    """A row for each unknown, its own one where possible; None where no matching is complete."""
    count = len(slopes)
    if all(_present(row, i) for i, row in enumerate(slopes)):
        return list(range(count))
    from scipy.optimize import linear_sum_assignment

    costs = np.full((count, count), np.inf)  # (unknown, row)
    for i, row in enumerate(slopes):
        for j in row:
            if _present(row, j):
                costs[j, i] = float(i != j)
    try:
        _, rows = linear_sum_assignment(costs)
    except ValueError:  # no complete matching
        return None
    return [int(i) for i in rows]


def _present(row: Mapping[int, Symbol], j: int) -> bool:
    return j in row and not trace.is_const(row[j], 0.0)


def _unmixed(rows: list[Symbol], slopes: Slopes) -> list[Symbol]:
    """Rows in which linear combinations are resolved, where unknowns depend on each other in a circle at h = 0."""
    others = [{j for j in row if j != i and _present(row, j)} for i, row in enumerate(slopes)]
    left = set(range(len(rows)))
    while ready := {i for i in left if not others[i] & left}:
        left -= ready
    fixed = all(slope.op == "const" for row in slopes for slope in row.values())
    if not left or not fixed or len(rows) > MIXED:
        return rows
    A = np.eye(len(rows))
    for i, row in enumerate(slopes):
        for j in others[i]:
            A[i, j] = row[j].value / row[i].value
    if np.linalg.matrix_rank(A) < len(rows):
        return rows
    return [
        _total([(1, trace.mul(const(w), row)) for w, row in zip(weights, rows, strict=True) if w])
        for weights in np.linalg.inv(A)
    ]


def _sign(slope: Symbol) -> int:
    """1 or -1 where the slope has this sign for all inputs, else 0."""
    if slope.op == "const":
        return 1 if slope.value > 0.0 else -1
    return 1 if slope.positive else -1 if trace.neg(slope).positive else 0
