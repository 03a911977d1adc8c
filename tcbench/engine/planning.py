"""What a run will do, before it does it: cells of integrators x scenarios x studies."""

from __future__ import annotations

import json
from collections import UserDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import plugins
from ..errors import TcbenchError, unknown_name
from ..integrator import Integrator
from ..store.cells import Cell
from ..store.cores import usable_cores
from ..store.disk import could_write
from ..store.encoding import plain
from ..store.rows import Rows
from ..store.store import ROWS, Store
from ..studies.base import default_studies, expand_studies, find_study, refuse_doubles
from ..study import Study
from ..systems.scenario import Scenario
from .child import ask
from .declared import declared
from .fingerprint import cell_fingerprint, code_mark, forget, own_sources, scenario_mark, source_mark
from .measure import module_folder, scenario_data
from .remaining import Remaining

if TYPE_CHECKING:
    from .local import Summary


@dataclass(frozen=True, eq=False)
class Job:
    """Everything that a run will do, before it does it.

    here : by key, cells of what workers cannot look up, measured in this process; else all of it is data.
    left_out : why methods that were asked for by name are in none of a study's cells. notes : absent peers, steps that
        do not apply, plugins that were not loaded. packages : that the methods require.
    told : what methods and scenarios say of themselves (`declared`), found when it is asked for.
    """

    cells: list[Cell]
    context: dict[str, Any]
    studies: list[Study]
    here: Mapping[str, tuple[Integrator, Scenario]] = field(default_factory=dict)
    left_out: Sequence[str] = ()
    notes: Sequence[str] = ()
    packages: Sequence[str] = ()
    told: Callable[[], Mapping[str, Any]] = dict


def plan_job(
    integrators: Iterable[str | Integrator] | None = None,
    scenarios: Iterable[str | Scenario] | None = None,
    studies: Iterable[str] | None = None,
    *,
    dt: Sequence[float] | None = None,
    options: Mapping[str, Any] | None = None,
) -> Job:
    """Look everything up and plan the cells; raises TcbenchError before anything is written.

    Plugins that are not tcbench's own are imported in another process, unless this one has imported them already or
    is given objects: what they do to numpy, say, stays there.
    """
    for name, chosen_names in (("integrators", integrators), ("scenarios", scenarios), ("studies", studies)):
        _check_list(name, chosen_names)
    asked: list[Any] = [None if n is None else list(n) for n in (integrators, scenarios, studies)]
    asked += [None if dt is None else list(dt), dict(options or {})]
    forget()
    if plugins.waiting_to_be_imported() and all(isinstance(n, str) for names in asked[:3] for n in names or ()):
        found = ask("tcbench.engine.planning:planned_for_another", list(map(str, plugins.plugin_folders())), *asked)
        if found is not None:
            return _from_data(found)
    return _plan(*asked)


def planned_for_another(folders: Sequence[str], *asked: Any) -> str:
    """The job of the process that asks, as JSON; "null" where cells would have to be measured here."""
    plugins.only_look_up(folders)
    job = _plan(*asked)
    if job.here:
        return "null"
    data = {name: getattr(job, name) for name in ("context", "left_out", "notes", "packages")}
    data |= {"studies": [study.name for study in job.studies], "cells": [cell.as_dict() for cell in job.cells]}
    return json.dumps({**data, "told": job.told()}, default=plain)


def _from_data(data: Mapping[str, Any]) -> Job:
    made = {"cells": [Cell(**cell) for cell in data["cells"]], "studies": [*map(find_study, data["studies"])]}
    return Job(**{**data, **made, "told": lambda: data["told"]})


class _Options(UserDict[str, Any]):
    """The options of a run, and which of them its studies have asked for."""

    asked: set[str]

    def __getitem__(self, name: str) -> Any:
        self.asked.add(name)
        return super().__getitem__(name)

    def __contains__(self, name: object) -> bool:
        self.asked.add(str(name))
        return super().__contains__(name)

    def __init__(self, given: Mapping[str, Any]) -> None:
        self.asked = set()
        super().__init__(given)

    @contextmanager
    def asked_by(self) -> Iterator[set[str]]:
        """What is asked for within the block alone."""
        before, self.asked = self.asked, set()
        yield self.asked
        self.asked |= before

    def check(self, names: Mapping[str, Any]) -> None:
        """Refuse those that no study has asked for: a misspelt one would be left out without a word."""
        for name in names:
            if names[name] is not None and name not in self.asked:
                random = name in ("size", "seed", "budget")
                remedy = f"{name} is for random scenarios: the study ensemble, and maps of them." if random else ""
                raise unknown_name("option of the chosen studies", name, self.asked, remedy)


def _plan(
    integrators: list[Any] | None, scenarios: list[Any] | None, studies: list[str] | None, dt: list[float] | None,
    options: dict[str, Any],
) -> Job:  # fmt: skip
    registry = plugins.registry()
    refuse_doubles(registry.studies.values())
    methods = plugins.expand_integrators(plugins.by_default() if integrators is None else integrators)
    selected = [s.current() for s in plugins.expand_scenarios(registry.scenarios if scenarios is None else scenarios)]
    chosen = [find_study(name) for name in (default_studies() if studies is None else expand_studies(studies))]
    if all(map(plugins.is_sampled, selected)):
        chosen = [find_study(study.of_random or study.name) for study in chosen]
    if len({s.name for s in selected}) < len(selected):
        raise TcbenchError("Two scenarios of one run have the same name; give variants a name: replace(name=...).")
    settings = _Options({"dt": _checked_steps(dt, selected), **options})
    custom = {s.name: data for s in selected if not _can_be_named(s) and (data := scenario_data(s)) is not None}
    remote = {s.name: s.name in custom or _can_be_named(s) for s in selected}
    cells, here, seen, own_steps = [], {}, set(), list[str]()
    used: dict[str, Scenario] = {s.name: s for s in selected}
    measured: dict[str, Integrator] = {m.name: m for m in methods}
    for study in chosen:
        with settings.asked_by() as asked:
            planned = study.planned(methods, _of_study(study, selected, scenarios), settings)
        own_steps += [study.name] if dt and planned and "dt" not in asked else []
        for method, scenario, cell_options in planned:
            if method.suits(scenario.model):
                continue
            seen.add((method.name, study.name))
            used.setdefault(scenario.name, scenario)
            measured.setdefault(method.name, method)
            cell = _cell(study, method, scenario, cell_options, custom.get(scenario.name, {}).get("code", ""))
            if scenario.name not in remote:  # one that the study drew
                remote[scenario.name] = _can_be_named(scenario)
            if not remote[scenario.name] or not plugins.is_registered(method):
                here[cell.key] = method, scenario
            cells.append(cell)
    settings.check(options)
    left_out: list[str] = []
    if integrators is not None:
        left_out += [*_left_out(methods, chosen, selected, seen, studies is not None), *_unsuited(methods, selected)]
    if not cells:
        raise TcbenchError(
            " ".join(["There is nothing to run: no integrator, scenario and step fit together.", *left_out])
        )
    context = {
        "index": plugins.index(),
        "scenarios": custom,
        "needs": _needs(chosen, list(measured.values()), list(used.values()), custom),
        "anchors": _anchors(custom),
        "fresh": [study.name for study in chosen if study.fresh],
        "tcbench": own_sources(),
        "marks": {
            "code": code_mark(),
            "integrators": {name: source_mark(method) for name, method in measured.items()},
            "scenarios": {name: scenario_mark(scenario) for name, scenario in used.items()},
        },
    }
    absent = {name: m.lacks for name, m in registry.integrators.items() if m.lacks}
    notes = [*_not_run(absent if integrators is None else {}, methods, dt, own_steps), *plugins.not_loaded()]
    notes += sorted(_no_laws(methods, list(used.values())))
    packages = sorted({name for method in methods for name in method.requires})
    unique = list({c.key: c for c in cells}.values())
    return Job(unique, context, chosen, here, left_out, notes, packages, lambda: declared(methods, selected, absent))


def _check_list(name: str, values: Any) -> None:
    """None, or names and objects in a list that is not empty."""
    if values is None or (isinstance(values, Sequence) and not isinstance(values, str) and len(values)):
        return
    if isinstance(values, Iterable) and not isinstance(values, str | Sequence | Mapping):
        return  # a generator, or the values of a dict
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
        found = set(method.claims) - {"energy", "entropy"}
        for scenario in (*used, *plugins.registry().scenarios.values()):
            if not found:
                break
            found -= set(scenario.model.invariant_names)
        yield from (f"{method.name} claims {claim!r}, which no system has: tcbench check says more." for claim in found)


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


def _needs(
    chosen: Sequence[Study], methods: Sequence[Integrator], scenarios: Sequence[Scenario], custom: Mapping[str, Any]
) -> dict[str, list[str]]:
    """By integrator, scenario and study the plugins, not tcbench's own, that a worker imports for its cells."""
    found = {}
    for study in chosen:
        metrics = plugins.metrics().values() if study.metrics else ()
        found[f"study {study.name}"] = plugins.needs(study.plugin, *(metric.plugin for metric in metrics))
    found |= {method.name: plugins.needs(method.name, method.plugin) for method in methods}
    for scenario in scenarios:
        found[scenario.name] = found.get(scenario.name, set()) | plugins.needs(scenario.name, scenario.plugin)
    found |= {name: {data["label"]} for name, data in custom.items()}
    return {name: sorted(labels) for name, labels in found.items() if labels - {""}}


def _anchors(custom: Mapping[str, Any]) -> dict[str, str]:
    """By label the folders that paths of plugins' inputs are relative to."""
    found = {label: str(Path(path).parent) for label, (_, _, path, _) in plugins.index()["origins"].items() if path}
    for data in custom.values():
        if data["label"].startswith("module "):
            found[data["label"]] = module_folder(data["system"])
    return found


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


def _cell(study: Study, method: Integrator, scenario: Scenario, options: dict[str, Any], code: str) -> Cell:
    mark, machine = cell_fingerprint(study, method, scenario, options, code)
    return Cell(study.name, method.name, scenario.name, options, study.is_timed(options), mark, machine)


def preview(job: Job, output: Path, limits: Mapping[str, Any], fresh: bool = False) -> tuple[Summary, float | None]:
    """What a run would do, and its seconds, None where the rows that are there do not tell; nothing is written.

    Raises TcbenchError for what the run would refuse: limits that are none, a folder that cannot be written.
    """
    from .local import check_limits, plan

    check_limits(*(limits[name] for name in ("jobs", "timeout", "memory_limit")))
    could_write(output)
    store = Store.read(output) if (output / ROWS).exists() else Rows()
    to_run, found = plan(job.cells, Rows() if fresh else store, limits["retry_failed"], job.context, job.here)
    cores = limits["jobs"] or usable_cores()
    return found, Remaining(to_run, cores, store.lines()).seconds() if to_run else 0.0
