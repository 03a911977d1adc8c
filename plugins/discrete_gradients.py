"""The paper's monolithic method with other discrete gradients.

They have DE . (z1 - z0) = E(z1) - E(z0) with other slopes, in coordinates that keep momenta. For elements these are
(pi, s) of each; positions enter through the gradient of the strain measure at the midpoint, exact for quadratic ones.
For other systems they are the parts y of E, and of S, that are at most quadratic: E = F(y(z)), with slopes of F and
grad y at the midpoint, which is exact.

tc_gonzalez: midpoint slopes with projection. tc_itoh_abe: one ordering, order 1. tc_averaged: the mean of that and of
the reverse, of order 2; of springs it is the paper's (31)-(32), and so tc_monolithic.
tc_mean_value: averaged slopes; its energy is exact up to a five-point quadrature, so it does not claim it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from tcbench import Integrator, hookimpl
from tcbench.building_blocks import directional
from tcbench.compiler.array_states import each, entries, refilled, side_by_side
from tcbench.compiler.cut import Cut
from tcbench.compiler.derivatives import Symbol, const
from tcbench.compiler.divided_differences import rectangle, symmetrised_slopes
from tcbench.systems.element_system import ElementSystem
from tcbench.systems.state import State
from tcbench.systems.system import System


def by_elements(system: ElementSystem, z0: Any, z1: Any, slopes: Callable[..., tuple[Any, Any]]) -> State:
    """The discrete gradient made of `slopes(pi0, dpi, s0, ds) -> (D_pi e, D_s e)`, arrays over the elements."""
    z0, z1 = system.state(z0), system.state(z1)
    dz, mid = system.state(z1 - z0), system.state((z0 + z1) / 2)
    system.check_shape(mid.q)
    pull = system.shape_gradient(mid.q)
    stress, theta = slopes(system.shape(z0.q), pull @ dz.q, z0.s, dz.s)
    return system.assemble(stress @ pull, mid.p, theta)


def _corners(system: ElementSystem, *edges: Any) -> Any:
    """The element energies with their exact slopes along the edges of [pi0, pi1] x [s0, s1]."""
    return system.element_energy(*each(rectangle, *edges, count=2))


def itoh_abe(system: ElementSystem, z0: Any, z1: Any) -> State:
    """Coordinate increments in the order pi, s (Itoh and Abe 1988); not symmetric, so of order 1."""

    def slopes(*edges: Any) -> tuple[Any, Any]:
        quotients: tuple[Any, Any] = each(lambda e: (e.pi_at_s0, e.s_at_pi1), _corners(system, *edges), count=2)
        return quotients

    return by_elements(system, z0, z1, slopes)


def averaged(system: ElementSystem, z0: Any, z1: Any) -> State:
    """The mean of both orders, Romero (2009), (31)-(32)."""
    return by_elements(system, z0, z1, lambda *edges: each(symmetrised_slopes, _corners(system, *edges), count=2))


def gonzalez(system: ElementSystem, z0: Any, z1: Any) -> State:
    """Slopes at the midpoint, projected onto the directionality property (Gonzalez 1996) element by element.

    The distance in (pi, s) is (dpi/pi)^2 + (ds/scale)^2. The projection adds a difference of slopes, never of energies:
    E1 - E0 is the sum of the symmetrised quotients times the increments.
    """

    def slopes(pi0: Any, dpi: Any, s0: Any, ds: Any) -> tuple[Any, Any]:
        pi, s = pi0 + 0.5 * dpi, s0 + 0.5 * ds
        exact = each(symmetrised_slopes, _corners(system, pi0, dpi, s0, ds), count=2)
        weights = np.stack([1.0 / pi**2, 0 * pi + 1.0 / system.entropy_scale() ** 2], axis=1)
        middle = np.stack(system.element_slopes(pi, s), axis=1)
        gradient = directional(middle, np.stack([dpi, ds], axis=1), np.stack(exact, axis=1), weights, axis=1)
        return gradient[:, 0], gradient[:, 1]

    return by_elements(system, z0, z1, slopes)


def mean_value(system: ElementSystem, z0: Any, z1: Any, points: int = 5) -> State:
    """Slopes averaged along the straight line in (pi, s) (AVF; Harten, Lax and van Leer 1983), by Gauss's rule: energy
    is kept as exactly as so many points integrate it, and temperatures stay positive at any step."""
    nodes, weights = np.polynomial.legendre.leggauss(points)

    def slopes(pi0: Any, dpi: Any, s0: Any, ds: Any) -> tuple[Any, Any]:
        at = [system.element_slopes(pi0 + x * dpi, s0 + x * ds) for x in (nodes + 1) / 2]
        stress = sum(w / 2 * e[0] for w, e in zip(weights, at, strict=True))
        theta = sum(w / 2 * e[1] for w, e in zip(weights, at, strict=True))
        return stress, theta

    return by_elements(system, z0, z1, slopes)


# ---- for any system: F, y at the start, its increments -> slopes of F


def cut_itoh_abe(F: Cut, start: list[Symbol], step: list[Symbol], turn: int = 1) -> list[Symbol]:
    """One coordinate after the other, in the order of the energy's formula, reversed for turn = -1; an array is one."""
    here, slopes, still = [*start], [const(0.0)] * len(step), [const(0.0)] * len(step)
    for k in range(len(step))[::turn]:
        slopes[k] = F.outer_discrete(here, [*still[:k], step[k], *still[k + 1 :]])[k]
        here[k] = start[k] + step[k]
    return slopes


def cut_averaged(F: Cut, start: list[Symbol], step: list[Symbol]) -> list[Symbol]:
    both = (cut_itoh_abe(F, start, step, turn) for turn in (1, -1))
    return [(a + b) / 2 for a, b in zip(*both, strict=True)]


def cut_gonzalez(F: Cut, start: list[Symbol], step: list[Symbol]) -> list[Symbol]:
    """The defect is distributed where F is not linear; the distance is sum dy^2/(1 + y^2)."""
    middle = [y + 0.5 * d for y, d in zip(start, step, strict=True)]
    slopes, exact = F.outer_slopes(middle), F.outer_discrete(start, step)
    weights = [const(0.0) if m.op == "const" else 1.0 / (1.0 + y * y) for m, y in zip(slopes, middle, strict=True)]
    return entries(directional(*map(side_by_side, (slopes, step, exact, weights))))


def cut_mean_value(F: Cut, start: list[Symbol], step: list[Symbol], points: int = 5) -> list[Symbol]:
    nodes, weights = np.polynomial.legendre.leggauss(points)
    at = [F.outer_slopes([y + x * d for y, d in zip(start, step, strict=True)]) for x in (nodes + 1) / 2]
    return [
        sum((w / 2 * slope for w, slope in zip(weights, slopes, strict=True)), const(0.0))
        for slopes in zip(*at, strict=True)
    ]


def by_cut(system: System, name: str, z0: Any, z1: Any, slopes: Callable[..., list[Symbol]]) -> State:
    """The discrete gradient of the "energy" or the "entropy"."""
    cut = system.cut(name)
    middle = entries((z0 + z1) / 2)
    step = cut.moved(middle, entries(z1 - z0))
    gradient = system.state(refilled(z0, cut.joined(slopes(cut, cut.values(entries(z0)), step), middle)))
    return gradient + system.pull_gradient(z0, z1) if system.multipliers and name == "energy" else gradient


EXACT = {"energy", "entropy", "angular_momentum"}


def with_gradient(of_elements, of_cut):
    def monolithic(z0, z1, h, system):
        if isinstance(system, ElementSystem):
            DE, DS = of_elements(system, z0, z1), system.entropy_gradient(z0)
        else:
            DE, DS = (by_cut(system, name, z0, z1, of_cut) for name in ("energy", "entropy"))
        mid = (z0 + z1) / 2
        return z1 - z0 - h * (system.reversible(mid, DE, DS) + system.irreversible(mid, DE, DS))

    return monolithic


@hookimpl
def tcbench_integrators():
    methods = [
        ("tc_gonzalez", gonzalez, cut_gonzalez, 2, EXACT, "Gonzalez (1996), in the frame of Romero (2009)"),
        ("tc_itoh_abe", itoh_abe, cut_itoh_abe, 1, EXACT, "Itoh and Abe (1988), in the frame of Romero (2009)"),
        ("tc_averaged", averaged, cut_averaged, 2, EXACT, "the mean of both orders of Itoh and Abe (1988)"),
        ("tc_mean_value", mean_value, cut_mean_value, 2, EXACT - {"energy"}, "McLachlan, Quispel and Robidoux (1999)"),
    ]
    return [
        Integrator(
            name=name,
            order=order,
            claims=claims,
            source=source,
            flows=with_gradient(*gradients),
            tags={"gradient"},
            by_default=name != "tc_averaged",
        )
        for name, *gradients, order, claims, source in methods
    ]
