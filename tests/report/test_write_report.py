"""The report page: complete without a network and without scripts, and alive in a real browser."""

import base64
import gzip
import io
import json
import math
import re
import shutil
import time
from html.parser import HTMLParser

import awkward
import pandas as pd
import pytest

import tcbench
from tcbench.errors import TcbenchError
from tcbench.report import drawing, summary
from tcbench.report import write_report as report
from tcbench.report.asv_history import read_history

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
LARGEST = 5_000_000


class Page(HTMLParser):
    """Elements by tag, and the text outside scripts and styles."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.text, self.inside = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        if tag in ("script", "style"):
            self.inside.append(tag)

    def handle_endtag(self, tag):
        if self.inside and self.inside[-1] == tag:
            self.inside.pop()

    def handle_data(self, data):
        if not self.inside:
            self.text.append(data)

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


def make(folder, tables, rows=()):
    path = report.write_report(awkward.write_run(folder, tables, rows))
    return path, path.read_text("utf-8")


@pytest.fixture(scope="module")
def full(tmp_path_factory):
    return make(tmp_path_factory.mktemp("full") / "run", awkward.everything([*awkward.FIVE, *awkward.PEERS]))


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    methods, scenarios = ["tc_monolithic", awkward.HOSTILE, "x" * 10_000], [*awkward.SCENARIOS, awkward.HOSTILE]
    settings = {"failing": lambda name, h: name != "tc_monolithic", "failure": (awkward.HOSTILE * 300)[:10_000]}
    cell = {"study": "conservation", "integrator": awkward.HOSTILE, "scenario": "short_term", "options": {"dt": 0.1}}
    rows = [(cell, {"status": "exception", "failure": "</script>" + "y" * 9_990, "energy_error_max": 0.1})]
    return make(tmp_path_factory.mktemp("hostile") / "run", awkward.everything(methods, scenarios, **settings), rows)


def test_the_page_is_one_small_file_that_asks_for_nothing_else(full):
    path, text = full
    assert path.stat().st_size < LARGEST
    page = Page(text)
    for tag, name in (("img", "src"), ("link", "href"), ("script", "src")):
        assert all(a.get(name, "data:").startswith("data:") for a in page.all(tag))
    assert all(a.get("href", "").startswith(("#", "data:")) for a in page.all("a"))
    assert "default-src 'none'" in text


def test_the_summary_comes_first_and_every_study_has_its_charts_and_data(full):
    _, text = full
    page = Page(text)
    order = [a["id"] for a in page.all("section")]
    assert order[0] == "summary" and set(report.STUDIES) <= set(order)
    assert {"failures", "claimed", "paper", "provenance"} <= set(order)
    kinds = {a["data-kind"] for a in page.all("figure")}
    assert {"work-precision", "convergence", "conservation", "laws", "stable-step", "blowup", "equilibrium"} <= kinds
    assert "tcbench plot convergence" in text and "/opt/x" not in text
    for name, attributes in ((a["download"], a) for a in page.all("a") if "download" in a):
        data = base64.b64decode(attributes["href"].partition(",")[2])
        table = pd.read_csv(io.BytesIO(gzip.decompress(data) if name.endswith(".gz") else data))
        assert len(table)


def test_the_data_of_a_chart_are_the_rows_that_it_shows(full):
    href = re.search(r'download="work-precision-stiff_spring.csv" href="data:text/csv;base64,([^"]*)"', full[1])[1]
    table = pd.read_csv(io.BytesIO(base64.b64decode(href)))
    wanted = awkward.work_precision([*awkward.FIVE, *awkward.PEERS])
    wanted = wanted[wanted["scenario"] == "stiff_spring"].reset_index(drop=True)
    pd.testing.assert_series_equal(table["error_q"], wanted["error_q"], rtol=1e-11)


def test_absent_studies_are_dashes_in_the_summary_and_not_mentioned_below(tmp_path):
    _, text = make(tmp_path / "run", {"conservation": awkward.conservation(awkward.FIVE)})
    assert 'id="convergence"' not in text and 'id="paper"' not in text
    row = re.search(r"<tr>.*?</tr>", text[text.index("<tbody>") :], re.S)[0]
    assert re.findall(r">([^<]*)</td>", row)[3:6] == ["-", "-", "-"]


def test_hostile_names_and_messages_are_text(hostile):
    path, text = hostile
    assert path.stat().st_size < LARGEST
    page = Page(text)
    assert "alert('x')" in "".join(page.text) and "y" * 9_990 in "".join(page.text)
    assert not [a for tag, a in page.elements if any(name.startswith("on") for name in a)]
    scripts = [a for a in page.all("script") if a.get("type") not in ("application/json", "application/gzip")]
    assert len(scripts) == 2  # the libraries and the page's own


def test_summary_says_what_was_measured():
    tables = awkward.everything(awkward.FIVE)
    declared = tcbench.integrators()
    table = summary.summary(tables, declared).set_index(["scenario", "integrator"])
    good = table.loc[("short_term", "tc_monolithic")]
    assert (good["claims kept"] == "3 of 3" and good["order"] == "undetermined") or good["order"] == "2.00"
    assert good["max stable step"] == "above 12" and good["failures"] == "0 of 5"
    assert table.loc[("short_term", "midpoint_temperature")]["failures"] == "3 of 5"
    broken = tables["conservation"].assign(energy_error_max=1e-3)
    mine = broken[broken["integrator"] == "tc_monolithic"]
    assert summary.claims_kept(mine, declared["tc_monolithic"]) == ("2 of 3, not energy", 1)
    nothing = mine.assign(steps=0, second_law_violations=0, status="exception")
    assert summary.claims_kept(nothing, declared["tc_monolithic"]) == ("no step done", 0)
    assert not len(summary.claimed({"conservation": nothing}, declared))
    assert summary.stable_step(pd.DataFrame([{"dt_stable": math.nan, "limit": math.nan}])) == "none found"
    verdicts = summary.claimed({"conservation": broken}, declared).set_index(["integrator", "claim"])["verdict"]
    assert verdicts["tc_monolithic", "energy"] == "broken"
    assert verdicts["midpoint_entropy", "energy"] == "not claimed, not kept"


def test_time_to_target_is_the_fastest_run_that_is_accurate_in_everything():
    rows = pd.DataFrame({
        "status": ["ok", "ok", "ok", "blowup"], "error_q": [1e-7, 1e-7, 1e-8, 1e-9],
        "error_theta": [1e-5, 1e-7, float("nan"), 1e-9], "wall_time_min_s": [1e-6, 0.25, 0.5, 1e-7],
    })  # fmt: skip
    assert summary.time_to_target(rows) == "250 ms"
    assert summary.time_to_target(rows.iloc[:1]) == "not reached" and summary.time_to_target(None) == "-"


def test_a_real_run_is_reported_with_its_trajectories_in_time(tmp_path):
    out = tmp_path / "run"
    tcbench.run(["tc_monolithic", "midpoint_entropy"], ["stiff_spring"], ["conservation"], out, jobs=1)
    begin = time.perf_counter()
    text = report.write_report(out).read_text("utf-8")
    assert time.perf_counter() - begin < 15
    assert all(f'data-kind="{kind}"' in text for kind in ("laws", "four-panel", "path", "conservation"))
    assert "exceeded 1 times the initial exergy" in text
    assert not list(out.glob(".report*"))


def test_a_helper_that_fails_costs_no_chart(monkeypatch):
    jobs = [drawing.Job("conservation", {"conservation": awkward.conservation(awkward.FIVE, ["s"])}, False)] * 12
    whole = drawing.draw_all(jobs)
    monkeypatch.setattr(drawing.sys, "executable", "/nonexistent")
    assert [d.svg for d in drawing.draw_all(jobs)] == [d.svg for d in whole] and len(whole) == 12
    monkeypatch.setattr(drawing.sys, "executable", shutil.which("false"))
    assert drawing.draw_all(jobs)[11].svg == whole[11].svg


def test_a_folder_without_rows_is_an_error(tmp_path):
    with pytest.raises(TcbenchError, match="There is no run"):
        report.write_report(tmp_path)
    with pytest.raises(TcbenchError, match="no finished cell"):
        report.write_report(awkward.write_run(tmp_path / "run", {}))


def test_tables_alone_are_enough(tmp_path):
    """A published run keeps its CSV tables, not its rows."""
    folder = awkward.write_run(tmp_path / "run", {"conservation": awkward.conservation(awkward.FIVE)})
    for path in [folder / "cells.jsonl", *folder.glob("tables/*.parquet")]:
        path.unlink()
    assert "blew up" in report.write_report(folder).read_text("utf-8")


def test_the_history_of_asv_is_shown_where_there_is_one(tmp_path):
    folder = awkward.write_run(tmp_path / "run", {"conservation": awkward.conservation(awkward.FIVE)})
    results = folder / ".asv" / "results"
    (results / "here").mkdir(parents=True)
    (results / "benchmarks.json").write_text("{}")
    (results / "here" / "machine.json").write_text("{}")
    (results / "here" / "broken.json").write_text("[")
    for i, commit in enumerate(("aaaa1111", "bbbb2222")):
        measured = {"step.time": [[1.5 + i, None], [["'tc'", "'mid'"]]], "step.size": [[3.0], []]}
        data = {"commit_hash": f"{commit}00", "date": 1700000000000 + i * 10**8, "results": measured}
        data["result_columns"] = ["result", "params"]
        (results / "here" / f"{commit}-env.json").write_text(json.dumps(data))
    table = read_history(results)
    assert table["value"].tolist() == [3.0, 3.0, 1.5, 2.5] and set(table["parameters"]) == {"", "tc"}
    text = report.write_report(folder).read_text("utf-8")
    assert 'id="history"' in text and "step.time" in text


# -- in a browser


@pytest.fixture(scope="module")
def browser():
    program = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if program is None:
        pytest.skip("no Chromium on this machine (apt-get install chromium)")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed (extra: dev)")
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=program, args=FLAGS)
        yield chromium
        chromium.close()


@pytest.fixture
def visit(browser):
    """Open a page; afterwards: no console message, no request but for the page itself."""
    contexts, messages, requests = [], [], []

    def opened(path, width=1600, **settings):
        context = browser.new_context(viewport={"width": width, "height": 900}, **settings)
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: messages.append(message.text))
        page.on("pageerror", lambda error: messages.append(str(error)))
        page.on("dialog", lambda dialog: (messages.append("dialog"), dialog.dismiss()))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(path.as_uri())
        return page

    yield opened
    for context in contexts:
        context.close()
    assert messages == []
    assert [url[:100] for url in requests if not url.startswith(("file:", "data:", "blob:"))] == []
    assert len([url for url in requests if url.startswith("file:")]) == len(contexts)


def plotted(page, study):
    """The interactive chart of a study, drawn."""
    holder = page.locator(f".explorer[data-study={study}]")
    holder.scroll_into_view_if_needed()
    holder.locator(".main-svg").first.wait_for()
    return holder


def test_tables_sort_and_filter(full, visit):
    page = visit(full[0])
    table = page.locator("#table-conservation")
    column = "() => [...document.querySelectorAll('#table-conservation tbody tr')].map(r => +r.children[2].textContent)"
    head = table.locator("thead th").nth(2)
    assert head.text_content() == "dt"
    rows = page.evaluate(column)
    assert len(set(rows)) == 5 and rows != sorted(rows)
    becomes = f"wanted => JSON.stringify(({column})()) === JSON.stringify(wanted)"  # the table sorts when it has time
    head.locator("[role=button]").focus()
    page.keyboard.press("Enter")
    page.wait_for_function(becomes, arg=sorted(rows))
    page.keyboard.press("Enter")
    page.wait_for_function(becomes, arg=sorted(rows, reverse=True))
    tools = page.locator("#conservation .tools:has(input[type=search])").first
    tools.locator("select").first.select_option("cvode_bdf")
    assert table.locator("tbody tr").count() == 15
    tools.locator("input").fill("stiff")
    assert table.locator("tbody tr").count() == 5


def test_numbers_sort_as_numbers(full, visit):
    page = visit(full[0])
    table = page.locator("#table-work_precision")
    table.locator("th:has-text('error_q') [role=button]").click()
    table.locator("th[aria-sort=ascending]").wait_for()
    index = table.locator("thead th").all_text_contents().index("error_q")
    cells = f"[...document.querySelectorAll('#table-work_precision tbody tr > :nth-child({index + 1})')]"
    texts = f"{cells}.map(c => c.textContent).filter(t => t !== '')"
    page.wait_for_function(
        f"() => {texts}.every((t, i, all) => i === 0 || +all[i - 1] <= +t)"
    )  # sorts when it has time
    assert float(page.evaluate(f"() => {texts}")[0]) < 1e-8


def test_charts_respond(full, visit):
    page = visit(full[0])
    holder = plotted(page, "work_precision")
    plot = holder.locator(".plot")
    assert holder.locator(".xtitle").text_content() == "wall time, s (minimum)"
    holder.locator("label:has-text('x') select").first.select_option("steps")
    page.wait_for_function("() => document.querySelector('#work_precision .xtitle').textContent == 'steps'")
    shown = "p => p.data.filter(t => t.visible === true).length"
    assert plot.evaluate(shown) == 7
    holder.locator("details.shown summary").click()
    holder.locator(".methods input").first.uncheck()
    assert plot.evaluate(shown) == 6
    holder.locator("select").first.select_option("stiff_spring")
    assert plot.evaluate("p => p.data.some(t => t.marker.symbol.includes('x-open'))")  # failed runs are still there
    parted = "t => t.marker.symbol.every((s, k) => s !== 'x-open' || k === 0 || t.y[k] === null || t.y[k - 1] === null)"
    assert plot.evaluate(f"p => p.data.every({parted})")  # and no line leads to them
    box = holder.locator(".point").nth(2).bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2 + 9, box["y"] + box["height"] / 2)
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    holder.locator(".hovertext").first.wait_for()


def test_one_list_chooses_the_scenario_of_all_charts(full, visit):
    page = visit(full[0])
    page.locator("#scenario").select_option("cold_spring")
    assert page.locator("figure[data-scenario=short_term]:visible").count() == 0
    assert page.locator("figure[data-scenario=cold_spring]:visible").count() > 3


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [400, 1600])
@pytest.mark.parametrize("which", ["full", "hostile"])
def test_nothing_overflows_and_text_is_readable(which, width, scheme, request, visit):
    page = visit(request.getfixturevalue(which)[0], width, color_scheme=scheme)
    for study in report.EXPLORE:
        plotted(page, study)
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    assert page.evaluate("document.body.scrollWidth - innerWidth") <= 0
    light = page.evaluate(
        """() => ['body', 'figure svg text', '.xtitle'].map(s => {
             const style = getComputedStyle(document.querySelector(s));
             const parts = (s === 'body' ? style.color : style.fill).match(/\\d+/g).map(Number);
             return (parts[0] + parts[1] + parts[2]) / 765; })"""
    )
    assert all(v > 0.7 if scheme == "dark" else v < 0.3 for v in light)


def test_the_page_is_readable_with_scripts_off(full, visit):
    page = visit(full[0], java_script_enabled=False)
    assert page.locator("#table-summary tbody tr").count() == 21 + 7
    assert page.locator("figure svg:visible").count() > 10
    assert page.locator(".explorer:visible").count() == 0


def test_every_control_is_reached_by_keyboard(full, visit):
    page = visit(full[0])
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "Skip to the summary"
    tags = set()
    for _ in range(40):
        page.keyboard.press("Tab")
        tags.add(page.evaluate("document.activeElement.tagName + (document.activeElement.getAttribute('role') || '')"))
    assert {"A", "INPUT", "SELECT", "SPANbutton", "DIVregion"} <= tags
