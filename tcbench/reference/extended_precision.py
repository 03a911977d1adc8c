"""A system's own equations in extended precision, whoever wrote the system.

The vector field is derived from the author's formulas as a graph (`trace`); printed as straight-line Python and
run on extended numbers (see precision.py) instead of being compiled, it keeps all their digits.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler.language import NUMPY_NAMES
from ..systems.right_hand_side import as_python
from ..systems.scenario import Scenario
from .precision import EPS, LONG

Longs = NDArray[Any]


@dataclass(frozen=True)
class ExtendedFunction:
    """One of a system's derived functions in extended precision: z (n,) or (n, k), k states at once -> (m,) or (m, k).

    text : the code that runs. constants : doubles, taken as they are.
    """

    text: str
    size: int
    run: Callable[..., None]
    constants: Longs

    def __call__(self, z: Longs) -> Longs:
        out = np.empty((self.size, *z.shape[1:]), LONG)
        self.run(z, self.constants, out)
        return out

    def fingerprint(self, z0: Longs) -> str:
        """Hash of everything that a solution from `z0` depends on."""
        digest = hashlib.sha256(f"{EPS}{self.text}".encode())
        for array in (self.constants, z0):
            digest.update(",".join(map(str, array)).encode() + b";")
        return digest.hexdigest()[:32]


def extended(scenario: Scenario, name: str) -> ExtendedFunction:
    """`vector_field`, `energy`, ... of a scenario's system with its constants."""
    model = scenario.model
    text, shape = model.formula(name)
    kernel = as_python(text, _FUNCTIONS)
    return ExtendedFunction(text, int(np.prod(shape)), kernel, model.constant_values.astype(LONG))


def _ratio(function: Callable[[Longs], Longs]) -> Callable[[Longs], Longs]:
    """function(x)/x, 1 at 0."""
    return lambda x: np.where(x == 0, 1, function(x) / np.where(x == 0, 1, x))


_NAMES = ("sqrt", "exp", "log", "expm1", "log1p", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh",
          "atan2", "hypot", "pow", "abs")  # fmt: skip
_FUNCTIONS: dict[str, Any] = {name: getattr(np, NUMPY_NAMES.get(name, name)) for name in _NAMES} | {
    "phi": _ratio(np.expm1), "lam": _ratio(np.log1p), "sinc": _ratio(np.sin),
}  # fmt: skip
