"""Plugin files that harm everybody: each ends as a sentence with its name, and the others are as before."""

import builtins
import json
import os
import sys

import numpy as np
import pytest

import tcbench
from tcbench import plugins
from tcbench.loading import guarded

UNIX = pytest.mark.skipif(sys.platform == "win32", reason="signals and descriptors of Unix")
HARMFUL = {
    "it did not end": "while True:\n    try:\n        sum(range(1000))\n    except Exception:\n        pass",
    "it sleeps": "import time\ntime.sleep(1000)",
    "json": "import json\njson.dumps = lambda *a, **k: 'nothing'",
    "os": "import os\nos.replace = None",
    "builtins": "import builtins\nbuiltins.len = lambda x: 0",
    "its hook": (
        "import json\nimport tcbench\n@tcbench.hookimpl\ndef tcbench_metrics():\n    json.loads = None\n    return []"
    ),
    "descriptors": "import os\nos.closerange(0, 3)",
}
SAID = {
    "it did not end": "did not end within", "it sleeps": "did not end within", "json": "it replaces json.dumps",
    "os": "it replaces os.replace", "builtins": "it replaces builtins.len", "its hook": "it replaces json.loads",
    "descriptors": "closes standard",
}  # fmt: skip


@pytest.fixture
def loaded(tmp_path, monkeypatch):
    """What is said of a file of this text, beside a good one."""
    monkeypatch.setattr(guarded, "IMPORT_S", 1.0)
    monkeypatch.setattr(guarded, "AGAIN_S", 0.2)

    def load(text):
        (tmp_path / "good.py").write_text("import numpy\n")
        (tmp_path / "harm.py").write_text(text)
        plugins.use_folders([tmp_path])
        return {o.path.rsplit("/", 1)[-1]: o.reason for o in plugins.registry().origins.values()}

    yield load
    plugins.use_folders([])


@UNIX
@pytest.mark.parametrize("kind", HARMFUL)
def test_a_file_that_harms_all_is_named_and_undone(kind, loaded):
    before = json.dumps, json.loads, os.replace, builtins.len
    found = loaded(HARMFUL[kind])
    assert SAID[kind] in found["harm.py"] and found["good.py"] == ""
    assert (json.dumps, json.loads, os.replace, builtins.len) == before
    assert "tc_monolithic" in tcbench.integrators()


@UNIX
def test_an_alarm_and_numpys_settings_of_a_file_end_with_it(loaded):
    import signal

    settings, handler = np.geterr(), signal.getsignal(signal.SIGALRM)
    assert loaded("import signal, numpy\nsignal.alarm(1000)\nnumpy.seterr(all='raise')")["harm.py"] == ""
    assert np.geterr() == settings and signal.getsignal(signal.SIGALRM) is handler
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
