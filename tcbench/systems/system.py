"""`System`: one GENERIC system, dz/dt = L grad E + M grad S, and everything an integrator may ask of it.

State z = (q, p, s): positions, momenta, entropies of the elements. The author of a system writes `inertia`, `shape`,
`element_energy`, `conduction` and `entropies` in plain numpy and names the constants; all the rest is derived:
on symbols (while a formula is traced) as an expression, on floats through a compiled kernel.
"""

from __future__ import annotations

from functools import wraps
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..compiler import derivatives as trace
from ..compiler.divided_differences import rectangle, symmetrised_slopes
from ..compiler.once import cached_property
from ..errors import TcbenchError, unknown_name
from .operators import Poisson, SparseRows
from .refusals import check_attribute, check_class, check_degree, check_own
from .state import State, fixed, formulas_hash
from .traced import Traced, derived

Array = NDArray[Any]


class System(Traced):
    """Base class; an instance holds values of the constants and is immutable."""

    positive: ClassVar[tuple[str, ...]] = ()  # constants that must be > 0
    non_negative: ClassVar[tuple[str, ...]] = ()
    source: ClassVar[str] = ""
    written: ClassVar[tuple[str, ...]] = (  # what an author's class may say; everything else is derived
        "name", "constants", "positive", "non_negative", "source", "n_positions", "n_elements", "inertia", "shape",
        "element_energy", "conduction", "entropies", "invariants", "conduction_flow", "points", "entropy_scale",
        "exergy_offset",
    )  # fmt: skip

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        check_class(cls)
        if "shape" in cls.__dict__:  # everything in an element sees the positions through its strain measure only
            shape = cls.__dict__["shape"]
            cls.shape = wraps(shape)(lambda self, q: _mark_like(shape(self, q), q))  # type: ignore[method-assign]
        if "entropies" in cls.__dict__:
            entropies = cls.__dict__["entropies"]
            cls.entropies = wraps(entropies)(lambda self, q, theta: entropies(self, q, _positive(theta)))  # type: ignore[method-assign]

    def __setattr__(self, name: str, value: Any) -> None:
        check_attribute(self, name)
        object.__setattr__(self, name, value)

    def __init__(self, **values: Any) -> None:
        check_class(type(self))  # which may have been changed since
        for name in values:
            if name not in self.constants:
                raise unknown_name(f"constant of {self.name!r}", name, self.constants)
        for name, shape in self.constants.items():
            if name not in values:
                raise TcbenchError(f"System {self.name!r} needs a value for the constant {name!r}.")
            setattr(self, name, self._checked(name, shape, values[name]))
        self.formulas = formulas_hash(type(self))
        self.zeros = tuple(
            (n, int(i)) for n in self.constants for i in np.flatnonzero(np.ravel(getattr(self, n)) == 0.0)
        )

    def _checked(self, name: str, shape: tuple[int, ...], value: Any) -> Any:
        try:
            array = np.array(value, dtype=float)  # not the caller's own, which may change
        except (TypeError, ValueError, OverflowError):
            raise TcbenchError(f"Constant {name!r} must be a number or {shape} numbers, not {value!r}.") from None
        if array.shape != shape:
            raise TcbenchError(f"Constant {name!r} must have shape {shape}, not {array.shape}.")
        if not np.all(np.isfinite(array)):
            raise TcbenchError(f"Constant {name!r} must be finite, not {value!r}.")
        if name in self.positive and not np.all(array > 0):
            raise TcbenchError(f"Constant {name!r} must be positive, not {value!r}.")
        if name in self.non_negative and not np.all(array >= 0):
            raise TcbenchError(f"Constant {name!r} must not be negative, not {value!r}.")
        return float(array) if shape == () else fixed(array)

    # ---- written by the author of a system -------------------------------------------------------------

    def inertia(self) -> Any:
        """Mass that belongs to each position coordinate, shape (n_positions,)."""
        raise TypeError(f"{type(self).__name__} must define inertia()")

    def shape(self, q: Any) -> Any:
        """Strain measure of each element, shape (n_elements,); linear or quadratic in q, positive."""
        raise TypeError(f"{type(self).__name__} must define shape()")

    def element_energy(self, pi: Any, s: Any) -> Any:
        """Internal energy of each element, a function of its own strain measure and entropy."""
        raise TypeError(f"{type(self).__name__} must define element_energy()")

    def conduction(self, theta: Any) -> Any:
        """M DS, the entropy rates by heat conduction, shape (n_elements,); theta @ conduction(theta) = 0."""
        raise TypeError(f"{type(self).__name__} must define conduction()")

    def entropies(self, q: Any, theta: Any) -> Any:
        """Entropies at given temperatures: the inverse of theta = de/ds."""
        raise TypeError(f"{type(self).__name__} must define entropies()")

    def invariants(self, q: Any, p: Any) -> dict[str, Any]:
        """Conserved momenta by name; none by default."""
        return {}

    @classmethod
    def defines(cls, name: str) -> bool:
        """Does the system define an optional function, such as "conduction_flow"?"""
        return getattr(cls, name, None) not in (None, getattr(System, name, None))

    def conduction_flow(self, theta: Any, t: Any) -> tuple[Any, Any]:
        """Pure conduction for a time t at fixed positions, in closed form: (entropy increments, mean temperatures).

        Optional: few systems have one. Splittings with an exact irreversible part ask for it; forces must be linear in
        the temperatures, so that the impulse over t is the force at the mean temperatures times t.
        """
        raise TcbenchError(
            f"System {self.name!r} has no closed form of its conduction (conduction_flow), which this method needs. "
            "Take a method without an exact irreversible part: tc_strang, tc_monolithic, tc_gauss. The method's author "
            "says so with Integrator(needs=('conduction_flow',)): it is then left out here."
        )

    def points(self, q: Any) -> Any:
        """The two ends of each element in the plane, shape (n_elements, 2, 2), for pictures; dimensionless.

        Optional: springs between points of the plane are found without it.
        """
        raise TcbenchError(f"System {self.name!r} does not say where its elements are: it has no points(q).")

    def entropy_scale(self) -> Any:
        """Size of a typical entropy increment, for Newton's stopping test."""
        return 1.0

    def exergy_offset(self) -> Any:
        """Constant that makes V = E - theta_ref S + offset >= 0."""
        return 0.0

    # ---- derived ---------------------------------------------------------------------------------------

    @property
    def size(self) -> int:
        """Length of z."""
        return 2 * self.n_positions + self.n_elements

    def state(self, values: Any) -> State:
        return State(values, self.n_positions)

    @cached_property
    def constant_values(self) -> NDArray[np.float64]:
        """(time step, then the constants in declared order): the second argument of every kernel."""
        parts = [np.ravel(getattr(self, name)) for name in self.constants]
        return fixed(np.concatenate([[0.0], *parts]).astype(np.float64))

    @property
    def n_constant_values(self) -> int:
        """Length of `constant_values`."""
        return 1 + sum(int(np.prod(shape)) for shape in self.constants.values())

    @property
    def L(self) -> Poisson:
        """The Poisson matrix: canonical on (q, p), zero on s; an operator, np.asarray(L) makes it dense."""
        return Poisson(self.n_positions, self.n_elements)

    @property
    def DS(self) -> NDArray[np.float64]:
        """Gradient of the entropy S = sum of s."""
        return np.concatenate([np.zeros(2 * self.n_positions), np.ones(self.n_elements)])

    def dissipation(self, theta: Any) -> State:
        """M(theta) DS as a vector of the size of z; never M times DS, which cancels (PHYSICS 4)."""
        return self.state(np.concatenate([np.zeros(2 * self.n_positions), self.conduction(theta)]))

    @derived
    def friction(self, theta: Any) -> Any:
        """M(theta), eq. (34), shape (2, 2): the one symmetric matrix with M theta = 0 and M DS = conduction."""
        if self.n_elements != 2:
            raise TcbenchError("friction() is written for two elements; use dissipation().")
        a, b = theta
        # M = mu (b, -a)(b, -a)^T acts on DS as mu (b - a)(b, -a), which is 0 at b = a: the first component divided
        # by b - a (exactly, as a divided difference from a to b) is mu b
        other, _ = rectangle(a, b - a, trace.const(0.0), trace.const(0.0))
        gained = self.conduction(np.array([a, other], dtype=object))[0]
        mu = other.lifted(gained).pi_at_s0 / b  # a number where nothing is conducted
        return np.array([[mu * b * b, -mu * a * b], [-mu * a * b, mu * a * a]])

    @derived
    def energy(self, z: Any) -> Any:
        """Total energy E(z)."""
        z = self.state(z)
        kinetic = sum(0.5 * z.p**2 / self.inertia())
        return kinetic + sum(self.element_energy(self.shape(z.q), z.s))

    @derived
    def entropy(self, z: Any) -> Any:
        """Total entropy S(z)."""
        return sum(self.state(z).s)

    @derived
    def momenta(self, z: Any) -> Any:
        """The invariants in the order of `invariant_names`."""
        z = self.state(z)
        return trace.array(map(trace.lifted, self.invariants(z.q, z.p).values()))

    @cached_property
    def invariant_names(self) -> tuple[str, ...]:
        unknown = trace.variables("x", 2 * self.n_positions)
        return tuple(self.symbolic.invariants(unknown[: self.n_positions], unknown[self.n_positions :]))

    @derived
    def temperatures(self, z: Any) -> Any:
        """theta = de/ds of each element."""
        z = self.state(z)
        return self.element_slopes(self.shape(z.q), z.s)[1]

    @derived
    def shapes(self, z: Any) -> Any:
        """The strain measures pi at a state."""
        return self.shape(self.state(z).q)

    @derived
    def gradient(self, z: Any) -> Any:
        """DE, shape (size,)."""
        z = self.state(z)
        stress, theta = self.element_slopes(self.shape(z.q), z.s)
        stress, theta = _mark(stress), _mark(theta)
        return self.assemble(stress @ self.shape_gradient(z.q), z.p, theta)

    @derived
    def discrete_gradient(self, z0: Any, z1: Any) -> Any:
        """Algorithmic gradient D E(z0, z1) with DE . (z1 - z0) = E(z1) - E(z0), eqs. (27)-(33)."""
        z0, z1 = self.state(z0), self.state(z1)
        dz, mid = self.state(z1 - z0), self.state((z0 + z1) / 2)
        self.check_shape(mid.q)
        slope = self.shape_gradient(mid.q)  # exact divided differences, as pi is at most quadratic
        dpi = _mark(slope @ dz.q)
        pairs = [rectangle(*edges) for edges in zip(self.shape(z0.q), dpi, z0.s, dz.s, strict=True)]
        pi, s = (trace.array(side) for side in zip(*pairs, strict=True))
        slopes = [symmetrised_slopes(e) for e in self.element_energy(pi, s)]
        stress, theta = _mark([d_pi for d_pi, _ in slopes]), _mark([d_s for _, d_s in slopes])
        return self.assemble(stress @ slope, mid.p, theta)

    @derived
    def vector_field(self, z: Any) -> Any:
        """dz/dt = L DE + M DS, eqs. (1) and (22)."""
        dE = self.state(self.gradient(z))
        return self.L @ dE + self.dissipation(dE.s)

    @derived
    def jacobian(self, z: Any) -> Any:
        """d(vector_field)/dz, shape (size, size)."""
        return trace.jacobian(list(self.vector_field(z)), list(z))

    @derived
    def temperature_variables(self, z: Any) -> Any:
        """(q, p, theta) from (q, p, s)."""
        z = self.state(z)
        return self.state(np.concatenate([z.q, z.p, self.temperatures(z)]))

    @derived
    def entropy_variables(self, y: Any) -> Any:
        """(q, p, s) from (q, p, theta)."""
        y = self.state(y)
        return self.state(np.concatenate([y.q, y.p, self.entropies(y.q, y.theta)]))

    @derived
    def temperature_field(self, y: Any) -> Any:
        """d(q, p, theta)/dt, by the chain rule from the vector field."""
        z = trace.variables("z", self.size)
        slope = trace.jacobian(list(self.temperature_variables(z)), list(z))
        here = dict(zip(z, self.entropy_variables(y), strict=True))
        rate = self.vector_field(self.entropy_variables(y))
        slope_here = np.array(trace.substitute(list(slope.ravel()), here), dtype=object).reshape(slope.shape)
        return self.state(slope_here @ rate)

    def assemble(self, by_q: Any, p: Any, theta: Any) -> State:
        """A gradient of the energy from its parts: by the positions (n_positions,), momenta p, temperatures theta."""
        return self.state(np.concatenate([by_q, p / self.inertia(), theta]))

    def element_slopes(self, pi: Any, s: Any) -> tuple[Any, Any]:
        """(de/dpi, de/ds), (n_elements,) each, of the elements at these strain measures and entropies; exact."""
        n = self.n_elements
        pi_, s_ = self.fresh("pi", "element"), self.fresh("s", "element")
        slopes = trace.sparse_jacobian(list(self.element_energy(pi_, s_)), [*pi_, *s_])
        check_own(self, slopes, n)
        zero = trace.const(0.0)
        diagonal = [row.get(i, zero) for i, row in enumerate(slopes)]
        diagonal += [row.get(n + i, zero) for i, row in enumerate(slopes)]
        here = dict(zip([*pi_, *s_], [*pi, *s], strict=True))
        values = np.array(trace.substitute(diagonal, here), dtype=object)
        return values[:n], values[n:]

    def fresh(self, name: str, space: str) -> Any:
        """New variables, one for each "position" or "element"."""
        return trace.variables(name, self.n_positions if space == "position" else self.n_elements)

    def slopes(self, value: Any, by: Any) -> Any:
        """Derivatives of a number by an array of variables (as `fresh` makes them), which it is a function of."""
        return trace.jacobian([value], list(by))[0]

    def shape_gradient(self, q: Any) -> Any:
        """d(shape)/dq at q, shape (n_elements, n_positions); an operator."""
        q_ = self.fresh("q", "position")
        rows = trace.sparse_jacobian(list(self.shape(q_)), list(q_))
        entries = [(i, j, x) for i, row in enumerate(rows) for j, x in row.items()]
        values = trace.substitute([x for _, _, x in entries], dict(zip(q_, q, strict=True)))
        found: list[dict[int, trace.Symbol]] = [{} for _ in rows]
        for (i, j, _), value in zip(entries, values, strict=True):
            found[i][j] = value
        return SparseRows(found, self.n_positions)

    def check_shape(self, q: Any) -> None:
        """TraceError where the strain measures are not at most quadratic in q."""
        check_degree(self, list(self.shape(q)), list(q))

    @derived
    def exergy(self, z: Any) -> Any:
        """V = E - theta_ref S + offset >= 0: the Lyapunov functional (37), the natural scale of energy errors."""
        reference = self.reference_temperature
        return self.energy(z) - reference * self.entropy(z) + self.exergy_offset()

    @derived
    def observe(self, z: Any) -> Any:
        """(E, S, invariants..., temperatures..., strain measures...): what a run records at each step."""
        parts = [[self.energy(z), self.entropy(z)], self.momenta(z), self.temperatures(z), self.shapes(z)]
        return np.concatenate(parts)

    @cached_property
    def observer(self) -> tuple[Any, int]:
        """Kernel of `observe` and the number of its outputs, for the compiled loop."""
        entry, shape = self.kernel("observe")
        return entry, shape[0]


def _positive(theta: Any) -> Any:
    """Temperatures: a logarithm of them may be undone."""
    trace.positive(np.ravel(theta))
    return theta


def _mark(values: Any) -> Any:
    """Accumulate derivatives through these values; a number among symbols, as a rigid element has it, becomes one."""
    if np.asarray(values).dtype != object:
        return values
    return trace.array(trace.mark(trace.lifted(x)) if isinstance(x, trace.Symbol | float | int) else x for x in values)


def _mark_like(values: Any, q: Any) -> Any:
    """The same where q is symbols: then rigid elements, all of which have a number, are no exception."""
    return _mark(np.asarray(values, dtype=object) if np.asarray(q).dtype == object else values)
