"""Loads plugins, checks them, and looks integrators and scenarios up by name.

A plugin that cannot be loaded stays listed with its traceback; it never hides the others.
"""

from __future__ import annotations

import itertools
import os
import re
import traceback
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from types import UnionType
from typing import Any, TypeVar

import pluggy

from . import hookspecs
from .errors import TcbenchError, is_pattern, matching, unknown_name
from .integrator import Integrator
from .metric import Metric
from .plugin_files import RefusedError, forget_helpers, import_file, plugin_files
from .progress import waiting
from .systems.scenario import Scenario, ScenarioFamily

GROUP = "tcbench"
_VARIANT = re.compile(r"(?P<base>[^\[\]]+)\[(?P<values>[^\[\]]*)\]\Z")
Named = TypeVar("Named", Integrator, Scenario, Metric)


@dataclass(frozen=True)
class Origin:
    """Where a plugin came from: entry-point name and distribution, or file.

    Of one that was not loaded `error` is the traceback and `reason` says the same in a sentence; else they are "".
    """

    name: str
    distribution: str = ""
    version: str = ""
    path: str = ""
    error: str = ""
    reason: str = ""

    @property
    def sentence(self) -> str:
        """That it was not loaded, and why."""
        return f"{self.distribution or Path(self.path).name or self.name} was not loaded: {self.reason.rstrip('.')}."

    def __str__(self) -> str:
        return f"{self.distribution} {self.version}".strip() or self.path


@dataclass
class Registry:
    """Everything that is registered."""

    integrators: dict[str, Integrator] = field(default_factory=dict)
    scenarios: dict[str, Scenario] = field(default_factory=dict)
    scenario_families: dict[str, ScenarioFamily] = field(default_factory=dict)
    metrics: dict[str, Metric] = field(default_factory=dict)
    origins: dict[str, Origin] = field(default_factory=dict)

    @property
    def broken(self) -> list[Origin]:
        return [origin for origin in self.origins.values() if origin.error]


_REGISTRY: Registry | None = None
_FOLDERS: list[Path] = []
_LOADING: list[str] = []  # the plugin that is being imported


def registry() -> Registry:
    """The registry, loaded on first use."""
    global _REGISTRY
    if _REGISTRY is None:
        if _LOADING:
            raise RefusedError(
                f"The file {_LOADING[0]!r} asks for what is registered while it is imported as a plugin. If it is a "
                'script, put its commands under `if __name__ == "__main__":`, or give --plugins-dir the plugin\'s file.'
            )
        with waiting("loading plugins"):
            _REGISTRY = load(plugin_folders())
    return _REGISTRY


def use_folders(folders: Iterable[str | Path]) -> None:
    """Also load the plugin files in these folders (or these files); forgets what was loaded before."""
    global _REGISTRY
    for named in folders:
        if not str(named).strip():
            raise TcbenchError("The name of a plugin folder is empty; the current folder is '.'.")
        folder = Path(named)
        if not folder.exists():
            raise TcbenchError(f"The plugin folder {str(folder)!r} does not exist.")
        if folder.resolve() not in _FOLDERS:
            _FOLDERS.append(folder.resolve())
    _REGISTRY = None


def forget() -> None:
    """As in a new process: no folder is named, and what is registered is loaded when it is next asked for."""
    global _REGISTRY
    _FOLDERS.clear()
    _REGISTRY = None


def plugin_folders() -> list[Path]:
    """Folders and files named with --plugins-dir, then those in $TCBENCH_PLUGINS_DIR."""
    named = os.environ.get("TCBENCH_PLUGINS_DIR", "")
    return [*_FOLDERS, *(Path(p) for p in named.split(os.pathsep) if p)]


def integrators() -> dict[str, Integrator]:
    """Every registered integrator by name."""
    return dict(registry().integrators)


def scenarios() -> dict[str, Scenario]:
    """Every registered scenario by name."""
    return dict(registry().scenarios)


def metrics() -> dict[str, Metric]:
    """Metrics that plugins bring, by name."""
    return dict(registry().metrics)


def find_integrator(name: str | Integrator) -> Integrator:
    """The integrator of that name; `name[param=value,...]` is a member of a family."""
    if isinstance(name, Integrator):
        return name
    if not isinstance(name, str):
        raise TcbenchError(f"An integrator is a name or an Integrator, not {name!r}.")
    known = registry().integrators
    if name in known:
        return known[name]
    base, values = split_name(name)
    if base not in known:
        raise unknown_name("integrator", base, known, *_remedy())
    return known[base].variant(**values) if values else known[base]


def starter_of(method: Integrator) -> Integrator:
    """The method that does the first steps of a multistep method: of equal steps, each from one state."""
    starter, whose = find_integrator(method.starter), f"The starter of {method.name!r}"
    remedy = f'take a one-step method of order {(method.order or 1) - 1:g} or more, such as "tc_monolithic".'
    if starter.kind == "adaptive":
        raise TcbenchError(
            f"{whose}, {starter.name}, is an adaptive solver, which takes no steps of length h: {remedy}"
        )
    if starter.memory:
        raise TcbenchError(f"{whose}, {starter.name}, is a multistep method, which needs a starter itself: {remedy}")
    if (starter.order or 0) < (method.order or 0) - 1:
        raise TcbenchError(f"{whose}, {starter.name}, is only of order {starter.order:g}: {remedy}")
    return starter


def is_registered(method: Integrator) -> bool:
    """Does its name alone bring the same integrator, in another process too?"""
    try:
        return bool(method.plugin) and find_integrator(method.name) == method
    except TcbenchError:
        return False


def split_name(name: str) -> tuple[str, dict[str, str]]:
    """Base and values of `base[param=value,...]`; no values of a plain name."""
    variant = _VARIANT.match(name)
    if not variant:
        return name, {}
    pairs = [item.partition("=") for item in variant["values"].split(",") if item]
    if not all(equals for _, equals, _ in pairs):
        raise TcbenchError(f"{name!r}: parameters are written {variant['base']}[param=value].")
    names = [key.strip() for key, _, _ in pairs]
    if twice := next((key for key in names if names.count(key) > 1), None):
        raise TcbenchError(f"{name!r} gives {twice!r} twice.")
    return variant["base"], {key.strip(): value.strip() for key, _, value in pairs}


def expand_integrators(names: Iterable[str | Integrator]) -> list[Integrator]:
    """The integrators of these names; `name[param=all]` is the whole family, `tc_*` every one whose name fits."""
    result: list[Integrator] = []
    for name in names:
        if isinstance(name, str) and is_pattern(name):
            result.extend(registry().integrators[one] for one in matching("integrator", name, present(), *_remedy()))
            continue
        base, values = split_name(name) if isinstance(name, str) else ("", {})
        if "all" in values.values():
            method = find_integrator(base)
            known = {key: method.parameters.get(key, ("all",)) for key in values}
            chosen = [known[key] if value == "all" else (value,) for key, value in values.items()]
            result += [method.variant(**dict(zip(values, v, strict=True))) for v in itertools.product(*chosen)]
        else:
            result.append(find_integrator(name))
    return list({i.name: i for i in result}.values())


def present() -> list[str]:
    """Names of the registered integrators whose packages are installed."""
    return [name for name, method in registry().integrators.items() if not method.lacks]


def expand_scenarios(names: Iterable[str | Scenario]) -> list[Scenario]:
    """The scenarios of these names, each once; a pattern such as `*_term` is every registered one whose name fits."""
    result: list[Scenario] = []
    for name in names:
        if isinstance(name, str) and is_pattern(name):
            known = registry().scenarios
            result.extend(known[one] for one in matching("scenario", name, known, *_remedy()))
        else:
            result.append(find_scenario(name))
    return [scenario for k, scenario in enumerate(result) if scenario not in result[:k]]


def find_scenario(name: str | Scenario) -> Scenario:
    """The scenario of that name; `name[param=value,...]` is a member of a family."""
    if isinstance(name, Scenario):
        return name
    if not isinstance(name, str):
        raise TcbenchError(f"A scenario is a name or a Scenario, not {name!r}.")
    known, families = registry().scenarios, registry().scenario_families
    if name in known:
        return known[name]
    base, values = split_name(name)
    if base in families:
        return _member(base, tuple(sorted(values.items())))
    raise unknown_name("scenario", base, [*known, *families], *_remedy())


def find_family(name: str) -> ScenarioFamily:
    """The family of scenarios of that name."""
    families = registry().scenario_families
    if name not in families:
        raise unknown_name("family of scenarios", name, families, *_remedy())
    return families[name]


def is_sampled(scenario: Scenario) -> bool:
    """Is it a member of a family that random scenarios are drawn from?"""
    family = registry().scenario_families.get(scenario.name.partition("[")[0])
    return family is not None and family.sample is not None


@cache
def _member(family: str, values: tuple[tuple[str, str], ...]) -> Scenario:
    return registry().scenario_families[family].member(**dict(values))


def scenarios_for(method: Integrator) -> list[Scenario]:
    """Registered scenarios that a method suits; of families, the members of the defaults, if none of the others."""
    families = (find_scenario(name) for name in registry().scenario_families)
    for known in (registry().scenarios.values(), families):
        if suited := [scenario for scenario in known if not method.suits(scenario.model)]:
            return suited
    raise TcbenchError(f"No registered scenario suits {method.name!r}; bring one with tcbench_scenarios, in its file.")


def _remedy() -> tuple[str, str]:
    """What to do about a name that is not there, and what may be to blame: files that were not loaded."""
    folders = ", ".join(str(folder) for folder in plugin_folders())
    looked = f"Plugin files were looked for in {folders}." if folders else ""
    return looked or "If it is yours, pass its folder with --plugins-dir.", " ".join(not_loaded())


def not_loaded() -> list[str]:
    """A sentence on each plugin that was not loaded; `tcbench list` has the tracebacks."""
    return [origin.sentence for origin in registry().broken]


def load(folders: Iterable[Path] = ()) -> Registry:
    """A fresh registry from the entry points of group "tcbench" and from plugin files."""
    forget_helpers()
    _member.cache_clear()
    manager = pluggy.PluginManager(hookspecs.PROJECT)
    manager.add_hookspecs(hookspecs)
    result = Registry()
    described: dict[Any, tuple[str, str]] = {}  # each reading of a distribution's metadata takes a millisecond
    for point in sorted(entry_points(group=GROUP), key=lambda p: p.name):
        if point.dist not in described:
            metadata = point.dist.metadata if point.dist else {"Name": "", "Version": ""}
            described[point.dist] = metadata["Name"], metadata["Version"]
        _register(manager, result, Origin(point.name, *described[point.dist]), point.load)
    for path in plugin_files(folders):
        _register(manager, result, Origin(path.stem, path=str(path)), lambda path=path: import_file(path))
    _collect(manager, result)
    return result


def _register(manager: pluggy.PluginManager, result: Registry, origin: Origin, importer: Any) -> None:
    _LOADING.append(origin.path or origin.name)
    label = _unique(origin, result)
    try:
        module = importer()
        manager.register(module, name=label)
        manager.check_pending()
        result.origins[label] = replace(origin, path=origin.path or getattr(module, "__file__", ""))
    except BaseException as error:  # SystemExit of a plugin is that plugin's failure too
        if isinstance(error, KeyboardInterrupt):
            raise
        if isinstance(error, pluggy.PluginValidationError):
            manager.unregister(error.plugin)
        result.origins[label] = replace(origin, **_told(error, origin.path))
    finally:
        _LOADING.pop()


def _told(error: BaseException, path: str) -> dict[str, str]:
    """The traceback of the error under way, and a sentence: what is wrong, and in which line of the plugin's file."""
    if isinstance(error, RefusedError):
        return {"error": str(error), "reason": str(error)}
    where = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if path and frame.filename == path]
    reason = str(error) if isinstance(error, TcbenchError) else f"{type(error).__name__}: {error}"
    if isinstance(error, SyntaxError):
        file = Path(error.filename or path).name
        reason, where = error.msg, [error.lineno] if file == Path(path).name else []
        reason += "" if where else f" ({file}, line {error.lineno})"
    reason = f"{reason.rstrip('.')}, line {where[-1]}" if where else reason
    return {"error": traceback.format_exc(), "reason": reason}


def _unique(origin: Origin, result: Registry) -> str:
    """A label that no other plugin has: two folders may each have a mine.py, or one a file called as a built-in one."""
    path = Path(origin.path)
    labels = (origin.name, f"{path.parent.name}/{origin.name}", origin.path or f"{origin.distribution} {origin.name}")
    return next(label for label in labels if label not in result.origins or label == labels[-1])


def _collect(manager: pluggy.PluginManager, result: Registry) -> None:
    """Call the hooks of each plugin; an exception costs that plugin alone, a duplicate name is an error."""
    owner: dict[tuple[str, str], str] = {}
    offered: dict[str, Scenario | ScenarioFamily] = {}
    targets: tuple[tuple[str, type | UnionType, dict], ...] = (
        ("tcbench_integrators", Integrator, result.integrators),
        ("tcbench_scenarios", Scenario | ScenarioFamily, offered),
        ("tcbench_metrics", Metric, result.metrics),
    )
    for hook_name, kind, target in targets:
        for implementation in getattr(manager.hook, hook_name).get_hookimpls():
            label = str(implementation.plugin_name)
            _LOADING.append(label)
            try:
                items = _checked(implementation.function(), kind, hook_name)
            except BaseException as error:
                if isinstance(error, KeyboardInterrupt):
                    raise
                _break(result, label, error)
                continue
            finally:
                _LOADING.pop()
            for item in items:
                if (hook_name, item.name) in owner:
                    raise TcbenchError(
                        f"Two plugins register {hook_name[8:-1]} {item.name!r}: "
                        f"{owner[hook_name, item.name]} and {label}. Rename one of them."
                    )
                owner[hook_name, item.name] = label
                target[item.name] = replace(item, plugin=label)
        for name in sorted(target):
            target[name] = target.pop(name)
    for name, item in offered.items():
        if isinstance(item, ScenarioFamily):
            result.scenario_families[name] = item
        else:
            result.scenarios[name] = item
    for name, method in list(result.integrators.items()):
        open_ones = {k: v for k, v in method.parameters.items() if callable(v)}
        try:
            values = {k: tuple(str(x) for x in v(result.integrators)) for k, v in open_ones.items()}
            result.integrators[name] = replace(method, parameters={**method.parameters, **values})
        except Exception as error:
            _break(result, method.plugin, error)
            del result.integrators[name]


def _break(result: Registry, label: str, error: BaseException) -> None:
    """Note the error under way as that of the plugin."""
    result.origins[label] = replace(result.origins[label], **_told(error, result.origins[label].path))


def _checked(items: Any, kind: type | UnionType, hook_name: str) -> list[Any]:
    items = list(items)
    for item in items:
        if not isinstance(item, kind):
            name = getattr(kind, "__name__", "Scenario or ScenarioFamily")
            raise TypeError(f"{hook_name} must return a list of {name}, it has {item!r}")
    return items
