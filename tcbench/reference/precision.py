"""Numbers with more digits than doubles, for what has to be certain.

np.longdouble where it has them (64 bits of mantissa on x86, 113 on 64-bit Arm under Linux); on Windows and Apple
silicon it is a double, and numpy-quaddtype's quadruple precision (113 bits, installed there) takes its place.
TCBENCH_EXTENDED=quad takes it elsewhere, too, and =double does without.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from ..errors import TcbenchError

ENOUGH = 1e-18  # round-off of what counts as extended
NAMES = ("longdouble", "quad", "double")


def _chosen() -> Any:
    """The type: as the environment asks, else the first that has the digits."""
    asked = os.environ.get("TCBENCH_EXTENDED", "")
    if asked not in ("", *NAMES):
        raise TcbenchError(f"TCBENCH_EXTENDED is {asked!r}; it may be one of {', '.join(NAMES)}.")
    if asked == "longdouble" or (not asked and np.finfo(np.longdouble).eps < ENOUGH):
        return np.dtype(np.longdouble)
    if asked != "double":
        try:
            from numpy_quaddtype import QuadPrecDType

            return QuadPrecDType()
        except ImportError:
            if asked:
                raise TcbenchError(
                    "TCBENCH_EXTENDED=quad needs the package numpy-quaddtype: pip install numpy-quaddtype"
                ) from None
    return np.dtype(float)


LONG: Any = _chosen()  # a dtype
long_number: Any = LONG.type  # a scalar of it, of a number or of its digits
EPS = float(np.finfo(LONG).eps)
DESCRIPTION = (
    f"{'extended' if EPS > 1e-20 else 'quadruple'} precision ({str(LONG).partition('(')[0]}, round-off {EPS:.0e})"
    if EPS < ENOUGH
    else "double precision, for no extended one is at hand (pip install numpy-quaddtype)"
)
