"""The report page as a file: complete without a network, without plugins, and harmless whatever it is told."""

import base64
import gzip
import json
from html.parser import HTMLParser

import awkward
import pandas as pd
import pytest

import tcbench
from tcbench.errors import TcbenchError
from tcbench.report import write_report as report
from tcbench.studies.base import table_schemas
from tcbench.studies.columns import column

pytestmark = pytest.mark.usefixtures("cells_here")

LARGEST = 4_000_000


class Page(HTMLParser):
    """Elements by tag, the text outside scripts and styles, and what stands inside scripts by their id."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.text, self.inside, self.scripts = [], [], [], {}
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        if tag in ("script", "style"):
            self.inside.append(dict(attributes).get("id", tag))

    def handle_endtag(self, tag):
        if tag in ("script", "style"):
            self.inside.pop()

    def handle_data(self, data):
        if self.inside:
            self.scripts[self.inside[-1]] = self.scripts.get(self.inside[-1], "") + data
        else:
            self.text.append(data)

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]

    @property
    def data(self):
        return self.unpacked("page")

    def unpacked(self, name):
        return json.loads(gzip.decompress(base64.b64decode(self.scripts[name])))

    def table(self, name):
        """A packed table as the page's script unpacks it."""
        columns = self.unpacked(f"table-{name}")
        plain = {c: self.column(v, self.data["tables"][name]) for c, v in columns.items()}
        return pd.DataFrame(plain)

    @staticmethod
    def column(packed, size):
        if isinstance(packed, list):
            return packed
        if "words" in packed:
            return [None if i < 0 else packed["words"][i] for i in packed["at"]]
        found = [None] * size
        for start, values in zip(packed["from"], packed["of"], strict=True):
            found[start : start + len(values)] = values
        return found


@pytest.fixture(scope="module", autouse=True)
def elsewhere(tmp_path_factory):
    """Away from a record of asv in the working directory, also while pages are made that several tests read."""
    with pytest.MonkeyPatch.context() as patched:
        patched.chdir(tmp_path_factory.mktemp("elsewhere"))
        yield


def make(folder, tables, rows=(), declared=None):
    path = report.write_report(awkward.write_run(folder, tables, rows, declared))
    return path, path.read_text("utf-8")


@pytest.fixture(scope="module")
def full(tmp_path_factory):
    tables = awkward.everything([*awkward.FIVE, *awkward.PEERS])
    return make(tmp_path_factory.mktemp("full") / "run", tables, declared=awkward.declared(awkward.FIVE))


def test_the_page_is_one_small_file_that_asks_for_nothing_else(full):
    path, text = full
    assert path.stat().st_size < LARGEST
    page = Page(text)
    for tag, name in (("img", "src"), ("link", "href"), ("script", "src")):
        assert all(a.get(name, "data:").startswith("data:") for a in page.all(tag))
    assert all(a.get("href", "").startswith("#") for a in page.all("a"))
    assert "default-src 'none'" in text and "/opt/x" not in text


def test_every_table_is_embedded_with_its_numbers(full):
    tables = awkward.everything([*awkward.FIVE, *awkward.PEERS])
    page, known = Page(full[1]), table_schemas()
    assert page.data["tables"] == {name: len(table) for name, table in tables.items()}
    for name, table in tables.items():
        found = page.table(name)
        assert len(found) == len(table)
        for each in found.select_dtypes("number"):
            digits = column(each, known[name]).digits or known[name].digits
            digits = 9 if each in ("energy", "entropy", "angular_momentum") else min(digits, 10)
            exact = table[each].reset_index(drop=True)
            pd.testing.assert_series_equal(found[each], exact, check_dtype=False, rtol=6.0 * 10.0**-digits)
    assert page.table("claims")["measured"].tolist()[-1] == awkward.HOSTILE


def test_the_sentences_stand_in_the_page_itself_and_lead_to_their_evidence(full):
    page = Page(full[1])
    cards = [a["href"] for a in page.all("a") if a["href"].startswith(("#lens", "#failures"))][
        1:6
    ]  # the first is a tab
    assert cards == ["#lens=time 1e-06", "#lens=coarse", "#lens=energy", "#lens=cost", "#failures"]
    words = "".join(page.text)
    assert "kept energy, entropy and angular momentum" in words and "at the smallest step" in words


def test_a_real_run_is_reported_without_simulation(tmp_path, monkeypatch):
    out = tmp_path / "run"
    tcbench.run(["tc_monolithic", "midpoint_entropy"], ["stiff_spring"], ["conservation"], out, jobs=1)

    def forbidden(*_, **__):
        raise AssertionError("a report is drawn from its folder alone")

    monkeypatch.setattr("tcbench.simulation.run.simulate", forbidden)
    page = Page(report.write_report(out).read_text("utf-8"))
    told = page.data["declared"]
    assert "discrete_gradient" in told["integrators"]["tc_monolithic"]["formula"]
    assert told["scenarios"]["stiff_spring"]["links"] == [[0, 1], [1, 2]]
    assert "exceeded the initial exergy" in page.data["failures"]["midpoint_entropy"]["stiff_spring"][2]
    assert {"x_1", "y_2", "temperature_a", "energy_error"} <= set(page.table("series").columns)
    assert not list(out.glob(".report*"))


def test_a_folder_without_rows_is_an_error(tmp_path):
    with pytest.raises(TcbenchError, match="There is no run"):
        report.write_report(tmp_path)
    with pytest.raises(TcbenchError, match="no finished cell"):
        report.write_report(awkward.write_run(tmp_path / "run", {}))


def test_tables_alone_are_enough(tmp_path):
    """A published run keeps its CSV tables, not its rows, and may be older than declared.json."""
    folder = awkward.write_run(tmp_path / "run", {"conservation": awkward.conservation(awkward.FIVE)})
    for path in [folder / "cells.jsonl", *folder.glob("tables/*.parquet")]:
        path.unlink()
    page = Page(report.write_report(folder).read_text("utf-8"))
    assert "blew up" in page.data["failures"]["midpoint_entropy"]["short_term"][2]
    assert {m["family"] for m in page.data["methods"]} == {4} and page.data["declared"]["integrators"] == {}


def test_the_page_names_what_is_absent_and_what_the_columns_of_plugins_are(tmp_path):
    table = awkward.conservation(awkward.FIVE).assign(hottest=380.0, tolerance=1e-3)
    told = awkward.declared(awkward.FIVE) | {"metrics": {"hottest": {"unit": "K", "description": "the highest one"}}}
    told |= {"absent": {"heyoka": "it needs packages: pip install heyoka"}}
    page = Page(make(tmp_path / "run", {"conservation": table}, (), told)[1])
    words = "".join(page.text)
    assert page.data["labels"]["hottest"] == "hottest, K" and "the highest one" in page.text
    assert "Not installed: heyoka." in words and "pip install heyoka" in words
    assert [*page.table("conservation")][2:4] == ["dt", "tolerance"]  # not twenty columns to the right
    assert list(page.data["tables"]) == ["conservation"]  # studies that the run has not are not mentioned
    assert [lens["key"] for lens in page.data["lenses"]] == ["energy", "cost"] and "An accurate" not in words
