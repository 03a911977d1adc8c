"""Several runs on one page: a name for each method, times over a yardstick, and a sentence on what can be compared."""

import json

import awkward
import pytest
from click.testing import CliRunner

from tcbench.cli import main
from tcbench.report.publish import publish
from tcbench.report.together import together
from tcbench.runner.rows import Store
from tcbench.runner.tables import read_tables

SCENARIOS = ["short_term", "stiff_spring"]


def run(folder, methods, cpu, slower=1.0, scenario=None):
    """A run of these methods on a machine; scenario: what it declares otherwise of stiff_spring."""
    tables = {
        name: table
        for name, table in awkward.everything(methods, SCENARIOS).items()
        if name in ("conservation", "work_precision", "stability")
    }
    for table in tables.values():
        for column in {"us_per_step", "time_s", "wall_time_min_s", "wall_time_median_s"}.intersection(table):
            table[column] *= slower
    told = awkward.declared(methods, SCENARIOS)
    told["scenarios"]["stiff_spring"] = told["scenarios"]["stiff_spring"] | (scenario or {})
    awkward.write_run(folder, tables, (), told)
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps(manifest | {"machine": {"cpu": cpu, "cores": 2}}))
    return folder


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    top = tmp_path_factory.mktemp("runs")
    return [
        run(top / "published", ["tc_monolithic", "tc_strang"], "fast"),
        run(top / "theirs", ["tc_monolithic", "mine"], "slow", 3.0, {"faces": []}),  # of a version that says more
        run(top / "alone", ["other"], "third", scenario={"t_end": 1.0}),
    ]


def test_rows_keep_their_names_and_times_are_those_of_one_machine(folders):
    store = Store.read(folders[0])
    tables, declared, said = together(store, read_tables(store), folders[1:])
    table = tables["conservation"].set_index(["integrator", "scenario", "dt"])
    assert {*table.index.get_level_values(0)} == {
        "tc_monolithic",
        "tc_strang",
        "tc_monolithic[run=theirs]",
        "mine",
        "other",
    }
    assert {*declared["integrators"]} == {*table.index.get_level_values(0)}
    first, again = (table.loc[name] for name in ("tc_monolithic", "tc_monolithic[run=theirs]"))
    assert again["us_per_step"].to_numpy() == pytest.approx(
        first["us_per_step"].to_numpy()
    )  # 3 times as slow a machine
    assert "multiplied by 0.33, the median ratio of a step's time over 2 pairs of method and scenario" in said[1]
    assert "shares no timed method: its times do not compare" in said[2]
    assert said[3] == "alone defines stiff_spring otherwise."
    assert "stiff_spring[run=alone]" in {*tables["stability"]["scenario"]} & {*declared["scenarios"]}
    best = tables["work_precision"].groupby("integrator")["wall_time_min_s"].min()
    assert best["tc_monolithic[run=theirs]"] == pytest.approx(best["tc_monolithic"])


@pytest.mark.thorough
def test_one_command_writes_them_on_one_page_and_a_site_has_it_too(folders, tmp_path):
    words = [*map(str, folders), "-o", str(tmp_path / "all.html")]
    done = CliRunner().invoke(main, ["report", *words])
    assert done.exit_code == 0 and "all.html" in done.output, done.output
    text = (tmp_path / "all.html").read_text()
    assert "3 runs: published, theirs, alone" in text and "mine" in text and "compare as they are" in text
    assert not (folders[0] / "report.html").exists()
    index = publish(folders[:2], tmp_path / "site")
    assert 'href="together.html"' in index.read_text() and (tmp_path / "site" / "together.html").is_file()
