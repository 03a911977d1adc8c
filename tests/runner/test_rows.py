"""The run folder: nothing acknowledged is lost, whatever is torn, damaged, full, or written to twice."""

from __future__ import annotations

import csv
import errno
import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pandas
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tcbench.errors import TcbenchError
from tcbench.runner.cell import Cell
from tcbench.runner.codec import decode_line, digest, encode_line, unpack
from tcbench.runner.provenance import provenance, utc_now
from tcbench.runner.rows import ROWS, Store, is_finished

ROOT = Path(__file__).resolve().parents[2]


def numbered(count: int) -> list[Cell]:
    return [Cell("conservation", "tc", "short", {"dt": 0.1, "n": n}) for n in range(count)]


def same(a, b) -> bool:
    """Equality under which NaN equals NaN, and -0.0 does not equal 0.0."""
    return repr(a) == repr(b)


# -- cells


def test_a_key_depends_on_everything_but_the_order_of_the_options():
    base = {"study": "s", "integrator": "i", "scenario": "c", "options": {"a": 1, "b": [1.5]}}
    changed = ["study", "integrator", "scenario"]
    variants = [Cell(**base | {name: "other"}).key for name in changed]
    variants += [
        Cell(**base, timed=True).key,
        Cell(**base | {"options": {"a": 2, "b": [1.5]}}).key,
        Cell(**base).key,
    ]
    assert len(set(variants)) == len(variants)
    assert Cell(**base).key == Cell(**base | {"options": {"b": (1.5,), "a": 1}}).key
    assert Cell(**Cell(**base).as_dict()) == Cell(**base)


def test_options_that_are_not_json_are_refused_with_a_sentence():
    with pytest.raises(TcbenchError, match="not JSON"):
        Cell("s", "i", "c", {"f": print})


@pytest.mark.parametrize("error", [OSError("libllvmlite.so"), ModuleNotFoundError("jax"), PermissionError(13, "x")])
def test_faults_of_the_machine_are_never_final(error):
    from tcbench.runner.worker import exception_row

    assert not is_finished(exception_row(error)) and is_finished(exception_row(ValueError("x")))


# -- rows


text = st.text(st.sampled_from('a ~/"\\\n\0é\u2028😀'), max_size=6)
numbers = st.floats(allow_nan=True, allow_infinity=True) | st.integers(-(2**53), 2**53)
values = st.recursive(
    st.none() | st.booleans() | numbers | text,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(text, inner, max_size=4),
    max_leaves=12,
)


@settings(max_examples=15)
@given(st.dictionaries(text, values, max_size=5))
def test_any_row_survives_as_strict_json_nan_and_infinity_included(row):
    line = encode_line(digest({}), row | {"status": "ok"}, {})
    json.loads(line, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert same(unpack(decode_line(line)["row"]), row | {"status": "ok"})


def finished(store):
    return {key for key, row in store.rows().items() if is_finished(row)}


def test_rows_come_back_latest_per_key(tmp_path):
    a, b = numbered(2)
    with Store.open(tmp_path / "run") as store:
        origin = store.add_provenance({"commit": "abc"})
        store.append(a.key, {"status": "crash"}, a.as_dict())
        store.append(b.key, {"status": "ok", "x": math.nan, "l": [math.inf, {"y/~": -math.inf}]}, b.as_dict())
        assert finished(store) == {b.key}  # a crash is worth another attempt
        store.append(a.key, {"status": "nonconverged"}, a.as_dict())
    store = Store.read(tmp_path / "run")
    assert finished(store) == {a.key, b.key}
    assert same(store.rows()[b.key], {"status": "ok", "x": math.nan, "l": [math.inf, {"y/~": -math.inf}]})
    assert store.raw()[0]["provenance"] == origin
    assert store.provenances() == {origin: {"commit": "abc"}}
    assert store.records("conservation")[1]["dt"] == 0.1
    assert store.problems == []


def test_a_torn_last_line_is_reported_and_the_next_row_starts_on_its_own(tmp_path):
    cells = numbered(3)
    with Store.open(tmp_path) as store:
        for cell in cells[:2]:
            store.append(cell.key, {"status": "ok"}, cell.as_dict())
    path = tmp_path / ROWS
    path.write_bytes(path.read_bytes()[:-20])
    assert "line 2: is incomplete" in Store.read(tmp_path).problems[0]
    with Store.open(tmp_path) as store:
        assert finished(store) == {cells[0].key}
        store.append(cells[2].key, {"status": "ok"}, cells[2].as_dict())
    assert finished(Store.read(tmp_path)) == {cells[0].key, cells[2].key}


@pytest.mark.parametrize("damage", [b"\x00\xff\xfe garbage", b"[1, 2]", b'{"key": "k"}', b"7", b"[" * 100_000,
                                    encode_line(digest({}), {"a": 1}, {})[:-1],
                                    encode_line(digest({}), {"status": [1]}, {})[:-1],
                                    encode_line("k", {"status": "ok"}, {})[:-1]])  # fmt: skip
def test_a_damaged_line_costs_its_own_cell_only(tmp_path, damage):
    cells = numbered(3)
    with Store.open(tmp_path) as store:
        for cell in cells:
            store.append(cell.key, {"status": "ok"}, cell.as_dict())
        lines = (tmp_path / ROWS).read_bytes().splitlines()
        lines[1] = damage
        (tmp_path / ROWS).write_bytes(b"\n".join(lines) + b"\n")
    with Store.open(tmp_path) as store:
        assert finished(store) == {cells[0].key, cells[2].key}
        assert "line 2: is damaged" in store.problems[0]
        store.append(cells[1].key, {"status": "ok"}, cells[1].as_dict())
    after = Store.read(tmp_path)
    assert finished(after) == {cell.key for cell in cells} and len(after.problems) == 1


def test_fresh_sets_the_earlier_rows_aside(tmp_path):
    (cell,) = numbered(1)
    with Store.open(tmp_path) as store:
        store.append(cell.key, {"status": "ok"}, cell.as_dict())
    with Store.open(tmp_path, fresh=True) as store:
        assert store.rows() == {}
    assert cell.key in (tmp_path / "cells.1.old.jsonl").read_text()


# -- one writer


def test_a_second_writer_is_refused_and_kill_9_releases_the_lock(tmp_path):
    script = (
        "import sys, time; from tcbench.runner.rows import Store; store = Store.open(sys.argv[1]); "
        "print('open', flush=True); time.sleep(60)"
    )
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path)], stdout=subprocess.PIPE, env=environment
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"open\n"
        before = sorted(path.name for path in tmp_path.iterdir())
        with pytest.raises(TcbenchError, match=rf"Another run is writing to .* \(process {other.pid} "):
            Store.open(tmp_path)
        assert sorted(path.name for path in tmp_path.iterdir()) == before
        Store.read(tmp_path)  # looking is always allowed
        other.kill()
    Store.open(tmp_path).close()


# -- disk full


def test_disk_full_in_the_middle_of_a_line_keeps_the_rows_and_resumes(tmp_path, monkeypatch):
    cells = numbered(3)
    store = Store.open(tmp_path)
    store.append(cells[0].key, {"status": "ok"}, cells[0].as_dict())
    real = os.write

    def half_then_full(file, data):
        if len(data) > 20:
            return real(file, bytes(data[:20]))
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", half_then_full)
        with pytest.raises(TcbenchError, match="No space is left"):
            store.append(cells[1].key, {"status": "ok"}, cells[1].as_dict())
    store.append(cells[2].key, {"status": "ok"}, cells[2].as_dict())  # somebody made room
    store.close()
    after = Store.read(tmp_path)
    assert finished(after) == {cells[0].key, cells[2].key} and after.problems == []


# -- tables, manifest


def test_tables_keep_every_digit_and_leave_no_temporary_files(tmp_path):
    frame = pandas.DataFrame({"x": [0.1, 1 / 3, 5e-324, math.nan, math.inf], "n": [1, 2, 3, 4, 5]})
    frame["mixed"] = [1, "two", None, 4.5, True]
    frame["nested"] = [[1.5, 2], {"a": 1}, None, "text", []]
    with Store.open(tmp_path) as store:
        store.write_tables({"conservation": frame})
        store.write_manifest(provenance() | {"provenance_id": "id", "started": utc_now(), "cells": 5})
        with pytest.raises(TcbenchError, match="cannot be called"):
            store.write_tables({"../up": frame})
    with open(tmp_path / "tables" / "conservation.csv", newline="") as file:
        text = list(csv.DictReader(file))
    store = Store.read(tmp_path)
    assert same([float(line["x"] or "nan") for line in text], frame["x"].tolist())
    assert same(store.read_table("conservation")["x"].tolist(), frame["x"].tolist())
    assert text[0]["nested"] == "[1.5,2]"
    assert store.manifest()["cells"] == 5 and store.manifest()["provenance_id"] == "id"
    assert store.tables() == ["conservation"]
    assert sorted(path.name for path in (tmp_path / "tables").iterdir()) == [
        "conservation.csv",
        "conservation.parquet",
    ]
