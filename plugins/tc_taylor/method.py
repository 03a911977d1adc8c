"""`TaylorMethod`: the kernels and the compiled march of one order, set up for a system."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcbench import System
from tcbench.compiler import derivatives as trace
from tcbench.compiler.caches import cached, cached_per_system, cached_property
from tcbench.compiler.kernels import Kernel, kernel
from tcbench.solver.foresight import Lending
from tcbench.solver.mending import mending_kernels

from . import on_arrays
from .orders import MOST_ORDER, is_long
from .texts import series_kernels, slopes_kernel

Floats = NDArray[np.float64]
SHORT = 16  # numbers whose slopes at the end of a step are written out: of 70 that takes 4 s to compile
SELDOM = 32  # steps to a mended state: mending takes a fifth of a step, or more


class TaylorMethod(Lending):
    """Taylor steps of one order on one system: fixed ones and adaptive runs. One run at a time has it."""

    def __init__(self, system: System, order: int) -> None:
        self.loops, model, self.series_time = prepared(system, order)
        self.counts = model.counts.again()
        self.tolerance = 0.0  # of the work
        self.reached: Floats | None = None  # where the run has come by marching
        self.lend_to(model.again(counts=self.counts, trials=model.trials.again(), course=model.course.again()), system)

    @cached_property
    def run(self) -> Callable[[], int]:
        """The adaptive march of the work; compiled when it is first asked for: tc_auto has its own."""
        bound: Callable[[], int] = self.loops.bound("run", self.work)
        return bound

    def adaptive(self, z0: Floats, times: Floats, tolerance: float) -> tuple[Floats, dict[str, int]]:
        """States at `times`, shape (len(times), n), and their cost; ArithmeticError where steps become too short."""
        self.begin(z0, times)
        if self.tolerance != tolerance:
            self.tolerance = self.work.tolerance = tolerance
        return self.ended(self.run() == len(times), self.work.course), self.cost()

    def cost(self) -> dict[str, int]:
        """What the last run took."""
        steps, rejected = self.counts.table.tolist()
        return {"steps": steps, "rejected": rejected}

    def step(self, z: Floats, h: float) -> Floats:
        """The state after a step that begins a run: what was there before does not matter."""
        self.reached = None
        z1 = self.march(z, h, 1)[0]
        self.reached = None
        return z1

    def march(self, z: Floats, h: float, count: int) -> Floats:
        """States after up to `count` steps of length h, as many as succeed; ArithmeticError where none does.

        From where the last one of this run ended it goes on: what a run keeps is what it began with, not each part.
        """
        states = np.empty((count, self.size))
        if self.reached is None or not np.array_equal(z, self.reached):
            self.loops.begin(self.work, z)
        done = self.loops.fixed_steps(self.work, h, states)
        self.reached = states[done - 1] if done == count else None
        if done == 0:
            raise ArithmeticError("the series gives no admissible state after this step")
        return states[:done]


@cached_per_system
def prepared(system: System, order: int) -> tuple[Any, Any, float]:
    """What the methods of all runs share: compiled functions, a record that each makes `again`, and the time of the
    series, in operations; 0 of those on arrays."""
    from tcbench.compiler.library import late_address

    from . import damping
    from .march import LOOPS  # LLVM is loaded when something runs, not when plugins are listed
    from .memory import Counts, Course, Trials, Work

    c, elements = system.constant_values, system.defines("element_energy")
    made, setup, series_time = kernels(system.by_arrays if is_long(system) else system.symbolic, order)
    if setup is None:
        made = {name: x.kernel(system.mesh) for name, x in made.items()}
        made["to_state"] = on_arrays.polynomial_kernel(order, system.size)
        made["to_end"] = on_arrays.slopes_kernel(order, system.size)
    given = np.concatenate([c, setup(c, c)]) if setup else c
    n_kinks = (made["to_series"].size - 2) // (order + 1) - system.size
    work = Work(
        size=system.size, order=order, n_kinks=n_kinks, n_given=len(given), given=given, tolerance=0.0, few=0.0,
        n_target=made["to_start"].size, seldom=SELDOM, rows=1,
        **{name: late_address(x) if x.table is not None else x.address for name, x in made.items()},
        counts=Counts(), trials=Trials(), course=Course(), least=np.square(system.state_magnitudes),
        **damping.fields(order if order <= MOST_ORDER or not elements else 0),
    )  # fmt: skip
    return LOOPS, work, series_time


@cached
def kernels(system: System, order: int) -> tuple[dict[str, Any], Kernel | None, float]:
    """Kernels by their names in `memory.Work`, setup and time of the series of all systems of one structure, by
    `System.symbolic`; of one kind, by `by_arrays`, without polynomials, setup and time."""
    elements = system.defines("element_energy")
    with trace.tracing():
        start, mend, hold, fixed = mending_kernels(system)
        y = system.unknowns("y")
        to_z = system.compiled([y], [system.entropy_variables(y) if elements else y])
        to_y = system.compiled([y], [system.temperature_variables(y) if elements else y])
        made = {"to_start": start, "to_mend": mend, "to_hold": hold, "to_z": to_z, "to_y": to_y}
        if system.by_array:
            series, rates = on_arrays.series_kernel(system, order), on_arrays.rates_kernel(system)
            return made | {"to_series": series, "to_rates": rates}, None, 0.0
        first = system.n_constant_values + len(fixed)
        series, polynomial, rates, more, series_time = series_kernels(system, order, first)
        made |= {"to_series": series, "to_state": polynomial, "to_rates": rates}
        made["to_end"] = (slopes_kernel if system.size <= SHORT else on_arrays.slopes_kernel)(order, system.size)
        setup = kernel(system.constant_symbols(), [*fixed, *more])
        return made, replace(setup, seldom=True), series_time
