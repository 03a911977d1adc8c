"""What the machine does to a run is not the methods' fault: full disks, damaged caches, other processors."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import tcbench
from tcbench import Integrator, cache
from tcbench.runner.rows import Store

SCRIPT = Path(sys.executable).with_name("tcbench")
BOOKKEEPING = ("cell_time_s", "wall_time_s", "shared_runs", "us_per_step", "shuffle_order", "samples")


def run(folder, out, *words, methods=("tc_monolithic", "tc_gauss"), cache, **environment):
    chosen = [word for name in methods for word in ("-i", name)]
    command = [SCRIPT, "run", *chosen, "-s", "short_term", "--study", "conservation", "--dt", "0.3", "-o", out, *words]
    env = os.environ | {"TCBENCH_CACHE_DIR": str(cache), **environment}
    return subprocess.run(list(map(str, command)), cwd=folder, env=env, capture_output=True, text=True)


def rows(folder):
    return {line["cell"]["integrator"]: line["row"] for line in Store.read(folder).raw()}


def lasting(folder):
    return {name: repr({k: v for k, v in row.items() if k not in BOOKKEEPING}) for name, row in rows(folder).items()}


def step(z, h, system):
    return z


def test_a_full_disk_is_no_final_row(tmp_path, monkeypatch):
    import errno

    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    def failing(z, h, system):
        return cache.write("code", "0" * 64 + ".o", b"")

    methods = [Integrator(name="mine", order=1, step=failing)]
    fine = Integrator(name="mine", order=1, step=step)  # compiles all that a run needs, beside the failing step
    tcbench.run([fine], ["short_term"], ["conservation"], tmp_path / "fine", dt=[0.3])
    with monkeypatch.context() as patch:
        patch.setattr(cache, "replacing", full)
        first = tcbench.run(methods, ["short_term"], ["conservation"], tmp_path / "out", dt=[0.3])
    row = rows(tmp_path / "out")["mine"]
    assert row["exception_type"] == "MachineError" and "Make room there" in row["failure"]
    assert first.summary.statuses == {"exception": 1}
    again = tcbench.run(methods, ["short_term"], ["conservation"], tmp_path / "out", dt=[0.3])
    assert again.summary.run == 1


def damages(content):
    """Ways in which a file may be damaged: cut, empty, a bit flipped, eight bytes, noise, other text."""
    middle = len(content) // 2
    yield from (b"", content[:middle], content[:-1], b"\0" * len(content), b"no such thing")
    yield content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
    yield content[:middle] + b"\xff" * 8 + content[middle + 8 :]


@pytest.mark.slow
def test_a_damaged_cache_heals(tmp_path):
    """Every file of the cache, damaged in each way at once: the same bits again, and no crash."""
    cache = tmp_path / "cache"
    assert run(tmp_path, "clean", cache=cache).returncode == 0
    files = [path for path in cache.rglob("*") if path.is_file()]
    assert files
    originals = {path: path.read_bytes() for path in files}
    for number in range(7):
        for path, content in originals.items():
            path.write_bytes(list(damages(content))[number])
        done = run(tmp_path, f"damaged{number}", cache=cache)
        assert done.returncode == 0, done.stderr
        assert lasting(tmp_path / f"damaged{number}") == lasting(tmp_path / "clean"), number
