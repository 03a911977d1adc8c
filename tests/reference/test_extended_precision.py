"""Quotients that are 0/0 at 0, and their derivatives, with the digits of extended precision."""

import mpmath as mp
import numpy as np
import pytest

from tcbench.reference.extended_precision import _FUNCTIONS
from tcbench.reference.precision import EPS, LONG

EXACT = {"phi": lambda x: mp.expm1(x) / x, "lam": lambda x: mp.log1p(x) / x}


@pytest.mark.parametrize("name", EXACT)
def test_derivatives_of_quotients_keep_the_digits(name):
    for at in [1e-8, 0.04, -0.3, 0.31, 0.9, -0.45, -0.55, -0.95, 2.0, 7.9, 60.0, -5.0, -60.0]:
        if name == "lam" and at < -1:
            continue
        with mp.workdps(80):
            exact = mp.taylor(EXACT[name], mp.mpf(at), 3)
        for order in (1, 2, 3):
            found = _FUNCTIONS[f"{name}_slope"](float(order), np.array([at], LONG))[0]
            with mp.workdps(80):
                digits = mp.mpf(np.format_float_positional(found, unique=False, precision=60))
                assert abs(digits / (exact[order] * mp.factorial(order)) - 1) < 100 * EPS, (at, order)
