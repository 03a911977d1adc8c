"""Reference solutions with a certificate: read from the package, or computed on the fly (`pairs`, `compute`).

Every gap in this file is measured as max_i |a_i - b_i| / max(magnitude_i, |b_i|) over the components of a state;
magnitudes are 1, but for what units make small or large (`System.magnitudes`).

A reference answers two different questions, and keeps the answers apart:

- `certificate`: how far the reference may be from the exact solution of the exact (decimal) data;
- `floor`: how far *any* double-precision run may be from it before it has taken a step, because 0.1 and 2.2
  and the initial entropies are rounded to double when it starts. An error near this floor says nothing about
  a method.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib.resources import files
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import cache
from ..errors import TcbenchError
from .collocation import Field, integrate

FORMAT = 1
SAFETY = 4.0  # of a certificate, over the gap of two computations
# SAFETY where formulas have |x|: across a kink both methods are of low order; once the error was 11 times the gap.
KINKED = 40.0
# Round-off, which a chaotic system magnifies, may leave two runs near each other and far from the solution: on
# random[seed=16] at t_end the error was 5 times their gap. So the effect of shaking the equations counts, too, by
# ROUNDINGS units of round-off (docs/truth.md has the errors).
SHAKE, SHAKES, ROUNDINGS = 1e-8, 3, 32.0
EPS = float(np.finfo(float).eps)
STAGES, FEWER = (13, 9), (9, 6)  # of the two collocations; FEWER for states of more than MANY numbers
MANY = 40  # numbers in a state


@dataclass(frozen=True, eq=False)
class Reference:
    """States known to a stated accuracy.

    times : n floats.  states : (n, m) float64, the certified states rounded to double.
    certificate : from the gap between two computations, one number a time (see the module's docstring for
        the measure).
    floor : smallest error that means something for a double-precision run, >= certificate.
    source : how it was made.  exact : the states as decimal strings where they are known, else ().
    """

    times: tuple[float, ...]
    states: NDArray[np.float64]
    certificate: tuple[float, ...]
    floor: tuple[float, ...]
    source: str
    exact: tuple[tuple[str, ...], ...] = ()

    def index(self, t: float) -> int:
        """Position of time `t` in `times` (equal to 1e-12 relative)."""
        for i, time in enumerate(self.times):
            if abs(time - t) <= 1e-12 * abs(t):
                return i
        raise KeyError(
            f"The reference has no state at t = {t:g}. It has t = {', '.join(f'{x:g}' for x in self.times)}."
        )

    def at(self, t: float) -> NDArray[np.float64]:
        """State at time `t`, shape (m,)."""
        return self.states[self.index(t), :]


def gap(a: ArrayLike, b: ArrayLike, magnitudes: Any = 1.0) -> float:
    """max_i |a_i - b_i| / max(magnitude_i, |b_i|) over the components; NaN as soon as one component is NaN."""
    a, b = np.asarray(a), np.asarray(b)
    return float(np.max(np.abs(a - b) / np.maximum(magnitudes, np.abs(b))))


# ---- stored references


def scenario_hash(constants: Mapping[str, Any], initial: Mapping[str, Any]) -> str:
    """sha256 of the scenario's numbers: constants and initial data, as canonical JSON.

    Horizon, step and name do not enter, for they do not change the solution; so `relative_equilibrium` and
    `long_term` share one hash. Integers and floats of the same value hash alike.
    """
    parts = {"constants": constants, "initial": initial}
    data = {name: {k: _plain(v) for k, v in values.items()} for name, values in parts.items()}
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _plain(value: Any) -> Any:
    return [float(x) for x in np.ravel(value)] if np.ndim(value) else float(value)


@lru_cache(maxsize=1)
def stored_file() -> dict[str, Any]:
    """The package's references.json, read once: recipe, versions, and one record a scenario."""
    return verified(files(__package__).joinpath("data", "references.json").read_text(encoding="utf-8"))


def verified(text: str) -> dict[str, Any]:
    """The content of a file of references; an error where its checksum does not fit."""
    record: dict[str, Any] = json.loads(text)
    if record.get("sha256") != checksum(record):
        raise TcbenchError("tcbench's stored references were changed, or damaged on their way: install tcbench again.")
    return record


def checksum(data: Mapping[str, Any]) -> str:
    """sha256 of the content of a file of references without its checksum."""
    plain = {name: value for name, value in data.items() if name != "sha256"}
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


def stored(name_or_hash: str) -> Reference | None:
    """The reference stored in the package for a scenario's name or hash; None if there is none.

    With a hash, all records of that content are merged.
    """
    records = stored_file()["scenarios"]
    if name_or_hash in records:
        matching = [records[name_or_hash]]
    else:
        matching = [r for r in records.values() if r["hash"] == name_or_hash]
    rows = {float(t): (r, i) for r in matching for i, t in enumerate(r["times"])}
    if not rows:
        return None
    times = sorted(rows)
    exact = tuple(tuple(rows[t][0]["states"][rows[t][1]]) for t in times)
    states = np.array([[float(x) for x in z] for z in exact])
    certificate = tuple(float(rows[t][0]["precision_gap"][rows[t][1]]) for t in times)
    rounded = [float(rows[t][0]["double_gap"][rows[t][1]]) for t in times]
    half_ulp = float(np.finfo(float).eps) / 2  # of the states themselves, which are rounded to double
    floor = tuple(max(c, r, half_ulp) for c, r in zip(certificate, rounded, strict=True))
    return Reference(tuple(times), states, certificate, floor, stored_file()["recipe"], exact)


# ---- references on the fly: two collocations


def compute(
    field: Field, z0: ArrayLike, times: Sequence[float], tolerance: float = 1e-12, max_seconds: float = 300.0,
    magnitudes: Any = 1.0, safety: float = SAFETY,
) -> Reference:  # fmt: skip
    """Reference at `times` for any smooth z' = f(z), z0 of shape (m,), by runs that share no step and no coefficient.

    The certificate is `safety` times the gap of two Radau IIA collocations of different orders, or the growth of
    round-off if that is more: the second one is run again with each number that enters and leaves the equations changed
    by the relative factor SHAKE. Raises ReferenceFailed.
    """
    times = tuple(float(t) for t in times)
    if not times or times[0] <= 0 or any(b <= a for a, b in pairwise(times)):
        raise ValueError(f"Reference times must be positive and increasing; got {times}.")
    start = np.asarray(z0, float)
    most, fewer = STAGES if len(start) <= MANY else FEWER
    fine = integrate(most, field, start, times, tolerance / 3, max_seconds, magnitudes)
    coarse = integrate(fewer, field, start, times, tolerance, max_seconds, magnitudes)
    growth = np.zeros(len(times))
    signs = np.random.Generator(np.random.PCG64(len(start))).integers(0, 2, (SHAKES, 2, len(start)))
    for before, after in 1 + SHAKE * (2.0 * signs - 1):
        moved = integrate(
            fewer, Shaken(field, before, after), start * before, times, tolerance, max_seconds, magnitudes
        )
        growth = np.maximum(growth, [gap(a, b, magnitudes) / SHAKE for a, b in zip(moved, coarse, strict=True)])
    certificate = tuple(
        max(safety * gap(a, b, magnitudes), ROUNDINGS * EPS * max(1.0, g))
        for a, b, g in zip(coarse, fine, growth, strict=True)
    )
    source = f"Radau IIA collocation of {most} against {fewer} stages in double precision"
    floor = tuple(c + EPS / 2 for c in certificate)  # the states are rounded to double
    return Reference(times, fine, certificate, floor, source)


@dataclass(frozen=True, eq=False)
class Shaken:
    """Equations with factors (m,) on each number that enters and leaves them."""

    field: Field
    before: NDArray[np.float64]
    after: NDArray[np.float64]

    def rows(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.after * self.field.rows(self.before * z)

    def jacobian(self, t: float, z: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.field.jacobian(t, self.before * z)


# ---- cache


def cached(key: str, make: Callable[[], Reference]) -> Reference:
    """`make()`, or its earlier result in the cache. key : a hash of all that the reference depends on.

    A file that is damaged, or of another format, is made again.
    """
    name = f"{key}.json"
    try:
        data = json.loads(cache.read("references", name) or b"")
        if data.pop("format") == FORMAT:
            data["states"] = np.array(data["states"], float)
            tuples = {k: tuple(data[k]) for k in ("times", "certificate", "floor")}
            return Reference(**{**data, **tuples, "exact": tuple(tuple(z) for z in data["exact"])})
    except (ValueError, KeyError, TypeError, AttributeError):
        pass
    reference = make()
    text = json.dumps({"format": FORMAT, **asdict(reference), "states": reference.states.tolist()})
    cache.write("references", name, text.encode())
    return reference
