"""Looks integrators and scenarios up by name, among what plugins have brought (`loading`)."""

from __future__ import annotations

import copyreg
import itertools
import os
import re
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from .errors import ByName, TcbenchError, is_pattern, matching, unknown_name
from .integrator import Integrator
from .loading.files import RefusedError
from .loading.registry import GROUP as GROUP
from .loading.registry import Origin as Origin
from .loading.registry import Registry, foreign_origins, load, loading
from .metric import Metric
from .progress import waiting
from .systems.scenario import Scenario
from .systems.scenario_family import ScenarioFamily

_VARIANT = re.compile(r"(?P<base>[^\[\]]+)\[(?P<values>[^\[\]]*)\]\Z")


_REGISTRY: Registry | None = None
_FOLDERS: list[Path] = []
_ONLY: list[tuple[str, str, str]] | None = None  # in a worker: name, distribution and path of the plugins it needs
_LOCK = threading.RLock()  # one thread loads plugins or makes a member of a family, the others wait


def registry() -> Registry:
    """The registry, loaded on first use."""
    global _REGISTRY
    loaded = _REGISTRY
    if loaded is not None:
        return loaded
    with _LOCK:
        if loading():
            raise RefusedError(
                f"The file {loading()!r} asks for what is registered while it is loaded as a plugin. A hook makes its "
                "scenarios by Scenario(...), as tcbench new scenario NAME shows. If it is a script, put its commands "
                'under `if __name__ == "__main__":`, or name the plugin\'s file alone.'
            )
        loaded = _REGISTRY
        if loaded is None:
            with waiting("loading plugins"):
                loaded = _REGISTRY = load(plugin_folders(), _ONLY)
        return loaded


def use_only(brought_by: Iterable[Iterable[str]]) -> None:
    """In a worker: load no plugins but tcbench's own and these (name, distribution, path)."""
    global _REGISTRY, _ONLY
    _ONLY, _REGISTRY = [(name, distribution, path) for name, distribution, path in brought_by], None


def needs(*names: str) -> set[str]:
    """The plugins, not tcbench's own, that integrators and scenarios of these names come from, as far as can be told
    beforehand: those of what they wrap, start with or name as `uses`, too."""
    here, labels, seen = registry(), set[str](), set[str]()
    waiting = list(names)
    while waiting:
        name = waiting.pop()
        base, values = split_name(name) if "[" in name else (name, {})
        if name in seen:
            continue
        seen.add(name)
        items = [kind[base] for kind in (here.integrators, here.scenarios, here.scenario_families) if base in kind]
        labels |= {label for label in [base, *(item.plugin for item in items)] if label in here.origins}
        waiting += values.values()
        for method in (item for item in items if isinstance(item, Integrator)):
            starter = method.starter.name if isinstance(method.starter, Integrator) else method.starter
            waiting += [*method.uses, *filter(None, [starter])]
    return labels & set(foreign_origins(here))


def use_folders(folders: Iterable[str | Path]) -> None:
    """Also load the plugin files in these folders (or these files); forgets what was loaded before."""
    global _REGISTRY
    for named in folders:
        if not str(named).strip():
            raise TcbenchError("The name of a plugin folder is empty; the current folder is '.'.")
        folder = Path(named)
        if not folder.exists():
            raise TcbenchError(f"The plugin folder {str(folder)!r} does not exist.")
        if folder.is_file() and folder.suffix != ".py":
            raise TcbenchError(f"{str(folder)!r} is no Python file; --plugins-dir takes a folder, or a file NAME.py.")
        if folder.resolve() not in _FOLDERS:
            _FOLDERS.append(folder.resolve())
    _REGISTRY = None


def forget() -> None:
    """As in a new process: no folder is named, and what is registered is loaded when it is next asked for."""
    global _REGISTRY, _ONLY
    _FOLDERS.clear()
    _REGISTRY, _ONLY = None, None


def plugin_folders() -> list[Path]:
    """Folders and files named with --plugins-dir, then those in $TCBENCH_PLUGINS_DIR."""
    named = os.environ.get("TCBENCH_PLUGINS_DIR", "")
    return [*_FOLDERS, *(Path(p) for p in named.split(os.pathsep) if p)]


def integrators() -> dict[str, Integrator]:
    """Every registered integrator by name, built-in ones and those of plugins.

    Returns
    -------
    dict of str to Integrator
        A copy, in the order of their registration; methods whose packages are absent are in it, too
        (`Integrator.lacks`).

    Raises
    ------
    TcbenchError
        For two plugins that register one name. A plugin that cannot be loaded is left out, and `tcbench list` says why.

    References
    ----------
    docs/methods.md has the formula and the source of each.
    """
    return ByName("integrator", registry().integrators)


def scenarios() -> dict[str, Scenario]:
    """Every registered scenario by name, built-in ones and those of plugins.

    Returns
    -------
    dict of str to Scenario
        A copy, in the order of their registration; of a family (`ScenarioFamily`) the member with its default
        parameters.

    Raises
    ------
    TcbenchError
        For two plugins that register one name. A plugin that cannot be loaded is left out, and `tcbench list` says why.

    References
    ----------
    Romero (2009), section 6, for the paper's own; docs/physics.md.
    """
    return ByName("scenario", registry().scenarios)


def metrics() -> dict[str, Metric]:
    """Metrics that plugins bring, by name."""
    return dict(registry().metrics)


def find_integrator(name: str | Integrator) -> Integrator:
    """The integrator of that name; `name[param=value,...]` is a member of a family."""
    if isinstance(name, Integrator):
        return name
    if not isinstance(name, str):
        raise TcbenchError(f"An integrator is a name or an Integrator, not {name!r}.")
    methods = registry().integrators
    if name in methods:
        return methods[name]
    base, values = split_name(name)
    if base not in methods:
        raise unknown_name("integrator", base, methods, *cure())
    return methods[base].variant(**values) if values else methods[base]


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


def _reduced(method: Integrator) -> Any:
    """What is pickled: the name, where that brings the method; functions within functions have no pickle."""
    return (find_integrator, (method.name,)) if is_registered(method) else object.__reduce_ex__(method, 2)


copyreg.pickle(Integrator, _reduced)


def split_name(name: str) -> tuple[str, dict[str, str]]:
    """Base and values of `base[param=value,...]`; no values of a plain name."""
    variant = _VARIANT.match(name)
    if not variant:
        if "[" in name and "]" not in name:
            raise TcbenchError(f"{name!r}: parameters are written {name.partition('[')[0]}[param=value].")
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
            result.extend(registry().integrators[one] for one in matching("integrator", name, present(), *cure()))
            continue
        base, values = split_name(name) if isinstance(name, str) else ("", {})
        if "all" in values.values():
            method = find_integrator(base)
            allowed = {key: method.parameters.get(key, ("all",)) for key in values}
            chosen = [allowed[key] if value == "all" else (value,) for key, value in values.items()]
            result += [method.variant(**dict(zip(values, v, strict=True))) for v in itertools.product(*chosen)]
        else:
            result.append(find_integrator(name))
    return list({i.name: i for i in result}.values())


def by_default() -> list[str]:
    """Names of those that run where none is named."""
    return [name for name in present() if registry().integrators[name].by_default]


def present() -> list[str]:
    """Names of the registered integrators whose packages are installed."""
    return [name for name, method in registry().integrators.items() if not method.lacks]


def expand_scenarios(names: Iterable[str | Scenario]) -> list[Scenario]:
    """The scenarios of these names, each once; a pattern such as `*_term` is every registered one whose name fits."""
    result: list[Scenario] = []
    for name in names:
        if isinstance(name, str) and is_pattern(name):
            registered = registry().scenarios
            result.extend(registered[one] for one in matching("scenario", name, registered, *cure()))
        else:
            result.append(find_scenario(name))
    return [scenario for k, scenario in enumerate(result) if scenario not in result[:k]]


def find_scenario(name: object) -> Scenario:
    """The scenario of that name; `name[param=value,...]` is a member of a family."""
    if isinstance(name, Scenario):
        return name
    if not isinstance(name, str):
        remedy = " The system of a scenario, with its constants, is scenario.model." if isinstance(name, type) else ""
        raise TcbenchError(f"A scenario is a name or a Scenario, not {name!r}.{remedy}")
    here = registry()
    registered, families = here.scenarios, here.scenario_families
    if name in registered:
        return registered[name]
    base, values = split_name(name)
    if base in families:
        key = base, *sorted(values.items())
        if key not in here.members:
            with _LOCK:  # one thread makes it: of its system's class there must be one
                return here.members.get(key) or here.members.setdefault(key, families[base].member(**values))
        return here.members[key]
    if base in registered:
        raise TcbenchError(
            f"Scenario {base!r} takes no values in brackets; {', '.join(sorted(families))} do. Change its constants by "
            f"tcbench.scenarios()[{base!r}].replace(name=..., ...)."
        )
    raise unknown_name("scenario", base, [*registered, *families], *cure())


def find_family(name: str) -> ScenarioFamily:
    """The family of scenarios of that name."""
    families = registry().scenario_families
    if name not in families:
        raise unknown_name("family of scenarios", name, families, *cure())
    return families[name]


def is_sampled(scenario: Scenario) -> bool:
    """Is it a member of a family that random scenarios are drawn from?"""
    family = registry().scenario_families.get(scenario.name.partition("[")[0])
    return family is not None and family.sample is not None


def scenarios_for(method: Integrator) -> list[Scenario]:
    """Registered scenarios that a method suits; of families, the members of the defaults, if none of the others."""
    families = (find_scenario(name) for name in registry().scenario_families)
    for group in (registry().scenarios.values(), families):
        if suited := [scenario for scenario in group if not method.suits(scenario.model)]:
            return suited
    raise TcbenchError(f"No registered scenario suits {method.name!r}; bring one with tcbench_scenarios, in its file.")


def cure() -> tuple[str, str]:
    """What to do about a name that is not there, and what may be to blame: files that were not loaded."""
    folders = ", ".join(str(folder) for folder in plugin_folders())
    looked = f"Plugin files were looked for in {folders}." if folders else ""
    return looked or "If it is yours, pass its folder with --plugins-dir.", " ".join(not_loaded())


def not_loaded() -> list[str]:
    """A sentence on each plugin that was not loaded; `tcbench list` has the tracebacks."""
    return [origin.sentence for origin in registry().broken]
