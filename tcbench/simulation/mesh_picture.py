"""A run on its mesh as a picture: the start, the middle and the end side by side, filled by temperature."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import writing
from ..files import written

if TYPE_CHECKING:
    from .trajectory import Trajectory

SUFFIXES = (".png", ".svg", ".pdf")
FACES = {  # corners of the faces of a cell that has some
    "tetra": ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)),
    "hexahedron": ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}
SIDE, ROOM = 3.6, 0.05  # inches of a panel; margin, over the size of the mesh
PLAIN = "#9db4c8"  # colour without a temperature


def outside(mesh: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Corners (m, k) of the faces that belong to one cell only, and these cells (m,); lines and surfaces: the cells."""
    if mesh.kind not in FACES:
        return mesh.cells, np.arange(len(mesh.cells))
    faces = np.concatenate([mesh.cells[:, corners] for corners in FACES[mesh.kind]])
    owner = np.tile(np.arange(len(mesh.cells)), len(FACES[mesh.kind]))
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    alone = np.sort(first[count == 1])
    return faces[alone], owner[alone]


class Surface:
    """The outside of a mesh, or its lines, in axes of three dimensions; what is flat is seen from above.

    faces : (m, k), points of each face. points : all that are to be seen, (n, 3). heat : coldest and hottest colour.
    """

    def __init__(
        self, ax: Any, faces: NDArray[np.int64], points: NDArray[np.float64], heat: tuple[float, float]
    ) -> None:
        from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

        self.faces, lines = faces, faces.shape[1] == 2
        look: Any = {"linewidths": 3.0} if lines else {"edgecolors": "#333333", "linewidths": 0.3}
        kind: Any = Line3DCollection if lines else Poly3DCollection
        self.drawn = kind(np.zeros((*faces.shape, 3)), cmap="coolwarm", clim=heat, **look)
        self.put: Any = self.drawn.set_segments if lines else self.drawn.set_verts
        ax.add_collection3d(self.drawn)
        low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
        room = ROOM * (high - low).max() + 1e-300
        ax.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room),
               zlim=(low[2] - room, high[2] + room), xlabel="x", ylabel="y")  # fmt: skip
        ax.set_box_aspect(high - low + 2 * room)
        ax.tick_params(labelsize=6)
        if high[2] == low[2]:
            ax.view_init(90, -90)
            ax.set_proj_type("ortho")
            ax.set_zticks([])

    def show(self, points: NDArray[np.float64], heat: Any) -> None:
        """The points (n, 3) there, each face with its temperature (m,); None: of one colour."""
        self.put(points[self.faces])
        if heat is None:
            self.drawn.set_color(PLAIN)
        else:
            self.drawn.set_array(heat)


def draw(run: Trajectory, mesh: Any, records: Iterable[Any], path: Path) -> Path:
    """Write the picture: .png, .svg or .pdf. records : as of `fields.records`, of every state."""
    from matplotlib.figure import Figure

    kept = sorted({0, len(run.t) // 2, len(run.t) - 1})
    states = [state for k, state in enumerate(records) if k in kept]
    faces, owner = outside(mesh)
    heats = [heat_of(on_points, on_cells, faces, owner) for _, _, on_points, on_cells in states]
    points, colours = np.concatenate([x for _, x, _, _ in states]), colours_of(heats)
    figure = Figure(figsize=(SIDE * len(states), SIDE), layout="constrained")
    every: Any = figure.subplots(1, len(states), squeeze=False, subplot_kw={"projection": "3d"})[0]
    for ax, (t, x, _, _), heat in zip(every, states, heats, strict=True):
        ax.set_title(f"t = {t:.3g}")
        surface = Surface(ax, faces, points, colours or (0.0, 1.0))
        surface.show(x, heat)
    if colours:
        figure.colorbar(surface.drawn, ax=list(every), label="temperature θ", shrink=0.7)
    figure.suptitle(f"{run.integrator.name} on {run.scenario.name}")
    with writing(repr(str(path))), written(path) as temporary:
        figure.savefig(temporary, format=path.suffix[1:], dpi=150)
    return path


def colours_of(heats: Iterable[Any]) -> tuple[float, float] | None:
    """The coldest and the hottest of some faces' temperatures; None without any."""
    known: Any = np.concatenate([np.zeros(0), *(np.ma.compressed(x) for x in heats if x is not None)])
    return (float(known.min()), float(max(known.max(), known.min() + 1e-9))) if len(known) else None


def heat_of(on_points: Any, on_cells: Any, faces: Any, owner: Any) -> Any:
    """The temperature of each face, shape (m,): the mean of its corners, or its cell's; None without a temperature."""
    if "temperature" in on_points:
        corners: Any = np.ma.masked_invalid(on_points["temperature"].reshape(-1)[faces])
        return corners.mean(axis=1)  # fixed points have none
    return on_cells.get("temperature")[owner] if "temperature" in on_cells else None
