"""Many charts at once: each core draws a share. Drawing is the larger part of the time that a report takes.

The helpers are interpreters of their own that import tcbench and nothing of the caller's script. A helper that fails
costs nothing but time: its share is drawn here.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

from ..cores import usable_cores
from .chart_kinds import find_kind
from .html import png_element, svg_text

WORTH = 10  # charts from which starting a helper pays
MOST = 4  # processes
LARGEST_SVG = 400_000  # bytes as matplotlib writes it; a larger chart becomes a picture


class Job(NamedTuple):
    """A chart to draw: its kind, the tables that it needs, and whether it must be a picture."""

    kind: str
    tables: dict[str, Any]
    picture: bool


class Drawn(NamedTuple):
    """An SVG document or an HTML element, and the width in inches."""

    svg: str
    element: str
    width: float


def draw(job: Job) -> Drawn:
    figure = find_kind(job.kind).draw(job.tables)
    width = float(figure.get_size_inches()[0])
    svg = "" if job.picture else svg_text(figure)
    if job.picture or len(svg) > LARGEST_SVG:
        return Drawn("", png_element(figure), width)
    return Drawn(svg, "", width)


def draw_all(jobs: Sequence[Job]) -> list[Drawn]:
    """The charts in the order of the jobs."""
    count = max(1, min(usable_cores(), MOST, len(jobs) // WORTH + 1))
    shares = [list(jobs[i::count]) for i in range(count)]
    helpers = [_start(share) for share in shares[1:]]
    done = [[draw(job) for job in shares[0]]]
    for helper, share in zip(helpers, shares[1:], strict=True):
        done.append(_finish(helper) or [draw(job) for job in share])
    return [done[i % count][i // count] for i in range(len(jobs))]


def _start(share: list[Job]) -> subprocess.Popen[bytes] | None:
    """A helper with its share; it starts to draw while this process draws its own."""
    command = [sys.executable, "-P", "-c", "from tcbench.report.drawing import serve; serve()"]
    try:
        helper = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    except OSError:
        return None
    assert helper.stdin is not None
    try:
        helper.stdin.write(pickle.dumps([tuple(job) for job in share]))
        helper.stdin.close()
    except OSError:  # it died before it had read its share
        helper.kill()
        helper.wait()
        return None
    helper.stdin = None  # closed: nothing more to send
    return helper


def _finish(helper: subprocess.Popen[bytes] | None) -> list[Drawn] | None:
    if helper is None:
        return None
    output, _ = helper.communicate()
    if helper.returncode:
        return None
    try:
        return [Drawn(*drawn) for drawn in pickle.loads(output)]
    except (pickle.UnpicklingError, EOFError, TypeError):
        return None


def serve() -> None:
    """What a helper does: read jobs, draw them, write the results."""
    out = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    sys.stdout = sys.stderr  # whatever a library prints must not get among the results
    jobs = [Job(*job) for job in pickle.load(sys.stdin.buffer)]
    with out:
        out.write(pickle.dumps([tuple(draw(job)) for job in jobs]))
