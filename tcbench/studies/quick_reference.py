"""References for scenarios by the hundred: independent solvers at tight tolerances, their gap as the error bar.

A certified reference (`tcbench.reference`) takes seconds; these take milliseconds. Nothing is assumed of any solver:
the largest gap between any two is the uncertainty of all. A method is compared with a solver of another family, so
that none is judged by itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import plugins
from ..errors import TcbenchError, leave_to_the_machine
from ..integrator import Integrator
from ..systems.scenario import Scenario

Floats = NDArray[np.float64]
SHIFT = 1e-7  # relative change of the initial state from which the growth of a disturbance is estimated
USABLE = 0.1  # a scenario counts for a target if its error bar is at most this part of it


class Family(NamedTuple):
    """Solvers of one kind, (integrator, tolerance), and the plugins whose methods are related to them."""

    solvers: tuple[tuple[str, float], ...]
    plugins: frozenset[str]


FAMILIES = {  # in order of preference
    "collocation": Family(
        (("tc_gauss_adaptive[k=6]", 1e-13), ("tc_gauss_adaptive[k=4]", 1e-13)),
        frozenset({"tc_gauss", "tc_auto", "gauss"}),
    ),
    "taylor": Family((("heyoka", 1e-16),), frozenset({"peers_heyoka", "tc_taylor"})),
    "runge_kutta": Family((("scipy_dop853", 1e-13),), frozenset({"peers_scipy"})),
}
ENOUGH = 2  # families; a third one, the slow one, stands in where another is not installed
OWNER = FAMILIES["collocation"].solvers[0][0]


def available(count: int = ENOUGH) -> dict[str, list[tuple[Integrator, float]]]:
    """The solvers that there are, by family: of the first `count` families that have any."""
    found: dict[str, list[tuple[Integrator, float]]] = {}
    for name, family in FAMILIES.items():
        present = [(method, tol) for label, tol in family.solvers if (method := _present(label)) is not None]
        if present and len(found) < count:
            found[name] = present
    if len(found) < ENOUGH:
        raise TcbenchError(
            f"Errors of random scenarios need solvers of two families, and there is {', '.join(found) or 'none'}. "
            "pip install 'tcbench[peers]' brings heyoka and SciPy's."
        )
    return found


def _present(name: str) -> Integrator | None:
    try:
        method = plugins.find_integrator(name)
    except TcbenchError:
        return None
    return None if method.lacks else method


def solve(scenario: Scenario, count: int = ENOUGH) -> dict[str, Any]:
    """The state at t_end by each solver of `count` families, and how fast a disturbance grows.

    Returns states: solver -> list of n numbers (NaN where it failed), gap: the largest relative gap between two of
    them (infinite where fewer than two families succeeded), lyapunov: finite-time exponent ln(growth)/t_end of a
    disturbance of the initial state; per unit of time.
    """
    states: dict[str, list[float]] = {}
    solvers = available(count)
    for members in solvers.values():
        for method, tolerance in members:
            states[method.name] = run(method, scenario, scenario.z0, tolerance).tolist()
    method, tolerance = next(iter(solvers.values()))[0]
    z0 = np.array(scenario.z0)
    names = set(scenario.model.variables)
    shift = np.zeros(len(z0))
    for begin, stop, _ in (scenario.model.layout[name] for name in (names & {"q", "p"} or names)):
        shift[begin:stop] = SHIFT * np.maximum(1.0, abs(z0[begin:stop]))
    near, end = run(method, scenario, z0 + shift, tolerance), np.array(states[method.name])
    growth = distance(near, end) / distance(z0 + shift, z0)
    lyapunov = math.log(growth) / scenario.t_end if math.isfinite(growth) and growth > 0 else math.nan
    return {"states": states, "gap": largest_gap(states), "lyapunov": lyapunov}


def run(method: Integrator, scenario: Scenario, z0: Floats, tolerance: float) -> Floats:
    """The state at t_end, shape (n,); NaN where the solver gave up."""
    assert method.adaptive is not None
    try:
        ends = np.array([0.0, scenario.t_end])
        found = method.adaptive(scenario.model, np.array(z0), ends, tolerance, tolerance)
    except Exception as error:  # a reference that cannot be had is a scenario that is left out
        leave_to_the_machine(error)
        return np.full(len(z0), np.nan)
    states = found[0] if isinstance(found, tuple) else found
    return np.asarray(states[-1], dtype=float)


def distance(a: Any, b: Any) -> float:
    """max |a - b| / max(1, |b|); infinite where it is not a number."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    gap = float(np.max(abs(a - b) / np.maximum(1.0, abs(b))))
    return gap if math.isfinite(gap) else math.inf


def largest_gap(states: Mapping[str, Iterable[float]]) -> float:
    """Over all pairs of solvers; infinite where fewer than two families gave a state."""
    good = {name: np.array(list(z)) for name, z in states.items() if np.all(np.isfinite(list(z)))}
    if len({family_of_solver(name) for name in good}) < ENOUGH:
        return math.inf
    names = list(good)
    return max(distance(good[a], good[b]) for i, a in enumerate(names) for b in names[:i])


def family_of_solver(name: str) -> str:
    return next(family for family, known in FAMILIES.items() if name in dict(known.solvers))


def own_family(origins: Iterable[str]) -> str:
    """The family that a method of these plugins is related to; "" if none."""
    mine = set(origins)
    known = plugins.registry().integrators  # `uses` may name methods, too
    mine |= {known[name].plugin for name in mine if name in known}
    return next((name for name, family in FAMILIES.items() if mine & family.plugins), "")


def reference_for(states: Mapping[str, Iterable[float]], *avoided: str) -> Floats | None:
    """The state to compare with: of the preferred solver that is of none of these families; None if there is none."""
    for name, family in FAMILIES.items():
        for solver, _ in family.solvers:
            if name not in avoided and solver in states:
                z = np.array(list(states[solver]), dtype=float)
                if np.all(np.isfinite(z)):
                    return z
    return None
