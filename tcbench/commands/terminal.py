"""What the terminal shows: tables that fit 80 columns, plain text when piped."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from shlex import quote
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table

from ..errors import visible
from ..report.html import strict
from ..studies.columns import column, shown_columns
from ..studies.conservation import COLUMNS as CONSERVATION

if TYPE_CHECKING:
    from pandas import DataFrame

    from ..runner.run import Results
    from ..runner.scheduler import Summary


def console() -> Console:
    """stdout; rich obeys NO_COLOR, and a pipe gets plain text in which a row of a table is a line, however long."""
    return Console(width=None if sys.stdout.isatty() else PIPE, highlight=False, emoji=False, markup=False)


def say(text: str) -> None:
    console().print(visible(text), soft_wrap=True)


def put(table: Table) -> None:
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
    sys.stdout.write(json.dumps(strict(data), indent=1) + "\n")


def number(value: Any) -> str:
    """Three digits are enough on a terminal; the CSV has them all."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, float):
        return f"{value:.3g}"
    return str(value)


TOO_NARROW = "Without room here (a wider terminal or a pipe shows them)"
FIRST_TO_GO = tuple(  # headings of columns that a narrow terminal does without
    column(c).short
    for c in ("us_per_step", "newton_iterations_mean", "points_used", "order_low", "order_high",
              "angular_momentum_error_max")
)  # fmt: skip
GAP = 2  # blanks between columns
SHORT = 12  # characters of a phrase that is not folded
PIPE = 100_000  # characters of a line in a pipe, where nothing is folded and nothing cropped


def make_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """A plain table; numbers to the right, names and numbers never folded; columns for which a narrow terminal has no
    room are left out, and named below."""
    columns, rows = [visible(name) for name in columns], [[visible(text) for text in row] for row in rows]
    cells = [[name, *(row[i] for row in rows)] for i, name in enumerate(columns)]
    widths = [max(map(len, found), default=0) for found in cells]
    solid = [w <= SHORT or not any(" " in text for text in found[1:]) for w, found in zip(widths, cells, strict=True)]
    least = [w if s else max(len(word) for text in found for word in text.split() or [""])
             for w, s, found in zip(widths, solid, cells, strict=True)]  # fmt: skip
    kept = list(range(len(columns)))
    last_to_go = [*(columns.index(n) for n in FIRST_TO_GO if n in columns), *reversed(kept[2:])]
    while last_to_go and sum(least[i] + GAP for i in kept) - GAP > console().width:
        first = last_to_go.pop(0)
        kept = [i for i in kept if i != first]
    gone = [name for i, name in enumerate(columns) if i not in kept and name]
    table = Table(
        title=visible(title), title_justify="left", box=None, pad_edge=False, header_style="bold", padding=(0, 1),
        caption=f"{TOO_NARROW}: {', '.join(gone)}" if gone else None, caption_justify="left",
    )  # fmt: skip
    for i in kept:
        right = bool(rows) and all(_numeric(row[i]) for row in rows)
        table.add_column(
            columns[i], justify="right" if right else "left", overflow="fold", no_wrap=solid[i], min_width=least[i]
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


SHOWN = {  # columns of a table that fit a terminal
    "conservation": (
        "integrator", "dt", "tolerance", "status", "energy_error_max", "entropy_increment_min",
        "angular_momentum_error_max", "newton_iterations_mean", "us_per_step", "blowup_time",
    ),
    "convergence": ("integrator", "variable", "order", "order_low", "order_high", "points_used", "verdict"),
    "equilibrium_summary": ("integrator", "equilibrium", "entropy_gap", "temperature_gap", "growth_a", "growth_b"),
    "stability": (
        "integrator", "limit", "dt_stable", "dt_unstable", "dt_fold", "limit_plain", "dt_stable_plain",
        "dt_unstable_plain",
    ),
    "work_precision": (
        "integrator", "control", "value", "status", "error", "energy_error_max", "wall_time_min_s", "steps",
    ),
    "time_to_accuracy": (
        "integrator", "measure", "target", "time_s", "ratio_to_best_peer", "ratio_to_best_scipy",
    ),
    "failure_share": (
        "integrator", "dt", "tolerance", "runs", "failed", "share", "low", "high", "solver", "branch", "physical",
        "law",
    ),
    "ensemble_laws": ("integrator", "law", "claimed", "runs", "broken", "median", "quantile_99", "worst"),
    "first_share": ("integrator", "measure", "target", "runs", "first", "reached", "share", "low", "high"),
    "cost": ("integrator", "exponent_steps", "exponent_horizon", "us_per_step"),
    "size": (
        "integrator", "numbers", "status", "first_step_s", "us_per_step", "memory_mb", "energy_error_max",
        "entropy_increment_min", "angular_momentum_error_max",
    ),
}  # fmt: skip


MOST_VALUES = 3  # parameters of a family of scenarios that a list names
MOST_OWN = 8  # columns of the conservation table that systems and plugins bring; of a sweep they are its constants
WHOLE = 40  # rows of the conservation table that a run prints in full; of more, the middle steps
LONG = (
    "convergence_points", "stability_points", "equilibrium", "work_precision", "series", "opening",
    "ensemble_accuracy", "ensemble_points", "ensemble_scenarios", "ensemble_seeds", "performance_profile",
)  # shown when asked for by name # fmt: skip


def print_tables(tables: Mapping[str, DataFrame]) -> None:
    """Each table, but for those of points."""
    for name, table in tables.items():
        if name in LONG:
            say(f"\n{name}: {len(table)} rows, with --table {name}, and in the CSV and Parquet files.")
        else:
            print_table(name, table)


def print_table(name: str, table: DataFrame) -> None:
    """One table, one block a scenario, or a family of them, where there are several."""
    columns, by = SHOWN.get(name), "family" if "family" in table else "scenario"
    if name == "claims":
        print_frame(table, "\nclaims", ("claim", "measured", "verdict"))
    elif columns is None or by not in table:
        print_frame(table, f"\n{name}", [c for c in shown_columns(table.columns) if table[c].notna().any()])
    else:
        for group, part in table.groupby(by, sort=False):
            _print_block(f"\n{name}: {group}", name, part)


def _print_block(title: str, name: str, part: DataFrame) -> None:
    """Rows of a table: the columns that fit a terminal and have a number; of conservation the errors of a system's own
    invariants and metrics of plugins, too."""
    columns = list(SHOWN[name])
    if name == "conservation":
        own = [c for c in shown_columns(part.columns) if c not in CONSERVATION and c not in columns]
        place = columns.index("angular_momentum_error_max") + 1
        columns[place:place] = own if len(own) <= MOST_OWN else []
    columns = [c for c in columns if c in part and part[c].notna().any()]
    rows = [[number(v) for v in row] for row in part[columns].itertuples(index=False)]
    put(make_table(title, [column(c).short for c in columns], rows))


def print_contents(tables: Mapping[str, DataFrame], folder: Any) -> None:
    """Which tables there are, and how to see one."""
    put(make_table("\ntables", ["table", "rows"], [[name, str(len(t))] for name, t in tables.items()]))
    say(f"\nOne of them: tcbench show {quote(str(folder))} --table NAME [-s SCENARIO] [-i INTEGRATOR]")


def print_row(row: Mapping[str, Any], verdicts: Mapping[str, str]) -> None:
    """One run: each number with what it is, and whether a claim that it measures was kept."""
    told = {k: number(v) for k, v in row.items() if v != ""}
    failure = told.pop("failure", "")  # a sentence, as wide as the rest together
    put(make_table("", ["", "", "", ""], [[k, text, meaning(k), verdicts.get(k, "")] for k, text in told.items()]))
    if failure:
        say(f"\nfailure: {failure}")


def meaning(name: str) -> str:
    """What a column holds and its unit, as far as its name does not say it."""
    told = column(name)
    label = "" if told.label.replace(" ", "_") == name else told.label
    return label or told.unit


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
        given = [f"{k}={v}" for k, v in f["parameters"].items()]
        label = ",".join(given if len(given) <= MOST_VALUES else [given[0], "..."])
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
    results: Results, methods: Sequence[Sequence[str]], remarks: Sequence[str], unseen: Sequence[str]
) -> None:
    """What a run ends with, in 30 lines: the rows of a small one, of a large one a line a method.

    unseen : those of the remarks that the rows do not show.
    """
    summary = results.summary
    small = results.tables.get("conservation")
    if small is not None and len(small) <= WHOLE and set(results.tables).difference(LONG) == {"conservation"}:
        for scenario, part in small.groupby("scenario", sort=False):
            _print_block(f"\n{scenario}", "conservation", part)
        for sentence in unseen:
            say(f"\n{sentence}")
    elif len(methods) > 1 and len(methods[0]) > 1:
        print_methods(methods, remarks)
    else:  # studies that say nothing of single methods
        print_tables(results.tables)
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
