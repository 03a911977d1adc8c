"""Random scenarios that are the same on every machine and for ever: numbers drawn from a seed, within named ranges.

Three things make the digits last. The bits are PCG64's, seeded by `SeedSequence`: NumPy keeps these streams, and not
those of its distributions. A double is made of the upper 53 bits of a word, as documented there. Everything else
(logarithms, directions, normal numbers) is computed here and rounded to six digits, far from where the mathematical
libraries of two machines differ.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import TcbenchError, unknown_name

DIGITS = 6  # a difference in the last bit shows in one number of 1e9
LARGEST_SEED = 2**63 - 1
STREAM = 2009  # second word of the seed: other programs that count seeds from 0 draw other numbers


@dataclass(frozen=True)
class Range:
    """The range of a number of a random scenario, low <= x <= high.

    Parameters
    ----------
    low, high : float
        Ends, in the unit of the number: dimensionless in the built-in families.
    log : bool
        Uniform in the logarithm, not in the number itself.

    Raises
    ------
    TcbenchError
        By `narrowed`, for what a user writes instead: no number, low above high, not positive where `log`.

    References
    ----------
    docs/ensembles.md.
    """

    low: float
    high: float
    log: bool = False

    def __str__(self) -> str:
        return f"{self.low:g}" if self.low == self.high else f"{self.low:g}:{self.high:g}"

    def at(self, u: float) -> float:
        """The value at u in [0, 1)."""
        if self.low == self.high:
            return self.low
        return self.low * (self.high / self.low) ** u if self.log else self.low + (self.high - self.low) * u

    def narrowed(self, name: str, text: str) -> Range:
        """The range `low:high`, or the single value, that a user writes instead of this one."""
        try:
            low, high = (float(part) for part in (text.split(":") if ":" in text else (text, text)))
        except ValueError:
            raise TcbenchError(f"{name}={text!r} must be a number or a range low:high, as in {name}={self}.") from None
        if not (math.isfinite(low) and math.isfinite(high) and low <= high):
            raise TcbenchError(f"{name}={text!r} needs low <= high, both finite.")
        if self.log and low <= 0:
            raise TcbenchError(f"{name}={text!r} is drawn uniformly in its logarithm: low must be positive.")
        return Range(low, high, self.log)


class Draw:
    """The numbers of one random scenario, in the order in which they are asked for. Everything is dimensionless."""

    def __init__(self, seed: int, ranges: Mapping[str, Range]) -> None:
        self._bits = np.random.PCG64(np.random.SeedSequence([seed, STREAM]))
        self.ranges = ranges

    def __call__(self, name: str, size: int | None = None) -> Any:
        """A number within the range of that name, or an array of `size` of them, independent; shape () or (size,)."""
        if name not in self.ranges:
            raise unknown_name("range of this family", name, self.ranges)
        values = [rounded(self.ranges[name].at(self.uniform())) for _ in range(1 if size is None else size)]
        return values[0] if size is None else np.array(values)

    def uniform(self) -> float:
        """A double in [0, 1)."""
        return (int(self._bits.random_raw()) >> 11) * 2.0**-53

    def directions(self, count: int) -> NDArray[np.float64]:
        """Unit vectors in the plane, uniform; shape (count, 2)."""
        angles = [2.0 * math.pi * self.uniform() for _ in range(count)]
        return np.array([rounded([math.cos(a), math.sin(a)]) for a in angles])

    def normals(self, size: int) -> NDArray[np.float64]:
        """Standard normal numbers, by Box and Muller; shape (size,)."""
        values = []
        for _ in range(size):
            radius = math.sqrt(-2.0 * math.log(1.0 - self.uniform()))
            values.append(rounded(radius * math.cos(2.0 * math.pi * self.uniform())))
        return np.array(values)


def rounded(x: Any) -> Any:
    """A number, or every number of an array, to six digits."""
    if np.ndim(x):
        return np.array([rounded(value) for value in x])
    return float(f"{x:.{DIGITS}g}")


def seed_of(text: str) -> int:
    """A seed as it is written in a name: a whole number, not negative."""
    if not (text.isdecimal() and text.isascii() and int(text) <= LARGEST_SEED):
        raise TcbenchError(f"A seed is a whole number from 0 to 2**63 - 1, not {text!r}: random[seed=7].")
    return int(text)
