"""What Python callers get wrong: one sentence that names the argument, as TcbenchError."""

import os

import numpy as np
import pandas as pd
import pytest
from command import tcbench as command

import tcbench
from tcbench import Flow, Integrator, Scenario, TcbenchError
from tcbench.runner.compare import compare

HUGE = 10**400


def scenario(**changes):
    return tcbench.scenarios()["short_term"].replace(**changes)


def step(z, h, system):
    return z


WRONG = {
    "dt": lambda: tcbench.simulate("tc_monolithic", "short_term", dt=HUGE),
    "t_end": lambda: tcbench.simulate("tc_monolithic", "short_term", t_end=HUGE),
    "tolerance": lambda: tcbench.simulate("scipy_odeint", "short_term", tolerance=HUGE),
    "below the round-off of a number": lambda: tcbench.simulate("scipy_odeint", "short_term", tolerance=1e-300),
    "positions": lambda: scenario(positions=(HUGE, 0, 0, 0)),
    "momenta": lambda: scenario(momenta=(0, 0, 0, HUGE)),
    "stiffness": lambda: scenario(stiffness=(HUGE, 1)),
    "conductivity": lambda: scenario(conductivity=HUGE),
    "blowup_factor": lambda: scenario(blowup_factor=HUGE),
    "name of a scenario": lambda: scenario(name=float("nan")),
    "An Integrator: name must be a word": lambda: Integrator(name=7, order=1, step=step),
    "step must be a function or nothing": lambda: Integrator(name="a", order=1, step=0),
    "adaptive must be a function or nothing": lambda: Integrator(name="a", adaptive="solve"),
    "outputs must be a function or nothing": lambda: Integrator(name="a", adaptive=step, outputs=[]),
    "outputs= without adaptive=": lambda: Integrator(name="a", order=1, step=step, outputs=step),
    "march must be a function or nothing": lambda: Integrator(name="a", order=1, step=step, march=3),
    "Did you mean 'size'?": lambda: tcbench.run(["tc_strang"], None, ["ensemble"], options={"siez": 3}),
    "option of the chosen studies": lambda: tcbench.run(["tc_strang"], None, ["conservation"], options={"size": 3}),
    "Write .0.1..": lambda: tcbench.run(["tc_strang"], dt=0.1),
    "integrators is a list": lambda: tcbench.run(integrators="tc_gauss"),
    "scenarios is a list": lambda: tcbench.run(scenarios=""),
    "scenarios is a list of at least one": lambda: tcbench.run(scenarios=[]),
    "studies is a list": lambda: tcbench.run(studies={}),
    "cannot be the name": lambda: tcbench.run(["tc_gauss"], ["short_term"], ["conservation"], output="\ud800"),
    "A Flow: variables must be": lambda: Flow(step, variables="nope"),
    "A Flow: variables must be 'e": lambda: Flow(step, variables=np.array(["entropy", "energy"])),
    "A Flow has a finite fraction": lambda: Integrator(name="a", order=1, flows=[(step, HUGE)]),
    "stages from 0": lambda: Flow(step, stages=-1),
    "most from 1": lambda: Flow(step, most=0),
    "a finite fraction": lambda: Integrator(name="a", order=1, flows=[(step, np.nan)]),
    "A Flow: most must be a whole number": lambda: Flow(step, most="2"),
    "A Flow: residual must be a function": lambda: Flow(None),
    "variables must be": lambda: Integrator(name="a", order=1, step=step, variables={"a": "b"}),
    "requires must be": lambda: Integrator(name="a", order=1, step=step, requires=np.array(0.1)),
    "has no formula": lambda: Integrator(name="a", order=1, flows=()),
    "e.18 cannot be counted": lambda: tcbench.simulate("tc_gauss", "short_term", t_end=2**63, record_every=2**63),
    "cannot be counted": lambda: tcbench.simulate("tc_gauss", new_scenario(dt=1e-320)),
    "not 5": lambda: tcbench.draw("laws", [5]),
    "simulate returns, not 7": lambda: tcbench.draw("laws", 7),
    "no Observable": lambda: tcbench.simulate("tc_gauss", "short_term", t_end=0.5).plot([5]),
    "times must be numbers": lambda: tcbench.simulate("solve_ivp_rk45", "short_term", times=10**400),
    "t_end must be positive": lambda: tcbench.simulate("tc_gauss", "short_term", t_end=True),
    "No study is called 'None'": lambda: tcbench.run(["tc_gauss"], ["short_term"], [None]),
    "compare: run_a must be": lambda: compare(b"x", "y"),
    "family: a must be": lambda: tcbench.family(lambda a: 5, a=5),
    "of what simulate returns": lambda: tcbench.animate([5]),
    "make returns": lambda: tcbench.family(lambda: 5),
    "scenario family: ranges": lambda: tcbench.ScenarioFamily("a", sample=step, ranges=[1.0]),
    "methods are names": lambda: tcbench.draw("laws", {"series": pd.DataFrame()}, methods=pd.DataFrame()),
    "which is none": lambda: tcbench.simulate(
        Integrator(name="a", order=1, flows=lambda a, b, h, system: np.array([str(x) for x in b])), "short_term"),
    "cannot be the name of": lambda: tcbench.run(["tc_gauss"], ["short_term"], ["conservation"], output="a\0b"),
}  # fmt: skip


@pytest.mark.parametrize("named", WRONG)
def test_what_is_wrong_is_named(named, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(TcbenchError, match=named):
        WRONG[named]()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("jobs", [0, -1, float("nan"), 1.5])
def test_a_number_of_jobs_is_a_whole_number(jobs, tmp_path):
    with pytest.raises(TcbenchError, match="jobs is"):
        tcbench.run(["tc_gauss"], ["short_term"], ["conservation"], tmp_path, dt=[0.3], jobs=jobs)


MADE = {"name": "m", "order": 1, "step": step}
FIELDS = ("name", "system", "constants", "positions", "momenta", "temperatures", "t_end", "dt")
RUN = {"integrators": ["tc_gauss"], "scenarios": ["short_term"], "studies": ["conservation"], "progress": False}


def new_scenario(**changes):
    given = tcbench.scenarios()["short_term"]
    return Scenario(**{name: getattr(given, name) for name in FIELDS} | changes)


CALLS = {  # what is called with one wrong argument, and which
    "Integrator": (lambda **changes: Integrator(**MADE | changes), ("claims", "tags", "systems", "needs", "requires",
                   "uses", "parameters", "increments", "source", "description", "family", "memory", "starter")),
    "flows": (lambda **changes: Integrator(name="m", order=1, **changes), ("flows",)),
    "Scenario": (new_scenario, ("system", "constants", "positions", "ladder", "shows", "source", "plugin", "dt")),
    "run": (lambda **changes: tcbench.run(**RUN | changes), ("dt", "options", "timeout", "memory_limit",
            "on_event", "security", "progress", "fresh", "retry_failed", "dask")),
    "simulate": (lambda **changes: tcbench.simulate("tc_gauss", "short_term", t_end=0.5, **changes),
                 ("continuation", "residuals", "audit_roots", "dt", "tolerance")),
    "step": (lambda **changes: tcbench.stepper("tc_gauss", "short_term")(**{"z": np.zeros(10), "h": 0.1} | changes),
             ("z", "h")),
    "family": (lambda **changes: tcbench.family(**{"make": lambda **k: Integrator(**MADE)} | changes), ("make",)),
    "animate": (lambda **changes: tcbench.simulate("tc_gauss", "short_term", t_end=0.5).animate(**changes),
                ("path", "frames", "fps")),
    "draw": (lambda **changes: tcbench.draw(**{"kind": "laws", "data": "nowhere"} | changes), ("kind", "methods", "x",
             "y", "dt", "size", "font_size", "scenario")),
}  # fmt: skip


@pytest.mark.parametrize("call", CALLS)
def test_an_argument_of_a_wrong_type_is_one_sentence(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    function, names = CALLS[call]
    for name in names:
        for value in (5.5 + 1j, object(), [object()], {1: 2}, b"x"):
            with pytest.raises(TcbenchError) as found:
                function(**{name: value})
            assert "\n" not in str(found.value) and len(str(found.value)) < 600, (name, value)
    assert list(tmp_path.iterdir()) == []


TOML = ["1", "-1", '"x"', "true", "[]", "[1]", "[[1]]", "nan", "1979-05-27", "{a=1}", '""', '["\\u0000"]', "[{}]"]


@pytest.mark.parametrize("name", ["integrator", "dt", "output", "jobs", "fresh", "timeout", "plugins-dir", "tls-ca"])
def test_a_value_of_a_configuration_is_taken_or_refused_in_a_sentence(name, tmp_path, monkeypatch):
    from click.testing import CliRunner

    from tcbench.cli import main

    monkeypatch.chdir(tmp_path)
    for value in TOML:
        given = {"integrator": '["tc_gauss"]', "scenario": '["short_term"]', "study": '["conservation"]'} | {
            name: value
        }
        (tmp_path / "c.toml").write_text("\n".join(f"{key} = {v}" for key, v in given.items()))
        done = CliRunner().invoke(main, ["run", "--config", "c.toml", "--dry-run"])
        assert done.exit_code in (0, 2) and isinstance(done.exception, SystemExit | None), (value, done.exception)
        if (name, value) == ("dt", '"x"'):
            assert "'c.toml': Invalid value for '--dt': 'x' is not a valid float." in done.output


@pytest.mark.skipif(not os.path.exists("/dev/fd"), reason="of Unix")
def test_options_come_through_a_pipe_and_what_is_none_is_said():
    out, into = os.pipe()
    os.write(into, b"dt = 0.5\nnonsense = 1")
    os.close(into)
    found = command("run", "--config", f"/dev/fd/{out}")
    assert found.returncode == 2 and "called 'nonsense'" in found.stderr


ONE = ("run", "-i", "tc_monolithic", "-s", "short_term", "--study", "conservation", "--dt", 0.3)


@pytest.mark.parametrize(
    "words", [("--timeout", 0, "-o", "kept"), ("-o", "kept/cells.jsonl"), ("-o", "kept/cells.jsonl/x")]
)
def test_a_dry_run_refuses_what_the_run_does_and_no_row_is_set_aside_for_it(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "cells.jsonl").write_text("{}\n")
    for more in ("--dry-run", "--fresh"):
        done = command(*ONE, *words, more)
        assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
        assert [p.name for p in tmp_path.rglob("*")] == ["kept", "cells.jsonl"]
    assert (tmp_path / "kept" / "cells.jsonl").read_text() == "{}\n"


@pytest.mark.usefixtures("here")
def test_a_dry_run_into_a_folder_without_a_run_and_a_fresh_one_say_that_all_is_to_be_run(tmp_path):
    assert "1 cell: 0 finished, 1 to run" in command(*ONE, "--dry-run", "-o", tmp_path).stdout
    assert not list(tmp_path.iterdir())
    command(*ONE, "-q", "-o", tmp_path)
    assert "1 finished, 0 to run" in command(*ONE, "--dry-run", "-o", tmp_path).stdout
    assert "0 finished, 1 to run" in command(*ONE, "--dry-run", "--fresh", "-o", tmp_path).stdout
