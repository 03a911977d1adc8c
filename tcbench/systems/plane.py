"""Points and lines of a system in the plane, for pictures."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import TcbenchError
from .element_system import ElementSystem
from .system import System

DRAWN_ELEMENTS = 100  # masses or lines above which a picture would show nothing


def links(model: System) -> list[list[int]]:
    """The two points that each spring joins in the plane: 0 is the origin, k the k-th mass; [] of other systems.

    At random positions the strain measure of a spring is the squared distance of two points.
    """
    if not isinstance(model, ElementSystem) or model.n_positions % 2 or model.n_positions > 2 * DRAWN_ELEMENTS:
        return []
    trials = np.random.default_rng(0).normal(size=(3, model.n_positions))
    points = np.concatenate([np.zeros((3, 1, 2)), trials.reshape(3, -1, 2)], axis=1)
    try:
        measures = np.array([model.shape(q) for q in trials], dtype=float)
    except (TcbenchError, ArithmeticError, TypeError, ValueError):
        return []
    pairs = list(combinations(range(points.shape[1]), 2))
    squares = np.array([((points[:, a] - points[:, b]) ** 2).sum(axis=1) for a, b in pairs])
    matches = [np.flatnonzero(np.all(np.isclose(squares, measure), axis=1)) for measure in measures.T]
    return [list(pairs[match[0]]) for match in matches] if all(len(match) for match in matches) else []


def joints(model: System, z0: Any) -> tuple[list[list[int]], list[int]]:
    """The two joints of each line of points(), and the ends (0, 1 of the first line, 2, 3 of the second, ...) that are
    the joints 1, 2, ...; joint 0 is the origin. Ends that coincide in all states are one joint. ([], []) without
    points(), and for more than DRAWN_ELEMENTS lines."""
    if not model.defines("points") or len(z0) > 10 * DRAWN_ELEMENTS:
        return [], []
    rng = np.random.default_rng(0)
    try:
        with np.errstate(all="ignore"):
            states = np.array([z0, *(model.nearby(z0, rng) for _ in range(3))], dtype=float)
            ends = segments(model, states).reshape(len(states), -1, 2)
    except (TcbenchError, ArithmeticError, TypeError, ValueError):  # `tcbench check` says which
        return [], []
    if ends.shape[1] > 2 * DRAWN_ELEMENTS:
        return [], []
    places, first, joint_of_end = [np.zeros((len(states), 2))], [], []
    for k in range(ends.shape[1]):
        same = (i for i, place in enumerate(places) if np.array_equal(place, ends[:, k], equal_nan=True))
        joint = next(same, len(places))
        if joint == len(places):
            places.append(ends[:, k])
            first.append(k)
        joint_of_end.append(joint)
    return [joint_of_end[i : i + 2] for i in range(0, len(joint_of_end), 2)], first


def drawn(model: System, z0: Any, z: Any) -> dict[str, NDArray[np.float64]]:
    """Columns at_x_1, at_y_1, at_x_2, ... (m,): the joints of a system with points() at the states z (m, size)."""
    _, first = joints(model, z0)
    if not first:
        return {}
    places = segments(model, z).reshape(len(z), -1, 2)[:, first]
    return {f"at_{axis}_{i + 1}": places[:, i, k] for i in range(len(first)) for k, axis in enumerate("xy")}


def segments(model: System, z: Any) -> NDArray[np.float64]:
    """The ends of each line of a picture in the plane at each of the states z (m, n), shape (m, lines, 2, 2).

    As the system's `points` says; otherwise springs between masses. TcbenchError where neither is possible.
    """
    states = np.asarray(z, dtype=float)
    if not isinstance(model, ElementSystem):
        return _ends(model, states, "points(z)", -1)
    states = states[:, : model.n_positions]
    if model.defines("points"):
        return _ends(model, states, "points(q)", model.n_elements)
    joined = links(model)
    if not joined:
        raise TcbenchError(
            f"The elements of {model.name!r} are no springs in the plane, so it cannot be drawn as it is. Give the "
            "system points(q): the two ends of each element, shape (elements, 2, 2)."
        )
    places = np.concatenate([np.zeros((len(states), 1, 2)), states.reshape(len(states), -1, 2)], axis=1)
    return places[:, np.array(joined)]


def _ends(model: System, states: Any, said: str, lines: int) -> NDArray[np.float64]:
    """The values of `points` at states or positions (m, n), shape (m, lines, 2, 2); lines = -1: any number of them."""
    rows = [model.points(model.state(row) if lines < 0 else row) for row in states]
    try:
        ends = np.array([[np.array(line, dtype=float) for line in row] for row in rows])
    except (TypeError, ValueError):
        ends = np.zeros(0)
    if ends.shape[2:] != (2, 2) or lines not in (-1, ends.shape[1]):
        raise TcbenchError(
            f"{said} of the system {model.name!r} gave shape {ends.shape[1:]}; the two ends of each line in the plane "
            f"are needed, shape {(max(lines, 1), 2, 2)}."
        )
    return ends
