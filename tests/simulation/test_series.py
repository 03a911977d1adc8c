"""What a row keeps of a run in time: small, true to the run, and enough to draw it anywhere."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest

import tcbench
from tcbench.report.plot import plot
from tcbench.report.write_report import write_report
from tcbench.simulation import series
from tcbench.simulation.against_exact import distance_to_exact
from tcbench.studies.conservation import measure
from tcbench.systems.scenario import Scenario

pytestmark = pytest.mark.usefixtures("cells_here")

SHORT = tcbench.scenarios()["short_term"]


@pytest.mark.parametrize("steps, states, opening", [(50, 51, False), (400, 201, True), (1000, 201, True)])
def test_a_row_keeps_some_180_states_and_the_first_steps(steps, states, opening):
    run = tcbench.simulate("tc_monolithic", SHORT, dt=0.01, t_end=steps * 0.01)
    kept = series.row_parts(run)
    t = kept["series"]["t"]
    assert len(t) == states and t[0] == 0 and t[-1] == pytest.approx(run.t[-1]) and all(np.diff(t) > 0)
    assert ("opening" in kept) == opening
    if opening:
        assert np.allclose(kept["opening"]["t"], run.t[: series.POINTS + 1])
        assert np.allclose(kept["opening"]["x_2"], run.z[: series.POINTS + 1, 2], rtol=1e-8)
    assert len(json.dumps(kept)) < 60_000


def test_what_is_kept_is_the_run_to_nine_digits_and_its_losses_to_six():
    run = tcbench.simulate("midpoint_temperature", SHORT, dt=0.05)
    whole, kept = series.trajectory(run), pd.DataFrame(series.row_parts(run)["series"])
    rows = np.searchsorted(run.t, kept["t"] - 1e-9)
    for name in kept.columns.drop("exact_error"):
        lost = name.endswith(("_error", "_fall", "_rise"))
        assert np.allclose(kept[name], whole[name].iloc[rows], rtol=6e-6 if lost else 6e-9, atol=0), name
    assert kept["entropy_fall"].max() >= 0 and kept["energy_error"].max() > 1e-6
    # the largest error in a row's other columns is at least what its series shows
    assert kept["angular_momentum_error"].max() <= 1.00001 * run.summary.invariant_error_max["angular_momentum"] / abs(
        run.angular_momentum[0]
    )


def test_a_failed_run_ends_where_it_failed_and_no_column_is_empty():
    run = tcbench.simulate("midpoint_entropy", "stiff_spring")
    kept = series.row_parts(run)["series"]
    assert kept["t"][-1] == pytest.approx(run.t[-1]) and len(kept["t"]) == len(run.t)
    gas = series.row_parts(tcbench.simulate("tc_monolithic", "gas_containers"))["series"]
    assert "angular_momentum" not in gas and len(gas["q_1"]) == len(gas["t"])
    assert all(np.isfinite(values).all() for name, values in gas.items() if name != "exact_error")
    known = np.isfinite(gas["exact_error"])
    assert (known == (np.array(gas["t"]) <= 25.0001)).all()  # as far as the exact motion is known


def test_of_many_temperatures_the_range_and_the_mean_are_kept_and_drawn_as_a_band():
    """The page of a net showed its laws alone."""
    run = tcbench.simulate("tc_monolithic", "net[nx=5,ny=5]", dt=0.1, t_end=1.0)
    kept, theta = series.row_parts(run)["series"], run.temperatures
    assert theta.shape[1] == 42 and "temperature_a" not in kept
    for end, of in series.ENDS.items():
        assert np.allclose(kept[f"temperature_{end}"], of(theta, axis=1), rtol=1e-8)
    (ax,) = tcbench.draw("in-time", run).axes
    assert ax.get_title(loc="left") == "temperature: mean, least to largest" and len(ax.collections) == 1


def test_the_distance_from_the_exact_motion_is_that_from_a_finer_run():
    run, fine = (tcbench.simulate(m, SHORT, **how) for m, how in (("midpoint_entropy", {"dt": 0.1}), ("tc_auto", {})))
    exact = tcbench.simulate("tc_auto", SHORT, tolerance=1e-12, times=run.t[1:])
    wanted = (np.abs(run.z - exact.z) / np.maximum(run.scenario.model.state_magnitudes, np.abs(exact.z))).max(axis=1)
    assert np.allclose(distance_to_exact(run), wanted, rtol=1e-4, atol=1e-8) and distance_to_exact(fine).max() < 1e-5


def test_only_the_scenarios_own_step_and_steps_off_the_ladder_are_kept():
    method, peer = tcbench.integrators()["tc_monolithic"], tcbench.integrators()["scipy_dop853"]
    scenario = SHORT.replace(t_end=2.0)
    kept = {f: "series" in measure(method, scenario, {"dt": f * scenario.dt}) for f in (*scenario.ladder, 0.7)}
    assert kept == {f: f in (1.0, 0.7) for f in kept}
    assert [t for t in (1e-3, 1e-6, 1e-9) if "series" in measure(peer, scenario, {"tolerance": t})] == [1e-6]


def test_a_published_folder_is_drawn_without_simulating_and_without_plugins(tmp_path, monkeypatch):
    methods, scenarios = ["tc_monolithic", "scipy_dop853"], ["short_term", "gas_containers"]
    results = tcbench.run(methods, scenarios, ["conservation"], output=tmp_path / "run", dt=[0.3])
    table = results.tables["series"]
    assert set(table["integrator"]) == set(methods) and not table["integrator"].isna().any()
    assert "series" not in results.tables["conservation"] and "opening" not in results.tables["conservation"]
    published = tmp_path / "published"
    shutil.copytree(tmp_path / "run" / "tables", published / "tables")
    for path in (published / "tables").glob("*.parquet"):
        path.unlink()

    def never(*args, **kwargs):
        raise AssertionError("a report simulates nothing and asks for no plugin")

    from tcbench import plugins
    from tcbench.simulation import run as simulation

    monkeypatch.setattr(simulation, "simulate", never)
    monkeypatch.setattr(Scenario, "model", property(never))
    monkeypatch.setattr(plugins, "_REGISTRY", plugins.Registry())
    for folder, kind in ((tmp_path / "run", "laws"), (published, "four-panel"), (published, "path")):
        out = plot(kind, folder, folder / f"{kind}.svg", scenario="short_term")
        assert out.stat().st_size > 10_000
    page = write_report(published).read_text("utf-8")
    assert 'id="table-series"' in page
