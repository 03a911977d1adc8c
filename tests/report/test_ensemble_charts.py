"""Charts of the ensemble: any number of methods, names from anywhere, nothing to see, and what must be seen."""

import awkward
import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from tcbench.analysis.statistics import wilson
from tcbench.report import highlight
from tcbench.report.charts import ensemble, style, theme

METHODS = {
    "five": awkward.FIVE, "one": ["tc_monolithic"], "forty": awkward.FORTY,
    "hostile": ["tc_monolithic", awkward.HOSTILE, "x" * 10_000],
}  # fmt: skip


def share_table(methods):
    rows = []
    for place, name in enumerate(methods):
        for dt in (0.1, 0.2, 0.4):
            failed = min(100, int(place * 90 * dt))
            low, high = wilson(failed, 100)
            rows.append({"integrator": name, "dt": dt, "tolerance": np.nan, "runs": 100, "failed": failed,
                         "share": failed / 100, "low": low, "high": high})  # fmt: skip
    return pd.DataFrame(rows)


def profile_table(methods):
    return pd.DataFrame([
        {"integrator": name, "measure": measure, "target": target, "tau": tau, "share": min(1.0, tau / (10 + place)),
         "low": 0.0, "high": 1.0, "runs": 30, "without_reference": 4}
        for place, name in enumerate(methods) for measure, target in (("state", 1e-6), ("energy", 1e-12))
        for tau in (1.0, 3.0, 10.0, 100.0)
    ])  # fmt: skip


def point_table(methods):
    return pd.DataFrame([
        {"integrator": name, "value": 10.0**-k, "seed": seed, "error": 10.0 ** (-k + 0.1 * seed), "time_s": 1e-4 * k}
        for name in methods for k in (3, 6, 9) for seed in range(5)
    ])  # fmt: skip


def law_table(methods):
    return pd.DataFrame([
        {"integrator": name, "law": law, "claimed": place % 2 == 0, "median": 0.0, "quantile_99": 1e-14, "worst": 1e-9}
        for place, name in enumerate(methods) for law in ("energy", "entropy")
    ])  # fmt: skip


def map_table(methods):
    return pd.DataFrame([
        {"integrator": name, "x_name": "dt", "x_low": dt, "x_high": dt, "y_name": "stiffness", "y_low": low,
         "y_high": 10 * low, "share": 0.5, "runs": 20}
        for name in methods for dt in (0.1, 0.2) for low in (1.0, 10.0, 100.0)
    ])  # fmt: skip


CHARTS = {
    "failure_share": (ensemble.failure_share, share_table),
    "performance_profiles": (ensemble.performance_profiles, profile_table),
    "error_time": (ensemble.error_time, point_table),
    "law_quantiles": (ensemble.law_quantiles, law_table),
    "where_it_fails": (ensemble.where_it_fails, map_table),
}


@pytest.mark.thorough
@pytest.mark.parametrize("methods", METHODS.values(), ids=METHODS)
@pytest.mark.parametrize("name", CHARTS)
def test_a_chart_draws_any_number_of_methods(name, methods, tmp_path):
    draw, table = CHARTS[name]
    figure = draw(table(methods))
    assert isinstance(figure, Figure)
    figure.savefig(tmp_path / "chart.png", dpi=40)


@pytest.mark.parametrize("rows", ["all NaN", "none"])
@pytest.mark.parametrize("name", CHARTS)
def test_a_chart_of_nothing_is_drawn_and_not_an_error(name, rows, tmp_path):
    draw, make = CHARTS[name]
    table = make(awkward.FIVE)
    numbers = [c for c in table.select_dtypes("number").columns if c not in ("runs", "without_reference", "target")]
    table = table.assign(**dict.fromkeys(numbers, np.nan)) if rows == "all NaN" else table.iloc[:0]
    draw(table).savefig(tmp_path / "chart.png", dpi=40)


def texts(figure):
    return [text.get_text() for ax in figure.axes for text in ax.texts]


def test_methods_that_never_failed_are_one_line_that_says_how_many():
    table = share_table(["midpoint_entropy", "tc_strang", "tc_monolithic"])
    table.loc[table["integrator"] != "midpoint_entropy", ["failed", "share"]] = [0, 0.0]
    table.loc[table["integrator"] == "midpoint_entropy", ["failed", "share"]] = [7, 0.07]
    found = texts(ensemble.failure_share(table))
    assert "midpoint_entropy" in found and "no run failed: 2 methods" in found and "tc_strang" not in found


def test_lines_that_are_named_have_looks_of_their_own():
    table = share_table(awkward.FORTY[5:])
    (ax,) = ensemble.failure_share(table).axes
    own = [line for line in ax.lines if line.get_color() not in (style.OTHER.colour, theme.INK)]
    assert len(own) == highlight.IN_COLOUR == len({(line.get_color(), line.get_marker()) for line in own})
    (ax, _) = ensemble.performance_profiles(profile_table(awkward.FORTY[5:11])).axes
    assert len({line.get_color() for line in ax.lines}) == 6


def test_a_cell_of_the_map_without_a_failure_is_white():
    table = map_table(["tc_monolithic"])
    table.loc[table["x_low"] == 0.1, "share"] = 0.0
    (image,) = ensemble.where_it_fails(table).axes[0].get_images()
    colours = image.to_rgba(image.get_array())
    assert np.all(colours[:, 0, :3] == 1.0) and np.all(colours[:, 1, 2] < 0.9)


def test_too_few_runs_draw_no_share():
    assert "has 5 runs" in " ".join(texts(ensemble.failure_share(share_table(awkward.FIVE).assign(runs=4))))


def test_a_profile_says_how_many_scenarios_it_is_of():
    figure = ensemble.performance_profiles(profile_table(awkward.FIVE))
    assert figure.axes[0].get_title(loc="left") == "state to 1e-6: 30 scenarios, 4 without reference"


def test_a_law_that_is_claimed_is_filled():
    figure = ensemble.law_quantiles(law_table(["tc_monolithic", "midpoint_entropy"]))
    fills = {line.get_markerfacecolor() for line in figure.axes[0].lines if line.get_marker() == "o"}
    assert "white" in fills and len(fills) == 2
