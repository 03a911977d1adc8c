"""Conditions (8) and (9) of any system, on random states and covectors, which every method relies on.

Methods put covectors of their own in the place of grad E and grad S: sum_b F_b grad y_b, with the y that are at most
quadratic in z and slopes F_b that differ from the true ones. Discrete gradients do so, and the random covectors here.
In the place of grad E there may be any other: Gonzalez's gradient adds a multiple of z1 - z0 to all of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..compiler import derivatives as trace
from ..compiler.kernels import Kernel, kernel, placed
from ..systems.as_written import place
from ..systems.declaration import MATRICES
from ..systems.element_system import ElementSystem
from ..systems.system import System

FORMULAS = tuple(MATRICES)
SPREAD = 2.0  # random covectors are the gradients times factors from 1/2 to 2
ROUNDOFF = 1e-13  # of sums of some ten terms of one size
OF_DIFFERENCES = 1e-7  # relative error of a rate that central differences measure
CANCELLED = 1e-11  # round-off of a rate whose terms nearly cancel: (dE . dE) dS - (dE . dS) dE where dE is along dS
Row = Callable[[str, str, str, float, float, str], Any]


def findings(row: Row, model: System, sample: Any, rng: np.random.Generator) -> Iterator[Any]:
    """The findings on a sample of pairs of states (n,)."""
    put_in, count = _random_covectors(model)
    free = _free_covectors(model, sample, rng)
    owed = [_Condition(claim, source, formula, covector) for claim, source, formula, covector in CONDITIONS]
    lost = dict.fromkeys(model.invariant_names, 0.0)
    gap, n = 0.0, model.size
    for (z0, z1), freely in zip(sample, free, strict=True):
        dE, dS = (np.asarray(g) for g in model.discrete_gradients(z0, z1))
        mid = np.asarray(z0 + z1) / 2
        factors = SPREAD ** rng.uniform(-1, 1, count)
        outputs = put_in(np.concatenate([np.asarray(z0), factors]), model.constant_values)
        true = np.asarray(model.entropy_gradient(z0))
        cases = (
            (mid, dE, dS, *rates_of(model, mid, dE, dS)),
            (z0, *np.split(outputs[: 4 * n], 4)),
            (z0, freely, true, *rates_of(model, z0, freely, true)),
        )
        for case in cases:
            warm = _is_warm(model, *case[:3])
            for one in owed:
                if warm or not one.rises:
                    one.see(*case)
        for i, name in enumerate(lost):
            slope = outputs[(4 + i) * n : (5 + i) * n]
            lost[name] = max(lost[name], *(relative(slope, rate) for rate in np.split(outputs[2 * n : 4 * n], 2)))
        scale = np.linalg.norm(dS) * np.linalg.norm(z1 - z0) + abs(float(model.entropy(z0))) + 1e-300
        gap = max(gap, abs(dS @ np.asarray(z1 - z0) - (model.entropy(z1) - model.entropy(z0))) / scale)
    for one in owed:
        yield row(f"{one.claim}: {one.needs}", one.source, f"{one.measured} 0, relative", one.worst, CANCELLED,
                  f"{written(model, one.formula)}: {one.why(model)}")  # fmt: skip
    yield row("the discrete gradient of S is directional: DS . (z1 - z0) = S(z1) - S(z0)", "eq. (8)",
              "defect 0, relative", gap, ROUNDOFF,
              f"{written(model, 'entropy')}: a sum whose terms cancel loses its digits.")  # fmt: skip
    yield from _of_matrices(row, model, sample)
    for name, worst in lost.items():
        least = ROUNDOFF
        if worst > ROUNDOFF and (rate := _rate_of(model, name, sample)) <= OF_DIFFERENCES:
            worst, least = rate, OF_DIFFERENCES  # the equations keep it; steps may not, which `check` tries
        yield row(f"{name.replace('_', ' ')} is invariant", "section 3", "rate 0, relative", worst, least,
                  f"{written(model, 'invariants')}: neither reversible nor irreversible may change it.")  # fmt: skip


def _rate_of(model: System, name: str, sample: Any) -> float:
    """The relative rate of an invariant by the equations, both parts together, by central differences."""
    k, worst = model.invariant_names.index(name), 0.0
    rate = model.free_rate if model.multipliers else model.vector_field  # constraints have checks of their own
    for z, _ in sample[:20]:
        z = np.asarray(z)
        step = 1e-5 * (np.abs(z) + 1e-2)
        up, down = (np.asarray(model.momenta(z + sign * np.diag(step)))[:, k] for sign in (1, -1))
        worst = max(worst, relative((up - down) / (2 * step), np.asarray(rate(z))))
    return worst


@dataclass(eq=False)
class _Condition:
    """One of the four conditions on covector . rate, and its largest violation."""

    claim: str
    source: str
    formula: str
    covector: str
    worst: float = 0.0
    terms: Any = None
    state: Any = None
    seen: int = 0
    fallen: int = 0

    @property
    def rises(self) -> bool:
        """Is it the inequality among the four?"""
        return self.claim.endswith("entropy") and self.formula == "irreversible"

    @property
    def needs(self) -> str:
        return f"{self.covector} . {self.formula}(z, dE, dS) {'>=' if self.rises else '='} 0"

    @property
    def measured(self) -> str:
        return "violation" if self.rises else "defect"

    def see(self, z: Any, dE: Any, dS: Any, reversible: Any, irreversible: Any) -> None:
        covector = dE if self.covector == "dE" else dS
        rate = reversible if self.formula == "reversible" else irreversible
        defect = relative(covector, rate)
        if self.rises:
            size = float(np.linalg.norm(covector) * np.linalg.norm(rate)) + 1e-300
            defect = max(0.0, -float(covector @ rate) / size)
        self.seen, self.fallen = self.seen + 1, self.fallen + (defect > CANCELLED)
        if defect > self.worst or math.isnan(defect):
            self.worst, self.terms, self.state = defect, covector * rate, z

    def why(self, model: System) -> str:
        """A sentence: which terms do not cancel, or that a sign is wrong."""
        rule = "it must hold for the covectors that are put in, whatever they are, not for the true gradients only."
        if self.worst <= CANCELLED:
            return rule
        if self.rises and self.fallen == self.seen:
            return f"the entropy falls everywhere: is a sign wrong? {rule[0].upper()}{rule[1:]}"
        parts = {name: float(self.terms[a:b].sum()) for name, (a, b, _) in model.layout.items()}
        shown = " + ".join(f"({value:.3g} of {name})" for name, value in parts.items() if value)
        return f"{rule} At worst {self.covector} . rate = {shown}, at {state_in_words(model, self.state)}."


CONDITIONS: tuple[tuple[str, str, str, str], ...] = (  # claim, source, formula of the rate, covector
    ("reversible keeps energy", "eqs. (1), (9)", "reversible", "dE"),
    ("reversible keeps entropy", "eq. (9)", "reversible", "dS"),
    ("irreversible keeps energy", "eq. (9)", "irreversible", "dE"),
    ("irreversible never lowers entropy", "eqs. (1), (37)", "irreversible", "dS"),
)


def rates_of(model: System, z: Any, dE: Any, dS: Any) -> tuple[Any, Any]:
    """The reversible and the irreversible rate, (n,) each, of these covectors."""
    return np.asarray(model.reversible(z, dE, dS)), np.asarray(model.irreversible(z, dE, dS))


def _of_matrices(row: Row, model: System, sample: Any) -> Iterator[Any]:
    """The conditions on L and M at the true gradients. They are projected: a wrong one keeps both laws and is another
    system."""
    for name, claim, other, sign, needs in (
        ("reversible", "L is skew", "S", -1.0, "L = -L^T"), ("irreversible", "M is symmetric", "E", 1.0, "M = M^T")
    ):  # fmt: skip
        if not model.defines(MATRICES[name]):
            continue
        value = _matrix_of(model, MATRICES[name])
        turned, kept, least = 0.0, 0.0, 0.0
        for z, _ in sample:
            A = value(np.asarray(z), model.constant_values).reshape(model.size, model.size)
            g = np.asarray(model.entropy_gradient(z) if other == "S" else model.gradient(z))
            size = np.abs(A).max() + 1e-300
            turned = max(turned, float(np.abs(A - sign * A.T).max() / size))
            kept = max(kept, float((np.abs(A @ g) / (np.abs(A) @ np.abs(g) + 1e-300)).max()))
            least = max(least, -float(np.linalg.eigvalsh((A + A.T) / 2).min() / size))
        where = written(model, MATRICES[name])
        yield row(f"{claim}: {needs}", "eq. (1)", "defect 0, relative", turned, ROUNDOFF, f"{where}.")
        yield row(f"{claim[0]} grad {other} = 0: at the true gradients", "eq. (2)", "defect 0, relative", kept,
                  ROUNDOFF, f"{where}: a row of the matrix times grad {other} vanishes.")  # fmt: skip
        if sign > 0:
            yield row("M is positive: no eigenvalue below 0", "eq. (1)", "violation 0, relative", least,
                      ROUNDOFF, f"{where}: B B^T with columns B is.")  # fmt: skip


def _matrix_of(model: System, name: str) -> Kernel:
    """The kernel z -> matrix of an author's poisson or friction."""
    sym = model.symbolic
    with trace.tracing():
        z = trace.variables("z", model.size)
        outputs = [trace.lifted(x) for x in np.ravel(np.asarray(getattr(sym, name)(z), dtype=object))]
        return kernel(placed("a", z) | sym.constant_symbols(), outputs)


def _is_warm(model: System, z: Any, dE: Any, dS: Any) -> bool:
    """Are the temperatures of these covectors positive? Entropy grows only then."""
    if not model.defines("temperature"):
        return True
    return bool(np.min(np.asarray(model.temperature(*map(model.state, (z, dE, dS))), dtype=float)) > 0)


def relative(covector: Any, rate: Any) -> float:
    """|covector . rate| over the sum of the sizes of its terms."""
    return float(abs(covector @ rate) / (np.abs(covector) @ np.abs(rate) + 1e-300))


def _free_covectors(model: System, sample: Any, rng: np.random.Generator) -> Any:
    """A covector in the place of grad E for each pair of states: a random number of the size of grad E where grad S is
    always 0, elsewhere a positive multiple; entries that are constant in grad E stay, as in every method."""
    slopes = np.array([np.asarray(model.gradient(z)) for z, _ in sample])
    others = np.array([np.asarray(model.entropy_gradient(z)) for z, _ in sample])
    positive = slopes * SPREAD ** rng.uniform(-1, 1, slopes.shape)
    sizes = np.abs(slopes).max(axis=0)
    anything = np.where(sizes > 0, sizes, 1.0) * rng.standard_normal(slopes.shape)
    return np.where(constant(slopes), slopes, np.where((others == 0).all(axis=0), anything, positive))


def constant(slopes: Any) -> Any:
    """Which entries of a gradient are the same at all states, shape (states, entries)."""
    return (slopes == slopes[0]).all(axis=0)


def _random_covectors(model: System) -> tuple[Kernel, int]:
    """(z, factors) -> dE, dS with the factors on their slopes, the two rates there, the gradients of the invariants.

    And how many factors there are.
    """
    sym = model.symbolic
    with trace.tracing():
        z = trace.variables("z", model.size)
        factors: list[trace.Symbol] = []
        covectors = []
        for name in ("energy", "entropy"):
            cut = sym.cut(name)
            slopes = cut.outer_slopes(cut.values(list(z)))
            for i, slope in enumerate(slopes):
                if slope.op != "const":  # no method changes a constant slope
                    factors.append(trace.variable("factor"))
                    slopes[i] = slope * factors[-1]
            covectors.append(sym.state(trace.array(cut.joined(slopes, list(z)))))
        rates = [getattr(sym, name)(z, *covectors) for name in FORMULAS]
        outputs = [trace.lifted(x) for part in (*covectors, *rates) for x in part]
        outputs += [x for line in trace.jacobian(list(sym.momenta(z)), list(z)) for x in line]
        return kernel(placed("a", [*z, *factors]) | sym.constant_symbols(), outputs), len(factors)


def state_in_words(model: System, z: Any) -> str:
    """The first numbers of a state in words."""
    names = model.component_names
    shown = [f"{name} = {value:.4g}" for name, value in zip(names[:6], np.asarray(z), strict=False)]
    return ", ".join(shown) + ", ..." * (len(names) > 6)


OF_ELEMENTS = {"reversible": "element_energy", "irreversible": "conduction", "entropy": "entropies"}


def written(model: System, name: str) -> str:
    """File and line of a formula, of the matrix in its place, or of the formula that it follows from."""
    name = MATRICES[name] if name in MATRICES and model.defines(MATRICES[name]) else name
    name = OF_ELEMENTS.get(name, name) if isinstance(model, ElementSystem) else name
    return f"{place(getattr(type(model), name))}, {name}()"
