"""The compile cache: kernels are reused across processes, and an edit of a helper changes the answer."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

PACKAGE = Path(__file__).parent.parent
PRINT = (
    "import tcbench; from tcbench import jit, special; "
    "print(jit.sources_hash(), special.phi(0.1), tcbench.simulate('tc_monolithic', 'short_term', t_end=0.3).energy[-1])"
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
    compiled = {p: p.stat().st_mtime_ns for kind in ("*.nbc", "*.o") for p in cache.rglob(kind)}
    assert {p.suffix for p in compiled} == {".nbc", ".o"}  # loops and kernels
    assert run(PRINT, tmp_path / "copy", cache) == first
    again = {p: p.stat().st_mtime_ns for kind in ("*.nbc", "*.o") for p in cache.rglob(kind)}
    assert again == compiled  # nothing was compiled again

    helper = tmp_path / "copy" / "tcbench" / "special.py"
    helper.write_text(helper.read_text().replace("1.0 + x *", "1.001 + x *"))
    edited = run(PRINT, tmp_path / "copy", cache)
    assert edited[0] != first[0]
    assert abs(float(edited[1]) - float(first[1]) - 0.001) < 1e-9
    assert edited[2] != first[2]  # the kernels, which call the helper from other files, noticed
    assert len({p.parent for p in cache.glob("kernels-*")}) == 1 and len(list(cache.glob("kernels-*/*.o"))) > 0
