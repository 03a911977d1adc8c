"""Which cases of a test are of the first tier."""

import pytest


def tiers(cases, first):
    """The cases for `parametrize`: those of `first` as they are, the others in the second tier."""
    others = pytest.mark.thorough
    return [c if c in first else pytest.param(*(c if isinstance(c, tuple) else (c,)), marks=others) for c in cases]
