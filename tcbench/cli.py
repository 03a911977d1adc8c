"""The command line: parse, look up, call, write. Heavy imports stay inside the commands."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from .errors import TcbenchError

PLUGINS = click.option(
    "--plugins-dir", "folders", multiple=True, type=click.Path(), metavar="FOLDER",
    help="Also load the plugin files in FOLDER (they are Python code: name only what you trust).",
)  # fmt: skip


class Folder(click.Path):
    """A folder to write into; the empty name is a mistake, such as a shell variable that is not set."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if not str(value).strip():
            raise TcbenchError("The name of the output folder is empty; the current folder is '.'.")
        return super().convert(value, param, ctx)


QUIET = click.option("--quiet", "-q", is_flag=True, help="No progress and no tables, errors only.")
AS_JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of tables.")


class Group(click.Group):
    """Turns errors that a user can cure into one sentence and exit code 2."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except TcbenchError as error:
            click.echo(f"Error: {error}", err=True)
            ctx.exit(2)
        except KeyboardInterrupt:
            click.echo("Interrupted.", err=True)
            ctx.exit(130)
        except BrokenPipeError:
            sys.stderr.close()
            ctx.exit(1)

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        if args and args[0] not in self.commands and not args[0].startswith("-"):
            from .errors import unknown_name

            raise unknown_name("command", args[0], self.commands)
        return super().resolve_command(ctx, args)


@click.group(cls=Group, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="tcbench")
def main() -> None:
    """Benchmark for thermodynamically consistent (GENERIC, metriplectic) time integrators."""


@main.command()
@click.option("--all", "everything", is_flag=True, help="Every integrator, scenario and study.")
@click.option("--integrator", "-i", "integrators", multiple=True, metavar="NAME", help="Repeat for several.")
@click.option("--scenario", "-s", "scenarios", multiple=True, metavar="NAME", help="Repeat for several.")
@click.option("--study", "studies", multiple=True, metavar="NAME", help="Repeat for several.")
@click.option("--dt", "steps", multiple=True, type=float, help="Step size instead of the scenario's ladder; repeat.")
@click.option("--output", "-o", type=Folder(), default=Path("results/latest"), show_default=True)
@click.option("--jobs", "-j", type=click.IntRange(1), help="Worker processes (default: the cores).")
@click.option("--timeout", type=float, default=300.0, show_default=True, help="Seconds a cell may take.")
@click.option("--memory-limit", type=click.IntRange(1), metavar="MIB", help="Address space of a worker, in MiB.")
@click.option("--fresh", is_flag=True, help="Forget the rows that the output folder already has.")
@click.option("--retry-failed", is_flag=True, help="Run again every cell whose status is not ok.")
@click.option("--report/--no-report", default=None, help="Write report.html (default: with --all and no --study).")
@click.option("--strict", is_flag=True, help="Exit with code 1 if a cell ended as exception, crash or timeout.")
@click.option("--dry-run", is_flag=True, help="Say what would run and for how long; run nothing.")
@click.option("--dask", metavar="ADDRESS", help="Send the cells to this Dask scheduler (extra: cluster).")
@click.option("--tls-ca", type=click.Path(exists=True), help="TLS certificate authority of the scheduler.")
@click.option("--tls-cert", type=click.Path(exists=True), help="TLS certificate for the scheduler.")
@click.option("--tls-key", type=click.Path(exists=True), help="TLS key for the scheduler.")
@PLUGINS
@QUIET
@AS_JSON
def run(everything: bool, folders: tuple[str, ...], quiet: bool, as_json: bool, **options: Any) -> None:
    """Run studies and write tables. Finished cells of the output folder are not run again."""
    from . import terminal
    from .commands import run_command

    load_plugins(folders)
    if not everything and not (options["integrators"] or options["scenarios"] or options["studies"]):
        raise TcbenchError("Say what to run: --all, or a selection with -i, -s and --study. See tcbench list.")
    if options["report"] is None:
        options["report"] = everything and not options["studies"]
    code = run_command(options, terminal.Display(quiet=quiet or as_json, as_json=as_json))
    sys.exit(code)


@main.command("list")
@PLUGINS
@AS_JSON
def list_(folders: tuple[str, ...], as_json: bool) -> None:
    """Integrators, scenarios and studies, with claims and sources; and plugins that failed to load."""
    from .commands import list_command

    load_plugins(folders)
    list_command(as_json)


@main.command()
@click.argument("integrator")
@click.argument("scenario")
@click.option("--dt", type=float, help="Step; the scenario's own by default.")
@click.option("--t-end", type=float, help="Horizon; the scenario's own by default.")
@click.option("--tolerance", type=float, help="Of an adaptive solver, instead of --dt.")
@click.option("--plain", is_flag=True, help="Plain Newton from z0: no continuation.")
@click.option("--record-every", type=click.IntRange(1), default=1, show_default=True, help="Keep every k-th state.")
@click.option("--audit-roots", is_flag=True, help="Count accepted roots that are not the principal one (slow).")
@click.option("--csv", type=click.Path(path_type=Path, dir_okay=False), help="Write the trajectory to this file.")
@PLUGINS
@AS_JSON
def simulate(folders: tuple[str, ...], as_json: bool, **options: Any) -> None:
    """Run one integrator on one scenario."""
    from .commands import simulate_command

    load_plugins(folders)
    simulate_command(as_json=as_json, **options)


@main.command("map")
@click.argument("names", nargs=-1, required=True, metavar="INTEGRATOR... SCENARIO")
@click.option("--x", required=True, metavar="AXIS", help="name=low:high:n[:log], as in dt=0.02:4:40:log.")
@click.option("--y", required=True, metavar="AXIS", help="The same; constants are multiples of the scenario's own.")
@click.option("--output", "-o", type=Folder(), default=Path("results/map"), show_default=True)
@click.option("--jobs", "-j", type=click.IntRange(1), help="Worker processes (default: the cores).")
@click.option("--timeout", type=float, default=300.0, show_default=True, help="Seconds a row of the map may take.")
@PLUGINS
@QUIET
def map_(names: tuple[str, ...], folders: tuple[str, ...], quiet: bool, **options: Any) -> None:
    """A stability map over two parameters; several integrators are drawn side by side."""
    from . import terminal
    from .commands import map_command

    load_plugins(folders)
    sys.exit(map_command(names, options, terminal.Display(quiet=quiet)))


@main.command()
@click.argument("scenario")
@PLUGINS
@AS_JSON
def reference(scenario: str, folders: tuple[str, ...], as_json: bool) -> None:
    """Compute the reference solution of a scenario anew and compare it with the one in use."""
    from .commands import reference_command

    load_plugins(folders)
    sys.exit(reference_command(scenario, as_json))


@main.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--table", metavar="NAME", help="This table alone, whatever its length.")
@click.option("--scenario", "-s", "scenarios", multiple=True, metavar="NAME", help="Rows of this one; repeat.")
@click.option("--integrator", "-i", "integrators", multiple=True, metavar="NAME", help="Rows of this one; repeat.")
@PLUGINS
@AS_JSON
def show(folder: Path, folders: tuple[str, ...], as_json: bool, **options: Any) -> None:
    """The tables of a run so far, also while it is running; of a large run a summary."""
    from .commands import show_command

    load_plugins(folders)
    show_command(folder, as_json=as_json, **options)


@main.command()
@click.argument("folder", type=click.Path(path_type=Path))
@PLUGINS
def report(folder: Path, folders: tuple[str, ...]) -> None:
    """Write report.html of a run: one self-contained page."""
    from .commands import report_command

    load_plugins(folders)
    report_command(folder)


@main.command()
@click.argument("kind")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--output", "-o", type=click.Path(path_type=Path), help="PNG, SVG or PDF by suffix (default: KIND.png).")
@click.option("--scenario", "-s", metavar="NAME", help="Needed where the run has several.")
@click.option("--integrator", "-i", "integrators", multiple=True, metavar="NAME", help="Only these; repeat.")
@click.option("--x", metavar="COLUMN", help="Column of the horizontal axis (work-precision, conservation).")
@click.option("--y", multiple=True, metavar="COLUMN", help="Columns of the vertical axis (work-precision); repeat.")
@click.option("--dt", type=float, help="Of laws, four-panel and path: the runs of this step only.")
@PLUGINS
def plot(kind: str, folder: Path, folders: tuple[str, ...], **options: Any) -> None:
    """Draw one chart of a run; an unknown KIND lists those that exist."""
    from .commands import plot_command

    load_plugins(folders)
    plot_command(kind, folder, **options)


@main.command()
@click.option("--output", "-o", type=Folder(), default=Path("results/paper"), show_default=True)
@click.option("--format", "suffix", type=click.Choice(["png", "svg", "pdf"]), default="png", show_default=True)
def paper(output: Path, suffix: str) -> None:
    """Figures 2 to 9 of Romero (2009), with captions that say what differs from the paper's account."""
    from .commands import paper_command

    paper_command(output, suffix)


@main.command()
@click.argument("run_a", type=click.Path(path_type=Path))
@click.argument("run_b", type=click.Path(path_type=Path))
@click.option("--fail-on-regression", is_flag=True, help="Exit with code 1 if RUN_B is worse.")
@AS_JSON
def compare(run_a: Path, run_b: Path, fail_on_regression: bool, as_json: bool) -> None:
    """What changed from RUN_A to RUN_B beyond noise, cell by cell."""
    from .commands import compare_command

    sys.exit(compare_command(run_a, run_b, fail_on_regression, as_json))


@main.command()
@click.argument("kind", type=click.Choice(["integrator", "scenario", "system"]))
@click.argument("name")
@click.option("--package", is_flag=True, help="A complete distribution: pyproject, source, a test.")
@click.option("--folder", type=click.Path(path_type=Path, file_okay=False), default=Path(), help="Where to write it.")
def new(kind: str, name: str, package: bool, folder: Path) -> None:
    """Write a commented plugin that runs as it is: an integrator, a scenario or a system."""
    from .commands import new_command

    new_command(kind, name, package, folder)


@main.command()
@click.argument("target", metavar="FILE|NAME")
@PLUGINS
@AS_JSON
def check(target: str, folders: tuple[str, ...], as_json: bool) -> None:
    """Check a plugin line by line: does it keep the contract, and what it claims? Exit code 0 or 1."""
    from .commands import check_command

    load_plugins(folders)
    sys.exit(check_command(target, as_json))


def load_plugins(folders: tuple[str, ...]) -> None:
    """Make the plugin folders of the command line known."""
    if folders:
        from . import plugins

        plugins.use_folders(folders)
