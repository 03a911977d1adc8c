"""What small systems of tests have in common: a position, its momentum, an entropy, and friction that warms."""

import numpy as np

from tcbench import System


class OfEntropies(System):
    """Its entropies s are variables."""

    def entropy(self, z):
        return np.sum(z.s)


class Mechanical(OfEntropies):
    """A subclass writes its energy, and what dissipates."""

    variables = {"q": (), "p": (), "s": ()}

    def reversible(self, z, dE, dS):
        return {"q": dE.p, "p": -dE.q}


class Warm(Mechanical):
    """And a temperature for each entropy."""

    def temperature(self, z, dE, dS):
        return dE.s


def rubbed(force, dE):
    """The rates of friction with this force, whose work warms the entropy beside each momentum."""
    return {"p": -force, "s": force * dE.p / dE.s}
