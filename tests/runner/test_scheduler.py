"""The engine under bad plugins, kill -9 and Ctrl-C: every planned cell gets exactly one row, the right one."""

from __future__ import annotations

import itertools
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import deadlines
import pytest

from tcbench.errors import TcbenchError
from tcbench.runner.cell import Cell
from tcbench.runner.ledger import Event, plan
from tcbench.runner.rows import ROWS, Rows, Store
from tcbench.runner.scheduler import SEED, START_ATTEMPTS, run_cells
from tcbench.runner.worker import tail

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "helpers"))  # workers inherit the path and find `faults` on it

MEASURE = "faults:measure"
MEMORY = 2 * 2**30
UNREPEATABLE = ("cell_time_s", "wall_time_s", "output_tail")

# what each fault must end as, and what its row must say
EXPECTED = {
    "hang": ("timeout", {}),
    "hang_in_c": ("timeout", {}),
    "prints": ("timeout", {}),
    "segfault": ("crash", {"exit_code": -signal.SIGSEGV, "signal": "SIGSEGV"}),
    "kill": ("crash", {"exit_code": -9, "signal": "SIGKILL"}),
    "os_exit": ("crash", {"exit_code": 3, "signal": None}),
    "os_exit_zero": ("crash", {"exit_code": 0, "signal": None}),
    "system_exit": ("exception", {"exception_type": "SystemExit"}),
    "exception": ("exception", {"exception_type": "ValueError"}),
    "unprintable": ("exception", {"exception_type": "UnprintableError"}),
    "wrong_shape": ("exception", {"exception_type": "TypeError"}),
    "not_json": ("exception", {"exception_type": "TypeError"}),
    "huge_row": ("exception", {"exception_type": "ValueError"}),
    "memory": ("exception", {"exception_type": "MemoryError"}),
    "import_error": ("exception", {"exception_type": "ModuleNotFoundError"}),
    "syntax_error": ("exception", {"exception_type": "SyntaxError"}),
    "nan": ("nonfinite", {}),
    "slow_import": ("ok", {"value": 42.0}),
    "closes_stdout": ("ok", {"value": 1.0}),
    "time_bomb": ("ok", {"value": 2.0}),
}

posix = pytest.mark.skipif(os.name == "nt", reason="signals and address-space limits are POSIX")


def good_cells(count: int, sleep: float = 0.0, timed: bool = False) -> list[Cell]:
    options = {"sleep": sleep} if sleep else {}
    return [Cell("timing" if timed else "s", "good", "x", {"n": n} | options, timed=timed) for n in range(count)]


def lasting(rows: dict[str, dict]) -> dict[str, str]:
    """The rows without what differs from run to run; as text, for bit-identity and NaN."""
    return {key: repr({k: v for k, v in row.items() if k not in UNREPEATABLE}) for key, row in rows.items()}


# -- faults


@posix
def test_every_fault_costs_its_own_cell_and_nothing_else(tmp_path, monkeypatch):
    deadlines.only_for(monkeypatch, ("hang", "hang_in_c"), ("prints",))
    good = good_cells(60)
    clean = Rows()
    run_cells(good, MEASURE, {}, clean, jobs=2)
    cells = []
    for index, name in enumerate(EXPECTED):
        cells += [Cell("s", name, "x"), *good[3 * index : 3 * index + 3]]
    with Store.open(tmp_path / "run") as store:
        limits = {"timeout": deadlines.LIMIT, "memory_limit": MEMORY}
        summary = run_cells(cells, MEASURE, {"folder": str(tmp_path)}, store, jobs=2, **limits)
    written = (tmp_path / "run" / ROWS).read_text().splitlines()
    assert sorted(json.loads(line)["key"] for line in written) == sorted(cell.key for cell in cells)
    assert summary.run == len(cells) and summary.left == 0
    rows = Store.read(tmp_path / "run").rows()
    assert lasting({cell.key: rows[cell.key] for cell in good}) == lasting(clean.rows())
    for name, (status, says) in EXPECTED.items():
        row = rows[Cell("s", name, "x").key]
        assert (row["status"], {k: row.get(k) for k in says}) == (status, says), name
        assert (row["failure"] == "") == (status in ("ok", "nonfinite")), name
    tails = {name: rows[Cell("s", name, "x").key].get("output_tail", "") for name in EXPECTED}
    assert "about to read address 0" in tails["segfault"] and "in fault_segfault" in tails["segfault"]
    assert "no play" in tails["prints"]
    assert max(map(len, written)) < 20_000  # the 10 MB message was cut


def test_what_was_said_before_a_crash_and_its_innermost_frames_are_kept():
    dump = "Fatal Python error: Segmentation fault\n\n" + "".join(f'  File "a.py", line {k} in f\n' for k in range(100))
    kept = tail("chatter\n" * 5000 + "the last word\n" + dump)
    assert "the last word\nFatal Python error" in kept and "line 0 in f" in kept and len(kept) < 4100


def test_a_module_that_kills_the_worker_on_import_becomes_rows_and_no_endless_restart(tmp_path, monkeypatch):
    started = tmp_path / "started"
    (tmp_path / "deadly.py").write_text(f"import os\nopen({str(started)!r}, 'a').write('x')\nos._exit(9)\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    store = Rows()
    summary = run_cells(good_cells(50), "deadly:measure", {}, store, jobs=2)
    assert summary.statuses == {"crash": 50}
    assert "No worker could be started" in next(iter(store.rows().values()))["failure"]
    assert 1 <= len(started.read_text()) <= START_ATTEMPTS + 2  # the two slots start side by side


def test_importing_the_measuring_code_is_not_counted_as_the_cells_time(tmp_path, monkeypatch):
    (tmp_path / "slow.py").write_text("import time\ntime.sleep(1.0)\ndef measure(cell, context):\n    return {}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert run_cells(good_cells(3), "slow:measure", {}, Rows(), jobs=1, timeout=0.5).statuses == {"ok": 3}


# -- timed cells, events, plan


def test_timed_cells_run_alone_after_the_rest_in_one_worker_in_shuffled_order():
    together = [Cell("s", "i", "x", {"n": n}) for n in range(8)]
    timed = [Cell("t", "i", "x", {"n": n}, timed=True) for n in range(6)]
    store = Rows()
    run_cells([*timed, *together], "faults:pid", {}, store, jobs=2)
    rows = store.rows()
    spans = sorted((rows[cell.key]["began"], rows[cell.key]["seen"]) for cell in timed)
    assert all(end <= begin for (_, end), (begin, _) in itertools.pairwise(spans))
    assert max(rows[cell.key]["seen"] for cell in together) < spans[0][0]
    (pid,) = {rows[cell.key]["pid"] for cell in timed}
    assert pid in {rows[cell.key]["pid"] for cell in together}  # which has loaded what they need
    fresh = Rows()
    run_cells(timed[:3], "faults:pid", {"fresh": ["t"]}, fresh, jobs=2)
    assert len({row["pid"] for row in fresh.rows().values()}) == 3  # of a study that asks for it, in one each
    order = [rows[cell.key]["shuffle_order"] for cell in timed]
    assert sorted(order) == list(range(6)) and order != sorted(order)
    assert all(rows[cell.key]["timed"] and rows[cell.key]["shuffle_seed"] == SEED for cell in timed)
    assert not any(rows[cell.key]["timed"] for cell in together)


def test_events_count_up_and_resuming_runs_only_what_is_left():
    cells, store, events = good_cells(6), Rows(), list[Event]()
    bad = [Cell("s", "exception", "x"), Cell("s", "os_exit", "x")]
    run_cells([*cells, *bad, cells[0]], MEASURE, {}, store, jobs=2, on_event=events.append)
    assert [e.kind for e in events].count("started") == 8
    last = events[-1]
    assert (last.done, last.failed, last.total, last.running) == (8, 2, 8, 0)
    assert run_cells(cells, MEASURE, {}, store).already_finished == 6
    to_run, found = plan([*cells, *bad, *good_cells(9)[6:]], store)
    assert {cell.integrator for cell in to_run} == {"good", "os_exit"} and len(to_run) == found.left == 4
    assert len(plan([*cells, *bad], store, retry_failed=True)[0]) == 2


def test_disk_full_stops_the_run_with_a_sentence_and_no_worker_left():
    class Full(Rows):
        def append(self, key, *rest):
            if len(self.rows()) == 3:
                raise TcbenchError("No space is left")
            super().append(key, *rest)

    store = Full()
    with pytest.raises(TcbenchError, match="No space is left"):
        run_cells([*good_cells(20), Cell("s", "hang", "x")], MEASURE, {}, store, jobs=2)
    assert len(store.rows()) == 3
    assert children(os.getpid()) == set()


# -- interruptions

RUN = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs start with it ignored
import json, sys
from tcbench.runner.cell import Cell
from tcbench.runner.scheduler import run_cells
from tcbench.runner.rows import Store
folder, count, sleep = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
cells = [Cell("s", "good", "x", {"n": n, "sleep": sleep}) for n in range(count)]
cells += [Cell("s", name, "x") for name in sys.argv[4:]]
with Store.open(folder) as store:
    def tell(event):
        if event.kind != "started":
            print(event.cell.key, flush=True)
    print("begin", flush=True)
    summary = run_cells(cells, "faults:measure", {}, store, jobs=2, on_event=tell)
    print("interrupted" if summary.interrupted else "done", flush=True)
"""


def start_run(folder: Path, count: int, sleep: float, *faults: str) -> subprocess.Popen:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests" / "helpers")])}
    command = [sys.executable, "-c", RUN, str(folder), str(count), str(sleep), *faults]
    return subprocess.Popen(command, stdout=subprocess.PIPE, env=environment, text=True)


def children(pid: int) -> set[int]:
    """The live worker processes of a process (Linux; elsewhere none are seen)."""
    found = set()
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
            command = (path.parent / "cmdline").read_bytes()
        except OSError:
            continue
        if int(fields[1]) == pid and fields[0] != "Z" and b"runner.worker" in command:
            found.add(int(path.parent.name))
    return found


def alive(pid: int) -> bool:
    """Whether a process is there and not just waiting for its end to be noted (a zombie)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def kill_and_resume(folder: Path, count: int, sleep: float, kills: int, pause: tuple[float, float]) -> None:
    """Kill -9 the run at random moments, resume each time, and check every promise on the way."""
    chance = random.Random(7)
    acknowledged: set[str] = set()
    killed = 0
    for attempt in range(kills + 1):
        with start_run(folder, count, sleep) as run:
            assert run.stdout is not None
            if attempt < kills:
                run.stdout.readline()
                time.sleep(chance.uniform(*pause))
                workers = children(run.pid)
                run.kill()
                killed += 1
            lines = run.stdout.read().split("\n")
        acknowledged |= {line for line in lines if len(line) == 64}
        assert acknowledged <= set(Store.read(folder).rows())
        if attempt < kills:
            wait_until(lambda gone=workers: not any(map(alive, gone)))
    assert "done" in lines
    undisturbed = Rows()
    cells = [Cell("s", "good", "x", {"n": n, "sleep": sleep}) for n in range(count)]
    run_cells(cells, MEASURE, {}, undisturbed, jobs=2)
    assert killed == kills
    assert lasting(Store.read(folder).rows()) == lasting(undisturbed.rows())


def wait_until(condition, limit: float = 60.0) -> None:
    end = time.monotonic() + limit
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


@posix
def test_kill_9_at_random_moments_loses_nothing_and_leaves_no_worker(tmp_path):
    kill_and_resume(tmp_path, count=30, sleep=0.05, kills=2, pause=(0.1, 0.6))


@posix
def test_ctrl_c_stops_at_once_even_with_a_worker_that_hangs_in_c(tmp_path):
    with start_run(tmp_path, 1, 0.0, "hang_in_c", "hang") as run:
        assert run.stdout is not None
        for _ in range(2):  # "begin" and the good cell's row
            run.stdout.readline()
        time.sleep(0.3)
        workers = children(run.pid)
        run.send_signal(signal.SIGINT)
        assert run.stdout.read().endswith("interrupted\n")
        assert run.wait() == 0
    assert not any(map(alive, workers))
    assert len(Store.read(tmp_path).rows()) == 1  # whoever waits for those that hang writes the rows of their timeouts


@posix
def test_a_killed_run_takes_a_worker_that_hangs_in_c_with_it(tmp_path):
    with start_run(tmp_path, 0, 0.0, "hang_in_c") as run:
        if sys.platform != "linux":
            run.kill()
            pytest.skip("only Linux can kill a process that hangs in C code with its parent")
        wait_until(lambda: len(children(run.pid)) == 1)
        time.sleep(0.5)
        (worker,) = children(run.pid)
        run.kill()
    wait_until(lambda: not alive(worker))


@posix
@pytest.mark.parametrize("end", ["end", "deadline"])
def test_what_a_cell_has_started_ends_with_its_worker(end):
    store = Rows()
    cells = [Cell("s", "spins", "x"), *([Cell("s", "hang", "x")] if end == "deadline" else [])]
    run_cells(cells, MEASURE, {}, store, jobs=1, timeout=1.0)
    pids = store.rows()[cells[0].key]["pids"]
    wait_until(lambda: not any(map(alive, pids[: None if sys.platform == "linux" else 1])))


def test_a_run_that_is_stopped_for_a_while_gives_no_timeout(monkeypatch):
    from tcbench.runner import ledger

    asleep, clock = [0.0], time.monotonic
    monkeypatch.setattr(time, "monotonic", lambda: clock() + asleep[0])
    monkeypatch.setattr(ledger.Ledger, "start", lambda self, cell, running: asleep.__setitem__(0, 0.0))

    def later():  # a laptop's lid: the clock goes on, nothing else does
        time.sleep(0.3)
        asleep[0] = 1000.0

    store = Rows()
    threading.Thread(target=later).start()
    assert run_cells(good_cells(1, sleep=0.8), MEASURE, {}, store, jobs=1, timeout=1800.0).statuses == {"ok": 1}
