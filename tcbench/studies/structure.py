"""Conditions (8) and (9) of any system, on random states and covectors: what its formulas owe to every method.

A method puts covectors of its own in the place of grad E and grad S: sum_b F_b grad y_b, with the y that are at most
quadratic in z and slopes F_b that differ from the true ones. So do the discrete gradients, and so the random ones here.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..compiler import derivatives as trace
from ..compiler.kernels import Kernel, kernel

if TYPE_CHECKING:
    from ..systems.system import System

FORMULAS = ("reversible", "irreversible")
SPREAD = 2.0  # random slopes are the true ones, times a number from 1/2 to 2
ROUNDOFF = 1e-13  # of sums of some ten terms of one size
Row = Callable[[str, str, str, float, float, str], Any]


def findings(row: Row, model: System, sample: Any, rng: np.random.Generator) -> list[Any]:
    """The findings on a sample of pairs of states."""
    put_in, count = _random_covectors(model)
    worst = np.zeros(4)
    lost = dict.fromkeys(model.invariant_names, 0.0)
    gap, n = 0.0, model.size
    for z0, z1 in sample:
        dE, dS = (np.asarray(g) for g in model.discrete_gradients(z0, z1))
        mid = np.asarray(z0 + z1) / 2
        rates = [np.asarray(getattr(model, name)(mid, dE, dS)) for name in FORMULAS]
        factors = SPREAD ** rng.uniform(-1, 1, count)
        found = put_in(np.concatenate([np.asarray(z0), factors]), model.constant_values)
        worst = np.maximum(worst, np.maximum(_defects(dE, dS, *rates), _defects(*np.split(found[: 4 * n], 4))))
        for i, name in enumerate(lost):
            slope = found[(4 + i) * n : (5 + i) * n]
            lost[name] = max(lost[name], *(_relative(slope, rate) for rate in np.split(found[2 * n : 4 * n], 2)))
        scale = np.linalg.norm(dS) * np.linalg.norm(z1 - z0) + abs(float(model.entropy(z0))) + 1e-300
        gap = max(gap, abs(dS @ np.asarray(z1 - z0) - (model.entropy(z1) - model.entropy(z0))) / scale)
    lines = {name: _line(model, name) for name in (*FORMULAS, "entropy", "invariants")}
    why = "{}: it must hold for the covectors that are put in, whatever they are, not for the true gradients only."
    of = {name: why.format(lines[name]) for name in FORMULAS}
    rows = [
        row("reversible keeps energy: dE . reversible(z, dE, dS) = 0", "eqs. (1), (9)", "defect 0, relative", worst[0],
            ROUNDOFF, of["reversible"]),
        row("reversible keeps entropy: dS . reversible(z, dE, dS) = 0", "eq. (9)", "defect 0, relative", worst[1],
            ROUNDOFF, of["reversible"]),
        row("irreversible keeps energy: dE . irreversible(z, dE, dS) = 0", "eq. (9)", "defect 0, relative", worst[2],
            ROUNDOFF, of["irreversible"]),
        row("irreversible never lowers entropy: dS . irreversible(z, dE, dS) >= 0", "eq. (1)", "violation 0, relative",
            worst[3], ROUNDOFF, of["irreversible"]),
        row("the discrete gradient of S is directional: DS . (z1 - z0) = S(z1) - S(z0)", "eq. (8)",
            "defect 0, relative", gap, ROUNDOFF, f"{lines['entropy']}: a sum whose terms cancel loses its digits."),
    ]  # fmt: skip
    return rows + [
        row(f"{name.replace('_', ' ')} is invariant", "section 3", "rate 0, relative", worst, ROUNDOFF,
            f"{lines['invariants']}: neither reversible nor irreversible may change it.")
        for name, worst in lost.items()
    ]  # fmt: skip


def _defects(dE: Any, dS: Any, rev: Any, irr: Any) -> Any:
    """Of the four conditions, relative."""
    size = np.linalg.norm(dS) * np.linalg.norm(irr) + 1e-300
    return _relative(dE, rev), _relative(dS, rev), _relative(dE, irr), max(0.0, -float(dS @ irr) / size)


def _relative(covector: Any, rate: Any) -> float:
    """|covector . rate| over the sum of the sizes of its terms."""
    return float(abs(covector @ rate) / (np.abs(covector) @ np.abs(rate) + 1e-300))


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
                if slope.op != "const":  # one that is constant no method changes
                    factors.append(trace.variable("factor"))
                    slopes[i] = slope * factors[-1]
            covectors.append(sym.state(trace.array(cut.joined(slopes, cut.gradients(list(z))))))
        rates = [getattr(sym, name)(z, *covectors) for name in FORMULAS]
        outputs = [trace.lifted(x) for part in (*covectors, *rates) for x in part]
        outputs += [x for line in trace.jacobian(list(sym.momenta(z)), list(z)) for x in line]
        inputs = {x: f"a[{i}]" for i, x in enumerate([*z, *factors])} | sym.constant_symbols()
        return kernel(inputs, outputs), len(factors)


def _line(model: System, name: str) -> str:
    """Where the author wrote a formula."""
    formula: Any = getattr(type(model), name)
    while hasattr(formula, "__wrapped__"):
        formula = formula.__wrapped__
    return f"{Path(formula.__code__.co_filename).name}, line {formula.__code__.co_firstlineno}, {name}()"
