"""Whole processes: what a user waits for."""

import subprocess
import sys
import tempfile


def python(*arguments):
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True)


class Commands:
    number = 1
    repeat = (3, 10, 20.0)
    warmup_time = 0
    timeout = 300

    def setup(self):
        python("-m", "tcbench", "simulate", "tc_monolithic", "short_term")  # fills the cache of compiled kernels

    def time_import(self):
        python("-c", "import tcbench")

    def time_help(self):
        python("-m", "tcbench", "--help")

    def time_list(self):
        python("-m", "tcbench", "list")

    def time_warm_simulate(self):
        python("-m", "tcbench", "simulate", "tc_monolithic", "short_term")

    def time_run_selection(self):
        with tempfile.TemporaryDirectory() as folder:
            python(
                "-m", "tcbench", "run", "-i", "tc_monolithic", "-i", "midpoint_entropy", "-s", "short_term",
                "--study", "conservation", "--quiet", "-o", f"{folder}/run",
            )  # fmt: skip
