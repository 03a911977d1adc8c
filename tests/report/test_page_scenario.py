"""The page answers for a scenario: sentences, ranking, chart, then the player; a cell leads to its number and run."""

import re

import awkward
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from tcbench.report.charts.style import FIXED, OTHER, SKY
from tcbench.report.plot import run_looks
from tcbench.report.write_report import write_report


def test_methods_are_told_apart_by_the_colour_blind_too():
    """They differ in marker, or in colour as a deuteranope and a protanope see it (Vienot et al. 1999)."""
    see = {
        "deuteranope": np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]]),
        "protanope": np.array([[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]]),
    }
    looks = list(run_looks(awkward.everything([*awkward.FORTY[:20], *FIXED], ["short_term"])).values())
    for who, matrix in see.items():
        seen = [np.clip(matrix @ np.array(to_rgb(one.colour)) ** 2.2, 0, 1) ** (1 / 2.2) for one in looks]
        pairs = [(i, j) for i in range(len(looks)) for j in range(i) if looks[i].marker == looks[j].marker]
        assert all(np.linalg.norm(seen[i] - seen[j]) > 0.08 for i, j in pairs), who
        others = np.clip(matrix @ np.array(to_rgb(OTHER.colour)) ** 2.2, 0, 1) ** (1 / 2.2)
        away = {look.colour: np.linalg.norm(one - others) for look, one in zip(looks, seen, strict=True)}
        # none turns into the grey of "others"; the paper's sky blue is as light, and stays blue
        assert all(far > 0.35 for colour, far in away.items() if colour != SKY), who


def test_a_scenario_answers_first_and_then_shows(large, visit):
    page = visit(large)
    page.locator(".matrix thead .one a", has_text="fast_").click()  # which method for a long run at a large step?
    told = page.locator("#scenario-page .answers").inner_text()
    assert re.match(r"An accurate trajectory: \w+, an error of 10⁻⁶ in \d", told) and "At h = 0.3: " in told
    place = "() => [...document.querySelectorAll('#scenario-page .answers, .rank, #scenario-page .chart svg, .player')]"
    tops = page.evaluate(f"({place})().map(e => e.getBoundingClientRect().y)")
    assert tops[0] < tops[1] < tops[-1] and tops[2] < tops[-1]  # sentence, ranking and chart, player
    rows = page.locator(".rank tbody tr")
    heads = [text.rstrip(" ▾") for text in page.locator(".rank thead th").all_inner_texts()]
    table = awkward.work_precision(["tc_monolithic"], ["fast_conduction"])
    wrong = table.loc[
        table["value"].idxmax(), "error_theta"
    ]  # how far is it from the truth, what is lost with another?
    cell = rows.filter(has_text="tc_monolithic").locator("td").nth(heads.index("θ error") - 1)
    assert float(cell.inner_text().rstrip("%")) == pytest.approx(100 * wrong, rel=0.05)
    assert page.locator(".rank thead th[title*='wall time']").count() >= 2  # columns are defined
    assert page.locator("#scenario-page .again").count() >= 4
    page.locator("#scenario-page .again summary").first.click()
    assert "tcbench run -s fast_conduction" in page.locator("#scenario-page .again pre").first.inner_text()


def test_a_clicked_cell_leads_to_its_number_and_its_run(full, visit):
    page = visit(full)
    cell = page.locator(".matrix .cell[href^='#scenario=stiff_spring&method=tc_staggered&']")
    shown = cell.text_content().rstrip("✓")
    cell.click()
    told = page.locator(".pair")
    told.wait_for()
    assert "Time to an error of 10" in told.inner_text() and f"{shown} times the best" in told.inner_text()
    told.locator(".again summary").click()
    assert "tcbench simulate tc_staggered stiff_spring --dt " in told.locator("pre").inner_text()
    assert page.locator(".rank tr.wanted th").inner_text() == "tc_staggered"


def test_a_small_screen_shows_every_scenario(large, visit):
    page = visit(large, "", 400)
    right = page.locator(".matrix .one").evaluate_all(
        "cells => Math.max(...cells.map(c => c.getBoundingClientRect().right))"
    )
    assert right <= 400 and page.locator(".matrix thead .one").count() == 8
    assert page.locator(".matrix .cell").first.evaluate("c => c.getBoundingClientRect().width") > 15


def test_a_pair_counts_the_failures_that_every_sentence_counts(tmp_path, visit):
    """At a tolerance above 1e-3 a solver is asked for so little that what it does is no failure."""
    work = awkward.work_precision(["scipy_radau"], ["short_term"])
    work.loc[:1, "status"], work.loc[0, "value"] = "exception", 0.1
    page = visit(write_report(awkward.write_run(tmp_path / "run", {"work_precision": work}, (), {})))
    assert "1 of 6 runs" in page.locator(".finding", has_text="What fails").inner_text()
    page.locator(".matrix .cell.failed").click()
    page.locator(".pair", has_text="1 of its 6 runs").wait_for(timeout=5000)


def test_the_fastest_lawful_method_on_a_scenario_is_one_click_away(full, visit):
    page = visit(full)
    page.locator(".matrix thead button[title^='stiff_spring']").click()
    first = page.locator(".matrix tbody tr").filter(has_text="✓").first
    times = awkward.time_to_accuracy([*awkward.FIVE, *awkward.PEERS])
    rows = times[(times["scenario"] == "stiff_spring") & (times["target"] == 1e-6) & times["time_s"].notna()]
    lawful = rows[rows["integrator"].str.startswith("tc")]
    assert first.locator("th").text_content() == lawful.sort_values("time_s")["integrator"].iloc[0]
    shown = page.locator(".matrix tbody th[scope=row]").all_text_contents()
    assert shown[: len(rows)] == rows.sort_values("time_s")["integrator"].tolist()
