"""Thermodynamic projection: any method keeps energy and invariants, and its entropy never falls.

After each step (of an adaptive solver: at each output time) the result is moved to a nearby state with the energy and
the invariants of the start of the run and no less entropy than before the step: along their gradients
(tcbench/solver/mending.py), each variable in proportion to its change in the step. The move is as small as the error of
one step, so the order is kept. What an adaptive solver misses at an output is of all its steps up to there: each
variable is moved in proportion to its size. A solver begins anew behind each kink of the rates, which its error
estimate does not see (solver_kinks.py). Where no such state is near, as at steps at which the method alone fails, the
step fails.

`projected[method=NAME]` wraps any registered method, peers included. The default is verlet_heat4: explicit, of order
four, and with the projection thermodynamically consistent.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from tcbench import Flow, Integrator, System, TcbenchError, family, hookimpl
from tcbench.plugins import find_integrator
from tcbench.solver.flow_kernels import correction
from tcbench.solver.mending import (
    ENTROPY,
    LAWFUL,
    NEAR,
    SHRUNK,
    Along,
    by_variable,
    gradients,
    laws,
    missed,
    position_slopes,
    positions,
)

from .exact_conduction import VERLET_HEAT4
from .solver_kinks import stopped_at_kinks

MAX_SLOPES = 20  # slopes in a step: one where little is missed, more of a stiff spring at a long step
STILL = 1e-12  # of the square of a variable: its weight in a correction where the step does not move it
MOVED, LEAST = 1e3, 1e-11  # a correction may move an output by MOVED tolerances; smaller ones than LEAST count as LEAST
ROUNDED = 1e-15  # fall of S, over its magnitude and size, that is not corrected: round-off


def projected(method: Integrator, name: str = "projected") -> Integrator:
    """`method` with the thermodynamic projection after each step; an Integrator of the same order.

    Raises TcbenchError for multistep methods: their earlier states would have to be projected, too.
    """
    if method.memory:
        raise TcbenchError(f"{method.name!r} is a multistep method: take a one-step method or an adaptive solver.")
    common: dict[str, Any] = {
        "name": name, "claims": {"energy", "entropy", "angular_momentum"}, "tags": method.tags | {"projected"},
        "source": f"thermodynamic projection around {method.name}", "description": "",
        "nonfinite": "no finite state near the step's result has the energy, the invariants and no less entropy",
        "uses": method.sources, "parameters": {}, "family": None,
    }  # fmt: skip
    if method.adaptive is not None:
        outputs = method.outputs and _projected_outputs(method.adaptive, method.outputs)
        return replace(method, **common, adaptive=_projected_solver(method.adaptive), outputs=outputs)
    if method.kind == "flows":
        if not any(flow.stages or flow.of_step for flow in method.flows):
            common["tags"] |= {"constraints"}
        return replace(method, **common, flows=[*method.flows, PROJECTION])
    assert method.step is not None
    # each step is projected before the next begins, so the loop of a method that marches by itself is left unused
    step = _projected_step(method.step, method.increments)
    return replace(method, **common, step=step, increments=True, march=None)


def projection(z0: Any, z1: Any, h: Any, system: System, start: Any, first: Any, moved: Any) -> Any:
    """The residual of the correction `moved` of a step's end, now z1, towards the laws, along slopes at z0.

    The step began at `start`, the run at `first`; all (n,).
    """
    change = z0 - start
    weights = by_variable(system, change, change) + STILL * squares(system, z0)
    return towards(system, z0, z1, start, first, weights)


def projection_of_output(z0: Any, z1: Any, h: Any, system: System, start: Any, first: Any, moved: Any) -> Any:
    """`projection` of a solver's output; `start` is the one before."""
    return towards(system, z0, z1, start, first, squares(system, z0))


def towards(system: System, z0: Any, z1: Any, start: Any, first: Any, weights: Any) -> Any:
    """The correction (n,) of z1 to the laws of `first` and at least the entropy of `start`, by slopes at z0."""
    entropy = system.entropy(start)
    wanted = [*laws(system, first)[:-1], entropy - ROUNDED * (system.entropy_magnitude + abs(entropy))]
    misses = [target - f for target, f in zip(wanted, laws(system, z1), strict=True)]
    misses, slopes = (
        [*(-g for g in positions(system, z1)), *misses],
        [*position_slopes(system, z0), *gradients(system, z0)],
    )
    return -Along(system, slopes, lambda slope: weights * slope).move(misses, at_least=True)


def squares(system: System, z: Any) -> Any:
    """Squares of the sizes of a state's variables, at least of their magnitudes, shape (n,)."""
    least = system.magnitudes_of(z)
    return least * least + by_variable(system, z, z)


PROJECTION = Flow(projection, of_step=True, most=MAX_SLOPES)
PROJECTION_OF_OUTPUT = Flow(projection_of_output, of_step=True, most=MAX_SLOPES)


def onto_laws(system: System, start: Any, end: Any, first: Any = None, by: Flow = PROJECTION) -> Any:
    """The end of a step, or an output, projected; NaN where no state near it has the laws."""
    first = start if first is None else first
    wanted, entropy, left = system.observe(first), system.observe(start)[ENTROPY], np.inf
    least = system.law_magnitudes
    allowed = LAWFUL * (least + np.abs(wanted[: len(least)]))
    for _ in range(by.most):
        end = end + correction(by, system, start, end, first)
        before, left = left, missed(system.observe(end), wanted, entropy, allowed)
        if left <= 1.0 or not left < SHRUNK * before:
            break
    return end if left <= NEAR / LAWFUL else np.nan * end


def _projected_step(step: Callable[..., Any], increments: bool) -> Callable[..., Any]:
    def stepped(z: Any, h: float, system: System, *held: Any) -> Any:
        raw = np.asarray(step(z, h, system, *held), dtype=float)
        if raw.shape != np.shape(z):
            raise ValueError(f"the step returned shape {raw.shape}, a state has shape {np.shape(z)}")
        dz = raw if increments else raw - z
        return onto_laws(system, np.asarray(z), z + dz) - z

    return stepped


def _mended(states: Iterable[Any], system: System, z0: Any, tolerance: float) -> Iterator[Any]:
    """The outputs of a solver, projected one by one; its own steps between kinks stay as they are."""
    first = last = np.asarray(z0, dtype=float)
    yield first
    for state in itertools.islice(states, 1, None):
        z = np.asarray(state, dtype=float)
        last = onto_laws(system, last, z, first, PROJECTION_OF_OUTPUT)
        if (np.abs(last - z) > MOVED * max(tolerance, LEAST) * (system.state_magnitudes + np.abs(z))).any():
            last = np.nan * last  # the defect is no error of the solver, as where the energy jumps
        yield last


def _projected_outputs(adaptive: Callable[..., Any], outputs: Callable[..., Any] | None) -> Callable[..., Any]:
    def solved(system: System, z0: Any, times: Any, rtol: float, atol: float) -> Any:
        states, counts = stopped_at_kinks(adaptive, outputs, system, z0, times, rtol, atol)
        return _mended(states, system, z0, rtol), counts

    return solved


def _projected_solver(adaptive: Callable[..., Any]) -> Callable[..., Any]:
    one_by_one = _projected_outputs(adaptive, None)

    def solved(*problem: Any) -> Any:
        states, counts = one_by_one(*problem)
        return np.array(list(states)), counts

    return solved


def project(method=VERLET_HEAT4.name):
    return projected(VERLET_HEAT4 if method == VERLET_HEAT4.name else find_integrator(method))


def methods(integrators):
    """Methods that a projection changes: not adaptive ones that keep the energy, nor those for one system only.
    Formulas that keep the energy may lose an invariant that is not quadratic."""
    others = (
        n for n, i in integrators.items()
        if not i.memory and not i.systems and i.family is not project
        and ("energy" not in i.claims or (i.kind == "flows" and "projected" not in i.tags and i.flows[-1].most == 1))
    )  # fmt: skip
    return [VERLET_HEAT4.name, *(name for name in others if name != VERLET_HEAT4.name)]


@hookimpl
def tcbench_integrators():
    return [family(project, method=methods)]
