"""`write_report`: one run folder -> one HTML page that needs nothing else."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import TcbenchError
from ..files import replacing
from ..store.store import Store
from ..store.tables import read_tables
from ..studies.columns import column, shown
from .chart_kinds import OPENING, SERIES, Kind, kinds, with_fallbacks
from .drawing import Drawn, Job, draw_all
from .html import Charts, cell, is_numeric, script_json, svg_text, table_href

if TYPE_CHECKING:
    from pandas import DataFrame

STUDIES = {
    "conservation": ("Conservation", "What each method keeps and what it loses."),
    "convergence": ("Convergence", "The order of each method, measured in the range of steps where it shows."),
    "work_precision": ("Work and precision", "What an error costs in time; adaptive solvers beside fixed steps."),
    "stability": ("Stability", "The largest stable step, what ends it, and when runs beyond it fail."),
    "equilibrium": ("Relative equilibrium", "How near runs come to the exact rigid rotation of one temperature."),
}
SHOWN = {  # tables shown in full; the others feed charts and can be saved
    "conservation": ("conservation",),
    "convergence": ("convergence",),
    "work_precision": ("time_to_accuracy", "cost", "work_precision"),
    "stability": ("stability", "blowup_sensitivity"),
    "equilibrium": ("equilibrium_summary",),
}
EXPLORE = {  # study -> table, x, y, columns that select rows
    "conservation": ("conservation", "dt", "energy_error_max", ("scenario",)),
    "convergence": ("convergence_points", "dt", "error", ("scenario", "variable")),
    "work_precision": ("work_precision", "wall_time_min_s", "error_q", ("scenario",)),
    "stability": ("stability_points", "dt", "blowup_time", ("scenario", "solver")),
    "equilibrium": ("equilibrium", "t", "entropy_gap", ("scenario",)),
}
TRAJECTORIES = "laws"  # the chart that embeds the trajectories
PAPER = "claims"
WIDE = 10.0  # inches from which a chart takes the width of the page
CROWD = 15  # methods in a chart from which it becomes a picture: an SVG of so many lines is larger
ROWS = 500  # rows of a table that the page shows; the file that it embeds has all
EXPLORED = 4000  # rows of an interactive chart
LONGEST = 12_000  # characters of a message that are shown


@dataclass
class Drawing:
    """One chart on the page."""

    kind: str
    text: str
    scenario: str
    html: str
    wide: bool
    command: str
    href: str
    suffix: str


@dataclass
class Listing:
    """One table on the page; columns are (name, is numeric, is a filter)."""

    name: str
    columns: list[tuple[str, bool, bool]]
    rows: list[list[dict[str, Any]]]
    total: int
    href: str
    suffix: str


@dataclass
class Section:
    """One study on the page."""

    name: str
    title: str
    text: str
    drawings: list[Drawing] = field(default_factory=list)
    listings: list[Listing] = field(default_factory=list)
    explorer: str = ""


def write_report(folder: str | Path) -> Path:
    """Write `report.html` into a run folder, complete or not at all; returns its path.

    Everything that the run has is shown, and nothing is said of studies that it has not. Nothing is
    simulated and no plugin is needed. Raises TcbenchError where there is no run or nothing can be written.
    """
    store = Store.read(folder)
    tables: dict[str, DataFrame] = with_fallbacks(read_tables(store))
    if not any(len(table) for table in tables.values()):
        raise TcbenchError(f"{str(folder)!r} holds no finished cell yet; there is nothing to report.")
    text = _environment().get_template("report.html").render(**_content(store, tables))
    path = Path(folder) / "report.html"
    try:
        with replacing(path) as temporary:
            temporary.write_text(text, encoding="utf-8", errors="replace")
    except OSError as error:
        raise TcbenchError(f"{str(path)!r} cannot be written: {error.strerror or error}.") from None
    return path


def _environment() -> Any:
    from jinja2 import Environment, PackageLoader

    environment = Environment(
        loader=PackageLoader("tcbench.report"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["shorten"] = lambda text, n: text if len(text) <= n else f"{text[: n - 1]}…"
    return environment


def _content(store: Store, tables: dict[str, DataFrame]) -> dict[str, Any]:
    from .. import plugins
    from .summary import claimed, summary

    declared = _declared(tables, plugins)
    overview = summary(tables, declared)
    charts = Charts()
    drawings = _drawings(tables, store.folder, charts)
    sections = [s for name in STUDIES if (s := _section(name, tables, drawings.get(name, []))) is not None]
    known = {SERIES, OPENING, PAPER, "map", *(e[0] for e in EXPLORE.values())}.union(*SHOWN.values())
    manifest = store.manifest()
    compared = claimed(tables, declared)
    return {
        "title": store.folder.resolve().name,
        "summary": _listing("summary", overview, hide={"claims broken"}) if len(overview) else None,
        "broken": overview["claims broken"].tolist() if len(overview) else [],
        "sections": sections,
        "other": [_listing(name, table) for name, table in tables.items() if name not in known],
        "failures": _failures(store, tables),
        "claimed": _listing("claimed", compared) if len(compared) else None,
        "paper": _listing(PAPER, tables[PAPER]) if PAPER in tables else None,
        "history": _history(store.folder, charts),
        "manifest": _facts(manifest),
        "provenances": {name: _facts(data) for name, data in store.provenances().items()},
        "problems": store.problems,
        "scenarios": _names(tables, "scenario"),
        "when": manifest.get("ended", ""),
        "script_json": script_json,
        "looks": _looks(_names(tables, "integrator")),
        "longest": LONGEST,
        "libraries": _libraries(),
        "sheet": charts.sheet(),
    }


def _declared(tables: Mapping[str, DataFrame], plugins: Any) -> dict[str, Any]:
    """The integrators of the tables that are installed, members of families too."""
    found = {}
    for name in _names(tables, "integrator"):
        try:
            found[name] = plugins.find_integrator(name)
        except TcbenchError:
            continue  # a run may have been measured elsewhere, with other plugins
    return found


def _names(tables: Mapping[str, DataFrame], column: str) -> list[str]:
    return sorted({str(v) for t in tables.values() if column in t for v in t[column].dropna().unique()})


def _section(name: str, tables: Mapping[str, DataFrame], drawings: list[Drawing]) -> Section | None:
    section = Section(name, *STUDIES[name], drawings=drawings)
    section.listings = [_listing(t, tables[t]) for t in SHOWN[name] if t in tables]
    table, x, y, selects = EXPLORE[name]
    if table in tables and {x, y} <= set(tables[table].columns) and tables[table][x].notna().any():
        section.explorer = _explorer(tables[table], x, y, selects)
    return section if section.drawings or section.listings else None


def _drawings(tables: Mapping[str, DataFrame], folder: Path, charts: Charts) -> dict[str, list[Drawing]]:
    """Every chart that the tables allow, by study."""
    wanted = [
        (kind, scenario, kind.select(tables, scenario))
        for kind in kinds().values()
        if kind.possible(tables)
        for scenario in kind.scenarios(tables)
    ]
    wanted = [(kind, scenario, chosen) for kind, scenario, chosen in wanted if kind.worth(chosen)]
    jobs = [Job(k.name, chosen, k.name == "path" or _crowd(chosen) > CROWD) for k, _, chosen in wanted]
    found: dict[str, list[Drawing]] = {}
    for (kind, scenario, chosen), drawn in zip(wanted, draw_all(jobs), strict=True):
        found.setdefault(kind.study, []).append(_drawing(kind, scenario, chosen, drawn, folder, charts))
    return found


def _drawing(
    kind: Kind, scenario: str | None, chosen: Mapping[str, DataFrame], drawn: Drawn, folder: Path, charts: Charts
) -> Drawing:
    """A chart with its command and its data."""
    if SERIES in kind.needs and kind.name != TRAJECTORIES:  # the same table as another chart: embedded there
        href, suffix = f"#data-{TRAJECTORIES}-{scenario}", ""
    else:
        table = _without_bookkeeping(chosen[kind.needs[0]])
        if OPENING in kind.needs:
            table = table[[c for c in table if str(c).startswith(("integrator", "t", "x_", "y_"))]]
        elif SERIES in kind.needs:
            table = table[[c for c in table if not str(c).startswith(("x_", "y_", "status", "scenario"))]]
        href, suffix = table_href(table, 6 if {SERIES, OPENING} & set(kind.needs) else 12)
    where = f" --scenario {shlex.quote(scenario)}" if scenario else ""
    command = f"tcbench plot {kind.name} {shlex.quote(_place(folder))}{where} --output {kind.name}.svg"
    html = drawn.element or charts.element(drawn.svg)
    return Drawing(kind.name, kind.text, scenario or "", html, drawn.width > WIDE, command, href, suffix)


def _crowd(chosen: Mapping[str, DataFrame]) -> int:
    return max((table["integrator"].nunique() for table in chosen.values() if "integrator" in table), default=0)


def _place(folder: Path) -> str:
    """The folder as the reader may type it: relative to here, or its name; no path of this machine."""
    try:
        return folder.resolve().relative_to(Path.cwd().resolve()).as_posix()
    except ValueError:
        return folder.resolve().name


def _without_bookkeeping(table: DataFrame, hide: Iterable[str] = ()) -> DataFrame:
    return table[[c for c in shown(table.columns) if c not in set(hide)]]


def _listing(name: str, table: DataFrame, hide: Iterable[str] = ()) -> Listing:
    part = _without_bookkeeping(table, hide).dropna(axis=1, how="all")
    columns = [(str(c), is_numeric(part, c), str(c) in FILTERS) for c in part.columns]
    rows = [[cell(v) for v in row] for row in part.head(ROWS).itertuples(index=False)]
    href, suffix = table_href(table.drop(columns=[c for c in hide if c in table]))
    return Listing(name, columns, rows, len(table), href, suffix)


FILTERS = {
    "integrator", "scenario", "status", "verdict", "variable", "limit", "study", "claim", "factor", "section", "solver",
    "measure",
}  # fmt: skip


def _explorer(table: DataFrame, x: str, y: str, selects: tuple[str, ...]) -> str:
    """The data of an interactive chart, as JSON for the page."""
    stride = -(-len(table) // EXPLORED)
    thin = table.iloc[::stride]
    numeric = [c for c in shown(thin.columns) if is_numeric(thin, c) and thin[c].notna().any()]
    y = y if y in numeric else next((c for c in numeric if c != x), x)
    keep = [c for c in ("integrator", "status", *selects, *numeric) if c in thin]
    return script_json({
        "columns": {c: _packed(thin, c) for c in dict.fromkeys(keep)},
        "numeric": numeric,
        "selects": [c for c in selects if c in thin],
        "labels": {c: column(c).label for c in numeric},
        "x": x, "y": y, "thinned": stride > 1,
    })  # fmt: skip


def _packed(table: DataFrame, column: str) -> Any:
    """Numbers as they are; words as places in a list of the distinct ones."""
    if is_numeric(table, column):
        return table[column].tolist()
    words = [str(v) for v in table[column]]
    found = list(dict.fromkeys(words))
    place = {word: i for i, word in enumerate(found)}
    return {"words": found, "at": [place[word] for word in words]}


SYMBOLS = {
    "o": "circle", "s": "square", "^": "triangle-up", "D": "diamond", "v": "triangle-down", "P": "cross", "X": "x",
    "h": "hexagon", "<": "triangle-left", ">": "triangle-right", "p": "pentagon", "*": "star", "d": "diamond-tall",
    "H": "hexagon2", "8": "octagon",
}  # fmt: skip
DASHES = {"-": "solid", "--": "dash", "-.": "dashdot"}


def _looks(integrators: Iterable[str]) -> str:
    from .charts.style import look

    styles = {name: look(name) for name in integrators}
    return script_json({n: [s.colour, SYMBOLS[s.marker], DASHES.get(str(s.dash), "dot")] for n, s in styles.items()})


def _failures(store: Store, tables: Mapping[str, DataFrame]) -> list[dict[str, str]]:
    """Every cell that did not end well, with its sentence: from the rows, or from the tables where rows are absent."""
    records: Iterable[Mapping[str, Any]] = store.records()
    if not records:
        records = (
            {"study": name, **row}
            for name, table in tables.items()
            if {"failure", "status"} <= set(table.columns) and name != "stability_points"
            for row in table.to_dict("records")
        )
    found = []
    for record in records:
        failure = record.get("failure")
        if record.get("status", "ok") != "ok" or (isinstance(failure, str) and failure):
            control = next(
                (f"{c} = {record[c]:g}" for c in ("dt", "tolerance", "value") if _is_number(record.get(c))), ""
            )
            text = str(failure) if isinstance(failure, str) else ""
            found.append({
                "study": str(record.get("study") or ""), "integrator": str(record.get("integrator") or ""),
                "scenario": str(record.get("scenario") or ""), "control": control,
                "status": str(record.get("status") or ""), "failure": text[:LONGEST],
            })  # fmt: skip
    return found


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and value == value


def _history(folder: Path, page: Charts) -> Section | None:
    from .asv_history import find_history, read_history
    from .charts.runs import history

    place = find_history(folder)
    table = None if place is None else read_history(place)
    if table is None or not len(table):
        return None
    section = Section("history", "Performance over commits", "What asv recorded; each panel starts at 0.")
    href, suffix = table_href(table)
    drawn = page.element(svg_text(history(table)))
    section.drawings.append(Drawing("history", section.text, "", drawn, True, "asv run && asv publish", href, suffix))
    latest = table.assign(date=table["date"].dt.strftime("%Y-%m-%d"))
    section.listings.append(_listing("history", latest.tail(ROWS)))
    return section


def _facts(data: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Nested data as (name, value) lines; a command is shown without the folder of its program."""
    lines: list[tuple[str, str]] = []
    for key, value in data.items():
        name = f"{prefix}{key}"
        if key == "command" and isinstance(value, list) and value:
            words = [str(value[0]).replace("\\", "/").rpartition("/")[2], *map(str, value[1:])]
            lines.append((name, " ".join(words)))
        elif isinstance(value, Mapping):
            lines += _facts(value, f"{name}.")
        elif isinstance(value, list):
            lines.append((name, ", ".join(map(str, value))))
        else:
            lines.append((name, str(value)))
    return lines


def _libraries() -> dict[str, str]:
    """The JavaScript that the page embeds; versions and licences are in templates/vendor/LICENSES.txt.

    Plotly, by far the largest, is compressed: the page unpacks it when the first interactive chart comes into view.
    """
    import base64
    import gzip
    from importlib.resources import files

    vendor = files(__package__) / "templates" / "vendor"
    plain = [(vendor / name).read_text("utf-8") for name in ("jquery.slim.min.js", "dataTables.min.js")]
    packed = gzip.compress((vendor / "plotly-basic.min.js").read_bytes(), mtime=0)
    return {
        "tables": "\n".join(text.replace("</script", "<\\/script") for text in plain),
        "plotly": base64.b64encode(packed).decode(),
    }
