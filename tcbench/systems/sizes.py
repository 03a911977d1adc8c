"""Checks that the functions of an `ElementSystem` return as many numbers as there are positions or elements.

Once for each class, with numbers, at the start of a scenario: traced on symbols, a wrong length would be an error of
numpy's, in one method here and in another there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import TcbenchError

if TYPE_CHECKING:
    from .element_system import ElementSystem

_KNOWN: set[Any] = set()


def how_many(system: ElementSystem, positions: Any, temperatures: Any) -> tuple[int, int]:
    """Its numbers of positions and elements; TcbenchError where a start has some and its class says of none."""
    n, m = system.n_positions, system.n_elements
    if (len(positions) and not n) or (len(temperatures) and not m):
        unsaid = "elements: n_elements" if n else "positions: n_positions"
        raise TcbenchError(f"{type(system).__name__} does not say how many there are of its {unsaid} = 2, or tables.")
    return n, m


def check_sizes(system: ElementSystem, q: Any, p: Any, theta: Any) -> None:
    """TcbenchError where a function of the author's gives another number of values than is asked of it."""
    if system.structure in _KNOWN:
        return
    n, m = system.n_positions, system.n_elements
    _exact(system, "shape", m, "element", q)
    _exact(system, "entropies", m, "element", q, theta)
    _exact(system, "element_energy", m, "element", system.shape(q), system.entropies(q, theta))
    _exact(system, "conduction", m, "element", theta)
    for name, count, of in (("inertia", n, "position"), ("entropy_scale", m, "element")):
        value = _numbers(system, name)
        if value.shape not in ((), (1,), (count,)):
            raise _refused(system, name, value.shape, f"it gives one number, or {count}: one for each {of}")
    if (offset := _numbers(system, "exergy_offset")).shape:
        raise _refused(system, "exergy_offset", offset.shape, "it gives one number")
    named = _called(system, "invariants", q, p)
    if not isinstance(named, Mapping):
        raise _refused(system, "invariants", named, "it gives a dict: name -> number")
    for key, value in named.items():
        if np.shape(value):
            raise _refused(system, "invariants", np.shape(value), f"each is one number, {key!r} too")
    _KNOWN.add(system.structure)


def _exact(system: ElementSystem, name: str, count: int, of: str, *arguments: Any) -> None:
    value = _numbers(system, name, *arguments)
    if value.shape != (count,):
        raise _refused(system, name, value.shape, f"it gives {count} numbers, one for each {of}")


def _numbers(system: ElementSystem, name: str, *arguments: Any) -> Any:
    value = _called(system, name, *arguments)
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise _refused(system, name, value, "it gives numbers") from None


def _called(system: ElementSystem, name: str, *arguments: Any) -> Any:
    function: Callable[..., Any] = getattr(system, name)
    try:
        with np.errstate(all="ignore"):
            return function(*arguments)
    except TcbenchError:
        raise
    except Exception as error:
        raise TcbenchError(
            f"{type(system).__name__}: {name}() fails at the start of a scenario: {type(error).__name__}: {error}."
        ) from error


def _refused(system: ElementSystem, name: str, found: Any, wanted: str) -> TcbenchError:
    what = f"an array of shape {found}" if isinstance(found, tuple) else f"{found!r:.60}"
    return TcbenchError(f"{type(system).__name__}: {name}() gives {what.replace('shape ()', 'no axis')}; {wanted}.")
