"""The author's formula of a flow, called on symbols: its further arguments, and sentences on what cannot be traced."""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..compiler import derivatives as trace
from ..compiler.derivatives import Symbol
from ..compiler.ops import OPERATIONS
from ..compiler.repeats import REMEDY, same_again
from ..errors import TcbenchError, TraceError, misnamed
from ..integrator import Flow, Residual
from ..systems.system import System


def further(flow: Flow, system: System, z0: Any, h: Symbol, start: Any) -> list[Any]:
    """The last arguments of a formula: states at the start of the step and the run, and what corrections have moved; or
    states of earlier steps.

    Of an earlier state what is known is its slope, v = (state - z0)/h of the whole step: as z0 + h v it comes to z0
    when a solver follows the root from h = 0.
    """
    known = [] if flow.chosen is None else [flow.chosen]
    if flow.of_step:
        return [*(system.state(z) for z in start), *known]
    states = (system.state(z0 + h * v) for v in start)
    return [*([tuple(system.in_variables(flow.variables, z) for z in states)] if flow.memory else []), *known]


def numbered(flow: Flow, found: Any) -> tuple[Any, list[Symbol]]:
    """What a formula returns, and the equations of its further numbers."""
    if not flow.numbers:
        return found, []
    rows, equations = found
    return rows, [trace.lifted(x) for x in equations]


def has_roots(rows: Sequence[Symbol]) -> bool:
    """May these be finite where a slope of theirs is not?"""
    return any(x.op in OPERATIONS and OPERATIONS[x.op].rooted for x in trace.topological(rows))


def checked_rows(flow: Flow, rows: list[Symbol], d: Sequence[Symbol]) -> list[Symbol]:
    """The rows; TraceError where there is an infinite number in them, or nothing of d = z1 - z0."""
    if any(x.op == "const" and np.isinf(x.value) for x in trace.topological(rows)):
        raise TraceError(
            f"{_file(flow.residual)}: the residual {flow.residual.__name__!r} contains an infinite number, so that no "
            "state solves it. Look for inf, and for numbers that overflow."
        )
    reads = trace.depends_on(rows, d)
    if rows and not any(row.number in reads for row in rows):
        raise TraceError(
            f"{_file(flow.residual)}: the residual {flow.residual.__name__!r} does not depend on z1. Return what is 0 "
            "where z1 is the new state, such as z1 - z0 - h * f(z0), and not the new state itself."
        )
    return rows


_NOT_NUMPY = " Formulas are branch-free numpy on symbols; for what calls LAPACK or SciPy use step= instead of flows=."


def called(flow: Flow, arguments: Sequence[Any]) -> Any:
    """What the author's formula returns for these arguments, symbols among them; one sentence where it cannot."""
    function = flow.residual
    try:
        found = function(*arguments)
        again = same_again(found, lambda: function(*arguments))
    except TcbenchError:
        raise
    except Exception as error:  # numpy and Python refuse symbols with errors of their own
        frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == _file(function)]
        if not frames and (wanted := _other_arguments(flow, arguments)):
            raise TraceError(wanted) from error
        where = f"{Path(frames[-1].filename).name}, line {frames[-1].lineno}: " if frames else ""
        remedy = "" if isinstance(error, AttributeError | NameError) else _NOT_NUMPY
        raise TraceError(
            f"{where}the residual {function.__name__!r} cannot be traced: {misnamed(error)}.{remedy}"
        ) from error
    if not again:
        where = f"{_file(function)}: the residual {function.__name__!r}"
        raise TraceError(f"{where}, or a formula that it reads, {REMEDY}.")
    return found


def _other_arguments(flow: Flow, arguments: Sequence[Any]) -> str:
    """A sentence where the author's function takes other arguments than a residual is given, else ""."""
    try:
        taken = inspect.signature(flow.residual)
        taken.bind(*arguments)
    except ValueError:  # of a builtin
        return ""
    except TypeError:
        names = {
            "stages": flow.stages, "start": flow.of_step, "first": flow.of_step, "moved": flow.most > 1,
            "before": flow.memory, "numbers": flow.numbers, "chosen": flow.chosen is not None,
        }  # fmt: skip
        further = [name for name, told in names.items() if told]
        given = ", ".join(["z0", "z1", "h", "system", *further])
        return f"{_file(flow.residual)}: the residual {flow.residual.__name__!r} takes ({given}); yours takes {taken}."
    return ""


def _file(function: Residual) -> str:
    return getattr(getattr(function, "__code__", None), "co_filename", "")
