"""What the commands that draw do, apart from parsing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .. import plugins
from ..errors import TcbenchError
from ..progress import waiting
from . import terminal
from .actions import wrote
from .options import words
from .simulate import one_of


def plot_command(
    kind: str | None, folder: Path, output: Path | None, integrators: tuple[str, ...], methods: str | None,
    as_json: bool, **options: Any,
) -> None:  # fmt: skip
    if kind is None:
        _list_kinds(as_json)
        return
    from ..report.plot import plot

    if methods and integrators:
        raise TcbenchError("Name methods with -i or with --methods, which also orders and labels them; not with both.")
    with waiting(f"drawing {kind}"):
        path = plot(kind, folder, output or f"{kind}.png", methods=methods or integrators, **options)
    wrote([path], as_json)


def _list_kinds(as_json: bool) -> None:
    from ..report.chart_kinds import kinds

    texts = {name: chart.text for name, chart in kinds().items()}
    if as_json:
        terminal.print_json(texts)
    else:
        terminal.put(terminal.make_table("tcbench plot KIND", ["kind", "shows"], list(map(list, texts.items()))))


def publish_command(folders: tuple[Path, ...], output: Path, as_json: bool) -> None:
    from ..report.publish import publish

    with waiting("writing the site"):
        path = publish(folders, output)
    wrote([path], as_json)


def paper_command(output: Path, suffix: str, as_json: bool) -> None:
    from ..report.paper_figures import paper_figures

    with waiting("drawing the paper's figures"):
        paths = list(paper_figures(output, f".{suffix}"))
    wrote(paths, as_json)


def animate_command(
    names: tuple[str, ...], integrators: tuple[str, ...], scenarios: tuple[str, ...], *, output: Path,
    dt: float | None, t_end: float | None, tolerance: float | None, frames: int, fps: int, as_json: bool,
) -> None:  # fmt: skip
    """Run the methods on the scenario and write them in motion, side by side."""
    from ..report.animation import animate, checked_output
    from ..simulation.run import simulate

    first, last = words(names, integrators, scenarios)
    scenario = one_of("scenario", plugins.expand_scenarios(last), "tcbench animate INTEGRATOR... SCENARIO.")
    methods = plugins.expand_integrators(first)
    if not methods:
        raise TcbenchError("tcbench animate takes at least one integrator, and then the scenario.")
    checked_output(output)
    runs = []
    for method in methods:
        step: dict[str, Any] = {"tolerance": tolerance} if method.kind == "adaptive" else {"dt": dt}
        with waiting(f"{method.name} on {scenario.name}"):
            runs.append(simulate(method, scenario, t_end=t_end, **step))
    with waiting("drawing"):
        path = animate(runs, output, frames, fps)
    assert isinstance(path, Path)
    wrote([path], as_json)
