"""What a run will do, before it does it: cells of integrators x scenarios x studies."""

from __future__ import annotations

import pkgutil
import sys
from collections import UserDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Sized
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypedDict

from .. import plugins
from ..compiler.formula_hash import formula_hash
from ..errors import TcbenchError, several, unknown_name
from ..integrator import Integrator
from ..studies.base import default_studies, expand_studies, find_study, refuse_doubles
from ..study import Study
from ..systems.scenario import Scenario
from . import hashes
from .cell import Cell
from .codec import digest
from .declared import declared
from .disk import could_write
from .eta import Remaining
from .ledger import Summary, check_limits, plan
from .provenance import machine_name, usable_cores
from .rows import ROWS, Rows, Store


class Context(TypedDict):
    """What a worker is told beside its cells. JSON.

    folders : of plugin files. brought_by : integrator -> the plugins, not tcbench's own, that its cells need. made_by :
    key -> what the row is made by. scenarios : by name those that no plugin brings. fresh : studies whose cells have a
    process each.
    """

    folders: list[str]
    brought_by: dict[str, list[tuple[str, str, str]]]
    made_by: dict[str, str]
    scenarios: dict[str, dict[str, Any]]
    fresh: list[str]


@dataclass(frozen=True, eq=False)
class Job:
    """Everything that a run will do, before it does it.

    local : by key, cells of what workers cannot look up (objects of a notebook), measured in this process.
    left_out : why methods that were asked for by name are in none of a study's cells. notes : absent peers, steps that
    do not apply, plugins that were not loaded. packages : that the methods require. declared : what methods and
    scenarios say of themselves.
    """

    cells: list[Cell]
    context: Context
    studies: list[Study]
    local: Mapping[str, tuple[Integrator, Scenario]] = field(default_factory=dict)
    left_out: Sequence[str] = ()
    notes: Sequence[str] = ()
    packages: Sequence[str] = ()
    declared: Callable[[], Mapping[str, Any]] = dict


class _Options(UserDict[str, Any]):
    """The options of a run, and which of them its studies have asked for."""

    requests: set[str]

    def __getitem__(self, name: str) -> Any:
        self.requests.add(name)
        return super().__getitem__(name)

    def __contains__(self, name: object) -> bool:
        self.requests.add(str(name))
        return super().__contains__(name)

    def __init__(self, options: Mapping[str, Any]) -> None:
        self.requests = set()
        super().__init__(options)

    @contextmanager
    def recorded(self) -> Iterator[set[str]]:
        """The names that are asked for within the block alone."""
        before, self.requests = self.requests, set()
        yield self.requests
        self.requests |= before

    def check(self, names: Mapping[str, Any]) -> None:
        """Refuse those that no study has asked for: a misspelt one would be left out without a word."""
        for name in names:
            if names[name] is not None and name not in self.requests:
                random = name in ("size", "seed", "budget")
                remedy = f"{name} is for random scenarios: the study ensemble, and maps of them." if random else ""
                raise unknown_name("option of the chosen studies", name, self.requests, remedy)


def plan_job(
    integrators: Iterable[str | Integrator] | None = None,
    scenarios: Iterable[str | Scenario] | None = None,
    studies: Iterable[str] | None = None,
    *,
    dt: Sequence[float] | None = None,
    options: Mapping[str, Any] | None = None,
) -> Job:
    """Look everything up and plan the cells; raises TcbenchError before anything is written."""
    for name, chosen_names in (("integrators", integrators), ("scenarios", scenarios), ("studies", studies)):
        _check_list(name, chosen_names)
    hashes.forget()
    registry = plugins.registry()
    refuse_doubles(registry.studies.values())
    methods = plugins.expand_integrators(plugins.by_default() if integrators is None else integrators)
    named = None if scenarios is None else list(scenarios)
    selected = [s.current() for s in plugins.expand_scenarios(registry.scenarios if named is None else named)]
    by_study = studies is not None
    chosen = [find_study(name) for name in (default_studies() if studies is None else expand_studies(studies))]
    if all(map(plugins.is_sampled, selected)):
        chosen = [find_study(study.of_random or study.name) for study in chosen]
    if len({s.name for s in selected}) < len(selected):
        raise TcbenchError("Two scenarios of one run have the same name; give variants a name: replace(name=...).")
    settings = _Options({"dt": _checked_steps(None if dt is None else list(dt), selected), **(options or {})})
    cells, own_steps = _Cells(selected), list[str]()
    for study in chosen:
        with settings.recorded() as requests:
            planned = study.planned(methods, _of_study(study, selected, named), settings)
        own_steps += [study.name] if dt and planned and "dt" not in requests else []
        for method, scenario, cell_options in planned:
            if not method.suits(scenario.model):
                cells.add(study, method, scenario, cell_options)
    settings.check(options or {})
    left_out: list[str] = []
    if integrators is not None:
        left_out += [*_left_out(methods, chosen, selected, cells.studied, by_study), *_unsuited(methods, selected)]
    if not cells.cells:
        raise TcbenchError(
            " ".join(["There is nothing to run: no integrator, scenario and step fit together.", *left_out])
        )
    absent = {name: m.lacks for name, m in registry.integrators.items() if m.lacks}
    notes = [*_not_run(absent if integrators is None else {}, methods, dt, own_steps), *plugins.not_loaded()]
    notes += sorted(_no_laws(methods, [*cells.used.values()]))
    packages = sorted({name for method in methods for name in method.requires})
    return Job(
        list(cells.cells.values()), cells.context([s.name for s in chosen if s.fresh]), chosen, cells.local, left_out,
        notes, packages, lambda: declared(methods, selected, absent, chosen),
    )  # fmt: skip


class _Cells:
    """The cells of a job by key, and what workers need for them."""

    def __init__(self, selected: Sequence[Scenario]) -> None:
        self.cells: dict[str, Cell] = {}
        self.local: dict[str, tuple[Integrator, Scenario]] = {}
        self.used = {s.name: s for s in selected}
        self.studied: set[tuple[str, str]] = set()  # method and study
        self._needs: dict[str, set[str]] = {}
        self._made_by: dict[str, str] = {}
        self._pairs: dict[tuple[str, str, str], str] = {}
        self._custom: dict[str, dict[str, Any] | None] = {}  # by scenario: of what no plugin brings
        self._by_name: dict[str, bool] = {}
        self._registered: dict[str, bool] = {}

    def add(self, study: Study, method: Integrator, scenario: Scenario, options: dict[str, Any]) -> None:
        name = scenario.name
        self.used.setdefault(name, scenario)
        self.studied.add((method.name, study.name))
        if name not in self._by_name:
            self._by_name[name] = _can_be_named(scenario)
            self._custom[name] = None if self._by_name[name] else scenario_data(scenario)
        if method.name not in self._registered:
            self._registered[method.name] = plugins.is_registered(method)
        cell, custom = Cell(study.name, method.name, name, options, study.is_timed(options)), self._custom[name]
        self.cells[cell.key] = cell
        if not self._registered[method.name] or not (self._by_name[name] or custom):
            self.local[cell.key] = method, scenario
        pair = study.name, method.name, name
        if pair not in self._pairs:
            self._pairs[pair] = hashes.made_by(method, scenario, study, custom)
            own = (method.name, method.plugin, name, scenario.plugin, study.plugin)
            metrics = [m.plugin for m in plugins.metrics().values()] if study.metrics else []
            self._needs.setdefault(method.name, set()).update(plugins.needs(*own, *metrics))
        drawn = f"+{digest(study.drawn(scenario, options))[:12]}" if study.drawn else ""
        self._made_by[cell.key] = "session" if cell.key in self.local else self._pairs[pair] + drawn  # never used again

    def context(self, fresh: list[str]) -> Context:
        named = {name: foreign_plugins(labels) for name, labels in self._needs.items() if labels}
        custom = {name: data for name, data in self._custom.items() if data}
        return Context(
            folders=[str(folder) for folder in plugins.plugin_folders()], brought_by=named, made_by=self._made_by,
            scenarios=custom, fresh=fresh,
        )  # fmt: skip


def foreign_plugins(labels: Iterable[str]) -> list[tuple[str, str, str]]:
    """Name, distribution and path of the plugins of these labels, as `plugins.use_only` takes them."""
    origins = map(plugins.registry().origins.get, labels)
    return [(o.name, o.distribution, o.path if not o.distribution else "") for o in origins if o]


def scenario_data(scenario: Scenario) -> dict[str, Any] | None:
    """A scenario that no plugin brings, as JSON, to be made again in a worker; None where that cannot import its
    system. folder : of the system's code, where that is not tcbench's."""
    system = scenario.system
    module = sys.modules.get(system.__module__)
    try:
        if (
            system.__module__ == "__main__"
            or pkgutil.resolve_name(f"{system.__module__}:{system.__qualname__}") is not system
        ):
            return None
    except (AttributeError, ValueError, ImportError):  # it is local to a function
        return None
    file, code = getattr(module, "__file__", None), formula_hash(system)
    if code is None or system.__module__.startswith("tcbench_plugin_"):
        return None
    own = system.__module__.partition(".")[0] in ("tcbench", "tcbench_plugins")
    return scenario.as_dict() | {
        "system": f"{system.__module__}:{system.__qualname__}", "code": code, "name": scenario.name, "dt": scenario.dt,
        "t_converge": scenario.t_converge, "ladder": list(scenario.ladder),
        "folder": "" if own or not file else str(Path(file).parent) if not hashes.is_installed(file) else file,
    }  # fmt: skip


def _check_list(name: str, values: Any) -> None:
    """None, or names and objects in a list that is not empty."""
    listed = several(values) and not isinstance(values, Mapping)
    if values is None or (listed and (not isinstance(values, Sized) or len(values))):
        return
    raise TcbenchError(f"{name} is a list of at least one, or None for all of them, not {values!r}.")


def _of_study(study: Study, selected: Sequence[Scenario], named: Any) -> Sequence[Scenario]:
    """What a study plans with: where no scenario is named its own, and the random families for one that draws."""
    if named is None and study.scenarios:
        return [plugins.find_scenario(name) for name in study.scenarios]
    if not study.sampled or named is not None:
        return selected
    families = plugins.registry().scenario_families
    return [plugins.find_scenario(name) for name, family in families.items() if family.sample and family.by_default]


def _left_out(
    methods: Sequence[Integrator], chosen: Sequence[Study], scenarios: Sequence[Scenario], seen: set[tuple[str, str]],
    by_name: bool,
) -> Iterator[str]:  # fmt: skip
    """Why methods have no cell: in a study that was asked for by name, or in any."""
    for method in methods:
        missing = [study for study in chosen if (method.name, study.name) not in seen]
        if by_name or len(missing) == len(chosen):
            yield from (_why_not(method, study, scenarios) for study in missing[: None if by_name else 1])


def _not_run(
    absent: Mapping[str, str], methods: Sequence[Integrator], dt: Any, own_steps: Sequence[str]
) -> Iterator[str]:
    """Sentences on what a run leaves out although nobody said so: absent peers, and steps that do not apply."""
    yield from (f"{name} was not run: {why}." for name, why in absent.items())
    adaptive = [method.name for method in methods if method.kind == "adaptive"]
    if dt and adaptive:
        yield f"--dt does not apply to methods that choose their steps: {', '.join(adaptive)}."
    if own_steps:
        yield f"--dt does not apply to studies that have steps of their own: {', '.join(own_steps)}."


def _no_laws(methods: Sequence[Integrator], used: Sequence[Scenario]) -> Iterator[str]:
    """Sentences on claims of what no system has: misspelt, they would not be judged, as if nothing were claimed."""
    for method in methods:
        laws = set(method.claims) - {"energy", "entropy"}
        for scenario in (*used, *plugins.registry().scenarios.values()):
            if not laws:
                break
            laws -= set(scenario.model.invariant_names)
        yield from (f"{method.name} claims {law!r}, which no system has: tcbench check says more." for law in laws)


def _unsuited(methods: Sequence[Integrator], scenarios: Sequence[Scenario]) -> Iterator[str]:
    """On which scenarios methods were not run that run on others of them."""
    for method in methods:
        reasons = {scenario.name: method.suits(scenario.model) for scenario in scenarios}
        for why in dict.fromkeys(filter(None, reasons.values())) if not all(reasons.values()) else ():
            names = ", ".join(name for name, reason in reasons.items() if reason == why)
            yield f"{method.name} is not run on {names}: {why}."


def _why_not(method: Integrator, study: Study, scenarios: Sequence[Scenario]) -> str:
    """Why a method that was asked for by name has no cell in a study."""
    reasons = [method.suits(scenario.model) for scenario in scenarios]
    if method.lacks:
        why = method.lacks
    elif study.sampled and not any(plugins.is_sampled(scenario) for scenario in scenarios):
        why = "it draws its own scenarios; leave --scenario out, or name a random family, as in random[stiffness=1:10]"
    elif reasons and all(reasons):
        why = "; ".join(dict.fromkeys(reasons))
    elif method.kind == "adaptive":
        why = "a method that chooses its steps has no step size to vary"
    else:
        why = "none of these scenarios and steps fits"
    return f"{method.name} is not in the study {study.name}: {why}."


def _can_be_named(scenario: Scenario) -> bool:
    """Does a worker find the same scenario by its name?"""
    try:
        return plugins.find_scenario(scenario.name) == scenario
    except TcbenchError:
        return False


def _checked_steps(dt: Sequence[float] | None, scenarios: Sequence[Scenario]) -> list[float] | None:
    """The steps asked for; each must fit at least the longest scenario."""
    if dt is None:
        return None
    from ..simulation.run import check_memory, checked_dt

    longest = max(scenarios, key=lambda s: s.t_end)
    steps = [checked_dt(value, longest) for value in dt]
    for step in steps:
        check_memory(longest, step, longest.steps(step))
    return steps


def preview(job: Job, output: Path, limits: Mapping[str, Any], fresh: bool = False) -> tuple[Summary, float | None]:
    """What a run would do, and its seconds, None where the rows that are there do not tell; nothing is written.

    Raises TcbenchError for what the run would refuse: limits that are none, a folder that cannot be written.
    """
    check_limits(*(limits[name] for name in ("jobs", "timeout", "memory_limit")))
    could_write(output)
    store = Store.read(output) if (output / ROWS).exists() else Rows()
    rows, made_by = Rows() if fresh else store, job.context["made_by"]
    to_run, summary = plan(job.cells, rows, limits["retry_failed"], made_by, job.local, machine_name())
    cores = limits["jobs"] or usable_cores()
    return summary, Remaining(to_run, cores, store.raw()).seconds() if to_run else 0.0
