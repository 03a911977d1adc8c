"""Elimination of unknowns before Newton: those that do not move, and those that one equation gives in terms of others.

Of a residual R(d) = 0 in increments d (n,), with n rows as expression graphs: row i goes where it reads a d_i + g = 0
with a > 0 constant and g free of d_i. The cost is linear in the number of rows if each of them sees few unknowns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from ..compiler import derivatives as trace
from ..compiler.array_jacobian import jacobian_terms
from ..compiler.cut import degrees
from ..compiler.derivatives import Symbol, const


@dataclass
class Reduction:
    """Rows and unknowns that Newton has to deal with, and formulas for the eliminated increments."""

    rows: list[Symbol]
    unknowns: list[Symbol]
    eliminated: dict[Symbol, Symbol] = field(default_factory=dict)

    def increments(self, d: Iterable[Symbol]) -> list[Symbol]:
        return [self.eliminated.get(s, s) for s in d]

    def moved(self) -> list[Symbol]:
        """Those eliminated unknowns that move with the others (their rows are affine by construction)."""
        moving = trace.depends_on(self.eliminated.values(), self.unknowns) if self.eliminated else set()
        return [e for e, formula in self.eliminated.items() if formula.number in moving]


def reduce(rows: Sequence[Symbol], unknowns: Sequence[Symbol], unseen: bool = False) -> Reduction:
    """Drop unknowns that do not move, and eliminate those that their own row gives explicitly or linearly.

    A row i goes that reads a*d_i + g = 0 with a constant a > 0 and g free of d_i, affine in the other unknowns.
    unseen: also those that no other row sees, however theirs is curved.
    """
    degree = degrees([], unknowns)

    def formula_of(row: Symbol, unknown: Symbol) -> Symbol | None:
        return _linear(row, unknown) if degrees([row], [], degree)[row.number] <= 1 else None

    return _reduced(rows, unknowns, formula_of, unseen)


def reduce_arrays(rows: Sequence[Symbol], unknowns: Sequence[Symbol], h: Symbol) -> Reduction:
    """The same of arrays: those go that their row gives entry by entry, however it is curved in others.

    What belongs to one entry alone, as the flow of a dashpot, is condensed so.
    """
    return _reduced(rows, unknowns, lambda row, unknown: _of_array(row, unknown, h))


def _reduced(
    rows: Sequence[Symbol], unknowns: Sequence[Symbol],
    formula_of: Callable[[Symbol, Symbol], Symbol | None], unseen: bool = False,
) -> Reduction:  # fmt: skip
    left, eliminated = list(zip(rows, unknowns, strict=True)), dict[Symbol, Symbol]()
    while True:  # what was eliminated may make another row linear
        kept, before = [], len(eliminated)
        inserted = trace.Substitution(eliminated)
        for row, unknown in left:
            while (closed := inserted(row)) is not row:  # formulas may contain what was eliminated after them
                row = closed
            formula = formula_of(row, unknown)
            if formula is None:
                kept.append((row, unknown))
            else:
                eliminated[unknown] = formula
                inserted = trace.Substitution(eliminated)
        left = kept
        if len(eliminated) == before and not (unseen and _unseen(left, eliminated)):
            break
    left.reverse()  # entropies first: their pivots are safe at any h (an M-matrix)
    return Reduction([row for row, _ in left], [unknown for _, unknown in left], _closed(eliminated))


def _unseen(left: list[tuple[Symbol, Symbol]], eliminated: dict[Symbol, Symbol]) -> bool:
    """Eliminate the first unknown that no other row sees; is there one?"""
    slopes = trace.sparse_jacobian([row for row, _ in left], [unknown for _, unknown in left])
    for i, (row, unknown) in enumerate(left):
        alone = not any(i in other for j, other in enumerate(slopes) if j != i)
        a = slopes[i].get(i, const(0.0))
        if alone and _is_positive(a):
            eliminated[unknown] = _given(row, unknown, a)
            del left[i]
            return True
    return False


def _linear(row: Symbol, unknown: Symbol) -> Symbol | None:
    """The formula that an affine row gives for its unknown; None where its slope is not positive."""
    (slope,) = trace.sparse_jacobian([row], [unknown])
    a = slope.get(0, const(0.0))
    return _given(row, unknown, a) if _is_positive(a) else None


def _of_array(row: Symbol, unknown: Symbol, h: Symbol) -> Symbol | None:
    """The formula that the row gives for an array; None where it is not linear in that, or sees other entries of it."""
    if degrees([row], [unknown])[row.number] != 1:
        return None
    (found,) = jacobian_terms([row], [unknown])
    if len(found) != 1:
        return None
    ((term, a),) = found.items()
    (still,) = trace.substitute([a], {h: const(0.0)})
    return None if term.rows or term.columns or not _is_positive(still) else _given(row, unknown, a)


def _is_positive(slope: Symbol) -> bool:
    return slope.op == "const" and bool(slope.value > 0)


def _given(row: Symbol, unknown: Symbol, slope: Symbol) -> Symbol:
    """The unknown that solves a row in which it is linear with this slope."""
    (rest,) = trace.substitute([row], {unknown: const(0.0)})
    return trace.neg(trace.mul(rest, trace.reciprocal(slope)))


def _closed(eliminated: dict[Symbol, Symbol]) -> dict[Symbol, Symbol]:
    """The formulas in terms of what stays: each may contain only those that were eliminated after it."""
    closed: dict[Symbol, Symbol] = {}
    inserted = trace.Substitution(closed)
    for unknown, formula in reversed(eliminated.items()):
        closed[unknown] = inserted.new[unknown.number] = inserted(formula)
    return {unknown: closed[unknown] for unknown in eliminated}
