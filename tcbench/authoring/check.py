"""`tcbench check`: the contract of a plugin, a verdict per line with the remedy.

Everything that a plugin's author claims is measured on the registered scenarios; what cannot apply is "-", not "ok".
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from .. import plugins
from ..errors import TcbenchError, blamed, matching
from ..integrator import Integrator
from ..plugins import Origin
from ..runner.cell import Cell
from ..runner.plan import foreign_plugins
from ..runner.rows import Rows
from ..runner.scheduler import run_cells
from ..simulation.run import simulate
from ..studies.base import refuse_doubles
from ..systems.scenario import Scenario
from . import integrator_checks, scenario_checks
from .check_line import FAIL, NONE, OK, Line, line

DEADLINE = 60.0  # seconds for a run in a process of its own, from when tcbench and the plugin are loaded there
LARGE, LONGER = 2000, 10  # numbers of a state from which on compiling takes long, and how many times as long it may
ALONE = ("runs", "step too large")  # lines that are runs in a process of their own
OF_INTEGRATORS = ("metadata", *(name for name, _ in integrator_checks.TESTS), *ALONE, "time per step")
OF_SCENARIOS = tuple(name for name, _ in scenario_checks.TESTS)
DOES_NOT_RUN = Line("the rest", NONE, "not checked: the method does not run")
RUN_SAYS = "a run of them says the rest"
LOADED = (Line("loads", OK), Line("unique name", OK))  # the first lines of whatever has a name
SMALL = 0.01  # a step at which every method runs
LOOK_BELOW = "A small step must succeed: see whether the formula is consistent with dz/dt, and the scenario not stiff."
DIED = "The process must not die: see the sentence; a segmentation fault shows no more."
BOUND = "Bound the number of iterations and raise an exception when they run out."
HOOKED = ("integrators", "scenarios", "metrics", "studies", "charts")
OTHERS = {"metric": "metrics", "study": "studies", "chart": "charts"}
STOPS = {
    "formulas": "no method can use these formulas",
    "positive": "no run goes on where a temperature or a measure is not positive",
}  # line -> why there is nothing to check behind it where it fails
WIDTH = max(map(len, OF_INTEGRATORS))  # of the names of lines; those of the operators may be longer


@dataclass(eq=False)
class Subject:
    """What is checked: an integrator, a scenario, or a file that brings neither. Walked over it gives its lines as they
    are known, and `results` has those that have been given."""

    name: str
    kind: str
    lines: Iterator[Line]
    results: list[Line] = field(default_factory=list)

    def __iter__(self) -> Iterator[Line]:
        for one in self.lines:
            self.results.append(one)
            yield one

    @property
    def ok(self) -> bool:
        return all(line.verdict != FAIL for line in self.results)

    def as_dict(self) -> dict[str, Any]:
        return {"name": self.name, "kind": self.kind, "ok": self.ok, "lines": [asdict(line) for line in self.results]}


def check(target: str, only: Sequence[str] = ()) -> list[Subject]:
    """What a plugin file, or registered integrators or scenarios, stand for, with all lines."""
    chosen = subjects(target, only)
    for subject in chosen:
        for _ in subject:
            pass
    return chosen


def subjects(target: str, only: Sequence[str] = ()) -> list[Subject]:
    """What a target (a file, a name, a pattern) stands for. only : the lines to check, all if there are none.

    Nothing is run before the lines are asked for; raises TcbenchError for targets and lines that do not exist.
    """
    chosen, path = _lines(only), Path(target)
    if path.suffix == ".py" or path.is_file():
        return _of_file(path, chosen)
    registry = plugins.registry()
    if path.is_dir() and target not in {*registry.integrators, *registry.scenarios}:
        raise TcbenchError(f"{target!r} is a folder: name a plugin file in it. tcbench new integrator NAME writes one.")
    broken = [o for o in registry.broken if o.name == target]
    if broken:
        return [Subject(target, "plugin", iter([_loads(broken[0])]))]
    if target in registry.scenarios or plugins.split_name(target)[0] in registry.scenario_families:
        return named([], [target], only)
    if target in registry.studies:
        return [Subject(target, "study", iter([*LOADED, Line("the rest", NONE, RUN_SAYS)]))]
    return named([target], [], only)


def named(integrators: Sequence[str], scenarios: Sequence[str], only: Sequence[str] = ()) -> list[Subject]:
    """Integrators and scenarios of these names or patterns."""
    chosen, methods = _lines(only), plugins.expand_integrators(integrators)
    judged = [Subject(method.name, "integrator", integrator_lines(method, [], chosen)) for method in methods]
    return judged + [
        Subject(s.name, "scenario", scenario_lines(s, chosen)) for s in plugins.expand_scenarios(scenarios)
    ]


def _lines(only: Sequence[str]) -> list[str]:
    names = dict.fromkeys((*OF_INTEGRATORS, *OF_SCENARIOS))
    return [one for name in only for one in matching("line of tcbench check", name, names)]


def _of_file(path: Path, only: Sequence[str]) -> list[Subject]:
    def alone(*lines: Line) -> list[Subject]:
        return [Subject(path.stem, "plugin", iter(lines))]

    if not path.is_file():
        raise TcbenchError(f"There is no plugin file {str(path)!r}. tcbench new integrator NAME writes one.")
    plugins.use_folders([path])
    try:
        registry = plugins.registry()
        refuse_doubles(registry.studies.values())
    except TcbenchError as error:  # two plugins with one name
        remedy = "Rename yours; tcbench list shows the names that are taken."
        return alone(Line("loads", OK), Line("unique name", FAIL, str(error), remedy))
    origin = next(o for o in registry.origins.values() if o.path and Path(o.path).resolve() == path.resolve())
    if origin.error:
        return alone(_loads(origin))

    def brings(*kinds: str) -> list[Any]:
        every = [one for kind in kinds for one in getattr(registry, kind).values()]
        return [one for one in every if one.plugin in {origin.name, origin.path}]

    methods = [v for i in brings("integrators") for v in i.variants() or [i]]
    scenarios = plugins.expand_scenarios(s.name for s in brings("scenarios", "scenario_families"))
    result = [Subject(m.name, "integrator", integrator_lines(m, [str(path.resolve())], only)) for m in methods]
    result += [Subject(s.name, "scenario", scenario_lines(s, only)) for s in scenarios]
    others = [f"{kind} {one.name}" for kind in ("metric", "study", "chart") for one in brings(OTHERS[kind])]
    if not result and not others:
        remedy = f"Return it from a @hookimpl: {' or '.join(f'tcbench_{kind}' for kind in HOOKED)}."
        return alone(Line("registers something", FAIL, "no hook is implemented", remedy))
    return result or alone(Line("loads", OK, f"brings {', '.join(others)}; {RUN_SAYS}"))


def _loads(origin: Origin) -> Line:
    return Line("loads", FAIL, origin.reason, "Fix what the message says; tcbench list shows the traceback.")


def integrator_lines(method: Integrator, folders: Sequence[str] = (), only: Sequence[str] = ()) -> Iterator[Line]:
    """Every line for one integrator. Begins in a process of its own: a hang or a crash ends there."""
    wanted = set(only or OF_INTEGRATORS)
    yield from LOADED
    if "metadata" in wanted:
        yield integrator_checks.metadata(method)
    tests = {name: test for name, test in integrator_checks.TESTS if name in wanted}
    if method.kind == "flows" and "input unchanged" in tests:  # harmless to trace here; what cannot be does not run
        yield (traced := _guarded("runs", tests.pop("input unchanged"), method))
        if traced.check == "runs":
            yield DOES_NOT_RUN
            return
    started = _runs_alone("runs", method, folders)
    yield started
    if started.verdict == FAIL:
        if started.remedy == LOOK_BELOW and "consistent" in tests:
            yield _guarded("consistent", tests["consistent"], method)
        yield DOES_NOT_RUN
        return
    for name, test in tests.items():
        yield _guarded(name, test, method)
    if "step too large" in wanted:
        yield _runs_alone("step too large", method, folders)
    if "time per step" in wanted:
        yield _guarded("time per step", time_per_step, method)


def _guarded(name: str, test: Callable[[Any], Any], subject: Any) -> Any:
    """The line (or lines) of a test; an exception of the plugin is a finding, not the end of the check."""
    try:
        return test(subject)
    except TcbenchError as error:
        return Line(name, FAIL, str(error), "Fix what the message says.")
    except (Exception, SystemExit) as error:
        remedy = "Fix what the message says; a plugin must not raise on an admissible state."
        return Line(name, FAIL, blamed(error), remedy)


def _runs_alone(name: str, method: Integrator, folders: Sequence[str]) -> Line:
    """A run in a process of its own: ends in time, with a status."""
    scenario = integrator_checks.scenarios(method)[0]  # not a stiff one, where explicit methods fail at any such step
    dt = min(SMALL, integrator_checks.GENTLE * scenario.dt)
    settings: dict[str, float] = {"dt": dt, "t_end": 10 * dt} if name == "runs" else {"dt": 1000.0, "t_end": 10000.0}
    if method.kind == "adaptive":
        settings = {"tolerance": 1e-6, "t_end": 0.1} if name == "runs" else {"tolerance": 0.5, "t_end": 100.0}
    row = _row_of(method, scenario, settings, folders)
    status, shown = row["status"], ", ".join(f"{key} = {value:g}" for key, value in settings.items())
    if status == "timeout":
        return Line(name, FAIL, f"no answer: {row['failure']} ({scenario.name}, {shown})", BOUND)
    if status == "crash":
        said = row.get("output_tail", "").strip().splitlines()
        return Line(name, FAIL, said[-1] if said else row["failure"], DIED)
    if kind := row.get("exception_type"):  # not of a step, which is a status: a formula that is refused, for instance
        return Line(name, FAIL, f"{kind}: {row['exception_message']}", "Fix what the message says.")
    if name == "runs":
        ended = status if status == "ok" else f"{status}: {row['failure']}"
        return line(name, status == "ok", ended, "Fix what the message says." if status == "exception" else LOOK_BELOW)
    return Line(name, OK, f"h = 1000: status {status}" if "dt" in settings else f"status {status}")


def _row_of(method: Integrator, scenario: Scenario, settings: dict[str, float], folders: Sequence[str]) -> Any:
    """The row of one run, as of a cell of a study: exceptions, hangs and crashes have one, too."""
    needed = foreign_plugins(plugins.needs(method.name, method.plugin, scenario.name, scenario.plugin))
    paths = list(dict.fromkeys([*folders, *map(str, plugins.plugin_folders())]))
    context = {"folders": paths, "brought_by": {method.name: needed}}
    cell, rows = Cell("check", method.name, scenario.name, settings), Rows()
    timeout = DEADLINE * (LONGER if scenario.model.size > LARGE else 1)
    run_cells([cell], f"{__name__}:measure", context, rows, jobs=1, timeout=timeout)
    return rows.rows()[cell.key]


def measure(cell: dict[str, Any], context: dict[str, Any]) -> dict[str, Any]:
    """Status and failure of one run, in that process."""
    run = simulate(cell["integrator"], plugins.find_scenario(cell["scenario"]), **cell["options"])
    return {"status": run.status, "failure": run.failure}


def time_per_step(method: Integrator) -> Line:
    """Microseconds a step beside the built-in monolithic method; for information, no limit."""
    chosen = [s for s in plugins.scenarios_for(method) if s.name == "short_term"] or integrator_checks.scenarios(method)
    if method.kind == "adaptive":
        one = simulate(method, chosen[0], t_end=5.0)
        return Line("time per step", OK, f"{1e6 * one.wall_time_s / max(1, one.steps):.3g} us an internal step")
    times = []
    for each in (method, plugins.find_integrator("tc_monolithic")):
        count = 2000 if each.kind == "flows" else 50
        runs = [simulate(each, chosen[0], dt=0.01, t_end=count * 0.01, record_every=None) for _ in range(3)]
        times.append(min(1e6 * one.wall_time_s / max(1, one.steps) for one in runs))
    return Line("time per step", OK, f"{times[0]:.3g} us (tc_monolithic: {times[1]:.3g} us)")


def scenario_lines(scenario: Scenario, only: Sequence[str] = ()) -> Iterator[Line]:
    """Every line for one scenario and its system."""
    yield from LOADED
    for name, test in scenario_checks.TESTS:
        if not only or name in only:
            answer = _guarded(name, test, scenario)
            lines = answer if isinstance(answer, list) else [answer]
            yield from lines
            if reason := next((STOPS[x.check] for x in lines if x.verdict == FAIL and x.check in STOPS), ""):
                yield Line("the rest", NONE, f"not checked: {reason}")
                return


def printable(item: Line) -> Iterator[str]:
    """A line as text, with its remedy below it."""
    yield f"  {item.verdict:4}  {item.check:{WIDTH}}  {item.found}".rstrip()
    if item.remedy:
        yield f"        {'':{WIDTH}}  -> {item.remedy}"


def verdict(subject: Subject) -> str:
    """The last line of a report."""
    failed = sum(item.verdict == FAIL for item in subject.results)
    return f"{subject.name}: {'all lines pass' if subject.ok else f'{failed} to fix'}\n"
