"""Diagnosis of a failed step: which quotient of the author's formula is 0/0 at z1 = z0, where Newton starts."""

from __future__ import annotations

import traceback
from pathlib import Path
from typing import Any

import numpy as np

from ..integrator import Flow
from ..systems.system import System
from .kernels_of_flow import FlowKernels, constants

REMEDY = (
    "Write the quotient with tcbench.building_blocks (divided_difference, phi, log1p_ratio), which has its value there"
)
SHORTER = 2.0**-20  # of the step


def finite_at_rest(kernels: FlowKernels, memory: int, system: System, z: Any, h: float) -> bool:
    """Has the compiled formula its value and its derivatives at z1 = z0 = z? Then it divides nothing by 0 there, and a
    run on plain numbers, which takes a thousand times as long, has nothing to find."""
    further = [np.zeros(memory * len(z))] if memory else [z, z, np.zeros(len(z))]
    w = kernels.prepared(z, constants(system, h, np.ones(len(system.variables)), *further))
    still = np.zeros(max(1, kernels.n_unknowns))
    return bool(np.all(np.isfinite(kernels.linear(w, still))) and np.all(np.isfinite(kernels.finish(w, still))))


def zero_over_zero(flow: Flow, system: System, z: Any, h: float) -> str:
    """Where the formula divides 0 by 0 at z1 = z0 = z: "file, line N", or "" if it does not.

    The formula is run on plain numbers, at h and at a much shorter step: a quotient of differences is 0/0 at both, what
    has overflowed is not. One that cannot be run on them is not judged here.
    """
    return _invalid(flow, system, z, h) and _invalid(flow, system, z, h * SHORTER)


def _invalid(flow: Flow, system: System, z: Any, h: float) -> str:
    """Where a division on plain numbers has no value: "file, line N", or ""."""
    states = [system.in_variables(flow.variables, np.array(z)) for _ in range(2 + flow.stages + flow.memory + 2)]
    arguments: list[Any] = [*states[:2], h, system]
    arguments += [states[2 : 2 + flow.stages]] if flow.stages else []
    arguments += [tuple(states[-flow.memory :])] if flow.memory else states[-2:] if flow.of_step else []
    arguments += [np.zeros(len(z))] * (flow.most > 1)
    try:
        with np.errstate(all="ignore", invalid="raise", over="raise"):
            flow.residual(*arguments)
    except (FloatingPointError, ZeroDivisionError) as error:
        if "divi" not in str(error):  # overflow; infinity less infinity, the logarithm of a negative number
            return ""
        frames = traceback.extract_tb(error.__traceback__)
        own = [f for f in frames if f.filename == flow.residual.__code__.co_filename]
        return f"{Path(own[-1].filename).name}, line {own[-1].lineno}" if own else ""
    except Exception:
        return ""
    return ""
