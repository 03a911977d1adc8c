"""Hash-consing: equal expressions are one object, within a trace or among all that are alive."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterator, Mapping, MutableMapping
from contextlib import contextmanager
from typing import Any

from .caches import LOCK, uncollected

Key = tuple[str, tuple[int, ...], Any]  # of an expression: operation, numbers of its arguments, value


class _Expressions(threading.local):
    """Table of expressions by their keys, one for each thread: of the trace under way, or of all that are alive."""

    def __init__(self) -> None:
        self.table: MutableMapping[Key, Any] = weakref.WeakValueDictionary()


INTERNED = _Expressions()


@contextmanager
def tracing(symbols: Mapping[Key, Any] | None = None) -> Iterator[Mapping[Key, Any]]:
    """A trace with a table of its own: its graph, and so the last digits of its results, do not depend on earlier ones.

    symbols : the table of a trace to go on from. Yields the table.
    """
    with LOCK, uncollected():
        before, INTERNED.table = INTERNED.table, dict(symbols or {})
        try:
            yield INTERNED.table
        finally:
            INTERNED.table = before


def in_trace() -> bool:
    """Is a trace under way?"""
    return isinstance(INTERNED.table, dict)


def expressions() -> Mapping[Key, Any]:
    """The table of the trace under way."""
    return INTERNED.table
