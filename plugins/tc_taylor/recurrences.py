"""Taylor coefficients of a system's solution, of all orders, by recurrences for the operations of the traced formulas.

The coefficient n of y needs the coefficients below n of its rate; each is made when it is first asked for.
Source: Jorba and Zou (2005), section 3; docs/methods-explained.md.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Any, Generic, TypeVar

from .series import STANDING

PARTNERS = {"sin": ("cos", 1.0), "cos": ("sin", -1.0), "sinh": ("cosh", 1.0), "cosh": ("sinh", 1.0)}
Of = Callable[[int], Any]  # a value by its order
Products = Sequence[tuple[Any, ...]]
X = TypeVar("X")  # what has coefficients: a series, or several side by side


class Recurrences(Generic[X]):
    """One recurrence a kind of series; a coefficient is a value of whatever a subclass computes with, and 0 is None."""

    value: Callable[[X, int], Any]  # coefficient n
    parts: Callable[[X], list[X]]
    sum_of: Callable[[list[tuple[Any, ...]]], Any]  # of products of values
    scaled: Callable[[float, Any], Any]
    plus: Callable[[float, Any], Any]
    over: Callable[[Any, Any], Any]
    function: Callable[..., Any]  # of a value; of its size where the series given say so
    angle: Callable[[Any, Any, X], Any]

    def __init__(self) -> None:
        self.made: dict[Hashable, Any] = {}
        self.begun: set[Hashable] = set()  # those of them that are there or are being made

    def key(self, x: X, n: int, what: str) -> Hashable:
        return id(x), n, what

    def once(self, x: X, n: Any, what: str, make: Callable[[Any], Any]) -> Any:
        key = self.key(x, n, what)
        if key not in self.made:
            self.begun.add(key)
            self.made[key] = make(n)
        return self.made[key]

    def of_kind(self, x: X, kind: str, n: int) -> Any:
        if kind in PARTNERS:
            return self._turned(*self.parts(x), n, kind)
        return getattr(self, f"_{kind}")(x, n)

    def summed(self, older: Products, newest: Products, weight: float = 1.0) -> Any:
        """weight times the sum of older products, and the newest ones."""
        older, newest = ([x for x in rows if not any(y is None for y in x)] for rows in (older, newest))
        if weight != 1.0:
            known = self.sum_of(list(older))
            older = [] if known is None else [(self.scaled(weight, known),)]
        return self.sum_of([*older, *newest])

    def convolution(self, n: int, a: Of, b: Of, newest: Products, weight: float = 1.0) -> Any:
        """weight times the sum of a(j) b(n - j) for j = 1 .. n - 1, and the newest products."""
        return self.summed([(a(j), b(n - j)) for j in range(1, n)], newest, weight)

    def _of(self, x: X) -> Of:
        return lambda n: self.value(x, n)

    def _slope(self, x: X) -> Of:
        """n times coefficient n."""
        return lambda n: self.once(x, n, "slope", lambda n: self.times(n, self.value(x, n)))

    def times(self, weight: float, value: Any) -> Any:
        return value if value is None or weight == 1.0 else self.scaled(weight, value)

    def _divided(self, newest: Any, known: Any, inverse: Any, n: int = 1) -> Any:
        """(n newest - known) times the inverse; from `newest` on, one operation."""
        return self.summed([], [(newest, self.times(n, inverse)), (known, self.scaled(-1.0, inverse))])

    def _product(self, x: X, n: int) -> Any:
        a, b = self.parts(x)
        if a == b:
            return self._square(a, n)
        newest = [(self.value(a, 0), self.value(b, n))]
        if n:
            newest.append((self.value(a, n), self.value(b, 0)))
        return self.convolution(n, self._of(a), self._of(b), newest)

    def _square(self, a: X, n: int) -> Any:
        if n == 0:
            return self.sum_of([(self.value(a, 0),) * 2])
        return self.summed(self.squared(n, self._of(a)), [(self.times(2.0, self.value(a, 0)), self.value(a, n))])

    def squared(self, n: Any, a: Of) -> list[tuple[Any, ...]]:
        """Products that add up to the sum of a(j) a(n - j), j = 1 .. n - 1: each of two different coefficients is there
        twice, and it is the one known longer that is doubled."""
        older = [(self.times(2.0, a(j)), a(n - j)) for j in range(1, (n + 1) // 2)]
        return [*older, (a(n // 2),) * 2] if n % 2 == 0 else older

    def _quotient(self, x: X, n: int) -> Any:
        """(u_n - sum_(0<j<=n) v_j q_(n-j)) / v_0: one operation from the newest of u on. v_n q_0 stays as large as u_n,
        where q_0 / v_0 may be below the smallest number."""
        above, below = self.parts(x)
        inverse, newest = self.over(1.0, self.value(below, 0)), self.value(above, n)
        if n == 0:
            return self.summed([], [(newest, inverse)])
        known = self.convolution(n, self._of(below), self._of(x), [(self.value(below, n), self.value(x, 0))])
        return self.summed([], [(newest, inverse), (known, self.scaled(-1.0, inverse))])

    def log_rate(self, x: X, n: int) -> Any:
        """n times coefficient n of log u: (n u_n - sum_(0<j<n) (j l_j) u_(n-j)) / u_0."""

        def make(n: Any) -> Any:
            (u,) = self.parts(x)
            known = self.convolution(n, lambda j: self.log_rate(x, j), self._of(u), [])
            return self._divided(self.value(u, n), known, self.over(1.0, self.value(u, 0)), n)

        return self.once(x, n, "rate", make)

    def _log(self, x: X, n: int) -> Any:
        if n == 0:
            return self.function("log", self.value(self.parts(x)[0], 0), of_size=x)
        return self.times(1.0 / n, self.log_rate(x, n))

    def _risen(self, u: X, n: int, by: Of) -> Any:
        """Coefficient n of f(u), where `by` has those of df/du: the sum of (j u_j) by(n - j), over n."""
        return self.convolution(n, self._slope(u), by, [(self.value(u, n), by(0))], 1.0 / n)

    def _exp(self, x: X, n: int) -> Any:
        (u,) = self.parts(x)
        return self._risen(u, n, self._of(x)) if n else self.function("exp", self.value(u, 0))

    def _sqrt(self, x: X, n: int) -> Any:
        (u,) = self.parts(x)
        if n == 0:
            return self.function("sqrt", self.value(u, 0))
        known = self.convolution(n, self._of(x), self._of(x), [])
        return self._divided(self.value(u, n), known, self.over(0.5, self.value(x, 0)))

    def _turned(self, u: X, n: int, what: str) -> Any:
        """Coefficient n of sin u, cos u, sinh u or cosh u: each is its partner's rate."""

        def make(n: Any) -> Any:
            if n == 0:
                return self.function(what, self.value(u, 0))
            other, sign = PARTNERS[what]
            newest = [(self.times(sign, self.value(u, n)), self._turned(u, 0, other))]
            return self.convolution(n, self._slope(u), lambda n: self._turned(u, n, other), newest, sign / n)

        return self.once(u, n, what, make)

    def _bell(self, u: X, sign: float) -> Of:
        """Coefficients of 1 - u^2 or 1 + u^2."""

        def make(n: Any) -> Any:
            square = self.times(sign, self._square(u, n))
            return square if n else self.plus(1.0, square)

        return lambda n: self.once(u, n, f"bell{sign}", make)

    def _tanh(self, x: X, n: int) -> Any:
        (u,) = self.parts(x)
        return self._risen(u, n, self._bell(x, -1.0)) if n else self.function("tanh", self.value(u, 0))

    def _atan(self, x: X, n: int) -> Any:
        (u,) = self.parts(x)
        if n == 0:
            return self.function("atan", self.value(u, 0))
        bell = self._bell(u, 1.0)
        known = self.convolution(n, self._slope(x), bell, [], 1.0 / n)
        return self._divided(self.value(u, n), known, self.over(1.0, bell(0)))

    def _sign(self, x: X, n: int) -> Any:
        """Of u, at the start: steps end where it changes (`kinks`)."""
        (u,) = self.parts(x)
        return None if n else self.over(self.value(u, 0), self.plus(STANDING, self.function("abs", self.value(u, 0))))

    def _atan2(self, x: X, n: int) -> Any:
        """From how fast the angle turns."""
        turn, above, below = self.parts(x)
        if n:
            return self.times(1.0 / n, self.value(turn, n - 1))
        return self.angle(self.value(above, 0), self.value(below, 0), x)
