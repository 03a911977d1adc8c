"""Makes the package's file of certified references, by tcbench/reference/pendulum_certificates.py.

python benchmarks/stored_references.py FOLDER/references.json        # all scenarios, about 3 minutes
"""

from __future__ import annotations

import json
import platform
import sys
from collections.abc import Mapping, Sequence
from decimal import Decimal, localcontext
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

import tcbench
from tcbench.reference.certified import FORMAT, checksum, scenario_hash
from tcbench.reference.pendulum_certificates import (
    PRECISIONS,
    certified_states,
    digits,
    exact_constants,
    exact_state,
    gaps_of,
    lengths,
    taylor_states,
)

RECIPE = (
    "heyoka Taylor series at 160 and 220 bits from exact decimal data (gap between them = certificate); "
    "cross-checked by 8-stage Gauss collocation in extended precision"
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
    """Certified states of one scenario, as plain JSON data.

    constants : masses (2,), stiffness (2,), natural_lengths (2,), conductivity, reference_temperature,
        coupling, heat_capacity.
    initial : positions (4,), momenta (4,), temperatures (2,).  times : increasing, > 0.

    Per time: `states` (10 strings of 30 digits), `precision_gap` and `cross_gap` (see `certified_states`), `double_gap`
    (what rounding the data to double does), all as max_i |difference_i| / max(1, |z_i|); and `energy_error`, |E - E0|
    at 80 digits, which no run was told to keep.
    """
    labels = [str(Decimal(repr(t))) if isinstance(t, float) else str(t) for t in times]
    labels = [t[:-2] if t.endswith(".0") else t for t in labels]
    states, precision_gap, cross_gap = certified_states(constants, initial, labels)
    rounded = taylor_states(constants, initial, labels, PRECISIONS[0], rounded=True)
    z0 = exact_state(constants, initial)
    start = exact_invariants(constants, z0)
    drift = [abs(exact_invariants(constants, z)["E"] - start["E"]) for z in states]
    return {
        "hash": scenario_hash(constants, initial),
        "constants": {k: np.asarray(v).tolist() for k, v in constants.items()},
        "initial": {k: np.asarray(v).tolist() for k, v in initial.items()},
        "E0": digits(start["E"]),
        "S0": digits(start["S"]),
        "J0": digits(start["J"]),
        "s0": [digits(x) for x in z0[8:]],
        "times": labels,
        "states": [[digits(x) for x in z] for z in states],
        "precision_gap": precision_gap,
        "cross_gap": cross_gap,
        "double_gap": gaps_of(rounded, states),
        "energy_error": [f"{x:.2e}" for x in drift],
        "precisions_bits": list(PRECISIONS),
    }


def scenarios() -> dict[str, tuple[Mapping[str, Any], Mapping[str, Any], Sequence[str | float]]]:
    """Name -> constants, initial data, times; Romero (2009), section 6, and variations."""
    known = {name: tcbench.scenarios()[name] for name in TIMES}
    return {name: (dict(s.constants), {k: getattr(s, k) for k in s.model.initial_data}, TIMES[name])
            for name, s in known.items()}  # fmt: skip


def generate(path: Path | str, of: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Certify every scenario (name -> constants, initial data, times; those of the paper) and write the file."""
    data = {
        "format": FORMAT,
        "recipe": RECIPE,
        "gap": "max_i |a_i - b_i| / max(1, |b_i|)",
        "state": "q1x q1y q2x q2y p1x p1y p2x p2y s_a s_b",
        "versions": {
            "python": platform.python_version(),
            **{name: version(name) for name in ("heyoka", "numpy", "scipy")},
            "machine": platform.machine(),
        },
        "scenarios": {name: certify(*spec) for name, spec in (of or scenarios()).items()},
    }
    Path(path).write_text(json.dumps(data | {"sha256": checksum(data)}, indent=1) + "\n", encoding="utf-8")
    return data


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("Usage: python benchmarks/stored_references.py FOLDER/references.json")
    for label, made in generate(sys.argv[1])["scenarios"].items():
        for row in zip(made["times"], made["precision_gap"], made["cross_gap"], made["double_gap"], strict=True):
            gaps = f"precisions {row[1]}   cross-check {row[2]}   double data {row[3]}"
            print(f"{label:22s} t = {row[0]:>5s}   {gaps}")
