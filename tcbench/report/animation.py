"""A system in motion: methods side by side, elements coloured by temperature, the laws running below."""

from __future__ import annotations

import base64
import html
import io
import shutil
import subprocess
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np

from ..errors import TcbenchError, expect, needs_folder, positive, several, shown, writing
from ..files import written
from ..simulation.fields import mesh_of, records
from ..simulation.mesh_picture import Surface, colours_of, heat_of, outside
from ..simulation.trajectory import Trajectory
from ..systems.plane import joints, segments
from .charts.scales import ROUND_OFF
from .charts.style import look
from .charts.theme import STYLE

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from PIL.Image import Image

FRAMES, FPS = 120, 20
TRAIL = 12  # frames of a mass's way that are shown
MOST_METHODS, MOST_FRAMES = 4, 10_000
SUFFIXES = (".gif", ".mp4", ".html")
ROOM = 0.06  # of a view around what the runs that ended well need: a run that flies apart leaves it
WIDEST = 0.6  # the same where no run ended well, around the start
IN_A_ROW = 5  # laws; more stand in two rows
LOST = 3.0  # errors of the energy over V0 that are shown
BAD, PLAIN = "#b00020", "#222222"


def animate(
    runs: Trajectory | Sequence[Trajectory], path: str | Path | None = None, frames: int = FRAMES, fps: int = FPS
) -> FuncAnimation | Path:
    """The runs of one scenario side by side, in the same time; a run that failed stops where it did and says so.

    Parameters
    ----------
    runs : Trajectory or sequence of Trajectory
        At most four, of one scenario whose masses lie in the plane, or that has a mesh; their states have shape (m, n).
    path : str or Path, optional
        Writes .gif, .mp4 (needs ffmpeg) or .html (one file, with controls).
    frames : int
        Pictures in all.
    fps : int
        Pictures in a second.

    Returns
    -------
    FuncAnimation or Path
        The path that was written; without one the animation itself, which a notebook plays, with controls.

    Raises
    ------
    TcbenchError
        For no run, more than four, different scenarios, other suffixes, and systems that cannot be drawn in the plane
        (see `System.points`) and have no mesh (see `Trajectory.write`).

    References
    ----------
    docs/gallery.md shows some.
    """
    chosen: list[Any] = [*runs] if several(runs) else [runs]  # type: ignore[misc]
    if wrong := [run for run in chosen if not isinstance(run, Trajectory)]:
        raise TcbenchError(f"An animation is of what simulate returns, not of {shown(wrong[0])}.")
    expect("animate", locals(), {"path": "a path or nothing", "frames": "a whole number", "fps": "a number"})
    positive("fps", fps)
    if not 1 <= frames <= MOST_FRAMES:
        raise TcbenchError(f"frames must be 1 to {MOST_FRAMES}, not {frames}.")
    place = None if path is None else checked_output(path)
    if not 1 <= len(chosen) <= MOST_METHODS:
        raise TcbenchError(f"An animation shows 1 to {MOST_METHODS} runs side by side, not {len(chosen)}.")
    if len(names := {run.scenario.name for run in chosen}) > 1:
        raise TcbenchError(f"An animation shows runs of one scenario, not of {', '.join(sorted(names))}.")
    if place is None:
        return _movie(chosen, frames, fps)
    pictures = _pictures(chosen, frames)
    with writing(repr(str(place))), written(place) as temporary:
        if place.suffix == ".html":
            temporary.write_text(_page(pictures, fps), encoding="utf-8")
        elif place.suffix == ".mp4":
            _as_mp4(pictures, temporary, fps)
        else:
            first, *rest = [picture.quantize(64) for picture in pictures]
            first.save(temporary, save_all=True, append_images=rest, duration=round(1000 / fps), loop=0, optimize=True)
    return place


def _movie(runs: Sequence[Trajectory], frames: int, fps: int) -> FuncAnimation:
    """matplotlib's animation, which a notebook shows as a player."""
    from matplotlib.animation import FuncAnimation

    class Movie(FuncAnimation):
        def _repr_html_(self) -> str:
            page = html.escape(_page(_pictures(runs, frames), fps))
            width, height = (80 * size + 40 for size in stage.figure.get_size_inches())
            return f'<iframe srcdoc="{page}" width="{width:.0f}" height="{height:.0f}" style="border:0"></iframe>'

    with matplotlib.rc_context(STYLE):
        stage = _Stage(runs, frames)
        movie = Movie(stage.figure, stage.show, frames=frames, interval=1000 / fps, blit=False)
        vars(movie)["_draw_was_started"] = True  # one that nobody looks at is no reason for a warning
        return movie


def checked_output(output: str | Path) -> Path:
    """The path, if an animation can be written there."""
    path = Path(output)
    if path.suffix not in SUFFIXES:
        raise TcbenchError(f"{str(path)!r}: an animation is written as {', '.join(SUFFIXES)}.")
    if path.suffix == ".mp4" and not shutil.which("ffmpeg"):
        raise TcbenchError("An .mp4 needs the program ffmpeg, which is not installed. Write a .gif or .html instead.")
    needs_folder(path)
    return path


def _pictures(runs: Sequence[Trajectory], frames: int) -> list[Image]:
    """Every frame; what stands still is drawn once, which matplotlib's own writers do not (30 CPU s for 60 frames)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    pictures = []
    with matplotlib.rc_context(STYLE):
        stage = _Stage(runs, frames)
        stage.figure.set_dpi(80)
        canvas = FigureCanvasAgg(stage.figure)
        for artist in stage.moving:
            artist.set_animated(True)
        canvas.draw()
        background = canvas.copy_from_bbox(stage.figure.bbox)
        for frame in range(frames):
            canvas.restore_region(background)
            stage.show(frame)
            for artist in stage.moving:
                artist.axes.draw_artist(artist)
            pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
    return pictures


def _as_mp4(pictures: Sequence[Image], path: Path, fps: int) -> None:
    width, height = pictures[0].size
    command = ["ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}",
               "-r", str(fps), "-i", "-", "-pix_fmt", "yuv420p", "-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2",
               str(path)]  # fmt: skip
    done = subprocess.run(command, input=b"".join(p.tobytes() for p in pictures), capture_output=True)
    if done.returncode:
        why = done.stderr.decode(errors="replace").strip()[:300]
        raise TcbenchError(f"ffmpeg could not write {str(path)!r}: {why}")


def _page(pictures: Sequence[Image], fps: int) -> str:
    """One page with all pictures and the controls of a player."""
    encoded = []
    for picture in pictures:
        picture.quantize(64).save(buffer := io.BytesIO(), "PNG", optimize=True)
        encoded.append(base64.b64encode(buffer.getvalue()).decode())
    page = (files(__package__) / "templates" / "movie.html").read_text("utf-8")
    return page.replace("FRAMES", str(encoded)).replace("WAIT", str(1000 / fps))


class _Stage:
    """The figure and what moves in it."""

    def __init__(self, runs: Sequence[Trajectory], frames: int) -> None:
        from matplotlib.figure import Figure

        self.times = np.linspace(0.0, max(run.t[-1] for run in runs), frames)
        self.rows = [np.searchsorted(run.t, self.times, side="right") - 1 for run in runs]
        laws = [_laws(run) for run in runs]
        n_rows = 1 if len(laws[0]) <= IN_A_ROW else 2
        columns = -(-len(laws[0]) // n_rows)
        size = 3.4 * max(2, len(runs), 0.7 * columns), 3.6 + 2.6 * n_rows
        self.figure = Figure(figsize=size, layout="constrained")
        parts: Any = self.figure.subfigures(2, 1, height_ratios=(3.6, 2.6 * n_rows))
        above, below = parts
        try:
            self.views: Any = _views(above, runs)
        except TcbenchError as no_lines:
            self.views = _mesh_views(above, runs, self.rows, no_lines)
        if any(view.coloured for view in self.views):
            axes = [view.ax for view in self.views]
            above.colorbar(self.views[0].springs, ax=axes, label="temperature θ", shrink=0.8, pad=0.01)
        above.suptitle(runs[0].scenario.name)
        panels = below.subplots(n_rows, columns, squeeze=False).ravel()
        for ax in panels[len(laws[0]) :]:
            ax.set_axis_off()
        self.lines: list[list[Any]] = [[] for _ in runs]  # of each run (line, times, values)
        for ax, label in zip(panels, laws[0], strict=False):
            self._running(
                ax, label, runs, [of.get(label, np.full(len(r.t), np.nan)) for of, r in zip(laws, runs, strict=True)]
            )
        self.moving = [a for view in self.views for a in view.moving] + [x[0] for lines in self.lines for x in lines]
        self.figure.draw_without_rendering()
        self.figure.set_layout_engine("none")  # found once: it would take most of the time of each frame
        for view in self.views:
            view.fill()

    def _running(self, ax: Any, label: str, runs: Sequence[Trajectory], values: Sequence[Any]) -> None:
        """The panel of a law: no legend, which would cover lines; names stand above, in the colours of theirs."""
        for run, of, lines in zip(runs, values, self.lines, strict=True):
            (line,) = ax.plot([], [], color=look(run.integrator.name).colour, label=run.integrator.name)
            lines.append((line, run.t, of))
        every = np.concatenate([of[np.isfinite(of)] for of in values])
        low, high = (float(every.min()), float(every.max())) if len(every) else (0.0, 1.0)
        if label.startswith("(E"):
            low, high = max(low, -LOST), min(high, LOST)
        if label != "entropy S":  # an error: what is round-off is a flat line, not noise that fills the panel
            margin = ROUND_OFF * 10
            low, high = min(low, -margin), max(high, margin)
            if high - low < 1e3 * margin:
                ax.axhspan(-ROUND_OFF, ROUND_OFF, color="#808080", alpha=0.3, linewidth=0)
        room = 0.08 * (high - low) or 1e-12
        ax.set(xlim=(0, self.times[-1] or 1.0), ylim=(low - room, high + room), xlabel="time t", title=label)
        largest = max(abs(low), abs(high), room)
        digits = 3 + int(np.log10(1.0 + largest / (high - low + room)))  # else all ticks of a narrow range say the same
        ax.yaxis.set_major_formatter(lambda value, _: f"{value:.{digits}g}")

    def show(self, frame: int) -> list[Any]:
        """Move everything to this frame."""
        for view, rows, lines in zip(self.views, self.rows, self.lines, strict=True):
            row = int(rows[frame])
            view.show(row, [int(r) for r in rows[max(0, frame - TRAIL) : frame + 1]], float(self.times[frame]))
            for line, t, values in lines:
                line.set_data(t[: row + 1], values[: row + 1])
        return []


def _views(above: Any, runs: Sequence[Trajectory]) -> list[_View]:
    """Each run in the plane, around what the runs that ended well need."""
    places = [segments(run.scenario.model, run.z) for run in runs]
    good = [place for run, place in zip(runs, places, strict=True) if run.ok]
    held = np.concatenate([place.reshape(-1, 2) for place in good or [p[:1] for p in places]])
    low, high = held.min(axis=0), held.max(axis=0)
    heat, room = _heat(runs), 2 * (ROOM if good else WIDEST) * max(high - low)
    axes, box = above.subplots(1, len(runs), squeeze=False)[0], ((low + high) / 2, high - low + room)
    return [_View(ax, run, place, heat, box) for ax, run, place in zip(axes, runs, places, strict=True)]


def _mesh_views(above: Any, runs: Sequence[Trajectory], rows: Any, no_lines: TcbenchError) -> list[_MeshView]:
    """Each run on its mesh."""
    try:
        mesh = mesh_of(runs[0].scenario.model, runs[0].z[0])
    except TcbenchError:
        raise no_lines from None
    (faces, owner), seen = outside(mesh), []
    for run, its in zip(runs, rows, strict=True):
        steps, states = np.unique(its), {}
        for row, (_, x, on_points, on_cells) in zip(steps.tolist(), records(run, mesh, steps), strict=True):
            states[row] = x, heat_of(on_points, on_cells, faces, owner)
        seen.append(states)
    good = [states for run, states in zip(runs, seen, strict=True) if run.ok] or [{0: states[0]} for states in seen]
    points = np.concatenate([x for states in good for x, _ in states.values()])
    colours = colours_of(heat for states in good for _, heat in states.values())
    axes = above.subplots(1, len(runs), squeeze=False, subplot_kw={"projection": "3d"})[0]
    return [_MeshView(ax, run, states, Surface(ax, faces, points, colours or (0.0, 1.0)), bool(colours))
            for ax, run, states in zip(axes, runs, seen, strict=True)]  # fmt: skip


def _heat(runs: Sequence[Trajectory]) -> tuple[float, float]:
    """The temperatures between which the colours of a run lie."""
    temperatures = np.concatenate([run.temperatures.ravel() for run in runs])
    low, high = np.percentile(temperatures[np.isfinite(temperatures)], (1, 99)) if temperatures.size else (0.0, 1.0)
    return float(low), float(max(high, low + 1e-9))


def _laws(run: Trajectory) -> dict[str, Any]:
    """What runs below: the title of a panel -> the values of a run."""
    error = (run.energy - run.energy[0]) / run.scenario.initial_exergy
    changes = {f"{name.replace('_', ' ')}, change": of - of[0] for name, of in run.invariants.items()}
    return {"(E − E₀) / V₀": error, "entropy S": run.entropy} | changes


class _View:
    """One run: its elements as lines, masses at their ends, and the masses' way.

    Where a system says points() masses are where lines begin or end, but for the origin, as on the page; else where
    they end. heat : temperatures of the coldest and the hottest colour. box : middle and size of what is seen.
    """

    def __init__(self, ax: Any, run: Trajectory, place: Any, heat: tuple[float, float], box: Any) -> None:
        from matplotlib.collections import LineCollection

        self.ax, self.run, self.place, (self.middle, self.size) = ax, run, place, box
        ends = place.reshape(len(place), -1, 2)
        self.masses_at = ends[:, joints(run.scenario.model, run.z[0])[1] or slice(1, None, 2)]
        self.coloured = run.temperatures.shape[1] == place.shape[1]  # a line for each temperature, of its colour
        ax.tick_params(labelsize=7)
        ax.set_title(run.integrator.name, color=look(run.integrator.name).colour, fontweight="bold")
        ax.grid(False)
        self.springs = LineCollection([], linewidths=4, cmap="coolwarm", clim=heat, capstyle="round")
        ax.add_collection(self.springs)
        (self.trail,) = ax.plot([], [], ".", color="#999999", markersize=2)
        (self.masses,) = ax.plot([], [], "o", color=PLAIN, markersize=8)
        self.text = ax.text(0.02, 0.02, "", transform=ax.transAxes, fontsize=8, va="bottom")
        self.moving = [self.springs, self.trail, self.masses, self.text]

    def fill(self) -> None:
        """The whole panel, a unit as long upwards as sideways: a broad one shows more of the plane."""
        panel = self.ax.get_window_extent()
        unit = max(self.size[0] / panel.width, self.size[1] / panel.height)
        (x, y), wide, high = self.middle, unit * panel.width / 2, unit * panel.height / 2
        self.ax.set(xlim=(x - wide, x + wide), ylim=(y - high, y + high))

    def show(self, row: int, before: Sequence[int], t: float) -> None:
        self.springs.set_segments(list(self.place[row]))
        if self.coloured:
            self.springs.set_array(self.run.temperatures[row])
        self.masses.set_data(*self.masses_at[row].T)
        self.trail.set_data(*self.masses_at[list(before)].reshape(-1, 2).T)
        _tell(self.text, self.run, row, t)


class _MeshView:
    """One run on its mesh. states : points and temperatures of faces by the rows that are shown."""

    def __init__(self, ax: Any, run: Trajectory, states: dict[int, Any], surface: Surface, coloured: bool) -> None:
        self.ax, self.run, self.states, self.surface, self.coloured = ax, run, states, surface, coloured
        ax.set_title(run.integrator.name, color=look(run.integrator.name).colour, fontweight="bold")
        self.springs = surface.drawn
        self.text = ax.text2D(0.02, 0.02, "", transform=ax.transAxes, fontsize=8, va="bottom")
        self.moving = [self.springs, self.text]

    def fill(self) -> None:
        self.ax.M = self.ax.get_proj()

    def show(self, row: int, before: Sequence[int], t: float) -> None:
        self.surface.show(*self.states[row])
        self.springs.do_3d_projection()
        _tell(self.text, self.run, row, t)


def _tell(text: Any, run: Trajectory, row: int, t: float) -> None:
    """The time, or how and when the run ended."""
    end = run.t[-1]
    over = not run.ok and (t > end + 1e-12 or row == len(run.t) - 1)
    text.set(text=f"{run.status} at t = {end:.3g}" if over else f"t = {t:.3g}", color=BAD if over else PLAIN)
