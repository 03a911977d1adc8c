"""`controlled[method=NAME]`: any one-step method with its step chosen by a tolerance, by step doubling.

Each step is done once with h and once as two halves; their gap, over 2^p - 1, estimates the error of the halves. It is
held at the tolerance times the share of the step in the whole time, so that the errors of all steps add up to the
tolerance. The result is that of the halves, that is, steps of the method itself, which keep the same laws. `tol=1e-6`
fixes the tolerance, whatever is asked for. Source: Hairer, Norsett & Wanner, Solving ODEs I, II.4.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcbench import Integrator, TcbenchError, family, hookimpl, stepper
from tcbench.plugins import find_integrator

from .tc_gauss import tc_gauss
from .tc_gauss.memory import LONG

DEFAULT = "tc_gauss"  # of high order: a low one takes very many steps to a tight tolerance
SAFETY, SHRINK, GROW, SMALLEST, TINY = 0.9, 0.2, 5.0, 1e-12, 1e-300
ROUND_OFF = 4e-16  # of a component: a gap as small says nothing of the method
STUCK = 8  # steps in a row, each shorter than the last, whose gap is round-off and yet too large


def controlled(method: Integrator, tolerance: float | None = None, name: str = "controlled"):
    """`method` with a step that follows the tolerance (this one, or the one a run asks for)."""
    if method.kind == "adaptive" or method.memory or method.order is None:
        raise TcbenchError(f"{method.name!r} has no step of its own that could be controlled; take a one-step method.")

    def adaptive(system, z0, times, rtol, atol):
        return doubling(stepper(method, system), z0, times, tolerance or rtol, tolerance or atol)

    return Integrator(
        name=name, adaptive=adaptive, claims=method.claims, systems=method.systems, needs=method.needs,
        elements=method.elements, refuses=method.refuses, by_default=method.by_default,
        requires=method.requires, uses=method.sources,
        source=f"step doubling around {method.name}", tags=set() if tolerance is None else {"fixed tolerance"},
    )  # fmt: skip


def doubling(step: Any, z: Any, times: Any, rtol: float, atol: float):
    """States at the times, and counts. Raises ArithmeticError where no step is short enough."""
    order, whole, t = step.order, times[-1] - times[0], times[0]
    h, states, done, before, stuck = (rtol + atol) ** (1 / order) * max(1.0, whole / LONG), [z], 0, step.iterations, 0
    least, atol = step.system.least_each, step.system.absolute(atol)
    for end in times[1:]:
        while t < end:
            left = end - t
            tried = left if left < 1.01 * h else min(h, left / 2)
            try:
                once, twice = step(z, tried), step(step(z, tried / 2), tried / 2)
                gap, size = np.abs(twice - once), np.maximum(np.abs(z), np.abs(twice))
                why = "they err by more than the tolerance"
                error = float((gap / (atol + rtol * size)).max()) / (2**order - 1) * whole / tried
                rounded = bool((gap <= ROUND_OFF * np.maximum(least, size)).all())
            except ArithmeticError as failed:
                error, why, rounded = np.inf, str(failed), False
            proposed = tried * min(GROW, max(SHRINK, SAFETY * (error + TINY) ** (-1 / order)))
            stuck = stuck + 1 if error > 1 and rounded else 0
            # a step that was cut to end at an output says nothing against a longer one
            h = proposed if error > 1 or tried >= h else max(h, proposed)
            if error <= 1:
                z, t, done = twice, end if tried == left else t + tried, done + 2
            elif stuck == STUCK or h < SMALLEST * whole:
                if stuck:
                    why = (
                        f"a tolerance of {rtol:g} over t = {whole:g} asks for errors below round-off; take a looser "
                        "one, a shorter run, or a method of higher order"
                    )
                raise ArithmeticError(f"no step of {step.method.name} is short enough at t = {t:g}: {why}")
        states.append(z)
    return np.array(states), {"steps": done, "newton_iterations": step.iterations - before}


def make(method: str = DEFAULT, tol: str = "asked"):
    return controlled(
        tc_gauss() if method == DEFAULT else find_integrator(method), None if tol == "asked" else float(tol)
    )


def one_step_methods(known: dict[str, Integrator]):
    """Every method with a step, the default first."""
    others = (n for n, i in known.items() if i.kind != "adaptive" and not i.memory and n != DEFAULT)
    return [DEFAULT, *others]


@hookimpl
def tcbench_integrators():
    tolerances = ("asked", *(f"1e-{k}" for k in range(2, 13)))
    return [family(make, method=one_step_methods, tol=tolerances)]
