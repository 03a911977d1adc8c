"""Charts: a table in, a Figure out, whatever the table holds; and the same look for an integrator everywhere."""

from pathlib import Path

import awkward
import matplotlib
import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

import tcbench
from tcbench.errors import TcbenchError
from tcbench.report import page_charts, plot
from tcbench.report.chart_kinds import kinds
from tcbench.report.charts import ladders, precision
from tcbench.report.charts import runs as time_charts
from tcbench.report.charts.layout import line_labels, panels, spread
from tcbench.report.charts.scales import ROUND_OFF, power_text, zero_log_axis
from tcbench.report.charts.style import COLOURS, KNOWN, look
from tcbench.simulation import series

METHODS = {
    "with peers": [*awkward.FIVE, *awkward.PEERS],
    "one": ["tc_monolithic"],
    "forty": awkward.FORTY,
    "hostile": ["tc_monolithic", awkward.HOSTILE, "x" * 10_000],
}


def draw(name, methods):
    t = awkward.everything(methods, ["short_term"])
    return {
        "work_precision": lambda: precision.work_precision(t["work_precision"]),
        "convergence": lambda: precision.convergence(t["convergence_points"], t["convergence"]),
        "conservation": lambda: ladders.conservation(t["conservation"]),
        "blowup": lambda: ladders.blowup(t["stability_points"], t["blowup_sensitivity"]),
        "stable_step": lambda: ladders.stable_step(t["stability"]),
        "equilibrium": lambda: time_charts.equilibrium(t["equilibrium"]),
    }[name]()


CHARTS = ["work_precision", "convergence", "conservation", "blowup", "stable_step", "equilibrium"]


@pytest.mark.thorough
@pytest.mark.parametrize("methods", METHODS.values(), ids=METHODS)
@pytest.mark.parametrize("name", CHARTS)
def test_a_chart_draws_any_number_of_methods(name, methods, tmp_path):
    figure = draw(name, methods)
    assert isinstance(figure, Figure)
    figure.savefig(tmp_path / "chart.png", dpi=40)


@pytest.mark.parametrize("name", CHARTS)
@pytest.mark.parametrize("rows", ["all NaN", "none"])
def test_a_chart_of_nothing_is_drawn_and_not_an_error(name, rows, tmp_path):
    tables = awkward.everything(awkward.FIVE, ["short_term"])
    for key, table in tables.items():
        numbers = table.select_dtypes("number").columns
        tables[key] = table.assign(**dict.fromkeys(numbers, np.nan)) if rows == "all NaN" else table.iloc[:0]
    figure = {
        "work_precision": lambda: precision.work_precision(tables["work_precision"]),
        "convergence": lambda: precision.convergence(tables["convergence_points"], tables["convergence"]),
        "conservation": lambda: ladders.conservation(tables["conservation"]),
        "blowup": lambda: ladders.blowup(tables["stability_points"]),
        "stable_step": lambda: ladders.stable_step(tables["stability"]),
        "equilibrium": lambda: time_charts.equilibrium(tables["equilibrium"]),
    }[name]()
    figure.savefig(tmp_path / "chart.png", dpi=40)


def crosses(figure):
    return sum(len(line.get_xdata()) for ax in figure.axes for line in ax.lines if line.get_marker() == "x")


def test_failed_cells_are_drawn_not_dropped():
    table = awkward.conservation(["midpoint_entropy"], ["s"], failing=lambda name, h: h > 0.2)
    assert table["status"].ne("ok").sum() == 3
    assert crosses(ladders.conservation(table)) == 3 * 3  # three panels
    fits, points = awkward.convergence(["tc_strang"], ["s"], failing=["tc_strang"])
    assert crosses(precision.convergence(points, fits)) == len(points)
    work = awkward.work_precision(["midpoint_temperature"], ["stiff_spring"])
    assert crosses(precision.work_precision(work, y=["error_q"])) == work["status"].ne("ok").sum() == 2


def test_points_outside_the_fit_are_hollow_and_the_slope_is_written():
    fits, points = awkward.convergence(["tc_monolithic"], ["s"])
    ax = precision.convergence(points, fits).axes[0]
    hollow = [line for line in ax.lines if line.get_markerfacecolor() == "none" and line.get_marker() == "o"]
    assert len(hollow[0].get_xdata()) == (~points["used"] & (points["variable"] == "q")).sum()
    assert [text.get_text() for text in ax.texts] == ["2.00"]
    line = next(line for line in ax.lines if line.get_linestyle() == "-")  # the number stands at the end of its line
    assert ax.texts[0].xy == pytest.approx((line.get_xdata()[-1], line.get_ydata()[-1]))


def test_an_integrator_looks_the_same_everywhere_and_the_five_of_the_paper_differ():
    assert look("scipy_radau") == look("scipy_radau") != look("cvode_bdf")
    assert len({s.colour for s in KNOWN.values()}) == len({s.marker for s in KNOWN.values()}) == len(KNOWN)
    assert not {s.colour for s in KNOWN.values()} & set(COLOURS)
    assert look("midpoint_temperature[reading=rate]").colour == look("midpoint_temperature").colour


def test_neighbouring_methods_differ_in_grey():
    """On a black-and-white page colour is gone: marker or dash must tell methods apart."""
    assert len({(s.marker, str(s.dash)) for s in KNOWN.values()}) == len(KNOWN)
    for colour in [*(s.colour for s in KNOWN.values()), *COLOURS]:
        luminance = np.dot(to_rgb(colour), [0.2126, 0.7152, 0.0722])
        assert 0.1 < luminance < 0.75  # neither lost on white nor taken for the axes


def test_the_axis_of_magnitudes_shows_round_off_zero_and_a_blow_up_together():
    figure, (ax,) = panels(1)
    zero_log_axis(ax, [0.0, 1e-15, 1e3])
    ticks = ax.get_yticks()
    assert ticks[0] == 0 and min(ticks[1:]) == ROUND_OFF and max(ticks) >= 1
    places = [(0, y) for y in (0.0, 1e-15, ROUND_OFF, 1e-6, 1e3)]
    heights = ax.transAxes.inverted().transform(ax.transData.transform(places))[:, 1]
    assert np.all(np.diff(heights)[1:] > 0.03) and heights[0] >= 0 and heights[-1] <= 1
    assert heights[1] - heights[0] < 1e-3  # round-off is one place, in a grey band
    band = ax.patches[0].get_bbox()
    assert band.y0 <= 0 and band.y1 == ROUND_OFF
    assert (
        len(figure.axes) == 1 and power_text(1e-15) == "10⁻¹⁵" and power_text(0.0) == "0" and power_text(0.2) == "0.2"
    )


def test_labels_are_pushed_apart_and_stay_inside():
    placed = spread([0.5, 0.5, 0.51, 0.99], 0.1, 0.0, 1.0)
    assert np.all(np.diff(placed) > 0.0999) and placed[0] >= 0 and placed[-1] <= 1
    assert spread([], 0.1, 0, 1) == []


def test_charts_leave_the_settings_of_matplotlib_alone():
    before = dict(matplotlib.rcParams)
    draw("conservation", awkward.FIVE)
    assert dict(matplotlib.rcParams) == before


@pytest.fixture(scope="module")
def runs():
    return [tcbench.simulate(name, "stiff_spring") for name in ("tc_monolithic", "midpoint_entropy")]


def test_the_series_of_a_run_measures_the_laws(runs):
    good, bad = (series.trajectory(run) for run in runs)
    assert good["energy_error"].max() < 1e-12 and good["entropy_fall"].max() < 1e-12
    assert bad["energy_error"].max() > 1 and bad["status"].eq("blowup").all()
    z = runs[0].z
    assert np.allclose(good["strain_a"], np.log(np.hypot(z[:, 0], z[:, 1]) / 2))
    assert np.allclose(good["x_2"], z[:, 2]) and np.allclose(good["temperature_b"], runs[0].temperatures[:, 1])


@pytest.mark.parametrize("name", ["laws", "four_panel", "path"])
def test_charts_of_runs_mark_where_a_run_failed(name, runs, tmp_path):
    figure = getattr(time_charts, name)(series.trajectories(runs))
    figure.savefig(tmp_path / "chart.png", dpi=40)
    if name != "path":
        assert crosses(figure) >= 4
    assert isinstance(getattr(time_charts, name)(series.trajectories([])), Figure)


GENERAL = {"system of three numbers": "rigid_body", "temperatures, and no springs": "viscous_pendulum"}


@pytest.mark.parametrize("scenario", GENERAL.values(), ids=GENERAL)
def test_charts_of_a_general_system_speak_of_its_own_variables(scenario, runs, tmp_path):
    """Also where the table has runs of springs beside: their columns are empty for this system."""
    both = series.trajectories([*runs, tcbench.simulate("tc_monolithic", scenario, t_end=1.0)])
    mine = both[both["scenario"] == scenario]
    figure = time_charts.four_panel(mine)
    figure.savefig(tmp_path / "chart.png", dpi=40)
    last = figure.axes[3]
    words = [text.get_text() for text in last.get_legend().get_texts()]
    assert last.get_title(loc="left").startswith("variables") and last.lines
    assert words == (["m0", "m1", "m2"] if scenario == "rigid_body" else ["q0", "q1", "q2", "q3", "p0", "p1"])
    assert "spring" not in "".join(t.get_text() for ax in figure.axes for t in ax.findobj(matplotlib.text.Text))
    if scenario == "rigid_body":
        with pytest.raises(TcbenchError, match=r"points\(z\)"):
            time_charts.path(mine)


def test_errors_of_every_variable_get_a_panel_and_those_of_none_do_not():
    table = awkward.everything(["tc_monolithic"], ["short_term"])["work_precision"].drop(columns=["error_q", "error_s"])
    table["error_p"], table["error_m"], table["error_entropy_produced"] = np.nan, 1e-3, 1e-3
    labels = [ax.get_ylabel() for ax in precision.work_precision(table).axes]
    assert "error of m" in labels and not [x for x in labels if "momenta" in x or "produced" in x]


@pytest.mark.parametrize("suffix", [".svg", *(pytest.param(x, marks=pytest.mark.thorough) for x in (".png", ".pdf"))])
def test_plot_writes_each_format_from_runs_and_from_a_folder(suffix, runs, tmp_path):
    path = plot.plot("four-panel", runs, tmp_path / f"a{suffix}")
    assert path.read_bytes()[:4] in (b"\x89PNG", b"<?xm", b"%PDF")
    folder = awkward.write_run(tmp_path / "run", awkward.everything(awkward.FIVE))
    for kind in ("work-precision", "convergence", "conservation", "blowup") if suffix == ".png" else ("conservation",):
        assert plot.plot(kind, folder, tmp_path / f"{kind}{suffix}", scenario="short_term").stat().st_size > 1000
    assert plot.plot("stable-step", folder, tmp_path / f"s{suffix}").stat().st_size > 1000


def test_plot_says_what_is_wrong(runs, tmp_path):
    folder = awkward.write_run(tmp_path / "run", {"conservation": awkward.conservation(["nobody"])})
    out = tmp_path / "a.png"
    for message, call in {
        "Did you mean 'laws'": lambda: plot.plot("law", folder, out),
        "Which scenario": lambda: plot.plot("conservation", folder, out),
        "Did you mean 'short_term'": lambda: plot.plot("conservation", folder, out, scenario="short_tern"),
        "written as .png": lambda: plot.plot("conservation", folder, "a.gif"),
        "does not exist": lambda: plot.plot("conservation", folder, tmp_path / "no" / "a.png"),
        "needs the table 'stability'": lambda: plot.plot("stable-step", folder, out),
        "tcbench map INTEGRATOR SCENARIO makes it": lambda: plot.plot("map", folder, out),
        "study conservation does": lambda: plot.plot("laws", folder, out),
        "give its folder": lambda: plot.plot("conservation", runs, out),
        "No integrator of this run": lambda: plot.plot("conservation", folder, out, methods=["x"]),
        "There is no run": lambda: plot.plot("conservation", tmp_path / "nothing", out),
    }.items():
        with pytest.raises(TcbenchError, match=message):
            call()
    assert not out.exists()


def test_work_precision_takes_any_columns_as_axes(tmp_path):
    folder = awkward.write_run(tmp_path / "run", {"work_precision": awkward.work_precision(awkward.FIVE)})
    options = {"scenario": "short_term", "x": "steps", "y": ["error_s", "newton_iterations"]}
    assert plot.plot("work-precision", folder, tmp_path / "a.svg", **options).read_text().count("entropies s") == 1
    with pytest.raises(TcbenchError, match="Did you mean 'steps'"):
        plot.plot("work-precision", folder, tmp_path / "a.svg", **(options | {"x": "step"}))
    del options["x"]  # one axis alone
    assert "wall time" in plot.plot("work-precision", folder, tmp_path / "b.svg", **options).read_text()


def test_every_kind_of_chart_has_a_study_and_a_text():
    for kind in kinds().values():
        assert kind.study and kind.text.endswith(".") and kind.needs
        assert not kind.possible({}) and not kind.possible({name: pd.DataFrame() for name in kind.needs})


def test_a_method_need_not_be_in_every_table_to_be_drawn(tmp_path):
    # its table of blow-ups has the midpoint rules only
    baseline = Path(__file__).parents[2] / "results" / "baseline"
    target = tmp_path / "one.png"
    assert plot.plot("conservation", baseline, target, scenario="long_term", methods=["tc_monolithic"]).exists()
    with pytest.raises(TcbenchError, match="No integrator of this run is called 'mine'"):
        plot.plot("conservation", baseline, target, scenario="long_term", methods=["mine"])
    with pytest.raises(TcbenchError, match="no numbers to draw"):
        plot.plot("conservation", baseline, target, scenario="long_term", x="status")


@pytest.mark.parametrize("name", ["work_precision", "convergence", "conservation", "stable_step"])
def test_the_page_selects_from_a_table_once_and_not_once_a_line(name, monkeypatch):
    counts = []
    selected = (pd.DataFrame, "__getitem__"), (pd.Series, "__getitem__"), (pd.Series, "take"), (pd.DataFrame, "take")
    for methods in (awkward.FIVE, awkward.FORTY):
        tables, seen = awkward.everything(methods, ["short_term"]), []
        with monkeypatch.context() as patch:
            for owner, method in selected:
                own = getattr(owner, method)
                patch.setattr(owner, method, lambda *a, own=own, seen=seen, **k: seen.append(1) or own(*a, **k))
            assert page_charts.panels_of([kinds()[name.replace("_", "-")]], tables, {}, problems := [])
        assert not problems
        counts.append(len(seen))
    assert counts[1] == counts[0]


def test_a_name_at_the_end_of_a_line_below_the_axes_stands_inside_of_them():
    _, (ax,) = panels(1)
    ax.set_ylim(0, 1)
    line_labels(ax, [(0.5, -1.0, "below", "k"), (0.5, -0.9, "both", "k")])
    heights = sorted(ax.transData.transform(text.xy)[1] for text in ax.texts)
    assert heights[0] > ax.get_window_extent().y0 and heights[1] - heights[0] > 5


def test_a_large_array_is_a_band_and_not_a_panel_a_number():
    """A bar of 12 masses had 30 charts of five lines."""
    t = np.linspace(0, 1, 20)
    rows = {"integrator": "a", "scenario": "bar", "dt": 0.05, "status": "ok", "t": t, "energy": 1.0, "entropy": t}
    table = pd.DataFrame(rows | {f"q{k}": k * t for k in range(12)} | {"m0": t, "m1": -t})
    panels_ = time_charts.in_time.__wrapped__(table).panels
    assert [panel.title for panel in panels_] == ["m0", "m1", "q: mean of 12, least to largest"]
    (line,) = panels_[2].series
    assert (line.low[-1], line.y[-1], line.high[-1]) == (0.0, 5.5, 11.0)


def test_a_column_that_is_no_error_has_an_axis_of_its_own():
    """A plugin's column of 0.05 was drawn as an error, a line at the top of fourteen decades, and falls of the Lyapunov
    functional as rises of it."""
    row = {"integrator": "a", "scenario": "s", "status": "ok", "newton_iterations_mean": 2.0}
    rows = [row | {"dt": h, "mine": -h, "wide": h**3, "lyapunov_increment_max": -h} for h in (0.1, 0.2, 0.4)]
    asked = {"mine": "linear", "wide": "log", "newton_iterations_mean": "linear", "lyapunov_increment_max": "zero"}
    made = ladders.conservation.__wrapped__(pd.DataFrame(rows), y=[*asked]).panels
    assert [panel.y_scale for panel in made] == [*asked.values()]
    assert [panel.errors for panel in made] == [False, False, False, True]
    assert [list(np.asarray(panel.series[0].y)) for panel in made[::3]] == [[-0.1, -0.2, -0.4], [0.0, 0.0, 0.0]]
