"""What gave no result is told with its reason: nobody is told that nothing fails, and no undetermined order is mute."""

import pandas
import pytest
from click.testing import CliRunner

from tcbench.cli import main
from tcbench.report import overview, page_data
from tcbench.report.by_method import remarks
from tcbench.report.pairs import pairs

WHY = "ReferenceFailed: stopped at t = 0.2 of 1"


@pytest.fixture
def tables():
    row = {"scenario": "large", "variable": "all", "verdict": "undetermined"}
    failed = [row | {"integrator": n, "status": "exception", "note": WHY} for n in ("a", "b", "c")]
    found = row | {"integrator": "d", "status": "ok", "note": "Only 2 points stand above every floor."}
    ladder = {"integrator": "a", "scenario": "large", "dt": 0.1, "status": "ok", "failure": ""}
    return {"conservation": pandas.DataFrame([ladder]), "convergence": pandas.DataFrame([*failed, found])}


def test_a_measurement_without_a_result_is_a_failure_in_the_overview_and_in_the_list(tables):
    finding = overview.failing(pairs(tables, {}), tables)
    assert (finding.lead, WHY in finding.text) == ("3 measurements without a result", True)
    assert overview.failing(pairs({}, {}), {"convergence": tables["convergence"]}).lead == finding.lead
    assert overview.failing(pairs({}, {}), {"conservation": tables["conservation"]}).lead == "nothing"
    found = page_data.failures(tables)
    assert set(found) == {"a", "b", "c"} and found["a"]["large"][0] == 1 and WHY in found["a"]["large"][2]


def test_each_reason_is_told_once_below_the_table(tables):
    _, missing, undetermined = remarks(tables)
    assert missing == f"No result of convergence of a on large, convergence of b on large and 1 more: {WHY}"
    assert undetermined == "Order undetermined of d on large: Only 2 points stand above every floor."


def test_an_order_is_that_of_the_state_and_not_of_a_variable_that_stands_still(tables):
    table = tables["convergence"]
    still = {"variable": "u", "note": "Only 0 points stand above every floor."}
    rows = [table.iloc[-1].to_dict() | still, table.iloc[-1].to_dict() | {"verdict": "as declared", "note": "fine"}]
    assert not any("Order" in sentence for sentence in remarks({"convergence": pandas.DataFrame(rows)}))


def test_two_steps_for_an_order_and_a_scenario_that_does_not_suit_are_told(tmp_path):
    words = ["run", "-i", "verlet_heat", "-s", "short_term", "-s", "gas_containers", "--study", "convergence", "--dt"]
    done = CliRunner().invoke(main, [*words, "0.1", "--dt", "0.2", "-o", str(tmp_path / "out")])
    assert done.exit_code == 0 and "2 steps, and an order takes at least 3: leave --dt out" in done.stderr
    assert "verlet_heat is not run on gas_containers: it needs conduction_flow" in done.stderr
    assert "Order undetermined of verlet_heat on short_term: Only 2 points" in done.stdout
    shown = CliRunner().invoke(main, ["show", str(tmp_path / "out")])
    assert "Order undetermined of verlet_heat on short_term: Only 2 points" in shown.stdout
