"""What the commands do, apart from parsing."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from . import plugins, terminal
from .engine.planning import plan_job, preview
from .engine.run import run
from .errors import TcbenchError, unknown_name
from .report.summary import summary
from .store.encoding import csv_bytes
from .store.store import Store, replace_file
from .store.tables import only, read_tables
from .studies.base import default_studies

if TYPE_CHECKING:
    from pandas import DataFrame

SHOWN_ROWS = 200  # of all tables of a run that `show` prints in full


def run_command(options: dict[str, Any], display: terminal.Display) -> int:
    """Plan, run with progress, print the summary; 130 after Ctrl-C."""
    chosen: dict[str, Any] = {name: list(options.pop(name)) or None for name in ("integrators", "scenarios", "studies")}
    dt = list(options.pop("steps")) or None
    security = {key[4:]: value for key in ("tls_ca", "tls_cert", "tls_key") if (value := options.pop(key))}
    limit, report, strict = (options.pop(name) for name in ("memory_limit", "report", "strict"))
    if options.pop("dry_run"):
        job = plan_job(**chosen, dt=dt)
        display.plan(preview(job, options["output"], options["retry_failed"], options["jobs"]), len(job.cells))
        return 0
    with display.progress() as on_event:
        results = run(
            **chosen, dt=dt, memory_limit=limit * 2**20 if limit else None, security=security or None,
            on_event=on_event, **options,
        )  # fmt: skip
    overview = summary(results.tables, plugins.integrators())
    every = summary(read_tables(results.output), plugins.integrators())  # of all runs into this folder
    replace_file(results.output / "summary.csv", csv_bytes(every), results.output)
    display.results(results, overview)
    terminal.warn([*results.problems, *results.left_out])
    if report and not results.summary.interrupted:
        from .report.write_report import write_report

        page = write_report(results.output)
        if not display.quiet:
            terminal.say(f"Report: {page}")
    if results.summary.interrupted:
        return 130
    table = results.statuses
    return int(strict and any(table.get(status) for status in terminal.LOUD))


def list_command(as_json: bool) -> None:
    registry = plugins.registry()
    data = {
        "integrators": [
            {
                "name": i.name, "order": i.order, "kind": i.kind, "claims": sorted(i.claims), "source": i.source,
                "systems": sorted(i.systems), "needs": list(i.needs), "lacks": i.lacks,
                "parameters": {k: list(v) for k, v in i.parameters.items()}, "plugin": i.plugin,
            }
            for i in registry.integrators.values()
        ],
        "scenarios": [
            {
                "name": s.name, "system": s.system.name, "t_end": s.t_end, "dt": s.dt, "shows": s.shows,
                "source": s.source, "plugin": s.plugin,
            }
            for s in registry.scenarios.values()
        ],
        "scenario_families": [
            {
                "name": f.name, "parameters": dict(f.defaults), "shows": f.shows, "source": f.source,
                "plugin": f.plugin,
            }
            for f in registry.scenario_families.values()
        ],
        "studies": [{"name": s.name, "description": s.description} for s in default_studies().values()],
        "broken": [{"name": o.name, "path": o.path or o.distribution, "error": o.error} for o in registry.broken],
    }  # fmt: skip
    if as_json:
        terminal.print_json(data)
    else:
        terminal.print_listing(data)


def simulate_command(
    integrator: str, scenario: str, dt: float | None, t_end: float | None, tolerance: float | None, plain: bool,
    record_every: int, audit_roots: bool, csv: Path | None, as_json: bool,
) -> None:  # fmt: skip
    from .simulation import metrics
    from .simulation.run import simulate

    if csv is not None and not csv.resolve().parent.is_dir():
        raise TcbenchError(f"The folder of {str(csv)!r} does not exist; create it first.")
    if dt is not None and plugins.find_integrator(integrator).kind == "adaptive":
        raise TcbenchError(f"{integrator!r} chooses its steps: give --tolerance instead of --dt.")
    run_ = simulate(
        integrator, scenario, dt, t_end, tolerance=tolerance, continuation=not plain, record_every=record_every,
        residuals=True, audit_roots=audit_roots,
    )  # fmt: skip
    row = {"integrator": run_.integrator.name, "scenario": run_.scenario.name, "dt": run_.dt}
    row |= metrics.conservation(run_)
    row |= {name: value for name, value in asdict(run_.solver).items() if value and name != "unknown"}
    if csv is not None:
        _write_csv(run_, csv)
    if as_json:
        terminal.print_json(row)
    else:
        terminal.print_row(row)
        if csv is not None:
            terminal.say(f"{len(run_.t)} states in {csv}")


def _write_csv(run_: Any, path: Path) -> None:
    """t, z, energy, entropy, invariants and temperatures, all digits."""
    n, m = run_.scenario.model.n_positions, run_.scenario.model.n_elements
    names = ["t", *(f"q{i}" for i in range(n)), *(f"p{i}" for i in range(n)), *(f"s{i}" for i in range(m))]
    names += ["energy", "entropy", *run_.invariants, *(f"theta{i}" for i in range(m))]
    columns = [run_.t, *run_.z.T, run_.energy, run_.entropy, *run_.invariants.values(), *run_.temperatures.T]
    try:
        np.savetxt(path, np.column_stack(columns), delimiter=",", header=",".join(names), comments="", fmt="%.17g")
    except OSError as error:
        raise TcbenchError(f"{str(path)!r} cannot be written: {error.strerror}.") from None


def map_command(names: tuple[str, ...], options: dict[str, Any], display: terminal.Display) -> int:
    """Run the map, one cell a row of it; tables and one picture in the output folder."""
    from .engine.run import execute
    from .report.charts.stability_map import map_figure

    *methods, scenario = names
    if not methods:
        raise TcbenchError("tcbench map takes at least one integrator, and then the scenario.")
    axes = {"x": options.pop("x"), "y": options.pop("y")}
    job = plan_job(methods, [scenario], ["map"], options=axes)
    with display.progress() as on_event:
        results = execute(job, on_event=on_event, **options)
    if "map" in results.tables:
        picture = results.output / "map.png"
        map_figure(results.tables["map"]).savefig(picture, dpi=150, bbox_inches="tight")
        if not display.quiet:
            outcomes = results.tables["map"].groupby(["integrator", "outcome"], sort=True).size()
            terminal.print_frame(outcomes.rename("cells").reset_index(), "outcomes")
            terminal.say(f"Picture: {picture}. Table: {results.output}/tables/map.csv")
    return 130 if results.summary.interrupted else 0


def reference_command(scenario: str, as_json: bool) -> int:
    """0 if the reference in use is confirmed, 1 if not."""
    from .reference.lookup import recompute

    found = recompute(plugins.find_scenario(scenario))
    if as_json:
        terminal.print_json(found)
    else:
        rows = [[terminal.number(row[k]) for k in ("t", "gap", "certificate", "check")] for row in found["rows"]]
        title = f"{found['scenario']}: {found['method']}"
        columns = ["t", "gap to the one in use", "certificate", "check"]
        terminal.console().print(terminal.make_table(title, columns, rows))
        terminal.say(f"It {'agrees' if found['agrees'] else 'does NOT agree'} with the reference in use.")
    return 0 if found["agrees"] else 1


def show_command(
    folder: Path, table: str | None, scenarios: tuple[str, ...], integrators: tuple[str, ...], as_json: bool
) -> None:
    """The tables of a small run, or the one that is named; of a large run its summary, and what there is."""
    if not folder.is_dir():
        raise TcbenchError(f"There is no run in {str(folder)!r}. tcbench run --output FOLDER makes one.")
    store = Store.read(folder)
    tables = read_tables(store)
    terminal.warn(store.problems)
    if not tables:
        raise TcbenchError(f"{str(folder)!r} holds no finished cell yet.")
    if table is not None and table not in tables:
        raise unknown_name("table of this run", table, tables)
    for column, names in (("scenario", scenarios), ("integrator", integrators)):
        tables = {key: t for key, t in only(tables, column, names).items() if len(t) and (not names or column in t)}
    if table is not None and table not in tables:
        raise TcbenchError(f"The table {table!r} of this run has no row of {', '.join((*scenarios, *integrators))}.")
    if table is not None:
        tables = {table: tables[table]}
    if as_json:
        terminal.print_json({name: json.loads(t.to_json(orient="records", double_precision=15)) for name, t in
                             tables.items()})  # fmt: skip
    elif table is not None:
        terminal.print_table(table, tables[table])
    elif sum(len(t) for name, t in tables.items() if name not in terminal.LONG) <= SHOWN_ROWS:
        terminal.print_tables(tables)
    else:
        terminal.print_frame(summary(tables, plugins.integrators()), "summary")
        terminal.warn(absent_methods(tables))
        terminal.print_contents(tables, folder)


def absent_methods(tables: dict[str, DataFrame]) -> list[str]:
    """A sentence on methods of a run that are not installed here, if there are any."""
    names = {str(name) for t in tables.values() if "integrator" in t for name in t["integrator"]}
    absent = sorted(name for name in names if not _is_installed(name))
    if not absent:
        return []
    return [f"Not installed here, so without claims and trajectories: {', '.join(absent)}. --plugins-dir loads files."]


def _is_installed(name: str) -> bool:
    try:
        return bool(plugins.find_integrator(name))
    except TcbenchError:
        return False


def report_command(folder: Path) -> None:
    from .report.write_report import write_report

    terminal.say(f"Wrote {write_report(folder)}")
    terminal.warn(absent_methods(read_tables(folder)))


def plot_command(
    kind: str, folder: Path, output: Path | None, scenario: str | None, integrators: tuple[str, ...], x: str | None,
    y: tuple[str, ...], dt: float | None,
) -> None:  # fmt: skip
    from .report.plot import plot

    path = plot(
        kind, folder, output or f"{kind}.png", scenario=scenario, integrators=list(integrators) or None, x=x,
        y=list(y) or None, dt=dt,
    )  # fmt: skip
    terminal.say(f"Wrote {path}")


def paper_command(output: Path, suffix: str) -> None:
    from .report.paper_figures import paper_figures

    for path in paper_figures(output, f".{suffix}"):
        terminal.say(f"Wrote {path}")


def compare_command(run_a: Path, run_b: Path, fail_on_regression: bool, as_json: bool) -> int:
    from .store.compare import compare, other_machine, regressions

    for folder in (run_a, run_b):
        if not folder.is_dir():
            raise TcbenchError(f"There is no run in {str(folder)!r}.")
    changes = compare(run_a, run_b)
    terminal.warn(list(filter(None, [other_machine(run_a, run_b)])))
    worse = regressions(changes)
    if as_json:
        terminal.print_json(json.loads(changes.to_json(orient="records", double_precision=15)))
    elif changes.empty:
        terminal.say("Nothing changed beyond noise.")
    else:
        terminal.print_frame(changes, "changes")
        terminal.say(f"{len(changes)} changes beyond noise, {len(worse)} for the worse.")
    return 1 if fail_on_regression and len(worse) else 0


def new_command(kind: str, name: str, package: bool, folder: Path) -> None:
    from .authoring.scaffold import new_file, new_package

    if package:
        root = new_package(kind, name, folder)
        terminal.say(f"Wrote {root}/. Next: pip install -e {root}, then tcbench list.")
        return
    path = new_file(kind, name, folder)
    where = path.parent if str(path.parent) else Path(".")
    option = {"integrator": f"-i {name}", "scenario": f"-s {name}", "system": f"-s {name}_first"}[kind]
    terminal.say(
        f"Wrote {path}. It runs as it is:\n  tcbench check {path}\n"
        f"  tcbench run {option} --study conservation --plugins-dir {where}"
    )


def check_command(target: str, as_json: bool) -> int:
    """0 if every line passes, 1 if not."""
    from .authoring.check import check, printable

    reports = check(target)
    good = all(report.ok for report in reports)
    if as_json:
        terminal.print_json({"target": target, "ok": good, "reports": [report.as_dict() for report in reports]})
    else:
        for text in printable(reports):
            terminal.say(text)
    return 0 if good else 1
