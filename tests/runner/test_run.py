"""`tcbench.run` from Python: objects of the session, variants of scenarios, plugin metrics."""

import subprocess
import sys

import numpy as np
import pytest

import tcbench
from tcbench import Integrator


def heun(z, h, system):
    k = system.vector_field(z)
    return z + h / 2 * (k + system.vector_field(z + h * k))


def test_run_takes_names_objects_and_variants(tmp_path):
    soft = tcbench.scenarios()["short_term"].replace(name="soft", stiffness=(0.05, 0.5), conductivity=10.0, t_end=3.0)
    results = tcbench.run(
        integrators=["tc_monolithic", Integrator(name="heun", order=2, step=heun)], scenarios=[soft],
        studies=["conservation"], output=tmp_path / "mine", dt=[0.1],
    )  # fmt: skip
    table = results.tables["conservation"].set_index("integrator")
    assert list(table.index) == ["heun", "tc_monolithic"] and set(table["status"]) == {"ok"}
    direct = tcbench.simulate("tc_monolithic", soft, dt=0.1)
    assert table.loc["tc_monolithic", "steps"] == direct.steps == 30
    assert table.loc["heun", "energy_error_max"] > 1e-9 > table.loc["tc_monolithic", "energy_error_max"]
    assert (tmp_path / "mine" / "tables" / "conservation.csv").exists()


@pytest.mark.usefixtures("here")
def test_every_column_of_the_conservation_table_is_there(tmp_path):
    results = tcbench.run(["tc_strang"], ["short_term"], ["conservation"], tmp_path / "x", dt=[0.3])
    columns = [
        "integrator", "scenario", "dt", "status", "blowup_time", "energy_error_max", "energy_error_final",
        "energy_round_off", "energy_drift", "entropy_increment_min", "second_law_violations",
        "angular_momentum_error_max", "lyapunov_increment_max", "residual_max", "newton_iterations_mean", "us_per_step",
    ]  # fmt: skip
    table = results.tables["conservation"]
    assert list(table.columns[: len(columns)]) == columns
    row = table.iloc[0]
    assert row["residual_max"] < 1e-12 and row["energy_error_max"] < 1e-12 and np.isnan(row["blowup_time"])
    assert row["scenario_hash"] == tcbench.scenarios()["short_term"].hash


@pytest.mark.thorough
@pytest.mark.usefixtures("here")
def test_solvers_that_choose_their_steps_are_told_apart_and_what_they_do_not_count_is_unknown(tmp_path):
    methods = ["scipy_odeint", "tc_gauss_adaptive", "tc_gauss", "verlet_heat"]
    table = tcbench.run(methods, ["short_term"], ["conservation"], tmp_path / "x", dt=[0.3]).tables["conservation"]
    assert table[table.integrator == "scipy_odeint"].tolerance.tolist() == [1e-9, 1e-6, 1e-3]
    known = table.groupby("integrator")[["us_per_step", "newton_iterations_mean"]].agg(lambda c: c.notna().all())
    assert known.us_per_step.all()
    assert known.newton_iterations_mean[lambda k: k].index.tolist() == ["tc_gauss", "tc_gauss_adaptive", "verlet_heat"]


@pytest.mark.usefixtures("here")
def test_a_registered_method_with_another_step_is_measured_as_what_it_is(tmp_path):
    """`replace(registered, step=...)` under the registered name: the object runs, not what is registered."""
    from dataclasses import replace

    for name in ("tc_gauss", "tc_gauss[k=1]"):
        method = tcbench.plugins.find_integrator(name)
        wrong = replace(method, step=lambda z, h, system: np.ones(len(z)), march=None)
        where = tmp_path / name  # one folder: the keys tell them apart
        rows = tcbench.run([wrong], ["short_term"], ["conservation"], where, dt=[0.3]).tables["conservation"]
        assert rows["energy_error_max"].item() > 1 or rows["status"].item() != "ok"
        again = tcbench.run([method], ["short_term"], ["conservation"], where, dt=[0.3]).tables["conservation"]
        assert again["energy_error_max"].item() < 1e-12 and again["status"].item() == "ok"


@pytest.mark.usefixtures("here")
def test_every_table_of_the_folder_is_what_is_read_from_it(tmp_path):
    from tcbench.runner.tables import read_tables

    methods = ["tc_monolithic"], ["tc_monolithic", "tc_staggered"]
    for names, studies in ((methods[0], ["convergence", "conservation"]), (methods[1], ["conservation"])):
        results = tcbench.run(names, ["short_term"], studies, tmp_path / "run", dt=[0.3])
        read = read_tables(results.output)
        assert list(results.every) == list(read) and all(read[n].equals(t) for n, t in results.every.items())
        loaded = tcbench.load(results.output)
        assert list(loaded.tables) == list(read) and all(loaded.tables[n].equals(t) for n, t in read.items())
        assert loaded.statuses["ok"] == loaded.summary.already_finished > 0 == loaded.summary.left
    assert "convergence" not in results.tables and "convergence" in results.every
    with pytest.raises(tcbench.TcbenchError, match="no_run_here"):
        tcbench.load(tmp_path / "no_run_here")
    with pytest.raises(tcbench.TcbenchError, match="folder"):
        tcbench.load(3)


@pytest.mark.thorough
def test_a_script_without_a_guard_is_not_run_again_by_workers(tmp_path):
    """Workers get everything by name, and know nothing of this process's main module."""
    (tmp_path / "script.py").write_text(
        "import tcbench\n"
        "open(__file__ + '.begun', 'a').write('x')\n"
        "chosen = dict(integrators=['tc_monolithic'], scenarios=['short_term'], studies=['conservation'], dt=[0.3])\n"
        "print(tcbench.run(**chosen, output='out', jobs=2).summary.run)\n"
    )
    done = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "script.py.begun").read_text() == "x" and done.stdout == "1\n"


def test_a_claim_that_no_system_has_is_told(tmp_path):
    """Misspelt, it was counted as no claim: "claims kept: none"."""
    method = Integrator(name="mine", order=1, claims={"enrgy", "angular_momentum"}, flows=lambda z0, z1, h, s: z1 - z0)
    scenario = tcbench.scenarios()["reaction"].replace(name="r", t_end=1.0)
    results = tcbench.run([method], [scenario], ["conservation"], tmp_path / "out", dt=[0.1])
    assert [note for note in results.notes if "claims" in note] == [
        "mine claims 'enrgy', which no system has: tcbench check says more."
    ]
