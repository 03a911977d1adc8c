"""A real Dask scheduler and two worker processes, one killed: the same table as the local engine gives."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("distributed", reason="needs the extra 'cluster'")

import deadlines

from tcbench.errors import TcbenchError
from tcbench.runner import dask as cluster
from tcbench.runner.cell import Cell
from tcbench.runner.dask import run_on_dask
from tcbench.runner.ledger import Ledger, Summary
from tcbench.runner.rows import Rows, Store
from tcbench.runner.scheduler import run_cells

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "helpers"))  # the local engine's workers find `faults` on it

MEASURE = "faults:measure"
UNREPEATABLE = ("cell_time_s", "wall_time_s", "output_tail", "worker_host_cpu")


def cells() -> list[Cell]:
    """Good and bad cells, and two timed ones."""
    found = [Cell("s", "good", "x", {"n": n, "sleep": 0.05}) for n in range(24)]
    found[5], found[11] = Cell("s", "hang", "x"), Cell("s", "segfault", "x")
    return found + [Cell("t", "good", "x", {"n": n}, timed=True) for n in range(2)]


def lasting(rows: dict[str, dict]) -> dict[str, dict]:
    return {key: {k: v for k, v in row.items() if k not in UNREPEATABLE} for key, row in rows.items()}


@pytest.fixture
def dask(tmp_path):
    """The address of a scheduler, and two worker processes of one thread each."""
    helpers = ROOT / "tests" / "helpers"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, (ROOT, helpers, helpers / "dask_site")))}
    where = tmp_path / "scheduler.json"
    log = open(tmp_path / "dask.log", "w")  # noqa: SIM115 -- closed below, after the processes

    def launch(what, *arguments):
        command = [
            sys.executable,
            "-m",
            f"distributed.cli.dask_{what}",
            "--host",
            "127.0.0.1",
            "--no-dashboard",
        ]
        return subprocess.Popen([*command, *arguments], env=environment, stderr=log, stdout=log)

    processes = [launch("scheduler", "--port", "0", "--scheduler-file", str(where))]
    try:
        end = time.monotonic() + 300
        while not where.exists():
            assert time.monotonic() < end and processes[0].poll() is None
            time.sleep(0.05)
        address = json.loads(where.read_text())["address"]
        options = [address, "--nthreads", "1", "--local-directory", str(tmp_path)]
        processes.append(launch("worker", *options))  # with a nanny, which makes the worker daemonic
        processes.append(launch("worker", *options, "--no-nanny"))  # without one, so that killing it is final
        yield address, processes
    finally:
        for process in reversed(processes):
            process.terminate()
        for process in processes:
            try:
                process.wait(2)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        log.close()


@pytest.mark.skipif(os.name == "nt", reason="the faults are POSIX ones")
def test_a_cluster_gives_the_same_table_though_a_worker_is_killed_on_the_way(dask, tmp_path, monkeypatch):
    address, processes = dask
    ended = []
    monkeypatch.setattr(cluster, "CONNECT_LIMIT_S", 300.0)  # on a busy machine
    monkeypatch.setattr(cluster, "SHARE", 6)

    def kill_one(event):
        if event.kind != "started":
            ended.append(event.cell.key)
            if len(ended) == 4:
                processes[2].kill()

    with Store.open(tmp_path / "run") as store:
        summary = run_on_dask(cells(), MEASURE, {}, store, address, on_event=kill_one, timeout=deadlines.LIMIT)
        assert (summary.run, summary.left) == (26, 0)
        assert len(ended) == len(set(ended)) == 26
        assert run_on_dask(cells()[:5], MEASURE, {}, store, address).already_finished == 5
    local = Rows()
    deadlines.only_for(monkeypatch)
    run_cells(cells(), MEASURE, {}, local, jobs=2, timeout=deadlines.LIMIT)
    stored = Store.read(tmp_path / "run")
    assert lasting(stored.rows()) == lasting(local.rows())
    assert {line["provenance"] for line in stored.raw()} <= set(stored.provenances())
    assert all(row["worker_host_cpu"] for row in stored.rows().values())


def test_without_dask_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(TcbenchError, match=r"pip install 'tcbench\[cluster\]'"):
        run_on_dask(cells(), MEASURE, {}, Rows(), "tcp://127.0.0.1:9")


def test_a_share_that_keeps_being_lost_ends_as_rows_of_its_own_cells():
    class Lost:
        status = "error"

        def exception(self):
            return RuntimeError("KilledWorker")

    class Client:
        status = "running"

    store, summary, lost, sent = Rows(), Summary(), {}, 0
    ledger = Ledger(store, summary, None, 5)
    timed = [cell for cell in cells() if cell.timed]
    waiting = [cells()[:3], timed]
    while waiting:
        sent += 1
        waiting += cluster._receive(Client(), Lost(), waiting.pop(), ledger, lost, 0)
    assert summary.statuses == {"crash": 5} and sent < 30
    assert all("was lost 3 times" in row["failure"] for row in store.rows().values())


@pytest.mark.thorough
@pytest.mark.skipif(os.name == "nt", reason="signals are POSIX")
def test_a_scheduler_that_dies_is_one_sentence_and_the_rows_are_kept(dask, tmp_path):
    address, processes = dask
    ended = []

    def kill(event):
        if event.kind != "started":
            ended.append(event.cell.key)
            processes[0].kill()

    chosen = [cell for cell in cells() if cell.integrator == "good"]
    with Store.open(tmp_path / "run") as store, pytest.raises(TcbenchError, match="connection to the Dask scheduler"):
        run_on_dask(chosen, MEASURE, {}, store, address, on_event=kill)
    assert ended and set(ended) == set(Store.read(tmp_path / "run").rows())


@pytest.mark.thorough
def test_run_sends_its_cells_to_the_scheduler_and_gets_the_same_numbers(dask, tmp_path):
    import tcbench

    chosen = {"integrators": ["tc_monolithic"], "scenarios": ["short_term"], "studies": ["conservation"]}
    address, _ = dask
    there = tcbench.run(**chosen, dt=[0.3, 0.6], output=tmp_path / "there", dask=address, jobs=1).tables["conservation"]
    here = tcbench.run(**chosen, dt=[0.3, 0.6], output=tmp_path / "here").tables["conservation"]
    columns = ["integrator", "dt", "status", "energy_error_max", "angular_momentum_error_max", "newton_iterations_mean"]
    assert there[columns].equals(here[columns])
