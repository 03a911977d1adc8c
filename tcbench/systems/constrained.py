"""Holonomic constraints g(z) = 0 with multipliers: what a `System` that declares `multipliers` has of them.

The author writes the energy without multipliers and `constraints(z)`. Formulas of methods are called on a view of the
system (`pulled`), whose energy is E + lam . g wherever slopes of it are taken: DE then has lam Dg in it, with
Dg . (z1 - z0) = g(z1) - g(z0), so that the constraint's force does no work and keeps every invariant that g has
(Gonzalez 1999; Betsch and Steinmann 2002). `closed` adds the multipliers' own equations.

Unknown of a step is the impulse h lam, not lam: at h = 0 the equations then are those of a reflection,
    z1 - z0 = -L Dg . impulse,   Dg . L DE = 0,
whose matrix is (G M^-1 G^T)/2 in the rows of the multipliers, positive definite: determinants are positive at h = 0 and
roots can be followed from there. With lam itself, and g(z1) = 0 as its row, the matrix at h = 0 is singular.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..compiler import chain_rule
from ..compiler import derivatives as trace
from ..compiler.array_states import entries, is_array, refilled
from ..compiler.arrays import variable
from ..compiler.derivatives import Symbol, const
from ..compiler.elimination import factorise
from ..compiler.normal_rows import cancelled
from ..errors import TcbenchError, TraceError
from .state import blocks_of, products, shape_of, summed

if TYPE_CHECKING:
    from ..integrator import Integrator
    from .system import System

MOST_REDUCED = 240  # length of a state up to which the ODE under constraints is traced: 5 s for 30 rigid rods
MOST_LAWFUL = 100  # the same of methods that keep the constraints as laws: 70 numbers take 18 s
REDUCED = "constraints"  # tag of methods that keep the constraints as laws, most on this ODE: see solver.mending
SAMPLES, SYMMETRIC = 2, 1e-12  # random states at which symmetry is tested, and its relative round-off
NONE_AT_ZERO = 1e-32  # added to h^4, so that a residual of a constraint is corrected at h > 0 only


def check_multipliers(cls: Any) -> None:
    """TcbenchError where multipliers and constraints do not belong together."""
    if bool(cls.multipliers) != cls.defines("constraints"):
        raise TcbenchError(
            f"{cls.__name__}: multipliers = {{'lam': 'rod'}} and constraints(z), which returns {{'lam': what has to be "
            "0}, go together; write both or none."
        )
    for name in cls.multipliers:
        if name in cls.variables or name in cls.constants:
            raise TcbenchError(
                f"{cls.__name__}: the multiplier {name!r} is called as a variable or a constant is. tcbench adds it to "
                "the unknowns and lam . g to the energy: write the energy without it."
            )


def named_constraints(system: System, values: Any, where: str) -> Any:
    """The value of constraints(), checked: one array or number by the name of each multiplier, else TcbenchError."""
    if not isinstance(values, Mapping) or not set(values) <= set(system.multipliers):  # that of a base class has fewer
        wanted = ", ".join(f"{name!r}: ..." for name in system.multipliers)
        raise TcbenchError(f"{where} returns what has to be 0 by the name of its multiplier, {{{wanted}}}.")
    for name, value in values.items():
        declared = system.multipliers[name]
        first, *further = declared = (declared,) if isinstance(declared, str) else (*declared, *[None] * (not declared))
        shape = None if is_array(value) or value is None or isinstance(value, str) else shape_of(value)
        over = isinstance(first, str)  # a space: on arrays the value is one over it
        fits = shape == (() if first is None else declared) or (over and shape and shape[1:] == tuple(further))
        if not (fits or (over and is_array(value))):
            kind = "nothing" if value is None else f"shape {shape}" if shape is not None else f"{value!r}"
            wanted = "one number" if first is None else f"numbers of shape {system.multipliers[name]!r}"
            raise TcbenchError(f"{where}: the multiplier {name!r} is declared to hold {wanted}; it is given {kind}.")
    return values


def check_positions(system: System) -> None:
    """TcbenchError where constraints read what their own force changes at once: d2g/dt2 would not give multipliers."""
    net = system.by_arrays if system.large else system.symbolic
    with trace.tracing():
        x, dE, dS = (net.unknowns(name) for name in "xab")
        mu = symbols_like(conditions(net, x), "mu")
        slopes = chain_rule.gradient(paired(mu, conditions(net, x)), entries(x))
        rates = entries(net.reversible(x, dE, dS) + net.irreversible(x, dE, dS))
        read = [i for i, slope in enumerate(slopes) if not trace.is_const(slope, 0.0)]
        moved = [trace.lifted(rates[i]) for i in read]
        feels_force = trace.depends_on(moved, [entries(dE)[i] for i in read])
    of = [name for name, block in zip(net.variables, blocks_of(net, x), strict=True) for _ in entries(block)]
    names = [of[i] for i, rate in zip(read, moved, strict=True) if rate.number in feels_force]
    if names:
        raise TcbenchError(
            f"System {system.name!r}: constraints(z) reads {names[0]}, which moves with the constraint's own force: "
            "write it in positions, which do not (momenta and entropies cannot be held)."
        )


def excluded(system: System, method: Integrator) -> str:
    """Why a method cannot run on a system with constraints; "" where it can."""
    if REDUCED in method.tags:
        if system.size <= MOST_LAWFUL:
            return ""
        return (
            f"it writes out what keeps constraints and laws, of systems of up to {MOST_LAWFUL} numbers; "
            f"{system.name} has {system.size}: take tc_monolithic, or for a tolerance scipy_dop853"
        )
    if method.kind == "flows" and not method.memory and not any(flow.stages or flow.of_step for flow in method.flows):
        return ""
    if method.kind == "adaptive" and "peer" in method.tags:
        if system.size <= MOST_REDUCED or {"explicit", "peer"} <= method.tags:
            return ""
        return (
            f"it needs the ODE under the constraints as formulas, which are traced up to {MOST_REDUCED} numbers; "
            f"{system.name} has {system.size}: take scipy_dop853 or solve_ivp_rk45, to which numbers are enough"
        )
    return (
        f"{system.name} has constraints, whose multipliers are unknowns of one-step formulas without stages: take "
        "tc_monolithic, tc_gonzalez, tc_strang or midpoint_entropy; tc_invariant, which keeps every invariant; or "
        "tc_auto, which solves the ODE under them"
    )


def conditions(system: System, z: Any) -> list[Any]:
    """g(z), an array or number of each multiplier, in declared order."""
    values = system.constraints(system.state(z))
    if missing := [name for name in system.multipliers if name not in values]:
        raise TcbenchError(
            f"{type(system).__name__}: constraints() does not say what the multiplier {missing[0]!r} holds."
        )
    return [values[name] for name in system.multipliers]


def symbols_like(g: Sequence[Any], name: str) -> list[Any]:
    """New symbols in the shapes of the constraints g."""
    return [refilled(x, [variable(name, y.space) if isinstance(y, Symbol) else variable(name, "") for y in entries(x)])
            for x in map(_lifted, g)]  # fmt: skip


def _lifted(x: Any) -> Any:
    return x if is_array(x) else trace.array(map(trace.lifted, np.ravel(np.asarray(x, dtype=object))))


def paired(lam: Sequence[Any], g: Sequence[Any]) -> Symbol:
    """lam . g, one number."""
    return summed(products(entries(*lam), entries(*map(_lifted, g))))


def pulled(system: Any, lam: Sequence[Any]) -> Any:
    """A view of the system for formulas of methods: slopes of its energy are those of E + lam . g."""
    view = object.__new__(type(system))
    view.__dict__.update({k: v for k, v in system.__dict__.items() if k != "symbolic"})
    view.__dict__["pull"] = list(lam)
    view.__dict__["symbolic"] = view
    return view


# ---- the equations of a step ----------------------------------------------------------------------------------------


def closed(
    system: Any, view: Any, y0: Any, d: Sequence[Symbol], h: Symbol, rows: Sequence[Symbol], name: str
) -> tuple[list[Symbol], list[Symbol]]:
    """(rows, impulses): the equations of a step under constraints, with impulses h lam in the place of multipliers.

    y0 : the state. d : its increments. rows : equations of the author's formula on `view`, d + ... - h F = 0, one for
    each of d. The equations of the impulses follow. TraceError for formulas that are not linear in the multipliers.
    """
    lam = entries(*view.pull)
    dy = refilled(y0, list(d))
    y1 = y0 + dy
    middle = (y0 + y1) / 2
    impulses = [variable("impulse", x.space) for x in lam]
    blocks = _blocks_like(view.pull, impulses)
    by_impulse = trace.along(rows, dict(zip(lam, impulses, strict=True)))
    free = trace.substitute(rows, dict.fromkeys(lam, const(0.0)))
    if trace.depends_on(by_impulse, lam) & {x.number for x in by_impulse}:
        raise TraceError(
            f"{name}: the equations of a step are not linear in the multipliers: reversible() and irreversible() must "
            "be linear in those slopes of the energy that a constraint changes (dE.q of constraints on q)."
        )
    reads = any(not trace.is_const(x, 0.0) for x in by_impulse)
    DS = system.discrete_entropy_gradient(y0, y1)
    if not reads:  # as in M DS alone: the force on the velocities has to be along the constraint, too
        pull = system.reversible(middle, discrete_pull(system, y0, d, blocks), DS)
        by_impulse = [trace.neg(trace.lifted(x)) for x in entries(pull)]
        held = [free[i] + by_impulse[i] for i in range(len(d))]
    else:
        held = [free[i] + _over(by_impulse[i], h) for i in range(len(d))]
    rates = [_over(_difference(x, row), h) for x, row in zip(d, free, strict=True)]
    mu = symbols_like(conditions(system, y0), "mu")
    slopes = entries(discrete_pull(system, y0, d, mu))
    at_once = any(not trace.is_const(a, 0.0) and not trace.is_const(b, 0.0) for a, b in zip(slopes, rates, strict=True))
    if not at_once:
        rates = [trace.lifted(x) for x in entries(system.reversible(middle, system.discrete_gradient(y0, y1), DS))]
    moved = [i for i, slope in enumerate(slopes) if not trace.is_const(slope, 0.0)]
    if any(not trace.is_const(by_impulse[i], 0.0) for i in moved):
        raise TraceError(
            f"{name}: constraints(z) may restrict positions only: what they read must not feel their force."
        )
    others = {x: _difference(x, held[i]) for i, x in enumerate(d) if i not in moved}
    rates = trace.substitute(rates, others)  # by the rows: the multipliers then appear in their own equations
    own = chain_rule.gradient(summed(products(slopes, rates)), entries(*mu))
    own = trace.substitute(own, dict.fromkeys(entries(*mu), const(0.0)))
    if at_once:
        left = entries(*map(_lifted, conditions(system, y0)))
        square = h * h  # is 1/h, but 0 with its slope next to h = 0, where arcs begin
        mend = h * square * trace.reciprocal(square * square + NONE_AT_ZERO)
        own = [x + mend * trace.lifted(g) for x, g in zip(own, left, strict=True)]
    return [*held, *(trace.neg(x) for x in own)], impulses


def _blocks_like(blocks: Sequence[Any], values: Sequence[Symbol]) -> list[Any]:
    like_blocks, at = [], 0
    for block in blocks:
        end = at + len(entries(block))
        like_blocks.append(refilled(block, list(values[at:end])))
        at = end
    return like_blocks


def discrete_pull(system: Any, y0: Any, d: Sequence[Symbol], lam: Sequence[Any]) -> Any:
    """The discrete gradient of lam . g from y0 to y0 + d, a state."""
    at = system.unknowns("x")
    f = paired(lam, conditions(system, at))
    slopes = chain_rule.discrete_gradient(f, entries(at), [*map(trace.lifted, entries(y0))], list(d))
    return system.state(refilled(at, slopes))


def _difference(x: Symbol, row: Symbol) -> Symbol:
    """x - row without terms that cancel."""
    return cancelled(trace.sub(x, row))


def _over(x: Symbol, h: Symbol) -> Symbol:
    """x/h, divided term by term where each term of x has a factor h."""
    quotient = _divided(x, h)
    return trace.mul(x, trace.reciprocal(h)) if quotient is None else quotient


def _divided(x: Symbol, h: Symbol) -> Symbol | None:
    """x without a factor h; None where a term of it has none."""
    if trace.is_const(x, 0.0):
        return x
    if x is h:
        return const(1.0)
    if x.op == "mul":
        for k in (0, 1):
            part = _divided(x.args[k], h)
            if part is not None:
                return trace.mul(part, x.args[1 - k])
        return None
    if x.op in ("add", "sub", "neg", "take", "collect", "total", "part", "join"):
        parts = [_divided(a, h) for a in x.args]
        if any(p is None for p in parts):
            return None
        quotient: Symbol = trace.rebuild(x.op, tuple(parts), x.value)
        return quotient
    return None


# ---- the ODE under the constraints, for solvers of ODEs -------------------------------------------------------------


def velocities(system: Any, z: Any) -> list[Any]:
    """dg/dt at z, in the shapes of g: the constraints' velocity form, which no force of theirs enters."""
    x = system.unknowns("x")
    g = [_lifted(x) for x in conditions(system, x)]
    own = _along(entries(*g), entries(x), entries(system.free_rate(x)))
    here = dict(zip(entries(x), map(trace.lifted, entries(z)), strict=True))
    return _blocks_like(g, trace.substitute(own, here))


def reduced(system: Any, z: Any, dE: Any = None, dS: Any = None, marked: bool = False) -> Any:
    """dz/dt, shape (size,), with the multipliers that keep dg/dt = 0, in symbols: of small systems.

    A lam = b with A = {g, dg/dt} is solved by elimination without pivoting, for -A = G M^-1 G^T is positive definite.
    dE, dS : covectors, shape (size,), in the place of the gradients of energy and entropy. marked : multipliers and
    factors are intermediates whose series are made once; sparse Jacobians would be accumulated through them."""
    x = system.unknowns("x")
    here = dict(zip(entries(x), map(trace.lifted, entries(z)), strict=True))
    covectors = [system.gradient(x), system.entropy_gradient(x)]
    if dE is not None:
        unknown = [system.unknowns(name) for name in ("dE", "dS")]
        here |= dict(zip(entries(*unknown), map(trace.lifted, entries(dE, dS)), strict=True))
        covectors = [system.state(y) for y in unknown]
    dE, dS = covectors
    lam, slopes = _solved(system, x, dE, dS, marked)
    force = [summed(products(lam, column)) for column in zip(*slopes, strict=True)]
    pulled_by = dE + system.state(trace.array(force))
    rates = [trace.lifted(y) for y in system.reversible(x, pulled_by, dS) + system.irreversible(x, pulled_by, dS)]
    return system.state(trace.substitute(rates, here))


def _solved(system: Any, x: Any, dE: Any, dS: Any, marked: bool) -> tuple[list[Symbol], list[list[Symbol]]]:
    """The multipliers, (m,), at a state x of symbols, and the slopes of their constraints, (m, size)."""
    free = entries(system.reversible(x, dE, dS) + system.irreversible(x, dE, dS))
    g = entries(*map(_lifted, conditions(system, x)))
    slopes = [chain_rule.gradient(trace.lifted(f), entries(x)) for f in g]
    speeds = [trace.lifted(w) for w in entries(*velocities(system, x))]
    pulls = [entries(system.reversible(x, system.state(trace.array(s)), dS)) for s in slopes]

    columns = [[trace.neg(w) for w in _along(speeds, entries(x), pull)] for pull in pulls]
    A = [list(row) for row in zip(*columns, strict=True)]
    factors, _ = factorise(A, _is_symmetric(A, [*entries(x), *system.constant_symbols()]), marked)
    return factors.solve(_along(speeds, entries(x), free)), slopes


def _is_symmetric(A: Sequence[Sequence[Symbol]], inputs: Sequence[Symbol]) -> bool:
    """Is A (m, m) symmetric at random numbers? It is in all mechanics, where {{g, g}, E} = 0."""
    rng = np.random.default_rng(0)
    symbols = [x for row in A for x in row]
    for _ in range(SAMPLES):
        sample = {x: const(v) for x, v in zip(inputs, rng.uniform(0.5, 1.5, len(inputs)), strict=True)}
        numbers = [x.value if x.op == "const" else np.nan for x in trace.substitute(symbols, sample)]
        values = np.reshape(numbers, (len(A), -1))
        if not np.abs(values - values.T).max() <= SYMMETRIC * np.abs(values).max():
            return False
    return True


def _along(values: Sequence[Any], x: Sequence[Any], rates: Sequence[Any]) -> list[Symbol]:
    """The rates of these values at the rates of x."""
    return trace.along(list(map(trace.lifted, values)), dict(zip(x, map(trace.lifted, rates), strict=True)))
