"""Numbers and names as sentences, tables and cells of words say them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

LONGEST = 40  # characters of a name in a sentence
TURNING = "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"  # bidirectional controls
ABSENT = "-"


def is_finite(value: Any) -> bool:
    try:
        return math.isfinite(float(value))
    except (TypeError, ValueError):
        return False


def power(value: float) -> str:
    """1e-6 without the zero that Python writes."""
    return f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e+")


def rounded(value: float) -> str:
    """Two digits, never as a power of ten."""
    return f"{float(f'{value:.2g}'):g}" if value < 1e5 else f"{value:.0f}"


def percent(value: float) -> str:
    """Two digits; what an error is within needs no more than 0.001 %."""
    return f"{rounded(100 * max(value, 1e-5))} %"


def seconds(value: float) -> str:
    unit, size = next(((u, s) for u, s in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)) if value >= s), ("s", 1.0))
    return f"{value / size:.3g} {unit}"


def share_of(some: float, runs: float) -> str:
    return f"{int(some)} of {int(runs)}" if is_finite(runs) and runs else ABSENT


def called(name: Any) -> str:
    """A name as part of a sentence: short, and without characters that turn the direction of what follows."""
    plain = "".join(c for c in str(name) if c not in TURNING)
    return plain if len(plain) <= LONGEST else f"{plain[: LONGEST - 1]}…"


def listed(words: Iterable[str]) -> str:
    """ "a, b and c"."""
    *head, tail = words
    return f"{', '.join(head)} and {tail}" if head else tail


def some(names: Iterable[str], most: int = 3) -> str:
    """The first names, and how many others."""
    every = list(names)
    return listed([*every[:most], *([f"{len(every) - most} more"] if len(every) > most else [])])
