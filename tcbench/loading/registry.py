"""Plugins into a registry: which there are, their import, what they bring; one that fails never hides the others.

In a worker nothing but tcbench's own plugins is imported until a cell asks for a name that another one brings: what a
plugin does to its process (numpy patched, output, threads, wrong numbers) ends with the processes of its own cells.
"""

from __future__ import annotations

import contextlib
import traceback
from collections import UserDict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import entry_points
from pathlib import Path
from types import FunctionType, UnionType
from typing import Any, cast

import pluggy

from .. import cache, hookspecs
from ..chart import Chart
from ..errors import ChangedError, TcbenchError, several, shown, unknown_name
from ..inputs import marks, watching
from ..inputs.undone import Restored, undone
from ..integrator import Integrator
from ..metric import Metric
from ..study import Study
from ..systems.scenario import Scenario, ScenarioFamily
from .files import RefusedError, at_home, forget_helpers, import_file, plugin_files

GROUP = "tcbench"
HOOKS = [name for name in vars(hookspecs) if name.startswith("tcbench_")]
OWN = "tcbench"  # the distribution whose plugins are tcbench's own


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
    studies: dict[str, Study] = field(default_factory=dict)
    charts: dict[str, Chart] = field(default_factory=dict)
    origins: dict[str, Origin] = field(default_factory=dict)
    members: dict[Any, Scenario] = field(default_factory=dict)  # of families of scenarios, that were asked for
    need: Callable[[str], Any] = str  # in a worker: imports a plugin by its label

    @property
    def broken(self) -> list[Origin]:
        return [origin for origin in self.origins.values() if origin.error]


KINDS = ("integrators", "scenarios", "scenario_families", "metrics", "studies", "charts")  # of a registry, by name
OFFERED: dict[str, type | UnionType] = {  # hook -> what it returns a list of
    "tcbench_integrators": Integrator, "tcbench_scenarios": Scenario | ScenarioFamily, "tcbench_metrics": Metric,
    "tcbench_studies": Study, "tcbench_charts": Chart,
}  # fmt: skip
_LOADING: list[str] = []  # the plugin that is being imported


def loading() -> str:
    """The plugin that is being imported, "" if none is."""
    return _LOADING[0] if _LOADING else ""


def load(folders: Iterable[Path] = (), apart: bool = False) -> Registry:
    """A fresh registry from the entry points of group "tcbench" and from plugin files.

    apart : each plugin finds numpy and scipy as they were, whatever another has done to them; for a process that only
        looks up what there is.
    """
    forget_helpers()
    manager, result = _manager(), Registry()
    known = Restored() if apart else None
    with undone():
        for origin, importer in _present(folders):
            _register(manager, result, origin, importer, _unique(origin, result))
            if known:
                known.keep() if origin.distribution == OWN else known.restore()
        _collect(manager, result)
        if known:
            known.restore()
    return result


def _manager() -> pluggy.PluginManager:
    manager = pluggy.PluginManager(hookspecs.PROJECT)
    manager.add_hookspecs(hookspecs)
    return manager


def _present(folders: Iterable[Path]) -> Iterator[tuple[Origin, Callable[[], Any]]]:
    """Where plugins may come from, and how each is imported."""
    described: dict[Any, tuple[str, str]] = {}  # each reading of a distribution's metadata takes a millisecond
    points = sorted(entry_points(group=GROUP), key=lambda p: p.name)
    for point in points:
        if point.dist not in described:
            metadata = point.dist.metadata if point.dist else {"Name": "", "Version": ""}
            described[point.dist] = metadata["Name"], metadata["Version"]
    for point in sorted(points, key=lambda p: described[p.dist][0] != OWN):  # whose labels are the same everywhere
        yield Origin(point.name, *described[point.dist]), point.load
    for path in plugin_files(folders):
        yield Origin(path.stem, path=str(path)), partial(import_file, path)


def are_foreign(folders: Iterable[Path]) -> bool:
    """Are there plugins that are not tcbench's own? None is imported to find out."""
    return bool(plugin_files(folders)) or any(p.dist is None or p.dist.name != OWN for p in entry_points(group=GROUP))


# -- in a worker: only what a cell needs


def index_of(found: Registry) -> dict[str, Any]:
    """By name which plugin that is not tcbench's own brings it, where those are, and the values of open parameters."""
    foreign = foreign_origins(found)

    def brought(items: Mapping[str, Any]) -> dict[str, str]:
        return {name: item.plugin for name, item in items.items() if item.plugin in foreign}

    return {
        "brings": {kind: brought(getattr(found, kind)) for kind in KINDS},
        "origins": {
            label: [origin.name, origin.distribution, origin.path, marks.file_hash(origin.path)]
            for label, origin in foreign.items()
        },
        "parameters": {
            name: {key: list(values) for key, values in method.parameters.items()}
            for name, method in found.integrators.items() if method.parameters
        },
    }  # fmt: skip


def foreign_origins(found: Registry) -> dict[str, Origin]:
    """The plugins that are not tcbench's own, by label."""
    return {label: origin for label, origin in found.origins.items() if origin.distribution != OWN}


def lazy(known: dict[str, Any]) -> Registry:
    """tcbench's own registry, in which names of an `index` have their plugin imported when they are first asked for."""
    manager, own = _manager(), Registry()
    for origin, importer in _present(()):
        if origin.distribution == OWN:
            _register(manager, own, origin, importer, _unique(origin, own))
    _collect(manager, own)
    result = Registry(origins=own.origins)
    waiting = _Waiting(known, result)
    result.need = waiting.need
    for kind in KINDS:
        setattr(result, kind, _Lazy(getattr(own, kind), known["brings"][kind], waiting))
    waiting.open_parameters()
    return result


class _Waiting:
    """The plugins of an index that have not been imported yet."""

    def __init__(self, known: dict[str, Any], result: Registry) -> None:
        self.known, self.result, self.imported = known, result, set[str]()

    def need(self, label: str) -> None:
        """Import a plugin into the registry; `ChangedError` if that is not what the run was planned with."""
        if label in self.imported:
            return
        self.imported.add(label)
        name, distribution, path, mark = self.known["origins"][label]
        watched(label, str(Path(path).parent))
        if marks.file_hash(path) != mark:
            raise ChangedError(
                f"The files of the plugin {label} are not those that the run was planned with: edited meanwhile, or "
                "others on this machine. Run again, and what they say now is measured."
            )
        if distribution:
            points = (p for p in entry_points(group=GROUP) if p.name == name and p.dist and p.dist.name == distribution)
            point = next(points)
            importer, origin = point.load, Origin(name, distribution, point.dist.version if point.dist else "")
        else:
            importer, origin = partial(import_file, Path(path)), Origin(name, path=path)
        manager, new = _manager(), Registry()
        _register(manager, new, origin, importer, label)
        _collect(manager, new)
        self.result.origins.update(new.origins)
        for kind in KINDS:
            getattr(self.result, kind).data.update(getattr(new, kind))
        self.open_parameters()
        if reason := new.origins[label].reason:
            raise ChangedError(f"The plugin {label} could be loaded when the run was planned, and cannot now: {reason}")

    def open_parameters(self) -> None:
        """Values that are found by asking all integrators are those that the run was planned with."""
        imported = cast(_Lazy, self.result.integrators).data
        for name, values in self.known["parameters"].items():
            if (method := imported.get(name)) is not None:
                parameters = {key: tuple(each) for key, each in values.items()}
                imported[name] = replace(method, parameters=parameters)


def watched(label: str, folder: str) -> None:
    """From now on what this process reads is noted; the code of this plugin lies in this folder."""
    watching.leave_out(cache.root())
    watching.begin().plugins[label] = folder


class _Lazy(UserDict[str, Any]):
    """What is registered by name; whoever walks over all of it has every plugin imported."""

    def __init__(self, own: Mapping[str, Any], brings: Mapping[str, str], waiting: _Waiting) -> None:
        super().__init__(own)
        self._brings, self._waiting = brings, waiting

    def __contains__(self, name: object) -> bool:
        if name not in self.data and name in self._brings:
            self._waiting.need(self._brings[str(name)])
        return name in self.data

    def __getitem__(self, name: str) -> Any:
        return self.data[name] if name in self else super().__getitem__(name)

    def __iter__(self) -> Iterator[str]:
        for label in sorted(set(self._brings.values())):
            self._waiting.need(label)
        return iter(self.data)

    def __len__(self) -> int:
        return sum(1 for _ in self)  # a list of it would ask for its length first


# -- one plugin after the other


def _register(
    manager: pluggy.PluginManager, result: Registry, origin: Origin, importer: Callable[[], Any], label: str
) -> None:
    _LOADING.append(origin.path or origin.name)
    try:
        module = importer()
        _check_hooks(module)
        manager.register(module, name=label)
        manager.check_pending()
        result.origins[label] = replace(origin, path=origin.path or getattr(module, "__file__", ""))
    except BaseException as error:  # SystemExit of a plugin is that plugin's failure too
        if isinstance(error, KeyboardInterrupt):
            raise
        if isinstance(error, pluggy.PluginValidationError) and manager.is_registered(error.plugin):
            manager.unregister(error.plugin)  # pluggy below 1.7 has registered it
        result.origins[label] = replace(origin, **_told(error, origin.path))
    finally:
        _LOADING.pop()


def _check_hooks(module: Any) -> None:
    """Refuse hooks that would be missing without a word: twice under one name, of an unknown name, not marked."""
    for name, hook in vars(module).items():
        if not isinstance(hook, FunctionType) or hook.__module__ != module.__name__:
            continue
        line, marked = hook.__code__.co_firstlineno, hasattr(hook, f"{hookspecs.PROJECT}_impl")
        if before := getattr(hook, hookspecs.REPLACED, 0):
            raise RefusedError(
                f"{name} is defined in line {before} and again in line {line}, and Python keeps "
                "the last one only. Return everything from one function."
            )
        if marked and name not in HOOKS:
            raise RefusedError(f"{unknown_name('hook', name, HOOKS)} It is in line {line}.")
        if name in HOOKS and not marked:
            raise RefusedError(f"{name} in line {line} is no hook; write @hookimpl above it.")
        if marked and hook.__code__.co_argcount > len(hook.__defaults__ or ()):
            raise RefusedError(f"{name} in line {line} is called without arguments; write def {name}():")


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
    reason = f"{reason.rstrip('.')}, line {where[-1]}" if any(where) else reason
    return {"error": traceback.format_exc(), "reason": reason}


def _unique(origin: Origin, result: Registry) -> str:
    """A label that no other plugin has: two folders may each have a mine.py, or one a file called as a built-in one."""
    folder = Path(origin.path).parent.name or origin.distribution
    labels = (origin.name, f"{folder}/{origin.name}", origin.path or f"{origin.distribution} {origin.name}")
    return next(label for label in labels if label not in result.origins or label == labels[-1])


def _collect(manager: pluggy.PluginManager, result: Registry) -> None:
    """Call the hooks of each plugin; an exception costs that plugin alone, a duplicate name is an error."""
    owner: dict[tuple[str, str], str] = {}
    for hook_name, kind in OFFERED.items():
        for implementation in getattr(manager.hook, hook_name).get_hookimpls():
            label = str(implementation.plugin_name)
            _LOADING.append(label)
            path = result.origins[label].path
            try:
                with at_home(Path(path)) if path else contextlib.nullcontext():
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
                    kind_of = hook_name[8:-1].replace("studie", "study")
                    first, what = owner[hook_name, item.name], f"{kind_of} {item.name!r}"
                    twice = f"{label} registers {what} twice"
                    both = twice if first == label else f"Two plugins register {what}: {first} and {label}"
                    raise TcbenchError(f"{both}. Rename one of them.")
                owner[hook_name, item.name] = label
                of_kind = "scenario_families" if isinstance(item, ScenarioFamily) else hook_name[8:]
                getattr(result, of_kind)[item.name] = replace(item, plugin=label)
    for of_kind in KINDS:
        setattr(result, of_kind, dict(sorted(getattr(result, of_kind).items())))
    for name, method in list(result.integrators.items()):
        open_ones = {k: v for k, v in method.parameters.items() if callable(v)}
        if not open_ones:
            continue
        try:
            values = {k: tuple(str(x) for x in v(result.integrators)) for k, v in open_ones.items()}
            result.integrators[name] = replace(method, parameters={**method.parameters, **values})
        except Exception as error:
            _break(result, method.plugin, error)
            del result.integrators[name]


def _break(result: Registry, label: str, error: BaseException) -> None:
    """Note the error under way as that of the plugin."""
    result.origins[label] = replace(result.origins[label], **_told(error, result.origins[label].path))


def _checked(offered: Any, kind: type | UnionType, hook_name: str) -> list[Any]:
    told = f"{hook_name} must return a list of {getattr(kind, '__name__', 'Scenario or ScenarioFamily')}"
    if not several(offered):
        raise TcbenchError(f"{told}, not {shown(offered)}.")
    items = list(offered)
    for item in items:
        if not isinstance(item, kind):
            raise TcbenchError(f"{told}, it has {shown(item)}.")
    return items
