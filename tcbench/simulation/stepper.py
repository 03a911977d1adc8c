"""`stepper`: one step of a registered method as a function, for methods that are made of others."""

from __future__ import annotations

import math
import threading
from typing import Any

import numpy as np

from ..errors import TcbenchError, expect, shown
from ..integrator import Integrator
from ..solver.implicit_step import NO_ROOT, NONCONVERGED, OK, Rules, compiled_flows
from ..solver.kernels_of_flow import FlowKernels
from ..systems.scenario import Scenario
from ..systems.state import State
from ..systems.system import System
from .prepared import Prepared, take
from .python_loop import real
from .recorder import cause_of

BACK = 1e-9  # gap, over each variable's size, of a step and its way back


def stepper(method: str | Integrator, system: System | Scenario | str) -> Stepper:
    """One step of a method as a function, z1 = step(z, h).

    For Richardson extrapolation, composition, step-size control and other methods made of steps of another one;
    a plugin's `step` or `adaptive` may call it every time. The step is solved as in a run, continuation included, but
    as the first of a run: z1 depends on z and h alone, and rounding errors are not carried on to the next step.

    Parameters
    ----------
    method : str or Integrator
        A one-step method: no adaptive solver and no multistep method.
    system : System, Scenario or str
        The system; for a scenario, its system.

    Returns
    -------
    Stepper
        Called with z, a finite state of shape (n,), and h, finite, in the system's dimensionless time; gives z1, shape
        (n,). `iterations` counts Newton iterations so far. A step of h < 0 is a root that is joined to z, or one from
        which the step of -h leads to z.

    Raises
    ------
    TcbenchError
        For other kinds of methods, methods that cannot run on this system, and, when it is called, for an invalid
        state.
    ArithmeticError
        When it is called and there is no step; with the cause.

    References
    ----------
    docs/stability.md: which root of its equations a step is.
    """
    from .. import plugins

    method = plugins.find_integrator(method)
    if not isinstance(system, System):
        system = plugins.find_scenario(system).model
    if reason := method.lacks or method.suits(system):
        raise TcbenchError(f"{method.name!r} cannot step a {system.name}: {reason}.")
    if method.kind == "adaptive" or method.memory:
        kind = "an adaptive solver" if method.kind == "adaptive" else "a multistep method"
        raise TcbenchError(f"{method.name!r} is {kind}: it has no step that depends on z and h alone.")
    kernels = compiled_flows(method.flows, system.symbolic) if method.kind == "flows" else ()
    return Stepper(method, system, kernels)


class Stepper:
    """z1 = step(z, h); see `stepper`. It holds the workspace of a run; threads that share one take turns."""

    _ready: Prepared | None = None

    def __init__(self, method: Integrator, system: System, kernels: tuple[FlowKernels, ...]) -> None:
        self.method, self.system, self._held = method, system, method.held_by_a_run(system)
        self._lock = threading.RLock()
        if kernels:
            self._ready = take(method, system, kernels)
            self._ready.clear()
            self._ready.run.make_room(2)  # earlier records belong to the run that made them
            self._ready.set_rules(Rules(), math.inf)
            self._ready.set_length(1.0)

    def __del__(self) -> None:
        if self._ready is not None:
            self._ready.give_back()

    def __reduce__(self) -> Any:
        return stepper, (self.method, self.system)  # a copy has a workspace of its own

    @property
    def order(self) -> int | None:
        return self.method.order

    @property
    def iterations(self) -> int:
        """Newton iterations so far; 0 where the method solves by itself."""
        return 0 if self._ready is None else self._ready.tally.iterations

    @property
    def divided(self) -> bool:
        """Did the method take its last step in parts, as what its `step` holds for a run says by `divided`? Two steps
        of half the length may consist of the same parts: they do not tell what it errs by."""
        return any(getattr(held, "divided", False) for held in self._held)

    def __call__(self, z: Any, h: float) -> State:
        expect("A step", {"h": h}, {"h": "a number"})
        try:
            z, h = real(z), float(h)
        except (TypeError, ValueError, OverflowError):
            raise TcbenchError(f"A step begins at a state of numbers, not at z = {shown(z)}.") from None
        if z.shape != (self.system.size,):
            raise TcbenchError(f"A state of this {self.system.name} has shape ({self.system.size},), not {z.shape}.")
        if not (math.isfinite(h) and np.isfinite(z).all()):
            raise TcbenchError(f"A step begins at a finite state and has a finite length, not z = {z!r} and h = {h:g}.")
        with self._lock:
            z1 = self._by_function(z, h) if self._ready is None else self._by_flows(self._ready, z, h)
        return self.system.state(z1)

    def _by_function(self, z: np.ndarray, h: float) -> np.ndarray:
        assert self.method.step is not None
        z1 = real(self.method.step(self.system.state(z), h, self.system, *self._held))
        return z + z1 if self.method.increments else z1

    def _by_flows(self, ready: Prepared, z: np.ndarray, h: float) -> np.ndarray:
        reason = self._solved(ready, z, h)
        if reason != OK and h < 0 and self._backwards(ready, z, h):
            return ready.run.z.copy()
        if reason != OK:
            cause = cause_of(reason, self.system, self.method)
            if h < 0 and reason in (NONCONVERGED, NO_ROOT):
                cause = (
                    f"the roots that begin at this state end on the way back, and no other was found from which a step "
                    f"of {-h:g} leads here"
                )
            raise ArithmeticError(f"{self.method.name}, a step of {h:g}: {cause}")
        return ready.run.z.copy()

    def _solved(self, ready: Prepared, z: np.ndarray, h: float) -> int:
        if h != ready.run.h:
            ready.set_length(h)
        return ready.step(z)

    def _backwards(self, ready: Prepared, z: np.ndarray, h: float) -> bool:
        """Is there, off the branch that begins at z, a root from which a step forwards leads to z? It is left in run.z.

        Conduction in a step of -h has a pole where h is its own time: behind it roots have det J < 0, and only plain
        Newton takes these.
        """
        ready.set_rules(Rules(continuation=False), math.inf)
        try:
            status, z1 = self._solved(ready, z, h), ready.run.z.copy()
        finally:
            ready.set_rules(Rules(), math.inf)
        if status != OK or self._solved(ready, z1, -h) != OK:
            return False
        away = np.abs(ready.run.z - z) / np.maximum(self.system.state_magnitudes, np.abs(z))
        ready.run.z[:] = z1
        return bool(away.max() <= BACK)
