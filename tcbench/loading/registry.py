"""Plugins into a registry: which there are, their import, what they bring; one that fails never hides the others.

A worker loads tcbench's own plugins and those that its integrator's cells need, so that what a plugin does to its
process (numpy patched, output, threads) ends with the processes of its own cells.
"""

from __future__ import annotations

import contextlib
import os
import sys
import traceback
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import entry_points
from pathlib import Path
from types import FunctionType, UnionType
from typing import Any

import pluggy

from .. import hookspecs
from ..chart import Chart
from ..errors import TcbenchError, several, shown, unknown_name
from ..integrator import Integrator
from ..metric import Metric
from ..study import Study
from ..systems.scenario import Scenario
from ..systems.scenario_family import ScenarioFamily
from .files import RefusedError, at_home, forget_helpers, import_file, plugin_files
from .guarded import guarded

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


def load(folders: Iterable[Path] = (), only: Collection[tuple[str, str, str]] | None = None) -> Registry:
    """A fresh registry from the entry points of group "tcbench" and from plugin files.

    only : name, distribution and path of the plugins that are loaded beside tcbench's own; None: all.
    """
    forget_helpers()
    manager, result = _manager(), Registry()
    with left_alone():
        for origin, importer in _present(folders):
            if only is None or origin.distribution == OWN or (origin.name, origin.distribution, origin.path) in only:
                _register(manager, result, origin, importer, _unique(origin, result))
        _collect(manager, result)
    return result


@contextlib.contextmanager
def left_alone() -> Iterator[None]:
    """Plugins' output does not stand among results, and the current folder stays."""
    folder = ""
    with contextlib.suppress(OSError):  # one that was removed
        folder = os.getcwd()
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        with contextlib.suppress(OSError):
            if folder and os.getcwd() != folder:
                os.chdir(folder)


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


def foreign_origins(registry: Registry) -> dict[str, Origin]:
    """The plugins that are not tcbench's own, by label."""
    return {label: origin for label, origin in registry.origins.items() if origin.distribution != OWN}


# -- one plugin after the other


def _register(
    manager: pluggy.PluginManager, result: Registry, origin: Origin, importer: Callable[[], Any], label: str
) -> None:
    _LOADING.append(origin.path or origin.name)
    try:
        with contextlib.nullcontext() if origin.distribution == OWN else guarded():
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
        result.origins[label] = replace(origin, **_failure(error, origin.path))
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


def _failure(error: BaseException, path: str) -> dict[str, str]:
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
                distribution = result.origins[label].distribution
                with (
                    at_home(Path(path)) if path and not distribution else contextlib.nullcontext(),
                    contextlib.nullcontext() if distribution == OWN else guarded(),
                ):
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
    result.origins[label] = replace(result.origins[label], **_failure(error, result.origins[label].path))


def _checked(offered: Any, kind: type | UnionType, hook_name: str) -> list[Any]:
    demand = f"{hook_name} must return a list of {getattr(kind, '__name__', 'Scenario or ScenarioFamily')}"
    if not several(offered):
        raise TcbenchError(f"{demand}, not {shown(offered)}.")
    items = list(offered)
    for item in items:
        if not isinstance(item, kind):
            raise TcbenchError(f"{demand}, it has {shown(item)}.")
    return items
