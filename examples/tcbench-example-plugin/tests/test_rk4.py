"""The plugin keeps the contract."""

import subprocess
import sys


def test_the_plugin_passes_tcbench_check():
    done = subprocess.run([sys.executable, "-m", "tcbench", "check", "example_rk4"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
