"""Caches that are safe among threads, spare workspaces, and the lock and the pause of collections while tracing."""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, wraps
from functools import cached_property as _cached_property
from typing import Any, Generic, Self, TypeVar, overload
from weakref import WeakKeyDictionary, ref

LOCK = threading.RLock()  # of traces and of what is made of them: one thread at a time
Made = TypeVar("Made")


@contextmanager
def uncollected() -> Iterator[None]:
    """Without garbage collections: tracing and translating make hundreds of thousands of objects in no circles."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


def cached(make: Callable[..., Made]) -> Callable[..., Made]:
    """As `functools.cache`; of threads that ask for the same at once one makes it, and the others wait."""
    values = cache(make)

    @wraps(make)
    def lookup(*arguments: object) -> Made:
        with LOCK:
            return values(*arguments)

    lookup.cache_clear = values.cache_clear  # type: ignore[attr-defined]
    return lookup


def cached_per_system(make: Callable[..., Made]) -> Callable[..., Made]:
    """`cached` of make(system, ...). A value lives as long as its system, and does not refer to it."""
    values_of: WeakKeyDictionary[Any, dict[tuple[Any, ...], Made]] = WeakKeyDictionary()

    @wraps(make)
    def lookup(system: Any, *rest: Any) -> Made:
        values = values_of.get(system)
        if values is None or rest not in values:
            with LOCK:
                values = values_of.setdefault(system, {})
                if rest not in values:
                    values[rest] = make(system, *rest)
        return values[rest]

    lookup.cache_clear = values_of.clear  # type: ignore[attr-defined]
    return lookup


class Spares(Generic[Made]):
    """Workspaces make(system, *key(asked)) that one run at a time uses; they do not refer to their system.

    The key of an `asked` that comes often, such as a tolerance, is computed once."""

    def __init__(self, make: Callable[..., Made], key: Callable[[Any], tuple[Any, ...]]) -> None:
        self.make, self.key = make, key
        self.free: dict[Any, dict[Any, list[Made]]] = {}  # by weak references to systems

    def adaptive(self, system: Any, asked: Any, z0: Any, times: Any, tolerance: float) -> Any:
        """states, counts = solver.adaptive(z0, times, tolerance) of a free one, or of a new one."""
        solver: Any = None
        try:
            free = self.free[ref(system)][asked]
            solver = free.pop()  # at once: of two threads each gets another
        except (KeyError, IndexError):
            pass
        if solver is None:  # outside of `except`: an error of `make` has no other one as its context
            solver, free = self.take(system, asked)
        try:
            return solver.adaptive(z0, times, tolerance)
        finally:
            free.append(solver)

    def take(self, system: Any, asked: Any) -> tuple[Made, list[Made]]:
        """One that no run uses, and the list to which it is given back."""
        lists = self.free.get(ref(system))
        if lists is None:
            lists = self.free.setdefault(ref(system, self.free.pop), {})
        free = lists.setdefault(asked, lists.setdefault(self.key(asked), []))
        with suppress(IndexError):
            return free.pop(), free
        return self.make(system, *self.key(asked)), free


class cached_property(_cached_property[Made]):
    """That of functools without the lock of Python 3.11, which all objects share, so that a thread that waits in one
    for `LOCK` would stop the one that has it. Of two threads that make a value at once both have the first one's."""

    @overload
    def __get__(self, item: None, owner: Any = None) -> Self: ...
    @overload
    def __get__(self, item: object, owner: Any = None) -> Made: ...
    def __get__(self, item: Any, owner: Any = None) -> Self | Made:
        if item is None:
            return self
        value: Made = vars(item).setdefault(self.attrname, self.func(item))
        return value
