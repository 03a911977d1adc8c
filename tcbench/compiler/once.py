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


def once(make: Callable[..., Made]) -> Callable[..., Made]:
    """As `functools.cache`; of threads that ask for the same at once one makes it, and the others wait."""
    kept = cache(make)

    @wraps(make)
    def found(*arguments: object) -> Made:
        with LOCK:
            return kept(*arguments)

    found.cache_clear = kept.cache_clear  # type: ignore[attr-defined]
    return found


def once_a_system(make: Callable[..., Made]) -> Callable[..., Made]:
    """`once` of make(system, ...): what is made, which does not refer to the system, lives as long as that does."""
    kept: WeakKeyDictionary[Any, dict[tuple[Any, ...], Made]] = WeakKeyDictionary()

    @wraps(make)
    def found(system: Any, *rest: Any) -> Made:
        known = kept.get(system)
        if known is None or rest not in known:
            with LOCK:
                known = kept.setdefault(system, {})
                if rest not in known:
                    known[rest] = make(system, *rest)
        return known[rest]

    found.cache_clear = kept.clear  # type: ignore[attr-defined]
    return found


class Spares(Generic[Made]):
    """What a run has to itself, kept for the next one: make(system, *key(asked)), which does not refer to the system.
    What is asked for often, as a tolerance is, is found without its key."""

    def __init__(self, make: Callable[..., Made], key: Callable[[Any], tuple[Any, ...]]) -> None:
        self.make, self.key = make, key
        self.free: dict[Any, dict[Any, list[Made]]] = {}  # by weak references to systems

    def adaptive(self, system: Any, asked: Any, z0: Any, times: Any, tolerance: float) -> Any:
        """A run by the `adaptive` of one."""
        made: Any = None
        try:
            free = self.free[ref(system)][asked]
            made = free.pop()  # at once: of two threads each gets another
        except (KeyError, IndexError):
            pass
        if made is None:  # not in there: errors of what makes one stand alone
            made, free = self.take(system, asked)
        try:
            return made.adaptive(z0, times, tolerance)
        finally:
            free.append(made)

    def take(self, system: Any, asked: Any) -> tuple[Made, list[Made]]:
        """One that nobody has, and the list to which it is given back."""
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
        made: Made = vars(item).setdefault(self.attrname, self.func(item))
        return made
