"""Thermodynamically consistent runs end in the exact relative equilibrium, where one is within reach."""

import numpy as np
import pytest

import tcbench
from tcbench import plugins
from tcbench.studies import equilibrium
from tcbench.studies.equilibrium import STUDY, measure, plan, tabulate

TC = ("tc_monolithic", "tc_strang", "tc_staggered")


def run(integrator, scenario, **changes):
    scenario = plugins.find_scenario(scenario)
    dt = changes.pop("dt", scenario.dt)
    scenario = scenario.replace(**changes) if changes else scenario
    return measure(plugins.find_integrator(integrator), scenario, {"dt": dt})


def column(row, name):
    return np.array([line[name] for line in row["rows"]])


@pytest.mark.parametrize("integrator", TC)
def test_entropy_rises_to_that_of_the_equilibrium_and_never_beyond(integrator):
    """The demand: below 1e-4 at t = 1500 and falling. Exact E and J make the equilibrium an upper bound of S; 1e-11 is
    round-off of 5000 steps."""
    row = run(integrator, "bound_equilibrium")
    gap = column(row, "entropy_gap")
    assert 0 < gap[-1] < 1e-4 and np.all(np.diff(gap) <= 1e-11) and gap.min() > -1e-11
    summary = row["summary"]
    assert summary["equilibrium"] == "approached" and summary["entropy_gap_falls"]
    assert summary["strain_gap"] < 0.01 and summary["temperature_gap"] < 0.1 and summary["rotation_gap"] < 0.01


@pytest.mark.parametrize("integrator", ("midpoint_entropy", "midpoint_temperature"))
def test_a_method_that_loses_energy_passes_the_equilibrium_and_is_told(integrator):
    summary = run(integrator, "bound_equilibrium")["summary"]
    assert summary["equilibrium"] == "passed" and "energy moved" in summary["note"]
    assert summary["entropy_gap"] < -1e-5


@pytest.mark.thorough
def test_printed_data_show_growth_instead_of_a_gap():
    """docs/truth.md: strains 8.54 and 9.33 at t = 1500, growing like ln t (0.9 per unit over the last decade)."""
    row = run("tc_monolithic", "relative_equilibrium")
    summary = row["summary"]
    assert summary["equilibrium"] == "distant" and "No equilibrium is reached" in summary["note"]
    assert np.all(np.isnan(column(row, "entropy_gap"))) and np.isnan(summary["strain_gap"])
    assert (row["rows"][-1]["strain_a"], row["rows"][-1]["strain_b"]) == pytest.approx((8.54, 9.33), abs=0.01)
    assert summary["growth_a"] == pytest.approx(0.9, abs=0.1) and summary["growth_b"] == pytest.approx(0.9, abs=0.1)
    late = column(row, "t") > 100
    t, strain = column(row, "t")[late], column(row, "strain_a")[late]
    straight = np.polyfit(np.log(t), strain, 1)
    assert np.abs(np.polyval(straight, np.log(t)) - strain).max() < 0.1  # a line in ln t, of the 2.4 that it rises


def test_failed_and_short_runs_are_rows():
    summary = run("midpoint_entropy", "stiff_spring")["summary"]
    assert summary["equilibrium"] == "run failed" and "exceeded" in summary["note"]
    short = run("tc_monolithic", "bound_equilibrium", t_end=0.3)
    assert len(short["rows"]) == 1 and short["summary"]["equilibrium"] == "not reached"


def test_plan_takes_long_scenarios_by_default_and_any_on_request():
    methods = [plugins.find_integrator("tc_monolithic")]
    everything = list(tcbench.scenarios().values())
    names = {scenario.name for _, scenario, _ in plan(methods, everything, {})}
    assert names == {"relative_equilibrium", "bound_equilibrium"}
    asked = plan(methods, [tcbench.scenarios()["short_term"]], {"dt": [0.1, 0.2, 100.0]})
    assert [(scenario.name, options["dt"]) for _, scenario, options in asked] == [
        ("short_term", 0.1),
        ("short_term", 0.2),
    ]


def test_tables_are_tidy_and_a_failed_cell_keeps_a_row():
    good = {"integrator": "tc_strang", "scenario": "bound_equilibrium", "dt": 0.3} | run(
        "tc_strang", "bound_equilibrium", t_end=30.0
    )
    bad = {"integrator": "worse", "scenario": "bound_equilibrium", "status": "crash", "failure": "signal 11"}
    tables = tabulate([bad, good])
    assert set(tables) == set(STUDY.table_names)
    rows, summary = tables["equilibrium"], tables["equilibrium_summary"]
    assert list(rows.columns) == equilibrium.EQUILIBRIUM.names and set(rows.integrator) == {"tc_strang"}
    assert list(summary.columns[: len(equilibrium.SUMMARY.names)]) == equilibrium.SUMMARY.names
    assert list(summary.note[summary.integrator == "worse"]) == ["signal 11"]
    assert rows.t.is_monotonic_increasing and len(rows) <= equilibrium.TIMES
