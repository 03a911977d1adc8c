"""Shared by all tests: slow tests on request, kernels forgotten on request."""

from __future__ import annotations

import pytest
from hypothesis import settings

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


@pytest.fixture(autouse=True)
def plugins_as_installed():
    """After each test the plugin folders that it named are forgotten."""
    yield
    from tcbench import plugin_files, plugins

    if plugins._FOLDERS:
        plugins.forget()
        plugin_files.forget_helpers()


@pytest.fixture
def forgotten_kernels(monkeypatch):
    """For tests that break a formula on purpose: what is compiled meanwhile is forgotten, and so is what was before."""
    from tcbench.solver import implicit_step
    from tcbench.systems import traced

    monkeypatch.setattr(traced, "_KERNELS", {})
    implicit_step._compiled_flows.cache_clear()
    yield
    implicit_step._compiled_flows.cache_clear()
