"""Runs of adaptive solvers that several cells of one `tcbench run` need: made once, and read by the others.

Conservation, equilibrium, stability and work_precision ask for the same run of the same solver, some of which take ten
seconds. The first cell that makes such a run leaves what the solver gave in a folder of the run under way, which is
removed at its end. Everything that is measured on the run is computed again from that, with the seconds that the solver
took when it ran. Nothing is shared outside a worker of such a run.
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
MOST_NUMBERS = 100_000  # of a run's states
MOST_ARRAYS = 4_000_000  # numbers of what is left as arrays: 32 MB

_folder: Path | None = None
_found = 0
_work_s = 0.0


@dataclass(frozen=True, eq=False)
class Solved:
    """What an adaptive solver gave.

    states : at the first output times, all but of a run that failed, shape (up to 201, n); counts : of steps and the
    like; status : "ok", "nonconverged" where the solver gave up (then there are no states), "exception"; failure : why,
    "" where it is ok; wall_s : seconds that it took; work_s : of the processor, by which what is slow is judged, for
    these no busy machine makes longer.
    """

    states: np.ndarray
    counts: dict[str, int]
    status: str
    failure: str
    wall_s: float
    work_s: float = 0.0


@contextmanager
def kept_in(folder: str | None) -> Iterator[None]:
    """Runs are shared with whatever else uses this folder; None: with nobody, as where nothing is shared."""
    global _folder, _found
    outer, _folder = _folder, Path(folder) if folder else None
    _found = 0 if outer is None else _found
    try:
        yield
    finally:
        _folder = outer


made_anew = partial(kept_in, None)  # runs of one's own


def are_shared() -> bool:
    """Is there anybody to share with?"""
    return _folder is not None


def found() -> int:
    """How many runs have been read, not made, since the outermost `kept_in`."""
    return _found


def used(run: Solved) -> None:
    """This run is what is measured now."""
    global _work_s
    _work_s = run.work_s


def work_s() -> float:
    """Processor seconds of the adaptive solver's latest run in this process, whether it was made or read."""
    return _work_s


def recorded(name: str, scenario: Scenario, tolerance: float) -> Solved | None:
    """The run of this solver, if it was made before."""
    global _found
    if _folder is None:
        return None
    with suppress(OSError, ValueError, KeyError):
        data = json.loads(_place(_folder, name, scenario, tolerance).read_text(encoding="utf-8"))
        states = np.array(data.pop("states"), dtype=float).reshape(-1, scenario.model.size)
        _found += 1
        return Solved(states, **data)
    return None


def keep(name: str, scenario: Scenario, tolerance: float, run: Solved) -> None:
    """Leave a run to others if it took long."""
    if _folder is None or run.wall_s < SHORTEST_S or run.states.size > MOST_NUMBERS:
        return
    data: dict[str, Any] = asdict(run) | {"states": run.states.tolist()}
    with suppress(OSError), replacing(_place(_folder, name, scenario, tolerance)) as temporary:  # the others run it too
        temporary.write_text(json.dumps(data), encoding="utf-8")


def arrays(name: str, scenario: Scenario, tolerance: float) -> dict[str, np.ndarray] | None:
    """What `keep_arrays` has left under this name, for this scenario."""
    if _folder is not None:
        place = _place(_folder, name, scenario, tolerance).with_suffix(".npz")
        with suppress(OSError, ValueError, zipfile.BadZipFile), np.load(place, allow_pickle=False) as data:
            return dict(data)
    return None


def keep_arrays(name: str, scenario: Scenario, tolerance: float, arrays: Mapping[str, np.ndarray]) -> None:
    """Leave arrays to others, whatever time they took."""
    if _folder is None or sum(array.size for array in arrays.values()) > MOST_ARRAYS:
        return
    place = _place(_folder, name, scenario, tolerance).with_suffix(".npz")
    with suppress(OSError), replacing(place) as temporary:
        np.savez(temporary, allow_pickle=False, **arrays)


def _place(folder: Path, name: str, scenario: Scenario, tolerance: float) -> Path:
    what = json.dumps([name, scenario.name, scenario.data(), tolerance], sort_keys=True)
    return folder / f"run-{hashlib.sha256(what.encode()).hexdigest()[:24]}.json"
