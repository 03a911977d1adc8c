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
from tcbench.plugins import find_integrator
from tcbench.solver.foresight import NO_RATES

from .tc_gauss import tc_gauss
from .tc_gauss.formulas import kink_blocks, kinks_of
from .tc_gauss.march import CLOSER, LITTLE, RISE, UNSEEN, summit, turn
from .tc_gauss.memory import LONG

DEFAULT = "tc_gauss"  # of high order: a low one takes very many steps to a tight tolerance
SAFETY, SHRINK, GROW, SMALLEST, NOT_ZERO = 0.9, 0.2, 5.0, 1e-12, 1e-300
GAP_ROUND_OFF = 4e-16  # relative gap of a component that says nothing of the method
UNEVEN, ALIKE = 0.375, 32.0  # first of two uneven parts of a step, and their gap to the halves in units of round-off
LEAST_SHARE = 1e-3  # of the tolerance that each step may use, however short, where rates have kinks
MOST_TURNS = 60  # steps in a row that meet a kink before the run fails: it sticks in one, or slides along it
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


class Kinks:
    """z -> (numbers that change their sign where the rates have a kink, then numbers that are positive where the rates
    are not flat; the rates of all these; the rates (n,)). jumping : how many are of the first kind."""

    def __init__(self, kernel: Any, jumping: int, system: Any):
        self.kernel, self.jumping, self.c = kernel, jumping, system.constant_values
        n = (kernel.size - system.size) // 2
        self.parts = [n, 2 * n]

    def __call__(self, z: Any):
        return np.split(self.kernel(np.ascontiguousarray(z, dtype=float), self.c), self.parts)


def kinks_in(system: Any) -> Kinks | None:
    """Those of a system; None where its rates have none."""
    kernel, jumping = kinks_kernel(system.by_arrays if system.large else system.symbolic)
    if kernel and system.large:
        kernel, jumping = kernel.kernel(system.mesh), [None] * system.mesh.offsets(alone(jumping))[-1]
    return Kinks(kernel, len(jumping), system) if kernel else None


@cached
def kinks_kernel(symbolic: Any):
    with trace.tracing():
        z = symbolic.unknowns("z")
        rates = symbolic.vector_field(z)
        kinks, jumping = kinks_of(entries(rates), entries(z))
        if not kinks:
            return None, []
        if not symbolic.by_array:
            return symbolic.compiled([z], [*kinks, rates]), jumping
        into = {"a": symbolic.blocks(z), "b": symbolic.constant_blocks()}
        return array_kernel(into, [*kink_blocks(kinks), *symbolic.blocks(rates)]), jumping


def turns(before: Any, after: Any, h: float) -> list[float]:
    """The parts of a time h after which a number with a kink of the rates changes, or may change, its sign."""
    return [s for s in map(turn, before[0], after[0], h * before[1], h * after[1]) if s >= 0.0]


def jump(kinks: Any, z: Any, z1: Any, before: Any, after: Any, h: float):
    """h times the largest jump of each rate at a kink in a step from z to z1, shape (n,); None without a kink.

    before, after : `kinks` at both ends. These may lie on both sides of a narrow window, so the rates at the kink
    itself are compared with the slope of the cubic from end to end."""
    d, p, q = z1 - z, h * before[2], h * after[2]
    second, third = 3.0 * d - 2.0 * p - q, p + q - 2.0 * d
    n = kinks.jumping
    gaps, size = [np.abs(q - p)], max(np.abs([*before[0][:n], *after[0][:n]]), default=0.0)
    cubic = lambda x: kinks(z + x * (p + x * (second + x * third)))  # noqa: E731
    if any(is_hidden(i, cubic, before, after, h) for i in range(n, len(before[0]))):
        return np.full_like(z, np.inf)
    for i, s in enumerate(map(turn, before[0][:n], after[0][:n], h * before[1], h * after[1])):
        left, right, tries = (0.0, before), (1.0, after), 0
        while s >= 0.0 and tries < CLOSER:
            if s == UNSEEN:
                if max(abs(end[1][k][i]) * (h if k else 1.0) for end in (left, right) for k in (0, 1)) < LITTLE * size:
                    break
                return np.full_like(z, np.inf)
            x = left[0] + (s if tries % 2 == 0 else 0.5) * (right[0] - left[0])
            middle = x, cubic(x)
            gaps.append(np.abs(h * middle[1][2] - (p + x * (2.0 * second + 3.0 * x * third))))
            u, m, v = (end[1][0][i] for end in (left, middle, right))
            tries = tries + 1 if u * v > 0.0 and u * m > 0.0 else CLOSER
            left, right = (middle, right) if u * middle[1][1][i] < 0.0 else (left, middle)
            part = h * (right[0] - left[0])
            s = turn(left[1][0][i], right[1][0][i], part * left[1][1][i], part * right[1][1][i])
    return np.max(gaps, axis=0) if len(gaps) > 1 else None


def is_hidden(i: int, kinks: Any, before: Any, after: Any, h: float) -> bool:
    """As `march.is_hidden`; kinks: by the part of a step."""
    (u, slope), (v, last) = ((end[0][i], h * end[1][i]) for end in (before, after))
    left, right, seen = 0.0, 1.0, max(u, v) + RISE
    x, tries = summit(u, v, slope, last, seen), 0
    while x >= 0.0 and tries < CLOSER:
        middle, slope, _ = kinks(x)
        if middle[i] > max(seen, 0.0):
            return True
        left, right = (x, right) if slope[i] > 0.0 else (left, x)
        x, tries = (left + right) / 2, tries + 1
    return False


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
                full, half = step(z, tried), step(z, tried / 2)
                twice = step(half, tried / 2)
                gap, size = np.abs(twice - full), np.maximum(np.abs(z), np.abs(twice))
                digits = GAP_ROUND_OFF * np.maximum(least, size)
                if (gap <= ALIKE * digits).all():  # exact, or a step that the method itself took in halves
                    uneven = np.abs(step(step(z, UNEVEN * tried), tried - UNEVEN * tried) - twice)
                    gap = np.where(uneven > ALIKE * digits, (2**order - 1) * uneven, gap)
                why = "they err by more than the tolerance"
                share = tried if kinks is None else max(tried, LEAST_SHARE * whole)  # behind a kink steps begin short
                error = float((gap / (atol + rtol * size)).max()) / (2**order - 1) * whole / share
                jumps = None
                if kinks is not None:
                    first, middle, last = map(kinks, (z, half, twice))
                    halves = (z, half, first, middle), (half, twice, middle, last)
                    jumps = [x for x in (jump(kinks, *ends, tried / 2) for ends in halves) if x is not None]
                kink = bool(jumps)
                turned = turned + 1 if kink else 0
                if kink:  # no method has its order there
                    error = max(error, float((np.max(jumps, axis=0) / (atol + rtol * size)).max()))
                rounded = not kink and bool((gap <= digits).all())
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
