"""Springs with a dashpot each: the nets of `spring_network` with a viscous branch beside every spring."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import positive
from .canonical import Canonical, conduction
from .scenario import Scenario


class ViscousSprings(Canonical):
    """Masses in the plane, and standard linear solids in the place of springs; each two at a mass conduct heat.

    alpha is the log strain of a spring's dashpot, whose flow heats that spring.
    """

    name = "viscous_springs"
    variables = {"q": ("point", 2), "p": ("point", 2), "s": ("element",), "alpha": ("element",)}
    tables = {"ends": ("element", 2, "point+anchor"), "pairs": ("link", 2, "element")}
    constants = {
        "masses": ("point",), "anchors": ("anchor", 2), "stiffness": ("element",), "branch": ("element",),
        "natural_lengths": ("element",), "viscosity": (), "conductivity": (), "reference_temperature": (),
        "coupling": (), "heat_capacity": (),
    }  # fmt: skip
    positive = ("masses", "natural_lengths", "viscosity", "reference_temperature", "heat_capacity")
    non_negative = ("stiffness", "branch", "conductivity")

    def lines(self, q: Any) -> Any:
        """The two ends of each spring."""
        return np.concatenate([q, self.anchors])[self.ends]

    def strain(self, q: Any) -> Any:
        """log(length/natural length)"""
        ends = self.lines(q)
        return np.log(((ends[:, 1] - ends[:, 0]) ** 2).sum(axis=1)) / 2 - np.log(self.natural_lengths)

    def energy(self, z: Any) -> Any:
        """Eq. (43), and of the branch half its stiffness times (L - alpha)^2."""
        c, warm, L = self.heat_capacity, self.reference_temperature, self.strain(z.q)
        heat = warm * (self.coupling * L + c * (np.exp((z.s - self.coupling * L) / c) - 1.0))
        springs = self.stiffness / 2 * L**2 + self.branch / 2 * (L - z.alpha) ** 2
        return (z.p**2 / (2 * self.masses[:, None])).sum() + (springs + heat).sum()

    def irreversible(self, z: Any, dE: Any, dS: Any) -> Any:
        """Conduction, eq. (22), and the flow of the dashpots, whose power is heat."""
        flow = -dE.alpha / self.viscosity
        return {"alpha": flow, "s": conduction(dE.s, self.pairs, self.conductivity) - flow * dE.alpha / dE.s}

    def points(self, z: Any) -> Any:
        """The springs in the plane; of a bar in space x and z."""
        return self.lines(z.q)[:, :, [0, -1]]


class ViscousTruss(ViscousSprings):
    """The same in space."""

    name = "viscous_truss"
    variables = {**ViscousSprings.variables, "q": ("point", 3), "p": ("point", 3)}
    constants = {**ViscousSprings.constants, "anchors": ("anchor", 3)}


def with_dashpots(scenario: Scenario, viscosity: float | None) -> Scenario:
    """The scenario of a `SpringNetwork` with dashpots of this viscosity, relaxed at the start; None: no change."""
    if viscosity is None:
        return scenario
    size = positive("The viscosity of dashpots", viscosity)
    kind: Any = scenario.system
    d, c = kind.dimension, {n: np.asarray(v) for n, v in scenario.constants.items() if n not in ("owner", "places")}
    q = np.reshape(scenario.positions, (-1, d))
    constants = c | {"ends": c["ends"][:, ::d] // d, "anchors": c["anchors"].reshape(-1, d), "viscosity": size}
    constants["branch"] = c["stiffness"] / 2
    lengths = np.sqrt(np.asarray(scenario.model.shapes(scenario.z0)))
    start = {"q": q, "p": np.reshape(scenario.momenta, (-1, d)), "s": scenario.z0[2 * q.size :]}
    return Scenario(
        name=scenario.name, system=ViscousTruss if d == 3 else ViscousSprings, constants=constants,
        initial=start | {"alpha": np.log(lengths / c["natural_lengths"])}, t_end=scenario.t_end, dt=scenario.dt,
        shows=scenario.shows, source=f"{scenario.source}, with dashpots",
    )  # fmt: skip
