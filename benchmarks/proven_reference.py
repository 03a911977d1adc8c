"""Proves a stored reference: balls of Arb around the exact state, and whether they hold the stored one.

python benchmarks/proven_reference.py bound_equilibrium 64 24      # ten seconds
python benchmarks/proven_reference.py short_term 1024 60           # minutes: conduction is stiff there

A proven bound: intervals that contain the exact state, by Taylor series with a bounded remainder (Moore 1966).

Every number is a ball of Arb (python-flint): an interval that contains the exact value whatever was rounded. In a step
from z the solution stays in a box B if z + [0, h] f(B) lies in B (Picard and Lindeloef); then

    z(h) = sum_(k <= p) z_k h^k + b h^(p+1),    b in the coefficients p + 1 of the series from all of B.

Intervals widen by e^(2 lambda h) and more a step, for the solver treats what decays as if it grew: hence hundreds of
bits. Data are exact decimals, as in the stored references: 2.2 is 22/10.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from fractions import Fraction
from operator import methodcaller
from typing import Any

import tcbench
from tcbench.errors import TcbenchError
from tcbench.reference.certified import stored
from tcbench.systems.right_hand_side import as_python
from tcbench.systems.scenario import Scenario

BITS, ROUGH_BITS = 900, 128  # of the numbers; of a box, which is wide anyhow
INFLATIONS = 30


def proven_state(
    scenario: Scenario, t: float, steps: int = 256, order: int = 80, bits: int = BITS,
    on_step: Callable[[int], None] | None = None,
) -> list[Any]:  # fmt: skip
    """The state (q, p, s) at t as balls (`flint.arb`): proven to contain the exact one. Dimensionless.

    Raises TcbenchError where python-flint is absent, or no box is found (take more steps).
    """
    try:
        from flint import arb, ctx
    except ImportError:
        raise TcbenchError("Proven bounds need python-flint: pip install 'tcbench[proof]'.") from None
    model, before = scenario.model, (ctx.prec, ctx.cap)
    ctx.prec = bits
    try:
        constants = [exact(x) for x in model.constant_values]
        start = [exact(x) for x in (*scenario.positions, *scenario.momenta, *scenario.temperatures)]
        z = evaluated(model.formula("entropy_variables")[0], start, constants)
        h = exact(t) / steps
        text = model.formula("vector_field")[0]
        for k in range(steps):
            ctx.prec = ROUGH_BITS
            remainder = coefficients(text, box_of(text, z, h, constants), constants, order + 1)[-1]
            ctx.prec = bits
            series = coefficients(text, z, constants, order)
            z = [
                sum((c * h**j for j, c in enumerate(own)), arb(0)) + rest * h ** (order + 1)
                for own, rest in zip(zip(*series, strict=True), remainder, strict=True)
            ]
            if on_step is not None:
                on_step(k + 1)
        return z
    finally:
        ctx.prec, ctx.cap = before


def exact(x: float) -> Any:
    """The decimal number that a double is written as, as a ball."""
    from flint import arb, fmpq

    value = Fraction(repr(float(x)))
    return arb(fmpq(value.numerator, value.denominator))


def functions() -> dict[str, Callable[..., Any]]:
    names = ("exp", "log", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan")
    return {name: methodcaller(name) for name in names} | {"pow": pow}


def evaluated(text: str, state: Sequence[Any], constants: Sequence[Any]) -> list[Any]:
    """A formula of the system in this arithmetic."""
    out: dict[int, Any] = {}
    as_python(text, functions())(list(state), list(constants), out)
    return [out[i] for i in range(len(out))]


def coefficients(text: str, z: Sequence[Any], constants: Sequence[Any], order: int) -> list[list[Any]]:
    """Taylor coefficients 0 .. order of the solution from z, each a list of n: z = z_0 + integral of f(z), repeated."""
    from flint import arb_series, ctx

    solution = [arb_series([x], 1) for x in z]
    for k in range(1, order + 1):
        ctx.cap = k
        rates = evaluated(text, solution, constants)
        ctx.cap = k + 1
        solution = [x + rate.integral() for x, rate in zip(z, rates, strict=True)]
    return [[x[k] for x in solution] for k in range(order + 1)]


def box_of(text: str, z: Sequence[Any], h: Any, constants: Sequence[Any]) -> list[Any]:
    """A box in which every solution from z stays for the time h."""
    from flint import arb

    time = arb(0).union(h)
    box = list(z)
    for _ in range(INFLATIONS):
        reached = [x + time * rate for x, rate in zip(z, evaluated(text, box, constants), strict=True)]
        if not all(r.is_finite() for r in reached):
            break
        if all(b.contains(r) for b, r in zip(box, reached, strict=True)):
            return box
        box = [arb(r.mid(), 1.5 * r.rad() + 1e-30) for r in reached]
    raise TcbenchError("No box holds the solution for a whole step: take more steps.")


def main() -> None:
    from flint import arb, ctx

    name, steps, order = sys.argv[1], *map(int, sys.argv[2:4])
    state = proven_state(tcbench.scenarios()[name], 1.0, steps, order)
    reference = stored(name)
    ctx.prec = 400
    exact = [arb(text) for text in reference.exact[reference.index(1.0)]]
    gaps = [float((abs(x - y) / (1 + abs(y))).upper()) for x, y in zip(state, exact, strict=True)]
    print(f"{name} at t = 1: the exact state is within {max(float(x.rad()) for x in state):.2g} of the balls' centres,")
    print(f"and within {max(gaps):.2g} (over 1 + |z|) of the stored one, whatever was rounded on the way.")


if __name__ == "__main__":  # asv imports every file here
    main()
