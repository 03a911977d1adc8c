"""Tables as numbers: which of another space each entry has, and the sums along them."""

from __future__ import annotations

from typing import Any

import numpy as np

from .symbols import Symbol, const, in_trace


class Table(np.ndarray):
    """The same as numbers. counts: of the spaces of the target."""

    counts: tuple[int, ...]
    summed: tuple[int, ...]

    def __array_finalize__(self, source: Any) -> None:
        self.counts, self.summed = getattr(source, "counts", ()), getattr(source, "summed", (0,))

    def __reduce__(self) -> Any:
        return numbered, (np.array(self), self.counts, self.summed)

    def sums(self, x: Any) -> Any:
        """As of a `TableSymbol`."""
        index = np.asarray(self)
        values = np.broadcast_to(x, index.shape) if np.ndim(x) < index.ndim else np.asarray(x)
        zero: Any = 0.0
        if values.dtype == object:  # of symbols; or of units, where nothing has that of the others
            symbols = any(isinstance(v, Symbol) for v in values.flat) if values.size else in_trace()
            zero = const(0.0) if symbols else values[(0,) * index.ndim] if values.size else 0.0
        totals = np.full((sum(self.counts), *values.shape[index.ndim :]), zero, values.dtype)
        np.add.at(totals, index, values)
        of_each = np.split(totals, np.cumsum(self.counts)[:-1])
        return alone_or_all([of_each[k] for k in self.summed])


def numbered(values: Any, counts: tuple[int, ...], summed: tuple[int, ...]) -> Table:
    """A table of these numbers."""
    table: Table = values.view(Table)
    table.counts, table.summed = counts, summed
    return table


def alone_or_all(values: list[Any]) -> Any:
    """What is alone by itself."""
    return values[0] if len(values) == 1 else tuple(values)
