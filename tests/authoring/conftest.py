"""Lines of `tcbench check` are tried on four scenarios; on all of them in the second tier."""

import pytest

from tcbench import plugins

FEW = ("short_term", "bound_equilibrium", "gas_containers", "rigid_body")


@pytest.fixture(autouse=True)
def few_scenarios(request, monkeypatch):
    every = plugins.scenarios_for
    if not any(map(request.node.get_closest_marker, ("thorough", "slow"))):
        monkeypatch.setattr(plugins, "scenarios_for", lambda method: [s for s in every(method) if s.name in FEW])
