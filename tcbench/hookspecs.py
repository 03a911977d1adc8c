"""The whole plugin contract. A plugin is a Python file or package that implements any of these hooks.

    from tcbench import Integrator, hookimpl

    @hookimpl
    def tcbench_integrators():
        return [Integrator(name="mine", order=2, claims={"energy"}, source="...", flows=residual)]

Register it by an entry point in group "tcbench", or put the file in a folder named with --plugins-dir.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pluggy

if TYPE_CHECKING:
    from .integrator import Integrator
    from .metric import Metric
    from .systems.scenario import Scenario, ScenarioFamily

PROJECT = "tcbench"
hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


@hookspec
def tcbench_integrators() -> list[Integrator]:  # type: ignore[empty-body]
    """Integrators that the plugin brings."""


@hookspec
def tcbench_scenarios() -> list[Scenario | ScenarioFamily]:  # type: ignore[empty-body]
    """Scenarios, and families of them, that the plugin brings."""


@hookspec
def tcbench_metrics() -> list[Metric]:  # type: ignore[empty-body]
    """Further numbers to compute from each trajectory of the conservation study, one column each."""
