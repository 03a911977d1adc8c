"""The page answers for a scenario: sentences, ranking, steps, chart and player, of any system; charts are saved."""

import csv
import io
import re
from pathlib import Path

import awkward
import numpy as np
import pandas as pd
import pytest
from mechanics import Warm

import tcbench
from tcbench.report.write_report import write_report


def test_the_player_plays(full, visit):
    page = visit(full, "#scenario=stiff_spring")
    assert page.locator(".player .side").count() == 2 and page.locator(".player canvas").count() == 2
    painted = (
        "() => [...document.querySelector('canvas').getContext('2d').getImageData(0, 0, 640, 460).data].some(v => v)"
    )
    page.wait_for_function(painted)
    page.locator(".player button").click()
    page.wait_for_function("() => +document.querySelector('.player input').value > 0.5")
    page.locator(".player button").click()
    assert page.locator(".player button").text_content() == "▶ Play"
    page.locator(".player input").fill("25")
    assert page.locator(".player output").last.text_content() == "t = 25.0"
    assert page.locator(".running").first.text_content().startswith("E = 60")
    page.locator("label", has_text="left").locator("select").select_option("scipy_radau")
    page.locator(".side h4", has_text="scipy_radau").wait_for()


def test_laws_and_ends_of_a_scenario_are_dots_and_marks(full, visit):
    page = visit(full, "#scenario=stiff_spring")
    heads = page.locator(".rank thead th").all_inner_texts()
    row = page.locator(".rank tbody tr", has_text="midpoint_temperature").locator("td")
    assert row.nth(heads.index("laws kept") - 1).locator(".dot").count() == 3
    assert "B" in row.nth(heads.index("ended badly") - 1).inner_text()


def test_a_general_system_is_told_in_its_own_variables(tmp_path, visit):
    """Also beside a system of springs, whose columns are empty for it: no strain, no momentum that it has not."""
    springs = awkward.series(["mine"], ["short_term"])
    laws = ["t", "energy", "entropy", "energy_error", "entropy_fall", "integrator", "scenario", "dt", "status"]
    body = awkward.series(["mine"], ["body"])[laws].assign(m0=0.25, m1=np.linspace(0, 1, 90))
    work = awkward.work_precision(["mine"], ["short_term"])
    moved = work.drop(columns=["error_q", "error_p", "error_s", "error_theta"]).assign(scenario="body", error_m=1e-3)
    tables = {"conservation": awkward.conservation(["mine"], ["body", "short_term"]),
              "series": pd.concat([springs, body]), "work_precision": pd.concat([work, moved])}  # fmt: skip
    told = awkward.declared(["mine"], ["body", "short_term"])
    elements = ("positions", "momenta", "temperatures")
    facts = {k: v for k, v in told["scenarios"]["body"].items() if k not in elements}
    own = facts | {"links": [], "system": "body", "invariants": [], "initial": {"m": [0.25, 0]}}
    told["scenarios"] = told["scenarios"] | {"body": own}
    page = visit(write_report(awkward.write_run(tmp_path / "run", tables, (), told)), "#scenario=body")
    lines = page.locator(".running > span").all_inner_texts()
    assert [line.split(" = ")[0] for line in lines] == ["E", "S", "m0", "m1"] and page.locator("canvas").count() == 0
    assert "initial m\n(0.25, 0)" in page.locator("#scenario-page dl").inner_text()
    assert page.locator("#scenario-page .panels figcaption").all_inner_texts() == ["energy: |E − E₀| / V₀", "m0", "m1"]
    page.evaluate("location.hash = 'overview'")
    page.locator("#speed-controls select").first.wait_for()
    page.locator("#speed-controls select").first.select_option("body")
    errors = page.locator("#speed-controls select").nth(1).locator("option")
    shown = errors.all_inner_texts()
    assert "error of m" in shown and not [x for x in shown if "positions" in x or "temperatures" in x]


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


MOST_COLOURED = """() => {
  const data = document.querySelector('canvas').getContext('2d').getImageData(0, 0, 640, 460).data;
  let most = -1;  // nothing is painted
  for (let i = 0; i < data.length; i += 4)
    if (data[i + 3] > 200) most = Math.max(most, Math.max(...data.slice(i, i + 3)) - Math.min(...data.slice(i, i + 3)));
  return most;
}"""


class Ring(Warm):
    """Masses on a ring, three of them drawn, and one temperature, of a bath that rubs on all."""

    name = "ring"
    variables = {"q": ("mass",), "p": ("mass",), "s": ()}
    tables = {"pairs": ("spring", 2, "mass")}
    constants = {"mass": ("mass",), "axes": (2, 2)}

    def energy(self, z):
        ends = z.q[self.pairs]
        return (z.p**2 / self.mass).sum() / 2 + ((ends[:, 1] - ends[:, 0]) ** 2).sum() / 2 + np.exp(z.s)

    def irreversible(self, z, dE, dS):
        return {"p": -dE.p, "s": (dE.p * dE.p).sum() / dE.s}

    def points(self, z):
        return [[(0, 0), (x, y)] for x, y in ((z.s, 1), (1, 1), (1, 0))]


@pytest.fixture(scope="module")
def page_of_a_ring(tmp_path_factory):
    n, folder = 30, tmp_path_factory.mktemp("ring") / "run"
    constants = {"pairs": [[i, (i + 1) % n] for i in range(n)], "mass": np.ones(n), "axes": [[1, 0], [0, 1]]}
    start = {"q": np.cos(np.arange(n)), "p": np.zeros(n), "s": 0.0}
    ring = tcbench.Scenario("ring", Ring, constants, initial=start, t_end=1.0, dt=0.1)
    tcbench.run(["tc_monolithic"], [ring], ["conservation"], folder, dt=[0.1], jobs=1)
    return write_report(folder)


def test_tables_and_long_arrays_are_told(page_of_a_ring, visit):
    """The rows of a table, and of a matrix, were dashes; hundreds of numbers filled the page."""
    facts = visit(page_of_a_ring, "#scenario=ring").locator("dd").all_text_contents()
    assert "((1, 0), (0, 1))" in facts
    assert "30 × 2 values, 0 to 29" in facts and "30 values, all 1" in facts  # sizes and ranges


def test_one_temperature_colours_no_line_of_three(page_of_a_ring, visit):
    """As in `animate`: the first of them had the colour of the bath."""
    page = visit(page_of_a_ring, "#scenario=ring")
    page.locator(".running").first.wait_for()
    assert 0 <= page.evaluate(MOST_COLOURED) < 60  # the greys of lines and text, some of them bluish
    assert "of 62 variables and temperatures" in page.locator(".player").text_content()


@pytest.mark.parametrize("name, dt", [("solid[n=1]", 0.1), ("net[nx=2,ny=2]", 0.25)])
def test_a_mesh_is_filled_by_temperature_and_one_in_space_is_turned(name, dt, tmp_path, visit):
    tcbench.run(["midpoint_entropy"], [name], ["conservation"], tmp_path, dt=[dt], jobs=1)
    table = pd.read_csv(tmp_path / "tables" / "fields.csv")
    run = tcbench.simulate("midpoint_entropy", name, dt=dt)
    assert np.allclose(table["t"].unique(), run.t) and table["temperature"].max() <= 1.001 * run.temperatures.max()
    page = visit(
        write_report(tmp_path), "#scenario=" + pd.read_csv(tmp_path / "tables" / "conservation.csv")["scenario"][0]
    )
    page.wait_for_function(f"({MOST_COLOURED})() > 100")  # hot and cold, of blue and orange
    pixels = "() => document.querySelector('canvas').toDataURL()"
    turned, seen = page.locator("label", has_text="turn").locator("input"), page.evaluate(pixels)
    assert turned.count() == name.startswith("solid")
    for place in (turned, page.get_by_label("time", exact=True)):
        if place.count():
            place.fill("1.5" if place != turned else "120")
            assert page.evaluate(pixels) != seen
            seen = page.evaluate(pixels)


def test_a_chart_is_saved_as_svg_png_and_csv(full, visit):
    page = visit(full, accept_downloads=True)
    page.locator("#speed .save summary").click()
    saved = {}
    for kind in ("SVG", "PNG", "CSV"):
        with page.expect_download() as waiting:
            page.locator("#speed .save button", has_text=kind).click()
        saved[kind] = waiting.value.path().read_bytes()
    assert saved["SVG"].startswith(b"<svg") and b"color(" not in saved["SVG"] and b"class=" not in saved["SVG"]
    assert saved["PNG"].startswith(b"\x89PNG") and len(saved["PNG"]) > 5000
    rows = list(csv.DictReader(io.StringIO(saved["CSV"].decode())))
    work = awkward.work_precision([*awkward.FIVE, *awkward.PEERS], ["stiff_spring"])
    assert len(rows) >= (work["status"] == "ok").sum() and {*work["integrator"]} <= {row["method"] for row in rows}


def test_a_tolerated_error_leads_to_a_step_and_a_problem_to_what_it_is_like(full, visit):
    page = visit(full, "#scenario=short_term")
    heads = page.locator(".rank thead th").all_inner_texts()
    row = page.locator(".rank tbody tr", has_text="tc_monolithic").locator("td")
    (at,) = [k for k, text in enumerate(heads) if text.startswith("h for 1%")]
    table = awkward.work_precision(["tc_monolithic"], ["short_term"]).dropna(subset="error_theta")
    wrong, steps = np.log(table["error_theta"].to_numpy()[::-1]), np.log(table["value"].to_numpy()[::-1])
    step = np.exp(np.interp(np.log(0.01), wrong, steps))
    assert float(row.nth(at - 1).inner_text()) == pytest.approx(step, rel=0.06)
    page.locator("label", has_text="step for an error of").locator("select").select_option("0.0001")
    assert page.locator(".rank thead th", has_text="h for 0.01%").count() == 1 and "off=0.0001" in page.url
    page.locator("#tabs a", has_text="Which is like yours?").click()
    here = page.locator("#like-page details", has=page.locator("a", has_text="stiff_spring")).locator("> summary")
    assert "Fast vibrations" in here.nth(0).inner_text() and "within a step" in here.nth(1).inner_text()
    page.locator("#like-page a", has_text="stiff_spring").click()
    page.locator("#scenario-page h2", has_text="stiff_spring").wait_for()


def test_the_published_page_tells_a_step_for_one_per_cent_and_repeats_a_claim(tmp_path, visit):
    """It has no study of speed; the errors that its table of laws has were not shown."""
    folder = Path(__file__).parents[2] / "results" / "baseline"
    page = visit(write_report(folder, page=tmp_path / "page.html"), "#scenario=stiff_spring")
    heads = [text.rstrip(" ▾") for text in page.locator(".rank thead th").all_inner_texts()]
    cells = page.locator(".rank tbody tr", has_text="tc_monolithic").locator("td").all_inner_texts()
    table = pd.read_csv(folder / "tables" / "conservation.csv")
    mine = table[table["integrator"].eq("tc_monolithic") & table["scenario"].eq("stiff_spring")].sort_values("dt")
    assert float(cells[heads.index("θ error") - 1].rstrip("%")) == pytest.approx(
        100 * mine["error_theta"].iloc[-1], rel=0.05
    )
    step = np.exp(np.interp(np.log(0.01), np.log(mine["error_theta"]), np.log(mine["dt"])))
    assert float(cells[heads.index("h for 1%") - 1]) == pytest.approx(step, rel=0.06)
    page.locator("#tabs a", has_text="claims").click()
    page.locator("#claim-page .again summary").first.click()
    assert page.locator("#claim-page .again[open] pre").inner_text().startswith("tcbench ")
