"""What a step and a tolerance buy; the steps that keep temperatures in their range."""

import math

import pytest

import tcbench
from tcbench.plugins import find_integrator
from tcbench.studies import reachable_range
from tcbench.studies.tolerance import bought

pytestmark = pytest.mark.usefixtures("cells_here")


def rung(error):
    return {"status": "ok", "error": error}


def test_what_a_step_and_a_tolerance_buy():
    """Errors meet 1 % between two rungs; a larger step that happens to be right is none."""
    errors = {0.8: 0.005, 0.4: 0.16, 0.2: 0.04, 0.1: 0.01 / 4, 0.05: 0.01 / 16}
    rungs = [rung(e) | {"value": h, "steps": round(8 / h)} for h, e in errors.items()]
    of_tolerances = [
        rung(4e-3) | {"value": 1e-3},
        rung(7e-6) | {"value": 1e-6},
        {"value": 1e-9, "status": "blowup"},
    ]
    base = {"scenario": "s"}
    mine, never, theirs = bought([
        base | {"integrator": "a", "control": "dt", "points": rungs},
        base | {"integrator": "b", "control": "dt", "points": rungs[1:3]},
        base | {"integrator": "c", "control": "rtol", "points": of_tolerances},
    ])  # fmt: skip
    assert mine["dt_1_percent"] == pytest.approx(0.1 * 2**0.5)  # 0.0025 and 0.04 at 0.1 and 0.2
    assert mine["steps_1_percent"] * mine["dt_1_percent"] == pytest.approx(8)
    assert math.isnan(never["dt_1_percent"])
    assert theirs["over_1e-3"] == pytest.approx(4) and theirs["over_1e-6"] == pytest.approx(7)
    assert math.isnan(theirs["over_1e-9"])


@pytest.mark.thorough
def test_errors_are_beside_what_was_asked_for(tmp_path):
    """tc_auto keeps to its tolerance, odeint at its own end does not; the chart has a line for it."""
    tables = tcbench.run(
        ["tc_auto", "scipy_odeint", "gauss2"], ["gas_containers"], ["tolerance"], tmp_path / "r"
    ).tables
    points = tables["tolerance"].set_index("integrator")
    over = points.loc["tc_auto", "over_tolerance"].to_numpy()
    assert len(over) == 12 and max(over[1:]) < 1 and over[0] < 2  # at 0.1 a series has too few terms to judge by
    assert (
        points.loc["scipy_odeint", "over_tolerance"].max() > 10 and points.loc["gauss2", "over_tolerance"].isna().all()
    )
    rows = tables["bought"].set_index("integrator")
    assert rows.loc["tc_auto", "over_1e-6"] == pytest.approx(
        points.loc["tc_auto"].set_index("value").loc[1e-6, "error"] * 1e6
    )
    assert 0.05 < rows.loc["gauss2", "dt_1_percent"] < 0.3
    with_line, of_steps = tcbench.draw("tolerance", tables).axes
    asked = [list(line.get_xdata()) for line in with_line.lines if list(line.get_xdata()) == list(line.get_ydata())]
    assert asked == [[1e-12, 0.1]] and max(len(line.get_xdata()) for line in of_steps.lines) > 5


@pytest.mark.thorough
def test_both_laws_do_not_keep_temperatures_in_their_range():
    """Stiff conduction rings: tc_monolithic leaves the range at every step, Gauss's collocation keeps it."""
    scenario = tcbench.scenarios()["short_term"]
    records = [
        {"integrator": name, "scenario": scenario.name, **options}
        | reachable_range.measure(find_integrator(name), scenario, options)
        for name in ("tc_monolithic", "gauss2")
        for options in ({"dt": 0.3}, {"dt": 0.6})
    ]
    records.append({"integrator": "gauss2", "scenario": scenario.name, "dt": 2.4, "status": "blowup"})
    theirs, ours = reachable_range.within(records)
    assert theirs["dt_within"] == 0.6 and theirs["dt_beyond"] == 2.4 and theirs["range_left_max"] < 0.1
    assert math.isnan(ours["dt_within"]) and ours["dt_beyond"] == 0.3 and ours["range_left_max"] > 0.1
