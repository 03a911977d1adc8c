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
    from .errors import TcbenchError
    from .hookspecs import hookimpl
    from .integrator import Flow, Integrator, family
    from .metrics import Metric
    from .plugins import integrators, scenarios
    from .runner import Results, run
    from .scenario import Scenario, ScenarioFamily
    from .simulation import simulate
    from .system import System
    from .trajectory import Trajectory

_HOME = {
    "TcbenchError": "errors",
    "hookimpl": "hookspecs",
    "Flow": "integrator",
    "Integrator": "integrator",
    "family": "integrator",
    "Metric": "metrics",
    "integrators": "plugins",
    "scenarios": "plugins",
    "Results": "runner",
    "run": "runner",
    "Scenario": "scenario",
    "ScenarioFamily": "scenario",
    "simulate": "simulation",
    "System": "system",
    "Trajectory": "trajectory",
}

__all__ = [
    "Flow", "Integrator", "Metric", "Results", "Scenario", "ScenarioFamily", "System", "TcbenchError", "Trajectory",
    "family", "hookimpl", "integrators", "run", "scenarios", "simulate",
]  # fmt: skip
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'tcbench' has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
