"""Shared by all tests: slow tests on request, and random admissible states of the pendulum."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st

settings.register_profile("tcbench", deadline=None, max_examples=60, derandomize=True)
settings.load_profile("tcbench")


def pytest_addoption(parser):
    parser.addoption("--run-slow", action="store_true", help="also run the tests that take minutes")


def pytest_collection_modifyitems(config, items):
    if not config.getoption("--run-slow"):
        slow = pytest.mark.skip(reason="takes minutes: --run-slow")
        for item in items:
            if "slow" in item.keywords:
                item.add_marker(slow)


@pytest.fixture
def forgotten_kernels(monkeypatch):
    """For tests that break a formula on purpose: what is compiled meanwhile is forgotten, and so is what was before."""
    from tcbench import simulation, system

    monkeypatch.setattr(system, "_KERNELS", {})
    simulation.compiled_flows.cache_clear()
    yield
    simulation.compiled_flows.cache_clear()


def _polar(radius, angle):
    return np.array([radius * np.cos(angle), radius * np.sin(angle)])


@st.composite
def admissible_states(draw):
    """(q, p, theta) of the pendulum: springs of length 0.3 to 5, |p| up to 3 a component, 150 to 600 in temperature."""
    length, angle = st.floats(0.3, 5.0), st.floats(0.0, 2 * np.pi)
    q1 = _polar(draw(length), draw(angle))
    q2 = q1 + _polar(draw(length), draw(angle))
    p = draw(st.lists(st.floats(-3.0, 3.0), min_size=4, max_size=4))
    theta = draw(st.lists(st.floats(150.0, 600.0), min_size=2, max_size=2))
    return np.concatenate([q1, q2, p, theta])
