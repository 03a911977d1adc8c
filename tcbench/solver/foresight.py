"""What a trace will cost, said before it is paid: measured coefficients times the length of what is traced."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from ..errors import TcbenchError
from ..progress import part
from ..systems.system import System

# of chains and nets, for each number of a state (docs/chain.md)
WHOLE = (7e-3, 0.14)  # seconds and MB to trace and compile as a whole
LOOPS = (3e-5, 5e-3)  # in loops over the elements
SHORT = 2.0  # seconds that need no word
SPARE = 0.8  # of the machine's memory


@contextmanager
def foreseen(system: System, copies: int, by_loops: bool) -> Iterator[None]:
    """Say what is about to take long while it does; TcbenchError for what does not fit into memory.

    copies: states that a formula works with, its stages.
    """
    seconds, megabytes = (x * system.size * copies for x in (LOOPS if by_loops else WHOLE))
    room = _memory()
    if room is not None and megabytes > SPARE * room:
        more = "a smaller one is needed" if by_loops else (
            "declare its elements (tcbench.Network, docs/add-system.md): they are then traced one for all"
        )  # fmt: skip
        raise TcbenchError(
            f"A {system.name} of {system.size} numbers needs about {megabytes / 1024:.0f} GiB to be traced "
            f"{'element by element' if by_loops else 'as a whole'}, and this machine has {room / 1024:.0f}: {more}."
        )
    if seconds < SHORT:
        yield
        return
    with part(f"tracing {system.size} numbers {'in loops' if by_loops else 'as a whole'}, about {seconds:.0f} s"):
        yield


def _memory() -> float | None:
    """The machine's memory, MiB; None where it is not told."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**20
    except (AttributeError, ValueError, OSError):
        return None
