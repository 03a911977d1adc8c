"""Runs of adaptive solvers that several cells of one `tcbench run` need: the first cell makes them, others read them.

Conservation, equilibrium, stability and work_precision ask for the same run of the same solver, some of which take ten
seconds. The first cell that makes such a run writes the solver's result into a folder of the run under way, which is
removed at its end. Other cells measure that result, with the seconds that the solver took when it ran. Nothing is
shared outside a worker of such a run.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..files import replacing
from ..systems.scenario import Scenario

SHORTEST_S = 0.02  # runs that take less are made again
MOST_NUMBERS = 100_000  # of the states of a run that is shared
MOST_ARRAYS = 4_000_000  # numbers of arrays that are shared: 32 MB

_folder: Path | None = None
_reads = 0
_work_s = 0.0


@dataclass(frozen=True, eq=False)
class Solved:
    """The result of an adaptive solver.

    states : at the output times, shape (m, n), up to the first at which it failed; counts : of steps and the
    like; status : "ok", "nonconverged" where the solver gave up (then there are no states), "exception"; failure : why,
    "" where it is ok; wall_s : seconds; work_s : processor seconds, which a busy machine does not make longer.
    """

    states: np.ndarray
    counts: dict[str, int]
    status: str
    failure: str
    wall_s: float
    work_s: float = 0.0


@contextmanager
def shared_in(folder: str | None) -> Iterator[None]:
    """Within, runs are shared through this folder; None: they are not shared."""
    global _folder, _reads
    outer, _folder = _folder, Path(folder) if folder else None
    _reads = 0 if outer is None else _reads
    try:
        yield
    finally:
        _folder = outer


unshared = partial(shared_in, None)  # within, runs are not shared


def are_shared() -> bool:
    """Are runs shared now?"""
    return _folder is not None


def reads() -> int:
    """Number of runs that were read, not made, since the outermost `shared_in`."""
    return _reads


def used(run: Solved) -> None:
    """Declare that this run is measured now: see `work_s`."""
    global _work_s
    _work_s = run.work_s


def work_s() -> float:
    """Processor seconds of the adaptive solver's latest run in this process, whether it was made or read."""
    return _work_s


def recorded(name: str, scenario: Scenario, tolerance: float) -> Solved | None:
    """The run of this solver, if it was made before."""
    global _reads
    if _folder is None:
        return None
    with suppress(OSError, ValueError, KeyError):
        data = json.loads(_place(_folder, name, scenario, tolerance).read_text(encoding="utf-8"))
        states = np.array(data.pop("states"), dtype=float).reshape(-1, scenario.model.size)
        _reads += 1
        return Solved(states, **data)
    return None


def keep(name: str, scenario: Scenario, tolerance: float, run: Solved) -> None:
    """Share a run that took long."""
    if _folder is None or run.wall_s < SHORTEST_S or run.states.size > MOST_NUMBERS:
        return
    data: dict[str, Any] = asdict(run) | {"states": run.states.tolist()}
    with suppress(OSError), replacing(_place(_folder, name, scenario, tolerance)) as temporary:  # the others run it too
        temporary.write_text(json.dumps(data), encoding="utf-8")


def arrays(name: str, scenario: Scenario, tolerance: float) -> dict[str, np.ndarray] | None:
    """The arrays that `keep_arrays` shared under this name for this scenario, or None."""
    if _folder is not None:
        place = _place(_folder, name, scenario, tolerance).with_suffix(".npz")
        with suppress(OSError, ValueError, zipfile.BadZipFile), np.load(place, allow_pickle=False) as data:
            return dict(data)
    return None


def keep_arrays(name: str, scenario: Scenario, tolerance: float, arrays: Mapping[str, np.ndarray]) -> None:
    """Share arrays, however long they took."""
    if _folder is None or sum(array.size for array in arrays.values()) > MOST_ARRAYS:
        return
    place = _place(_folder, name, scenario, tolerance).with_suffix(".npz")
    with suppress(OSError), replacing(place) as temporary:
        np.savez(temporary, allow_pickle=False, **arrays)


def _place(folder: Path, name: str, scenario: Scenario, tolerance: float) -> Path:
    what = json.dumps([name, scenario.name, scenario.data(), tolerance], sort_keys=True)
    return folder / f"run-{hashlib.sha256(what.encode()).hexdigest()[:24]}.json"
