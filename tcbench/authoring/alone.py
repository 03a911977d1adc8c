"""What `tcbench check` has a process of its own do (`engine.child`): a plugin that hangs or crashes ends there."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Sequence
from typing import Any

from .. import plugins
from ..errors import TcbenchError
from ..simulation.run import simulate


def warm(folders: Sequence[str], scenario: str) -> str:
    """Load the plugins and compile what is tcbench's, so that what is left is the plugin's own."""
    plugins.use_folders(folders)
    found = plugins.find_scenario(scenario)
    with contextlib.suppress(TcbenchError):  # of a system that the built-in methods are not for
        simulate("tc_monolithic", found, t_end=found.dt)
    return "null"


def run(integrator: str, scenario: str, settings: dict[str, Any]) -> str:
    """Status and failure of one run."""
    one = simulate(integrator, plugins.find_scenario(scenario), **settings)
    return json.dumps({"status": one.status, "failure": one.failure})
