"""Certified data sets: trajectories of one scenario from many starts, with a stated error for each state.

For those who learn dynamics from data: which integrator made a data set, and how far its states are from the solution,
is then known. Trajectories are the references (`reference.pairs`, two Taylor series in double-doubles); where these
lead nowhere, two runs of tc_auto at tolerances that differ by a hundred.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import TcbenchError, needs_folder, writing
from ..files import written
from ..reference import pairs
from ..systems.sampling import Draw, Range
from ..systems.scenario import Scenario
from ..systems.scenario_family import TRIES, moved
from .run import simulate
from .stepper import stepper

Floats = NDArray[np.float64]
FALLBACK, FINER = 1e-11, 1e-13  # tolerances of tc_auto where there is no reference
SAFETY = 4.0  # the stated error over the gap of two runs, as references have it
SPLITS = {"train": 0.8, "validation": 0.1, "test": 0.1}  # shares of the trajectories
PARTS = (1, 2, 5, 10)  # numbers of steps between two states of a data set that are tried
COMPARED = 50  # moves of the first trajectory that are compared
EXACT_MOVE = 1e-13  # error of one move that is round-off: the data are solutions, or the method's own steps
CONSTANT_MATRIX = 1e-9  # relative change of a matrix along the data, below which it is constant


@dataclass(frozen=True, eq=False)
class DataSet:
    """Trajectories of one scenario at common times.

    times : shape (m,), in the scenario's unit of time, the first is 0.
    states : shape (k, m, n), trajectories by times by numbers of a state, in the units of the system's variables.
    rates : shape (k, m, n), dz/dt there.
    error : shape (k, m), the stated error max |dz| / max(magnitude, |z|) of a state, dimensionless; 0 at the start.
    laws : name to array (k, m): energy, entropy and each invariant. temperatures : shape (k, m, nt).
    split : shape (k,), "train", "validation" or "test". about : scenario, variables, constants, who made each
    trajectory, version.
    """

    times: Floats
    states: Floats
    rates: Floats
    error: Floats
    laws: dict[str, Floats]
    temperatures: Floats
    split: NDArray[np.str_]
    about: dict[str, Any] = field(default_factory=dict)

    def write(self, path: str | Path) -> None:
        """As `.npz` (every field by its name, `about` as JSON), or as `.mat` in the layout of published data sets:
        Z (k, n, m), t_vec (1, m), dt, and L, M where they are constant along the data. TcbenchError for other names."""
        path = Path(path)
        check_name(path)
        with writing(repr(str(path))), written(path) as temporary, open(temporary, "wb") as file:
            if path.suffix == ".npz":
                np.savez_compressed(file, **self._named())
            else:
                from scipy.io import savemat

                savemat(file, self._published(), do_compression=True)

    def _named(self) -> dict[str, Any]:
        laws = {f"law_{name}": values for name, values in self.laws.items()}
        return {
            "times": self.times, "states": self.states, "rates": self.rates, "error": self.error, **laws,
            "temperatures": self.temperatures, "split": self.split, "about": np.array(json.dumps(self.about)),
        }  # fmt: skip

    def _published(self) -> dict[str, Any]:
        steps = np.diff(self.times)
        arrays = {
            "Z": self.states.transpose(0, 2, 1), "dZ": self.rates.transpose(0, 2, 1), "error": self.error,
            "t_vec": self.times[None], "dt": np.array([[steps[0] if len(steps) else 0.0]]),
            "split": self.split.astype(object), "about": json.dumps(self.about),
            **self.laws,
        }  # fmt: skip
        return arrays | {name: np.array(matrix) for name, matrix in self.about.get("matrices", {}).items()}


def check_name(path: Path) -> None:
    """TcbenchError for a file that is no data set by its name, or whose folder is missing."""
    if path.suffix not in (".npz", ".mat"):
        raise TcbenchError(f"A data set is a file .npz or .mat, not {path.name!r}.")
    needs_folder(path)


def data_set(
    scenario: Scenario, starts: int = 50, every: float | None = None, t_end: float | None = None,
    spread: float = 0.3, seed: int = 0,
) -> DataSet:  # fmt: skip
    """Trajectories of `scenario` from its own start and `starts` - 1 random ones around it.

    every, t_end : in the scenario's unit of time; its dt and t_end if not given. spread : how far each number of a
    start is moved at most, over its size or 0.3. seed : of the starts and of the split, the same on every machine.
    Raises TcbenchError for numbers that cannot be, and where no trajectory can be computed.
    """
    every, t_end = every or scenario.dt, t_end or scenario.t_end
    count = round(t_end / every) if every > 0 else 0
    if starts < 1 or not 1 <= count <= 1_000_000 or not 0 <= spread < 1:
        raise TcbenchError(
            f"A data set needs starts >= 1, 0 < every <= t_end, at most a million states a trajectory and 0 <= spread "
            f"< 1, not starts={starts}, every={every:g}, t_end={t_end:g}, spread={spread:g}."
        )
    times: Floats = every * np.arange(count + 1, dtype=np.float64)
    members = starts_around(scenario, starts, spread, seed)
    model = scenario.model
    certified = pairs.solve([s.model for s in members], [s.z0 for s in members], times[1:])
    runs = [_certified(s, times, pair) for s, pair in zip(members, certified, strict=True)]
    states = np.array([states for states, _, _ in runs])
    flat = states.reshape(-1, model.size)
    shape = states.shape[:2]
    momenta = np.asarray(model.momenta(flat)).reshape(*shape, -1)
    laws = {"energy": np.reshape(model.energy(flat), shape), "entropy": np.reshape(model.entropy(flat), shape)}
    laws |= {name: momenta[..., i] for i, name in enumerate(model.invariant_names)}
    return DataSet(
        times, states, np.reshape(model.vector_field(flat), states.shape), np.array([error for _, error, _ in runs]),
        laws, np.reshape(model.temperatures(flat), (*shape, -1)), splits(starts, seed),
        _about(scenario, members, flat, [source for _, _, source in runs], spread, seed),
    )  # fmt: skip


def starts_around(scenario: Scenario, count: int, spread: float, seed: int) -> list[Scenario]:
    """The scenario and `count` - 1 like it whose start is moved, each number x by at most spread * max(|x|, 0.3)."""
    names = scenario.system.initial_data if scenario.positions else tuple(scenario.initial)
    first = {n: getattr(scenario, n) if scenario.positions else scenario.initial[n] for n in names}
    starts, draw = [scenario], Draw(seed, {"start": Range(-spread, spread)})
    while len(starts) < count:
        for _ in range(TRIES):
            start = {n: moved(value, draw, "start") for n, value in first.items()}
            try:
                starts.append(scenario.replace(**(start if scenario.positions else {"initial": start})))
                break
            except TcbenchError as error:
                why = error
        else:
            raise TcbenchError(f"No admissible start was found around {scenario.name!r}: narrow spread. {why}")
    return starts


def _certified(scenario: Scenario, times: Floats, pair: pairs.Pair | None) -> tuple[Floats, Floats, str]:
    """States (m, n), their stated error (m,), and what made them."""
    if pair is not None and np.isfinite(pair.certificate).all():
        rounding = pairs.SAFETY * float(np.finfo(float).eps)
        error = np.append(0.0, np.maximum(pair.certificate, rounding))
        return np.vstack([scenario.z0, pair.states]), error, pairs.SOURCE
    runs = [simulate("tc_auto", scenario, tolerance=tolerance, times=times) for tolerance in (FALLBACK, FINER)]
    for run in runs:
        if not run.ok:
            raise TcbenchError(f"A start of {scenario.name!r} has no trajectory: {run.failure}")
    magnitudes = scenario.model.state_magnitudes
    gap = np.max(np.abs(runs[0].z - runs[1].z) / np.maximum(magnitudes, np.abs(runs[1].z)), axis=1)
    return runs[1].z, SAFETY * np.maximum.accumulate(gap), f"tc_auto at {FINER:g} against {FALLBACK:g}"


def splits(count: int, seed: int) -> NDArray[np.str_]:
    """For each trajectory, whether it is for training, validation or testing; shape (count,)."""
    draw = Draw(seed, {})
    order = sorted(range(count), key=[draw.uniform() for _ in range(count)].__getitem__)
    ends = np.round(np.cumsum([*SPLITS.values()]) * count).astype(int)
    labels = np.empty(count, dtype="U10")
    for name, part in zip(SPLITS, np.split(np.array(order, int), ends[:-1]), strict=True):
        labels[part] = name
    return labels


def _about(
    scenario: Scenario, members: Sequence[Scenario], states: Floats, sources: Sequence[str], spread: float, seed: int
) -> dict[str, Any]:  # fmt: skip
    from .. import __version__

    model = scenario.model
    constants = {name: np.asarray(value).tolist() for name, value in scenario.constants.items()}
    return {
        "scenario": scenario.name, "system": model.name, "constants": constants,
        "variables": {name: [first, end, list(shape)] for name, (first, end, shape) in model.layout.items()},
        "made_by": list(sources), "tcbench": __version__, "spread": spread, "seed": seed,
        "matrices": _constant_matrices(model, states), "starts": len(members),
    }  # fmt: skip


def _constant_matrices(model: Any, states: Floats) -> dict[str, Any]:
    """L and M of GENERIC (n, n) where they are the same at all of the states, as far as that is known."""
    matrices = {}
    for name, matrix in (("L", model.poisson), ("M", model.friction)):
        try:
            values = np.array([matrix(z) for z in states[:: max(1, len(states) // 20)]])
        except TcbenchError:  # a large system has none, or S is constant
            continue
        if np.abs(values - values[0]).max() <= CONSTANT_MATRIX * np.abs(values).max():
            matrices[name] = values[0].tolist()
    return matrices


@dataclass(frozen=True, eq=False)
class Judgement:
    """How far the states of somebody's data set are from the solution, and what may have made it.

    errors : shape (k, m), max |dz| / max(magnitude, |z|) against the certified trajectory from the same first state.
    certificates : shape (k, m), the stated error of that trajectory; NaN where there is none. methods : (method, steps
    between two states of the data) to the median error of one such move over the first trajectory, the nearest first;
    empty where the states are the solution to round-off, for then every accurate method seems to have made them.
    """

    times: Floats
    errors: Floats
    certificates: Floats
    methods: dict[tuple[str, int], float]

    @property
    def exact(self) -> bool:
        """Is each next state the solution, as far as doubles tell?"""
        return bool(np.nanmedian(self.errors[:, 1]) <= EXACT_MOVE) if np.isfinite(self.errors[:, 1]).any() else False


def read_published(path: str | Path) -> tuple[Floats, Floats]:
    """(times (m,), states (k, m, n)) of a `.npz` of tcbench or a `.mat` with Z (k, n, m) and t_vec (1, m).

    Nothing in the file is executed. Raises TcbenchError for a file that is neither.
    """
    path = Path(path)
    try:
        if path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as content:
                times, states = content["times"], content["states"]
        else:
            from scipy.io import loadmat

            content = loadmat(path, variable_names=["Z", "t_vec"])
            times, states = content["t_vec"].ravel(), content["Z"].transpose(0, 2, 1)
        times, states = np.asarray(times, float), np.asarray(states, float)
    except Exception as error:  # readers of foreign files raise what they will
        raise TcbenchError(
            f"{path} is no data set: a .npz of `tcbench data`, or a .mat with Z (trajectories, numbers, times) and "
            f"t_vec, is needed. {error}"
        ) from error
    if states.ndim != 3 or times.shape != (states.shape[1],) or len(times) < 2 or not np.all(np.diff(times) > 0):
        raise TcbenchError(f"{path}: Z has shape {states.shape} for {times.size} times; times must grow.")
    return times, states


def judge(path: str | Path, scenario: Scenario, methods: Sequence[Any] = ()) -> Judgement:
    """The data set at `path` against the scenario's system and constants, from the data's own first states."""
    times, states = read_published(path)
    model = scenario.model
    if states.shape[2] != model.size:
        raise TcbenchError(
            f"{path} has states of {states.shape[2]} numbers, {scenario.name!r} of {model.size}: choose the scenario "
            "of the data's system, with its constants by scenario[constant=value]."
        )
    starts, ends = states[:, 0], times - times[0]
    certified = pairs.solve([model] * len(starts), list(starts), ends[1:])
    errors, certificates = np.full((2, *states.shape[:2]), np.nan)
    errors[:, 0] = certificates[:, 0] = 0.0
    for i, pair in enumerate(certified):
        if pair is not None:
            size = np.maximum(model.state_magnitudes, np.abs(pair.states))
            errors[i, 1:] = np.max(np.abs(states[i, 1:] - pair.states) / size, axis=1)
            certificates[i, 1:] = pair.certificate
    judged = Judgement(times, errors, certificates, {})
    return judged if judged.exact else replace(judged, methods=_nearest(scenario, ends, states[0], methods))


def _nearest(scenario: Scenario, times: Floats, states: Floats, methods: Sequence[Any]) -> dict[tuple[str, int], float]:
    """Of one-step methods, from each state of the data to the next: which one made them is at round-off."""
    size = np.maximum(scenario.model.state_magnitudes, np.abs(states))
    errors = {}
    for method in methods:
        try:
            step = stepper(method, scenario)
        except TcbenchError:  # adaptive, multistep, or not for this system
            continue
        for parts in PARTS:
            missed = [
                _missed(step, states[i], states[i + 1], (times[i + 1] - times[i]) / parts, parts, size[i + 1])
                for i in range(min(COMPARED, len(times) - 1))
            ]
            errors[method.name, parts] = float(np.median(missed))
    return dict(sorted(errors.items(), key=lambda item: item[1]))


def _missed(step: Any, z: Floats, wanted: Floats, h: float, parts: int, size: Floats) -> float:
    """max |dz| / size after so many steps from z; infinite where there is no step."""
    try:
        for _ in range(parts):
            z = step(z, h)
    except ArithmeticError:
        return float("inf")
    return float(np.max(np.abs(z - wanted) / size))
