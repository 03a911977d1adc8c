"""A desk with folders of plugins on which a worker's side is played: a row is made, and is it used again?"""

import json
import os
import sys
import textwrap
from unittest.mock import patch

import tcbench
from tcbench import plugins
from tcbench.engine.child import given
from tcbench.runner.plan import plan_job
from tcbench.engine.reuse import Reuse
from tcbench.inputs import watching
from tcbench.loading import files
from tcbench.store.rows import Rows

HEAD = """
import contextlib, ctypes, importlib, io, json, os, pathlib, sqlite3, sys
import numpy as np
from tcbench import Integrator, hookimpl
HERE = pathlib.Path(__file__).parent
"""
TAIL = """
def step(z, h, system):
    return z + h * {use} * system.vector_field(z)
@hookimpl
def tcbench_integrators():
    return [Integrator(name="{name}", order=1, source="x", step=step{extra})]
"""


def plugin(before="", use="1.0", name="mine", extra=""):
    return HEAD + textwrap.dedent(before) + TAIL.format(use=use, name=name, extra=extra)


def forget(folder):
    """As in a process of its own: nothing of the folder has been imported."""
    watching.end()
    plugins.forget()
    files.forget_helpers()
    for name, module in list(sys.modules.items()):
        places = [getattr(module, "__file__", None) or "", *map(str, getattr(module, "__path__", ()))]
        if any(place.startswith(str(folder)) for place in places):
            del sys.modules[name]
    sys.path[:] = [p for p in sys.path if not p.startswith(str(folder))]


def planned(desk, name="mine"):
    forget(desk)
    plugins.use_folders([folder for folder in (desk / "p", desk / "q") if any(folder.iterdir())])
    plugins.registry()  # so that no other process plans
    return plan_job([name], ["short_term"], ["conservation"], dt=[0.3])


def measured(desk, name="mine"):
    """The rows of a run: what a worker would note is noted here."""
    job = planned(desk, name)
    forget(desk)
    with patch.dict(os.environ, given(), clear=True):
        plugins.use_index(job.context["index"])
        method = plugins.find_integrator(name)
        model = tcbench.scenarios()["short_term"].model
        method.step(model.state(tcbench.scenarios()["short_term"].z0), 0.1, model)
        identity, text = watching.recorder().collected()
        watching.end()
    rows, cell = Rows(), job.cells[0]
    rows.append(cell.key, {"status": "ok", "inputs": identity, "_inputs": json.loads(text)}, cell.as_dict())
    return rows


def again(desk, rows, name="mine"):
    """Why the row is not used again; "" if it is."""
    job = planned(desk, name)
    forget(desk)  # another process plans
    cell = job.cells[0]
    if cell.key not in rows.rows():
        return "another key"
    return Reuse(rows, job.context).reason(cell, rows.rows()[cell.key])


def write(desk, files):
    for name, text in files.items():
        path = desk / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text) if isinstance(text, bytes) else path.write_text(text)
