"""Fields on meshes for ParaView: what is read back is the run."""

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import tcbench
from tcbench.cli import main
from tcbench.errors import TcbenchError
from tcbench.plugins import find_scenario
from tcbench.runner.declared import scenario_facts
from tcbench.simulation import series
from tcbench.simulation.fields import mesh_of
from tcbench.simulation.mesh_picture import outside

meshio = pytest.importorskip("meshio")
SHORT = {"solid[n=1]": (0.2, 0.1), "ring[n=8]": (0.1, 0.05), "gas_tube[n=30]": (0.01, 0.005)}


@pytest.mark.parametrize(
    "name", ["ring[n=8]", "gas_tube[n=30]", pytest.param("solid[n=1]", marks=pytest.mark.thorough)]
)
def test_what_is_read_back_is_the_run(name, tmp_path):
    t_end, dt = SHORT[name]
    run = tcbench.simulate("midpoint_entropy", name, t_end=t_end, dt=dt)
    z = run.scenario.model.state(run.z)
    places = z.q if "solid" in name or "ring" in name else z.x[..., None]
    n, d = places.shape[1:]
    assert run.write(tmp_path / "a.xdmf") == tmp_path / "a.xdmf"
    with meshio.xdmf.TimeSeriesReader(tmp_path / "a.xdmf") as read:
        points, cells = read.read_points_cells()
        assert read.num_steps == 3 and np.allclose(points[:n, :d], places[0])
        t, on_points, on_cells = read.read_data(2)
    assert np.isclose(t, t_end) and np.allclose(points[:n, :d] + on_points["displacement"][:n, :d], places[2])
    heat = on_points if "solid" in name else {k: x[0] for k, x in on_cells.items()}
    assert np.allclose(heat["temperature"].ravel(), run.temperatures[2]) and np.allclose(heat["s"].ravel(), z.s[2])
    listed = run.write(tmp_path / "b.vtu")
    assert listed.suffix == ".pvd" and listed.read_text().count("timestep") == 3
    last = meshio.read(tmp_path / "b_00002.vtu")
    assert np.allclose(last.points[:n, :d], places[2]) and len(last.cells[0].data) == len(cells[0].data)


def test_hexahedra_have_the_corners_of_vtk_and_one_cell_for_eight_points():
    scenario = find_scenario("solid[n=1,element=hex]")
    z = np.array(scenario.z0)[None]
    mesh = mesh_of(scenario.model, z[0])
    x = scenario.model.state(z[0]).q[mesh.cells]
    assert mesh.kind == "hexahedron" and len(mesh.cells) == 3 and len(mesh.of_cell) == 24
    steps = np.roll(x[:, :4], -1, axis=1) - x[:, :4]  # around the bottom, then straight up
    assert np.allclose(np.abs(steps).sum(axis=2), 1) and np.allclose(x[:, 4:] - x[:, :4], (x[:, 4] - x[:, 0])[:, None])


def test_the_command_writes_fields_and_says_where(tmp_path):
    words = "simulate tc_monolithic ring[n=8] --t-end 0.1 --fields"
    done = CliRunner().invoke(main, [*words.split(), f"{tmp_path}/r.xdmf"])
    assert done.exit_code == 0 and "3 states in" in done.output and (tmp_path / "r.xdmf").exists()


def test_what_has_no_mesh_is_told(tmp_path):
    run = tcbench.simulate("tc_monolithic", "short_term", t_end=0.6)
    with pytest.raises(TcbenchError, match="no table of cells of places"):
        run.write(tmp_path / "a.xdmf")
    with pytest.raises(TcbenchError, match=r"\.xdmf .* or \.vtu, .* not to 'a.txt'"):
        run.write(tmp_path / "a.txt")


MESHES = [("ring[n=8]", 0.1, 0.05), ("net[nx=3,ny=2]", 1.0, 0.5), ("truss3d", 0.2, 0.1)]


@pytest.mark.parametrize("name, t_end, dt", MESHES)
def test_a_row_keeps_a_mesh_in_time_with_the_temperature_of_each_line(name, t_end, dt):
    """Of nets and trusses coordinates were taken for places."""
    run = tcbench.simulate("midpoint_entropy", name, t_end=t_end, dt=dt)
    kept, faces = series.row_parts(run), np.array(scenario_facts(run.scenario)["faces"])
    table = pd.DataFrame(kept["fields"])
    assert not [column for column in kept["series"] if column.startswith("at_")]  # said once
    for t, theta, z in zip(run.t, run.temperatures, run.z, strict=True):
        frame = table[np.isclose(table["t"], t)]
        assert len(faces) == len(theta) and np.allclose(frame["temperature"].dropna(), theta, rtol=1e-3)
        places = frame[[axis for axis in "xyz" if axis in frame]].dropna().to_numpy()
        q = np.asarray(run.scenario.model.state(z).q).reshape(-1, places.shape[1])
        assert np.allclose(places[: len(q)], q, rtol=1e-3, atol=1e-6) and faces.max() == len(places) - 1
    lengths = np.linalg.norm(np.diff(places[faces], axis=1), axis=2)
    assert lengths.max() < 3 * lengths.min()  # neighbours are joined


@pytest.mark.parametrize(("name", "suffix"), [("ring[n=8]", "png"), ("gas_tube[n=30]", "svg"), ("solid[n=1]", "png")])
def test_a_picture_of_the_start_the_middle_and_the_end_is_drawn(name, suffix, tmp_path):
    t_end, dt = SHORT[name]
    run = tcbench.simulate("midpoint_entropy", name, t_end=t_end, dt=dt)
    faces, owner = outside(mesh := mesh_of(run.scenario.model, run.z[0]))
    if name == "solid[n=1]":  # three cubes side by side have 14 squares for their surface, each two triangles
        assert len(faces) == 28 and set(owner) <= set(range(len(mesh.cells)))
    drawn = run.write(tmp_path / f"a.{suffix}").read_bytes()
    assert drawn[:4] == b"\x89PNG" if suffix == "png" else b"temperature" in drawn
