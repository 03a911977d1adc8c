"""The contract of `System`: what its author writes, and the defaults of all that is optional.

energy(z), entropy(z), reversible(z, dE, dS) and irreversible(z, dE, dS), or the matrices poisson(z) and friction(z);
all else is optional.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ..errors import TcbenchError
from .magnitudes import Magnitudes
from .operators import projected
from .traced import derived

FORMULAS = ("energy", "entropy", "reversible", "irreversible")


class Formulas(Magnitudes):
    """Declarations and formulas, z of shape (size,), everything dimensionless; see `System`."""

    variables: Mapping[str, tuple[Any, ...]] = {}  # name -> shape
    positive: ClassVar[tuple[str, ...]] = ()  # constants that must be > 0
    non_negative: ClassVar[tuple[str, ...]] = ()
    reference_temperature: Any = 0.0  # of the exergy; 0: the energy is its own scale
    multipliers: ClassVar[Mapping[str, Any]] = {}  # name -> shape, of holonomic constraints; see constraints()
    pull: Any = None  # the multipliers, of a view on which formulas are traced
    source: ClassVar[str] = ""
    units: ClassVar[Mapping[str, Any]] = {}  # of variables, constants, energy, entropy, time: for `tcbench check`
    initial_data: ClassVar[tuple[str, ...]] = ("initial",)  # settings of a Scenario from which `start` computes z0
    collapsed: ClassVar[str] = "what measures(z) says is not positive"  # cause, where a run ends for that

    @derived
    def energy(self, z: Any) -> Any:
        """Total energy E(z) of a state, z of shape (size,): one number."""
        raise TcbenchError(f"{type(self).__name__} must define energy(z), a formula of its variables: one number.")

    @derived
    def entropy(self, z: Any) -> Any:
        """Total entropy S(z) of a state, z of shape (size,): one number."""
        raise TcbenchError(f"{type(self).__name__} must define entropy(z), a formula of its variables: one number.")

    @derived
    def reversible(self, z: Any, dE: Any, dS: Any) -> Any:
        """L(z) dE of a covector dE, shape (size,): rates by the name of their variable, in its shape; others are 0."""
        return self._by_matrix("poisson", z, dE, dS)

    @derived
    def irreversible(self, z: Any, dE: Any, dS: Any) -> Any:
        """M(z) dS of a covector dS, shape (size,): rates by name, as of `reversible`."""
        return self._by_matrix("friction", z, dS, dE)

    def _by_matrix(self, name: str, z: Any, slopes: Any, others: Any) -> Any:
        """The author's matrix, projected, times the slopes (size,); 0 where the author has written none."""
        if getattr(type(self), name) is getattr(Formulas, name):
            return self.state(0.0 * z)
        return self.state(projected(getattr(type(self), name)(self, self.state(z)), *map(np.asarray, (slopes, others))))

    def poisson(self, z: Any) -> Any:
        """L(z), shape (size, size), with L = -L^T and L grad S = 0, in the place of `reversible`."""
        return np.zeros((self.size, self.size))

    def friction(self, z: Any) -> Any:
        """M(z), shape (size, size), with M = M^T >= 0 and M grad E = 0, in the place of `irreversible`."""
        return np.zeros((self.size, self.size))

    def invariants(self, z: Any) -> dict[str, Any]:
        """Conserved quantities besides the energy, numbers by name; none by default."""
        return {}

    def constraints(self, z: Any) -> dict[str, Any]:
        """g(z), which has to be 0, by the name of its multiplier; none by default. The energy is written without it."""
        return {}

    def temperature(self, z: Any, dE: Any, dS: Any) -> Any:
        """Absolute temperatures, one or an array (n_temperatures,), from the gradients, shape (size,); they must stay
        positive. None by default."""
        return []

    def measures(self, z: Any) -> Any:
        """Numbers that must stay positive besides temperatures: lengths, volumes, concentrations. None by default."""
        return []

    def points(self, z: Any) -> Any:
        """The two ends of each line of a picture in the plane, shape (lines, 2, 2); optional."""
        raise TcbenchError(
            f"System {self.name!r} does not say what it looks like: write points(z), lines in the plane "
            "(docs/add-system.md), or take the curves of run.plot()."
        )

    def exergy_offset(self) -> Any:
        """The constant for which V = E - theta_ref S + offset >= 0, in the unit of energy."""
        return 0.0
