"""The command line: the options of each command, and what does it. Nothing heavy is imported before it is asked for."""

from __future__ import annotations

import functools
import os
import pkgutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from . import progress
from .commands.cache import cache_command
from .commands.group import Group
from .commands.options import CONFIG, LATEST, PLUGINS, QUIET, completion, many, one, output, runs
from .studies.base import study_names

ENVIRONMENT = """\b
Environment:
  TCBENCH_PLUGINS_DIR  folders of plugin files, as --plugins-dir
  TCBENCH_CACHE_DIR    where compiled kernels and references are kept: see tcbench cache
  NO_COLOR             plain text on a terminal, too
"""


JOBS = click.option("--jobs", "-j", type=click.IntRange(1), help="Worker processes (default: the cores).")
INTEGRATORS = many("integrator", "Integrator to run (default: all).")
SCENARIOS = many("scenario", "Scenario to run (default: all).")
ROWS_OF_INTEGRATORS = many("integrator", "Rows of this integrator.")
ROWS_OF_SCENARIOS = many("scenario", "Rows of this scenario.")


METHODS_AND_SCENARIOS = completion("plugins:integrators", "plugins:scenarios")


def done_by(place: str) -> Callable[[Callable[[], None]], Callable[..., None]]:
    """What does a command with its options, "MODULE:FUNCTION" of `commands`; a number that it returns is the exit code.

    The function below says what is done, for --help. Every command has --json, the last of its options.
    """

    def decorated(described: Callable[[], None]) -> Callable[..., None]:
        @functools.wraps(described)
        def does(**options: Any) -> None:
            if place.startswith("simulate") and "numpy" not in sys.modules:  # threads take longer than the run
                os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
            if code := pkgutil.resolve_name(f"{__package__}.commands.{place}")(**options):
                sys.exit(code)

        return click.option("--json", "as_json", is_flag=True, help="Print JSON instead of tables.")(does)

    return decorated


@click.group(
    cls=Group, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100}, epilog=ENVIRONMENT
)
@click.version_option(package_name="tcbench")
@click.pass_context
def main(ctx: click.Context) -> None:
    """Benchmark for thermodynamically consistent (GENERIC, metriplectic) time integrators."""
    before, progress.default = progress.default, True  # the command line says in a pipe, too, what it waits for
    ctx.call_on_close(lambda: setattr(progress, "default", before))


@main.command()
@CONFIG
@click.option("--all", "everything", is_flag=True, help="Every integrator, scenario and study.")
@INTEGRATORS
@SCENARIOS
@click.option(
    "--study", "studies", multiple=True, metavar="NAME", shell_complete=lambda c, p, i: list(study_names()),
    help=f"Study to run (default: see tcbench list): {', '.join(study_names())}. Patterns, too; repeat for several.",
)  # fmt: skip
@click.option(
    "--dt", "steps", multiple=True, type=float, metavar="STEP",
    help="Step size instead of the scenario's ladder, for methods of a fixed step; repeat for several.",
)  # fmt: skip
@click.option("--size", type=int, help="Number of random scenarios of the study ensemble.")
@click.option("--seed", type=int, help="Seed of the ensemble; two seeds have no scenario in common.")
@click.option("--budget", type=float, help="Seconds for the timed runs of the study ensemble, divided equally.")
@output(LATEST)
@JOBS
@click.option("--timeout", type=float, default=300.0, show_default=True, help="Seconds a cell may take.")
@click.option(
    "--memory-limit", type=click.IntRange(1), metavar="MIB",
    help="Address space of a worker, in MiB (on Linux; elsewhere it is not enforced).",
)  # fmt: skip
@click.option("--fresh", is_flag=True, help="Forget the rows that the output folder already has.")
@click.option("--retry-failed", is_flag=True, help="Run again every cell whose status is not ok.")
@click.option("--report/--no-report", default=None, help="Write report.html (default: with --all and no --study).")
@click.option("--strict", is_flag=True, help="Exit with code 1 if a cell ended as exception, crash or timeout.")
@click.option("--dry-run", is_flag=True, help="Say what would run and how long it would take; run nothing.")
@click.option("--dask", metavar="ADDRESS", help="Send the cells to this Dask scheduler (extra: cluster).")
@click.option("--tls-ca", type=click.Path(exists=True), help="TLS certificate authority of the scheduler.")
@click.option("--tls-cert", type=click.Path(exists=True), help="TLS certificate for the scheduler.")
@click.option("--tls-key", type=click.Path(exists=True), help="TLS key for the scheduler.")
@PLUGINS
@QUIET
@done_by("actions:run_command")
def run() -> None:
    """Run studies and write tables. Finished cells of the output folder are not run again."""


@main.command("list")
@many("integrator", "List this integrator.")
@many("scenario", "List this scenario.")
@PLUGINS
@done_by("actions:list_command")
def list_() -> None:
    """Integrators, scenarios and studies, with claims and sources; and plugins that failed to load."""


@main.command()
@click.argument("names", nargs=-1, metavar="INTEGRATOR SCENARIO", shell_complete=METHODS_AND_SCENARIOS)
@one("integrator", "Instead of the first word.")
@one("scenario", "Instead of the last word.")
@click.option("--dt", type=float, help="Step; the scenario's own by default.")
@click.option("--t-end", type=float, help="Final time; the scenario's own by default.")
@click.option("--tolerance", type=float, help="Tolerance of an adaptive solver, instead of --dt.")
@click.option("--plain", is_flag=True, help="Plain Newton from z0: no continuation.")
@click.option("--record-every", type=click.IntRange(1), default=1, show_default=True, help="Keep every k-th state.")
@click.option("--audit-roots", is_flag=True, help="Count accepted roots that are not the principal one (slow).")
@click.option("--csv", type=click.Path(path_type=Path, dir_okay=False), help="Write the trajectory to this file.")
@click.option(
    "--fields",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the fields on the mesh, for ParaView: FILE.xdmf, or FILE.vtu, one a state; or draw them: FILE.png.",
)
@PLUGINS
@done_by("simulate:simulate_command")
def simulate() -> None:
    """Run one integrator on one scenario."""


@main.command("map")
@click.argument("names", nargs=-1, metavar="INTEGRATOR... SCENARIO", shell_complete=METHODS_AND_SCENARIOS)
@many("integrator", "Instead of the words before the last.")
@many("scenario", "Instead of the last word.")
@click.option("--x", required=True, metavar="AXIS", help="name=low:high:n[:log], as in dt=0.02:4:40:log.")
@click.option("--y", required=True, metavar="AXIS", help="The same; constants are multiples of the scenario's own.")
@click.option("--dt", type=float, help="Step, where no axis is dt (default: the scenario's own).")
@click.option("--size", type=int, help="Scenarios in each cell of a map of random scenarios (default: 30).")
@click.option("--seed", type=int, help="Seed of these scenarios.")
@output(Path("results/map"))
@JOBS
@click.option("--timeout", type=float, default=300.0, show_default=True, help="Seconds a row of the map may take.")
@PLUGINS
@QUIET
@done_by("actions:map_command")
def map_() -> None:
    """A stability map over two parameters; several integrators are drawn side by side.

    Of random scenarios (`random`) the share of failures over the step and a constant, such as stiffness=0.03:300:6:log.
    """


@main.command()
@click.argument("names", nargs=-1, metavar="SCENARIO...", shell_complete=completion("plugins:scenarios"))
@many("scenario", "The same as a word.")
@PLUGINS
@done_by("actions:reference_command")
def reference() -> None:
    """Compute the reference solution of scenarios again and compare it with the one in use."""


@main.command()
@click.argument("names", nargs=-1, metavar="SCENARIO", shell_complete=completion("plugins:scenarios"))
@one("scenario", "Instead of the word.")
@click.option("--output", "-o", type=click.Path(path_type=Path, dir_okay=False), help="Write a data set, .npz or .mat.")
@click.option(
    "--judge", "judged", type=click.Path(path_type=Path, dir_okay=False),
    help="Judge this data set: how far it is from the solution, which integrator made it.",
)  # fmt: skip
@click.option("--starts", type=click.IntRange(1), default=50, show_default=True, help="Trajectories.")
@click.option("--every", type=float, help="Time between two states (default: the scenario's step).")
@click.option("--t-end", type=float, help="Final time; the scenario's own by default.")
@click.option("--spread", type=float, default=0.3, show_default=True, help="How far starts are moved, over their size.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of the starts and the split.")
@PLUGINS
@done_by("data:data_command")
def data() -> None:
    """Trajectories from many starts with a stated error for each state, to learn dynamics from; or judge such data."""


@main.command()
@runs()
@click.option("--table", metavar="NAME", help="This table alone, whatever its length.")
@click.option("--latex", is_flag=True, help="That table as a LaTeX tabular.")
@ROWS_OF_SCENARIOS
@ROWS_OF_INTEGRATORS
@PLUGINS
@done_by("actions:show_command")
def show() -> None:
    """Show the tables of a run, also while it is running; a summary of a large one. FOLDER: results/latest."""


@main.command()
@click.argument("folders", nargs=-1, type=click.Path(path_type=Path), metavar="[FOLDER]...")
@click.option(
    "--output", "-o", type=click.Path(path_type=Path), help="The page (default: report.html in the first FOLDER)."
)
@PLUGINS
@done_by("actions:report_command")
def report() -> None:
    """Write report.html of a run, or of several on one page: one self-contained file. FOLDER: results/latest."""


@main.command()
@click.argument("kind", required=False, metavar="[KIND]", shell_complete=completion("report.chart_kinds:kinds"))
@runs()
@click.option("--output", "-o", type=click.Path(path_type=Path), help="PNG, SVG or PDF by suffix (default: KIND.png).")
@click.option(
    "--scenario", "-s", metavar="NAME", shell_complete=completion("plugins:scenarios"),
    help="Draw this scenario; needed if the run has several.",
)  # fmt: skip
@many("integrator", "Draw this integrator (default: all of the run).")
@click.option("--x", metavar="COLUMN", help="Column of the horizontal axis (work-precision, conservation).")
@click.option(
    "--y", multiple=True, metavar="COLUMN", help="Draw these panels: columns, variables or laws; repeat for several."
)
@click.option("--dt", type=float, help="In laws, four-panel and path: only runs with this step.")
@click.option("--size", metavar="WxH", help="Size of the picture: 6x4 in inches, or 15x10cm.")
@click.option(
    "--font-size", type=float, metavar="POINTS", help="Font size of labels; titles and numbers follow (9 by default)."
)
@click.option("--methods", metavar="LIST", help="Draw these methods, in this order, labelled: NAME=LABEL,NAME,...")
@click.option("--style", metavar="FILE", help="A matplotlib style, file or name; your matplotlibrc is used, too.")
@PLUGINS
@done_by("pictures:plot_command")
def plot() -> None:
    """Draw one chart of a run; without a KIND, list the kinds. FOLDER: results/latest."""


@main.command()
@click.argument("names", nargs=-1, metavar="INTEGRATOR... SCENARIO", shell_complete=METHODS_AND_SCENARIOS)
@many("integrator", "Instead of the words before the last.")
@many("scenario", "Instead of the last word.")
@click.option(
    "--output", "-o", type=click.Path(path_type=Path), default=Path("movie.gif"), show_default=True,
    help="GIF, MP4 (needs ffmpeg) or HTML by suffix.",
)  # fmt: skip
@click.option("--dt", type=float, help="Step; the scenario's own by default.")
@click.option("--t-end", type=float, help="Final time; the scenario's own by default.")
@click.option("--tolerance", type=float, help="Tolerance of adaptive solvers.")
@click.option("--frames", type=click.IntRange(2, 2000), default=120, show_default=True, help="Number of frames.")
@click.option("--fps", type=click.IntRange(1, 60), default=20, show_default=True, help="Frames a second.")
@PLUGINS
@done_by("pictures:animate_command")
def animate() -> None:
    """Methods in motion, side by side: elements coloured by temperature, the laws running below."""


@main.command()
@output(Path("results/paper"))
@click.option("--format", "suffix", type=click.Choice(["png", "svg", "pdf"]), default="png", show_default=True)
@done_by("pictures:paper_command")
def paper() -> None:
    """Figures 2 to 9 of Romero (2009), with captions that say what differs from the paper's account."""


@main.command()
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="FOLDER...")
@output(Path("site"), "Folder of the site.")
@done_by("pictures:publish_command")
def publish() -> None:
    """A static site of several runs: an index by machine, each run's report and its tables."""


@main.command()
@runs("run_a", required=True, shown="RUN_A")
@runs("run_b", shown="[RUN_B]")
@ROWS_OF_SCENARIOS
@ROWS_OF_INTEGRATORS
@click.option("--fail-on-regression", is_flag=True, help="Exit with code 1 if RUN_B is worse.")
@done_by("actions:compare_command")
def compare() -> None:
    """What changed from RUN_A to RUN_B beyond noise, cell by cell. RUN_B: results/latest."""


@main.command()
@click.argument("kind", type=click.Choice(["integrator", "scenario", "system", "elements", "study"]), metavar="KIND")
@click.argument("name")
@click.option("--package", is_flag=True, help="A complete distribution: pyproject, source, a test.")
@click.option("--folder", type=click.Path(path_type=Path, file_okay=False), default=Path(), help="Where to write it.")
@done_by("actions:new_command")
def new() -> None:
    """Write a commented plugin that runs as it is: an integrator, scenario, system, elements, or study."""


@main.command()
@click.argument("targets", nargs=-1, metavar="FILE|NAME...")
@many("integrator", "Check this integrator.")
@many("scenario", "Check this scenario.")
@click.option("--only", metavar="LINE[,LINE]", default="", help="Check these lines only, as in --only order,claims.")
@PLUGINS
@done_by("actions:check_command")
def check() -> None:
    """Check plugins line by line: do they keep the contract, and what they claim?

    Exit code 0: no line fails; 1: some do; 2: there is no such plugin.
    """


main.add_command(cache_command)
