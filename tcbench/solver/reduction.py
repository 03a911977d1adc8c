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

SMALL = 64  # unknowns up to which rows are taken one by one, each time through all of them


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
    if len(unknowns) <= SMALL:
        return _one_by_one(
            Reduction(list(rows), list(unknowns)),
            lambda state: _eliminable(state) or (_eliminable(state, unseen=True) if unseen else None),
        )
    left, eliminated = list(zip(rows, unknowns, strict=True)), dict[Symbol, Symbol]()
    degree = degrees([], unknowns)
    while True:  # what was eliminated may make another row linear
        kept, before = [], len(eliminated)
        inserted = trace.Substitution(eliminated)
        for row, unknown in left:
            row = inserted(row)
            formula = _solved(row, unknown, degree)
            if formula is None:
                kept.append((row, unknown))
            else:
                eliminated[unknown] = formula
                inserted = trace.Substitution(eliminated)
        left = kept
        if len(eliminated) == before:
            break
    left.reverse()  # entropies first: their pivots are safe at any h (an M-matrix)
    return Reduction([row for row, _ in left], [unknown for _, unknown in left], _closed(eliminated))


def reduce_arrays(rows: Sequence[Symbol], unknowns: Sequence[Symbol], h: Symbol) -> Reduction:
    """The same of arrays: those go that their row gives entry by entry, however it is curved in others.

    What belongs to one entry alone, as the flow of a dashpot, is condensed so.
    """

    def eliminable(state: Reduction) -> tuple[int, Symbol] | None:
        formulas = (_of_array(row, x, h) for row, x in zip(state.rows, state.unknowns, strict=True))
        return next(((i, formula) for i, formula in enumerate(formulas) if formula is not None), None)

    return _one_by_one(Reduction(list(rows), list(unknowns)), eliminable)


def _of_array(row: Symbol, unknown: Symbol, h: Symbol) -> Symbol | None:
    """The formula that the row gives for an array; None where it is not linear in that, or sees other entries of it."""
    if degrees([row], [unknown])[row.number] != 1:
        return None
    (found,) = jacobian_terms([row], [unknown])
    if len(found) != 1:
        return None
    ((term, a),) = found.items()
    (still,) = trace.substitute([a], {h: const(0.0)})
    if term.rows or term.columns or not _is_positive(still):
        return None
    return _given(row, unknown, a)


def _one_by_one(state: Reduction, eliminable: Callable[[Reduction], tuple[int, Symbol] | None]) -> Reduction:
    """The same, each row's formula inserted into all others: at a cost that grows as the square of their number."""
    while (found := eliminable(state)) is not None:
        i, formula = found
        unknown = state.unknowns.pop(i)
        state.rows.pop(i)
        state.rows = trace.substitute(state.rows, {unknown: formula})
        formulas = trace.substitute(list(state.eliminated.values()), {unknown: formula})
        state.eliminated = dict(zip(state.eliminated, formulas, strict=True)) | {unknown: formula}
    state.rows.reverse()
    state.unknowns.reverse()
    return state


def _eliminable(state: Reduction, unseen: bool = False) -> tuple[int, Symbol] | None:
    slopes_of = trace.sparse_jacobian(state.rows, state.unknowns) if unseen else []
    for i, (row, unknown) in enumerate(zip(state.rows, state.unknowns, strict=True)):
        (slopes,) = trace.sparse_jacobian([row], state.unknowns)
        moving = trace.depends_on(slopes.values(), state.unknowns)
        a = slopes.get(i, const(0.0))
        curved = any(s.number in moving for s in slopes.values())
        if unseen:
            curved = any(i in other for j, other in enumerate(slopes_of) if j != i)
        if _is_positive(a) and not curved:
            return i, _given(row, unknown, a)
    return None


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


def _solved(row: Symbol, unknown: Symbol, degree: dict[int, float]) -> Symbol | None:
    """The formula that the row gives for its unknown, or None. degree: in all unknowns, of the nodes seen so far."""
    if degrees([row], [], degree)[row.number] > 1:
        return None
    (slope,) = trace.sparse_jacobian([row], [unknown])
    a = slope.get(0, const(0.0))
    return _given(row, unknown, a) if _is_positive(a) else None
