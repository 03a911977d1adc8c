"""Expressions that exist: equal ones are one object, in a trace of its own or among all that are alive."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterator, Mapping, MutableMapping
from contextlib import contextmanager
from typing import Any

from .once import LOCK, uncollected

Key = tuple[str, tuple[int, ...], Any]  # of an expression: operation, numbers of its arguments, value


class _Expressions(threading.local):
    """Those that exist, by what they are made of: of the trace under way, or all that are alive; each thread's own."""

    def __init__(self) -> None:
        self.table: MutableMapping[Key, Any] = weakref.WeakValueDictionary()


KNOWN = _Expressions()


@contextmanager
def tracing(known: Mapping[Key, Any] | None = None) -> Iterator[Mapping[Key, Any]]:
    """A trace of its own, which finds no expressions of others: its graph, and so the last digits of what it computes,
    do not depend on what was traced before. Gives its table of expressions; known: that of a trace to go on from.
    """
    with LOCK, uncollected():
        before, KNOWN.table = KNOWN.table, dict(known or {})
        try:
            yield KNOWN.table
        finally:
            KNOWN.table = before


def in_trace() -> bool:
    """Is a trace under way?"""
    return isinstance(KNOWN.table, dict)


def expressions() -> Mapping[Key, Any]:
    """Those of the trace that is going on."""
    return KNOWN.table
