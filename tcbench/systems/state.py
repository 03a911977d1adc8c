"""What a `System` is made of beside formulas: `State`, a vector with names, and the hash that tells edited formulas."""

from __future__ import annotations

import uuid
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..compiler.formula_hash import formula_hash

if TYPE_CHECKING:
    from .system import System

Array = NDArray[Any]


def fixed(array: Array) -> Array:
    """The array, which from now on cannot be written to: many hold it."""
    array.setflags(write=False)
    return array


class State(np.ndarray):
    """Array, last axis (q, p, s), with the blocks by name; `theta` names the last block in (q, p, theta)."""

    n_positions: int

    def __new__(cls, values: Any, n_positions: int) -> State:
        state = np.asarray(values).view(cls)
        state.n_positions = n_positions
        return state

    def __array_finalize__(self, source: Any) -> None:
        self.n_positions = getattr(source, "n_positions", 0)

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        """What has no axis left, as the largest component, is a number."""
        return array[()] if array.ndim == 0 else super().__array_wrap__(array, context, return_scalar)

    @property
    def q(self) -> Array:
        return self.view(np.ndarray)[..., : self.n_positions]

    @property
    def p(self) -> Array:
        return self.view(np.ndarray)[..., self.n_positions : 2 * self.n_positions]

    @property
    def s(self) -> Array:
        return self.view(np.ndarray)[..., 2 * self.n_positions :]

    theta = s


def formulas_hash(kind: type[System]) -> str:
    """Hash of what a class of systems computes now: a global that its formulas read may have changed in between.

    Another one each time where they have none (see formula_hash): nothing traced is then used twice.
    """
    return formula_hash(kind) or uuid.uuid4().hex
