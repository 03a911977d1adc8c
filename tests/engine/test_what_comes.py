"""What was not there when a row was measured and comes later, or goes: variables, folders, links, submodules."""

import io
import mmap
import os
import shutil
import sqlite3
import sys
import zipfile
from types import ModuleType

import pytest
from desks import again, measured, plugin, write

from tcbench.inputs import watching
from tcbench.inputs.recorder import Recorder

G1, G2 = "G = 1.0\n", "G = 1.1\n"
SPEC = """
from importlib import machinery, util
loader = machinery.SourceFileLoader("loaded_x", str(HERE / "_g.txt"))
module = util.module_from_spec(util.spec_from_file_location("loaded_x", HERE / "_g.txt", loader=loader))
loader.exec_module(module)
"""


def archive(text):
    with zipfile.ZipFile(content := io.BytesIO(), "w") as file:
        file.writestr("zip_x.py", text)
    return content.getvalue()


FILES = {  # what the plugin does, files before, files after
    "a submodule": (plugin("try:\n    from pk_z.sub import G\nexcept ImportError:\n    G = 1.0", "G"),
                    {"p/pk_z/__init__.py": ""}, {"p/pk_z/sub.py": G2}),
    "a submodule that is looked for": (plugin("import importlib.util\nG = importlib.util.find_spec('pk_v.sub') is None",
                                              "G"), {"p/pk_v/__init__.py": ""}, {"p/pk_v/sub.py": G2}),
    "a package before a submodule": (plugin("from pk_u.a import G", "G"), {"p/pk_u/__init__.py": "", "p/pk_u/a.py": G1},
                                     {"p/pk_u/a/__init__.py": G2}),
    "a folder in a step": (plugin("", "(1.1 if (HERE / 'dd').is_dir() else 1.0)"), {}, {"p/dd/x": ""}),
    "a folder": (plugin("G = os.path.exists(HERE / 'dd') + 1.0", "G"), {}, {"p/dd/x": ""}),
    "sizes": (plugin("G = sum(e.stat().st_size for e in os.scandir(HERE / '_d'))", "G"), {"p/_d/a": "1"},
              {"p/_d/a": "12"}),
    "an archive of modules": (plugin("sys.path[:0] = [str(HERE.parent / 'lib' / n) for n in ('z.zip', '.')]\n"
                                     "from zip_x import G", "G"), {"lib/zip_x.py": G1}, {"lib/z.zip": archive(G2)}),
    "a source of another kind": (plugin(SPEC, "module.G"), {"p/_g.txt": G1}, {"p/_g.txt": G2}),
    **{f"asked by {asks}": (plugin(f"G = 1.0\ntry:\n    {asks}\nexcept OSError:\n    G = 1.1", "G"), {}, {"p/_f/x": ""})
       for asks in ("open(HERE / '_f', 'x').close(); os.remove(HERE / '_f')", "os.rmdir(HERE / '_f')",
                    "os.mkdir(HERE / '_f'); os.rmdir(HERE / '_f')", "os.utime(HERE / '_f')")},
}  # fmt: skip
MADE = """
import shutil, tempfile
folder = tempfile.TemporaryDirectory()
os.makedirs(HERE / "_d", exist_ok=True)
with contextlib.suppress(OSError):
    (HERE / "_out").unlink()
for name in ("_out", "_d/out", folder.name + "/out"):
    (HERE / name).write_text("1")
shutil.rmtree(folder.name)
"""


def test_what_a_cell_makes_itself_is_no_input(desk):
    write(desk, {"p/mine.py": plugin(MADE), "p/_out": ""})
    assert again(desk, measured(desk)) == ""


def test_a_pipe_in_the_place_of_a_file_is_told_and_not_waited_for(desk):
    write(desk, {"p/mine.py": plugin("G = 1.0 + (HERE / 'g').exists()", "G")})
    rows = measured(desk)
    os.mkfifo(desk / "p" / "g")
    assert again(desk, rows) == "<mine>/g"


@pytest.mark.parametrize("what", FILES)
def test_what_comes_later_is_seen(desk, what):
    text, before, after = FILES[what]
    write(desk, {"p/mine.py": text} | before)
    rows = measured(desk)
    assert again(desk, rows) == ""
    write(desk, after)
    assert again(desk, rows) != ""


@pytest.mark.parametrize("how", ["dict(os.environ).get('MY_G', 1)", "len(os.environ)", "('MY_G' in list(os.environ))"])
def test_a_variable_that_comes_is_seen_by_who_reads_all(desk, monkeypatch, how):
    monkeypatch.delenv("MY_G", raising=False)
    write(desk, {"p/mine.py": plugin(f"os.environ['OWN_X'] = '1'\nG = float({how})", "G")})
    rows = measured(desk)
    monkeypatch.delenv("OWN_X", raising=False)
    monkeypatch.setenv("HOME", str(desk))
    assert again(desk, rows) == ""
    monkeypatch.delenv("OWN_X", raising=False)
    monkeypatch.setenv("MY_G", "2")
    assert again(desk, rows) == "the variable (names of all)"


@pytest.mark.parametrize(
    "asked", ["os.path.isdir(HERE / '_e' / 'dd')", "any(e.is_dir() for e in os.scandir(HERE / '_e'))"]
)
def test_a_folder_that_goes_is_seen(desk, asked):
    write(desk, {"p/mine.py": plugin(f"G = 1.0 + {asked}", "G"), "p/_e/dd/x": "", "p/_e/y": ""})
    rows = measured(desk)
    assert again(desk, rows) == ""
    shutil.rmtree(desk / "p" / "_e" / "dd")
    write(desk, {"p/_e/dd": ""})
    assert again(desk, rows) != ""


@pytest.mark.parametrize("asked", ["os.path.islink(HERE / 'b')", "os.path.samefile(HERE / 'a', HERE / 'b')"])
def test_a_link_to_the_same_content_is_seen(desk, asked):
    write(desk, {"p/mine.py": plugin(f"G = 1.0 + {asked}", "G"), "p/a": "1", "p/c": "1"})
    (desk / "p" / "b").symlink_to("c")
    rows = measured(desk)
    assert again(desk, rows) == ""
    (desk / "p" / "b").unlink()
    (desk / "p" / "b").symlink_to("a")
    assert again(desk, rows) == "<mine>/b"


def test_a_file_that_becomes_a_link_to_its_content_is_seen(desk):
    write(desk, {"p/mine.py": plugin("G = 1.0 + (HERE / 'b').is_symlink()", "G"), "p/a": "1", "p/b": "1"})
    rows = measured(desk)
    assert again(desk, rows) == ""
    (desk / "p" / "b").unlink()
    (desk / "p" / "b").symlink_to("a")
    assert again(desk, rows) == "<mine>/b"


def test_a_database_that_is_named_by_an_address_is_a_file(desk):
    def fill(value):
        with sqlite3.connect(desk / "p" / "g %.db") as base:
            base.execute("create table if not exists t(v real)")
            base.execute("insert into t values(?)", (value,))
        base.close()

    read = """
    base = sqlite3.connect((HERE / 'g %.db').as_uri() + '?mode=ro', uri=True)
    G = len(list(base.execute('select v from t')))
    base.close()
    """
    write(desk, {"p/mine.py": plugin(read, "G")})
    fill(1.0)
    rows = measured(desk)
    assert again(desk, rows) == ""
    fill(2.0)
    assert again(desk, rows) == "<mine>/g %.db"


@pytest.mark.skipif(sys.platform != "linux", reason="there is no /proc")
def test_what_several_processes_write_to_as_their_memory_is_no_input(desk):
    """heyoka's cache is a database, whose other users changed it between two rows: both were measured again."""
    write(
        desk,
        {
            "p/mine.py": plugin("with contextlib.suppress(OSError):\n    ctypes.CDLL(str(HERE / 'none.so'))"),
            "lib/g.db-shm": "1" * 64,
            "lib/g": "1",
        },
    )
    with (desk / "lib" / "g.db-shm").open("r+b") as shared, (desk / "lib" / "g").open("rb") as read:
        memory, _held = mmap.mmap(shared.fileno(), 0), mmap.mmap(read.fileno(), 0, prot=mmap.PROT_READ)
        rows = measured(desk)
        memory[:1] = b"2"
        memory.flush()
        assert again(desk, rows) == ""
        (desk / "lib" / "g").write_text("2")
        assert again(desk, rows).endswith("lib/g")


@pytest.mark.skipif(sys.platform != "linux", reason="there is no /proc")
def test_the_state_of_the_machine_is_no_input_that_could_be_compared(desk):
    write(desk, {"p/mine.py": plugin("G = len(open('/proc/self/stat').read())", "G")})
    assert again(desk, measured(desk)) == "the state of the machine was read"


def test_what_python_imports_before_anything_else_is_an_input(desk, monkeypatch):
    module = ModuleType("sitecustomize")
    module.__file__ = str(desk / "lib" / "sitecustomize.py")
    monkeypatch.setitem(sys.modules, "sitecustomize", module)
    write(desk, {"p/mine.py": plugin(), "lib/sitecustomize.py": G1})
    watching.end()
    noted = watching.begin().files
    watching.end()
    assert list(noted) == [os.path.abspath(module.__file__)]


@pytest.mark.skipif(sys.platform != "linux", reason="there is no /proc")
def test_what_is_looked_up_for_a_note_is_no_input_whoever_wraps_open(desk, monkeypatch):
    """A sitecustomize that wraps open() made every such look one of the plugin's, and the row was never used again."""
    wrapped = "def wrap(plain):\n    def wrapper(*a, **k):\n        return plain(*a, **k)\n    return wrapper\n"
    space = {}
    exec(compile(wrapped, str(desk / "lib" / "wrapping.py"), "exec"), space)
    monkeypatch.setattr("builtins.open", space["wrap"](open))
    recorder = Recorder()
    recorder.loaded_libraries = True
    sys.addaudithook(
        lambda event, arguments: recorder.heard(event, arguments) if event == "open" and listening else None
    )
    listening = True
    try:
        recorder.collected()
    finally:
        listening = False
    assert recorder.files and not recorder.unseen
