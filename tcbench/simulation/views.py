"""A trajectory as a table, as a picture and in a notebook."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import TcbenchError, calling, several, shown
from ..metric import Observable

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from .trajectory import Trajectory


def columns(run: Trajectory, observables: Sequence[Observable] = ()) -> dict[str, np.ndarray]:
    """t, variables (m0.., s), energy, entropy, invariants, theta0.. and observables by name, each of shape (m,)."""
    names, m = run.scenario.model.component_names, run.temperatures.shape[1]
    table = {"t": run.t, **dict(zip(names, run.z.T, strict=True)), "energy": run.energy, "entropy": run.entropy}
    table |= dict(run.invariants) | {f"theta{i}": run.temperatures[:, i] for i in range(m)}
    for observable in _checked(observables):
        if observable.name in table:
            raise TcbenchError(f"The table of a run has a column {observable.name!r}; rename the observable.")
        table[observable.name] = observed(run, observable)
    return table


def _checked(observables: Any) -> Sequence[Observable]:
    for one in observables if several(observables) else [observables]:
        if not isinstance(one, Observable):
            raise TcbenchError(f"{shown(one)} is no Observable; give Observable(name, compute), or a list of several.")
    return [observables] if isinstance(observables, Observable) else list(observables)


def read_only(run: Trajectory) -> Trajectory:
    """The run with read-only arrays, for the function of a plugin."""

    def view(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {name: view(one) for name, one in value.items()}
        if isinstance(value, np.ndarray):
            value = value.view()
            value.flags.writeable = False
        return value

    return replace(run, **{f.name: view(getattr(run, f.name)) for f in fields(run) if f.init})


def observed(run: Trajectory, observable: Observable) -> np.ndarray:
    """The observable at each recorded state, shape (m,)."""
    _checked([observable])
    with calling(f"The observable {observable.name!r}"):
        returned = np.asarray(observable.compute(read_only(run)))
        if returned.dtype.kind == "c":
            raise TcbenchError(f"The observable {observable.name!r} gave complex numbers.")
        values = returned.astype(float)
    if values.shape != run.t.shape:
        raise TcbenchError(
            f"The observable {observable.name!r} gave shape {values.shape}; one number for each of the "
            f"{len(run.t)} recorded times is needed, shape {run.t.shape}."
        )
    return values


def frame(run: Trajectory, observables: Sequence[Observable] = ()) -> DataFrame:
    import pandas as pd

    return pd.DataFrame(columns(run, observables))


def picture(run: Trajectory, observables: Sequence[Observable] = ()) -> Figure:
    """Energy error, entropy, errors of the invariants, temperatures, and each observable, against time."""
    from matplotlib.figure import Figure

    scale = run.scenario.initial_exergy
    panels: list[tuple[str, dict[str, Any]]] = [
        ("(E − E₀) / V₀", {"": (run.energy - run.energy[0]) / scale}),
        ("entropy S", {"": run.entropy}),
    ]
    if run.temperatures.shape[1]:
        panels.append(("temperatures θ", {f"{i}": theta for i, theta in enumerate(run.temperatures.T)}))
    panels += [(f"{name} − initial value", {"": x - x[0]}) for name, x in run.invariants.items()]
    panels += [(f"{o.name}{f' ({o.unit})' if o.unit else ''}", {"": observed(run, o)}) for o in _checked(observables)]
    rows = -(-len(panels) // 2)

    class Picture(Figure):
        """A figure that a notebook shows without pyplot."""

        def _repr_png_(self) -> bytes:
            from io import BytesIO

            self.savefig(page := BytesIO(), format="png")
            return page.getvalue()

    figure = Picture(figsize=(9, 2.6 * rows), layout="constrained")
    axes = figure.subplots(rows, 2, sharex=True, squeeze=False).ravel()
    for ax, (label, lines) in zip(axes, panels, strict=False):
        for name, values in lines.items():
            ax.plot(run.t, values, label=name or None, linewidth=1)
        ax.set_ylabel(label)
        if len(lines) > 1:
            ax.legend(frameon=False)
    for ax in axes[len(panels) :]:
        ax.set_visible(False)
    figure.supxlabel("time t")
    figure.suptitle(f"{run.integrator.name} on {run.scenario.name}: {run.status}")
    return figure


def as_html(run: Trajectory) -> str:
    """The run as HTML for a notebook: how it ended, and its largest errors."""
    lost = np.abs(run.energy - run.energy[0]).max() / run.scenario.initial_exergy
    facts = {
        "integrator": run.integrator.name, "scenario": run.scenario.name, "status": run.status,
        "failure": run.failure, "steps": f"{run.steps}" + ("" if np.isnan(run.dt) else f" of {run.dt:g}"),
        "time reached": f"{run.t[-1]:g}", "max |E − E₀| / V₀": f"{lost:.3g}",
        "least increment of S": f"{run.summary.entropy_increment_min:.3g}",
    }  # fmt: skip
    rows = "".join(
        f"<tr><th style='text-align:left'>{html.escape(k)}</th><td style='text-align:left'>{html.escape(v)}</td></tr>"
        for k, v in facts.items()
        if v
    )
    return f"<table>{rows}</table>"
