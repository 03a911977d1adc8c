"""What the commands that draw do, apart from parsing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .. import plugins, terminal
from ..errors import TcbenchError
from ..progress import waiting
from .actions import one_of, wrote


def plot_command(
    kind: str | None, folder: Path, output: Path | None, scenario: str | None, integrators: tuple[str, ...],
    x: str | None, y: tuple[str, ...], dt: float | None, as_json: bool, size: str | None, font_size: float | None,
    methods: str | None, style: str | None,
) -> None:  # fmt: skip
    if kind is None:
        _list_kinds(as_json)
        return
    from ..report.charts.theme import FONT_SIZE, Theme, checked_font_size, parse_methods, parse_size, style_settings
    from ..report.plot import plot

    theme = Theme(
        labels=parse_methods(methods) if methods else {}, settings=style_settings(style) if style else {},
        font_size=checked_font_size(font_size or FONT_SIZE), size=parse_size(size) if size else None,
    )  # fmt: skip
    with waiting(f"drawing {kind}"):
        path = plot(
            kind, folder, output or f"{kind}.png", scenario=scenario, integrators=list(integrators) or None, x=x,
            y=list(y) or None, dt=dt, theme=theme,
        )  # fmt: skip
    wrote([path], as_json)


def _list_kinds(as_json: bool) -> None:
    from ..report.chart_kinds import kinds

    found = {name: chart.text for name, chart in kinds().items()}
    if as_json:
        terminal.print_json(found)
    else:
        terminal.put(terminal.make_table("tcbench plot KIND", ["kind", "shows"], list(map(list, found.items()))))


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
    integrators: Sequence[str], scenarios: Sequence[str], output: Path, dt: float | None, t_end: float | None,
    tolerance: float | None, frames: int, fps: int, as_json: bool,
) -> None:  # fmt: skip
    """Run the methods on the scenario and write them in motion, side by side."""
    from ..report.animation import animate
    from ..simulation.run import simulate

    scenario = one_of("scenario", plugins.expand_scenarios(scenarios), "tcbench animate INTEGRATOR... SCENARIO.")
    methods = plugins.expand_integrators(integrators)
    if not methods:
        raise TcbenchError("tcbench animate takes at least one integrator, and then the scenario.")
    runs = []
    for method in methods:
        step: dict[str, Any] = {"tolerance": tolerance} if method.kind == "adaptive" else {"dt": dt}
        with waiting(f"{method.name} on {scenario.name}"):
            runs.append(simulate(method, scenario, t_end=t_end, **step))
    with waiting("drawing"):
        path = animate(runs, output, frames, fps)
    assert isinstance(path, Path)
    wrote([path], as_json)
