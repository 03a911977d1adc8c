"""The report page in a real browser: its views, links, keyboard, sizes and colours, and no word on the console."""

import csv
import io
import re

import awkward
import numpy as np
import pandas as pd
import pytest

import tcbench
from tcbench.report.write_report import write_report

VIEWS = (
    "", "#scenario=short_term", "#method=tc_strang", "#scenario=cold_spring&method=midpoint_entropy", "#failures",
    "#claims", "#table=stability", "#measured", "#like", "#charts=blowup",
)  # fmt: skip
LAWFUL = ["tc_monolithic", "tc_staggered", "tc_strang"]
READY = "() => document.documentElement.dataset.ready"


def go(page, place):
    """To another view by its link; what it shows is there when this returns."""
    page.evaluate(
        """place => new Promise(done => { delete document.documentElement.dataset.ready; location.hash = place;
           const wait = () => document.documentElement.dataset.ready ? done() : setTimeout(wait, 10); wait(); })""",
        place or "#overview",
    )


def overflow(page):
    return page.evaluate("Math.max(document.documentElement.scrollWidth, document.body.scrollWidth) - innerWidth")


LIGHTNESS = """() => ['body', '.view:not([hidden]) svg text'].flatMap(s => document.querySelector(s) || []).map(e => {
  const style = getComputedStyle(e), parts = (e.tagName === 'BODY' ? style.color : style.fill).match(/\\d+/g);
  return (+parts[0] + +parts[1] + +parts[2]) / 765; })"""


@pytest.mark.parametrize("width", [400, 1400])
@pytest.mark.parametrize("which", ["full", "hostile", "sixty", "alone", "failed"])
def test_no_view_overflows_and_text_is_readable(which, width, request, visit):
    page = visit(request.getfixturevalue(which), "", width)
    for place in VIEWS:
        go(page, place)
        page.wait_for_timeout(60)
        assert overflow(page) <= 0, place
        assert page.evaluate("document.querySelectorAll('main > .view:not([hidden])').length") == 1
        assert page.locator("main > .view:visible").inner_text().strip()
        for scheme in ("light", "dark") if width == 1400 else ():
            page.emulate_media(color_scheme=scheme)
            light = page.evaluate(LIGHTNESS)
            assert all(v > 0.55 if scheme == "dark" else v < 0.45 for v in light), (place, scheme)


def test_the_overview_is_one_screen(full, visit):
    page = visit(full)
    assert page.evaluate("document.documentElement.scrollHeight") <= 900
    assert page.locator(".finding").count() == 5 and page.locator(".matrix tbody tr:not(.family)").count() == 7
    assert page.locator("#speed .line").count() == 7 and page.locator("#steps .thick").count() == 7


def test_a_large_run_with_an_ensemble_is_one_screen_of_six_sentences(large, visit):
    assert large.stat().st_size < 4e6
    page = visit(large)
    assert page.evaluate("document.documentElement.scrollHeight") <= 900
    assert page.locator(".matrix tbody tr:not(.family)").count() == 26 and page.locator(".finding").count() == 6
    page.locator(".finding", has_text="From random starts").click()
    page.locator("#steps svg[aria-label='Failure shares']").wait_for()
    page.locator("#speed svg[aria-label^='Performance profile']").wait_for()
    assert page.evaluate("document.documentElement.scrollHeight") <= 900


CONTRAST = """() => {
  const parts = (c) => c.match(/[-.\\d]+/g).map(Number);
  const rgb = (c) => parts(c).map((v, i) => (i === 3 || c.startsWith("color(") ? v : v / 255));
  const linear = (v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  const light = (c) => 0.2126 * linear(c[0]) + 0.7152 * linear(c[1]) + 0.0722 * linear(c[2]);
  const page = rgb(getComputedStyle(document.body).backgroundColor);
  return [...document.querySelectorAll(".matrix .cell")].map((cell) => {
    const style = getComputedStyle(cell), b = rgb(style.backgroundColor);
    const through = b[3] ?? 1, seen = [0, 1, 2].map((i) => through * b[i] + (1 - through) * page[i]);
    const [text, back] = [light(rgb(style.color)), light(seen)];
    return (Math.max(text, back) + 0.05) / (Math.min(text, back) + 0.05);
  });
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_cell_can_be_read_on_its_colour(large, scheme, visit):
    """WCAG 2.1, 1.4.3: a contrast of at least 4.5."""
    page = visit(large, color_scheme=scheme)
    lenses = page.locator("#matrix-controls select").first
    for lens in lenses.locator("option").evaluate_all("options => options.map(o => o.value)"):
        lenses.select_option(lens)
        found = page.evaluate(CONTRAST)
        assert len(found) >= 100 and min(found) >= 4.5, lens


def test_no_column_of_a_ranking_is_cut_off_and_a_unit_stays_with_its_number(full, visit):
    """The last one was, on a screen of 1400; lines ended between 0.22 and µs, and a unit."""
    page = visit(full, "", 1400)
    go(page, "#scenario=stiff_spring")
    assert page.evaluate("(e => e.scrollWidth - e.clientWidth)(document.querySelector('.ranking'))") <= 1
    assert "\u00a0µs" in page.locator("#scenario-page .answers").inner_text()


def test_a_deep_link_opens_its_place_and_tabs_lead_on(full, visit):
    page = visit(full, "#method=tc_strang")
    assert page.locator("h2:visible").first.text_content() == "tc_strang"
    assert page.locator("#method-page .soft").first.text_content().startswith("Romero (2009), (A1)")
    assert "def step(z0, z1, h, system)" in page.locator("#method-page details:not(.again) pre").text_content()
    page.locator("#tabs a", has_text="Scenarios").click()
    page.locator("#scenario-page h2").wait_for()
    assert page.locator("[aria-current=page]", has_text="Scenarios").count() == 1
    page.go_back()
    page.locator("#method-page h2", has_text="tc_strang").wait_for()
    go(page, "#scenario=no_such&method=nothing")  # a link of another run
    assert page.locator("#scenario-page h2").is_visible()
    go(page, "#method=%E0%A4%A")
    assert page.locator("#method-page h2").is_visible()


def test_a_lens_recolours_the_cells(full, visit):
    page = visit(full)
    cell = page.locator(".matrix .cell[href^='#scenario=short_term&method=tc_monolithic&']")
    assert cell.text_content() == "best✓"
    page.locator("#matrix-controls select").first.select_option("step")
    assert cell.text_content() == "> 12"
    page.locator(".finding", has_text="The laws").click()
    page.wait_for_function("() => document.querySelector('#matrix-controls select').value === 'energy'")
    assert cell.text_content() == "1e-15"


def test_lines_answer_to_pointer_click_and_keys(sixty, visit):
    page = visit(sixty)
    chart = page.locator("#speed svg")
    box = page.locator("#speed g.rest .line").first.bounding_box()
    page.mouse.move(box["x"] + 1, box["y"] + 1)
    page.locator("#tip:visible").wait_for()
    name = page.locator("#tip strong").text_content()
    assert page.locator("#speed .name", has_text=name).count() == 0
    page.mouse.click(box["x"] + 1, box["y"] + 1)
    page.locator("#speed .name", has_text=name).wait_for()
    chart.focus()
    page.keyboard.press("ArrowRight")
    assert page.locator("#speed g.hot").count() == 1 and page.locator("#tip").is_visible()
    page.keyboard.press("Escape")
    assert not page.locator("#tip").is_visible()


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


def test_methods_in_time_are_chosen_by_name(full, visit):
    page = visit(full, "#scenario=short_term")
    names = page.locator(".panels figure").first.locator(".name")
    assert len(names.all_text_contents()) == 2  # the two of the player, not eight lines upon each other
    page.locator(".chips button", has_text="tc_strang").click()
    page.wait_for_function("() => document.querySelectorAll('.panels figure:first-child .name').length === 3")
    assert "tc_strang" in names.all_text_contents() and "shown=" in page.url and "tc_strang" in page.url
    again = visit(full, page.url[page.url.index("#") :])
    assert again.locator(".panels figure").first.locator(".name").count() == 3
    again.locator("#scenario-page select", has_text="none").last.select_option("tc_strang")
    again.locator("figcaption", has_text="less that of tc_strang").first.wait_for()


def test_tables_sort_search_filter_and_are_saved(full, visit):
    page = visit(full, "#table=conservation", accept_downloads=True)
    grid = page.locator("table.data")
    head = grid.locator("thead th").nth(2)
    assert head.inner_text().startswith("dt")
    column = "() => [...document.querySelectorAll('table.data tbody tr')].map(r => +r.children[2].textContent)"
    sorted_ = f"() => {{ const v = ({column})(); return v.length > 5 && v.every((x, i) => !i || v[i - 1] <= x); }}"
    head.locator("[role=button]").focus()
    page.keyboard.press("Enter")
    page.wait_for_function(sorted_)
    page.locator(".listing select").first.select_option("cvode_bdf")
    page.wait_for_function("() => document.querySelectorAll('table.data tbody tr').length === 15")
    page.locator(".listing input").fill("stiff")
    page.wait_for_function("() => document.querySelectorAll('table.data tbody tr').length === 5")
    with page.expect_download() as waiting:
        page.locator("button", has_text="Save conservation.csv").click()
    rows = list(csv.DictReader(io.StringIO(waiting.value.path().read_text("utf-8"))))
    wanted = awkward.conservation([*awkward.FIVE, *awkward.PEERS])
    wanted = wanted[wanted["integrator"].eq("cvode_bdf") & wanted["scenario"].eq("stiff_spring")]
    assert len(rows) == len(wanted) == 5  # what is seen, not all that there is
    found = sorted(float(r["energy_error_max"]) for r in rows)
    np.testing.assert_allclose(found, sorted(wanted["energy_error_max"]), rtol=1e-9)
    again = visit(full, page.url[page.url.index("#") :])
    again.wait_for_function("() => document.querySelectorAll('table.data tbody tr').length === 5")


def test_a_word_that_leads_nowhere_is_said_and_plurals_lead_where_they_mean(full, visit):
    page = visit(full, "#scenarois=short_term")
    assert "has no view scenarois: it has overview, scenario," in page.locator("#notice").inner_text()
    go(page, "#scenarios")
    assert page.locator("#scenario-page h2").is_visible() and page.locator("#notice").is_hidden()
    go(page, "#method=tc_stang")
    assert "This run has no method tc_stang" in page.locator("#notice").inner_text()


def test_what_is_chosen_is_in_the_address_and_a_link_brings_it_back(full, visit):
    page = visit(full)
    page.locator("#matrix-controls select").first.select_option("step")
    page.locator("#matrix-controls select").last.select_option("lawful")  # methods by property
    assert sorted(page.locator(".matrix tbody th a").all_text_contents()) == LAWFUL
    page.locator("#speed-controls select").first.select_option("cold_spring")
    page.locator("#speed-controls select").last.select_option("yes")  # fixed step only
    page.wait_for_function("() => document.querySelectorAll('#speed .line').length === 5")
    again = visit(full, page.url[page.url.index("#") :])
    assert again.locator("#matrix-controls select").first.input_value() == "step"
    assert sorted(again.locator(".matrix tbody th a").all_text_contents()) == LAWFUL
    assert again.locator("#speed-controls select").first.input_value() == "cold_spring"
    assert again.locator("#speed .line").count() == 5


def test_laws_and_ends_of_a_scenario_are_dots_and_marks(full, visit):
    page = visit(full, "#scenario=stiff_spring")
    heads = page.locator(".rank thead th").all_inner_texts()
    row = page.locator(".rank tbody tr", has_text="midpoint_temperature").locator("td")
    assert row.nth(heads.index("laws kept") - 1).locator(".dot").count() == 3
    assert "B" in row.nth(heads.index("ended badly") - 1).inner_text()


def test_one_method_alone_has_every_view(alone, visit):
    page = visit(alone)
    assert page.locator(".finding").count() == 5 and page.locator(".matrix tbody th a").count() == 1
    go(page, "#scenario=short_term")
    assert page.locator(".player .side").count() == 1


def test_hostile_names_stay_text_in_every_view(hostile, visit):
    page = visit(hostile)
    for place in VIEWS:
        go(page, place)
    page.locator("#tabs a[data-view=method]").click()
    page.locator("#method-page select").first.select_option(awkward.HOSTILE)
    page.locator("#method-page h2", has_text="alert('x')").wait_for()
    assert "</script>" in page.locator("#method-page details:not(.again) pre").text_content()
    assert page.evaluate("document.querySelectorAll('[onerror], [onload], [onclick], main script').length") == 0


def test_every_control_is_reached_by_keyboard(full, visit):
    page = visit(full)
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "Skip to the overview"
    reached = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.tagName.toLowerCase()"))
    assert {"a", "select", "button", "svg"} <= reached
    page.locator(".matrix tbody th a").first.focus()
    page.keyboard.press("ArrowRight")
    here = page.evaluate("document.activeElement.getAttribute('href')")
    assert here.startswith("#scenario=") and page.locator("#tip").is_visible()
    page.keyboard.press("ArrowDown")
    assert page.evaluate("document.activeElement.getAttribute('href')") != here
    page.keyboard.press("Enter")
    page.locator(".pair").wait_for()


def test_the_page_prints_in_light_colours_without_controls_and_says_what_cells_and_dots_mean(full, visit):
    page = visit(full, color_scheme="dark")
    page.emulate_media(media="print")
    assert page.locator("#tabs").is_hidden()
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert page.locator(".matrix").is_visible() and page.locator("#speed svg").is_visible()
    assert page.locator("#matrix-controls").is_visible() and page.locator(".dot.all").first.is_visible()
    style = "e => { const s = getComputedStyle(e); return [s.appearance, s.borderTopWidth, s.printColorAdjust]; }"
    assert page.locator("#matrix-controls select").first.evaluate(style)[:2] == ["none", "0px"]
    for painted in (".matrix .dot", ".matrix .cell", ".matrix .mark"):  # else paper would show every law as broken
        assert page.locator(painted).first.evaluate(style)[2] == "exact", painted
    go(page, "#scenario=stiff_spring")
    assert page.locator(".player button").is_hidden() and page.locator("canvas").first.is_visible()


def test_without_scripts_the_sentences_and_a_table_are_there(full, visit):
    page = visit(full, java_script_enabled=False)
    assert page.locator(".finding:visible").count() == 5
    assert page.locator("noscript table tr, table.simple tr").count() >= 8
    assert not page.locator("#tabs").is_visible()


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
    go(page, "")
    page.locator("#speed-controls select").first.select_option("body")
    errors = page.locator("#speed-controls select").nth(1).locator("option")
    shown = errors.all_inner_texts()
    assert "error of m" in shown and not [x for x in shown if "positions" in x or "temperatures" in x]


def test_a_study_of_ones_own_opens_its_table_and_not_four_empty_frames(tmp_path, visit):
    mine = pd.DataFrame({"integrator": ["tc_monolithic"], "scenario": ["short_term"], "mine": [1.0]})
    page = visit(write_report(awkward.write_run(tmp_path / "run", {"own": mine}, (), {})))
    assert page.locator("table.data tbody tr").count() == 1 and page.locator("#view-overview").is_hidden()
    assert page.locator("#tabs a", has_text="Overview").is_hidden()


def test_what_authors_state_and_what_is_added_stand_apart(tmp_path, visit):
    row = {"claim": "E is of order 2", "expected": "2", "measured": "2.00", "verdict": "holds", "why": "a slope"}
    later = pd.DataFrame([row | {"stated_by": who} for who in ("Shang and Ottinger (2020)", "tcbench")])
    tables = {"conservation": awkward.conservation(awkward.FIVE), "claims": pd.DataFrame([row]), "literature": later}
    page = visit(write_report(awkward.write_run(tmp_path / "run", tables, (), {})))
    go(page, "#claims")
    headings = page.locator("#claim-page h2").all_inner_texts()
    assert headings == ["The paper's claims", "Stated by Shang and Ottinger (2020)", "Beside it, measured by tcbench"]
    assert page.locator("#claim-page table").count() == 3


def test_a_run_of_one_study_says_what_it_measured_and_no_more(tmp_path, visit):
    """The claims alone open themselves; the unmeasured is blank; a formula that took no iteration is explicit."""
    path = awkward.write_run(tmp_path / "claims", {"claims": awkward.claims()}, (), {})
    page = visit(write_report(path))
    assert page.locator("#claim-page h2").is_visible() and page.locator("#tabs a", has_text="Overview").is_hidden()
    methods = ["tc_monolithic", "controlled"]
    table = awkward.work_precision(methods, ["short_term"])
    table["newton_iterations"] = np.where(table["integrator"] == "controlled", 0.0, 100.0)
    declared = awkward.declared(methods, ["short_term"])
    declared["integrators"]["tc_monolithic"]["kind"] = declared["integrators"]["controlled"]["kind"] = "flows"
    page = visit(write_report(awkward.write_run(tmp_path / "work", {"work_precision": table}, (), declared)))
    heads = page.locator(".matrix thead th:not(.one)").all_inner_texts()
    assert heads == ["method", "laws"]  # order and stable step were not measured: columns without a number
    for name, kind in zip(methods, ("implicit, tcbench's Newton", "explicit, compiled"), strict=True):
        go(page, f"#method={name}")
        assert kind in page.locator("#method-page > .soft").inner_text()


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


class Ring(tcbench.System):
    """Masses on a ring, three of them drawn, and one temperature, of a bath that rubs on all."""

    name = "ring"
    variables = {"q": ("mass",), "p": ("mass",), "s": ()}
    tables = {"pairs": ("spring", 2, "mass")}
    constants = {"mass": ("mass",), "axes": (2, 2)}

    def energy(self, z):
        ends = z.q[self.pairs]
        return (z.p**2 / self.mass).sum() / 2 + ((ends[:, 1] - ends[:, 0]) ** 2).sum() / 2 + np.exp(z.s)

    def entropy(self, z):
        return z.s

    def reversible(self, z, dE, dS):
        return {"q": dE.p, "p": -dE.q}

    def irreversible(self, z, dE, dS):
        return {"p": -dE.p, "s": (dE.p * dE.p).sum() / dE.s}

    def temperature(self, z, dE, dS):
        return dE.s

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
    page.locator("#like-page a", has_text="stiff_spring").click()
    page.locator("#scenario-page h2", has_text="stiff_spring").wait_for()
