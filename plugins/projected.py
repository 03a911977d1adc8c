"""Thermodynamic projection: any method made to keep energy and momenta, with an entropy that never falls.

After each step (of an adaptive solver: at each output time) the result is moved to the nearest state, in a simple
sense, with the values that the run began with:
1. the momenta are rotated back: along m dJ/dp, for each invariant J, which must be linear in p;
2. all entropies are shifted by the same amount until the energy is right, if the total then is no lower than before
   the step; otherwise to the total before the step,
3. and what energy is still missing goes into the part of the momenta that carries no invariant.
If that part has less kinetic energy than must go, no momenta and entropies at these positions have the right energy:
the part is stopped, entropy and momenta are kept and the energy is not. It happens at steps at which the method alone
fails, and close to an equilibrium, where little kinetic energy is left; so projected methods claim entropy and momenta.
The correction is as small as the error of one step, so the order stays. Source: docs/methods.md.

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
from tcbench.compiler import derivatives as trace
from tcbench.plugins import find_integrator
from tcbench.solver.flow_kernels import apply_explicit
from tcbench.systems.momenta import lengthening, restored_momenta

from .exact_conduction import VERLET_HEAT4

SMALLEST_SHARE = 1e-12  # of the energy, as kinetic energy free to change: below it 3. does nothing


def projected(method: Integrator, name: str = "projected") -> Integrator:
    """`method` with the thermodynamic projection after each step; an Integrator of the same order.

    Raises TcbenchError for multistep methods: their earlier states would have to be projected, too.
    """
    if method.memory:
        raise TcbenchError(f"{method.name!r} is a multistep method: take a one-step method or an adaptive solver.")
    common: dict[str, Any] = {
        "name": name, "claims": {"entropy", "angular_momentum"}, "tags": method.tags | {"projected"},
        "source": f"thermodynamic projection around {method.name}", "description": "",
        "uses": method.sources, "parameters": {}, "family": None,
        "elements": True,
    }  # fmt: skip
    if method.adaptive is not None:
        outputs = method.outputs and _projected_outputs(method.outputs)
        return replace(method, **common, adaptive=_projected_solver(method.adaptive), outputs=outputs)
    if method.kind == "flows":
        return replace(method, **common, flows=[*method.flows, Flow(projection, of_step=True)])
    assert method.step is not None
    # each step is projected before the next begins, so the loop of a method that marches by itself is left unused
    step = _projected_step(method.step, method.increments)
    return replace(method, **common, step=step, increments=True, march=None)


def projection(z0: Any, z1: Any, h: Any, system: System, start: Any, first: Any) -> Any:
    """z1 = the projection of z0, for a step that began at `start` in a run that began at `first`; explicit.

    Energy and momenta are taken from `first`: from `start` their round-off would add up.
    """
    p, free = restored_momenta(z0, system, system.invariants(first.q, first.p))
    energy, risen = system.energy(first), sum(z0.s) - sum(start.s)

    def at(shift: Any) -> Any:
        return system.state(np.concatenate([z0.q, p, z0.s + shift]))

    missing, heat = energy - system.energy(at(0.0)), sum(system.temperatures(at(0.0)))
    c = np.mean(system.entropy_scale() * np.ones(system.n_elements))
    shift = c * np.log1p(missing / (c * heat))  # exact where heat grows as exp(s/c)
    shift = shift + (energy - system.energy(at(shift))) / sum(system.temperatures(at(shift)))
    shift = trace.maximum(shift, -risen / system.n_elements)
    missing = energy - system.energy(at(shift))
    kinetic = sum(free * free / system.inertia()) / 2
    floor = SMALLEST_SHARE * (1.0 + abs(energy))
    x = trace.maximum(missing * kinetic / (kinetic * kinetic + floor * floor), trace.const(-1.0))
    scaled = p + lengthening(free, x)
    return z1 - np.concatenate([z0.q, scaled, z0.s + shift])


def _projected_step(step: Callable[..., Any], increments: bool) -> Callable[..., Any]:
    def stepped(z: Any, h: float, system: System, *held: Any) -> Any:
        found = np.asarray(step(z, h, system, *held), dtype=float)
        if found.shape != np.shape(z):
            raise ValueError(f"the step returned shape {found.shape}, a state has shape {np.shape(z)}")
        dz = found if increments else found - z
        return dz + apply_explicit(projection, system, np.asarray(z), z + dz)

    return stepped


def _mended(states: Iterable[Any], system: System, z0: Any) -> Iterator[Any]:
    """What a user of a solver can do: its outputs are projected, its own steps are as they were."""
    first = last = np.asarray(z0, dtype=float)
    yield first
    for state in itertools.islice(states, 1, None):
        last = state + apply_explicit(projection, system, last, np.asarray(state, dtype=float), first)
        yield last


def _projected_solver(adaptive: Callable[..., Any]) -> Callable[..., Any]:
    def solved(system: System, z0: Any, times: Any, rtol: float, atol: float) -> Any:
        found = adaptive(system, z0, times, rtol, atol)
        states, counts = found if isinstance(found, tuple) else (found, {})
        return np.array(list(_mended(states, system, z0))), counts

    return solved


def _projected_outputs(outputs: Callable[..., Any]) -> Callable[..., Any]:
    def solved(system: System, z0: Any, times: Any, rtol: float, atol: float) -> Any:
        states, counts = outputs(system, z0, times, rtol, atol)
        return _mended(states, system, z0), counts

    return solved


def project(method=VERLET_HEAT4.name):
    return projected(VERLET_HEAT4 if method == VERLET_HEAT4.name else find_integrator(method))


def methods(known):
    """Those that a projection changes: not the ones that keep the energy already, nor those for one system only."""
    others = (
        n for n, i in known.items()
        if not i.memory and "energy" not in i.claims and not i.systems and i.family is not project
    )  # fmt: skip
    return [VERLET_HEAT4.name, *(name for name in others if name != VERLET_HEAT4.name)]


@hookimpl
def tcbench_integrators():
    return [family(project, method=methods)]
