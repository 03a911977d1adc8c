"""Runs in motion: every frame, side by side, where a failed run stops; and what cannot be drawn says why."""

import dataclasses

import numpy as np
import pytest
from PIL import Image

import tcbench
from tcbench import TcbenchError
from tcbench.plugins import find_scenario
from tcbench.report import animation
from tcbench.simulation.series import columns, variables
from tcbench.systems.plane import drawn, joints, links, segments


@pytest.fixture(scope="module")
def runs():
    return [tcbench.simulate(m, "stiff_spring", dt=0.15, t_end=6) for m in ("midpoint_entropy", "tc_monolithic")]


@pytest.fixture(scope="module")
def stage(runs):
    """At its last frame."""
    stage = animation._Stage(runs, 10)
    stage.show(9)
    return stage


def test_every_frame_is_there_and_the_failed_run_stops_where_it_failed(runs, stage, tmp_path):
    path = tcbench.animate(runs, tmp_path / "movie.gif", frames=2)
    assert runs[0].status == "blowup" and runs[1].ok and path.stat().st_size < 2e6
    assert Image.open(path).n_frames == 2
    left, right = (view.masses.get_xydata() for view in stage.views)
    assert np.array_equal(left, stage.views[0].masses_at[-1]) and np.array_equal(right, stage.views[1].masses_at[-1])


def test_springs_stand_where_the_masses_are_and_take_the_colours_of_their_temperatures(runs, stage):
    model, z = runs[1].scenario.model, runs[1].z
    place = segments(model, z[:, :4])
    assert links(model) == [[0, 1], [1, 2]] and place.shape == (len(z), 2, 2, 2)
    assert np.array_equal(place[:, 0, 1], z[:, :2]) and np.array_equal(place[:, 1, 1], z[:, 2:4])
    assert np.allclose(np.linalg.norm(place[:, 1, 1] - place[:, 1, 0], axis=1) ** 2, model.shapes(z)[:, 1])
    assert "temperature θ" in [ax.get_ylabel() for ax in stage.figure.axes]  # the colours have a scale
    assert np.array_equal(stage.views[1].springs.get_array(), runs[1].temperatures[stage.rows[1][9]])
    assert stage.views[0].text.get_text() == f"blowup at t = {runs[0].t[-1]:.3g}"
    line, times, values = stage.lines[1][0]
    assert np.array_equal(line.get_xdata(), times[: stage.rows[1][9] + 1]) and abs(values).max() < 1e-10


@pytest.mark.thorough
def test_an_html_page_is_one_file_without_a_network(runs, tmp_path):
    text = runs[1].animate(path=tmp_path / "movie.html", frames=2).read_text()
    assert text.count("iVBOR") == 2 and "http" not in text and "<script>" in text
    text = tcbench.animate(runs[1], frames=1)._repr_html_()  # as a notebook plays it
    assert text.startswith("<iframe srcdoc=") and text.count("iVBOR") == 1 and "http" not in text


@pytest.mark.thorough
def test_a_system_says_where_its_elements_are():
    run = tcbench.simulate("tc_monolithic", "gas_containers", t_end=3.0)
    place = segments(run.scenario.model, run.z[:, :1])
    assert np.array_equal(place[:, 0, 1, 0], run.z[:, 0]) and np.all(place[:, 1, 0, 0] == 2.0)
    stage = animation._Stage([run], 4)
    stage.show(3)
    seen = stage.views[0].masses.get_xydata().tolist()
    assert seen == [[run.z[stage.rows[0][3], 0], 0], [2, 0]]  # where a line begins, too, as on the page


@pytest.mark.thorough
def test_what_lines_only_begin_from_is_marked():
    """Of four point vortices joined to each other three had a dot."""

    def points(self, z):
        return [[(z.q, 1), (z.q, 2)], [(z.q, 1), (3, z.q)]]

    one = tcbench.scenarios()["damped_oscillator"]
    kind = type("Fork", (one.system,), {"points": points})
    stage = animation._Stage([tcbench.simulate("tc_monolithic", dataclasses.replace(one, system=kind), t_end=1.0)], 4)
    stage.show(0)
    assert len(stage.views[0].masses.get_xydata()) == 3


@pytest.mark.thorough  # compiles solids
@pytest.mark.parametrize("name", ["solid", "solid[element=hex]"])
def test_a_solid_moves_on_its_mesh_filled_by_temperature(name, tmp_path):
    pytest.importorskip("skfem")
    run = tcbench.simulate("tc_monolithic", name, dt=0.1, t_end=0.4)
    stage = animation._Stage([run], 5)
    (view,) = stage.views
    assert view.coloured and sorted(view.states) == [0, 1, 2, 3, 4]
    places = np.asarray(run.scenario.model.state(run.z[4]).q).reshape(-1, 3)
    assert np.array_equal(view.states[4][0][: len(places)], places)
    with Image.open(tcbench.animate(run, tmp_path / "a.gif", frames=3)) as movie:
        assert movie.n_frames == 3
        shown = [np.asarray(movie.convert("RGB")) for _ in map(movie.seek, (0, 2))]
    above = slice(0, shown[0].shape[0] // 2)
    assert np.any(shown[0][above] != shown[1][above])


def test_what_cannot_be_animated_is_refused_with_a_sentence(runs, tmp_path, monkeypatch):
    other = tcbench.simulate("tc_monolithic", "short_term", t_end=1.0)
    for wrong, path, message in (
        ([], "a.gif", "1 to 4 runs side by side, not 0"),
        ([*runs, other], "a.gif", "runs of one scenario, not of short_term, stiff_spring"),
        (runs, "a.avi", "written as .gif, .mp4, .html"),
        (runs, "no/folder/a.gif", "does not exist; create it first"),
    ):
        with pytest.raises(TcbenchError, match=message):
            tcbench.animate(wrong, tmp_path / path)
    monkeypatch.setattr(animation.shutil, "which", lambda name: None)
    with pytest.raises(TcbenchError, match="needs the program ffmpeg"):
        tcbench.animate(runs, tmp_path / "a.mp4")
    gas = tcbench.simulate("tc_monolithic", "gas_containers", t_end=1.0)
    monkeypatch.delattr(type(gas.scenario.model), "points")
    with pytest.raises(TcbenchError, match=r"no springs in the plane.*points\(q\)"):
        tcbench.animate(gas)


def test_the_runs_that_end_well_fill_the_frame(runs, stage):
    view, place = stage.views[1], segments(runs[1].scenario.model, runs[1].z)
    (left, right), (low, high) = view.ax.get_xlim(), view.ax.get_ylim()
    spans = np.ptp(place.reshape(-1, 2), axis=0) / (right - left, high - low)
    assert 0.8 < max(spans) <= 1


JOINTS = {
    "viscous_pendulum": [[0, 1], [1, 2]], "rubbing_piston": [[0, 1], [2, 1]], "heavy_top": [[0, 1]],
    "gas_containers": [[0, 1], [2, 1]], "short_term": [], "chain[n=3]": [[0, 1], [1, 2], [2, 3]],
    "net[nx=9,ny=9]": [],
}  # fmt: skip


@pytest.mark.parametrize("name", JOINTS)
def test_ends_that_are_always_one_point_are_one_joint(name):
    scenario = find_scenario(name)
    assert joints(scenario.model, scenario.z0)[0] == JOINTS[name]


def test_places_are_columns_and_no_variables():
    run = tcbench.simulate("tc_strang", "viscous_pendulum", t_end=3)
    told = columns(run, slice(0, 5))
    assert np.array_equal(told["at_x_2"], run.z[:5, 2]) and np.array_equal(told["at_y_1"], run.z[:5, 1])
    assert not any(name.startswith("at_") for name in variables(told))


def test_a_picture_that_fails_costs_no_run():
    class Own(tcbench.System):
        name = "own"
        variables = {"q": ()}
        energy = entropy = lambda self, z: z.q

        def points(self, z):
            return [[(0, 0), (1 / 0, z.q)]]

    scenario = tcbench.Scenario("own", Own, {}, initial={"q": 1}, t_end=1, dt=0.1)
    assert joints(scenario.model, scenario.z0) == ([], []) and drawn(scenario.model, scenario.z0, np.ones((3, 1))) == {}
