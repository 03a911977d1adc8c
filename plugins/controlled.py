"""`controlled[method=NAME]`: any one-step method with its step chosen by a tolerance, by step doubling.

Each step is taken once with h and once as two halves; their gap, over 2^p - 1, estimates the error of the halves. It is
held at the tolerance times the share of the step in the whole time, so that the errors of all steps add up to the
tolerance. The halves are the result: steps of the method itself, which keep the same laws. `tol=1e-6` fixes the
tolerance, whatever a run asks for. Source: Hairer, Norsett & Wanner, Solving ODEs I, II.4.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcbench import Integrator, TcbenchError, family, hookimpl, stepper
from tcbench.compiler import derivatives as trace
from tcbench.compiler.array_kernels import array_kernel
from tcbench.compiler.array_mesh import alone
from tcbench.compiler.array_states import entries
from tcbench.compiler.caches import cached
from tcbench.compiler.library import Library
from tcbench.plugins import find_integrator
from tcbench.solver.foresight import NO_RATES

from .tc_gauss import tc_gauss
from .tc_gauss.formulas import kink_blocks, kinks_of
from .tc_gauss.march import defect_between, jump_between, turn
from .tc_gauss.memory import LONG, Work

DEFAULT = "tc_gauss"  # of high order: a low one takes very many steps to a tight tolerance
SAFETY, SHRINK, GROW, SMALLEST, NOT_ZERO = 0.9, 0.2, 5.0, 1e-12, 1e-300
GAP_ROUND_OFF = 4e-16  # relative gap of a component that says nothing of the method
UNEVEN, ALIKE = 0.375, 32.0  # first of two uneven parts of a step, and their gap to the halves in units of round-off
LEAST_SHARE = 1e-3  # of the tolerance that each step may use, however short, where rates have kinks
MOST_TURNS = 60  # steps in a row that meet a kink before the run fails: it sticks in one, or slides along it
STUCK = 8  # steps in a row, each shorter than the last, whose gap is round-off and yet too large
LOOKS = Library("kinks of steps", jump_between, defect_between)
OF_COLLOCATION = ("k", "rows", "n_factors", "n_lanes", "n_own", "n_nodes", "n_carried", "n_slopes", "n_mended")


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


class Kinks:
    """Numbers u of a system's state by which steps of any method see its kinks, as `tc_gauss.march` does: those that
    change their sign where rates have a kink, and then those that are positive where the rates are not flat."""

    def __init__(self, kernel: Any, jumping: int, system: Any):
        size, c, self.kernel, self.n = system.size, system.constant_values, kernel, (kernel.size - system.size) // 2
        self.work = Work(
            m=size, n_laws=size, n_ends=kernel.size, n_kinks=2 * self.n, n_jumping=jumping, n_constants=len(c), c=c,
            to_start=kernel.address, **dict.fromkeys(OF_COLLOCATION, 0),
        )  # fmt: skip

    def __call__(self, z: Any):
        """At a state (m,): its rates (m,), each u (n,) and its rate (n,), one after the other."""
        return self.kernel(np.ascontiguousarray(z, dtype=float), self.work.c)

    def numbers(self, z: Any):
        """Each u at a state, shape (n,)."""
        return self(z)[self.work.m :][: self.n]

    def change(self, before: Any, after: Any, h: float) -> bool:
        """Does any u change its sign between two states a time h apart, or may it? before, after : of `__call__`."""
        (_, u, slope), (_, v, last) = (np.split(x, [self.work.m, self.work.m + self.n]) for x in (before, after))
        return any(part >= 0.0 for part in map(turn, u, v, h * slope, h * last))

    def jump(self, z: Any, z1: Any, before: Any, after: Any, h: float, sizes: Any) -> float | None:
        """h times the largest jump of a rate at a kink in a step from z to z1, over `sizes` (m,); None without a kink,
        infinite where both ends do not tell.

        These may lie on both sides of a narrow window, so the rates at the kink itself are compared with the slope of
        the cubic from end to end."""
        w = self.work
        w.here[:], w.now[:] = z, z1
        w.lend("inverse_sizes", 1.0 / sizes)
        largest = LOOKS.jump_between(w, before, after, h)
        if largest < 0.0:
            return None
        if largest == 0.0:  # no kink, but exponents are steep: nothing is known of what is between both ends
            largest = LOOKS.defect_between(w, before, after, 0.5, h)
        else:
            largest = max(largest, float((np.abs(h * (after - before)[: w.m]) / sizes).max()))
        return largest if largest < np.inf else np.inf  # also of what is no number


def kinks_in(system: Any) -> Kinks | None:
    """Those of a system; None where its rates have none."""
    kernel, jumping = kinks_kernel(system.by_arrays if system.large else system.symbolic)
    if kernel is None:
        return None
    if not system.large:
        return Kinks(kernel, len(jumping), system)
    return Kinks(kernel.kernel(system.mesh), system.mesh.offsets(alone(jumping))[-1], system)


@cached
def kinks_kernel(symbolic: Any):
    with trace.tracing():
        z = symbolic.unknowns("z")
        rates = symbolic.vector_field(z)
        kinks, jumping = kinks_of(entries(rates), entries(z))
        if not kinks:
            return None, []
        if not symbolic.by_array:
            return symbolic.compiled([z], [rates, *kinks]), jumping
        into = {"a": symbolic.blocks(z), "b": symbolic.constant_blocks()}
        return array_kernel(into, [*symbolic.blocks(rates), *kink_blocks(kinks)]), jumping


def doubling(step: Any, z: Any, times: Any, rtol: float, atol: float):
    """(states at the times, counts); ArithmeticError where no step is short enough."""
    order, whole, t = step.order, times[-1] - times[0], times[0]
    h, states, done, before, stuck = (rtol + atol) ** (1 / order) * max(1.0, whole / LONG), [z], 0, step.iterations, 0
    kinks, turned = kinks_in(step.system), 0
    least, atol = step.system.state_magnitudes, step.system.absolute(atol)
    for end in times[1:]:
        while t < end:
            left = end - t
            tried = left if left < 1.01 * h else min(h, left / 2)
            try:
                full, divided = step(z, tried), step.divided
                half = step(z, tried / 2)
                twice = step(half, tried / 2)
                gap, size = np.abs(twice - full), np.maximum(np.abs(z), np.abs(twice))
                digits = GAP_ROUND_OFF * np.maximum(least, size)
                if (gap <= ALIKE * digits).all():  # exact, or two steps that are one in disguise
                    uneven = np.abs(step(step(z, UNEVEN * tried), tried - UNEVEN * tried) - twice)
                    gap = np.where(uneven > ALIKE * digits, (2**order - 1) * uneven, gap)
                why = f"{step.method.name} takes them in parts" if divided else "they err by more than the tolerance"
                share = tried if kinks is None else max(tried, LEAST_SHARE * whole)  # behind a kink steps begin short
                sizes, jumps = atol + rtol * size, list[float]()
                error = float((gap / sizes).max()) / (2**order - 1) * whole / share
                if kinks is not None:
                    first, middle, last = map(kinks, (z, half, twice))
                    halves = (z, half, first, middle), (half, twice, middle, last)
                    found = (kinks.jump(*ends, tried / 2, sizes) for ends in halves)
                    jumps = [x for x in found if x is not None]
                kink = bool(jumps)
                turned = turned + 1 if kink else 0
                error = np.inf if divided else max([error, *jumps])  # no method has its order at a kink
                rounded = not kink and not divided and bool((gap <= digits).all())
            except ArithmeticError as failed:
                error, why, rounded, kink = np.inf, str(failed), False, False
            proposed = tried * min(GROW, max(SHRINK, SAFETY * (error + NOT_ZERO) ** (-1 / (2 if kink else order))))
            stuck = stuck + 1 if error > 1 and rounded else 0
            # a step that ends at an output does not limit the next one
            h = proposed if error > 1 or tried >= h else max(h, proposed)
            if error <= 1:
                z, t, done = twice, end if tried == left else t + tried, done + 2
            elif stuck == STUCK or turned > MOST_TURNS or h < SMALLEST * whole:
                if kink:
                    why = f"its rates have kinks, and {NO_RATES}"
                if stuck:
                    why = (
                        f"a tolerance of {rtol:g} over t = {whole:g} asks for errors below round-off; take a looser "
                        "one, a shorter run, or a method of higher order"
                    )
                gave_up = ArithmeticError(f"no step of {step.method.name} is short enough at t = {t:g}: {why}")
                vars(gave_up)["states"] = np.array(states)
                raise gave_up
        states.append(z)
    return np.array(states), {"steps": done, "newton_iterations": step.iterations - before}


def make(method: str = DEFAULT, tol: str = "asked"):
    return controlled(
        tc_gauss() if method == DEFAULT else find_integrator(method), None if tol == "asked" else float(tol)
    )


def one_step_methods(integrators: dict[str, Integrator]):
    """Every method with a step, the default first."""
    others = (n for n, i in integrators.items() if i.kind != "adaptive" and not i.memory and n != DEFAULT)
    return [DEFAULT, *others]


@hookimpl
def tcbench_integrators():
    tolerances = ("asked", *(f"1e-{k}" for k in range(2, 13)))
    return [family(make, method=one_step_methods, tol=tolerances)]
