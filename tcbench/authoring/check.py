"""`tcbench check`: the contract of a plugin, a verdict per line with the remedy.

Everything that a plugin's author claims is measured on the registered scenarios; what cannot apply is "-", not "ok".
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import plugins
from ..errors import TcbenchError
from .check_line import FAIL, NONE, OK, Line, line

if TYPE_CHECKING:
    from ..integrator import Integrator
    from ..plugins import Origin
    from ..systems.scenario import Scenario

DEADLINE = 60.0  # seconds for a run in a process of its own, start-up and a first compilation included


@dataclass(frozen=True)
class Report:
    """All lines for one integrator or scenario (or for a file that brings neither)."""

    name: str
    kind: str
    lines: tuple[Line, ...]

    @property
    def ok(self) -> bool:
        return all(line.verdict != FAIL for line in self.lines)

    def as_dict(self) -> dict[str, Any]:
        return {"name": self.name, "kind": self.kind, "ok": self.ok, "lines": [asdict(line) for line in self.lines]}


def check(target: str) -> list[Report]:
    """The reports of a plugin file, or of a registered integrator or scenario."""
    path = Path(target)
    if path.suffix == ".py" or path.exists():
        return _check_file(path)
    registry = plugins.registry()
    broken = [o for o in registry.broken if o.name == target]
    if broken:
        return [Report(target, "plugin", (_loads(broken[0]),))]
    if target in registry.scenarios:
        return [check_scenario(registry.scenarios[target])]
    return [check_integrator(method, []) for method in plugins.expand_integrators([target])]


def _check_file(path: Path) -> list[Report]:
    if not path.is_file():
        raise TcbenchError(f"There is no plugin file {str(path)!r}. tcbench new integrator NAME writes one.")
    try:
        plugins.use_folders([path])
        registry = plugins.registry()
    except TcbenchError as error:  # two plugins with one name
        remedy = "Rename yours; tcbench list shows the names that are taken."
        return [Report(path.stem, "plugin", (Line("loads", OK), Line("unique name", FAIL, str(error), remedy)))]
    origin = next(o for o in registry.origins.values() if o.path and Path(o.path).resolve() == path.resolve())
    if origin.error:
        return [Report(path.stem, "plugin", (_loads(origin),))]
    labels = {origin.name, origin.path}
    methods = [i for i in registry.integrators.values() if i.plugin in labels]
    scenarios = [s for s in registry.scenarios.values() if s.plugin in labels]
    reports = [check_integrator(v, [str(path.resolve())]) for i in methods for v in i.variants() or [i]]
    reports += [check_scenario(s) for s in scenarios]
    if not reports and not any(m.plugin in labels for m in registry.metrics.values()):
        remedy = "Decorate a function with @hookimpl: tcbench_integrators, tcbench_scenarios or tcbench_metrics."
        return [Report(path.stem, "plugin", (Line("registers something", FAIL, "no hook is implemented", remedy),))]
    return reports or [Report(path.stem, "plugin", (Line("loads", OK, "brings metrics only"),))]


def _loads(origin: Origin) -> Line:
    found = origin.error.strip().splitlines()[-1]
    places = [text.strip() for text in origin.error.splitlines() if origin.path and origin.path in text]
    where = f" ({places[-1]})" if places else ""
    return Line("loads", FAIL, found + where, "Mend the line that the message names; tcbench list shows the traceback.")


def check_integrator(method: Integrator, folders: Sequence[str]) -> Report:
    """Every line for one integrator. Begins in a process of its own: a hang or a crash ends there."""
    from . import integrator_checks as contract

    lines = [Line("loads", OK), Line("unique name", OK), contract.metadata(method)]
    tests = dict(contract.TESTS)
    if method.kind == "flows":  # harmless to trace here; and a formula that fails it does not run
        lines.append(_guarded("input unchanged", tests.pop("input unchanged"), method))
    started = _runs_alone("runs", method, "--dt", ["0.01", "--t-end", "0.1"], folders)
    lines.append(started)
    if started.verdict == FAIL:
        lines.append(Line("the rest", NONE, "not checked: the method does not run"))
        return Report(method.name, "integrator", tuple(lines))
    lines += [_guarded(name, test, method) for name, test in tests.items()]
    lines.append(_runs_alone("step too large", method, "--dt", ["1000", "--t-end", "10000"], folders))
    lines.append(_guarded("time per step", contract.time_per_step, method))
    return Report(method.name, "integrator", tuple(lines))


def _guarded(name: str, test: Callable[[Any], Any], subject: Any) -> Any:
    """The line (or lines) of a test; an exception of the plugin is a finding, not the end of the check."""
    try:
        return test(subject)
    except Exception as error:
        from ..simulation.recorder import exception_sentence

        sentence = exception_sentence(error, 0, 0.0).partition("): ")[2]
        return Line(name, FAIL, sentence, "The plugin must not raise on an admissible state; see the sentence.")


def _runs_alone(name: str, method: Integrator, control: str, numbers: Sequence[str], folders: Sequence[str]) -> Line:
    """A run in a process of its own, from the command line: ends in time, with a status."""
    named = [scenario.name for scenario in plugins.scenarios_for(method)]
    scenario = "short_term" if "short_term" in named else named[0]
    if method.kind == "adaptive":
        control, numbers = "--tolerance", ["1e-6", *numbers[1:]] if name == "runs" else ["0.5", "--t-end", "100"]
    folders = [*folders, *map(str, plugins.plugin_folders())]
    command = [sys.executable, "-P", "-m", "tcbench", "simulate", method.name, scenario, control, *numbers, "--json"]
    command += [word for folder in dict.fromkeys(folders) for word in ("--plugins-dir", folder)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE, check=False)
    except subprocess.TimeoutExpired:
        found = f"no answer after {DEADLINE:.0f} s ({' '.join(command[3:])})"
        return Line(name, FAIL, found, "Bound the number of iterations and raise an exception when they run out.")
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        return Line(name, FAIL, last, "The process must not die: see the sentence; a segmentation fault shows no more.")
    row = json.loads(done.stdout[done.stdout.index("{") :])
    if name == "runs":
        found = row["status"] if row["status"] == "ok" else f"{row['status']}: {row['failure']}"
        return line(name, row["status"] == "ok", found, "See the sentence; it names the step and your line.")
    return Line(
        name, OK, f"h = {numbers[0]}: status {row['status']}" if control == "--dt" else f"status {row['status']}"
    )


def check_scenario(scenario: Scenario) -> Report:
    """Every line for one scenario and its system."""
    from . import scenario_checks as contract_scenario

    lines = [Line("loads", OK), Line("unique name", OK)]
    for name, test in contract_scenario.TESTS:
        found = _guarded(name, test, scenario)
        lines += found if isinstance(found, list) else [found]
    return Report(scenario.name, "scenario", tuple(lines))


def printable(reports: Sequence[Report]) -> Iterator[str]:
    """The reports as lines of text."""
    for report in reports:
        yield f"{report.kind} {report.name}"
        width = max(len(item.check) for item in report.lines)
        for item in report.lines:
            yield f"  {item.verdict:4}  {item.check:{width}}  {item.found}".rstrip()
            if item.remedy:
                yield f"        {'':{width}}  -> {item.remedy}"
        failed = sum(item.verdict == FAIL for item in report.lines)
        yield f"{report.name}: {'all lines pass' if report.ok else f'{failed} to mend'}\n"
