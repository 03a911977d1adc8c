"""tcbench: a benchmark for thermodynamically consistent time integrators, after Romero (2009).

    import tcbench

    run = tcbench.simulate("tc_monolithic", "short_term", dt=0.3)
    run.energy, run.entropy, run.status

Names are imported when they are first used, so that `import tcbench` is instant.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .chart import Chart, Panel, Row, Series
    from .errors import TcbenchError
    from .hookspecs import hookimpl
    from .integrator import Flow, Integrator, family
    from .metric import Metric, Observable
    from .plugins import integrators, scenarios
    from .report.animation import animate
    from .report.plot import draw
    from .runner.run import Results, load, run
    from .simulation.run import simulate
    from .simulation.stepper import stepper
    from .simulation.trajectory import Trajectory
    from .study import Study
    from .systems.element_system import ElementSystem
    from .systems.pendulum import Pendulum
    from .systems.sampling import Range
    from .systems.scenario import Scenario
    from .systems.scenario_family import ScenarioFamily
    from .systems.system import System
    from .table import Column, Table

_NAMES = {
    "chart": ("Chart", "Panel", "Row", "Series"),
    "runner.run": ("Results", "load", "run"),
    "errors": ("TcbenchError",),
    "hookspecs": ("hookimpl",),
    "integrator": ("Flow", "Integrator", "family"),
    "metric": ("Metric", "Observable"),
    "plugins": ("integrators", "scenarios"),
    "report.animation": ("animate",),
    "report.plot": ("draw",),
    "simulation.run": ("simulate",),
    "simulation.stepper": ("stepper",),
    "simulation.trajectory": ("Trajectory",),
    "study": ("Study",),
    "systems.element_system": ("ElementSystem",),
    "systems.pendulum": ("Pendulum",),
    "systems.sampling": ("Range",),
    "systems.scenario": ("Scenario",),
    "systems.scenario_family": ("ScenarioFamily",),
    "systems.system": ("System",),
    "table": ("Column", "Table"),
}
_HOME = {name: module for module, names in _NAMES.items() for name in names}

__all__ = [
    "Chart", "Column", "ElementSystem", "Flow", "Integrator", "Metric", "Observable", "Panel", "Pendulum", "Range",
    "Results", "Row", "Scenario", "ScenarioFamily", "Series", "Study", "System", "Table", "TcbenchError", "Trajectory",
    "animate", "draw", "family", "hookimpl", "integrators", "load", "run", "scenarios", "simulate", "stepper",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name == "__version__":
        globals()[name] = _version()
        return globals()[name]
    if name not in _HOME:
        raise AttributeError(f"module 'tcbench' has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value


def _version() -> str:
    """The version that was installed: it comes from the tags of the repository (setuptools-scm)."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("tcbench")
    except PackageNotFoundError:  # the folder itself is on the path
        return "0+not.installed"


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
