"""What the terminal shows: tables that fit 80 columns, plain text when piped."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from shlex import quote
from typing import TYPE_CHECKING, Any

import orjson
import rich.table
from rich.console import Console

from ..errors import visible
from ..studies.base import table_schemas
from ..studies.columns import column, shown_columns
from ..studies.conservation import CONSERVATION
from ..table import Table

if TYPE_CHECKING:
    from pandas import DataFrame

    from ..runner.ledger import Summary
    from ..runner.run import Results


def console() -> Console:
    """stdout; rich obeys NO_COLOR, and a pipe gets plain text in which a row of a table is a line, however long."""
    return Console(width=None if sys.stdout.isatty() else PIPE, highlight=False, emoji=False, markup=False)


def say(text: str) -> None:
    console().print(visible(text), soft_wrap=True)


def put(table: rich.table.Table) -> None:
    """Print a table; a pipe gets no blanks at the ends of lines."""
    screen = console()
    if screen.is_terminal:
        screen.print(table)
        return
    with screen.capture() as text:
        screen.print(table)
    sys.stdout.write("".join(f"{line.rstrip()}\n" for line in text.get().splitlines()))


def warn(sentences: Sequence[str]) -> None:
    """What the user should know but no command fails for, on stderr."""
    for sentence in sentences:
        sys.stderr.write(visible(sentence) + "\n")


def print_json(data: Any) -> None:
    """Strict JSON: NaN and infinities become null."""
    options = orjson.OPT_INDENT_2 | orjson.OPT_NON_STR_KEYS | orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_APPEND_NEWLINE
    sys.stdout.write(orjson.dumps(data, lambda v: v.tolist() if hasattr(v, "tolist") else str(v), options).decode())


def number(value: Any) -> str:
    """Three digits are enough on a terminal; the CSV has them all."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, float):
        return f"{value:.3g}"
    return str(value)


TOO_NARROW = "Without room here (a wider terminal or a pipe shows them)"
GAP = 2  # blanks between columns
SHORT = 12  # characters of a phrase that is not folded
PIPE = 100_000  # characters of a line in a pipe, where nothing is folded and nothing cropped


def make_table(
    title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], first_to_go: Sequence[int] = ()
) -> rich.table.Table:
    """A plain table; numbers to the right, names and numbers never folded; columns for which a narrow terminal has no
    room are left out (the first of these places before others), and named below."""
    columns, rows = [visible(name) for name in columns], [[visible(text) for text in row] for row in rows]
    cells = [[name, *(row[i] for row in rows)] for i, name in enumerate(columns)]
    widths = [max(map(len, texts), default=0) for texts in cells]
    solid = [w <= SHORT or not any(" " in text for text in texts[1:]) for w, texts in zip(widths, cells, strict=True)]
    longest_words = [max(len(word) for text in texts for word in text.split() or [""]) for texts in cells]
    narrowest = [w if s else word for w, s, word in zip(widths, solid, longest_words, strict=True)]
    kept = list(range(len(columns)))
    to_go = [*first_to_go, *reversed(kept[2:])]
    while to_go and sum(narrowest[i] + GAP for i in kept) - GAP > console().width:
        first = to_go.pop(0)
        kept = [i for i in kept if i != first]
    gone = [name for i, name in enumerate(columns) if i not in kept and name]
    table = rich.table.Table(
        title=visible(title), title_justify="left", box=None, pad_edge=False, header_style="bold", padding=(0, 1),
        caption=f"{TOO_NARROW}: {', '.join(gone)}" if gone else None, caption_justify="left",
    )  # fmt: skip
    for i in kept:
        right = bool(rows) and all(_numeric(row[i]) for row in rows)
        table.add_column(
            columns[i], justify="right" if right else "left", overflow="fold", no_wrap=solid[i], min_width=narrowest[i]
        )
    for row in rows:
        table.add_row(*(row[i] for i in kept))
    return table


def _numeric(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return text in ("-", "")
    return True


def print_frame(frame: DataFrame, title: str, columns: Sequence[str] | None = None) -> None:
    names = [c for c in (columns or frame.columns) if c in frame.columns]
    rows = [[number(value) for value in row] for row in frame[names].itertuples(index=False)]
    put(make_table(title, names, rows))


MOST_VALUES = 3  # parameters of a family of scenarios that a list names
MOST_OWN = 8  # columns of the conservation table that systems and plugins bring; of a sweep they are its constants
WHOLE = 40  # rows of the conservation table that a run prints in full; of more, the middle steps


def is_long(name: str, schemas: Mapping[str, Table]) -> bool:
    return name in schemas and schemas[name].long


def print_tables(tables: Mapping[str, DataFrame], schemas: Mapping[str, Table]) -> None:
    """Each table, but for those that are shown when they are asked for."""
    for name, table in tables.items():
        if is_long(name, schemas):
            say(f"\n{name}: {len(table)} rows, with --table {name}, and in the CSV and Parquet files.")
        else:
            print_table(table, schemas.get(name, Table(name)))


def print_table(frame: DataFrame, schema: Table) -> None:
    """One table, one block a scenario, or a family of them, where its study says what fits a terminal; then what its
    headings mean."""
    by = "family" if "family" in frame else "scenario"
    if not schema.terminal or by in schema.terminal or by not in frame or schema.name == "claims":
        _print_block(f"\n{schema.name}", frame, schema)
    else:
        for group, part in frame.groupby(by, sort=False):
            _print_block(f"\n{schema.name}: {group}", part, schema)
    described = (column(name, schema) for name in shown(frame, schema))
    if means := [f"{one.short}: {one.label}" for one in described if one.short.replace("_", " ") != one.label]:
        say(f"Headings: {'; '.join(means)}.")


def shown(frame: DataFrame, schema: Table) -> list[str]:
    """The columns of a table that fit a terminal and have a value; of conservation the errors of a system's own
    invariants and metrics of plugins, too."""
    columns = list(schema.terminal) or shown_columns(frame.columns, schema)
    if schema.name == "conservation":
        own = [c for c in shown_columns(frame.columns, schema) if c not in CONSERVATION.names and c not in columns]
        place = columns.index("angular_momentum_error_max") + 1
        columns[place:place] = own if len(own) <= MOST_OWN else []
    return [c for c in columns if c in frame and frame[c].notna().any()]


def _print_block(title: str, frame: DataFrame, schema: Table) -> None:
    described = [column(name, schema) for name in shown(frame, schema)]
    rows = [[number(v) for v in row] for row in frame[[one.name for one in described]].itertuples(index=False)]
    first = sorted((i for i, one in enumerate(described) if one.narrow), key=lambda i: described[i].narrow)
    put(make_table(title, [one.short for one in described], rows, first))


def print_contents(tables: Mapping[str, DataFrame], folder: Any) -> None:
    """Which tables there are, and how to see one."""
    put(make_table("\ntables", ["table", "rows"], [[name, str(len(t))] for name, t in tables.items()]))
    say(f"\nOne of them: tcbench show {quote(str(folder))} --table NAME [-s SCENARIO] [-i INTEGRATOR]")


def print_row(row: Mapping[str, Any], verdicts: Mapping[str, str]) -> None:
    """One run: each number with what it is, and whether a claim that it measures was kept."""
    texts = {k: number(v) for k, v in row.items() if v != ""}
    failure = texts.pop("failure", "")  # a sentence, as wide as the rest together
    put(make_table("", ["", "", "", ""], [[k, text, meaning(k), verdicts.get(k, "")] for k, text in texts.items()]))
    if failure:
        say(f"\nfailure: {failure}")


def meaning(name: str) -> str:
    """What a column holds and its unit, as far as its name does not say it."""
    described = column(name)
    label = "" if described.label.replace(" ", "_") == name else described.label
    return label or described.unit


def _when(item: Mapping[str, Any]) -> str:
    return "" if item["by_default"] else "run when named"


def _put_rows(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """The table, if it has a row."""
    if rows:
        put(make_table(title, columns, rows))


def print_listing(data: Mapping[str, Any]) -> None:
    """Tables of what there is; the parameters of methods where some are named."""
    heads = ["name", "order", "claims", "source", *(["parameters"] if not data["studies"] else [])]
    rows: list[list[str]] = []
    for i in data["integrators"]:
        source = "; ".join(filter(None, (i["source"], _when(i), i["lacks"])))
        values = "; ".join(f"{k}: {', '.join(v)}" for k, v in i["parameters"].items())
        rows.append([i["name"], number(i["order"]), " ".join(i["claims"]), source, values][: len(heads)])
    _put_rows("Integrators", heads, rows)
    rows = [[s["name"], number(s["t_end"]), number(s["dt"]), s["shows"], s["source"]] for s in data["scenarios"]]
    for f in data["scenario_families"]:
        pairs = [f"{k}={v}" for k, v in f["parameters"].items()]
        label = ",".join(pairs if len(pairs) <= MOST_VALUES else [pairs[0], "..."])
        rows.append([f"{f['name']}[{label}]", "", "", f"{f['shows']}; run when named, with any value", f["source"]])
    _put_rows("\nScenarios", ["name", "t_end", "dt", "shows", "source"], rows)
    rows = [[s["name"], "; ".join(filter(None, (s["description"], _when(s))))] for s in data["studies"]]
    _put_rows("\nStudies", ["name", "measures"], rows)
    for origin in data["broken"]:
        say(f"\nPlugin {origin['name']!r} ({origin['path']}):\n{origin['error']}")


def print_methods(methods: Sequence[Sequence[str]], remarks: Sequence[str]) -> None:
    """The table of `report.by_method`, headings first, and the sentences below it."""
    headings, *rows = methods
    put(make_table("", headings, rows))
    for sentence in remarks:
        say(sentence)


def print_plan(plan: Summary, seconds: float | None, total: int) -> None:
    time = "unknown: too few earlier rows to judge by" if seconds is None else f"about {seconds:.1f} s"
    say(f"{total} cell{'s' * (total != 1)}: {plan.already_finished} finished, {plan.left} to run. Time: {time}.")


def print_results(
    results: Results, methods: Sequence[Sequence[str]], remarks: Sequence[str], unseen: Sequence[str],
    declared: Mapping[str, Any],
) -> None:  # fmt: skip
    """What a run ends with, in 30 lines: the rows of a small one, of a large one a line a method.

    unseen : those of the remarks that the rows do not show. declared : what the folder says of its tables.
    """
    summary = results.summary
    small, schemas = results.tables.get("conservation"), table_schemas(declared)
    short = {name for name in results.tables if not is_long(name, schemas)}
    if small is not None and len(small) <= WHOLE and short == {"conservation"}:
        for scenario, part in small.groupby("scenario", sort=False):
            _print_block(f"\n{scenario}", part, schemas["conservation"])
        for sentence in unseen:
            say(f"\n{sentence}")
    elif len(methods) > 1 and len(methods[0]) > 1:
        print_methods(methods, remarks)
    else:  # studies that say nothing of single methods
        print_tables(results.tables, schemas)
        for sentence in remarks:
            say(f"\n{sentence}")
    counts = ", ".join(f"{n} {status}" for status, n in sorted(summary.statuses.items()))
    say(
        f"\n{summary.run} cell{'s' * (summary.run != 1)} in {summary.elapsed_s:.1f} s ({counts or 'nothing new'}), "
        f"{summary.already_finished} were finished before."
    )
    if summary.interrupted:
        say(f"Interrupted with {summary.left} cells left; the same command resumes.")
    if results.every:
        see = f"tcbench show {quote(str(results.output))}"
        say(f"Tables: {results.output}/tables/ (CSV and Parquet). To see them: {see}")
