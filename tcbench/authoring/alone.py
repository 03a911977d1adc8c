"""One run of a plugin's method in a process of its own, for `tcbench check`; not for people.

    python -m tcbench.authoring.alone FOLDER JOB

The file FOLDER/ready says that tcbench is loaded and compiled, so that what is left is the plugin's own;
FOLDER/row.json is the answer: status and failure.
"""

from __future__ import annotations

import contextlib
import json
import sys
from pathlib import Path
from typing import Any

from ..errors import TcbenchError


def main(folder: Path, job: dict[str, Any]) -> None:
    """job: plugin folders, integrator, scenario (names), and settings of simulate."""
    from .. import plugins
    from ..simulation.run import simulate

    plugins.use_folders(job["folders"])
    scenario = plugins.find_scenario(job["scenario"])
    with contextlib.suppress(TcbenchError):  # of a system that the built-in methods are not for
        simulate("tc_monolithic", scenario, t_end=scenario.dt)
    (folder / "ready").touch()
    run = simulate(job["integrator"], scenario, **job["settings"])
    (folder / "row.json").write_text(json.dumps({"status": run.status, "failure": run.failure}))


if __name__ == "__main__":
    try:
        main(Path(sys.argv[1]), json.loads(sys.argv[2]))
    except TcbenchError as error:  # a formula that is refused, for instance: the sentence says all
        (Path(sys.argv[1]) / "row.json").write_text(json.dumps({"status": "refused", "failure": str(error)}))
    except Exception as error:
        sys.exit(f"{type(error).__name__}: {error}")
