"""The report page in a real browser: its views, links, keyboard, sizes and colours, and no word on the console."""

import csv
import io

import awkward
import numpy as np
import pandas as pd
import pytest

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


# what answers to a click and is no control of its own accord; lines of charts answer to arrow keys, as cells do
CLICKED = """() => [...document.querySelectorAll("body *")].filter(e => e.checkVisibility()
  && getComputedStyle(e).cursor === "pointer" && !e.closest("a, button, select, input, summary, label, [tabindex='0']"))
  .map(e => e.outerHTML.slice(0, 80))"""
STOPS = """() => [...document.querySelectorAll("a[href], button, select, input, summary, [tabindex='0']")]
  .filter(e => e.checkVisibility() && e.tabIndex >= 0 && !e.disabled).map(e => e.outerHTML.slice(0, 200))"""
HERE = """() => { const e = document.activeElement, s = getComputedStyle(e);
  return [e.outerHTML.slice(0, 200), s.outlineStyle !== "none" && parseFloat(s.outlineWidth) > 0]; }"""


@pytest.mark.parametrize("place", ["", "#scenario=stiff_spring", "#method=tc_strang", "#claims", "#table=stability"])
def test_tab_alone_reaches_every_control_and_shows_where_it_is(full, place, visit):
    page = visit(full, place)
    page.wait_for_timeout(300)
    assert page.evaluate(CLICKED) == []
    reached = {}
    for _ in range(400):
        page.keyboard.press("Tab")
        element, seen = page.evaluate(HERE)
        if element in reached and len(reached) > 5 and element == next(iter(reached)):
            break
        reached.setdefault(element, seen)
    assert "Skip to the overview" in next(iter(reached))
    assert {*page.evaluate(STOPS)} - {*reached} == set()
    assert [element for element, seen in reached.items() if not seen and not element.startswith("<body")] == []


def test_keys_walk_the_matrix_and_open_a_cell(full, visit):
    page = visit(full)
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
