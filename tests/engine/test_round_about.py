"""What is read by a way round about: through links, packages, byte code, descriptors, C, or without a file at all."""

import importlib.util
import os
import py_compile
import shutil
import sqlite3
import subprocess
import sys
from importlib.machinery import PathFinder, SourceFileLoader

import pytest
from desks import again, measured, plugin, write

from tcbench.inputs import facts, marks, recorder, seen

G1, G2 = "G = 1.0\n", "G = 1.1\n"
TWO = "sys.path[:0] = [str(HERE.parent / 'l1'), str(HERE.parent / 'l2')]\nfrom two_x import G"
SOURCELESS = """
from importlib import machinery, util
loader = machinery.SourcelessFileLoader("pyc_y", util.cache_from_source(str(HERE / "pyc_y.py")))
module = util.module_from_spec(util.spec_from_loader("pyc_y", loader))
loader.exec_module(module)
"""
MARSHAL = """
import importlib.util, marshal
exec(marshal.loads(open(importlib.util.cache_from_source(str(HERE / "pyc_z.py")), "rb").read()[16:]))
"""
needs_linux = pytest.mark.skipif(sys.platform != "linux", reason="what Linux has")


def byte_code(text, name):
    def write_it(desk):
        write(desk, {"lib/source.py": text})
        place = desk / "p" / name
        if "__pycache__" in name:
            place = importlib.util.cache_from_source(str(desk / "p" / name.removeprefix("__pycache__/")))
        py_compile.compile(str(desk / "lib" / "source.py"), cfile=str(place), doraise=True)

    return write_it


def linked(folder):
    def write_it(desk):
        write(desk, {"lib/x/y": "", "lib/g": "1.0", "q/x/y": "", "q/g": "1.1", "p/g": "1.0"})
        (desk / "p" / "l").unlink(missing_ok=True)
        (desk / "p" / "l").symlink_to(desk / folder / "x")

    return write_it


def entry(desk):
    (desk / "p" / "_d" / "a").unlink()
    (desk / "p" / "_d" / "a").symlink_to(desk / "p" / "g")


UP = plugin("G = float(open(str(HERE / 'l' / '..' / 'g')).read())", "G")
FILES = {  # what the plugin does, before, after
    "above a link": (UP, linked("lib"), {"lib/g": "1.1"}),
    "above another link": (UP, linked("lib"), linked("q")),
    "a folder added before": (plugin(TWO, "G"), {"l1/a": "", "l2/two_x.py": G1}, {"l1/two_x.py": G2}),
    "a package added before": (plugin(TWO, "G"), {"l1/a": "", "l2/two_x.py": G1}, {"l2/two_x/__init__.py": G2}),
    "byte code alone": (plugin("from pyc_x import G", "G"), byte_code(G1, "pyc_x.pyc"), byte_code(G2, "pyc_x.pyc")),
    "byte code in its folder": (plugin(SOURCELESS, "module.G"), byte_code(G1, "__pycache__/pyc_y.py"),
                                byte_code(G2, "__pycache__/pyc_y.py")),
    "byte code that is read": (plugin(MARSHAL, "G"), lambda desk: [write(desk, {"p/pyc_z.py": G1}),
                               byte_code(G1, "__pycache__/pyc_z.py")(desk)], byte_code(G2, "__pycache__/pyc_z.py")),
    "line ends of data": (plugin("G = len(open(HERE / 'g', 'rb').read())", "G"), {"p/g": b"1\n2"}, {"p/g": b"1\r\n2"}),
    "who may use it": (plugin("G = 1.0 + os.access(HERE / 'g', os.X_OK)", "G"), {"p/g": "1"},
                       lambda desk: (desk / "p" / "g").chmod(0o755)),
    "its mode": (plugin("G = 1.0 + ((HERE / 'g').stat().st_mode & 0o100)", "G"), {"p/g": "1"},
                 lambda desk: (desk / "p" / "g").chmod(0o755)),
    "who may use a folder": (plugin("G = 1.0 + os.access(HERE / '_d', os.W_OK)", "G"), {"p/_d/a": "1"},
                             lambda desk: (desk / "p" / "_d").chmod(0o500)),
    "a folder gone into": (plugin("was = os.getcwd()\nos.chdir(HERE / 'l')\nos.chdir('..')\n"
                                  "G = float(open('g').read())\nos.chdir(was)", "G"), linked("lib"), linked("q")),
    "a link among names": (plugin("G = sum(e.is_symlink() for e in os.scandir(HERE / '_d')) + 1.0", "G"),
                           {"p/_d/a": "1", "p/g": "1"}, entry),
    "asked by a known package": (plugin("import scipy.io\nG = 1.0\nif np.lib.npyio.DataSource(str(HERE)).exists('g'):\n"
                                        "    G = 1.1", "G"), {}, {"p/g": "1"}),
}  # fmt: skip


def do(desk, change):
    write(desk, change) if isinstance(change, dict) else change(desk)


@pytest.mark.parametrize("what", FILES)
def test_a_file_that_is_read_in_a_roundabout_way_is_seen(desk, what):
    text, before, after = FILES[what]
    write(desk, {"p/mine.py": text})
    do(desk, before)
    rows = measured(desk)
    assert again(desk, rows) == ""
    do(desk, after)
    assert again(desk, rows) != ""


@needs_linux
@pytest.mark.parametrize("how", ["a file", "shared memory"])
def test_shared_memory_is_files(desk, how):
    name = f"tcbench_{desk.name}_{os.getpid()}"
    read = {"a file": f"G = float(open('/dev/shm/{name}').read())", "shared memory": (
        f"from multiprocessing import shared_memory\ns = shared_memory.SharedMemory('{name}')\n"
        "G = float(bytes(s.buf[:3]))\ns.close()")}[how]  # fmt: skip
    place = f"/dev/shm/{name}"
    write(desk, {"p/mine.py": plugin(read, "G"), place: "1.0"})
    try:
        rows = measured(desk)
        assert again(desk, rows) == ""
        write(desk, {place: "1.1"})
        assert again(desk, rows) == place
    finally:
        os.unlink(place)


def test_what_is_still_to_be_written_into_a_database_is_of_it(desk):
    base = sqlite3.connect(desk / "p" / "g.db")
    base.execute("pragma journal_mode=wal")
    base.execute("create table t(v)")
    base.commit()
    base.close()
    read = "b = sqlite3.connect(HERE / 'g.db')\nG = 1.0 + len(list(b.execute('select v from t')))\nb.close()"
    write(desk, {"p/mine.py": plugin(read, "G")})
    rows = measured(desk)
    assert again(desk, rows) == ""
    base = sqlite3.connect(desk / "p" / "g.db")
    base.execute("insert into t values(1)")
    base.commit()
    assert again(desk, rows) == "<mine>/g.db"
    base.close()


VARIABLES = {  # variable: what the plugin does, values
    "LOGNAME": ("G = len(os.environ['LOGNAME'])", "a", "bb"),
    "COLUMNS": ("G = float(os.getenv('COLUMNS', '80'))", "80", "90"),
    "MY_G": ("import re\nG = float(re.search(r\"'MY_G': '([0-9.]+)'\", repr(os.environ)).group(1))", "1", "2"),
    "TZ": ("import time\nG = 1.0 + time.timezone", "UTC", "UTC+3"),
    "LC_ALL": ("import locale\nG = len(locale.setlocale(locale.LC_ALL, ''))", "C", "POSIX"),
    "PYTHONWARNINGS": ("", "ignore", "error"),
    "PATH": ("import shutil\nG = 1.0 + (shutil.which('which_x') is None)", "/a", "/b"),
    "USER": ("import getpass\nG = 1.0 + len(getpass.getuser())", "a", "bb"),
    "LANG": ("import locale\nG = 1.0 + len(str(locale.getlocale()))", "C", "POSIX"),
}


@pytest.mark.parametrize("name", VARIABLES)
def test_a_variable_that_python_or_c_reads_for_a_plugin_is_an_input(desk, monkeypatch, name):
    read, before, after = VARIABLES[name]
    monkeypatch.setattr("locale._setlocale", lambda category, value=None: "C")  # this process keeps its own
    monkeypatch.setenv(name, before)
    write(desk, {"p/mine.py": plugin(read, "G" if read else "1.0")})
    rows = measured(desk)
    assert again(desk, rows) == ""
    monkeypatch.setenv(name, after)
    assert again(desk, rows) == ("another key" if name.startswith("PYTHON") else f"the variable {name}")


@pytest.mark.parametrize(("asked", "fact"), [
    ("len(platform.node())", "machine"), ("os.cpu_count()", "machine"), ("len(os.uname().nodename)", "machine"),
    ("len(__import__('socket').gethostname())", "machine"), ("len(os.sched_getaffinity(0))", "cores"),
])  # fmt: skip
def test_what_machine_it_is_is_an_input_where_it_is_asked(desk, monkeypatch, asked, fact):
    if any(name in asked and not hasattr(os, name) for name in ("uname", "sched_getaffinity")):
        pytest.skip("no such function")
    write(desk, {"p/mine.py": plugin(f"import platform\nG = 1.0 + {asked}", "G")})
    rows = measured(desk)
    assert again(desk, rows) == ""
    monkeypatch.setitem(facts.FACTS, f"({fact})", lambda *_: "another")
    assert again(desk, rows) == f"the variable ({fact})"


def test_the_mask_of_new_files_is_an_input_where_it_is_asked(desk):
    before = os.umask(0o022)
    try:
        write(desk, {"p/mine.py": plugin("u = os.umask(0)\nos.umask(u)\nG = 1.0 + u", "G")})
        rows = measured(desk)
        assert again(desk, rows) == ""
        os.umask(0o027)
        assert again(desk, rows) == "the variable (umask)"
    finally:
        os.umask(before)


@needs_linux
@pytest.mark.parametrize(
    ("does", "reason"),
    [
        ("ctypes.CDLL(None).getenv", "C functions of the system were called"),
        ("ctypes.CDLL('libc.so.6').fopen", "C functions of the system were called"),
        ("fd = os.open(HERE / 'ff', os.O_RDWR)\nos.write(fd, b'1')\nos.read(fd, 1)", "a pipe or a device was read"),
        ("with contextlib.suppress(OSError):\n    os.getxattr(HERE, 'user.g')", "attributes of a file were read"),
        ("ctypes.PyDLL.__getitem__(ctypes.pythonapi, 'getenv')", "C functions of the system were called"),
        ("os.path.exists('/dev/nvidia0')", "the state of the machine was read"),
        ("fd = os.open(HERE, os.O_RDONLY)\nopen(f'/dev/fd/{fd}/n').read()", "the state of the machine was read"),
        ("os.statvfs(HERE)", "the state of the machine was read"),
        ("os.sysconf('SC_PHYS_PAGES')", "the state of the machine was read"),
        ("import resource\nresource.getrlimit(resource.RLIMIT_NOFILE)", "the state of the machine was read"),
        ("list(os.fwalk(HERE / 'flat'))", "a file was named by an open folder"),
        ("import socket\nsocket.gethostbyname('127.0.0.1')", "the network was used"),
        ("n = float(open(HERE / 'n').read())\nopen(HERE / 'n', 'r+').write('2')", "<mine>/n changed while it was meas"),
        ("import h5py", "h5py opens files in C"),
        ("sys.modules.pop('cffi', None)\nimport cffi", "cffi opens files in C"),
    ],
)
def test_what_cannot_be_compared_is_measured_each_time(desk, does, reason):
    os.mkfifo(desk / "p" / "ff")
    write(
        desk,
        {"p/mine.py": plugin(does), "p/n": "1", "p/h5py/__init__.py": "", "p/cffi/__init__.py": "", "p/flat/a": ""},
    )
    assert again(desk, measured(desk)).startswith(reason)


def test_who_loads_a_library_of_his_own_may_read_any_variable_in_it(desk, monkeypatch):
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    (desk / "g.c").write_text("double g(void) { return 1; }")
    subprocess.run(["cc", "-shared", "-fPIC", desk / "g.c", "-o", desk / "p" / "libg.so"], check=True)
    write(desk, {"p/mine.py": plugin("L = ctypes.CDLL(str(HERE / 'libg.so'))")})
    rows = measured(desk)
    monkeypatch.setenv("SSH_CONNECTION", "of one login")
    assert again(desk, rows) == ""
    monkeypatch.setenv("MY_G", "2")
    assert again(desk, rows) == "the variable (all variables)"


@pytest.fixture
def site(tmp_path_factory, monkeypatch):
    """A folder of installed packages of this test's own."""
    folder = tmp_path_factory.mktemp("site")
    both = (*marks.SITE, f"{folder}{os.sep}")
    monkeypatch.setattr(sys, "path", [*sys.path, str(folder)])
    for module in (marks, facts, seen, recorder):
        monkeypatch.setattr(module, "SITE", both)
    monkeypatch.setattr(recorder, "INSTALLED", (*marks.INSTALLED, both[-1]))
    marks.distributions_of.cache_clear()
    yield folder
    marks.distributions_of.cache_clear()


def dist(site, version):
    for old in site.glob("own_x-*"):
        shutil.rmtree(old)
    write(site, {f"own_x-{version}.dist-info/METADATA": f"Name: own-x\nVersion: {version}\n"})


VERSION = """
G = 1.0
with contextlib.suppress(metadata.PackageNotFoundError):
    G = float(metadata.version("own-x"))
"""


@pytest.mark.parametrize(
    "asked",
    [VERSION, "G = len(list(metadata.distributions()))", "import pkgutil\nG = len(list(pkgutil.iter_modules()))"],
)
def test_a_package_that_is_installed_later_is_seen(desk, site, asked):
    write(desk, {"p/mine.py": plugin(f"from importlib import metadata\n{asked}", "G")})
    rows = measured(desk)
    assert again(desk, rows) == ""
    dist(site, "1.1")
    assert again(desk, rows) in ("the package own-x", "the variable (packages)")


def test_code_that_python_runs_before_anything_else_is_an_input(desk, site):
    write(desk, {"p/mine.py": plugin()})
    rows = measured(desk)
    write(site, {"only_a_path.pth": "/somewhere\n", "__editable__.of_another.pth": "import of_another\n"})
    assert again(desk, rows) == ""
    write(site, {"patch.pth": "import patch_x\n"})
    assert again(desk, rows) == "the variable (code at start)"


def test_an_editable_install_that_is_made_elsewhere_is_seen(desk, monkeypatch):
    class Finder:
        place = desk / "lib" / "one" / "edit_x.py"

        @classmethod
        def find_spec(cls, name, path=None, target=None):
            if name == "edit_x":
                loader = SourceFileLoader(name, str(cls.place))
                return importlib.util.spec_from_file_location(name, cls.place, loader=loader)
            return None

    write(desk, {"p/mine.py": plugin("from edit_x import G", "G"), "lib/one/edit_x.py": G1, "lib/two/edit_x.py": G2})
    finders = list(sys.meta_path)
    finders.insert(finders.index(PathFinder), Finder)
    monkeypatch.setattr(sys, "meta_path", finders)
    rows = measured(desk)
    assert again(desk, rows) == ""
    Finder.place = desk / "lib" / "two" / "edit_x.py"
    assert again(desk, rows) == "the module edit_x"
