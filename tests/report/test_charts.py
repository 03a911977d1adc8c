"""Charts: a table in, a Figure out, whatever the table holds; the same look for a method everywhere, and who leads."""

from itertools import combinations
from pathlib import Path

import awkward
import matplotlib
import numpy as np
import pandas as pd
import pytest
from chart_tables import law_table, map_table, point_table, profile_table, share_table
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from tiers import tiers

import tcbench
from tcbench.errors import TcbenchError
from tcbench.report import highlight, page_charts, plot
from tcbench.report.charts import ensemble, ladders, precision, style, theme
from tcbench.report.charts import runs as time_charts
from tcbench.report.charts.layout import name_lines, panels, spread
from tcbench.report.charts.scales import ROUND_OFF, power_text, zero_log_axis
from tcbench.report.charts.style import COLOURS, FIXED, OTHER, PAPER, SKY, look
from tcbench.simulation import series

pytestmark = pytest.mark.usefixtures("cells_here")

METHODS = {
    "with peers": [*awkward.FIVE, *awkward.PEERS],
    "one": ["tc_monolithic"],
    "forty": awkward.FORTY,
    "hostile": ["tc_monolithic", awkward.HOSTILE, "x" * 10_000],
}
CHARTS = {  # the chart -> its tables, of those of a full run, or the function that makes its one
    precision.work_precision: ["work_precision"],
    precision.convergence: ["convergence_points", "convergence"],
    ladders.conservation: ["conservation"],
    ladders.blowup: ["stability_points", "blowup_sensitivity"],
    ladders.stable_step: ["stability"],
    time_charts.equilibrium: ["equilibrium"],
    ensemble.failure_share: share_table,
    ensemble.performance_profiles: profile_table,
    ensemble.error_time: point_table,
    ensemble.law_quantiles: law_table,
    ensemble.where_it_fails: map_table,
}
each_chart = pytest.mark.parametrize("chart", CHARTS, ids=lambda chart: chart.__name__)


def tables_of(chart, methods):
    made = CHARTS[chart]
    return [made(methods)] if callable(made) else [awkward.everything(methods, ["short_term"])[n] for n in made]


@pytest.mark.thorough
@pytest.mark.parametrize("methods", METHODS.values(), ids=METHODS)
@each_chart
def test_a_chart_draws_any_number_of_methods(chart, methods, tmp_path):
    figure = chart(*tables_of(chart, methods))
    assert isinstance(figure, Figure)
    figure.savefig(tmp_path / "chart.png", dpi=40)


OF_NOTHING = [(chart, rows) for rows in ("all NaN", "none") for chart in CHARTS]
FIRST = (precision.convergence, ladders.blowup, time_charts.equilibrium, ensemble.law_quantiles)


@pytest.mark.parametrize(("chart", "rows"), tiers(OF_NOTHING, [(chart, "all NaN") for chart in FIRST]))
def test_a_chart_of_nothing_is_drawn_and_not_an_error(chart, rows):
    (table, *_), kept = tables_of(chart, awkward.FIVE), ("runs", "without_reference", "target")
    numbers = [c for c in table.select_dtypes("number").columns if c not in kept]
    table = table.assign(**dict.fromkeys(numbers, np.nan)) if rows == "all NaN" else table.iloc[:0]
    chart(table).draw_without_rendering()


def crosses(figure):
    return sum(len(line.get_xdata()) for ax in figure.axes for line in ax.lines if line.get_marker() == "x")


def texts(figure):
    return [text.get_text() for ax in figure.axes for text in ax.texts]


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
    end = ax.transData.transform((line.get_xdata()[-1], line.get_ydata()[-1]))
    assert ax.transAxes.transform(ax.texts[0].xy) == pytest.approx(end, abs=0.5)


def test_runs_that_reached_the_end_are_hollow_above_those_that_failed():
    points = awkward.stability_points(["midpoint_entropy", "tc_monolithic"], ["s"])
    (panel,) = ladders.blowup.__wrapped__(points, awkward.sensitivity(["midpoint_entropy"], ["s"])).panels
    failed = max(np.max(one.y, initial=0.0) for one in panel.series if one.marks == "filled")
    ended = [one for one in panel.series if one.marks == "hollow"]
    assert sum(len(one.x) for one in ended) == points["status"].eq("ok").sum()
    assert min(np.min(one.y) for one in ended if len(one.y)) > failed
    (bar,) = [one for one in panel.series if len(one.low)]
    assert (bar.low[0], bar.y[0], bar.high[0]) == (5.0, 9.0, 14.0)


def test_an_integrator_looks_the_same_everywhere_and_neighbours_differ_in_print():
    assert look("scipy_radau") == look("scipy_radau") != look("cvode_bdf")
    assert len({s.colour for s in PAPER.values()}) == len({s.marker for s in PAPER.values()}) == len(PAPER)
    assert not {s.colour for s in PAPER.values()} & set(COLOURS)
    assert look("midpoint_temperature[reading=rate]").colour == look("midpoint_temperature").colour
    assert len({(s.marker, str(s.dash)) for s in PAPER.values()}) == len(PAPER)  # on paper colour is gone
    for colour in [*(s.colour for s in PAPER.values()), *COLOURS]:
        luminance = np.dot(to_rgb(colour), [0.2126, 0.7152, 0.0722])
        assert 0.1 < luminance < 0.75  # neither lost on white nor taken for the axes


def test_methods_are_told_apart_by_the_colour_blind_too():
    """They differ in marker, or in colour as a deuteranope and a protanope see it (Vienot et al. 1999)."""
    see = {
        "deuteranope": np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]]),
        "protanope": np.array([[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]]),
    }
    named = plot.run_looks(awkward.everything([*awkward.FORTY[:20], *FIXED], ["short_term"]))
    looks, fixed = list(named.values()), [i for i, name in enumerate(named) if name in FIXED]
    for who, matrix in see.items():
        seen = [np.clip(matrix @ np.array(to_rgb(one.colour)) ** 2.2, 0, 1) ** (1 / 2.2) for one in looks]
        pairs = [(i, j) for i in range(len(looks)) for j in range(i) if looks[i].marker == looks[j].marker]
        pairs += [(i, j) for i, j in combinations(fixed, 2) if looks[i].dash == looks[j].dash]  # leaders: lines, too
        assert all(np.linalg.norm(seen[i] - seen[j]) > 0.08 for i, j in pairs), who
        others = np.clip(matrix @ np.array(to_rgb(OTHER.colour)) ** 2.2, 0, 1) ** (1 / 2.2)
        away = {look.colour: np.linalg.norm(one - others) for look, one in zip(looks, seen, strict=True)}
        # none turns into the grey of "others"; the paper's sky blue is as light, and stays blue
        assert all(far > 0.35 for colour, far in away.items() if colour != SKY), who


def test_the_axis_of_magnitudes_shows_round_off_zero_and_a_blow_up_together():
    _, (ax,) = panels(1)
    zero_log_axis(ax, [0.0, 1e-15, 1e3])
    ticks = ax.get_yticks()
    assert ticks[0] == 0 and min(ticks[1:]) == ROUND_OFF and max(ticks) >= 1
    places = [(0, y) for y in (0.0, 1e-15, ROUND_OFF, 1e-6, 1e3)]
    heights = ax.transAxes.inverted().transform(ax.transData.transform(places))[:, 1]
    assert np.all(np.diff(heights)[1:] > 0.03) and heights[0] >= 0 and heights[-1] <= 1
    assert heights[1] - heights[0] < 1e-3  # round-off is one place, in a grey band
    band = ax.patches[0].get_bbox()
    assert band.y0 <= 0 and band.y1 == ROUND_OFF
    assert [power_text(value) for value in (1e-15, 0.0, 0.2)] == ["10⁻¹⁵", "0", "0.2"]


def test_names_at_lines_are_pushed_apart_and_stay_inside():
    placed = spread([0.5, 0.5, 0.51, 0.99], 0.1, 0.0, 1.0)
    assert np.all(np.diff(placed) > 0.0999) and placed[0] >= 0 and placed[-1] <= 1
    assert spread([], 0.1, 0, 1) == []
    _, (ax,) = panels(1)
    ax.set_ylim(0, 1)
    name_lines(ax, [(0.5, -1.0, "below", "k"), (0.5, -0.9, "both", "k")])
    heights = sorted(text.xy[1] for text in ax.texts)
    assert heights[0] > 0 and (heights[1] - heights[0]) * ax.get_window_extent().height > 5


def test_charts_leave_the_settings_of_matplotlib_alone():
    before = dict(matplotlib.rcParams)
    ladders.conservation(awkward.conservation(awkward.FIVE, ["short_term"]))
    assert dict(matplotlib.rcParams) == before


@pytest.fixture(scope="module")
def runs():
    return [tcbench.simulate(n, "stiff_spring", dt=0.15, t_end=6) for n in ("tc_monolithic", "midpoint_entropy")]


@pytest.mark.parametrize("name", tiers(["laws", "four_panel", "path"], ["laws"]))
def test_charts_of_runs_mark_where_a_run_failed(name, runs, tmp_path):
    figure = getattr(time_charts, name)(series.trajectories(runs))
    figure.savefig(tmp_path / "chart.png", dpi=40)
    if name != "path":
        assert crosses(figure) >= 4
    assert isinstance(getattr(time_charts, name)(series.trajectories([])), Figure)


@pytest.mark.parametrize("scenario", tiers(["rigid_body", "viscous_pendulum"], ["rigid_body"]))
def test_charts_of_a_general_system_speak_of_its_own_variables(scenario, runs):
    """Also where the table has runs of springs beside: their columns are empty for this system."""
    both = series.trajectories([*runs, tcbench.simulate("tc_monolithic", scenario, t_end=1.0)])
    mine = both[both["scenario"] == scenario]
    shown = time_charts.four_panel.__wrapped__(mine).panels[3]
    words = ["m0", "m1", "m2"] if scenario == "rigid_body" else ["q0", "q1", "q2", "q3", "p0", "p1"]
    assert shown.title.startswith("variables") and [one.text for one in shown.series] == words
    figure = time_charts.four_panel(mine)
    assert "spring" not in "".join(t.get_text() for ax in figure.axes for t in ax.findobj(matplotlib.text.Text))
    if scenario == "rigid_body":
        with pytest.raises(TcbenchError, match=r"points\(z\)"):
            time_charts.path(mine)


def test_errors_of_every_variable_get_a_panel_and_those_of_none_do_not():
    table = awkward.everything(["tc_monolithic"], ["short_term"])["work_precision"].drop(columns=["error_q", "error_s"])
    table["error_p"], table["error_m"], table["error_entropy_produced"] = np.nan, 1e-3, 1e-3
    labels = [ax.get_ylabel() for ax in precision.work_precision(table).axes]
    assert "error of m" in labels and not [x for x in labels if "momenta" in x or "produced" in x]


def test_plot_writes_pictures_of_runs_and_of_a_folder_and_says_what_is_wrong(runs, tmp_path):
    for suffix, start in ((".png", b"\x89PNG"), (".pdf", b"%PDF")):
        assert plot.plot("path", runs, tmp_path / f"a{suffix}").read_bytes()[:4] == start
    tables = {"conservation": awkward.conservation(["nobody"]), "work_precision": awkward.work_precision(["nobody"])}
    folder, out = awkward.write_run(tmp_path / "run", tables), tmp_path / "new.svg"
    for message, kind, options in (
        ("Did you mean 'laws'", "law", {}),
        ("Which scenario", "conservation", {}),
        ("Did you mean 'short_term'", "conservation", {"scenario": "short_tern"}),
        ("written as .png", "conservation", {"output": "a.gif"}),
        ("does not exist", "conservation", {"output": tmp_path / "no" / "a.png"}),
        ("needs the table 'stability'", "stable-step", {}),
        ("tcbench map INTEGRATOR SCENARIO makes it", "map", {}),
        ("study conservation does", "laws", {}),
        ("give its folder", "conservation", {"data": runs}),
        ("No integrator of this run", "conservation", {"methods": ["x"]}),
        ("There is no run", "conservation", {"data": tmp_path / "nothing"}),
        ("Did you mean 'steps'", "work-precision", {"scenario": "short_term", "x": "step"}),
        ("no numbers to draw", "conservation", {"scenario": "short_term", "x": "status"}),
    ):
        with pytest.raises(TcbenchError, match=message):
            plot.plot(kind, **({"data": folder, "output": out} | options))
    assert not out.exists()
    asked = {"scenario": "short_term", "y": ["error_s", "newton_iterations"]}
    assert "wall time" in plot.plot("work-precision", folder, out, **asked).read_text()
    assert plot.plot("work-precision", folder, out, x="steps", **asked).read_text().count("entropies s") == 1


@pytest.mark.thorough
def test_a_method_need_not_be_in_every_table_to_be_drawn(tmp_path):
    baseline = Path(__file__).parents[2] / "results" / "baseline"  # its table of blow-ups has the midpoint rules only
    options = {"scenario": "long_term", "methods": ["tc_monolithic"]}
    assert plot.plot("conservation", baseline, tmp_path / "one.png", **options).exists()


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


def test_methods_that_never_failed_are_one_line_and_too_few_runs_none():
    table = share_table(["midpoint_entropy", "tc_strang", "tc_monolithic"])
    never = table["integrator"] != "midpoint_entropy"
    table.loc[never, ["failed", "share"]], table.loc[~never, ["failed", "share"]] = [0, 0.0], [7, 0.07]
    found = texts(ensemble.failure_share(table))
    assert "midpoint_entropy" in found and "no run failed: 2 methods" in found and "tc_strang" not in found
    assert "has 5 runs" in " ".join(texts(ensemble.failure_share(table.assign(runs=4))))


def test_lines_that_are_named_have_looks_of_their_own():
    (ax,) = ensemble.failure_share(share_table(awkward.FORTY[5:])).axes
    own = [line for line in ax.lines if line.get_color() not in (style.OTHER.colour, theme.INK)]
    assert len(own) == highlight.IN_COLOUR == len({(line.get_color(), line.get_marker()) for line in own})


def test_pictures_of_ensembles_say_what_they_are_of():
    table = map_table(["tc_monolithic"])
    table.loc[table["x_low"] == 0.1, "share"] = 0.0
    (image,) = ensemble.where_it_fails(table).axes[0].get_images()
    colours = image.to_rgba(image.get_array())
    assert np.all(colours[:, 0, :3] == 1.0) and np.all(colours[:, 1, 2] < 0.9)  # white: no run failed
    title = ensemble.performance_profiles(profile_table(awkward.FIVE)).axes[0].get_title(loc="left")
    assert title == "state to 1e-6: 30 scenarios, 4 without reference"
    figure = ensemble.law_quantiles(law_table(["tc_monolithic", "midpoint_entropy"]))
    fills = {line.get_markerfacecolor() for line in figure.axes[0].lines if line.get_marker() == "o"}
    assert "white" in fills and len(fills) == 2  # a law that is claimed is filled
    (panel,) = page_charts.sheet_of(ensemble.error_time.__wrapped__(point_table(["a"]))).panels
    dots, medians = panel.series
    assert (len(dots.x), len(medians.x), medians.y[0]) == (15, 3, pytest.approx(10.0**-2.8))


MANY = [*awkward.FIVE, *awkward.PEERS, *(f"a_method_of_ours_{i:02d}" for i in range(9))]
TABLES = awkward.everything(MANY, ["short_term", "stiff_spring"])
DECLARED = awkward.declared(MANY, ["short_term", "stiff_spring"])


@pytest.mark.parametrize("scenario", ["short_term", "stiff_spring"])
def test_the_best_of_each_family_lead(scenario):
    """Those that are first at the smallest of 1e-9, 1e-6, 1e-3 that any of the family reaches; of a few all."""
    table, told = TABLES["time_to_accuracy"], DECLARED["integrators"]
    rows = table[table["scenario"].eq(scenario) & table["measure"].eq("error") & table["time_s"].notna()]
    rows = rows.assign(family=rows["integrator"].map(lambda name: told[name]["family"]))
    firsts = rows.sort_values(["target", "time_s"]).groupby("family")
    each = -(-5 // rows["family"].nunique())
    by_hand = {name for _, part in firsts for name in list(dict.fromkeys(part["integrator"]))[:each]}
    found = highlight.leaders(TABLES, DECLARED)[scenario]
    assert by_hand <= set(found) and len(found) < len(MANY)
    few = awkward.everything(MANY[: highlight.CROWD], [scenario])
    assert highlight.leaders(few, {})[scenario] == sorted(MANY[: highlight.CROWD])


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    """The folder of a run of many methods."""
    names = ("work_precision", "conservation", "series")
    tables = {name: TABLES[name] for name in (*names, "time_to_accuracy", "stability")}
    return awkward.write_run(tmp_path_factory.mktemp("many") / "run", tables, (), DECLARED)


@pytest.mark.parametrize("kind", tiers(["work-precision", "laws"], ["work-precision"]))
def test_a_picture_draws_those_in_their_colour_and_the_rest_in_grey(kind, many):
    folder = many
    figure = tcbench.draw(kind, folder, scenario="short_term")
    front, looks = highlight.leaders(TABLES, DECLARED)["short_term"], plot.run_looks(TABLES)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    shown = [name for name in front if name in texts]
    assert shown and len(texts) - len(shown) <= 2 and any(text.endswith(" others") for text in texts)
    colours = {line.get_color() for line in figure.axes[0].lines if len(line.get_xdata()) > 1}
    assert colours == {looks[name].colour for name in shown} | {OTHER.colour}
    named = tcbench.draw(kind, folder, scenario="short_term", methods=MANY)  # who is asked for is in colour
    assert OTHER.colour not in {line.get_color() for line in named.axes[0].lines}


@pytest.mark.thorough
def test_a_method_looks_the_same_in_every_chart_of_a_run():
    looks = plot.run_looks(TABLES)
    assert len({(one.colour, one.marker) for one in looks.values()}) == len(looks)
    for kind, methods in (("conservation", MANY[3:9]), ("convergence", MANY[8:12])):
        figure = tcbench.draw(kind, TABLES, scenario="short_term", methods=methods)
        drawn = {h.get_label(): (h.get_color(), h.get_marker()) for h in figure.legends[0].legend_handles}
        assert {n: drawn[n] for n in methods} == {n: (looks[n].colour, looks[n].marker) for n in methods}
