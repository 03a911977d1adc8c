"""Object files: their cache, what becomes of damaged ones and on a full disk, the processor that is compiled for."""

import errno
import os
import subprocess
import sys

import numpy as np
import pytest

import tcbench
from tcbench import TcbenchError
from tcbench import cache as files
from tcbench.compiler import calls, language, machine
from tcbench.compiler.kernels import _code
from tcbench.compiler.library import evaluate

pytestmark = pytest.mark.skipif(language.PLAIN, reason="nothing is compiled")
TEXT = "def kernel(a, b, out):\n    out[2] = a[0] + 3.25\n"


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache, and a count of what is compiled."""
    calls.native()  # from the usual cache
    machine._compiler()
    monkeypatch.setenv("TCBENCH_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(machine, "_LOADED", {})
    made, compile_object = [], machine.compile_object
    monkeypatch.setattr(machine, "compile_object", lambda *args: made.append(args) or compile_object(*args))
    return tmp_path / "cache" / "code", made


def result():
    out = np.zeros(3)
    evaluate(machine.load(TEXT, _code), np.ones(1), np.ones(1), out)
    return out.tolist()


def test_machine_code_is_kept_and_used_again(cache):
    folder, made = cache
    assert result() == [0.0, 0.0, 4.25] and len(made) == 1
    machine._LOADED.clear()
    assert result() == [0.0, 0.0, 4.25] and len(made) == 1
    (path,) = folder.iterdir()
    assert path.suffix == ".o" and files.read("code", path.name)


DAMAGE = {
    "truncated": lambda data: data[: len(data) // 2],
    "cut by a byte": lambda data: data[:-1],
    "longer": lambda data: data + b"\0",
    "a flipped bit in the code": lambda data: data[:-40] + bytes([data[-40] ^ 1]) + data[-39:],
    "a flipped bit in the checksum": lambda data: data[:20] + bytes([data[20] ^ 128]) + data[21:],
    "another seal": lambda data: b"tcbench file 0\n" + data[15:],
    "empty": lambda data: b"",
    "random": lambda data: np.random.default_rng(1).bytes(len(data)),
    "zeros": lambda data: bytes(len(data)),
    "text": lambda data: b"<html>not found</html>",
}


@pytest.mark.parametrize("what", DAMAGE)
def test_a_damaged_object_file_is_compiled_again_never_run(cache, what):
    folder, made = cache
    result()
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    path.write_bytes(DAMAGE[what](whole))
    machine._LOADED.clear()
    assert result() == [0.0, 0.0, 4.25] and len(made) == 2
    assert path.read_bytes() == whole and list(folder.iterdir()) == [path]


def test_a_full_disk_is_one_sentence(cache, monkeypatch):
    folder, _ = cache
    result()
    (path,) = folder.iterdir()
    path.unlink()

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", full)
    machine._LOADED.clear()
    with pytest.raises(TcbenchError, match=r"No space left on device.*TCBENCH_CACHE_DIR"):
        result()
    assert not list(folder.iterdir())  # no half-written file stays
    monkeypatch.undo()


def test_code_that_lacks_a_function_is_refused_never_called(cache):
    """Address 0 was called: a segmentation fault."""
    with pytest.raises(TcbenchError, match=r"lacks other.*tcbench cache clear"):
        machine.addresses(["kernel", "other"], lambda: _code(TEXT))


WAY = {"integrator": "tc_strang", "scenario": "short_term", "t_end": 6.0}
CODE = f"""import tcbench; from tcbench.compiler import machine
print(*machine.target()[:1], *(x.hex() for x in tcbench.simulate(**{WAY}).z[-1]))
"""


@pytest.mark.parametrize(
    "asked", ["x86-64", *(pytest.param(f"x86-64-v3{f}", marks=pytest.mark.thorough) for f in ("", ":-fma"))]
)
def test_another_processor_may_be_compiled_for(asked):
    import platform

    if platform.machine().lower() not in ("x86_64", "amd64"):
        pytest.skip("these are x86 processors")
    env = os.environ | {"TCBENCH_TARGET": asked}
    done = subprocess.run([sys.executable, "-c", CODE], env=env, capture_output=True, text=True, check=True)
    name, *numbers = done.stdout.split()
    assert name == asked.partition(":")[0]
    here, there = tcbench.simulate(**WAY).z[-1], np.array([float.fromhex(x) for x in numbers])
    np.testing.assert_allclose(there, here, rtol=1e-11, atol=1e-11)  # products are fused with sums, or not


def test_a_processor_that_does_not_exist_is_one_sentence():
    env = os.environ | {"TCBENCH_TARGET": "z80"}
    done = subprocess.run([sys.executable, "-m", "tcbench", "simulate", "tc_strang", "short_term"], env=env,
                          capture_output=True, text=True)  # fmt: skip
    assert done.returncode == 2 and "no processor known here: 'z80'" in done.stderr and "Traceback" not in done.stderr
