"""`System`: any GENERIC system, dz/dt = L(z) grad E + M(z) grad S, by its formulas; and all that is derived from them.

The author names the variables and the constants and writes, in plain numpy,

    energy(z), entropy(z)
    reversible(z, dE, dS)     L(z) dE        with  dE . rev = 0  and  dS . rev = 0
    irreversible(z, dE, dS)   M(z) dS        with  dE . irr = 0  and  dS . irr >= 0

for whatever covectors dE and dS are put in, not at the true gradients only: a method puts in discrete ones, and both
laws follow. Or the matrices `poisson(z)` and `friction(z)`, with identities at the true gradients: they are projected.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from ..compiler import chain_rule
from ..compiler import derivatives as trace
from ..compiler.array_states import entries, refilled
from ..compiler.caches import cached_property
from ..compiler.cut import Cut
from ..errors import TcbenchError, unknown_name
from . import constrained
from .as_written import RETURNED, as_written, derive
from .declaration import check_declared, checked_constant, finite, named_constant, whole
from .formulas import FORMULAS, Formulas
from .refusals import check_attribute, check_class
from .state import Layout, State, fixed, formulas_hash, in_one_row, laid_out, products, summed
from .traced import OF_LAWS, derived

if TYPE_CHECKING:
    from ..integrator import Integrator


class System(Formulas):
    """Base class of GENERIC systems; an instance holds values of the constants and is immutable.

    A subclass declares `name`, `variables` and `constants` and defines `energy`, `entropy`, `reversible` and
    `irreversible` (or `poisson` and `friction`); gradients, discrete gradients and compiled kernels are derived. A
    state z has shape (size,), and z.q is the variable q; everything is dimensionless.

    Parameters
    ----------
    **values : number or array
        A value for each constant, of the shape that the class declares for it.

    Attributes
    ----------
    name : str
        Of the kind of system; that of the class by default.
    variables : mapping of str to tuple of int
        Name -> shape: () for a number, (3,) for three.
    constants : mapping of str to tuple of int
        Likewise.
    positive, non_negative : tuple of str
        Names of constants that must be positive, or not negative.
    reference_temperature : float or name of a constant
        theta_ref of the exergy V = E - theta_ref S + offset; 0: energy errors are relative to the energy itself.
    source : str
        Paper and equation.
    units : mapping of str to str
        Units by the name of a variable or a constant; used by `tcbench check` only.

    Raises
    ------
    TcbenchError
        For a class that overrides a derived function; for constants that are missing, unknown, of another shape, not
        finite or not positive.

    References
    ----------
    Romero (2009), eq. (1), dz/dt = L grad E + M grad S; eq. (37) for V; docs/add-system.md.
    """

    # what an author may write; all other names of the class are derived
    written: ClassVar[tuple[str, ...]] = (
        "name", "constants", "variables", "tables", "positive", "non_negative", "reference_temperature", "source",
        *FORMULAS, "poisson", "friction", "invariants", "temperature", "measures", "exergy_offset", "points",
        "units", "multipliers", "constraints",
    )  # fmt: skip

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        if "name" not in cls.__dict__ and cls.name in ("", *(base.__name__ for base in cls.__mro__)):
            cls.name = cls.__name__
        check_class(cls)
        check_declared(cls, System)
        if isinstance(cls.reference_temperature, str):
            cls.reference_temperature = named_constant(cls, "reference_temperature", cls.reference_temperature)
        derive(cls, System, FORMULAS)
        constrained.check_multipliers(cls)
        for name in RETURNED:
            if name in cls.__dict__ and name not in FORMULAS and "energy" in cls.written:  # no system of elements
                setattr(cls, name, as_written(cls.__dict__[name], name))

    def __setattr__(self, name: str, value: Any) -> None:
        check_attribute(self, name, value)
        object.__setattr__(self, name, value)

    def __init__(self, **values: Any) -> None:
        check_class(type(self))  # again: a notebook may have changed the class and its formulas
        derive(type(self), System, FORMULAS)
        if not self.variables:
            raise TcbenchError(
                f"{type(self).__name__} declares no variables; write variables = {{'q': (), 'p': (2,)}}."
            )
        for name in values:
            if name not in self.constants and name not in self.tables:
                raise unknown_name(f"constant of {self.name!r}", name, {**self.constants, **self.tables})
        if self.has_spaces():
            self._measured(values)
        for name, shape in self.constants.items():
            if name not in values:
                raise TcbenchError(f"System {self.name!r} needs a value for the constant {name!r}.")
            setattr(self, name, checked_constant(self, name, shape, values[name]))
        self.formulas = formulas_hash(type(self))
        values_of = {name: np.ravel(getattr(self, name)) for name in self.constants}
        self.zeros = tuple((name, int(i)) for name, x in values_of.items() for i in np.flatnonzero(x == 0.0))

    @classmethod
    def defines(cls, name: str) -> bool:
        """Does the author define an optional function, such as "conduction_flow"?"""
        (base, *_) = (c for c in cls.__mro__ if "written" in c.__dict__)
        own = getattr(cls, name, None)
        return callable(own) and own is not getattr(base, name, None)

    # ---- variables -------------------------------------------------------------------------------------

    @cached_property
    def layout(self) -> Layout:
        """Where each variable stands in z, and its shape, by name."""
        return laid_out(self.variables)

    @cached_property
    def size(self) -> int:
        """Length of z."""
        return sum(int(np.prod(shape)) for shape in self.variables.values())

    def __repr__(self) -> str:
        shapes = (f"{n}{list(shape) if shape else ''}" for n, shape in self.variables.items())
        return f"<System {self.name}: {', '.join(shapes)}>"

    @property
    def component_names(self) -> list[str]:
        """Names of the numbers of z: q of a variable that is one number, q0, q1, ... of an array."""
        return [f"{n}{i}" if shape else n for n, shape in self.variables.items() for i in range(int(np.prod(shape)))]

    def state(self, values: Any) -> State:
        """z with its variables as attributes, shape (..., size): one state or several."""
        if self.by_array:
            of_arrays: Any = self.array_state(values)
            return cast(State, of_arrays)
        return State(values, self.layout)

    def unknowns(self, name: str) -> State:
        """New variables, a state of symbols."""
        return self.state(self.fresh_state(name) if self.by_array else trace.variables(name, self.size))

    def in_variables(self, variables: str, z: Any) -> State:
        """z in the thermal variables that a formula is written in; only systems of elements have several."""
        return self.state(z)

    def start(self, initial: Any) -> NDArray[np.float64]:
        """z, shape (size,), from the initial data of a Scenario; TcbenchError where a step could not begin there."""
        for name in initial:
            if name not in self.variables:
                raise unknown_name(f"variable of {self.name!r}", name, self.variables)
        for name, shape in self.variables.items():
            if name not in initial or (np.shape(initial[name]) != shape and (0 not in shape or np.size(initial[name]))):
                problem = f"has {initial[name]!r}" if name in initial else "does not"
                raise TcbenchError(f"initial must give {name!r}, {whole(shape)}; it {problem}.")
        z = np.concatenate([np.ravel(initial[name]) for name in self.variables]).astype(float)
        if not len(z):
            raise TcbenchError("all spaces are empty: a state has no numbers.")
        state = self.state(z)  # in plain numpy: a scenario is made without compiling anything
        with np.errstate(all="ignore"):  # what is not finite is said below
            laws = [finite(self, name, getattr(type(self), name).__wrapped__(self, state)) for name in FORMULAS[:2]]
        if not np.all(np.isfinite([*z, *laws])):
            raise TcbenchError("the initial state, its energy or its entropy is not finite.")
        if not np.all(np.asarray(in_one_row(self.measures(state)), dtype=float) > 0):
            raise TcbenchError(f"what must stay positive is {self.measures(state)} at the start.")
        return z

    def initial_of(self, z: Any) -> dict[str, Any]:
        """The settings of a Scenario that starts at z (size,)."""
        state = self.state(np.asarray(z, dtype=float))
        return {"initial": {name: getattr(state, name) for name in self.variables}}

    def columns_in_time(self, z: Any) -> dict[str, Any]:
        """Columns of charts, name -> (m,), of states z (m, size): the variables, one number each."""
        return dict(zip(self.component_names, np.asarray(z).T, strict=True))

    def nearby(self, z0: Any, rng: np.random.Generator) -> Any:
        """A random state (size,) at some distance from z0 (size,); it need not be admissible."""
        scale = np.maximum(0.3 * self.state_magnitudes, np.abs(z0))
        return self.state(z0 + 0.3 * scale * rng.standard_normal(self.size))

    # ---- derived ---------------------------------------------------------------------------------------

    @cached_property
    def constant_values(self) -> NDArray[np.float64]:
        """(h, constants in declared order, `magnitudes`), shape (n_constant_values,): each kernel's second argument."""
        declared = self.declared_values
        return fixed(np.concatenate([declared[: len(declared) - len(self.magnitudes)], self.magnitudes]))

    @cached_property
    def declared_values(self) -> NDArray[np.float64]:
        """`constant_values` with 1 for all magnitudes, which no formula of a system reads."""
        parts = [np.ravel(getattr(self, name)) for name in self.constants]
        return fixed(np.concatenate([[0.0], *parts, np.ones(len(self.variables) + OF_LAWS)]).astype(np.float64))

    @property
    def n_constant_values(self) -> int:
        """Length of `constant_values`."""
        constants = sum(int(np.prod(shape)) for shape in self.constants.values())
        return 1 + constants + len(self.variables) + OF_LAWS

    @derived
    def momenta(self, z: Any) -> Any:
        """The invariants in the order of `invariant_names`, shape (n_invariants,)."""
        return trace.array(map(trace.lifted, self._conserved(z).values()))

    def _conserved(self, z: Any) -> dict[str, Any]:
        """The invariants at the state z (size,), by name."""
        return self.invariants(self.state(z))

    def momenta_gradients(self, z: Any) -> list[State]:
        """Gradients of the invariants, shape (size,) each, on symbols."""
        x = self.unknowns("x")
        gradients = [chain_rule.gradient(f, entries(x)) for f in self.momenta(x)]
        at_z = dict(zip(entries(x), map(trace.lifted, entries(z)), strict=True))
        return [self.state(refilled(x, trace.substitute(slopes, at_z))) for slopes in gradients]

    def momenta_discrete_gradients(self, z0: Any, z1: Any) -> list[State]:
        """Discrete gradients of the invariants, shape (size,) each, on symbols: DJ . (z1 - z0) = J(z1) - J(z0)."""
        x = self.unknowns("x")
        start, step = [*map(trace.lifted, entries(z0))], [*map(trace.lifted, entries(z1 - z0))]
        gradients = [chain_rule.discrete_gradient(trace.lifted(f), entries(x), start, step) for f in self.momenta(x)]
        return [self.state(refilled(x, slopes)) for slopes in gradients]

    @derived
    def invariant_rates(self, z: Any) -> Any:
        """(2 n_invariants,): dJ/dt of each invariant without constraint forces, then the sum of |its terms| of each."""
        rates = entries(self.free_rate(z))
        terms = [products(entries(slopes), rates) for slopes in self.momenta_gradients(z)]
        return trace.array(map(summed, [*terms, *([abs(x) for x in row] for row in terms)]))

    @property
    def invariant_names(self) -> tuple[str, ...]:
        """Names of the invariants."""
        symbolic: System = self.symbolic
        return symbolic.counted[0]

    @property
    def n_temperatures(self) -> int:
        """Number of temperatures of a state."""
        symbolic: System = self.symbolic
        return symbolic.counted[1]

    @cached_property
    def counted(self) -> tuple[tuple[str, ...], int]:
        """Names of the invariants and number of temperatures, of a symbolic system."""
        sym = self.by_arrays if self.large else self
        with trace.tracing():
            z = sym.unknowns("x")
            names, theta = tuple(sym._conserved(z)), sym.temperatures(z)
        if self.by_array:  # of no size
            return names, 0
        return names, self.mesh.offsets(sym.blocks(theta))[-1] if self.large else len(theta)

    @derived
    def gradient(self, z: Any) -> Any:
        """grad E, shape (size,)."""
        return self._slopes("energy", z)

    @derived
    def entropy_gradient(self, z: Any) -> Any:
        """grad S, shape (size,)."""
        return self._slopes("entropy", z)

    @derived
    def discrete_gradient(self, z0: Any, z1: Any) -> Any:
        """D E(z0, z1), shape (size,), with DE . (z1 - z0) = E(z1) - E(z0), symmetric: eq. (8)."""
        return self._slopes("energy", z0, z1)

    @derived
    def discrete_entropy_gradient(self, z0: Any, z1: Any) -> Any:
        """D S(z0, z1), shape (size,), with DS . (z1 - z0) = S(z1) - S(z0)."""
        return self._slopes("entropy", z0, z1)

    def cut(self, name: str) -> Cut:
        """A law ("energy" or "entropy") cut into an outer function of inner ones that are at most quadratic in z."""
        x = self.unknowns("x")
        return Cut(trace.lifted(getattr(self, name)(x)), entries(x))

    def pull_gradient(self, z0: Any, z1: Any) -> Any:
        """The discrete gradient of lam . g in a view with multipliers, else 0: for discrete gradients of methods."""
        if self.pull is None:
            return self.state(0.0 * z0)
        return constrained.discrete_pull(self, z0, entries(z1 - z0), self.pull)

    def _with_pull(self, name: str, x: Any) -> Any:
        """The law of this name at x; the energy of a view with multipliers has lam . g added."""
        f = trace.lifted(getattr(self, name)(x))
        if self.pull is None or name != "energy":
            return f
        return f + constrained.paired(self.pull, constrained.conditions(self, x))

    def discrete_gradients(self, z0: Any, z1: Any) -> tuple[State, State]:
        """D E(z0, z1) and D S(z0, z1), shape (size,) each."""
        return self.discrete_gradient(z0, z1), self.discrete_entropy_gradient(z0, z1)

    def _slopes(self, name: str, z0: Any, z1: Any = None) -> State:
        """The gradient of a law at z0, or its discrete gradient from z0 to z1, shape (size,)."""
        at = self.unknowns("x")
        f, x, start = self._with_pull(name, at), entries(at), [*map(trace.lifted, entries(z0))]
        if z1 is None:
            slopes = trace.substitute(chain_rule.gradient(f, x), dict(zip(x, start, strict=True)))
        else:
            step = [b - a for a, b in zip(start, map(trace.lifted, entries(z1)), strict=True)]
            slopes = chain_rule.discrete_gradient(f, x, start, step)
        return self.state(refilled(at, slopes))

    @derived
    def vector_field(self, z: Any) -> Any:
        """dz/dt = L grad E + M grad S, shape (size,), eq. (1); under constraints with their multipliers."""
        if self.multipliers and self.pull is None:
            if self.by_array:
                raise TcbenchError(
                    f"{self.name!r} has constraints: its right-hand side needs the multipliers, which solve a system "
                    "of equations; it is traced for states of a few numbers only. Take tc_monolithic or "
                    "midpoint_entropy"
                )
            return constrained.reduced(self, z)
        return self.free_rate(z)

    @derived
    def jacobian(self, z: Any) -> Any:
        """d(vector_field)/dz, shape (size, size)."""
        return trace.jacobian(list(self.vector_field(z)), list(z))

    @derived
    def temperatures(self, z: Any) -> Any:
        """The temperatures at a state, shape (n_temperatures,)."""
        return in_one_row(self.temperature(*(self.state(x) for x in (z, self.gradient(z), self.entropy_gradient(z)))))

    @derived
    def shapes(self, z: Any) -> Any:
        """The values of `measures`, which must stay positive, shape (n_measures,)."""
        return in_one_row(self.measures(self.state(z)))

    @derived
    def free_rate(self, z: Any) -> Any:
        """dz/dt without constraint forces, shape (size,)."""
        covectors = self.state(self.gradient(z)), self.state(self.entropy_gradient(z))
        return self.reversible(z, *covectors) + self.irreversible(z, *covectors)

    def excludes(self, method: Integrator) -> str:
        """Why a method cannot run on systems of this kind; "" where it can. See `Integrator.suits`."""
        return constrained.excluded(self, method) if self.multipliers else ""

    @derived
    def constraint_values(self, z: Any) -> Any:
        """g(z), which has to be 0, shape (n_constraints,)."""
        return in_one_row(constrained.conditions(self, z))

    @derived
    def constraint_speeds(self, z: Any) -> Any:
        """dg/dt, which has to be 0, too, shape (n_constraints,): the velocity form of the constraints."""
        return in_one_row(constrained.velocities(self, z))

    @derived
    def exergy(self, z: Any) -> Any:
        """V = E - theta_ref S + offset >= 0: the Lyapunov functional (37), the natural scale of energy errors."""
        return self.energy(z) - self.reference_temperature * self.entropy(z) + self.exergy_offset()

    @derived
    def observe(self, z: Any) -> Any:
        """(E, S, invariants..., temperatures..., strain measures...), shape (n_observables,): a record of a step."""
        parts = [[self.energy(z), self.entropy(z)], self.momenta(z), self.temperatures(z), self.shapes(z)]
        return np.concatenate(parts)

    @cached_property
    def observer(self) -> tuple[Any, int]:
        """Kernel of `observe` and the number of its outputs, for the compiled loop."""
        entry, shape = self.kernel("observe")
        return entry, shape[0]
