"""`tcbench data`: certified data sets, and how far somebody's data set is from the solution."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .. import plugins
from ..errors import TcbenchError
from ..progress import waiting
from . import terminal
from .simulate import one_of

SHOWN = 6  # nearest methods


def data_command(
    names: Sequence[str], scenarios: Sequence[str], *, output: Path | None, judged: Path | None, starts: int,
    every: float | None, t_end: float | None, spread: float, seed: int, as_json: bool,
) -> None:  # fmt: skip
    many = "tcbench data SCENARIO -o FILE.npz."
    scenario = one_of("scenario", plugins.expand_scenarios([*names, *scenarios]), many)
    if (output is None) == (judged is None):
        raise TcbenchError("Say what to do: -o FILE.npz writes a data set (.mat, too), --judge FILE judges one.")
    if output is not None:
        row = _written(scenario, output, starts, every, t_end, spread, seed)
    else:
        assert judged is not None
        row = _judged(scenario, judged)
    if as_json:
        terminal.print_json(row)
    else:
        for sentence in row.pop("sentences"):
            terminal.say(sentence)


def _written(
    scenario: Any, output: Path, starts: int, every: float | None, t_end: float | None, spread: float, seed: int
) -> dict[str, Any]:  # fmt: skip
    from ..simulation.data_set import check_name, data_set

    check_name(output)
    with waiting(f"computing {starts} trajectories of {scenario.name}"):
        data = data_set(scenario, starts, every, t_end, spread, seed)
    data.write(output)
    worst, middle = float(data.error.max()), float(np.median(data.error.max(axis=1)))
    k, m, n = data.states.shape
    sentences = [
        f"{k} trajectories of {m} states of {n} numbers in {output}.",
        f"Stated error of a state: at most {worst:.1e}, {middle:.1e} in the median trajectory.",
        f"Made by: {'; '.join(sorted(set(data.about['made_by'])))}.",
    ]
    return {"file": str(output), "trajectories": k, "states": m, "error_max": worst, "error_median": middle,
            "made_by": data.about["made_by"], "sentences": sentences}  # fmt: skip


def _judged(scenario: Any, path: Path) -> dict[str, Any]:
    from ..simulation.data_set import EXACT_MOVE, judge

    with waiting(f"computing the trajectories of {path} as {scenario.name}"):
        judgement = judge(path, scenario, [*plugins.integrators().values()])
    reached = np.isfinite(judgement.certificates)
    last = judgement.errors[:, -1][np.isfinite(judgement.errors[:, -1])]
    nearest: list[dict[str, Any]] = [
        {"integrator": name, "steps_between": parts, "difference": missed}
        for (name, parts), missed in list(judgement.methods.items())[:SHOWN]
    ]
    sentences = [
        f"{len(judgement.errors)} trajectories of {len(judgement.times)} states, as {scenario.name}, "
        f"{int(reached.all(axis=1).sum())} with a reference from end to end."
    ]
    if len(last):
        sentences.append(
            f"Error of the last states: {np.median(last):.1e} in the median, at most {last.max():.1e}; the references' "
            f"own error is at most {np.nanmax(judgement.certificates):.1e}."
        )
    makers = [_sentence(each, "made the data") for each in nearest if each["difference"] <= EXACT_MOVE]
    off = [_sentence(each, "is off by more than round-off") for each in nearest]
    exact = ["The states are the solution to round-off: no error is left by which to tell what made them."]
    sentences += exact if judgement.exact else makers or ["No method made it, step by step; the nearest are:", *off]
    error = [float(x) for x in np.nanmax(judgement.errors, axis=0, initial=0.0)]
    return {"file": str(path), "times": judgement.times.tolist(), "error_max": error, "nearest": nearest,
            "sentences": sentences}  # fmt: skip


def _sentence(nearest: dict[str, Any], what: str) -> str:
    parts, missed = nearest["steps_between"], nearest["difference"]
    steps = f"{parts} steps" if parts > 1 else "one step"
    return f"{nearest['integrator']} {what}: {steps} from each state to the next, to {missed:.1e} in the median."
