"""The text of the kernels: coefficients of all orders as straight-line code, and the polynomial that they make."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from tcbench import System
from tcbench.compiler import derivatives as trace
from tcbench.compiler.derivatives import Symbol
from tcbench.compiler.kernels import Kernel

from .series import Series, rates

Term = tuple[int, str]  # the order of its newest coefficient, and the text


class Writer:
    """Writes down coefficients when they are first asked for; a coefficient that is 0 is None."""

    def __init__(self, rate: dict[int, Series], constants: dict[int, str]) -> None:
        self.rate, self.constants = rate, constants
        self.lines: list[str] = []
        self.names: dict[tuple[int, int, str], str | None] = {}

    def name(self, text: str) -> str:
        self.lines.append(f"t{len(self.lines)} = {text}")
        return f"t{len(self.lines) - 1}"

    def coefficient(self, x: Series, n: int) -> str | None:
        """Name of coefficient n."""
        key = (id(x), n, "")
        if key not in self.names:
            self.names[key] = getattr(self, f"_{x.kind}")(x, n)
        return self.names[key]

    def scaled(self, weight: float, name: str | None) -> str | None:
        return name if name is None or weight == 1.0 else self.name(f"{weight!r} * {name}")

    def total(self, terms: list[Term]) -> str | None:
        """The sum, the terms that are known longest first."""
        ordered = [text for _, text in sorted(terms, key=lambda term: term[0])]
        return " + ".join(ordered) if ordered else None

    def convolution(self, a: Series, b: Series, n: int, first: int = 0, last: int | None = None) -> list[Term]:
        """a_j b_(n-j) for j = first .. last."""
        terms = []
        for j in range(first, (n if last is None else last) + 1):
            left, right = self.coefficient(a, j), self.coefficient(b, n - j)
            if left is not None and right is not None:
                terms.append((max(j, n - j), f"{left} * {right}"))
        return terms

    def weight(self, symbol: Symbol) -> str:
        return repr(symbol.value) if symbol.op == "const" else self.constants[symbol.number]

    # ---- one recurrence a kind -----------------------------------------------------------------------------

    def _var(self, x: Series, n: int) -> str | None:
        if n == 0:
            return self.name(f"a[{x.index}]")
        return self.scaled(1.0 / n, self.coefficient(self.rate[x.index], n - 1))

    def _sum(self, x: Series, n: int) -> str | None:
        terms: list[str] = []
        for part, weight in zip(x.parts, x.weights, strict=False):
            name = self.coefficient(part, n)
            if name is not None:
                plain = trace.is_const(weight, 1.0)
                terms.append(name if plain else f"{self.weight(weight)} * {name}")
        if n == 0 and not trace.is_const(x.weights[-1], 0.0):
            terms.append(self.weight(x.weights[-1]))
        return self.name(" + ".join(terms)) if terms else None

    def _product(self, x: Series, n: int) -> str | None:
        a, b = x.parts
        if a is not b:
            text = self.total(self.convolution(a, b, n))
            return None if text is None else self.name(text)
        half = self.total(self.convolution(a, a, n, 0, (n - 1) // 2))
        middle = self.coefficient(a, n // 2) if n % 2 == 0 else None
        parts = ([f"2.0 * ({half})"] if half else []) + ([f"{middle} * {middle}"] if middle else [])
        return self.name(" + ".join(parts)) if parts else None

    def _inverse(self, x: Series) -> str:
        """1 / x_0."""
        key = (id(x), 0, "inverse")
        if key not in self.names:
            self.names[key] = self.name(f"1.0 / {self.coefficient(x, 0)}")
        return str(self.names[key])

    def _quotient(self, x: Series, n: int) -> str | None:
        above, below = x.parts
        inverse = self._inverse(below)
        known = self.total(self.convolution(below, x, n, 1))
        start = self.coefficient(above, n)
        if known is None:
            return None if start is None else self.name(f"{start} * {inverse}")
        return self.name(f"({'0.0' if start is None else start} - ({known})) * {inverse}")

    def _D(self, x: Series, n: int) -> str | None:
        (of,) = x.parts
        if of.kind == "log":
            return self._log_rate(of, n + 1)
        return self.scaled(float(n + 1), self.coefficient(of, n + 1))

    def _log_rate(self, x: Series, n: int) -> str | None:
        """n times coefficient n of log u: (n u_n - sum_(0<j<n) (j l_j) u_(n-j)) / u_0."""
        key = (id(x), n, "rate")
        if key not in self.names:
            (u,) = x.parts
            terms = []
            for j in range(1, n):
                left, right = self._log_rate(x, j), self.coefficient(u, n - j)
                if left is not None and right is not None:
                    terms.append((max(j, n - j), f"{left} * {right}"))
            newest, known = self.coefficient(u, n), self.total(terms)
            start = "0.0" if newest is None else f"{float(n)!r} * {newest}"
            text = start if known is None else f"{start} - ({known})"
            self.names[key] = None if text == "0.0" else self.name(f"({text}) * {self._inverse(u)}")
        return self.names[key]

    def _log(self, x: Series, n: int) -> str | None:
        if n == 0:
            return self.name(f"log({self.coefficient(x.parts[0], 0)})")
        return self.scaled(1.0 / n, self._log_rate(x, n))

    def _weighted(self, u: Series, n: int, x: Series) -> list[Term]:
        """(j/n) u_j x_(n-j) for j = 1 .. n."""
        terms = []
        for j in range(1, n + 1):
            left, right = self.coefficient(u, j), self.coefficient(x, n - j)
            if left is not None and right is not None:
                terms.append((max(j, n - j), f"{j / n!r} * {left} * {right}"))
        return terms

    def _exp(self, x: Series, n: int) -> str | None:
        if n == 0:
            return self.name(f"exp({self.coefficient(x.parts[0], 0)})")
        text = self.total(self._weighted(x.parts[0], n, x))
        return None if text is None else self.name(text)

    def _sqrt(self, x: Series, n: int) -> str | None:
        (u,) = x.parts
        if n == 0:
            return self.name(f"sqrt({self.coefficient(u, 0)})")
        key = (id(x), 0, "half inverse")
        if key not in self.names:
            self.names[key] = self.name(f"0.5 / {self.coefficient(x, 0)}")
        known, newest = self.total(self.convolution(x, x, n, 1, n - 1)), self.coefficient(u, n)
        text = f"{newest or '0.0'}" + (f" - ({known})" if known else "")
        return None if text == "0.0" else self.name(f"({text}) * {self.names[key]}")

    def _cached(self, x: Series, n: int, what: str, make: Callable[[], str]) -> str:
        key = (id(x), n, what)
        if key not in self.names:
            self.names[key] = self.name(make())
        return str(self.names[key])

    def _turned(self, u: Series, n: int, what: str) -> str:
        """Coefficient n of sin u or cos u: each is the other's rate."""
        if n == 0:
            return self._cached(u, 0, what, lambda: f"{what}({self.coefficient(u, 0)})")
        other, sign = ("cos", "") if what == "sin" else ("sin", "-")
        terms = [(max(j, n - j), f"{j / n!r} * {name} * {self._turned(u, n - j, other)}")
                 for j in range(1, n + 1) if (name := self.coefficient(u, j)) is not None]  # fmt: skip
        return self._cached(u, n, what, lambda: f"{sign}({self.total(terms) or '0.0'})")

    def _sin(self, x: Series, n: int) -> str | None:
        return self._turned(x.parts[0], n, "sin")

    def _cos(self, x: Series, n: int) -> str | None:
        return self._turned(x.parts[0], n, "cos")

    def _bell(self, x: Series, n: int, sign: str) -> str:
        """Coefficient n of 1 - x^2 or 1 + x^2."""
        text = self.total(self.convolution(x, x, n)) or "0.0"
        return self._cached(x, n, f"1 {sign} square", lambda: f"{'1.0' if n == 0 else '0.0'} {sign} ({text})")

    def _tanh(self, x: Series, n: int) -> str | None:
        (u,) = x.parts
        if n == 0:
            return self.name(f"tanh({self.coefficient(u, 0)})")
        terms = [(max(j, n - j), f"{j / n!r} * {name} * {self._bell(x, n - j, '-')}")
                 for j in range(1, n + 1) if (name := self.coefficient(u, j)) is not None]  # fmt: skip
        return self.name(self.total(terms) or "0.0")

    def _atan(self, x: Series, n: int) -> str | None:
        (u,) = x.parts
        if n == 0:
            return self.name(f"atan({self.coefficient(u, 0)})")
        terms = [(max(j, n - j), f"{j / n!r} * {name} * {self._bell(u, n - j, '+')}")
                 for j in range(1, n) if (name := self.coefficient(x, j)) is not None]  # fmt: skip
        known = f" - ({text})" if (text := self.total(terms)) else ""
        return self.name(f"({self.coefficient(u, n) or '0.0'}{known}) / {self._bell(u, 0, '+')}")


def series_kernels(system: System, order: int, first: int) -> tuple[Kernel, Kernel, list[Symbol]]:
    """(series, polynomial, constants) of one structure of system; nothing is compiled yet.

    series(y, given) -> coefficients 0 .. order of y, each of the size of y, then the sizes of the last two: the
        largest of velocities and of c0 theta/theta_0. The constants of the list stand in `given` from `first` on.
    polynomial(coefficients, (h,)) -> y after h
    """
    normal, variables, rate = rates(system)
    sym, n, size = system.symbolic, system.n_positions, system.size
    scale = [trace.reciprocal(m) for m in lifted(sym.inertia(), n)] + lifted(sym.entropy_scale(), system.n_elements)
    constants = {w.number: w for w in [*normal.weights(), *scale] if w.op != "const"}
    writer = Writer(dict(enumerate(rate)), {number: f"b[{first + i}]" for i, number in enumerate(constants)})
    outputs = [writer.coefficient(x, k) or "0.0" for k in range(order + 1) for x in variables]
    warm = [writer.name(f"1.0 / {outputs[i]}") for i in range(2 * n, size)]
    for k in (order - 1, order):
        largest = "0.0"
        for i in range(n, size):
            relative = f" * {warm[i - 2 * n]}" if i >= 2 * n else ""
            term = writer.name(f"abs({outputs[k * size + i]} * {writer.weight(scale[i - n])}{relative})")
            largest = writer.name(f"max({largest}, {term})")
        outputs.append(largest)
    horner = []
    for i in range(size):
        text = f"a[{order * size + i}]"
        for k in reversed(range(order)):
            text = f"({text} * h + a[{k * size + i}])"
        horner.append(text)
    return written(writer.lines, outputs), written(["h = b[0]"], horner), list(constants.values())


def lifted(value: Any, count: int) -> list[Symbol]:
    """A number, a symbol or an array of them, as so many symbols."""
    return [
        x if isinstance(x, Symbol) else trace.const(float(x)) for x in np.asarray(value, dtype=object) * np.ones(count)
    ]


def written(lines: list[str], outputs: list[str]) -> Kernel:
    stored = [f"out[{i}] = {name}" for i, name in enumerate(outputs)]
    return Kernel("def kernel(a, b, out):\n" + "".join(f"    {line}\n" for line in [*lines, *stored]), len(outputs))
