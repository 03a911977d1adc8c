"""What a cell's key is made of, and what only its row says."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

import tcbench
from tcbench import plugins
from tcbench.engine.cluster import _all_machines
from tcbench.engine.local import plan
from tcbench.runner.plan import plan_job
from tcbench.inputs import marks
from tcbench.store.cells import Cell
from tcbench.store.rows import Rows
from tcbench.runner.tables import latest_rows


@pytest.mark.parametrize("name", ["short_term", "rigid_body"])  # springs; any other system, which has `initial`
def test_every_field_of_a_scenario_is_in_the_key(name):
    from dataclasses import fields

    from tcbench.systems.scenario import SAID, Scenario

    def key(scenario):
        return plan_job(["midpoint_entropy"], [scenario], ["conservation"], dt=[0.3]).cells[0].key

    base = tcbench.scenarios()[name].replace(name="x")
    constant = "coupling" if name == "short_term" else "damping"
    other = {
        "system": type("Other", (base.system,), {"name": "other"}),
        "constants": base.constants | {constant: 0.3},
        "initial": {"m": [0.5, 0.9, 0.6]},
    }
    elements, general = ("positions", "momenta", "temperatures"), ("initial",)
    absent = general if name == "short_term" else elements
    for field in fields(Scenario):
        if field.name not in SAID and field.name not in absent:
            value = getattr(base, field.name)
            changed = tuple(1.01 * v for v in value) if isinstance(value, tuple) else other.get(field.name, value)
            changed = 1.01 * changed if isinstance(changed, float) else changed
            assert key(replace(base, **{field.name: changed})) != key(base), field.name
    for name in ("shows", "source", "plugin"):
        assert key(replace(base, **{name: "another word"})) == key(base)


@pytest.mark.parametrize("name", ["TCBENCH_PLAIN", "TCBENCH_TARGET", "OMP_NUM_THREADS", "PYTHONHASHSEED"])
def test_what_c_code_is_told_is_in_every_key(monkeypatch, name):
    def keys():
        cells = plan_job(["tc_strang"], ["short_term"], ["conservation", "work_precision"], dt=[0.3]).cells
        return {cell.key for cell in cells}

    before = keys()
    monkeypatch.setenv(name, "2")
    assert not keys() & before


def test_all_members_of_a_block_of_random_scenarios_are_in_its_key(monkeypatch):
    family = plugins.find_family("random")
    sample, first = family.sample, family.member(seed="0").positions

    def keys():
        job = plan_job(["tc_strang"], ["random"], ["ensemble"], options={"size": 20, "seed": 0})
        return {(c.options["part"], c.options["seeds"][0]): c.key for c in job.cells}

    before = keys()
    monkeypatch.setitem(family.__dict__, "sample", lambda draw: s if (s := sample(draw)).positions == first else
                        s.replace(stiffness=[300.0, 300.0]))  # fmt: skip
    assert not set(keys().values()) & set(before.values())
    monkeypatch.undo()
    assert keys() == before
    for found in ("1.0", "9.0"):  # of the packages behind the references
        monkeypatch.setattr("tcbench.reference.lookup._packages", lambda found=found: found)
        changed = {part for part, key in keys().items() if key != before[part]}
        assert changed == {("references", 0), ("references", 10)}


def test_one_hash_of_all_that_computes_and_of_nothing_that_only_shows(tmp_path, monkeypatch):
    from tcbench.engine import fingerprint

    for folder in marks.OWN:
        shutil.copytree(folder, tmp_path / Path(folder).name, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(marks, "OWN", tuple(str(tmp_path / Path(f).name) + os.sep for f in marks.OWN))

    def mark():
        fingerprint.forget()
        return fingerprint.own_sources()

    before = mark()
    shown, computed = ("progress.py", "report/html.py", "store/compare.py"), ("building_blocks.py", "solver/newton.py")
    for file, counts in {**dict.fromkeys(shown, False), **dict.fromkeys((*computed, "reference/data"), True)}.items():
        path = tmp_path / Path(marks.OWN[0]).name / file
        path = next(path.glob("*.json")) if path.is_dir() else path
        text = path.read_bytes()
        path.write_bytes(text + b"\n# a word\n")
        assert (mark() != before) == counts, file
        path.write_bytes(text)
    fingerprint.forget()


def test_a_timing_is_of_the_machine_that_took_it():
    job = plan_job(["tc_strang"], ["short_term"], ["work_precision"])
    (cell,) = [cell for cell in job.cells if cell.timed][:1]
    rows = Rows()
    rows.append(cell.key, {"status": "ok", "machine": cell.machine}, cell.as_dict())
    assert not plan([cell], rows)[0]
    rows.append(cell.key, {"status": "ok", "machine": "another", "worker_host_cpu": "another"}, cell.as_dict())
    assert plan([cell], rows)[0] and not plan([cell], rows, machines=_all_machines(rows))[0]


def test_a_table_is_of_one_physics_and_says_what_it_leaves_out():
    def rows(**of_the_older):
        found = Rows()
        for n, more in enumerate(({"scenario_fields": "a", "measured_by": "c"} | of_the_older,
                                  {"scenario_fields": "a", "measured_by": "c"})):  # fmt: skip
            cell = Cell("conservation", "m", "s", {"dt": n})
            found.append(cell.key, {"status": "ok", **more}, cell.as_dict())
        return latest_rows(found)

    assert len(rows()[0]) == 2 and not rows()[1]
    for more, told in (
        ({"scenario_fields": "b"}, "another scenario s"),
        ({"measured_by": "b"}, "another tcbench"),
        ({"measured_by": None, "tcbench_version": "0.1"}, "another tcbench"),
    ):
        keys, sentences = rows(**more)
        assert len(keys) == 1 and told in sentences[0]
    keys, sentences = rows(machine="a slow one")
    assert len(keys) == 2 and not sentences
    found = Rows()
    for n, machine in enumerate(("slow", "fast")):
        cell = Cell("work_precision", "m", "s", {"n": n}, timed=True, machine=machine)
        found.append(cell.key, {"status": "ok"}, cell.as_dict())
    assert "2 machines, whose times are not to be compared" in latest_rows(found)[1][0]
