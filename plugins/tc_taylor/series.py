"""Rates in normal form, sums of monomials of Taylor series in time: a Cauchy product is spent only where two meet.

Constants are collected, factors cancelled, common denominators drawn together.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from tcbench import TcbenchError
from tcbench.compiler import derivatives as trace
from tcbench.compiler.arrays import LINEAR
from tcbench.compiler.derivatives import Symbol
from tcbench.compiler.ops import OPERATIONS, as_methods, evaluated

UNARY = ("log", "exp", "sqrt", "sin", "cos", "sinh", "cosh", "tanh", "atan")


@dataclass(eq=False)
class Series:
    """A series in time; equal ones are one object.

    kind  : var, sum, product, quotient, D (time derivative), sign or the name of a function.
    parts : series it is made of. weights : of a sum, (constant, ...) beside its parts, and last the constant term.
    of_size : of a logarithm: of the size of its part, which may be negative.
    index : of a variable; of an operation that leads from one space of arrays to another its value.
    constant : in time, as a sum that is an invariant, or a sign: its first coefficient is the only one.
    """

    kind: str
    parts: tuple[Series, ...] = ()
    weights: tuple[Symbol, ...] = ()
    index: Any = -1
    of_size: bool = False
    constant: bool = False


Monomial = tuple[tuple[Series, int], ...]  # factors and exponents, in the order of their first appearance
Linear = dict[Monomial, Symbol]  # a sum of constants times monomials; () is the constant term
ONE, ZERO = trace.const(1.0), trace.const(0.0)
STANDING = 1e-300  # beside a size: the sign of 0 is 0


class Normal:
    """Traced formulas in normal form. These symbols vary in time, as `variables`; everything else is constant."""

    def __init__(self, varying: Sequence[Symbol]) -> None:
        self.interned: dict[Any, Series] = {}
        self.form_of: dict[int, Linear] = {}  # exponent of each exponential, terms of each sum
        self.keys: dict[frozenset[tuple[int, int]], Monomial] = {}
        self.variables = [self.series("var", index=i) for i in range(len(varying))]
        self.known: dict[int, Linear] = {
            symbol.number: {((x, 1),): ONE} for symbol, x in zip(varying, self.variables, strict=True)
        }

    def series(
        self, kind: str, parts: tuple[Series, ...] = (), weights: tuple[Symbol, ...] = (), index: Any = -1
    ) -> Series:
        """One object for equal series."""
        return self.interned.setdefault(self.key(kind, parts, weights, index), Series(kind, parts, weights, index))

    @staticmethod
    def key(kind: str, parts: tuple[Series, ...] = (), weights: tuple[Symbol, ...] = (), index: Any = -1) -> Any:
        """What is equal of equal series."""
        return kind, tuple(map(id, parts)), tuple(w.number for w in weights), index

    def of(self, outputs: list[Symbol]) -> list[Linear]:
        """Each output as a sum of monomials."""
        for node in trace.topological(outputs):
            if node.number not in self.known:
                self.known[node.number] = self._form(node)
        return [self.known[x.number] for x in outputs]

    def _form(self, node: Symbol) -> Linear:
        args = [self.known[a.number] for a in node.args]
        if not any(any(key for key in form) for form in args):  # what does not move, also where terms cancelled
            values = [form.get((), ZERO) for form in args]
            (still,) = trace.substitute([node], dict(zip(node.args, values, strict=True)))
            return {} if trace.is_const(still, 0.0) else {(): still}
        match node.op:
            case "add" if (root := beside_nothing(node)) is not None:
                return self.known[root.number]
            case "add" if trace.is_const(node.args[0], trace.TINY) and () in args[1]:
                return args[1]  # whose constant swallows it
            case "add" if trace.is_const(node.args[1], trace.TINY) and () in args[0]:
                return args[0]
            case "add":
                return combined(args[0], args[1], ONE)
            case "sub":
                return combined(args[0], args[1], trace.const(-1.0))
            case "neg":
                return scaled(args[0], trace.const(-1.0))
            case "mul":
                return self.times(*args)
            case "abs":
                return self.times(args[0], self.sign(args[0]))
            case "recip":
                return self.inverse(args[0])
            case "mark":
                return {((self.single(args[0]), 1),): ONE}
            case "pow":
                base, power = self.gathered(args[0]), args[1]
                if len(base) > 1 and not (power.keys() == {()} and power[()].op == "const"):  # 1/2 it may be, or 3/2
                    base, power = self.function("sqrt", base), scaled(power, trace.const(2.0))
                return self.function("exp", self.times(power, self.function("log", base)))
            case "atan2":
                y, x = args
                spins = combined(
                    self.times(x, self.derivative(y)), self.times(y, self.derivative(x)), trace.const(-1.0)
                )
                sizes = combined(self.times(x, x), self.times(y, y), ONE)
                turn = self.single(self.times(spins, self.inverse(sizes)))
                return {((self.series("atan2", (turn, self.single(y), self.single(x))), 1),): ONE}
        if node.op in UNARY:
            return self.function(node.op, args[0])
        if node.op in LINEAR and not (node.op == "total" and node.value[0] != "add"):
            return {((self.series(node.op, tuple(map(self.single, args)), index=node.value), 1),): ONE}
        if node.op in OPERATIONS and (same := OPERATIONS[node.op].same):
            return self.of([trace.lifted(evaluated(same, as_methods(), *node.args))])[0]
        name = node.value[0] if node.op == "total" else node.op
        raise TcbenchError(f"tc_taylor knows no series of the operation {name!r} in this system's formulas.")

    def function(self, name: str, form: Linear) -> Linear:
        """A function of a sum; logarithms of products and exponentials of logarithms are taken apart."""
        if name == "log" and len(form) == 1:
            return self._logarithm(*next(iter(form.items())))
        if name == "exp":
            return self._exponential(form)
        if name == "sqrt":
            form = self.gathered(form)
            if found := self._root_of_square(form):
                return found
        return {((self.series(name, (self.single(form),)), 1),): ONE}

    def _logarithm(self, key: Monomial, weight: Symbol) -> Linear:
        """log(weight x^a y^b ...) as log weight + a log|x| + ..., but for what has to be positive together."""
        powers = dict(key)
        odd = [x for x, power in key if power % 2 and x.kind != "exp"]
        negative = weight.op == "neg" or (weight.op == "const" and weight.value < 0.0)
        if odd and (negative or len(odd) > 1):
            together = self.single({tuple((x, 1) for x in odd): trace.const(-1.0 if negative else 1.0)})
            weight = trace.neg(weight) if negative else weight
            powers = {x: power - (x in odd) for x, power in powers.items() if power != 1 or x not in odd}
            powers[together] = 1
        result: Linear = {} if trace.is_const(weight, 1.0) else {(): weight.log()}
        for x, power in powers.items():
            part = self.form_of[id(x)] if x.kind == "exp" else {((self._log(x, power % 2 == 0), 1),): ONE}
            result = combined(result, part, trace.const(float(power)))
        return result

    def gathered(self, form: Linear) -> Linear:
        """max(u, 0), written as (|u| + u)/2, in the form u (1 + sign u)/2 and a tiny constant; any other sum as it is.

        On the flat side exactly the constant is left, and every power of it has a series.
        """
        for key, weight in form.items():
            u = next((x for x, k in key if x.kind != "sign" and k == 1), None)
            sign = next((x for x, _ in key if x.kind == "sign"), None)
            for one in (1.0, -1.0) if u and sign and len(key) == 2 else ():
                each, terms = trace.mul(trace.const(one), weight), self.form_of.get(id(u), {((u, 1),): ONE})
                whole = scaled(terms, each) | {key: weight}
                if whole.keys() == form.keys() and all(same(form[term], whole[term]) for term in form):
                    side = self.single({(): trace.const(0.5), ((sign, 1),): trace.const(0.5 * one)})
                    side.constant = True
                    return {
                        self.one_key([(u, 1), (side, 1)]): trace.mul(trace.const(2.0), each),
                        (): trace.const(trace.TINY),
                    }
        return form

    def sign(self, form: Linear) -> Linear:
        """Of a sum: constant in a step."""
        found = self.series("sign", (self.single(form),))
        found.constant = True
        return {((found, 1),): ONE}

    def _root_of_square(self, form: Linear) -> Linear:
        """sqrt(w x^2) as sqrt(w)|x|, whose sign changes with that of x: the series of the root goes on below 0."""
        terms = [(key, w) for key, w in form.items() if key or not (w.op == "const" and abs(w.value) <= trace.TINY)]
        if len(terms) != 1 or any(power % 2 for _, power in terms[0][0]):
            return {}
        ((key, weight),) = terms
        found: Linear = {self.one_key((x, power // 2) for x, power in key): weight.sqrt()}
        for x, power in key:
            found = self.times(found, self.sign({((x, 1),): ONE})) if power % 4 and x.kind != "exp" else found
        return found

    def _log(self, x: Series, of_size: bool) -> Series:
        """The series of log x, or of log|x|."""
        found = self.series("log", (x,))
        found.of_size = found.of_size or of_size
        return found

    def _exponential(self, form: Linear) -> Linear:
        outside: Linear = {(): ONE}
        inside: Linear = {}
        for key, weight in form.items():
            twice = round(2.0 * weight.value) if weight.op == "const" else 0
            whole = twice and abs(2.0 * weight.value - twice) < 2e-14
            if not key:
                outside = scaled(outside, weight.exp())
            elif len(key) == 1 and key[0][0].kind == "log" and key[0][1] == 1 and whole:
                (base,), of_size, power = key[0][0].parts, key[0][0].of_size, int(twice / 2)
                size: Linear = {((base, 1),): ONE}
                size = self.times(size, self.sign(size)) if of_size else size
                outside = self.times(outside, {((base, power),): ONE}) if power else outside
                outside = self.times(outside, self.sign({((base, 1),): ONE})) if power % 2 and of_size else outside
                if twice % 2:  # a root, whose sign is looked at: see `kinks`
                    root = self.function("sqrt", size)
                    outside = self.times(outside, root if twice > 0 else self.inverse(root))
            else:
                inside[key] = weight
        if not inside:
            return outside
        x = self.series("exp", (self.single(inside),))
        self.form_of[id(x)] = inside
        return self.times(outside, {((x, 1),): ONE})

    def hold(self, forms: list[Linear]) -> None:
        """These are constant in time."""
        for form in forms:
            if any(form):
                for x, _ in next(iter(self.as_factor(form))):
                    x.constant = True

    def derivative(self, form: Linear) -> Linear:
        """The series' derivative in time."""
        return {((self.series("D", (self.single(form),)), 1),): ONE}

    def inverse(self, form: Linear) -> Linear:
        if len(form) == 1:
            ((key, weight),) = form.items()
            return {self.one_key((x, -k) for x, k in key): trace.reciprocal(weight)}
        return self.inverse(self.as_factor(form))

    def times(self, a: Linear, b: Linear) -> Linear:
        """The product. A sum is multiplied out by a constant and where that cancels a factor; else it is one factor."""
        if not a or not b:
            return {}
        if len(a) > 1 and len(b) > 1:
            return self.times(self.as_factor(a), self.as_factor(b))
        if len(a) > 1:
            a, b = b, a
        ((left, weight),) = a.items()
        if len(b) > 1 and left and not any(self._cancels(left, key) for key in b):
            b = self.as_factor(b)
        result: Linear = {}
        for right, other in b.items():
            result = combined(result, {self.merged(left, right): trace.mul(weight, other)}, ONE)
        return result

    def as_factor(self, form: Linear) -> Linear:
        """The sum as one factor, its leading constant outside: multiples of a sum are one series.

        The sign is that of the constant term, where there is one: what is positive, such as 2 - x, stays so.
        """
        first = next(iter(form.values()))
        if first.op != "const" and all(w is first for w in form.values()):
            return {((self.single(dict.fromkeys(form, ONE)), 1),): first}
        leading = next((w.value for key, w in form.items() if key and w.op == "const"), 1.0)
        if () in form and form[()].op == "const":
            leading = math.copysign(leading, form[()].value)
        return {((self.single(scaled(form, trace.const(1.0 / leading))), 1),): trace.const(leading)}

    @staticmethod
    def _cancels(left: Monomial, right: Monomial) -> bool:
        powers = {id(x): k for x, k in left}
        return any(powers.get(id(x), 0) * k < 0 for x, k in right)

    def merged(self, left: Monomial, right: Monomial) -> Monomial:
        powers: dict[int, tuple[Series, int]] = {}
        for x, k in (*left, *right):
            powers[id(x)] = (x, powers.get(id(x), (x, 0))[1] + k)
        for x, k in list(powers.values()):  # x'/x is the derivative of log x
            if x.kind == "D" and k == 1 and powers.get(id(x.parts[0]), (x, 0))[1] < 0:
                base = x.parts[0]
                del powers[id(x)]
                powers[id(base)] = (base, powers[id(base)][1] + 1)
                rate = self.series("D", (self.series("log", (base,)),))
                powers[id(rate)] = (rate, 1)
        return self.one_key((x, k) for x, k in powers.values() if k)

    def one_key(self, factors: Iterable[tuple[Series, int]]) -> Monomial:
        """One key for one product, whatever the order of its factors: that in which they came first; signs once."""
        found = tuple((x, k % 2 if x.kind == "sign" else k) for x, k in factors if x.kind != "sign" or k % 2)
        return self.keys.setdefault(frozenset((id(x), k) for x, k in found), found)

    def single(self, form: Linear) -> Series:
        """The sum as one series: terms of a common denominator are one quotient."""
        groups: dict[Monomial, Linear] = {}
        for key, weight in form.items():
            below = self.one_key((x, -k) for x, k in key if k < 0)
            groups.setdefault(below, {})[self.one_key((x, k) for x, k in key if k > 0)] = weight
        parts: Linear = groups.pop((), {})
        for below, above in groups.items():
            leading = next(iter(above.values()))  # multiples of a quotient are one series
            leading = leading if leading.op == "const" else ONE
            top = self._sum(scaled(above, trace.reciprocal(leading)))
            key = ((self.series("quotient", (top, self._product(below))), 1),)
            parts = combined(parts, {key: leading}, ONE)
        return self._sum(parts)

    def _sum(self, form: Linear) -> Series:
        if len(form) == 1:
            ((key, weight),) = form.items()
            if key and trace.is_const(weight, 1.0):
                return self._product(key)
        constant = form.get((), ZERO)
        terms = [(self._product(key), weight) for key, weight in form.items() if key]
        found = self.series("sum", tuple(x for x, _ in terms), (*(w for _, w in terms), constant))
        self.form_of[id(found)] = form
        return found

    def _product(self, key: Monomial) -> Series:
        factors = [x for x, k in key for _ in range(k)]
        result = factors[0]
        for x in factors[1:]:
            result = self.series("product", (result, x))
        return result


def beside_nothing(node: Symbol) -> Symbol | None:
    """The size or root that a tiny number is added to, so that what is divided by it at 0 is finite."""
    for x, other in (node.args, node.args[::-1]):
        if trace.is_const(other) and abs(other.value) <= trace.TINY and x.op in ("abs", "sqrt", "hypot"):
            return x
    return None


def same(a: Symbol, b: Symbol) -> bool:
    """Are two weights one, however their signs and numbers are written: -(a/2) and a (-1/2)?"""

    def taken_apart(x: Symbol) -> tuple[float, int]:
        number = 1.0
        while x.op in ("neg", "mul"):
            known = next((y for y in x.args if y.op == "const"), None)
            if x.op == "mul" and known is None:
                break
            number *= -1.0 if known is None else known.value
            x = x.args[0] if known is not x.args[0] else x.args[1]
        return (number * x.value, 0) if x.op == "const" else (number, x.number)

    return taken_apart(a) == taken_apart(b)


def combined(a: Linear, b: Linear, weight: Symbol) -> Linear:
    """a + weight b."""
    result = dict(a)
    for key, value in b.items():
        term = trace.mul(weight, value)
        total = trace.add(result[key], term) if key in result else term
        result[key] = total
        if trace.is_const(total, 0.0):
            del result[key]
    return result


def scaled(form: Linear, weight: Symbol) -> Linear:
    return combined({}, form, weight)
