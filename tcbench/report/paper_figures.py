"""Figures 2 to 9 of Romero (2009), drawn again from the printed data; each caption says what differs."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import NamedTuple

from .. import plugins
from ..errors import TcbenchError, writing
from ..simulation import series
from ..simulation.run import simulate
from ..simulation.trajectory import Trajectory
from .charts.runs import four_panel
from .charts.theme import INK
from .plot import SUFFIXES, save


class PaperFigure(NamedTuple):
    """One figure: which runs it shows, and what the paper says of them."""

    number: int
    scenario: str
    integrators: tuple[str, ...]
    account: str


HOLDS = "The paper's account holds: E is constant, S only grows."
FIGURES = (
    PaperFigure(2, "short_term", ("tc_monolithic",), HOLDS),
    PaperFigure(3, "short_term", ("tc_staggered",), HOLDS),
    PaperFigure(
        4, "short_term", ("midpoint_entropy",),
        "The paper reports that E and S oscillate. E goes up, comes back and settles; the temperatures oscillate. S "
        "does not and cannot: the printed equations (A2) make its increment non-negative. "
        "The failure after 5 steps at h = 0.5 is not reproduced.",
    ),
    PaperFigure(
        5, "short_term", ("midpoint_temperature",),
        "The paper reports a blow-up at t = 12. With the printed data and a converged Newton iteration there is none.",
    ),
    PaperFigure(6, "long_term", ("tc_monolithic", "tc_staggered"), HOLDS),
    PaperFigure(
        7, "long_term", ("midpoint_entropy",),
        "The paper reports that E and S fall and temperatures come near 0. None of this is reproduced.",
    ),
    PaperFigure(
        8, "long_term", ("midpoint_temperature",),
        "The paper reports a failure after 28 steps. Newton's iteration started at the old state does fail, at the "
        "first step, with a negative temperature; guarded, it runs to the end: the failure is the iteration's, not the "
        "method's.",
    ),
    PaperFigure(
        9, "relative_equilibrium", ("tc_monolithic",),
        "The paper reports a relative equilibrium by t = 1500. It is not reached: the strains still grow like ln t, "
        "while S and the temperatures settle.",
    ),
)  # fmt: skip
DATA = {
    "short_term": "example 1, initial data (44)",
    "long_term": "example 2, initial data (45)",
    "relative_equilibrium": "example 2, initial data (45), to t = 1500",
}
NUMBERING = (
    "Figures 2 to 5 belong to example 1, 6 to 8 to example 2 and 9 to its long horizon, as in the paper. Which method "
    "stands in which figure of an example is tcbench's own arrangement."
)


def paper_figures(output: str | Path, suffix: str = ".png") -> list[Path]:
    """Draw figures 2 to 9 into a folder, `figure_N` with the suffix given, and `captions.md`; returns the paths.

    The folder is made where it does not exist. Raises TcbenchError when it cannot be written, or for another suffix.
    """
    if suffix not in SUFFIXES:
        raise TcbenchError(f"Figures are written as {', '.join(SUFFIXES)}, not {suffix!r}.")
    folder = Path(output)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TcbenchError(f"The folder {str(output)!r} cannot be made: {error.strerror or error}.") from None
    paths, captions = [], ["# Figures 2 to 9", NUMBERING]
    for figure in FIGURES:
        scenario = plugins.find_scenario(figure.scenario)
        every, name = max(1, scenario.steps(scenario.dt) // 2500), f"figure_{figure.number}{suffix}"
        runs = [simulate(method, figure.scenario, record_every=every) for method in figure.integrators]
        text, drawn = caption(figure, runs), four_panel(series.trajectories(runs))
        captions.append(f"**{name}.** {text}")
        lines = textwrap.wrap(text, 150)
        width, height = drawn.get_size_inches()
        drawn.set_size_inches(width, height + 0.16 * len(lines))
        drawn.supxlabel("\n".join(lines), x=0.01, ha="left", fontsize=8, color=INK, parse_math=False)
        paths.append(save(drawn, folder / name))
    paths.append(folder / "captions.md")
    with writing(repr(str(paths[-1]))):
        paths[-1].write_text("\n\n".join(captions) + "\n", "utf-8")
    return paths


def caption(figure: PaperFigure, runs: list[Trajectory]) -> str:
    """Data, step, what was measured, and what differs from the paper's account."""
    scenario = runs[0].scenario
    measured = "; ".join(measurement(run) for run in runs)
    methods = " and ".join(run.integrator.name for run in runs)
    return (
        f"Romero (2009), figure {figure.number}: {methods}, {DATA[figure.scenario]}, printed constants, "
        f"h = {scenario.dt:g}, t up to {scenario.t_end:g}. {figure.account} Measured: {measured}."
    )


def measurement(run: Trajectory) -> str:
    """The numbers of one run: energy, entropy, end."""
    end = f"ends at t = {run.t[-1]:.6g}" if run.ok else run.failure
    low, high = run.energy.min(), run.energy.max()
    if high - low < 1e-8 * max(1.0, abs(high)):
        energy = f"E = {run.energy[0]:.6g}, moving by {high - low:.0e}"
    else:
        energy = f"E from {low:.5g} to {high:.5g}"
    smallest = run.summary.entropy_increment_min
    fall = "never falling" if smallest >= -1e-13 else f"falling by up to {-smallest:.0e} in a step"
    strains = " and ".join(f"{v:.3f}" for v in run.scenario.model.log_strain(run.scenario.model.shape(run.z[-1, :4])))
    return (
        f"{run.integrator.name}: {energy}; S from {run.entropy[0]:.4g} to {run.entropy[-1]:.5g}, {fall}; "
        f"log strains {strains} at the end; {end}"
    )
