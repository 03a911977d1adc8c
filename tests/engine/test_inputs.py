"""What a plugin reads is noted and compared: attacks on rows that are used again, without a process (a worker's side is
played here), and a few from end to end."""

import io
import json
import os
import shutil
import sqlite3
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from desks import again, forget, measured, planned, plugin, write

import tcbench
from tcbench import plugins
from tcbench.engine.reuse import Reuse
from tcbench.inputs import marks, watching
from tcbench.store.store import Store

G1, G2 = "G = 1.0\n", "G = 1.1\n"


def archive(text):
    """A zip file with one module."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as written:
        written.writestr("zipped_x.py", text)
    return file.getvalue()


BESIDE = "import sys\nsys.path.insert(0, str(HERE.parent / 'lib'))\n"
ATTACKS = {  # what the plugin does, files before, files after
    "json": (plugin("G = json.loads((HERE / 'g.json').read_text())", "G"), {"p/g.json": "1.0"}, {"p/g.json": "1.1"}),
    "loadtxt": (plugin("", "np.loadtxt(HERE / 'g.txt')"), {"p/g.txt": "1.0"}, {"p/g.txt": "1.1"}),
    "in a step": (plugin("", "float(io.open(HERE / 'g.txt').read())"), {"p/g.txt": "1.0"}, {"p/g.txt": "1.1"}),
    "descriptor": (plugin("G = float(os.read(os.open(HERE / 'g.txt', os.O_RDONLY), 9))", "G"), {"p/g.txt": "1.0"},
                   {"p/g.txt": "1.1"}),
    "memory map": (plugin("G = np.load(HERE / 'g.npy', mmap_mode='r')", "G[0]"), {"p/g.npy": np.ones(3)},
                   {"p/g.npy": 2 * np.ones(3)}),
    "elsewhere": (plugin("G = float((HERE.parent / 'lib' / 'g.txt').read_text())", "G"), {"lib/g.txt": "1.0"},
                  {"lib/g.txt": "1.1"}),
    "exec": (plugin("exec((HERE / 'g.inc').read_text())", "G"), {"p/g.inc": G1}, {"p/g.inc": G2}),
    "runpy": (plugin("import runpy\nG = runpy.run_path(str(HERE / '_g.py'))['G']", "G"), {"p/_g.py": G1},
              {"p/_g.py": G2}),
    "path": (plugin(BESIDE + "from glib_x import G", "G"), {"lib/glib_x.py": G1}, {"lib/glib_x.py": G2}),
    "computed": (plugin("G = importlib.import_module(f'gv{1}').G", "G"), {"p/gv1.py": G1}, {"p/gv1.py": G2}),
    "late": (plugin("", "importlib.import_module('gval').G"), {"p/_x/y": "", "p/gval.py": G1}, {"p/gval.py": G2}),
    "namespace": (plugin("from ns_x.sub import G", "G"), {"p/ns_x/sub.py": G1}, {"p/ns_x/sub.py": G2}),
    "package": (plugin("from pk_x import *", "G"), {"p/pk_x/__init__.py": "from .a import *", "p/pk_x/a.py": G1},
                {"p/pk_x/a.py": G2}),
    "letters": (plugin("from été import G", "G"), {"p/été.py": G1}, {"p/été.py": G2}),
    "type checking": (plugin("TYPE_CHECKING = True\nif TYPE_CHECKING:\n    from gg import G", "G"), {"p/gg.py": G1},
                      {"p/gg.py": G2}),
    "a file that comes": (plugin("G = 1.0\nwith contextlib.suppress(OSError):\n    G = float(open(HERE / 'g').read())",
                                 "G"), {}, {"p/g": "1.1"}),
    "a module that comes": (plugin("try:\n    from absent_x import G\nexcept ImportError:\n    G = 1.0", "G"), {},
                            {"p/absent_x.py": G2}),
    "a glob": (plugin("G = sum(float(f.read_text()) for f in HERE.glob('*.txt'))", "G"), {"p/a.txt": "1"},
               {"p/b.txt": "1"}),
    "a listing": (plugin("", "len(os.listdir(HERE / '_data'))"), {"p/_data/a": "1"}, {"p/_data/b": "1"}),
    "uses": (plugin("", "tcbench_step(system)", extra=", uses='base'").replace("tcbench_step(system)",
             "__import__('tcbench').plugins.find_integrator('base').order"), {"p/tools.py": plugin(name="base")},
             {"p/tools.py": plugin(name="base") + "# other\n"}),
    "undeclared": (plugin("", "__import__('tcbench').plugins.find_integrator('base').order"),
                   {"q/tools.py": plugin(name="base")}, {"q/tools.py": plugin(name="base") + "# other\n"}),
    "a file that is asked for": (plugin("G = 1.1 if (HERE / 'flag').exists() else 1.0", "G"), {}, {"p/flag": ""}),
    "in a step is asked for": (plugin("", "(1.1 if os.path.isfile(HERE / 'flag') else 1.0)"), {}, {"p/flag": ""}),
    "a size": (plugin("G = os.stat(HERE / 'g').st_size", "G"), {"p/g": "1"}, {"p/g": "12"}),
    "a walk": (plugin("G = sum(len(files) for _, _, files in os.walk(HERE / '_d'))", "G"), {"p/_d/e/a": "1"},
               {"p/_d/e/b": "1"}),
    "bytes": (plugin("K = float(open(os.fsencode(HERE / 'g')).read())", "K"),
              {"p/g": "1"}, {"p/g": "2"}),
    "a zip": (plugin("sys.path.append(str(HERE / 'g.zip'))\nfrom zipped_x import G", "G"), {"p/g.zip": archive(G1)},
              {"p/g.zip": archive(G2)}),
    "a path file": (plugin("import site\nsite.addsitedir(str(HERE.parent / 'lib'))\nfrom pth_x import G", "G"),
                    {"lib/a.pth": "v1\n", "lib/v1/pth_x.py": G1, "lib/v2/pth_x.py": G2}, {"lib/a.pth": "v2\n"}),
    "a distribution": (plugin("sys.path.append(str(HERE.parent / 'lib'))\nimport importlib.metadata\n"
                              "G = float(importlib.metadata.version('own-x'))", "G"),
                       {"lib/own_x-1.0.dist-info/METADATA": "Name: own-x\nVersion: 1.0\n"},
                       {"lib/own_x-1.0.dist-info/METADATA": "Name: own-x\nVersion: 1.1\n"}),
    "a module's own reader": (plugin("sys.path.append(str(HERE.parent / 'lib'))\nimport res_x, importlib.resources\n"
                                     "G = float(importlib.resources.files('res_x').joinpath('g').read_text())", "G"),
                              {"lib/res_x/__init__.py": "", "lib/res_x/g": "1"}, {"lib/res_x/g": "2"}),
    "two parts of a namespace": (plugin(BESIDE + "from parts_x.b import G", "G"),
                                 {"p/parts_x/a.py": G1, "lib/parts_x/b.py": G1}, {"lib/parts_x/b.py": G2}),
    "a pickle": (plugin("import pickle\nG = pickle.loads((HERE / 'g').read_bytes())", "G"), {"p/g": b"F1\n."},
                 {"p/g": b"F2\n."}),
    "after a change of folder": (plugin("os.chdir(HERE)\nG = float(open('g').read())\nos.chdir('/')", "G"),
                                 {"p/g": "1"}, {"p/g": "2"}),
    "in a thread": (plugin("import threading\nG = []\ndef read():\n    G.append(float(open(HERE / 'g').read()))\n"
                           "t = threading.Thread(target=read)\nt.start()\nt.join()", "G[0]"),
                    {"p/g": "1"}, {"p/g": "2"}),
    "a stem of two": (plugin(), {"q/mine.py": plugin(name="two")}, {"p/mine.py": plugin(use="2.0")}),
}  # fmt: skip


def content(value):
    if isinstance(value, np.ndarray):
        buffer = io.BytesIO()
        np.save(buffer, value)
        return buffer.getvalue()
    return value


@pytest.mark.parametrize("attack", ATTACKS)
def test_a_row_is_used_again_only_while_all_that_was_read_is_as_it_was(desk, attack):
    text, before, after = ATTACKS[attack]
    write(desk, {"p/mine.py": text} | {name: content(value) for name, value in before.items()})
    rows = measured(desk)
    assert again(desk, rows) == ""
    for path in [p for p in desk.rglob("*") if p.is_file()]:
        os.utime(path, (2e9, 2e9))
    write(desk, {"p/beside.py": plugin(name="beside"), "q/other.py": plugin(name="other")})
    # a glob lists the folder; importlib_metadata, where something imported it, looks for distributions in all folders
    assert again(desk, rows) == "" or attack in ("a glob", "a distribution")
    write(desk, {name: content(value) for name, value in after.items()})
    assert again(desk, rows) != ""


def test_a_folder_that_is_moved_and_line_ends_change_nothing(desk):
    text = plugin(BESIDE + "from glib_x import G\nfrom near_x import K", "G")
    write(desk, {"p/mine.py": text, "p/near_x.py": "K = 1\n", "lib/glib_x.py": G1})
    rows = measured(desk)
    moved = desk / "moved" / "here"
    for name in ("p", "q", "lib"):
        shutil.copytree(desk / name, moved / name)
        shutil.rmtree(desk / name)
    assert again(moved, rows) == ""
    near = moved / "p" / "near_x.py"
    near.write_bytes(near.read_bytes().replace(b"\n", b"\r\n"))
    assert again(moved, rows) == ""
    assert str(desk) not in json.dumps(rows.inputs(next(iter(rows.rows().values()))["inputs"]))


@pytest.mark.parametrize("how", ["os.environ['MY_G']", "os.getenv('MY_G', '2')", "dict(os.environ).get('MY_G')"])
def test_the_environment_that_is_read_is_compared(desk, monkeypatch, how):
    monkeypatch.setenv("MY_G", "1")
    write(desk, {"p/mine.py": plugin(f"G = float({how})", "G")})
    rows = measured(desk)
    monkeypatch.setenv("HOME", str(desk))
    assert again(desk, rows) == ""
    monkeypatch.setenv("MY_G", "1.1")
    assert again(desk, rows) == "the variable MY_G"


def test_what_a_plugin_sets_in_its_own_environment_is_no_input(desk, monkeypatch):
    monkeypatch.delenv("MY_G", raising=False)
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    own = "os.environ.setdefault('MY_G', '1')\nG = float(os.environ['MY_G']) * float(os.getenv('OMP_NUM_THREADS', '1'))"
    write(desk, {"p/mine.py": plugin(own, "G")})
    rows = measured(desk)
    monkeypatch.delenv("OMP_NUM_THREADS")  # which a worker sets
    assert again(desk, rows) == ""


def test_a_new_module_that_shadows_one_is_seen(desk):
    write(desk, {"p/mine.py": plugin("from shade_x import G", "G"), "p/shade_x.py": G1})
    rows = measured(desk)
    write(desk, {"lib/shade_x.py": G2})
    assert again(desk, rows) == ""
    before = list(sys.path)
    sys.path.insert(0, str(desk / "lib"))
    try:
        job = planned(desk)
        sys.path.insert(0, str(desk / "lib"))  # as PYTHONPATH would
        assert Reuse(rows, job.context).reason(job.cells[0], rows.rows()[job.cells[0].key]) == "the module shade_x"
    finally:
        sys.path[:] = before


def test_a_module_elsewhere_that_is_edited_within_a_second_is_measured_as_it_is(desk, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    write(desk, {"p/mine.py": plugin(BESIDE + "from glib_x import G", "G")})
    for text in (G1, G2):
        write(desk, {"lib/glib_x.py": text})
        os.utime(desk / "lib" / "glib_x.py", (1e9, 1e9))
        measured(desk)
        assert text.strip().endswith(str(sys.modules["glib_x"].G))


@pytest.mark.parametrize("how", ["replaced", "same time", "a link in it"])
def test_content_counts_however_it_came(desk, how):
    read = "G = float(pathlib.Path(os.readlink(HERE / 'now'), 'g').read_text())" if "link" in how else (
        "G = float((HERE / 'g').read_text())")  # fmt: skip
    write(desk, {"p/mine.py": plugin(read, "G"), "p/g": "1.0", "lib/one/g": "1.0", "lib/two/g": "1.1"})
    (desk / "p" / "now").symlink_to(desk / "lib" / "one")
    rows = measured(desk)
    assert again(desk, rows) == ""
    before = os.stat(desk / "p" / "g")
    if how == "a link in it":
        (desk / "p" / "now").unlink()
        (desk / "p" / "now").symlink_to(desk / "lib" / "two")
    elif how == "replaced":
        (desk / "new").write_text("1.1")
        os.replace(desk / "new", desk / "p" / "g")
    else:
        (desk / "p" / "g").write_text("1.1")
        os.utime(desk / "p" / "g", ns=(before.st_atime_ns, before.st_mtime_ns))
    assert again(desk, rows) == ("<mine>/now" if "link" in how else "<mine>/g")


@pytest.mark.parametrize("how", ["open('g').read()", "open(os.path.join(os.getcwd(), 'g')).read()"])
def test_the_current_folder_is_the_one_of_the_run(desk, monkeypatch, how):
    write(desk, {"p/mine.py": plugin(f"G = float({how})", "G"), "lib/g": "1.0", "q/g": "1.0"})
    monkeypatch.chdir(desk / "lib")
    rows = measured(desk)
    assert again(desk, rows) == ""
    monkeypatch.chdir(desk / "q")
    assert (again(desk, rows) == "") == ("getcwd" not in how)  # another folder with the same content
    write(desk, {"q/g": "1.1"})
    assert again(desk, rows) != ""
    monkeypatch.chdir(desk / "lib")
    assert again(desk, rows) == ""


def test_a_library_that_is_built_again_is_seen(desk):
    def build(value):
        (desk / "g.c").write_text(f"double g(void) {{ return {value}; }}")
        subprocess.run(["cc", "-shared", "-fPIC", desk / "g.c", "-o", desk / "new.so"], check=True)
        os.replace(desk / "new.so", desk / "p" / "libg.so")

    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    build(1.0)
    load = "L = ctypes.CDLL(str(HERE / 'libg.so'))\nL.g.restype = ctypes.c_double\nG = L.g()"
    write(desk, {"p/mine.py": plugin(load, "G")})
    rows = measured(desk)
    assert again(desk, rows) == ""
    build(1.1)
    assert again(desk, rows) == "<mine>/libg.so"


def test_a_link_that_is_set_on_another_folder_is_seen(desk):
    for name, use in (("v1", "1.0"), ("v2", "1.1")):
        write(desk, {f"{name}/mine.py": plugin(use=use)})
    (desk / "p").rmdir()
    (desk / "p").symlink_to("v1")
    rows = measured(desk)
    assert again(desk, rows) == ""
    (desk / "p").unlink()
    (desk / "p").symlink_to("v2")
    assert again(desk, rows) == "<mine>/mine.py"


def test_a_file_that_is_called_as_a_built_in_one_is_known(desk):
    write(desk, {"p/tc_gauss.py": plugin()})
    rows = measured(desk)
    assert again(desk, rows) == ""
    write(desk, {"p/tc_gauss.py": plugin(use="1.1")})
    assert again(desk, rows).endswith("tc_gauss.py")


@pytest.mark.parametrize(
    ("does", "reason"),
    [
        ("__import__('subprocess').run([sys.executable, '-c', ''])", "a process was started"),
        ("os.system('true')", "a process was started"),
        ("__import__('multiprocessing').get_context('spawn').Process(target=int).start()", "a process was started"),
        ("__import__('socket').getaddrinfo('localhost', 80)", "the network was used"),
        ("(HERE / 'log').open().read(); (HERE / 'log').write_text(str(id(z)))", "<mine>/log changed while it was"),
    ],
)
def test_what_cannot_be_seen_is_measured_each_time(desk, does, reason):
    write(desk, {"p/mine.py": plugin().replace("return z", f"{does}\n    return z"), "p/log": "1"})
    assert again(desk, measured(desk)).startswith(reason)


def test_a_database_and_a_library_are_files(desk):
    with sqlite3.connect(desk / "p" / "g.db") as base:
        base.execute("create table g (x)")
    write(desk, {"p/mine.py": plugin("sqlite3.connect(HERE / 'g.db')\nwith contextlib.suppress(OSError):\n"
                                     "    ctypes.CDLL(str(HERE / 'g.so'))"), "p/g.so": b"\0no library"})  # fmt: skip
    rows = measured(desk)
    noted = rows.inputs(next(iter(rows.rows().values()))["inputs"])["files"]
    assert {"<mine>/g.db", "<mine>/g.so", "<mine>/mine.py"} <= set(noted)


def test_a_worker_imports_what_a_cell_asks_for_and_nothing_else(desk):
    bad = "import numpy as np\nnp.seterr(all='raise')\nimport time\ntime.monotonic = None\nprint('said')\n"
    write(desk, {"p/mine.py": plugin(), "q/bad.py": bad})
    job = planned(desk)
    assert np.geterr()["over"] != "raise" and __import__("time").monotonic() > 0  # undone in this process
    forget(desk)
    plugins.use_index(job.context["index"])
    assert plugins.find_integrator("tc_gauss").plugin == "tc_gauss" and watching.recorder() is None
    assert plugins.find_integrator("mine").plugin == "mine" and set(watching.recorder().plugins) == {"mine"}
    assert plugins.find_integrator("projected[method=mine]").name == "projected[method=mine]"


def test_a_run_that_another_worker_made_hands_on_what_that_has_read(desk):
    from tcbench.simulation import shared_runs

    scenario, run = tcbench.scenarios()["short_term"], shared_runs.Solved(np.ones((2, 10)), {}, "ok", "", 1.0)
    (desk / "p" / "g.txt").write_text("1.0")
    with shared_runs.kept_in(str(desk / "lib")):
        watching.begin().plugins["mine"] = str(desk / "p")
        (desk / "p" / "g.txt").read_text()
        shared_runs.keep("mine", scenario, 1e-3, run)
        watching.end()
        assert shared_runs.known("mine", scenario, 1e-3) is not None  # in another worker, which has read nothing itself
    noted = json.loads(watching.recorder().collected()[1])
    assert set(noted["files"]) >= {"<mine>/g.txt"} and noted["plugins"] == ["mine"]


def test_the_inputs_of_many_rows_are_looked_at_once(desk, monkeypatch):
    write(desk, {"p/mine.py": plugin()})
    rows = measured(desk)
    job = planned(desk)
    cell, row = job.cells[0], next(iter(rows.rows().values()))
    looked = []
    monkeypatch.setitem(marks.LOOKS, "files", lambda path: looked.append(path) or marks.file_hash(path))
    reuse = Reuse(rows, job.context)
    assert {reuse.reason(cell, row) for _ in range(1700)} == {""} and len(looked) == 1


def test_from_end_to_end_a_second_run_measures_nothing_and_an_edit_is_measured(desk):
    data = "G = json.loads((HERE / 'g.json').read_text())"
    write(desk, {"p/mine.py": plugin(data, "G"), "p/g.json": "1.0"})
    loud = "import numpy as np\nimport scipy.integrate as S\nS.RK45.B = S.RK45.B * 1.001\n" + plugin(name="loud")
    write(desk, {"q/loud.py": loud})

    def run(*dt):
        forget(desk)
        plugins.use_folders([desk / "p", desk / "q"])
        return tcbench.run(["mine", "loud"], ["short_term"], ["conservation"], desk / "out", dt=dt, jobs=1)

    first = run(0.1, 0.2)
    assert first.summary.run == 4 and run(0.1, 0.2).summary.run == 0
    (desk / "p" / "g.json").write_text("1.1")
    second = run(0.1)
    assert second.summary.run == 1 and second.summary.already_finished == 1
    table = second.every["conservation"]
    assert sorted(table[table.integrator == "mine"].dt) == [0.1] and len(table) == 3  # one physics
    assert "1 row of mine that was measured with another g.json is not in the tables" in " ".join(second.problems)
    error = [r.tables["conservation"].set_index("integrator").energy_error_max["mine"].iloc[0] for r in (first,)]
    assert error[0] != table[table.integrator == "mine"].energy_error_max.item()
    shutil.rmtree(desk / "out" / "inputs")  # lost: measured again
    assert run(0.1).summary.run == 2
    assert Store.read(desk / "out").rows()
    assert {path.name for path in (Path(desk) / "out" / "sources").iterdir()} == {"mine.py", "loud.py"}
