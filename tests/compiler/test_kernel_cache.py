"""The compile cache: kernels are reused across processes, and an edit of a helper changes the answer."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2]
PRINT = (
    "import tcbench; from tcbench.compiler import machine, special; "
    "run = tcbench.simulate('tc_monolithic', 'short_term', t_end=0.3); "
    "print(machine.sources_hash(), special.phi(0.1), run.energy[-1])"
)


def run(code, folder, cache):
    """Run code with a copy of the sources first on the path."""
    env = os.environ | {"PYTHONPATH": str(folder), "TCBENCH_CACHE_DIR": str(cache), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run([sys.executable, "-P", "-c", code], env=env, capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_editing_a_helper_changes_the_answer_and_not_editing_it_reuses_the_cache(tmp_path):
    shutil.copytree(PACKAGE / "tcbench", tmp_path / "copy" / "tcbench", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(PACKAGE / "plugins", tmp_path / "copy" / "tcbench_plugins")
    cache = tmp_path / "cache"
    first = run(PRINT, tmp_path / "copy", cache)
    compiled = {p: p.stat().st_mtime_ns for p in cache.rglob("*.o")}
    assert {p.name.partition("_")[0] for p in compiled} == {"loops", "kernel"}
    assert run(PRINT, tmp_path / "copy", cache) == first
    again = {p: p.stat().st_mtime_ns for p in cache.rglob("*.o")}
    assert again == compiled  # nothing was compiled again

    helper = tmp_path / "copy" / "tcbench" / "compiler" / "special.py"
    helper.write_text(helper.read_text().replace("1.0 + x *", "1.001 + x *"))
    edited = run(PRINT, tmp_path / "copy", cache)
    assert edited[0] != first[0]
    assert abs(float(edited[1]) - float(first[1]) - 0.001) < 1e-9
    assert edited[2] != first[2]  # the kernels, which call the helper from other files, noticed
    assert len({p.parent for p in cache.glob("kernels-*")}) == 1 and len(list(cache.glob("kernels-*/*.o"))) > 0


def test_every_numerical_source_is_part_of_the_key(tmp_path, monkeypatch):
    """Also a new file, a renamed one and one in a plugin's folder; a package that is missing is an error."""
    from tcbench import TcbenchError
    from tcbench.compiler import machine

    shutil.copytree(PACKAGE / "tcbench", tmp_path / "tcbench", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(machine, "__file__", str(tmp_path / "tcbench" / "compiler" / "machine.py"))
    plain = machine.sources_hash.__wrapped__
    before = plain()
    sources = machine.numerical_sources()
    imported = {"newton.py", "special.py", "flow_kernels.py", "system.py", "compiled_loop.py", "divided_differences.py"}
    assert {path.name for path in sources} >= imported and len(sources) > 25
    for path in sources:
        text = path.read_bytes()
        path.write_bytes(text + b"\n")
        assert plain() != before, path
        path.write_bytes(text)
    assert plain() == before
    moved = sources[1].rename(sources[1].with_name("renamed.py"))
    assert plain() != before
    moved.rename(sources[1])
    (tmp_path / "plugin").mkdir()
    (tmp_path / "plugin" / "loops.py").write_text("a = 1\n")
    with_plugin = plain(tmp_path / "plugin")
    (tmp_path / "plugin" / "loops.py").write_text("a = 2\n")
    assert len({before, with_plugin, plain(tmp_path / "plugin")}) == 3
    for part in ("", "one", "two"):  # parts of a package use each other: the key of either follows both
        (tmp_path / "pack" / part).mkdir()
        (tmp_path / "pack" / part / "__init__.py").write_text("def f(): pass\n")
    scope: dict = {}
    file = tmp_path / "pack" / "one" / "__init__.py"
    exec(compile(file.read_text(), str(file), "exec"), scope)
    package = plain(machine.plugin_folder(scope["f"]))
    (tmp_path / "pack" / "two" / "loops.py").write_text("a = 1\n")
    assert plain(machine.plugin_folder(scope["f"])) != package
    shutil.rmtree(tmp_path / "tcbench" / "solver")
    with pytest.raises(TcbenchError, match="'solver' has no sources"):
        plain()
