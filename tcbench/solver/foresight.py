"""Cost estimates for large systems: seconds and memory of tracing and stepping, told before they are spent.

Measured coefficients times the length of what is to be done or, where a method chooses its steps, the time that it took
so far. The coefficients are those of chains, nets and bars on one machine (docs/chain.md); an estimate is right within
a factor of two or three, so that only what is far beyond a limit is refused.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..compiler.polling import END, LEFT, TIME, raise_again, watch_by
from ..errors import MachineError
from ..progress import Meter, part
from ..systems.system import System

if TYPE_CHECKING:
    from .kernels_of_flow import FlowKernels

Floats = NDArray[np.float64]
# to trace and compile, seconds and MB for each number of a state: in loops over the elements, and as a whole, where
# these are the seconds for each square of theirs
LOOPS = (3e-5, 5e-3)
WHOLE = (8e-5, 0.14)
TERM = 2e-5  # MB for each entry that the terms of a sparse Jacobian have, of which many are added up in one
# seconds a step for each entry of a sparse Jacobian: assembly and solution, and incomplete factors, each entry of which
# meets its row
ENTRY, MEETING = 2.5e-8, 1e-9
SHORT = 2.0  # seconds that need no word
UNTOLD = 2000  # steps of a small system that are over before anyone could be told of them
SPARE = 0.8  # of the memory there is
CERTAIN = 2.0  # a prediction as many times what is left of a time limit is no mistake
# Of a run that chooses its steps: numbers of its state times steps before the first look, seconds from one look to the
# next, of which one takes a microsecond, and by how much that may be longer or shorter than the last; seconds from one
# word about it to the next.
FIRST, AIM, MOST_FASTER, LOOK = 10_000, 0.01, 10.0, 0.1
SHARE = 0.005  # of its time that such a run has covered when its rest is told
NO_RATES = (
    "where a motion sticks (dry friction) or slides along one, or the energy jumps, they lead nowhere; make the change "
    "smooth, as tanh(v/v0) does for sign(v)"
)
CGROUP = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")

_limit: tuple[float, float] | None = None  # what the work under way may take, seconds, and when that is over


@contextmanager
def within(seconds: float | None) -> Iterator[None]:
    """Work that may take so long, from now on; None: as long as it likes."""
    global _limit
    outer, _limit = _limit, None if seconds is None else (seconds, time.monotonic() + seconds)
    try:
        yield
    finally:
        _limit = outer


@contextmanager
def foreseen(system: System, copies: int, by_loops: bool) -> Iterator[None]:
    """Say what is about to take long while it does; MachineError for what does not fit into memory or a time limit.

    copies: states that a formula works with, its stages.
    """
    count = system.size * copies
    seconds, megabytes = (x * count for x in (LOOPS if by_loops else WHOLE))
    seconds *= 1 if by_loops else count
    cure = "a smaller one is needed"
    if not by_loops:
        cure = "declare its spaces (docs/add-system.md): formulas are then traced on arrays"
    what = "to be traced " + ("element by element" if by_loops else "as a whole")
    _fits(f"A {system.name} of {system.size} numbers", megabytes, what, cure)
    _affordable(f"Tracing a {system.name} of {system.size} numbers", seconds, cure)
    if seconds < SHORT:
        yield
        return
    with part(f"tracing {system.size} numbers {'in loops' if by_loops else 'as a whole'}, about {seconds:.0f} s"):
        yield


def jacobian_fits(numbers: int, entries: int) -> None:
    """MachineError where the terms of a sparse Jacobian, which have so many entries, do not fit into memory."""
    cure = "a smaller system, or fewer points in each element, is needed"
    _fits(f"A step of {numbers} unknowns", numbers * LOOPS[1] + entries * TERM, "for its Jacobian", cure)


def _fits(who: str, megabytes: float, what: str, cure: str) -> None:
    room = memory()
    if room is not None and megabytes > SPARE * room:
        raise MachineError(
            f"{who} needs about {_gigabytes(megabytes)} {what}, and there are {_gigabytes(room)}: {cure}."
        )


def of_steps(system: System, each: float, steps: int) -> str:
    """What to say of a run of so many steps, each so many seconds, while it lasts, "" of a short one; MachineError as
    above."""
    if steps * each < SHORT:
        return ""
    what = f"{steps} steps of about {1e3 * each:.2g} ms"
    cure = "take fewer steps (a longer dt, a shorter t_end) or a smaller system"
    _affordable(f"{what} of a {system.name} of {system.size} numbers", steps * each, cure)
    return f"{what}, {steps * each:.0f} s"


class Lending:
    """A method whose record, `work`, has `rows`, `times`, `states` and `watch`; these are lent to it, for a call that
    passes arrays takes two microseconds more. Its loop asks `compiler.polling.to_end` before each step.
    """

    work: Any
    size: int
    looks: Looks
    times: Floats
    states: Floats
    first: Floats  # of the states

    def lend_to(self, work: Any, system: System) -> None:
        """Of states of this system."""
        self.work, self.size, self.looks = work, system.size, Looks(system.size)
        self.times, self.states, self.first = np.empty(0), np.empty((0, self.size)), np.empty(0)
        work.lend("watch", self.looks.watch)

    def begin(self, z0: Floats, times: Floats) -> None:
        """The next run of the record goes from z0 through these times, to `states`."""
        if self.looks.watch[END]:  # one was interrupted, and then the end of it
            with suppress(KeyboardInterrupt, MachineError):
                self.looks.end()
        if len(times) != len(self.times):
            self.times, self.states = np.empty(len(times)), np.empty((len(times), self.states.shape[1]))
            self.work.rows = len(times)
            self.work.lend("times", self.times)
            self.work.lend("states", self.states)
            self.first, self.looks.times = self.states[0], self.times
        self.times[...] = times  # two thirds of the time of [:]
        self.first[...] = z0

    def ended(self, reached: bool, course: Any) -> Floats:
        """The states of a run that has ended; where it did not reach the last time but `course.t`, ArithmeticError with
        those up to there as `states`."""
        if self.looks.begun or not reached:
            self.looks.end()
        if not reached:
            kinks = f": its rates have kinks, or change as fast, and {NO_RATES}" if self.work.n_kinks else ""
            failed = ArithmeticError(f"the step became too short at t = {course.t:.6g}{kinks}")
            vars(failed)["states"] = self.states[: np.searchsorted(self.times, course.t, "right")].copy()
            raise failed
        return self.states.copy()


class Looks:
    """Looks at the runs of a method that chooses its steps, by the compiled loop itself: an interrupt ends it; and once
    it is no longer short, how far it is shows, and its rest by the rate until then.
    """

    def __init__(self, size: int) -> None:
        self.first = 1.0 + FIRST / size
        self.watch, self.times = watch_by(self, self.first), np.empty(0)
        self.begun = self.last = self.steps = 0.0  # when the first look was and the last one, and steps between two
        self.open, self.told = ExitStack(), 0.0
        self.meter: Meter | None = None

    def __bool__(self) -> bool:
        """A look; it ends the loop by errors only."""
        now = time.monotonic()
        if not self.begun:
            self.begun, self.told, self.steps = now, now, self.first
        else:
            self.steps *= min(max(AIM / max(now - self.last, 1e-6), 1 / MOST_FASTER), MOST_FASTER)
        if now - self.told > LOOK:
            self.tell(float(self.watch[TIME]), now)
            self.told = now
        self.last, self.watch[LEFT] = now, self.steps
        return False

    def tell(self, t: float, now: float) -> None:
        """How far it is, and its rest."""
        if self.meter is None:
            self.meter = self.open.enter_context(part(""))
            self.meter.total, self.text = len(self.times) - 1, self.meter.text
        self.meter.done = int(np.searchsorted(self.times, t, "right")) - 1
        start, end = self.times[0], self.times[-1]
        rest = (end - t) * (now - self.begun) / (t - start) if t - start > SHARE * (end - start) else 0.0
        if rest > SHORT:
            self.meter.tell(f"{self.text}, from t = {t:.3g} to {end:.6g} about {rest:.0f} s")

    def end(self) -> None:
        """Of a run that has ended: what a look has raised is raised here."""
        try:
            self.open.close()
        finally:
            self.meter, self.watch[LEFT] = None, self.first
            try:
                raise_again(self.watch)
            finally:
                self.begun = 0.0


def seconds_a_step(kernels: Sequence[FlowKernels]) -> float:
    """Of the flows with a sparse Jacobian, at steps of a usual length; 0 for those of small systems."""
    patterns = [k.pattern for k in kernels if k.pattern is not None]
    return sum(p.nnz * (ENTRY + MEETING * p.nnz / p.n) for p in patterns)


def _affordable(what: str, seconds: float, cure: str) -> None:
    """MachineError where this is far beyond what is left of the time limit."""
    if _limit is not None and _beyond(seconds):
        allowed, end = _limit
        raise MachineError(
            f"{what} takes about {seconds:.0f} s, and {max(0.0, end - time.monotonic()):.0f} s are left of the "
            f"{allowed:g} s that a cell has: give a longer --timeout, or {cure}."
        )


def _beyond(seconds: float) -> bool:
    return _limit is not None and seconds > CERTAIN * max(0.0, _limit[1] - time.monotonic())


def memory() -> float | None:
    """What this process may have, MiB: of the machine, of its control group, of its own limit; None where unknown."""
    found: list[float] = []
    with suppress(AttributeError, ValueError, OSError):
        found.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    for path in CGROUP:
        with suppress(OSError, ValueError):
            found.append(float(Path(path).read_text(encoding="ascii")))  # "max": no limit
    with suppress(ImportError):
        import resource

        own = resource.getrlimit(resource.RLIMIT_AS)[0]
        found += [own] if own != resource.RLIM_INFINITY else []
    return min(found) / 2**20 if found else None


def _gigabytes(megabytes: float) -> str:
    return f"{megabytes / 1024:.2g} GiB" if megabytes < 10240 else f"{megabytes / 1024:.0f} GiB"
