"""`ElementSystem`: masses joined by elements that carry entropy and conduct heat, springs above all.

State z = (q, p, s): positions, momenta, entropies of the elements. The author writes `inertia`, `shape`,
`element_energy`, `conduction` and `entropies` in plain numpy and names the constants. Beside what any `System` has,
these have temperatures in the place of entropies as variables, and the paper's symmetrised discrete gradient.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import wraps
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..compiler import chain_rule
from ..compiler import derivatives as trace
from ..compiler.array_states import each, entries, is_array, refilled
from ..compiler.array_symbols import ArraySymbol
from ..compiler.array_tensors import symbols
from ..compiler.arrays import variable
from ..compiler.divided_differences import rectangle, symmetrised_slopes
from ..errors import TcbenchError
from .operators import ShapeGradient
from .refusals import check_degree, energy_slopes
from .sizes import check_sizes, how_many
from .state import LETTERS, State
from .system import System
from .thermal_variables import ThermalVariables, marked_positive
from .traced import derived

Array = NDArray[Any]


class ElementSystem(ThermalVariables, System):
    """Base class of masses and elements that have an entropy, such as springs; see `System` for the common part.

    The state is z = (q, p, s), shape (2 n_positions + n_elements,), dimensionless. A subclass writes `inertia`,
    `shape`, `element_energy`, `conduction` and `entropies`.

    Parameters
    ----------
    **values : number or array
        A value for each constant, of the shape that the class declares for it.

    Attributes
    ----------
    n_positions, n_elements : int
        Lengths of q and p, and of s.

    Raises
    ------
    TcbenchError
        As of `System`; for strain measures that are more than quadratic in q, TraceError.

    References
    ----------
    Romero (2009), eqs. (27)-(33) for the discrete gradient, (34) for the friction matrix; docs/add-system.md.
    """

    n_positions: int = 0
    n_elements: int = 0
    collapsed = "an element collapsed (strain measure not positive)"
    initial_data = ("positions", "momenta", "temperatures")
    written: ClassVar[tuple[str, ...]] = (
        "name", "constants", "tables", "positive", "non_negative", "reference_temperature", "source", "n_positions",
        "n_elements", "units",
        "inertia", "shape", "element_energy", "conduction", "entropies", "invariants", "conduction_flow", "points",
        "entropy_scale", "exergy_offset",
    )  # fmt: skip

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        if "shape" in cls.__dict__:  # elements depend on positions through their strain measure only
            shape = cls.__dict__["shape"]
            cls.shape = wraps(shape)(lambda self, q: _mark_like(shape(self, q), q))  # type: ignore[method-assign]
        if "entropies" in cls.__dict__:
            entropies = cls.__dict__["entropies"]
            cls.entropies = wraps(entropies)(lambda self, q, theta: entropies(self, q, marked_positive(theta)))  # type: ignore[method-assign]
        for name in cls.__dict__.keys() & {"element_energy", "conduction", "shape", "entropies", "invariants"}:
            setattr(cls, name, _on_symbols(cls.__dict__[name]))

    # ---- written by the author of a system -------------------------------------------------------------

    def inertia(self) -> Any:
        """Mass that belongs to each position coordinate, shape (n_positions,)."""
        raise TypeError(f"{type(self).__name__} must define inertia()")

    def shape(self, q: Any) -> Any:
        """Strain measure of each element, shape (n_elements,); linear or quadratic in q, positive."""
        raise TypeError(f"{type(self).__name__} must define shape()")

    def element_energy(self, pi: Any, s: Any) -> Any:
        """Internal energies, shape (n_elements,), each a function of the element's own strain measure and entropy."""
        raise TypeError(f"{type(self).__name__} must define element_energy()")

    def conduction(self, theta: Any) -> Any:
        """M DS, the entropy rates by heat conduction, shape (n_elements,); theta @ conduction(theta) = 0."""
        raise TypeError(f"{type(self).__name__} must define conduction()")

    def entropies(self, q: Any, theta: Any) -> Any:
        """Entropies at given temperatures theta, shape (n_elements,) each: the inverse of theta = de/ds."""
        raise TypeError(f"{type(self).__name__} must define entropies()")

    def invariants(self, q: Any, p: Any) -> dict[str, Any]:  # type: ignore[override]
        """Conserved momenta, a number by name, of q and p, shape (n_positions,) each; none by default."""
        return {}

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

    def points(self, q: Any) -> Any:  # an argument of another name: positions only
        """The two ends of each element in the plane, shape (n_elements, 2, 2), for pictures; dimensionless.

        Optional: springs between points of the plane are found without it.
        """
        raise TcbenchError(f"System {self.name!r} does not say where its elements are: it has no points(q).")

    def entropy_scale(self) -> Any:
        """Size of a typical entropy increment, for Newton's stopping test."""
        return self.magnitudes[2]

    # ---- derived ---------------------------------------------------------------------------------------

    @classmethod
    def declared_variables(cls) -> dict[str, tuple[Any, ...]]:
        return {"q": ("position",), "p": ("position",), "s": ("element",)}

    @classmethod
    def has_spaces(cls) -> bool:
        return bool(cls.tables)

    def _set_variables(self, sizes: Mapping[str, int]) -> None:
        self.__dict__.update(n_positions=sizes["position"], n_elements=sizes["element"])

    @property
    def variables(self) -> dict[str, tuple[int, ...]]:  # type: ignore[override]
        return {"q": (self.n_positions,), "p": (self.n_positions,), "s": (self.n_elements,)}

    @property
    def size(self) -> int:
        return 2 * self.n_positions + self.n_elements

    def sizes(self, z: Any) -> list[Any]:
        return [*super().sizes(z)[:2], 0.0 * self.state(z).s + self.entropy_scale()]

    def start(self, positions: Any, momenta: Any, temperatures: Any) -> NDArray[np.float64]:  # type: ignore[override]
        n, m = how_many(self, positions, temperatures)
        settings = {"positions": (positions, n), "momenta": (momenta, n), "temperatures": (temperatures, m)}
        for name, (values, size) in settings.items():
            if len(values) != size:
                raise TcbenchError(f"{name} must be {size} numbers, not {len(values)}.")
        if min(temperatures) <= 0:
            raise TcbenchError(f"temperatures must be positive, not {min(temperatures):g}.")
        inertia = np.asarray(self.inertia(), dtype=float)
        if not np.all(inertia > 0):
            raise TcbenchError(f"{type(self).__name__}: inertia() must be positive, not {inertia.min():g}.")
        check_sizes(self, np.array(positions), np.array(momenta), np.array(temperatures))
        shape = np.asarray(self.shape(np.array(positions)), dtype=float)
        if not np.all(shape > 0):
            which = int(np.argmin(shape))
            raise TcbenchError(
                f"element {which} is collapsed at the start (strain measure {shape[which]:g}); "
                "move the initial positions apart."
            )
        s = self.entropies(np.array(positions), np.array(temperatures))
        z = np.concatenate([positions, momenta, s]).astype(float)
        energies = self.element_energy(shape, z[2 * n :])  # plain numpy: a scenario is made without compiling anything
        if not np.all(np.isfinite(z)) or not np.all(np.isfinite(energies)):
            raise TcbenchError("the initial state or its energy is not finite.")
        return z

    def initial_of(self, z: Any) -> dict[str, Any]:
        state = self.state(np.asarray(z, dtype=float))
        return {"positions": (*state.q,), "momenta": (*state.p,), "temperatures": (*self.temperatures(state),)}

    def columns_in_time(self, z: Any) -> dict[str, Any]:
        """Columns in time of the states z (m, size): log strains and points in the plane of springs, else positions."""
        q, log_strain = np.asarray(z)[:, : self.n_positions], getattr(self, "log_strain", None)
        if log_strain is None:
            return {f"q_{i + 1}": values for i, values in enumerate(q.T)}
        strains = np.array([log_strain(pi) for pi in self.shapes(z)])
        columns = {f"strain_{letter}": strain for letter, strain in zip(LETTERS, strains.T, strict=False)}
        for mass in range(q.shape[1] // 2):
            columns |= {f"x_{mass + 1}": q[:, 2 * mass], f"y_{mass + 1}": q[:, 2 * mass + 1]}
        return columns

    def nearby(self, z0: Any, rng: np.random.Generator) -> Any:
        z0 = self.state(z0)
        q_scale, p_scale, *_ = self.magnitudes
        reach = 0.3 * max(q_scale, float(np.abs(z0.q).max())), 0.5 * max(p_scale, float(np.abs(z0.p).max()))
        q = z0.q + reach[0] * rng.standard_normal(len(z0.q))
        p = z0.p + reach[1] * rng.standard_normal(len(z0.p))
        theta = np.asarray(self.temperatures(z0)) * np.exp(0.2 * rng.standard_normal(self.n_elements))
        return self.entropy_variables(np.concatenate([q, p, theta]))

    @property
    def L(self) -> NDArray[np.float64]:
        """The Poisson matrix: canonical on (q, p), zero on s; shape (size, size)."""
        n, matrix = self.n_positions, np.zeros((self.size, self.size))
        matrix[:n, n : 2 * n], matrix[n : 2 * n, :n] = np.eye(n), -np.eye(n)
        return matrix

    @property
    def DS(self) -> NDArray[np.float64]:
        """Gradient of the entropy S = sum of s, shape (size,)."""
        return np.concatenate([np.zeros(2 * self.n_positions), np.ones(self.n_elements)])

    @derived
    def reversible(self, z: Any, dE: Any, dS: Any) -> Any:
        """L dE."""
        dE = self.state(dE)
        return self.state(np.concatenate([dE.p, -dE.q, 0.0 * dE.s]))

    @derived
    def irreversible(self, z: Any, dE: Any, dS: Any) -> Any:
        """M DS at the temperatures in dE; the entropy gradient is DS at any state."""
        return self.dissipation(self.state(dE).s)

    def dissipation(self, theta: Any) -> State:
        """M(theta) DS, shape (size,), of temperatures (n_elements,); never M times DS, which cancels."""
        still = ArraySymbol("position", trace.const(0.0)) if self.by_array else np.zeros(self.n_positions)
        return self.state(np.concatenate([still, still, self.conduction(theta)]))

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
        kinetic = np.sum(0.5 * z.p**2 / self.inertia())
        return kinetic + np.sum(self.element_energy(self.shape(z.q), z.s))

    @derived
    def entropy(self, z: Any) -> Any:
        """Total entropy S(z)."""
        return np.sum(self.state(z).s)

    def _conserved(self, z: Any) -> dict[str, Any]:
        z = self.state(z)
        return self.invariants(z.q, z.p)

    @derived
    def temperatures(self, z: Any) -> Any:
        """theta = de/ds of each element, shape (n_elements,)."""
        z = self.state(z)
        return self.element_slopes(self.shape(z.q), z.s)[1]

    @derived
    def shapes(self, z: Any) -> Any:
        """The strain measures pi at a state, shape (n_elements,)."""
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
        pi, s = each(rectangle, self.shape(z0.q), dpi, z0.s, dz.s, count=2)
        stress, theta = each(symmetrised_slopes, self.simplified_energies(pi, s), count=2)
        return self.assemble(_mark(stress) @ slope, mid.p, _mark(theta))

    @derived
    def temperature_field(self, y: Any) -> Any:
        """d(q, p, theta)/dt, shape (size,), by the chain rule from the vector field."""
        z, state = self.unknowns("z"), self.entropy_variables(y)
        outputs = self.temperature_variables(z)
        rates = dict(zip(entries(z), map(trace.lifted, entries(self.vector_field(state))), strict=True))
        moved = trace.along([*map(trace.lifted, entries(outputs))], rates)
        return refilled(outputs, trace.substitute(moved, dict(zip(entries(z), entries(state), strict=True))))

    def assemble(self, by_q: Any, p: Any, theta: Any) -> State:
        """A gradient of the energy from its parts: by the positions (n_positions,), momenta p, temperatures theta."""
        return self.state(np.concatenate([by_q, p / self.inertia(), theta]))

    def element_slopes(self, pi: Any, s: Any) -> tuple[Any, Any]:
        """(de/dpi, de/ds), (n_elements,) each, of the elements at these strain measures and entropies; exact."""
        pi_, s_ = self.fresh("pi", "element"), self.fresh("s", "element")
        own = entries(pi_, s_)
        n, rows = len(own) // 2, energy_slopes(self, entries(self.element_energy(pi_, s_)), own)
        diagonal = [row.get(k + i, trace.const(0.0)) for k in (0, n) for i, row in enumerate(rows)]
        values = trace.substitute(diagonal, dict(zip(own, entries(pi, s), strict=True)))
        return refilled(pi_, values[:n]), refilled(pi_, values[n:])

    def fresh(self, name: str, space: str) -> Any:
        """New variables, one for each "position" or "element"."""
        if self.by_array:
            return ArraySymbol(space, variable(name, space))
        return trace.variables(name, self.n_positions if space == "position" else self.n_elements)

    def slopes(self, value: Any, by: Any) -> Any:
        """Derivatives of a number by an array of variables (as `fresh` makes them), which it is a function of."""
        return refilled(by, chain_rule.gradient(trace.lifted(value), entries(by)))

    def shape_gradient(self, q: Any) -> ShapeGradient:
        """d(shape)/dq at q, shape (n_elements, n_positions); an operator."""
        return ShapeGradient(self, q)

    def check_shape(self, q: Any) -> None:
        """TraceError where the strain measures are not at most quadratic in q."""
        check_degree(self, entries(self.shape(q)), entries(q))


def _mark(values: Any) -> Any:
    """Mark values, so that derivatives are accumulated through them; numbers among symbols become symbols."""
    if is_array(values):
        return each(lambda x: trace.mark(trace.lifted(x)), values)
    if np.asarray(values).dtype != object:
        return values
    return trace.array(trace.mark(trace.lifted(x)) if isinstance(x, trace.Symbol | float | int) else x for x in values)


def _on_symbols(body: Any) -> Any:
    """An author's function, on arrays of symbols in which numpy's functions may choose."""
    return wraps(body)(lambda self, *arrays: body(self, *map(symbols, arrays)))


def _mark_like(values: Any, q: Any) -> Any:
    """`_mark` where q is symbols, also where all values are numbers, as those of rigid elements are."""
    of_symbols = not is_array(values) and np.asarray(q).dtype == object
    return _mark(np.asarray(values, dtype=object) if of_symbols else values)
