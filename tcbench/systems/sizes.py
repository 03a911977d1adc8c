"""Checks that the functions of an `ElementSystem` return as many numbers as there are positions or elements.

Once for each class, with numbers, at the start of a scenario: traced on symbols, a wrong length would be an error of
numpy's, in one method here and in another there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import TcbenchError

if TYPE_CHECKING:
    from .element_system import ElementSystem

_CHECKED: set[Any] = set()


def how_many(system: ElementSystem, positions: Any, temperatures: Any) -> tuple[int, int]:
    """(n_positions, n_elements); TcbenchError where a start has some and the class declares none."""
    n, m = system.n_positions, system.n_elements
    if (len(positions) and not n) or (len(temperatures) and not m):
        unsaid = "elements: n_elements" if n else "positions: n_positions"
        raise TcbenchError(f"{type(system).__name__} does not say how many there are of its {unsaid} = 2, or tables.")
    return n, m


def check_sizes(system: ElementSystem, q: Any, p: Any, theta: Any) -> None:
    """TcbenchError where a function of the author gives another number of values than it must.

    q, p: shape (n_positions,); theta: shape (n_elements,)."""
    if system.structure in _CHECKED:
        return
    n, m = system.n_positions, system.n_elements
    each, one = f"it gives {m} numbers, one for each element", "it gives one number"
    pi, s = (_checked(system, name, [(m,)], each, *args) for name, args in (("shape", [q]), ("entropies", [q, theta])))
    _checked(system, "element_energy", [(m,)], each, pi, s)
    _checked(system, "conduction", [(m,)], each, theta)
    for name, count, of in (("inertia", n, "position"), ("entropy_scale", m, "element")):
        _checked(system, name, [(), (1,), (count,)], f"{one}, or {count}: one for each {of}")
    _checked(system, "exergy_offset", [()], one)
    named = _called(system, "invariants", q, p)
    if not isinstance(named, Mapping):
        raise _refused(system, "invariants", named, "it gives a dict: name -> number")
    for key, value in named.items():
        if np.shape(value):
            raise _refused(system, "invariants", np.shape(value), f"each is one number, {key!r} too")
    _CHECKED.add(system.structure)


def _checked(system: ElementSystem, name: str, shapes: list[Any], wanted: str, *arguments: Any) -> Any:
    """The value of the author's function, an array of one of these shapes; else TcbenchError."""
    value = _called(system, name, *arguments)
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise _refused(system, name, value, "it gives numbers") from None
    if array.shape not in shapes:
        raise _refused(system, name, array.shape, wanted)
    return array


def _called(system: ElementSystem, name: str, *arguments: Any) -> Any:
    try:
        with np.errstate(all="ignore"):
            return getattr(system, name)(*arguments)
    except TcbenchError:
        raise
    except Exception as error:
        raise TcbenchError(
            f"{type(system).__name__}: {name}() fails at the start of a scenario: {type(error).__name__}: {error}."
        ) from error


def _refused(system: ElementSystem, name: str, value: Any, wanted: str) -> TcbenchError:
    what = f"an array of shape {value}" if isinstance(value, tuple) else f"{value!r:.60}"
    return TcbenchError(f"{type(system).__name__}: {name}() gives {what.replace('shape ()', 'no axis')}; {wanted}.")
