"""Registration: entry points, files, broken plugins, duplicates, families."""

import math
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import tcbench
from tcbench import TcbenchError, plugins
from tcbench.cli import main
from tcbench.report.by_method import remarks

pytestmark = pytest.mark.usefixtures("cells_here")

ROOT = Path(__file__).parent.parent
GOOD = """
from tcbench import Integrator, hookimpl

def mine(z0, z1, h, system):
    return z1 - z0 - h * system.vector_field((z0 + z1) / 2)

@hookimpl
def tcbench_integrators():
    return [Integrator(name="mine", order=2, claims={"angular_momentum"}, flows=mine)]
"""


def test_every_plugin_file_has_its_entry_point():
    points = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]["tcbench"]
    files = {p.stem for p in (ROOT / "plugins").glob("*.py") if p.stem != "__init__"}
    files |= {p.parent.name for p in (ROOT / "plugins").glob("*/__init__.py")}
    assert {target.removeprefix("tcbench_plugins.") for target in points.values()} == files


def test_a_plugin_file_is_found_and_runs(tmp_path):
    (tmp_path / "mine.py").write_text(GOOD)
    plugins.use_folders([tmp_path])
    assert "mine" in tcbench.integrators()
    mine, builtin = tcbench.simulate("mine", "short_term"), tcbench.simulate("midpoint_entropy", "short_term")
    assert (mine.z == builtin.z).all()


BROKEN = {
    "syntax.py": ("x = (1,\n", "'(' was never closed, line 1."),
    "null.py": ("\0", "source code string cannot contain null bytes."),
    "importing.py": ("\nimport no_such_module_here\n", "No module named 'no_such_module_here', line 2."),
    "raising.py": ("raise RuntimeError('at import')\n", "at import"),
    "misspelt.py": (GOOD.replace("tcbench_integrators", "tcbench_integrator"), "mean 'tcbench_integrators'?"),
    "asking.py": (GOOD.replace("return", "import tcbench; tcbench.scenarios(); return", 2), "A hook makes its"),
    "unmarked.py": (GOOD.replace("@hookimpl", ""), "write @hookimpl above it"),
    "one.py": (GOOD.replace("return [", "return ").replace(")]", ")"), "must return a list of Integrator, not"),
    "listless.py": (GOOD.replace("return [", "return 7 #"), "must return a list of Integrator, not 7"),
    "wrong_type.py": (GOOD.replace("return [Integrator", "return [dict"), "must return a list of Integrator"),
    "nameless.py": (GOOD.replace('name="mine"', 'name="Mine!"'), "must be lower-case"),
    "twice.py": (GOOD + GOOD[GOOD.index("@hookimpl") :], "line 7 and again in line 10"),
    "method.py": (GOOD.replace("integrators()", "integrators(self)"), "line 7 is called without arguments; write def"),
    "orderless.py": (GOOD.replace("order=2, ", ""), "must declare its order"),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_plugin_stays_listed_with_a_sentence_and_costs_no_other(tmp_path, name):
    source, message = BROKEN[name]
    (tmp_path / name).write_text(source)
    (tmp_path / "good.py").write_text(GOOD)
    plugins.use_folders([tmp_path])
    broken = {origin.name: origin.error for origin in plugins.registry().broken}
    assert list(broken) == [name.removesuffix(".py")]
    assert {"mine", "tc_monolithic"} <= set(tcbench.integrators())
    with pytest.raises(TcbenchError, match=rf"'nobody'\. {name} was not loaded: .*Known: .*") as raised:
        plugins.find_integrator("nobody")
    assert "--plugins-dir" not in str(raised.value) and str(tmp_path) in str(raised.value)
    plugins.forget()
    done = CliRunner().invoke(main, ["list", "--plugins-dir", str(tmp_path)])  # also where nothing of it is asked for
    assert done.exit_code == 0 and message in done.stderr.splitlines()[-1], done.stderr


def test_a_script_in_the_folder_is_refused_with_a_sentence_and_spoils_nothing(tmp_path):
    """It asks for the registry that is just being made: once a recursion that ended in half-imported packages."""
    (tmp_path / "script.py").write_text("import tcbench\ntcbench.simulate('tc_monolithic', 'short_term')\n")
    (tmp_path / "good.py").write_text(GOOD)
    plugins.use_folders([tmp_path])
    (broken,) = plugins.registry().broken
    assert broken.name == "script" and "__main__" in broken.error and "Traceback" not in broken.error
    assert "mine" in tcbench.integrators()


def test_packages_of_an_environment_in_the_plugin_folder_are_not_helpers_beside_the_plugin(tmp_path, monkeypatch):
    packages = tmp_path / ".venv" / "site-packages"
    packages.mkdir(parents=True)
    (packages / "installed_here.py").write_text("")
    (tmp_path / "beside.py").write_text("")
    (tmp_path / "mine.py").write_text("import installed_here, beside\n" + GOOD)
    monkeypatch.syspath_prepend(packages)
    plugins.use_folders([tmp_path / "mine.py"])
    assert not plugins.registry().broken
    plugins.load()
    assert "installed_here" in sys.modules and "beside" not in sys.modules


def test_two_plugins_with_one_name_are_refused_with_both_named(tmp_path):
    (tmp_path / "first.py").write_text(GOOD)
    (tmp_path / "second.py").write_text(GOOD)
    plugins.use_folders([tmp_path])
    with pytest.raises(TcbenchError, match=r"integrator 'mine': first and second"):
        tcbench.integrators()


def test_the_environment_variable_names_folders(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text(GOOD)
    monkeypatch.setenv("TCBENCH_PLUGINS_DIR", str(tmp_path))
    plugins.forget()
    assert "mine" in tcbench.integrators()
    monkeypatch.undo()
    plugins.forget()


def test_families_expand():
    names = [i.name for i in plugins.expand_integrators(["midpoint_temperature[reading=all]"])]
    assert names == [
        "midpoint_temperature", "midpoint_temperature[reading=rate]", "midpoint_temperature[reading=a5_literal]",
    ]  # fmt: skip
    assert plugins.find_integrator("midpoint_temperature[reading=balance]").name == "midpoint_temperature"
    assert plugins.find_integrator("midpoint_temperature[reading=a5_literal]").order == 1


SCENARIO_AND_METRIC = """
import tcbench
from tcbench import Metric, hookimpl
from tcbench.plugins import load

@hookimpl
def tcbench_scenarios():
    return [load().scenarios["short_term"].replace(name="shorter", t_end=3.0)]

@hookimpl
def tcbench_metrics():
    return [Metric(name="hottest", compute=lambda run: float(run.temperatures.max()))]
"""


def test_scenarios_and_metrics_of_a_file_are_registered_and_used(tmp_path):
    (tmp_path / "scenario.py").write_text(SCENARIO_AND_METRIC)
    plugins.use_folders([tmp_path])
    assert tcbench.scenarios()["shorter"].t_end == 3.0 and tcbench.scenarios()["shorter"].plugin == "scenario"
    results = tcbench.run(["tc_monolithic"], ["shorter"], ["conservation"], output=tmp_path / "out", dt=[0.3])
    assert list(results.tables["conservation"]["hottest"]) == [pytest.approx(380.0)]


METRICS = """
from tcbench import Metric, hookimpl

@hookimpl
def tcbench_metrics():
    return [
        Metric("broken", lambda run: run.temprature.max()),
        Metric("energy_error_max", lambda run: 0.0),
        Metric("series", lambda run: 0.0),
        Metric("many", lambda run: run.energy),
        Metric("words", lambda run: "1"),
        Metric("spoils", lambda run: run.z.fill(7.0) or 0.0),
        Metric("steps_squared", lambda run: len(run.energy) ** 2),
    ]
"""


def test_a_metric_that_gives_no_number_costs_its_own_column(tmp_path):
    """It cost the rows of every method."""
    (tmp_path / "mine.py").write_text(METRICS)
    plugins.use_folders([tmp_path])
    results = tcbench.run(["tc_monolithic"], ["short_term"], ["conservation"], output=tmp_path / "out", dt=[0.6])
    (row,) = results.tables["conservation"].to_dict("records")
    assert row["status"] == "ok" and 0 < row["energy_error_max"] < 1e-9 and row["steps_squared"] == 43**2
    assert all(math.isnan(row[name]) for name in ("broken", "many", "words", "spoils"))
    assert "Metric 'spoils' of mine: ValueError: " in row["metric_failure"]  # what others, and the course, are made of
    said = " ".join(remarks(results.tables))
    chosen = ["run", "-i", "tc_monolithic", "-s", "short_term", "--study", "conservation", "--dt", "0.6"]
    shown = CliRunner().invoke(main, [*chosen, "--plugins-dir", str(tmp_path), "-o", str(tmp_path / "out")]).stdout
    assert "Metric 'many' of mine: TypeError: it gives an array of shape (43,), not a number" in shown
    assert "Metric 'broken' of mine: 'Trajectory' has no 'temprature'" in said and "at mine.py:7" in said
    assert "(1 of 1 runs)" in said
    assert all(
        f"Metric '{n}' of mine: the table has a column of this name" in said for n in ("energy_error_max", "series")
    )


FAMILIES = """
from tcbench import Integrator, ScenarioFamily, family, hookimpl
from tcbench.plugins import find_scenario

SCALE = {scale}


def step(z, h, system):
    return z + SCALE * h * system.vector_field(z)


def scenario_of(n):
    return find_scenario("short_term").replace(conductivity=SCALE * float(n))


@hookimpl
def tcbench_scenarios():
    return [ScenarioFamily("scaled", scenario_of, {{"n": "1"}})]


@hookimpl
def tcbench_integrators():
    def make(order="1"):
        return Integrator(name="mine", order=int(order), step=step, source="a test")

    return [family(make, order=("1", "2"))]
"""


def test_members_of_families_are_those_of_the_files_as_they_are_now(tmp_path):
    """Of a file's own families, and of families elsewhere that wrap what it brings."""
    file = tmp_path / "families.py"
    for scale in (300.0, 77.0):
        file.write_text(FAMILIES.format(scale=scale))
        plugins.use_folders([file])
        scenario = plugins.find_scenario("scaled[n=2]")
        assert scenario.constants["conductivity"] == 2 * scale and plugins.find_scenario("scaled[n=2]") is scenario
        for name in ("mine[order=2]", "projected[method=mine]"):
            assert plugins.find_integrator(name) == plugins.find_integrator(name)
        z, system = scenario.z0, scenario.model
        step = plugins.find_integrator("mine[order=2]").step
        np.testing.assert_allclose(step(z, 1e-3, system) - z, 1e-3 * scale * system.vector_field(z))
        wrapped = plugins.find_integrator("projected[method=mine]").step(z, 1e-6, system)
        expected = 1e-6 * scale * system.vector_field(z)
        np.testing.assert_allclose(wrapped[:4], expected[:4], atol=1e-7)  # a projection moves by what is missed


def test_a_worker_loads_the_plugins_that_its_cells_need_and_no_other(tmp_path):
    for name in ("mine", "other"):
        (tmp_path / f"{name}.py").write_text(GOOD.replace('"mine"', f'"{name}"'))
    plugins.use_folders([tmp_path])
    assert plugins.needs("mine") == {"mine"} and plugins.needs("tc_monolithic") == set()
    plugins.use_only([("mine", "", plugins.registry().origins["mine"].path)])
    assert {"mine", "tc_monolithic"} <= set(plugins.integrators()) and "other" not in plugins.integrators()


@pytest.mark.parametrize(("listed", "name"), [(tcbench.scenarios, "shortterm"), (tcbench.integrators, "tc_strong")])
def test_an_unknown_name_is_a_key_error_that_says_what_there_is(listed, name):
    with pytest.raises(KeyError, match=r"^No (scenario|integrator) is called .* Did you mean") as error:
        listed()[name]
    assert isinstance(error.value, TcbenchError) and name not in listed() and listed().get(name) is None
