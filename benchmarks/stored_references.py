"""Certified reference solutions of the double thermoelastic pendulum: makes the package's file of them, or checks it.

python benchmarks/stored_references.py FOLDER/references.json        # all scenarios, about 3 minutes
python benchmarks/stored_references.py short_term cold_spring        # do the stored digits come out again?

A certificate is the gap between Taylor series at two working precisions (heyoka, 160 and 220 bits, each run
to its own round-off). tcbench's own series in double-doubles, of the equations that it traces from the formulas of the
system, check both from the data as doubles. (The file
that ships was checked by Gauss collocation in 64-bit arithmetic.)

Data are taken as exact decimals: 2.2 is 22/10, not the double nearest to it, and initial entropies follow
from the printed temperatures in 80 digits. A double-precision run starts from rounded numbers and so ends
elsewhere; `double_gap` is that distance, measured by repeating the integration from the rounded data:
2e-16 to 1e-14, but 2e-13 for bound_equilibrium at t = 1500 and 9e-11 for cold_spring at t = 25. It, not the
certificate, limits what such a run can show.
"""

from __future__ import annotations

import json
import platform
import sys
from collections.abc import Mapping, Sequence
from decimal import Decimal, localcontext
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

import tcbench
from tcbench.reference import pairs
from tcbench.reference.certified import FORMAT, checksum, scenario_hash, stored_file
from tcbench.systems.pendulum import Pendulum

RECIPE = (
    "heyoka Taylor series at 160 and 220 bits from exact decimal data (gap between them = certificate); "
    "cross-checked by Taylor series in double-doubles of the traced equations"
)
TIMES = {  # at which states are certified
    "short_term": ("1", "5", "25"),
    "long_term": ("1", "25", "500"),
    "relative_equilibrium": ("1", "25", "500", "1500"),
    "bound_equilibrium": ("1", "10", "50", "1500"),
    "stiff_spring": ("1", "5", "25"),
    "cold_spring": ("1", "5", "25"),
    "fast_conduction": ("1", "5", "25"),
}
PRECISIONS = (160, 220)
DIGITS = 30  # stored: certificates are about 1e-44, thirty digits are enough for extended precision


class PeerMissing(ImportError):
    """heyoka is not installed."""


def _heyoka() -> Any:
    try:
        import heyoka
    except ImportError as missing:
        raise PeerMissing(
            'Certifying a reference needs heyoka: pip install "tcbench[peers]" (Linux only).'
        ) from missing
    return heyoka


# ---- exact data


def _decimal(x: Any, rounded: bool) -> Decimal:
    """The decimal a user wrote (shortest one that gives this double), or the double's own exact value."""
    return Decimal(float(x)) if rounded else Decimal(repr(float(x)))


def exact_constants(constants: Mapping[str, Any], rounded: bool = False) -> dict[str, list[Decimal]]:
    """Constants as decimals, each a list (one or two values)."""
    return {k: [_decimal(x, rounded) for x in np.ravel(v)] for k, v in constants.items()}


def exact_state(constants: Mapping[str, Any], initial: Mapping[str, Any], rounded: bool = False) -> list[Decimal]:
    """Initial state (q, p, s), 10 decimals of 80 digits, with s = beta L + c0 ln(theta/theta_ref), Romero (2009), (43);
    with `rounded` that at which a run in doubles really starts, whose entropies lose a few units of 5e-16."""
    with localcontext(prec=80):
        c = exact_constants(constants, rounded)
        q, p, theta = ([_decimal(x, rounded) for x in initial[k]] for k in ("positions", "momenta", "temperatures"))
        (beta,), (c0,), (reference,) = c["coupling"], c["heat_capacity"], c["reference_temperature"]
        if rounded:
            s = Pendulum(**constants).entropies(np.array(initial["positions"]), np.array(initial["temperatures"]))
            return q + p + [Decimal(float(x)) for x in s]
        parts = zip(lengths(q), c["natural_lengths"], theta, strict=True)
        return q + p + [beta * (length / rest).ln() + c0 * (T / reference).ln() for length, rest, T in parts]


def lengths(q: Sequence[Decimal]) -> list[Decimal]:
    return [(q[0] ** 2 + q[1] ** 2).sqrt(), ((q[2] - q[0]) ** 2 + (q[3] - q[1]) ** 2).sqrt()]


# ---- two unrelated integrations


@lru_cache(maxsize=4)
def _taylor(bits: int) -> Any:
    """heyoka integrator at `bits` of precision; constants are run-time parameters, so it compiles once."""
    hy = _heyoka()
    v = hy.make_vars("x1", "y1", "x2", "y2", "u1", "v1", "u2", "v2", "sa", "sb")
    x1, y1, x2, y2, u1, v1, u2, v2, sa, sb = v
    m1, m2, Ca, Cb, lna, lnb, kappa, ref, beta, c0 = (hy.par[i] for i in range(10))
    dx, dy = x2 - x1, y2 - y1
    pa, pb = x1 * x1 + y1 * y1, dx * dx + dy * dy
    La, Lb = hy.log(pa) / 2 - lna, hy.log(pb) / 2 - lnb
    Ta, Tb = ref * hy.exp((sa - beta * La) / c0), ref * hy.exp((sb - beta * Lb) / c0)
    fa, fb = (Ca * La - beta * (Ta - ref)) / pa, (Cb * Lb - beta * (Tb - ref)) / pb  # force / length
    dz = [u1 / m1, v1 / m1, u2 / m2, v2 / m2]
    dz += [fb * dx - fa * x1, fb * dy - fa * y1, -fb * dx, -fb * dy]
    dz += [kappa * (Tb - Ta) / Ta, kappa * (Ta - Tb) / Tb]  # (22)
    one = [hy.real(1, bits)] * 10
    return hy.taylor_adaptive(list(zip(v, dz, strict=True)), one, pars=one, fp_type=hy.real, prec=bits)


def taylor_states(
    constants: Mapping[str, Any], initial: Mapping[str, Any], times: Sequence[str], bits: int, rounded: bool = False
) -> list[list[Decimal]]:
    """States at `times` (decimal strings, increasing) by Taylor series at `bits` of precision."""
    hy, ta = _heyoka(), _taylor(bits)
    with localcontext(prec=80):
        c = exact_constants(constants, rounded)
        pars = c["masses"] + c["stiffness"] + [x.ln() for x in c["natural_lengths"]]
        pars += c["conductivity"] + c["reference_temperature"] + c["coupling"] + c["heat_capacity"]
    for i, (zi, par) in enumerate(zip(exact_state(constants, initial, rounded), pars, strict=True)):
        ta.state[i], ta.pars[i] = hy.real(str(zi), bits), hy.real(str(par), bits)
    ta.time = hy.real(0, bits)
    states = []
    for t in times:
        outcome = ta.propagate_until(hy.real(t, bits))[0]
        if outcome != hy.taylor_outcome.time_limit:
            raise ArithmeticError(f"The Taylor integration at {bits} bits stopped before t = {t}: {outcome}.")
        states.append([Decimal(str(x)) for x in ta.state])
    return states


def series_states(
    constants: Mapping[str, Any], initial: Mapping[str, Any], times: Sequence[str]
) -> list[list[Decimal]]:
    """States at `times` from the data as doubles, by tcbench's own series in double-doubles of the traced equations."""
    model = Pendulum(**constants)
    z0 = np.array([float(x) for x in exact_state(constants, initial, rounded=True)])
    (pair,) = pairs.solve([model], [z0], [float(t) for t in times])
    if pair is None:
        raise ArithmeticError("The series in double-doubles did not arrive.")
    with localcontext(prec=80):
        return [[Decimal(float(h)) + Decimal(float(l)) for h, l in zip(*row, strict=True)]
                for row in zip(pair.states, pair.low, strict=True)]  # fmt: skip


def _gap(a: Sequence[Decimal], b: Sequence[Decimal]) -> str:
    """max_i |a_i - b_i| / max(1, |b_i|) as a short decimal string."""
    with localcontext(prec=80):
        return f"{max(abs(x - y) / max(Decimal(1), abs(y)) for x, y in zip(a, b, strict=True)):.2e}"


def gaps_of(some: Sequence[Sequence[Decimal]], others: Sequence[Sequence[Decimal]]) -> list[str]:
    """Of states at several times."""
    return [_gap(a, b) for a, b in zip(some, others, strict=True)]


def digits(x: Decimal) -> str:
    """A number as it is stored."""
    with localcontext(prec=DIGITS):
        return str(+x)


def certified_states(
    constants: Mapping[str, Any], initial: Mapping[str, Any], times: Sequence[str]
) -> tuple[list[list[Decimal]], list[str], list[str]]:
    """States at these times (decimal strings, increasing, > 0), by the higher precision; their certificate, which is
    the gap of the two; and the gap to tcbench's own series, of both from the data as doubles. PeerMissing without
    heyoka."""
    low, high = (taylor_states(constants, initial, times, bits) for bits in PRECISIONS)
    rounded = taylor_states(constants, initial, times, PRECISIONS[0], rounded=True)
    return high, gaps_of(low, high), gaps_of(series_states(constants, initial, times), rounded)


# ---- the file


def compare(name: str, record: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Recompute the stored scenario `name`: its `stored_gap` to the digits that are stored, one a time (at most 1e-29
    where nothing changed), `precision_gap`, `cross_gap`, and whether it `agrees` (1e-20)."""
    old = record or stored_file()["scenarios"][name]
    states, precision_gap, cross_gap = certified_states(old["constants"], old["initial"], old["times"])
    told = [[Decimal(digits(x)) for x in z] for z in states]
    gaps = [float(x) for x in gaps_of([[Decimal(x) for x in z] for z in old["states"]], told)]
    found = {"times": old["times"], "stored_gap": gaps, "precision_gap": precision_gap, "cross_gap": cross_gap}
    return found | {"agrees": all(x <= 1e-20 for x in gaps)}


def exact_invariants(constants: Mapping[str, Any], z: Sequence[Decimal]) -> dict[str, Decimal]:
    """E, S, J and the temperatures of a state, in 80 digits, without heyoka or numpy."""
    with localcontext(prec=80):
        c = exact_constants(constants)
        (beta,), (c0,), (reference,) = c["coupling"], c["heat_capacity"], c["reference_temperature"]
        q, p, s = list(z[:4]), list(z[4:8]), list(z[8:])
        energy = (p[0] ** 2 + p[1] ** 2) / (2 * c["masses"][0]) + (p[2] ** 2 + p[3] ** 2) / (2 * c["masses"][1])
        theta = []
        for i, length in enumerate(lengths(q)):
            strain = (length / c["natural_lengths"][i]).ln()
            theta.append(reference * ((s[i] - beta * strain) / c0).exp())
            energy += c["stiffness"][i] / 2 * strain**2 + beta * reference * strain + c0 * (theta[i] - reference)
        J = q[0] * p[1] - q[1] * p[0] + q[2] * p[3] - q[3] * p[2]
        return {"E": energy, "S": s[0] + s[1], "J": J, "theta_a": theta[0], "theta_b": theta[1]}


def certify(constants: Mapping[str, Any], initial: Mapping[str, Any], times: Sequence[str | float]) -> dict[str, Any]:
    """Certified states of one scenario (constants and initial data by name, times increasing, > 0) as JSON values.

    Per time: `states` (10 strings of 30 digits), `precision_gap` and `cross_gap` (see `certified_states`), `double_gap`
    (what rounding the data to double does), all as max_i |difference_i| / max(1, |z_i|); and `energy_error`, |E - E0|
    at 80 digits, which no run was told to keep.
    """
    labels = [str(Decimal(repr(t))).removesuffix(".0") if isinstance(t, float) else str(t) for t in times]
    states, precision_gap, cross_gap = certified_states(constants, initial, labels)
    rounded = taylor_states(constants, initial, labels, PRECISIONS[0], rounded=True)
    z0 = exact_state(constants, initial)
    start = exact_invariants(constants, z0)
    drift = [abs(exact_invariants(constants, z)["E"] - start["E"]) for z in states]
    given = {"constants": constants, "initial": initial}
    return {
        "hash": scenario_hash(constants, initial),
        **{name: {k: np.asarray(v).tolist() for k, v in of.items()} for name, of in given.items()},
        **{f"{law}0": digits(start[law]) for law in "ESJ"}, "s0": [digits(x) for x in z0[8:]], "times": labels,
        "states": [[digits(x) for x in z] for z in states], "precision_gap": precision_gap, "cross_gap": cross_gap,
        "double_gap": gaps_of(rounded, states), "energy_error": [f"{x:.2e}" for x in drift],
        "precisions_bits": list(PRECISIONS),
    }  # fmt: skip


def scenarios() -> dict[str, tuple[Mapping[str, Any], Mapping[str, Any], Sequence[str | float]]]:
    """Name -> constants, initial data, times; Romero (2009), section 6, and variations."""
    known = {name: tcbench.scenarios()[name] for name in TIMES}
    return {name: (dict(s.constants), {k: getattr(s, k) for k in s.model.initial_data}, TIMES[name])
            for name, s in known.items()}  # fmt: skip


def generate(path: Path | str, of: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Certify every scenario (name -> constants, initial data, times; those of the paper) and write the file."""
    versions = {name: version(name) for name in ("heyoka", "numpy", "scipy")}
    data = {
        "format": FORMAT, "recipe": RECIPE, "gap": "max_i |a_i - b_i| / max(1, |b_i|)",
        "state": "q1x q1y q2x q2y p1x p1y p2x p2y s_a s_b",
        "versions": {"python": platform.python_version(), **versions, "machine": platform.machine()},
        "scenarios": {name: certify(*spec) for name, spec in (of or scenarios()).items()},
    }  # fmt: skip
    Path(path).write_text(json.dumps(data | {"sha256": checksum(data)}, indent=1) + "\n", encoding="utf-8")
    return data


if __name__ == "__main__":
    for word in sys.argv[1:]:
        print(word, "written" if word.endswith(".json") and generate(word) else compare(word))
