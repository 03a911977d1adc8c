"""The whole plugin contract. A plugin is a Python file or package that implements any of these hooks.

    from tcbench import Integrator, hookimpl

    @hookimpl
    def tcbench_integrators():
        return [Integrator(name="mine", order=2, claims={"energy"}, source="...", flows=residual)]

Register it by an entry point in group "tcbench", or put the file in a folder named with --plugins-dir.
"""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import TYPE_CHECKING, Any, TypeVar

import pluggy

if TYPE_CHECKING:
    from .chart import Chart
    from .integrator import Integrator
    from .metric import Metric
    from .study import Study
    from .systems.scenario import Scenario
    from .systems.scenario_family import ScenarioFamily

PROJECT = "tcbench"
hookspec = pluggy.HookspecMarker(PROJECT)
REPLACED = "tcbench_replaced"  # attribute of a hook: the line of the one that it took the name of
Hook = TypeVar("Hook", bound=Callable[..., Any])
_mark = pluggy.HookimplMarker(PROJECT)


def hookimpl(function: Hook) -> Hook:
    """Mark a function of a plugin as the hook with the function's name."""
    before = function.__globals__.get(function.__name__)
    if isinstance(before, FunctionType) and hasattr(before, f"{PROJECT}_impl"):
        setattr(function, REPLACED, before.__code__.co_firstlineno)
    return _mark(function)


@hookspec
def tcbench_integrators() -> list[Integrator]:  # type: ignore[empty-body]
    """The integrators of the plugin."""


@hookspec
def tcbench_scenarios() -> list[Scenario | ScenarioFamily]:  # type: ignore[empty-body]
    """The scenarios of the plugin, and families of them."""


@hookspec
def tcbench_metrics() -> list[Metric]:  # type: ignore[empty-body]
    """Further numbers for each run of the conservation study, one column each."""


@hookspec
def tcbench_studies() -> list[Study]:  # type: ignore[empty-body]
    """The studies of the plugin: what to measure for each method on each scenario, and its tables."""


@hookspec
def tcbench_charts() -> list[Chart]:  # type: ignore[empty-body]
    """The charts of the plugin, drawn from tables by `tcbench plot` and on the page."""
