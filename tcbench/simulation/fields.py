"""A run as fields on its mesh: as XDMF, as VTU files with a PVD that lists them (by meshio), or as a picture."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import TcbenchError, needs_folder, unknown_name, writing
from ..fem import needed
from ..systems.over_spaces import space_of
from .mesh_picture import SUFFIXES, draw, heat_of, outside

if TYPE_CHECKING:
    from ..systems.system import System
    from .trajectory import Trajectory

CELLS = {  # (components of a point, columns of a table) -> meshio's kind of cell, number of its corners
    **{(d, 2): ("line", 2) for d in (1, 2, 3)},
    (2, 3): ("triangle", 3), (2, 6): ("triangle", 3), (2, 4): ("quad", 4), (2, 9): ("quad", 4),
    (3, 3): ("triangle", 3), (3, 4): ("tetra", 4), (3, 10): ("tetra", 4), (3, 8): ("hexahedron", 8),
}  # fmt: skip
HEXAHEDRA = (
    [0, 1, 2, 3, 4, 5, 6, 7],
    [0, 2, 5, 1, 3, 6, 7, 4],
    [0, 1, 4, 2, 3, 5, 7, 6],
)  # corner orders in use, VTK's first
MAX_FACES = 2_000  # of a mesh whose fields rows keep
NUMBERS, DIGITS = 4_000, 4  # that a row keeps of them, and the digits of each
AROUND = [
    (1, 3, 4),
    (2, 0, 5),
    (3, 1, 6),
    (0, 2, 7),
    (7, 5, 0),
    (4, 6, 1),
    (5, 7, 2),
    (6, 4, 3),
]  # neighbours of each corner of a hexahedron


class Mesh(NamedTuple):
    """The mesh on which a run has its fields."""

    places: str  # variable of the moving points
    fixed: NDArray[np.float64]  # (m, d): points that follow the moving ones
    kind: str  # meshio's kind of cell
    cells: NDArray[np.int64]  # (cells, corners): numbers of points
    source: str  # space of the table's rows
    target: str  # space of the moving points
    of_cell: NDArray[np.int64]  # (rows,): the cell of each row of the table


def mesh_of(model: System, z0: Any, table: str | None = None) -> Mesh:
    """The mesh of the first table, or of the one of this name, whose rows are cells of points; z0 of shape (size,).

    TcbenchError for an unknown table, and where there is none.
    """
    declared = type(model).declared_variables()
    moving = {
        space_of(d): (name, int(np.prod(d[1:], dtype=int)))
        for name, d in declared.items()
        if name in ("q", "x") and space_of(d) and d[1:] in ((), (1,), (2,), (3,))
    }
    if table is not None and table not in model.tables:
        raise unknown_name(f"table of {model.name!r}", table, model.tables)
    flat = getattr(model, "dimension", 1)  # of networks: the coordinates of a point follow each other
    for name, (source, *columns, target) in model.tables.items():
        first, *others = target.split("+")
        if name != (table or name) or first not in moving or len(columns) != 1 or source == first:
            continue
        variable, components = moving[first]
        components, count, first = (flat, columns[0] / flat, "point") if flat > 1 else (components, columns[0], first)
        behind = [_places_of(model, space, components, flat) for space in others]
        if (components, count) not in CELLS or any(x is None for x in behind):
            continue
        kind, corners = CELLS[components, count]
        rows = np.asarray(getattr(model, name))[:, ::flat][:, :corners] // flat
        new = np.r_[True, np.any(rows[1:] != rows[:-1], axis=1)]  # points of one element follow each other
        fixed = np.concatenate([np.zeros((0, components)), *behind])
        mesh = Mesh(variable, fixed, kind, rows[new], source, first, np.cumsum(new) - 1)
        return mesh._replace(cells=_in_order(mesh, points_at(model, z0, mesh)))
    raise TcbenchError(
        f"{model.name!r} has no table of cells of places: a variable q or x over a space, of one to three components, "
        f"and a table of 2, 3, 4 or 8 of them for each element. Its tables: {', '.join(model.tables) or 'none'}."
    )


def _places_of(model: Any, space: str, components: int, flat: int) -> Any:
    """The constant that holds the fixed points of a space, shape (m, components), or None."""
    for name, d in type(model).constants.items():
        if space_of(d) == space and int(np.prod(d[1:], dtype=int)) == (1 if flat > 1 else components):
            return np.reshape(getattr(model, name), (-1, components))
    return None


def points_at(model: System, z: Any, mesh: Mesh) -> NDArray[np.float64]:
    """All points of the mesh at the state z (size,), shape (n, d)."""
    q = np.asarray(getattr(model.state(z), mesh.places))
    return np.concatenate([q.reshape(-1, mesh.fixed.shape[1]), mesh.fixed])


def _in_order(mesh: Mesh, points: NDArray[np.float64]) -> NDArray[np.int64]:
    """The cells with their corners in VTK's order: in the right order no corner has a negative volume."""
    if mesh.kind != "hexahedron":
        return mesh.cells
    for order in HEXAHEDRA:
        x = points[mesh.cells[0][order]]
        volumes = [np.linalg.det(x[list(around)] - x[corner]) for corner, around in enumerate(AROUND)]
        if min(volumes) > 0:
            return mesh.cells[:, order]
        if max(volumes) < 0:
            return mesh.cells[:, [*order[4:], *order[:4]]]
    raise TcbenchError("The corners of the elements are in an order that is not known.")


def _three(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vectors of the plane or the line as vectors (m, 3)."""
    return np.pad(x, [(0, 0), (0, 3 - x.shape[1])]) if x.ndim == 2 and x.shape[1] < 3 else x


def records(
    run: Trajectory, mesh: Mesh, rows: Iterable[int] | None = None
) -> Iterator[tuple[float, Any, dict[str, Any], dict[str, Any]]]:
    """Of each recorded state, or of `rows`: time, points (n, 3), fields by name of the points and of the cells."""
    model, count = run.scenario.model, len(mesh.cells)
    declared, weight = type(model).declared_variables(), np.bincount(mesh.of_cell)
    start, behind = points_at(model, run.z[0], mesh), len(mesh.fixed)
    sizes = {mesh.target: len(start) - behind, mesh.source: len(mesh.of_cell)}

    def of_points(x: Any) -> Any:
        x = np.asarray(x, dtype=float)
        return _three(np.concatenate([x, np.full((behind, *x.shape[1:]), np.nan)]).reshape(len(start), *x.shape[1:]))

    def of_cells(x: Any) -> Any:
        x = np.asarray(x, dtype=float).reshape(len(mesh.of_cell), -1)
        mean = np.stack([np.bincount(mesh.of_cell, column, count) for column in x.T], axis=1) / weight[:, None]
        return mean[:, 0] if x.shape[1] == 1 else mean

    for k in range(len(run.t)) if rows is None else rows:
        z, points = model.state(run.z[k]), points_at(model, run.z[k], mesh)
        on_points, on_cells = {"displacement": _three((points - start).reshape(len(points), -1))}, dict[str, Any]()
        fields = {n: (space_of(d), getattr(z, n)) for n, d in declared.items() if n != mesh.places}
        theta = run.temperatures[k]
        own = space_of(declared.get("s", ()))  # temperatures are those of what has entropies, where both are as many
        heated = sorted((s for s in sizes if len(theta) == sizes[s]), key=lambda s: s != own)
        fields |= {"temperature": (heated[0], theta)} if len(theta) and heated else {}
        for name, (space, x) in fields.items():
            if space == mesh.target:
                on_points[name] = of_points(x)
            elif space == mesh.source:
                on_cells[name] = of_cells(x)
        yield float(run.t[k]), _three(points), on_points, on_cells


def faces_of(model: System, z0: Any) -> tuple[Mesh, NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]] | None:
    """The mesh, its points on the outside (n,), and of each outer face the corners among these (m, k) and the
    cell (m,). None without a mesh, with more than MAX_FACES faces, and of a line, which has a picture of its own."""
    try:
        mesh = mesh_of(model, z0)
    except TcbenchError:
        return None
    if mesh.fixed.shape[1] == 1 and model.defines("points"):
        return None
    faces, owner = outside(mesh)
    seen, corners = np.unique(faces, return_inverse=True)
    return (mesh, seen, corners.reshape(faces.shape), owner) if len(faces) <= MAX_FACES else None


def mesh_columns(run: Trajectory) -> dict[str, list[float | None]]:
    """Columns of the mesh at some times, NUMBERS numbers or two states: `t`, `number`, the point `x`, `y`, `z` of that
    number and the `temperature` of the face of that number; None beyond the last point or face. {} without a mesh."""
    if (mesh_faces := faces_of(run.scenario.model, run.z[0])) is None:
        return {}
    mesh, seen, faces, owner = mesh_faces
    many = max(2, NUMBERS // (len(faces) + len(seen) * mesh.fixed.shape[1]))
    frames, size = [], max(len(seen), len(faces))
    for t, x, on_points, on_cells in records(run, mesh, np.unique(np.linspace(0, len(run.t) - 1, many).astype(int))):
        frame = np.full((size, 6), np.nan)
        frame[:, 0], frame[:, 1], frame[: len(seen), 2:5] = t, np.arange(size), x[seen]
        if (heat := heat_of(on_points, on_cells, seen[faces], owner)) is not None:
            frame[: len(faces), 5] = np.ma.filled(heat, np.nan)
        frames.append(frame)
    table = dict(zip(("t", "number", "x", "y", "z", "temperature"), np.concatenate(frames).T, strict=True))
    table = {n: of for n, of in table.items() if np.isfinite(of).any() and (n not in "yz" or of[of == of].any())}
    return {n: [float(f"{v:.{DIGITS}g}") if np.isfinite(v) else None for v in of.tolist()] for n, of in table.items()}


def write(run: Trajectory, path: str | Path, table: str | None = None) -> Path:
    """See `Trajectory.write`."""
    path = Path(path)
    if path.suffix not in (".xdmf", ".vtu", *SUFFIXES):
        raise TcbenchError(
            "Fields are written to .xdmf (all times in one file) or .vtu, or drawn as .png, .svg or .pdf, not to "
            f"{path.name!r}."
        )
    needs_folder(path)
    mesh = mesh_of(run.scenario.model, run.z[0], table)
    if path.suffix in SUFFIXES:
        return draw(run, mesh, records(run, mesh), path)
    meshio = needed("meshio", "meshio")
    cells = [(mesh.kind, mesh.cells)]
    with writing(repr(str(path))):
        if path.suffix == ".xdmf":
            start = _three(points_at(run.scenario.model, run.z[0], mesh))
            with meshio.xdmf.TimeSeriesWriter(str(path), data_format="XML") as series:
                series.write_points_cells(start, cells)
                for t, _, on_points, on_cells in records(run, mesh):
                    series.write_data(t, point_data=on_points, cell_data={n: [x] for n, x in on_cells.items()})
            return path
        lines = []
        for k, (t, points, on_points, on_cells) in enumerate(records(run, mesh)):
            one = path.with_name(f"{path.stem}_{k:05d}.vtu")
            meshio.Mesh(points, cells, on_points, {n: [x] for n, x in on_cells.items()}).write(str(one))
            lines.append(f'<DataSet timestep="{t!r}" part="0" file="{one.name}"/>')
        listed = path.with_suffix(".pvd")
        text = "\n".join(['<VTKFile type="Collection" version="0.1"><Collection>', *lines, "</Collection></VTKFile>"])
        listed.write_text(text + "\n", encoding="utf-8")
        return listed
