"""Lines of `tcbench check` are tried on four scenarios in this process; in the second tier on all, each alone."""

import here
import pytest

from tcbench import plugins
from tcbench.authoring import check

FEW = ("short_term", "bound_equilibrium", "gas_containers", "rigid_body")


@pytest.fixture(autouse=True)
def few_scenarios(request, monkeypatch):
    every = plugins.scenarios_for
    if not any(map(request.node.get_closest_marker, ("thorough", "slow"))):
        if "crash" not in request.node.name:
            monkeypatch.setattr(check, "run_cells", here.run_cells)
        monkeypatch.setattr(plugins, "scenarios_for", lambda method: [s for s in every(method) if s.name in FEW])
