"""`tcbench check`: the contract of a plugin, a verdict per line with the remedy.

Everything that a plugin's author claims is measured on the registered scenarios; what cannot apply is "-", not "ok".
"""

from __future__ import annotations

import json
import queue
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from .. import plugins
from ..errors import TcbenchError, blamed, matching
from ..integrator import Integrator
from ..metric import Metric
from ..plugins import Origin
from ..runner.child import LOOK_S, READY, Child, how_it_died
from ..studies.base import refuse_doubles
from ..study import Study
from ..systems.scenario import Scenario
from . import integrator_checks, scenario_checks, study_checks
from .check_cost import estimate, time_per_step
from .check_line import FAIL, NONE, OK, Line, line

DEADLINE = 60.0  # seconds for a run in a process of its own, from when tcbench itself is loaded and compiled there
SLOW_S = 30.0  # loading and compiling that takes longer is that of a large system: the run may take longer, too
WARM_LIMIT = 900.0  # seconds for that; more on a slow machine means that something else is wrong
ALONE = ("runs", "step too large")  # lines that are runs in a process of their own
OF_INTEGRATORS = ("metadata", *(name for name, _ in integrator_checks.TESTS), *ALONE, "time per step")
OF_SCENARIOS = tuple(name for name, _ in scenario_checks.TESTS)
OF_STUDIES = tuple(name for name, _ in study_checks.TESTS)
DOES_NOT_RUN = Line("the rest", NONE, "not checked: the method does not run")
LOADED = (Line("loads", OK), Line("unique name", OK))  # the first lines of whatever has a name
LOOK_BELOW = "A step of 0.01 must succeed: see whether the formula is consistent with dz/dt."
HOOKED = ("integrators", "scenarios", "metrics", "studies", "charts")
STOPS = {
    "formulas": "no method can use these formulas",
    "positive": "no run goes on where a temperature or a measure is not positive",
}  # line -> why there is nothing to check behind it where it fails
WIDTH = max(map(len, OF_INTEGRATORS))  # of the names of lines; those of the operators may be longer


@dataclass(frozen=True)
class Subject:
    """What is checked: an integrator, a scenario, or a file that brings neither; its lines come as they are known."""

    name: str
    kind: str
    lines: Iterator[Line]


@dataclass(frozen=True)
class Report:
    """All lines for one subject."""

    name: str
    kind: str
    lines: tuple[Line, ...]

    @property
    def ok(self) -> bool:
        return all(line.verdict != FAIL for line in self.lines)

    def as_dict(self) -> dict[str, Any]:
        return {"name": self.name, "kind": self.kind, "ok": self.ok, "lines": [asdict(line) for line in self.lines]}


def check(target: str, only: Sequence[str] = ()) -> list[Report]:
    """The reports of a plugin file, or of registered integrators or scenarios."""
    return [Report(subject.name, subject.kind, tuple(subject.lines)) for subject in subjects(target, only)]


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
        return [_of_study(registry.studies[target], chosen)]
    return named([target], [], only)


def named(integrators: Sequence[str], scenarios: Sequence[str], only: Sequence[str] = ()) -> list[Subject]:
    """Integrators and scenarios of these names or patterns."""
    chosen, methods = _lines(only), plugins.expand_integrators(integrators)
    found = [_of_integrator(method, [], chosen) for method in methods]
    return found + [_of_scenario(scenario, chosen) for scenario in plugins.expand_scenarios(scenarios)]


def _lines(only: Sequence[str]) -> list[str]:
    known = dict.fromkeys((*OF_INTEGRATORS, *OF_SCENARIOS, *OF_STUDIES))
    return [one for name in only for one in matching("line of tcbench check", name, known)]


def _of_file(path: Path, only: Sequence[str]) -> list[Subject]:
    def found(*lines: Line) -> list[Subject]:
        return [Subject(path.stem, "plugin", iter(lines))]

    if not path.is_file():
        raise TcbenchError(f"There is no plugin file {str(path)!r}. tcbench new integrator NAME writes one.")
    plugins.use_folders([path])
    try:
        registry = plugins.registry()
        refuse_doubles(registry.studies.values())
    except TcbenchError as error:  # two plugins with one name
        remedy = "Rename yours; tcbench list shows the names that are taken."
        return found(Line("loads", OK), Line("unique name", FAIL, str(error), remedy))
    origin = next(o for o in registry.origins.values() if o.path and Path(o.path).resolve() == path.resolve())
    if origin.error:
        return found(_loads(origin))
    labels = {origin.name, origin.path}
    methods = [i for i in registry.integrators.values() if i.plugin in labels]
    result = [_of_integrator(v, [str(path.resolve())], only) for i in methods for v in i.variants() or [i]]
    offered: list[Any] = [*registry.scenarios.values(), *registry.scenario_families.values()]
    result += [_of_scenario(s, only) for s in plugins.expand_scenarios(s.name for s in offered if s.plugin in labels)]
    result += [_of_study(study, only) for study in registry.studies.values() if study.plugin in labels]
    result += [_of_metric(metric) for metric in registry.metrics.values() if metric.plugin in labels]
    brought = [f"chart {chart.name}" for chart in registry.charts.values() if chart.plugin in labels]
    if not result and not brought:
        remedy = f"Return it from a @hookimpl: {' or '.join(f'tcbench_{kind}' for kind in HOOKED)}."
        return found(Line("registers something", FAIL, "no hook is implemented", remedy))
    return result or found(Line("loads", OK, f"brings {', '.join(brought)}; a run of them says the rest"))


def _loads(origin: Origin) -> Line:
    return Line("loads", FAIL, origin.reason, "Fix what the message says; tcbench list shows the traceback.")


def _of_integrator(method: Integrator, folders: Sequence[str], only: Sequence[str]) -> Subject:
    return Subject(method.name, "integrator", integrator_lines(method, folders, only))


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
    if slow := _guarded("estimate", lambda method: estimate(method, [*tests]), method):
        yield slow
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
        return Line(
            name, FAIL, blamed(error), "Fix what the message says; a plugin must not raise on an admissible state."
        )


def _runs_alone(name: str, method: Integrator, folders: Sequence[str]) -> Line:
    """A run in a process of its own: ends in time, with a status."""
    named = [scenario.name for scenario in plugins.scenarios_for(method)]
    scenario = "short_term" if "short_term" in named else named[0]
    settings: dict[str, float] = {"dt": 0.01, "t_end": 0.1} if name == "runs" else {"dt": 1000.0, "t_end": 10000.0}
    if method.kind == "adaptive":
        settings = {"tolerance": 1e-6, "t_end": 0.1} if name == "runs" else {"tolerance": 0.5, "t_end": 100.0}
    folders = list(dict.fromkeys([*folders, *map(str, plugins.plugin_folders())]))
    with tempfile.TemporaryDirectory(prefix="tcbench-check-", ignore_cleanup_errors=True) as folder:
        output = Path(folder, "output")
        calls = [("warm", folders, scenario), ("run", method.name, scenario, settings)]
        row, ended, deadline = _in_time(calls, output)
        said = output.read_text(errors="replace").strip().splitlines()
    shown = ", ".join(f"{key} = {value:g}" for key, value in settings.items())
    if not ended:
        found = f"no answer after {deadline:.0f} s ({scenario}, {shown})"
        return Line(name, FAIL, found, "Bound the number of iterations and raise an exception when they run out.")
    if row is None or row.get("kind") == "":
        found = (row["raised"].strip().splitlines() if row else said or [ended])[-1]
        return Line(
            name, FAIL, found, "The process must not die: see the sentence; a segmentation fault shows no more."
        )
    if "raised" in row:  # a formula that is refused, for instance: the sentence says all
        return Line(name, FAIL, row["sentence"], "Fix what the message says.")
    if name == "runs":
        found = row["status"] if row["status"] == "ok" else f"{row['status']}: {row['failure']}"
        remedy = "Fix what the message says." if row["status"] == "exception" else LOOK_BELOW
        return line(name, row["status"] == "ok", found, remedy)
    return Line(name, OK, f"h = 1000: status {row['status']}" if "dt" in settings else f"status {row['status']}")


def _in_time(calls: Sequence[tuple[Any, ...]], output: Path) -> tuple[dict[str, Any] | None, str, float]:
    """The answer of the last of these calls (see alone.py), or of one that raised; how the process ended, "" if it had
    to be killed; and the deadline that it had.

    The clock starts when tcbench is loaded and compiled there: what that took is ours. A system so large that ours
    takes long is given ten times as long.
    """
    answers: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
    began, limit, deadline, heard, answer = time.monotonic(), WARM_LIMIT, DEADLINE, 0, None
    with output.open("wb") as file:
        child = Child(lambda _, line: answers.put(line), output=file)
        for function, *arguments in calls:
            child.call(f"{__package__}.alone:{function}", *arguments)
        try:
            while heard <= len(calls) and answer is None:
                try:
                    text = answers.get(timeout=min(LOOK_S, limit))
                except queue.Empty:
                    if time.monotonic() - began > limit:
                        return None, "", deadline
                    continue
                if text is None:  # it has died
                    return None, how_it_died(child.process.wait()), deadline
                heard, answer = heard + 1, None if text == READY else json.loads(text)
                if heard == len(calls):  # all but the last are ours
                    warm, began = time.monotonic() - began, time.monotonic()
                    limit = deadline = DEADLINE if warm < SLOW_S else max(DEADLINE, 10 * warm)
        finally:
            child.kill()
    return answer, "answered", deadline


def _of_study(study: Study, only: Sequence[str]) -> Subject:
    return Subject(study.name, "study", study_lines(study, only))


def _of_metric(metric: Metric) -> Subject:
    return Subject(metric.name, "column", (_guarded("number", study_checks.number, one) for one in [metric]))


def study_lines(study: Study, only: Sequence[str] = ()) -> Iterator[Line]:
    """Every line for one study; each needs those before it."""
    yield from LOADED
    charts = [chart for chart in plugins.registry().charts.values() if chart.plugin == study.plugin]
    trial = study_checks.Trial(study, charts)
    for name, test in study_checks.TESTS:
        found = _guarded(name, test, trial)
        if not only or name in only or found.verdict == FAIL:
            yield found
        if found.verdict == FAIL or not trial.cells:
            return


def _of_scenario(scenario: Scenario, only: Sequence[str]) -> Subject:
    return Subject(scenario.name, "scenario", scenario_lines(scenario, only))


def scenario_lines(scenario: Scenario, only: Sequence[str] = ()) -> Iterator[Line]:
    """Every line for one scenario and its system."""
    yield from LOADED
    for name, test in scenario_checks.TESTS:
        if not only or name in only:
            found = _guarded(name, test, scenario)
            lines = found if isinstance(found, list) else [found]
            yield from lines
            if reason := next((STOPS[x.check] for x in lines if x.verdict == FAIL and x.check in STOPS), ""):
                yield Line("the rest", NONE, f"not checked: {reason}")
                return


def printable(item: Line) -> Iterator[str]:
    """A line as text, with its remedy below it."""
    yield f"  {item.verdict:4}  {item.check:{WIDTH}}  {item.found}".rstrip()
    if item.remedy:
        yield f"        {'':{WIDTH}}  -> {item.remedy}"


def verdict(report: Report) -> str:
    """The last line of a report."""
    failed = sum(item.verdict == FAIL for item in report.lines)
    return f"{report.name}: {'all lines pass' if report.ok else f'{failed} to fix'}\n"
