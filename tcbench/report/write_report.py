"""`write_report`: one run folder -> one HTML page that needs nothing else: no network, no plugins, no simulation."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import TcbenchError, writing
from ..files import replacing
from ..runner.rows import Store
from ..runner.tables import read_tables
from ..simulation.series import ROW, variables
from ..studies.base import table_schemas
from ..studies.columns import column
from ..studies.work_precision import SPENT_S
from ..table import Table
from .by_method import paper
from .chart_kinds import kinds
from .charts.scales import power_text
from .highlight import leaders
from .html import packed, packed_json, packed_table, script_hash, script_text, vendored
from .marks import MARKS
from .overview import findings, lawful_ones, scenario_answers
from .page_charts import panels_of
from .page_data import FAMILIES, failures, law_dots, lenses, methods, names, stopped, telling
from .pairs import LOOSE, pairs
from .plot import run_looks
from .together import machine, together

if TYPE_CHECKING:
    from pandas import DataFrame

SCRIPTS = ("base", "chart", "panels", "overview", "player", "scenarios", "methods", "tables", "main")  # in their order
POWER = re.compile(r"(?<![\d.])1e-\d+")
TOGETHER = re.compile(r"(?<=\d) (?=(?:%|µs|ms|s)(?!\w))|(?<=\b[ht]) (?==)|(?<=\b[ht] =) ")


def write_report(
    folder: str | Path, source: tuple[Store, Mapping[str, DataFrame]] | None = None, page: Path | None = None,
    others: Sequence[str | Path] = (),
) -> Path:  # fmt: skip
    """Write `report.html` into a run folder, complete or not at all; returns its path.

    source : the folder's store and tables, where they have been read. page : another place for it. others : folders of
    runs that are on the page, too.

    Everything that the run has is shown, and nothing is said of studies that it has not. Raises TcbenchError where
    there is no run or nothing can be written.
    """
    store, tables = source or (run := Store.read(folder), read_tables(run))
    if not any(len(table) for table in tables.values()):
        raise TcbenchError(f"{str(folder)!r} holds no finished cell yet; there is nothing to report.")
    tables, declared, beside = together(store, tables, others) if others else (dict(tables), store.declared(), [])
    content = _content(store, tables, declared)
    runs = [Path(name).resolve().name for name in ([folder, *others] if others else [])]
    text = templates().get_template("report.html").render(**content, beside=beside, runs=runs)
    path = page or Path(folder) / "report.html"
    with writing(repr(str(path))), replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="replace")
    return path


def templates() -> Any:
    """Those of the page and of a site of them."""
    from jinja2 import Environment, PackageLoader

    environment = Environment(
        loader=PackageLoader("tcbench.report"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["shorten"] = lambda text, n: text if len(text) <= n else f"{text[: n - 1]}…"
    return environment


def _unbroken(text: str) -> str:
    """No line ends between a number and its unit, nor within h = 0.3 or 1e-6, which is 10⁻⁶ as in the page's lists."""
    return TOGETHER.sub("\u00a0", POWER.sub(lambda match: power_text(float(match[0])), text))


def _content(store: Store, tables: dict[str, DataFrame], declared: Mapping[str, Any]) -> dict[str, Any]:
    """What the template of the page asks for."""
    texts = "\n".join(script_text(f"{name}.js") for name in SCRIPTS)
    script = f'"use strict";\n(async () => {{\n{texts}\n}})();'
    manifest, results, scenarios = store.manifest(), pairs(tables, declared), names(tables, "scenario")
    rows = methods(results, tables, declared)
    charts = panels_of(kinds().values(), tables, declared, store.problems)
    schemas = {name: Table(name) for name in tables} | table_schemas(declared)
    columns = {name: [column(str(c), schemas[name]) for c in table.columns] for name, table in tables.items()}
    data = {
        "families": FAMILIES, "methods": rows, "scenarios": scenarios, "declared": _named(declared, tables),
        "looks": {name: [one.colour, one.marker, dashes(one.dash)] for name, one in run_looks(tables).items()},
        "leaders": leaders(tables, declared, results),
        "answers": {name: [(*question, _unbroken(text)) for *question, text in said]
                    for name, said in scenario_answers(results, tables, scenarios).items()},
        "lawful": lawful_ones(results), "loose": LOOSE, "paper": paper(tables.get("claims")),
        "dots": law_dots(results, declared), "opening": telling(results), "marks": MARKS,
        "lenses": lenses(results), "failures": failures(tables), "stopped": stopped(tables),
        "charts": list(charts), "tables": {name: len(table) for name, table in tables.items()},
        "places": {name: names({name: table}, "scenario") for name, table in tables.items()},
        "labels": {one.name: one.label for of in columns.values() for one in of},
        "variables": [*dict.fromkeys(c for name in ROW[:2] if name in tables for c in variables(tables[name].columns))],
        "filters": {name: [one.name for one in of if one.filter] for name, of in columns.items()},
    }  # fmt: skip
    return {
        "title": store.folder.resolve().name,
        "machine": machine(manifest),
        "when": str(manifest.get("ended", "")),
        "counts": (len(rows), len(scenarios)),
        "findings": [
            finding._asdict() | {"text": _unbroken(finding.text)} for finding in findings(results, tables, declared)
        ],
        "methods": rows,
        "families": FAMILIES,
        "claims": "claims" in tables,
        "spent_ms": f"{1e3 * SPENT_S:g}",
        "charts": bool(charts),
        "charts_packed": packed_json(charts),
        "metrics": {n: m["description"] for n, m in declared.get("metrics", {}).items() if m["description"]},
        "absent": sorted(declared.get("absent", {}).items()),
        "manifest": _facts(manifest),
        "provenances": {name: _facts(facts) for name, facts in store.provenances().items()},
        "references": _references(tables),
        "problems": store.problems,
        "page": packed_json(data),
        "packed": {name: packed_table(table, schemas[name]) for name, table in tables.items()},
        "library": packed(vendored()),
        "script": script,
        "hashes": [script_hash(text) for text in (script, vendored())],
        "css": (css := script_text("report.css")),
        "style_hash": script_hash(css),
    }


def dashes(dash: Any) -> str:
    """A dash of matplotlib as one of SVG, for a line of two points."""
    parts = {"-": (), "--": (3.5, 1.6), "-.": (5, 1.5, 1, 1.5)}.get(dash) if isinstance(dash, str) else dash[1]
    return " ".join(f"{2 * length:g}" for length in parts or ())


def _named(declared: Mapping[str, Any], tables: Mapping[str, DataFrame]) -> dict[str, dict[str, Any]]:
    """What is declared of the methods and scenarios that the tables have."""
    kinds = {"integrators": "integrator", "scenarios": "scenario"}
    return {
        key: {name: declared[key][name] for name in names(tables, kind) if name in declared.get(key, {})}
        for key, kind in kinds.items()
    }


def _references(tables: Mapping[str, DataFrame]) -> list[tuple[str, str]]:
    """What errors are measured against, by scenario, with its own uncertainty where a table has it."""
    floor_of: dict[tuple[str, str], float] = {}
    for study in ("work_precision", "convergence"):
        table = tables.get(study)
        if table is not None and "reference" in table:
            floors = table.get("reference_floor", table["reference"].map(lambda _: math.nan))
            for (name, text), floor in floors.groupby([table["scenario"], table["reference"]]).max().items():
                floor_of.setdefault((str(name), str(text)), float(floor))
    return [(name, f"{text}: ± {x:.1g}" if x == x else text) for (name, text), x in sorted(floor_of.items())]


def _facts(data: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Nested data as (name, value) lines; a command is shown without the folder of its program."""
    lines: list[tuple[str, str]] = []
    for key, value in data.items():
        if isinstance(value, Mapping):
            lines += _facts(value, f"{prefix}{key}.")
        elif value not in (None, False, "") and not (value == [] and key == "command"):  # no commit, not interrupted
            first, *rest = map(str, value) if isinstance(value, list) and value else [str(value)]
            first = first.replace("\\", "/").rpartition("/")[2] if key == "command" and rest else first
            lines.append((f"{prefix}{key}", (" " if key == "command" else ", ").join([first, *rest])))
    return lines
