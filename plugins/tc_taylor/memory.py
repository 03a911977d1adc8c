"""The workspaces (records) of the Taylor method: every array of a run with its shape."""

from __future__ import annotations

from tcbench.compiler.language import Address, Floats, Matrix
from tcbench.compiler.polling import SIZE  # noqa: F401  (of the shapes)
from tcbench.compiler.records import Record, sized

LAST = 4  # coefficients of a series that are damped


class Counts(Record, mutable=True):
    """What steps cost."""

    steps: int
    rejected: int


class Trials(Record, mutable=True):
    """Of longer steps that a damped series allows: see damping.py."""

    wait: int  # steps until the next one
    pause: int  # steps to wait after one that fails


class Course(Record, mutable=True):
    """Where a run is, and what it goes back to: where its last step began, and its last mended state."""

    t: float
    h: float  # the last step
    own: float  # the same, if it is as long as its series, else 0
    behind: float  # how far a kink it ends
    unsure: float  # how far from the kink that its series has; infinite: it may be none
    row: int  # the next output
    since: int  # steps since a mended state
    often: int  # how many of these at most
    long: int  # steps in a row that were longer than asked
    checked: bool  # has `Work.end` the slopes of the last step, at whose end the run is
    last_t: float
    last_row: int
    last_since: int
    last_entropy: float
    kept_t: float
    kept_row: int
    kept_entropy: float
    final: float
    gap: float  # between places where a doubtful step is looked at
    unit: float  # of time
    held: int  # short steps in a row from kink to kink
    longest: float  # of the steps to kinks
    hopeless: int  # steps in a row that are too short for any run


class Work(Record):
    """The kernels and arrays of a run; its states, (q, p, theta) of elements, have `size` numbers."""

    size: int
    order: int
    n_kinks: int  # numbers of which the formulas have the size
    n_given: int
    n_target: int
    seldom: int  # steps from one mended state to the next, where none is asked for
    to_start: Address
    to_series: Address  # see texts.series_kernels
    to_state: Address
    to_end: Address  # the same with its slopes, as in `end`
    to_rates: Address
    to_mend: Address  # see tcbench.solver.mending
    to_hold: Address
    to_z: Address  # z of such a state
    to_y: Address  # and back
    counts: Counts
    trials: Trials
    course: Course
    tolerance: float  # of a run: what a step may miss
    few: float  # steps that the rest of a run has at least when it is left after a leg: see `march.advance`
    reach: float  # of a damped step, over the time of the fastest decay; 0: none
    factors: Floats = sized("LAST")  # of the last coefficients in it: see damping.py
    misses: Floats = sized("LAST")
    least: Floats = sized("size")  # the square of the size of a number y: this and y^2
    given: Floats = sized("n_given")  # the system's constants, and what depends on them only
    coefficients: Floats = sized("(order + 1) * (size + n_kinks) + 2")
    length: Floats = sized("1")
    target: Floats = sized("n_target")  # z of a state and the laws that it should have, as `solver.mending` has them
    found: Floats = sized("size + 2")  # what its kernels give
    mended: Floats = sized("size")  # the state that has the laws: when a step begins, the run is there
    kept: Floats = sized("size")  # the last of these that a step began from
    last: Floats = sized("size")  # the state that the last step began from
    end: Floats = sized("2 * size + 2")  # the end of a step or a place in it: the state there, and slopes
    rates: Floats = sized("2 * size")  # and the rates that the formulas give there
    watch: Floats = sized("SIZE")  # of an adaptive run, lent for it: see `tcbench.compiler.polling`
    rows: int  # what follows is lent for a run
    times: Floats = sized("rows")
    states: Matrix = sized("rows", "size")  # z at these times, the first given
