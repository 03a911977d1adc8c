"""Waits are announced where someone is looking: a terminal, Jupyter, and in a pipe if that was asked for."""

import contextlib
import os
import pty
import re
import subprocess
import sys
import time
import types

import numpy as np
import pytest

import tcbench
from tcbench import Integrator, progress
from tcbench.runner import eta
from tcbench.runner.cell import Cell
from tcbench.runner.eta import Remaining
from tcbench.runner.ledger import Event
from tcbench.simulation import run


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    monkeypatch.setattr(progress, "AFTER_S", 0.05)
    monkeypatch.setattr(progress._Pipe, "every", 0.05)
    monkeypatch.setattr(progress, "default", None)
    DRAWN.clear()
    for face in (progress._Pipe, progress._Jupyter):
        monkeypatch.setattr(face, "draw", lambda self, meter, draw=face.draw: (draw(self, meter), DRAWN.append(1)))


DRAWN = []


def until_drawn(times):
    """However busy the machine is."""
    end = len(DRAWN) + times
    while len(DRAWN) < end:
        time.sleep(0.01)


def wait(show=None, times=0, **settings):
    with progress.waiting("digging", show) as meter:
        for name, value in settings.items():
            setattr(meter, name, value)
        until_drawn(times)
        time.sleep(0.0 if times else 0.2)  # nothing is drawn: in that time nothing was


def test_in_a_pipe_a_line_now_and_then_if_asked_for_and_nothing_otherwise(capsys):
    wait()
    wait(False)
    assert capsys.readouterr() == ("", "")
    wait(True, 3, done=3, total=12)
    out, err = capsys.readouterr()
    assert out == "" and len(err.splitlines()) >= 3
    assert all(line.startswith("digging, 3 of 12, ") and " left" in line for line in err.splitlines())


def test_a_short_wait_says_nothing_and_one_within_another_is_part_of_it(capsys, monkeypatch):
    with progress.waiting("outer", True), progress.waiting("inner", True):
        until_drawn(2)
    assert "outer" in (err := capsys.readouterr().err) and "inner" not in err
    monkeypatch.setattr(progress, "AFTER_S", 1e5)
    wait(True)  # and its thread ends with it, not after these seconds
    assert capsys.readouterr().err == ""


def own_rows(system, z0, t, rtol, atol):
    for _ in t:
        LINES.append(progress._open.line())
        yield z0


def own_states(system, z0, t, rtol, atol):
    return np.array(list(own_rows(system, z0, t, rtol, atol)))


def own_step(z0, h, system):
    LINES.append(progress._open.line() if progress._open else "")
    return z0


def compiled(*rest):
    LINES.append(progress._open.line() if progress._open else "")
    return OWN.march(*rest)


LINES, OWN = [], run.LOOPS
LOOPS = types.SimpleNamespace(begin=OWN.begin, march=compiled)
CHOSEN = "at tolerance 1e-06, in steps that it chooses"


@pytest.mark.parametrize(
    ("method", "told"),
    [(Integrator("mine", order=1, step=own_step), "3000 steps of 0.001, 2999 of 3000"),
     ("tc_monolithic", "3000 steps of 0.001, 2900 of 3000"),
     (Integrator("mine", order=1, adaptive=own_states), f"{CHOSEN}, "),
     (Integrator("mine", order=1, adaptive=own_states, outputs=lambda *a: (own_rows(*a), {})),
      f"{CHOSEN}, 199 of 200")],
)  # fmt: skip
def test_a_run_of_any_method_says_how_far_it_is(method, told, monkeypatch):
    """A spring that collapses takes one that chooses its steps to millions of them, which nothing told from Python."""
    monkeypatch.setattr(progress, "default", True)
    monkeypatch.setattr(run, "LOOPS", LOOPS)
    monkeypatch.setattr(run, "CHUNK", 100)
    LINES.clear()
    tcbench.simulate(method, "short_term", 1e-3, 3.0)
    assert LINES[-1].startswith(told)


def test_jupyter_gets_a_bar_that_is_updated(monkeypatch):
    shown = []
    handle = types.SimpleNamespace(update=lambda data, raw: shown.append(data))
    display = types.SimpleNamespace(display=lambda data, raw, display_id: shown.append(data) or handle)
    shell = types.SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", types.SimpleNamespace(get_ipython=lambda: shell, display=display))
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    monkeypatch.setattr(progress._Jupyter, "every", 0.05)
    wait(None, 3, done=1, total=4)
    assert len(shown) >= 3 and '<progress value="1" max="4">' in shown[-1]["text/html"]
    assert shown[0]["text/plain"].startswith("digging")
    shown.clear()
    wait(False)
    assert shown == []


def cell(name="mine"):
    return Cell("conservation", name, "short_term")


def test_alarming_failures_are_printed_as_they_come_the_first_five(capsys):
    def events(show):
        with progress.of_cells(show) as tell:
            for k in range(8):
                tell(Event("failed", cell(), {"status": "crash", "failure": f"dead {k}"}, k, k, 9, 1))
            tell(Event("failed", cell(), {"status": "blowup", "failure": "a result"}, 9, 9, 9, 0))

    events(True)
    err = capsys.readouterr().err
    assert "mine on short_term: dead 4" in err and "dead 5" not in err and "and 3 more" in err and "result" not in err
    events(None)
    assert capsys.readouterr().err == ""


def test_run_from_python_is_silent_in_a_pipe_and_speaks_when_asked(tmp_path, capsys):
    method = Integrator("mine", order=1, step=lambda z, h, system: time.sleep(0.005) or z)
    chosen = {"integrators": [method], "scenarios": ["short_term"], "studies": ["conservation"], "dt": [0.6]}
    tcbench.run(**chosen, output=tmp_path / "a")
    assert capsys.readouterr() == ("", "")
    seen = []
    tcbench.run(**chosen, output=tmp_path / "b", progress=True, on_event=seen.append)
    assert "so far" in capsys.readouterr().err and [event.kind for event in seen] == ["started", "finished"]


@pytest.mark.skipif(os.name == "nt", reason="no pseudo-terminals")
def test_on_a_terminal_there_is_a_bar_from_python():
    script = (
        "import time\nfrom tcbench import progress\nprogress.AFTER_S = 0.05\n"
        "with progress.waiting('digging'):\n    time.sleep(0.5)\n"
    )
    parent, child = pty.openpty()
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "100"}
    with subprocess.Popen(
        [sys.executable, "-c", script], stderr=child, stdout=subprocess.PIPE, env=environment
    ) as process:
        os.close(child)
        text = ""
        with contextlib.suppress(OSError):  # how the end of a pseudo-terminal reads on Linux
            while part := os.read(parent, 4096):
                text += part.decode(errors="replace")
        os.close(parent)
        assert process.stdout.read() == b""
    assert process.returncode == 0 and re.search(r"digging, \d s so far", text)


def of(study, name, number, timed=False):
    return Cell(study, name, "short_term", {"k": number}, timed)


@pytest.fixture
def standing_clock(monkeypatch):
    monkeypatch.setattr(eta, "time", types.SimpleNamespace(monotonic=lambda: 1000.0))


def test_the_time_left_is_weighed_by_study_and_method_and_silent_about_the_unknown(standing_clock):
    fast = [of("conservation", "quick", k) for k in range(4)]
    slow = [of("work_precision", name, 0, timed=True) for name in ("quick", "slow")]
    left = Remaining([*fast, *slow], jobs=2)
    assert left.seconds() is None
    for cell in fast:
        left.finished(cell, {"cell_time_s": 1.0})
    assert left.seconds() is None  # no cell of the study that is left has ended: 4 of 6 cells say nothing of it
    left.finished(slow[0], {"cell_time_s": 30.0})
    assert left.seconds() is None  # of that study, but of another method
    lines = [{"cell": of("work_precision", "slow", 7).as_dict(), "row": {"cell_time_s": 200.0}}]
    left = Remaining([*fast[:2], *slow[1:]], 2, [*lines, {"cell": fast[3].as_dict(), "row": {"cell_time_s": 1.0}}])
    assert left.seconds() == 201.0  # timed ones alone, the others on two workers
    left._at -= 300.0
    assert left.seconds() is None  # what was told is over


def test_the_line_of_a_run_has_the_time_left_when_there_is_ground(capsys, standing_clock):
    cells = [of("conservation", "quick", k) for k in range(40)]
    with progress.of_cells(True, Remaining(cells, 1)) as tell:
        tell(Event("started", cells[0], None, 0, 0, 40, 1))
        until_drawn(2)
        first = capsys.readouterr().err
        assert "quick is compiled for short_term, 0 of 40" in first
        tell(Event("finished", cells[0], {"status": "ok", "cell_time_s": 10.0}, 1, 0, 40, 1))
        until_drawn(2)
    assert " left" not in first and "1 of 40" in (line := capsys.readouterr().err) and "about 6 min 30 s left" in line
