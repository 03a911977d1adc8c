"""Checks of what authors write in the class of a system; each TcbenchError says what to write instead."""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any
from weakref import WeakSet

import numpy as np

from ..compiler import derivatives as trace
from ..compiler.arrays import LINEAR
from ..compiler.cut import degrees
from ..compiler.symbols import Symbol
from ..compiler.trace_errors import refused, where_in_user_code
from ..errors import TcbenchError, expect_words, unknown_name
from .declaration import is_column, taken

if TYPE_CHECKING:
    from .element_system import ElementSystem
    from .system import System

COVECTORS = ("reversible", "irreversible", "temperature")  # formulas of (z, dE, dS)
ALIKE = 0.85  # of two names, as difflib has it: reversable and reversible are 0.9
MOST_DEGREE = 2  # of a strain measure in the positions
POINTS = 5  # random points at which a derivative has to vanish
NIL = 1e-9  # round-off of a derivative that is 0, over its terms
CONSERVED_RATE = 1e-7  # rate of an invariant, over its terms, that is round-off
RESTING_TERMS = 1e-6  # floor of these terms, over those at other states: at rest they are round-off themselves
_CHECKED: WeakSet[Any] = WeakSet()  # systems whose invariants have been checked


def check_class(cls: type[System]) -> None:
    """TcbenchError where a class overrides what is derived, or names a constant as something else is."""
    base = _base(cls)
    unwritten = tuple(n for n in base.written if not cls.defines(n))
    for name in dict.fromkeys(n for c in cls.__mro__[: cls.__mro__.index(base)] for n in c.__dict__):
        if not name.startswith("__") and name not in base.written and hasattr(base, name):
            raise _overridden(cls.__name__, name, base.written)
        _check_spelling(cls, base, name, unwritten)
    if cls.__getattribute__ is not object.__getattribute__:
        raise TcbenchError(
            f"{cls.__name__} writes __getattribute__: what a formula reads of self would not be what it names. Call a "
            "function of your own in the formulas."
        )
    expect_words(cls.__name__, {"positive": cls.positive, "non_negative": cls.non_negative}, "positive", "non_negative")
    for name in (*cls.__dict__.get("positive", ()), *cls.__dict__.get("non_negative", ())):
        if cls.constants and name not in cls.constants:
            raise unknown_name(f"constant of {cls.__name__}", name, cls.constants)
    constants: Mapping[Any, Any] = {**cls.constants, **cls.tables}  # whatever an author wrote
    for name in constants:
        if not isinstance(name, str) or not name.isidentifier():
            raise TcbenchError(f"{cls.__name__}: a constant is named by a word, self.word in formulas, not {name!r}.")
        if name == "self" or ((hasattr(base, name) or _is_computed(cls, name)) and name not in _free(cls, base)):
            raise taken(cls, "constant", name)


@cache  # of words alone; a system is made for every scenario
def _meant(name: str, unwritten: tuple[str, ...]) -> list[str]:
    return difflib.get_close_matches(name, unwritten, n=1, cutoff=ALIKE)


def _check_spelling(cls: type[System], base: type[System], name: str, unwritten: tuple[str, ...]) -> None:
    """A formula that is all but called as one that the class does not have, and takes as many arguments: without it the
    system would be another one."""
    for meant in () if name in base.written else _meant(name, unwritten):
        taken_by = [getattr(inspect.unwrap(getattr(c, n)), "__code__", None) for c, n in ((cls, name), (base, meant))]
        if taken_by[0] and taken_by[1] and taken_by[0].co_argcount == taken_by[1].co_argcount:
            raise TcbenchError(
                f"{cls.__name__} writes {name}(), which nothing calls, and no {meant}(). Did you mean that? A function "
                "of your own is called otherwise."
            )
    if name in COVECTORS and name in base.written and "energy" in base.written:
        words = [word.lower() for word in inspect.unwrap(getattr(cls, name)).__code__.co_varnames[1:4]]
        if words[1:] == ["ds", "de"]:
            raise TcbenchError(f"{cls.__name__} writes {name}(z, dS, dE); it is given (z, dE, dS), in that order.")


def _base(cls: type[System]) -> type[System]:
    """The class of tcbench's own that says what its subclasses may write."""
    return next(c for c in cls.__mro__ if "written" in c.__dict__ and c.__module__.startswith("tcbench."))


def _free(cls: type[System], base: type[System]) -> tuple[str, ...]:
    """Names of the base class that constants may have: what they replace, and matrices that a class does not write."""
    unwritten = (n for n in ("poisson", "friction") if n in base.written and getattr(cls, n) is getattr(base, n))
    return ("reference_temperature", *unwritten)


def _is_computed(cls: type, name: str) -> bool:
    """Is the attribute a method, a property or the like?"""
    return hasattr(inspect.getattr_static(cls, name, None), "__get__")


def check_attribute(system: System, name: str, value: Any) -> None:
    """TcbenchError where an attribute of an instance would hide what its class computes, be another constant, or hand a
    value from one formula to another, which may be called with other states in between."""
    kind, written = type(system), _base(type(system)).written
    if name in system.constants:
        if name in system.__dict__:
            raise TcbenchError(
                f"The constant {name!r} of a system does not change: take another one, such as "
                f"scenario.replace({name}=...).model."
            )
        return
    symbolic = any(isinstance(x, Symbol) for x in np.ravel(np.asarray(value, dtype=object)))
    if "energy" in written and symbolic:
        raise TcbenchError(
            f"{where_in_user_code()}: a formula of {kind.__name__} sets self.{name}. Formulas only read self: "
            "another one may be called with other states. Use a local name, or call a function of your own in each."
        )
    if _is_computed(kind, name):
        raise _overridden(kind.__name__, name, written)
    if name in written or any(name in c.__dict__ for c in kind.__mro__ if not c.__module__.startswith("tcbench.")):
        raise TcbenchError(
            f"{kind.__name__} sets {name!r} on an instance: it belongs to the class, whose formulas all of its "
            "scenarios share. Write it in the body of the class."
        )


class Fixed(dict[str, Any]):
    """The constants of a scenario, for reading."""

    def _refuse(self, *_: Any, **__: Any) -> Any:
        raise TcbenchError("The constants of a scenario do not change: take another one, scenario.replace(name=value).")

    __setitem__ = __delitem__ = __ior__ = update = setdefault = pop = popitem = clear = _refuse

    def __reduce__(self) -> Any:
        return Fixed, (dict(self),)


def _overridden(who: str, name: str, written: Sequence[str]) -> TcbenchError:
    return TcbenchError(
        f"{who} sets {name!r}, which is derived from the formulas of its class: some methods would use yours, others "
        f"would not. An author writes {', '.join(written)}; call a function of your own otherwise."
    )


def check_degree(system: ElementSystem, shapes: Sequence[Any], q: Sequence[Symbol]) -> None:
    """TraceError where a strain measure is of a higher degree than two in the positions: then its slope at the midpoint
    is no divided difference, and discrete gradients lose energy."""
    degree = degrees([x for x in shapes if isinstance(x, Symbol)], q)
    for i, x in enumerate(shapes):
        if isinstance(x, Symbol) and degree[x.number] > MOST_DEGREE and not _third_vanishes(x, q):
            raise refused(
                f"the strain measure of element {i} is not linear or quadratic in q, which discrete gradients need",
                "Let shape() return another measure of the strain, such as the squared length, and take the root, the "
                "logarithm or the power in element_energy(); methods without discrete gradients (tc_gauss, tc_taylor, "
                "midpoint_entropy) take any shape()",
                _line(system, "shape"),
            )


def _third_vanishes(x: Symbol, q: Sequence[Symbol]) -> bool:
    """Is the third derivative of x along random lines 0 at random points?"""
    from ..compiler.kernels import namespace, placed, straight_line

    if x.space:
        return False  # an array: not tested
    t, start, along = trace.variable("t"), trace.variables("q", len(q)), trace.variables("v", len(q))
    (line,) = trace.substitute([x], dict(zip(q, start + t * along, strict=True)))
    rates = [line]
    for _ in range(MOST_DEGREE + 1):
        rates.append(trace.jacobian([rates[-1]], [t])[0, 0])
    variables = [s for s in trace.topological(rates) if s.op == "var"]
    scope = namespace()
    exec(straight_line(placed("a", variables), rates), scope)
    rng, table = np.random.default_rng(0), np.empty((POINTS, len(rates)))
    with np.errstate(all="ignore"):
        for values in table:
            scope["kernel"](rng.uniform(0.5, 1.5, len(variables)), None, values)
    finite = np.isfinite(table).all(axis=1)
    return bool(finite.any() and np.all(np.abs(table[finite, -1]) <= NIL * np.abs(table[finite]).max(axis=1)))


def _line(system: System, *names: str) -> str:
    """Where the author wrote the first of these functions that there is."""
    function = inspect.unwrap(next(getattr(type(system), name) for name in names if hasattr(type(system), name)))
    return f"{function.__code__.co_filename}, line {function.__code__.co_firstlineno}"


def energy_slopes(system: ElementSystem, energies: Sequence[Symbol], own: Sequence[Symbol]) -> list[dict[int, Symbol]]:
    """Of each element's energy its derivatives by position in `own`, the strains and then the entropies of all elements
    (or of the array of them); TraceError where it depends on another element's."""
    count, where, moving = len(own) // 2, _line(system, "element_energy"), trace.depends_on(energies, own)
    if len(energies) != count:
        problem = f"element_energy() gives {len(energies)} numbers for {count} elements"
        raise refused(problem, "It gives one for each", where)
    between = any(x.op in LINEAR and x.number in moving for x in trace.topological(energies))
    rows = [] if between else trace.sparse_jacobian(energies, own)
    others = [(i, j % count) for i, row in enumerate(rows) for j in row if j % count != i]
    if between or others:
        one, other = (f"element {k}" for k in min(others)) if others else ("an element", "another one")
        raise refused(
            f"the energy of {one} depends on the strain or the entropy of {other}, and gradients are made of each "
            "element's own",
            "Let element_energy() act element by element; what couples two of them is an element of its own",
            where,
        )
    return rows


def check_invariants(system: System, z0: Any) -> None:
    """TcbenchError where what a system says is conserved changes as it moves: methods that hold its value would hold
    it all the same, and go elsewhere."""
    if system in _CHECKED:
        return
    own = system.defines("element_energy") and type(system).__module__.startswith(("tcbench.", "tcbench_plugins."))
    if own or not system.invariant_names:  # tests check these
        _CHECKED.add(system)
        return
    for name in system.invariant_names:
        if name in system.variables or is_column(name, system):
            raise taken(type(system), "invariant", name)
    rng = np.random.default_rng(0)
    states = np.array([z0, *(system.nearby(z0, rng) for _ in range(POINTS))], dtype=float)
    with np.errstate(all="ignore"):
        rates, terms = np.split(np.abs(system.invariant_rates(states)), 2, axis=1)
        shares = rates / np.fmax(terms, RESTING_TERMS * np.nanmedian(terms, axis=0))  # at rest all is round-off
    for k, i in np.argwhere(shares > CONSERVED_RATE)[:1]:  # not NaN
        raise TcbenchError(
            f"invariants() of {type(system).__name__} names {system.invariant_names[i]!r}, which is not conserved: "
            f"its rate at {np.array2string(states[k], precision=3)} is {shares[k, i]:.1g} of the terms that it is the "
            "sum of. Fix reversible(), irreversible() or the formula, or leave it out (tcbench check says more)."
        )
    _CHECKED.add(system)
