"""Conditions (8) and (9) of any system, on random states and covectors: what its formulas owe to every method.

A method puts covectors of its own in the place of grad E and grad S: sum_b F_b grad y_b, with the y that are at most
quadratic in z and slopes F_b that differ from the true ones. So do the discrete gradients, and so the random ones here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ..compiler import derivatives as trace
from ..compiler.kernels import Kernel, kernel
from ..systems.as_written import place
from ..systems.declaration import MATRICES

if TYPE_CHECKING:
    from ..systems.system import System

FORMULAS = tuple(MATRICES)
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
    written = {name: matrix if model.defines(matrix) else name for name, matrix in MATRICES.items()}
    lines = {name: _line(model, written.get(name, name)) for name in (*FORMULAS, "entropy", "invariants")}
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
    rows += _of_matrices(row, model, sample)
    return rows + [
        row(f"{name.replace('_', ' ')} is invariant", "section 3", "rate 0, relative", worst, ROUNDOFF,
            f"{lines['invariants']}: neither reversible nor irreversible may change it.")
        for name, worst in lost.items()
    ]  # fmt: skip


def _of_matrices(row: Row, model: System, sample: Any) -> list[Any]:
    """What L and M owe at the true gradients. They are projected, so that what is wrong here keeps both laws and is
    another system."""
    rows = []
    for name, told, other, sign, needs in (
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
        where = _line(model, MATRICES[name])
        rows.append(row(f"{told}: {needs}", "eq. (1)", "defect 0, relative", turned, ROUNDOFF, f"{where}."))
        rows.append(
            row(f"{told[0]} grad {other} = 0: at the true gradients", "eq. (2)", "defect 0, relative", kept,
                ROUNDOFF, f"{where}: a row of the matrix times grad {other} vanishes.")
        )  # fmt: skip
        if sign > 0:
            rows.append(row("M is positive: no eigenvalue below 0", "eq. (1)", "violation 0, relative", least,
                            ROUNDOFF, f"{where}: B B^T with columns B is."))  # fmt: skip
    return rows


def _matrix_of(model: System, name: str) -> Kernel:
    """z -> the matrix that an author wrote."""
    sym = model.symbolic
    with trace.tracing():
        z = trace.variables("z", model.size)
        outputs = [trace.lifted(x) for x in np.ravel(np.asarray(getattr(sym, name)(z), dtype=object))]
        return kernel({x: f"a[{i}]" for i, x in enumerate(z)} | sym.constant_symbols(), outputs)


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
            covectors.append(sym.state(trace.array(cut.joined(slopes, list(z)))))
        rates = [getattr(sym, name)(z, *covectors) for name in FORMULAS]
        outputs = [trace.lifted(x) for part in (*covectors, *rates) for x in part]
        outputs += [x for line in trace.jacobian(list(sym.momenta(z)), list(z)) for x in line]
        inputs = {x: f"a[{i}]" for i, x in enumerate([*z, *factors])} | sym.constant_symbols()
        return kernel(inputs, outputs), len(factors)


def _line(model: System, name: str) -> str:
    """Where the author wrote a formula."""
    return f"{place(getattr(type(model), name))}, {name}()"
