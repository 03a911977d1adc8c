"""Shared by all tests: their order and tiers, kernels forgotten on request."""

from __future__ import annotations

import os
import signal
import sys

import pytest
from hypothesis import settings

import tcbench.plugins  # noqa: F401 # tests look names up in it, whichever of them comes first

if (
    signal.getsignal(signal.SIGINT) is signal.SIG_IGN
):  # begun in the background of a shell: tests of interrupts would hang
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("tcbench", deadline=None, max_examples=60, derandomize=True)
settings.load_profile("tcbench")
SLOW = {"test_cli", "test_docs", "test_readme", "test_notebooks", "test_machine", "test_kernel_cache", "test_history"}
SLOW |= {"test_net", "test_array_flow", "test_ensemble", "test_shared_runs", "test_size"}
THOROUGH = {"browser", "dask"}  # fixtures whose tests are of the second tier

# half of what a process takes to start is compiling what it imports: they do it once, beside the sources
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config):
    """Workers that have nothing left take from the others: `pytest -n 2` ends on both at the same time."""
    if getattr(config.option, "numprocesses", None) and config.option.dist in ("no", "load"):
        config.option.dist = "worksteal"


def starts_processes(item):
    """Whether tests of this file start processes: they take longest, and wait, so they come first."""
    return item.path.parent.name in ("runner", "authoring") or item.path.stem in SLOW


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    items.sort(key=lambda item: (not starts_processes(item), str(item.path.parent)))
    for item in items:
        if THOROUGH & set(item.fixturenames):
            item.add_marker(pytest.mark.thorough)


@pytest.fixture(autouse=True, scope="session")
def a_share_of_the_cores():
    """Beside other workers of pytest a run begins no more processes than there are cores for it."""
    from tcbench.runner import scheduler

    beside = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    with pytest.MonkeyPatch.context() as patch:
        cores = scheduler.usable_cores()
        patch.setattr(scheduler, "usable_cores", lambda: max(1, cores // beside))
        yield


def in_this_process():
    """Cells are measured in this process: for tests of what rows say, not of the processes that measure them."""
    from here import run_cells

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tcbench.runner.run.run_cells", run_cells)
        yield


cells_here = pytest.fixture(scope="module", name="cells_here")(in_this_process)  # of all tests of a file
here = pytest.fixture(name="here")(in_this_process)  # of one


@pytest.fixture(autouse=True)
def plugins_as_installed():
    """After each test the plugin folders that it named are forgotten."""
    yield
    from tcbench import plugins
    from tcbench.loading import files

    if plugins._FOLDERS:
        plugins.forget()
        files.forget_helpers()


@pytest.fixture
def forgotten_kernels(monkeypatch):
    """For tests that break a formula on purpose: what is compiled meanwhile is forgotten, and so is what was before."""
    from tcbench.solver import implicit_step
    from tcbench.systems import traced

    monkeypatch.setattr(traced, "_KERNELS", {})
    implicit_step._compiled_flows.cache_clear()
    yield
    implicit_step._compiled_flows.cache_clear()
