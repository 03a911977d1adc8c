"""What the commands do, apart from parsing."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from .. import plugins
from ..analysis.order_fit import MIN_POINTS
from ..errors import LOUD, TcbenchError, unknown_name
from ..progress import waiting
from ..report.by_method import by_method, lost, remarks, without_number
from ..runner.plan import plan_job, preview
from ..runner.rows import Store
from ..runner.run import run
from ..runner.tables import only, read_tables
from ..studies.base import studies, table_schemas
from ..table import Table
from . import terminal
from .options import LATEST, words
from .simulate import one_of

if TYPE_CHECKING:
    from pandas import DataFrame

SHOWN_ROWS = 200  # of all tables of a run that `show` prints in full


def run_command(everything: bool, quiet: bool, as_json: bool, **options: Any) -> int:
    """Plan, run with progress, print the summary; 130 after Ctrl-C."""
    if not everything and not (options["integrators"] or options["scenarios"] or options["studies"]):
        raise TcbenchError("Say what to run: --all, or a selection with -i, -s and --study. See tcbench list.")
    if options["report"] is None:
        options["report"] = everything and not options["studies"]
    chosen: dict[str, Any] = {name: list(options.pop(name)) or None for name in ("integrators", "scenarios", "studies")}
    dt = list(options.pop("steps")) or None
    drawn = {name: options.pop(name) for name in ("size", "seed", "budget")}
    security = {key[4:]: value for key in ("tls_ca", "tls_cert", "tls_key") if (value := options.pop(key))}
    limit, report, strict = (options.pop(name) for name in ("memory_limit", "report", "strict"))
    options["memory_limit"] = limit * 2**20 if limit else None
    if options.pop("dry_run"):
        job = plan_job(**chosen, dt=dt, options=drawn)
        terminal.print_plan(*preview(job, options["output"], options, options["fresh"]), len(job.cells))
        return 0
    if limit and not sys.platform.startswith("linux"):
        terminal.warn([f"--memory-limit is not enforced on {sys.platform}."])
    results = run(**chosen, dt=dt, options=drawn, security=security or None, **options)
    store, tables = Store.read(results.output), results.every
    store.problems[:] = results.problems
    page = None
    if report and not results.summary.interrupted:
        from ..report.write_report import write_report

        with waiting("writing report.html"):
            page = write_report(results.output, (store, tables))
        results = replace(results, problems=tuple(dict.fromkeys(store.problems)))  # of charts, too
    if as_json:
        terminal.print_json({
            "output": str(results.output), "ran": results.summary.run, "statuses": dict(results.summary.statuses),
            "elapsed_s": results.summary.elapsed_s, "interrupted": results.summary.interrupted,
            "report": page and str(page), "tables": records(results.tables),
        })  # fmt: skip
    elif not quiet:
        declared, asked = declared_of(store), results.tables
        unseen = [*lost(asked), *without_number(asked)]
        terminal.print_results(results, by_method(asked, declared), remarks(asked), unseen, declared)
        if page:
            terminal.say(f"Report: {page}")
    terminal.warn([*results.problems, *results.left_out, *short_ladder(dt, results.tables), *results.notes])
    if results.summary.interrupted:
        return 130
    if results.without_tables:  # whose author has made a mistake; one of the problems above says which
        return 2
    return 1 if strict and any(results.statuses.get(status) for status in LOUD) else 0


def records(tables: Mapping[str, DataFrame]) -> dict[str, Any]:
    """Tables by name as lists of rows, for JSON."""
    return {name: table.to_dict("records") for name, table in tables.items()}


def short_ladder(dt: Sequence[float] | None, tables: Mapping[str, DataFrame]) -> list[str]:
    """A sentence where --dt leaves the study of orders too few steps to see one."""
    steps = len(set(dt or ()))
    if not steps or steps >= MIN_POINTS or "convergence" not in tables:
        return []
    return [
        f"--dt gives the study convergence {steps} step{'s' * (steps > 1)}, and an order takes at least {MIN_POINTS}: "
        "leave --dt out for the study's own ladder, or give more steps."
    ]


LISTED = {  # what is told of each thing that there is
    "integrators": ("name", "order", "kind", "claims", "source", "systems", "needs", "lacks", "by_default",
                    "parameters", "plugin"),
    "scenarios": ("name", "system", "t_end", "dt", "shows", "source", "plugin"),
    "scenario_families": ("name", "parameters", "shows", "source", "plugin"),
    "studies": ("name", "description", "by_default"),
}  # fmt: skip


def list_command(integrators: Sequence[str], scenarios: Sequence[str], as_json: bool) -> None:
    registry, whole = plugins.registry(), not (integrators or scenarios)
    chosen: dict[str, Any] = dict.fromkeys(LISTED, ())
    if whole:
        chosen |= {kind: getattr(registry, kind).values() for kind in LISTED} | {"studies": studies().values()}
    if integrators:
        chosen["integrators"] = plugins.expand_integrators(integrators)
    if scenarios:
        chosen["scenarios"] = plugins.expand_scenarios(scenarios)
    data = {kind: [_facts(one, names) for one in chosen[kind]] for kind, names in LISTED.items()}
    data["broken"] = [{"name": o.name, "path": o.path or o.distribution, "error": o.error} for o in registry.broken]
    if as_json:
        terminal.print_json(data)
    else:
        terminal.print_listing(data)
        terminal.warn(plugins.not_loaded())


def _facts(one: Any, names: Sequence[str]) -> dict[str, Any]:
    """These attributes of something that is registered: sets in their order, a system by its name; the parameters of a
    family of scenarios are its defaults."""
    values: dict[str, Any] = {name: getattr(one, name) if hasattr(one, name) else one.defaults for name in names}
    return {n: sorted(v) if isinstance(v, frozenset) else v.name if n == "system" else v for n, v in values.items()}


def map_command(
    names: tuple[str, ...], integrators: tuple[str, ...], scenarios: tuple[str, ...], quiet: bool, as_json: bool,
    **options: Any,
) -> int:  # fmt: skip
    """Run the map, one cell a row of it; tables and one picture in the output folder."""
    from ..report.chart_kinds import draw_kind, find_kind
    from ..runner.run import execute

    methods, chosen = words(names, integrators, scenarios)
    if not (methods and chosen):
        raise TcbenchError("tcbench map takes at least one integrator, and then the scenario.")
    settings = {name: options.pop(name) for name in ("x", "y", "size", "seed")}
    dt = options.pop("dt")
    settings |= {} if dt is None else {"dt": dt}
    with waiting("planning"):
        job = plan_job(methods, chosen, ["map"], options=settings)
    one_of("scenario", sorted({cell.scenario for cell in job.cells}), "A map is of one.")
    drawn = job.studies[0].name != "map"
    if drawn and dt is not None:
        raise TcbenchError("A map of random scenarios has the step as an axis: --x dt=0.025:1.6:7:log.")
    name = "failure_map" if drawn else "map"
    output = options.pop("output")
    results = execute(job, output, options)
    picture = output / f"{name}.png"
    table = results.tables.get(name)
    if table is not None:
        with waiting("drawing the map"):
            figure = draw_kind(find_kind(name.replace("_", "-")), results.tables)
            figure.savefig(picture, dpi=150, bbox_inches="tight")
    if as_json:
        terminal.print_json({"output": str(output), "picture": str(picture), "tables": records(results.tables)})
    elif table is not None and not quiet:
        grouped = table.groupby("integrator" if drawn else ["integrator", "outcome"], sort=True)
        outcomes = grouped[["runs", "failed"]].sum() if drawn else grouped.size().rename("cells")
        terminal.print_frame(outcomes.reset_index(), "outcomes")
        terminal.say(f"Picture: {picture}. Table: {output}/tables/{name}.csv")
    return 130 if results.summary.interrupted else 0


def reference_command(names: Sequence[str], scenarios: Sequence[str], as_json: bool) -> int:
    """0 if the references in use are confirmed, 1 if not."""
    if not (names or scenarios):
        raise TcbenchError("Say of which scenario: tcbench reference SCENARIO. See tcbench list.")
    from ..reference.collocation import ReferenceFailed
    from ..reference.lookup import recompute

    verdicts = []
    for scenario in plugins.expand_scenarios([*names, *scenarios]):
        with waiting(f"computing the reference of {scenario.name}"):
            try:
                verdicts.append(recompute(scenario))
            except ReferenceFailed as error:
                raise TcbenchError(f"{scenario.name} has no reference: {error}") from error
    if as_json:
        terminal.print_json(verdicts[0] if len(verdicts) == 1 else verdicts)
    else:
        for each in verdicts:
            rows = [[terminal.number(row[k]) for k in ("t", "gap", "certificate", "check")] for row in each["rows"]]
            title = f"{each['scenario']}: {each['method']}"
            columns = ["t", "gap to the one in use", "certificate", "check"]
            terminal.put(terminal.make_table(title, columns, rows))
            terminal.say(f"It {'agrees' if each['agrees'] else 'does NOT agree'} with the reference in use.")
    return 0 if all(each["agrees"] for each in verdicts) else 1


def show_command(
    folder: Path, table: str | None, latex: bool, scenarios: tuple[str, ...], integrators: tuple[str, ...],
    as_json: bool,
) -> None:  # fmt: skip
    """The tables of a small run, or the one that is named; of a large run its summary, and what there is."""
    if latex and table is None:
        raise TcbenchError("--latex writes one table: say which with --table NAME.")
    with waiting("reading the rows"):
        store = Store.read(folder)
        tables = read_tables(store)
    terminal.warn(store.problems)
    if not tables:
        held = "finished cells, of which no table can be made" if store.rows() else "no finished cell yet"
        raise TcbenchError(f"{str(folder)!r} holds {held}.")
    if table is not None and table not in tables:
        raise unknown_name("table of this run", table, tables)
    for column, names in (("scenario", scenarios), ("integrator", integrators)):
        tables = {key: t for key, t in only(tables, column, names).items() if len(t) and (not names or column in t)}
    if table is not None and table not in tables:
        raise TcbenchError(f"The table {table!r} of this run has no row of {', '.join((*scenarios, *integrators))}.")
    if table is not None:
        tables = {table: tables[table]}
    schemas = table_schemas(store.declared())
    if latex and table is not None:
        from ..report.latex import to_latex

        sys.stdout.write(to_latex(tables[table], schemas.get(table, Table(table))))
    elif as_json:
        terminal.print_json(records(tables))
    elif table is not None:
        terminal.print_table(tables[table], schemas.get(table, Table(table)))
    elif sum(len(t) for name, t in tables.items() if not terminal.is_long(name, schemas)) <= SHOWN_ROWS:
        terminal.print_tables(tables, schemas)
        for sentence in remarks(tables):
            terminal.say(f"\n{sentence}")
    else:
        terminal.print_methods(by_method(tables, declared_of(store)), remarks(tables))
        terminal.print_contents(tables, folder)


def declared_of(store: Store) -> dict[str, Any]:
    """What the folder says of its methods; where it does not, what those that are installed here say."""
    from ..runner.declared import method_facts

    declared = store.declared()
    if declared.get("integrators"):
        return declared
    return {**declared, "integrators": {name: method_facts(method) for name, method in plugins.integrators().items()}}


def report_command(folders: tuple[Path, ...], output: Path | None, as_json: bool) -> None:
    from ..report.write_report import write_report

    first, *others = folders or (LATEST,)
    store = Store.read(first)
    tables = read_tables(store)
    with waiting("writing report.html"):
        page = write_report(first, (store, tables), output, others)
    wrote([page], as_json)
    terminal.warn([*dict.fromkeys(store.problems)])


def wrote(paths: Sequence[Path], as_json: bool) -> None:
    """Say which files were written."""
    if as_json:
        terminal.print_json({"files": [str(path) for path in paths]})
    else:
        for path in paths:
            terminal.say(f"Wrote {path}")


def compare_command(
    run_a: Path, run_b: Path, scenarios: Sequence[str], integrators: Sequence[str], fail_on_regression: bool,
    as_json: bool,
) -> int:  # fmt: skip
    from ..runner.compare import compare, in_both, one_sided, other_machine, regressions

    if click.get_current_context().get_parameter_source("run_b") == ParameterSource.DEFAULT:
        click.echo(f"RUN_B is {run_b}: none is named.", err=True)
    with waiting("comparing"):
        changes = compare(run_a, run_b)
        problems = changes.attrs["problems"]
        for column, names in (("scenario", scenarios), ("integrator", integrators)):
            if names:  # those that have not changed are known, too
                changes = only(read_tables(run_a) | read_tables(run_b) | {"changes": changes}, column, names)["changes"]
    both, worse = in_both(changes), regressions(changes)
    terminal.warn([*problems, *filter(None, [other_machine(run_a, run_b)])])
    if as_json:
        terminal.print_json(records({"changes": changes})["changes"])
    else:
        if len(both):
            terminal.print_frame(both, "changes")
        times = changes[changes["kind"] == "time"].rename(columns={"after": "time after / before"})
        if len(times):
            by = times.groupby(["study", "integrator"])["time after / before"].agg(["median", "min", "max"])
            terminal.print_frame(by.reset_index(), "times after / before (no verdict: that is asv's)")
        if len(alone := one_sided(changes)):
            terminal.print_frame(alone, f"rows of one run alone: missing from {run_b}, or new there")
        count = f"{len(both)} change{'s' * (len(both) > 1)} beyond noise, {len(worse)} for the worse."
        terminal.say(count if len(both) else "Nothing changed beyond noise.")
    return 1 if fail_on_regression and len(worse) else 0


def new_command(kind: str, name: str, package: bool, folder: Path, as_json: bool) -> None:
    from ..authoring.scaffold import checked, new_file, new_package

    if as_json:
        wrote([(new_package if package else new_file)(kind, name, folder)], as_json)
        return
    if package:
        root = new_package(kind, name, folder)
        terminal.say(f"Wrote {root}/. Next: pip install -e {root}, then tcbench list.")
        return
    path = new_file(kind, name, folder)
    where = path.parent if str(path.parent) else Path(".")
    option = {
        "integrator": f"-i {name} --study conservation",
        "study": f"-i tc_monolithic -s short_term --study {name}",
    }.get(kind, f"-s {checked(kind, name)} --study conservation")
    terminal.say(
        f"Wrote {path}. It runs as it is:\n  tcbench check {path}\n  tcbench run {option} --plugins-dir {where}"
    )


def check_command(
    targets: Sequence[str], integrators: Sequence[str], scenarios: Sequence[str], only: str, as_json: bool
) -> int:
    """0 if every line passes, 1 if not. Each line is printed when it is known."""
    from ..authoring import check

    if not (targets or integrators or scenarios):
        raise TcbenchError("Say what to check: tcbench check FILE, or the name of an integrator or scenario.")
    lines = [line.strip() for line in only.split(",") if line.strip()]
    files = [subject for target in targets for subject in check.subjects(target, lines)]
    every = [*files, *check.named(integrators, scenarios, lines)]
    for subject in every:
        say = (lambda text: None) if as_json else terminal.say
        say(f"{subject.kind} {subject.name}")
        rest = iter(subject)
        while True:
            with waiting(f"checking {subject.name}"):
                item = next(rest, None)
            if item is None:
                break
            for text in check.printable(item):
                say(text)
        say(check.verdict(subject))
    good = all(subject.ok for subject in every)
    if as_json:
        target = " ".join([*targets, *integrators, *scenarios])
        terminal.print_json({"target": target, "ok": good, "reports": [subject.as_dict() for subject in every]})
    return 0 if good else 1
