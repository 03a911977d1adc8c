"""The compiled time loop: flows one after the other, observables in the same pass, nothing allocated per step."""

from __future__ import annotations

import numpy as np

from ..compiler.language import Address, Floats, Ints, Matrix, call, copy_into, fill, late, rare
from ..compiler.library import Library
from ..compiler.records import Record, Rows, address_of, sized
from ..solver.equations import MOVED
from ..solver.flow import CompiledFlow, Tally
from ..solver.implicit_step import BLOWUP, COLD, COLLAPSED, NO_AUDIT, NONFINITE, OK, PRINCIPAL, solve_flow
from ..solver.linear_algebra import add_increments, move
from ..solver.mending import LAWFUL, NEAR, SHRUNK, missed
from ..solver.newton import ACCEPTED, REJECTED, finish, foresee, forget, largest_residual, quick
from ..solver.quick_sparse import quick_sparse

E, S, FIRST_INVARIANT = 0, 1, 2  # in a row of observables
FIRST, BEFORE, NOW = range(3)  # rows of `observables`
# relative error that corrections may leave: `missed` tells of laws if it is more than round-off; of constraints nobody
# looks, and small numbers of a state may show it
LITTLE, CERTAIN = 1e-16, 1e-22
TIGHTER = 1e-2  # factor of what a run leaves from then on, once that was missed
NOT_ZERO = 1e-300  # square of a state
TELLING = 0.1  # square of a third difference over that of the last correction: more of it tells nothing of the next
SHARE, ROUGH = 1e-4, 1e-9  # error of a step's root, over its correction; and at most, scaled


class Run(Record):
    """One run: its flows, its criteria, where it is, and what it records. Dimensionless."""

    n: int  # length of a state
    n_flows: int  # flows that are solved; one of corrections may follow them
    n_elements: int  # temperatures: the first of the observables that must stay positive
    n_invariants: int
    n_mended: int  # length of a state that corrections move, or 0
    n_observables: int
    n_constants: int
    n_others: int
    n_rows: int
    observe: Address
    opening: Address  # prologue of the first flow and observables in one
    every: int  # steps from one record to the next
    of_step: bool  # formulas read the start of the whole step
    mends: bool  # corrections follow, until the state has the laws
    holds: bool  # the invariants are among these laws
    memory: int  # earlier states that the formula of a multistep method reads
    residuals: bool  # measure the residual of each accepted step
    h: float
    bound: float  # of |E - E_0|: beyond, the run is a blow-up
    reference: float  # temperature theta_ref
    entropy_tolerance: float  # fall of S, over max(entropy_size, |S|), that is no violation
    entropy_fall: float  # fall of S, over entropy_size, that is a failure of the second law
    entropy_size: float
    flows: Rows[CompiledFlow]
    tally: Tally
    c: Floats = sized("n_constants")
    others: Matrix = sized("n_others", "n")  # its end: see `implicit_step.constants_of`
    past: Matrix = sized("3", "n_mended")  # what corrections moved last, and its backward differences
    opened: Floats = sized("n_observables")  # a part of w of the first flow, where `opening` writes them
    z: Floats = sized("n")
    carry: Floats = sized("n")  # low parts of z: compensated summation
    after: Floats = sized("n")  # the state after a step
    dropped: Floats = sized("n")  # low parts of `after`
    observables: Matrix = sized("3", "n_observables")
    departures: Floats = sized("n_invariants")  # largest of each invariant
    states: Matrix = sized("n_rows", "n")
    records: Matrix = sized("n_rows", "n_observables")
    magnitudes: Floats = sized("n_invariants + 2")  # of energy, entropy and invariants
    allowed: Floats = sized("n_invariants + 2")  # residual of each law that a mended state may have
    counts: Ints = sized("n_rows")  # Newton iterations since the last record

    def make_room(self, rows: int) -> None:
        """Allocate this many records; earlier records, which trajectories hold, stay as they are."""
        n, m = self.n, self.n_observables
        memory, first, second = np.zeros(rows * (n + m + 1)), rows * n, rows * (n + m)
        self.n_rows, at = rows, address_of(memory)
        self.lend("states", memory[:first].reshape(rows, n), at)
        self.lend("records", memory[first:second].reshape(rows, m), at + 8 * first)
        self.lend("counts", memory[second:].view(np.int64), at + 8 * second)


def accumulate(run: Run, step: int, now: Floats) -> None:
    """Add one completed step to the tally."""
    tally, first, before = run.tally, run.observables[FIRST], run.observables[BEFORE]
    t = step * run.h
    error = now[E] - first[E]
    tally.energy_error = max(tally.energy_error, abs(error))
    tally.sum_t += t
    tally.sum_tt += t * t
    tally.sum_e += error
    tally.sum_te += t * error
    rise = now[S] - before[S]
    tally.entropy_min = min(tally.entropy_min, rise)
    if rise < -run.entropy_tolerance * max(run.entropy_size, abs(now[S])):
        tally.violations += 1
    if rise < -run.entropy_fall * run.entropy_size and tally.first_fall == 0:
        tally.first_fall = step
    lyapunov = (now[E] - before[E]) - run.reference * rise
    tally.lyapunov_max = max(tally.lyapunov_max, lyapunov)
    for i in range(run.n_invariants):
        departure = abs(now[FIRST_INVARIANT + i] - first[FIRST_INVARIANT + i])
        run.departures[i] = max(run.departures[i], departure)
    before[E], before[S] = now[E], now[S]


def verdict(run: Run, z: Floats, now: Floats) -> int:
    """OK, or why the run ends at the state z (n,) with the observables now (n_observables,)."""
    zero = 0.0  # 0 times anything that is not finite is NaN
    for i in range(run.n):
        zero += 0.0 * z[i]
    return admitted(run, now) if zero == 0.0 else NONFINITE


def admitted(run: Run, now: Floats) -> int:
    """`verdict` of a finite state."""
    temperatures = FIRST_INVARIANT + run.n_invariants
    zero, least = 0.0, np.inf
    for i in range(temperatures):
        zero += 0.0 * now[i]
    for i in range(temperatures, run.n_observables):
        zero += 0.0 * now[i]
        least = now[i] if now[i] < least else least
    if zero == 0.0 and least > 0.0:
        return BLOWUP if abs(now[E] - run.observables[FIRST, E]) > run.bound else OK
    return refused(run, now)


@rare
def refused(run: Run, now: Floats) -> int:
    """Why a finite state with these observables is not admissible."""
    temperatures = FIRST_INVARIANT + run.n_invariants
    for i in range(run.n_elements):
        if not now[temperatures + i] > 0.0:
            return COLD
    for i in range(temperatures + run.n_elements, run.n_observables):
        if not now[i] > 0.0:
            return COLLAPSED
    return NONFINITE


def completed(run: Run, step: int, reason: int, now: Floats) -> int:
    """The number of completed steps. This one is counted, and added to the tally, if its state is admissible: the
    energy of another state need not exist."""
    if reason != OK and reason != BLOWUP:
        return step - 1
    accumulate(run, step, now)
    return step


def monitor(run: Run, first: int, rows: Matrix) -> int:
    """Judge states that come from Python, of step `first` and the next, up to one that ends the run.

    rows : shape (m, n). Returns OK or why the run ends; the tally has the completed steps. States for which the run
    has no room are left out.
    """
    reason, now = OK, run.observables[NOW]
    run.tally.steps = first - 1
    for i in range(min(len(rows), (run.n_rows - 1) * run.every - (first - 1))):
        call(run.observe, rows[i], run.c, now)
        reason = verdict(run, rows[i], now)
        done = completed(run, first + i, reason, now)
        run.tally.steps = done
        if done == first + i:
            row = (done - 1) // run.every + 1  # the last record is overwritten by each state: it may be the last
            copy_into(run.states[row], rows[i])
            copy_into(run.records[row], now)
        if reason != OK:
            break
    return reason


def open_step(run: Run, z: Floats) -> None:
    """Prologue of the first flow and the observables of z, in one kernel: they share their logarithms."""
    first = run.flows[0]
    if run.of_step:
        copy_into(run.others[0], z)
    run.c[0] = first.h
    call(run.opening, z, run.c, first.w)


def remember(run: Run, z: Floats, new: Floats) -> None:
    """Update the slopes (earlier state - state)/h of a multistep method after a step from z (n,) to new (n,)."""
    slopes = run.others
    for k in range(run.memory - 1, -1, -1):
        for i in range(run.n):
            earlier = slopes[k - 1, i] if k > 0 else 0.0
            slopes[k, i] = earlier + (z[i] - new[i]) / run.h


def begin(run: Run) -> None:
    """Open the first step: its observables, the first and the last so far, by the kernel that observes every step."""
    open_step(run, run.z)
    now = run.opened
    copy_into(run.observables[FIRST], now)
    copy_into(run.observables[BEFORE], now)
    copy_into(run.states[0], run.z)
    copy_into(run.records[0], now)
    for i in range(len(run.allowed)):
        run.allowed[i] = LAWFUL * (run.magnitudes[i] + abs(now[i])) if run.holds or i < FIRST_INVARIANT else np.inf


@late
def measure_residual(flow: CompiledFlow) -> None:
    """Keep the largest scaled residual of an accepted step."""
    largest = largest_residual(flow, flow.iterate if flow.ns > 0 else flow.full, flow.x)
    flow.tally.residual_max = max(flow.tally.residual_max, largest)


@late
def mended(run: Run, z: Floats, after: Floats, now: Floats) -> bool:
    """Correct the end `after` of a step from z, (n,) each, until it has the laws, and open the next step there: its
    observables are left in `now`. False where corrections do not lead to the laws.

    The first correction takes its slopes where `expect` has foreseen that corrections lead. One that leads c away from
    its slopes leaves an error of c^2; one more along the same slopes, at a third of the cost, leaves c^3.
    """
    flow, first, entropy = run.flows[run.n_flows], run.observables[FIRST], run.observables[BEFORE, S]
    expected, moved, left, before = run.others[MOVED], flow.dz, np.inf, np.inf
    near = flow.foreseen.enough
    flow.c[0] = flow.h
    foreseen = flow.foreseen.near
    once, whole = not foreseen, 0.0  # slopes are taken once anyway, and nothing need be expected
    if foreseen:
        for i in range(run.n):
            after[i] += expected[i]
    for k in range(1, flow.most + 1):
        if k == 2 and foreseen:  # what the first has led to is corrected further, not begun anew
            fill(expected, 0.0)
        call(flow.prologue, after, flow.c, flow.w)
        change, step = flow.w[run.n] / max(flow.w[run.n + 1], NOT_ZERO), flow.w
        if not change < np.inf:
            return False
        if k == 1:
            whole = change
        done = change <= near
        once = once and done
        if not done and change * change * change <= near * near:
            call(flow.polish, flow.w, flow.w, flow.d)
            done, step = True, flow.d
        for i in range(run.n):
            after[i] += step[i]
        if flow.foresees and k == 1:
            for i in range(run.n):
                moved[i] = expected[i] + step[i]
        elif flow.foresees:
            for i in range(run.n):
                moved[i] += step[i]
        if done or k == flow.most:
            open_step(run, after)
            before, left = left, missed(now, first, entropy, run.allowed)
            if left <= 1.0 or not left < SHRUNK * before or k == flow.most:
                break
            flow.foreseen.enough = max(CERTAIN, TIGHTER * near)
            copy_into(run.others[0], z)
    if flow.foresees and not once:
        whole = expect(run, moved) / max(flow.w[run.n + 1], NOT_ZERO)
    for i in range(run.n_flows):
        run.flows[i].foreseen.enough = min(ROUGH, SHARE * whole**0.5)
    return left <= 1.0 or rounded(run, now, entropy)


def expect(run: Run, moved: Floats) -> float:
    """Set the move that is expected of the next step's corrections by the cubic through those of the last four steps,
    and to 0 where these tell nothing, as beside a kink. moved : that of this step, (n,). Returns its square.
    """
    expected, past, whole, error = run.others[MOVED], run.past, 0.0, 0.0
    for i in range(run.n):
        move = moved[i]
        first = move - past[0, i]
        second = first - past[1, i]
        third = second - past[2, i]
        past[0, i] = move
        past[1, i] = first
        past[2, i] = second
        expected[i] = move + first + second + third
        whole += move * move
        error += third * third
    run.flows[run.n_flows].foreseen.near = error < TELLING * whole
    if not error < TELLING * whole:
        fill(expected, 0.0)
    return whole


@rare
def rounded(run: Run, now: Floats, entropy: float) -> bool:
    """Is the residual of the laws round-off, against which no correction helps? Later steps may leave as much."""
    for i in range(len(run.allowed)):
        value = run.observables[FIRST, i]
        miss, most = abs(now[i] - value), NEAR * (run.magnitudes[i] + abs(value))
        if i == S:
            miss = entropy - now[S]
        if not (miss <= most or run.allowed[i] == np.inf):
            return False
        run.allowed[i] = max(run.allowed[i], min(2.0 * miss, most))
    return True


def one_step(run: Run, z: Floats, carry: Floats, after: Floats, trial: Floats) -> tuple[int, int]:
    """All flows from `z` + `carry`, opened, to `after` + `trial`; returns (OK or why there is no step, iterations)."""
    iterations = 0
    here, dropped = z, carry
    for k in range(run.n_flows):
        flow = run.flows[k]
        if k > 0:
            flow.c[0] = flow.h
            call(flow.prologue, after, flow.c, flow.w)
            here, dropped = after, trial
        if flow.nx == 0:  # explicit
            if finish(flow) != ACCEPTED:
                return NONFINITE, iterations
            move(here, dropped, flow.dz, after, trial)
            continue
        code = REJECTED
        if flow.continuation and flow.audit < PRINCIPAL:
            guess = flow.guess
            if flow.foreseen.near:
                guess = flow.x
            if flow.ns > 0:
                code, count = quick_sparse(flow)
            else:
                code, count = quick(flow, guess)
            iterations += count
        if code != ACCEPTED or flow.audit != NO_AUDIT:
            reason, more = solve_flow(flow, here, code == ACCEPTED)
            iterations += more
            if reason != OK:
                return reason, iterations
        if flow.residuals:
            measure_residual(flow)
        if flow.foresees:
            foresee(flow)
        move(here, dropped, flow.dz, after, trial)
    return OK, iterations


def march(run: Run, start: int, stop: int) -> int:
    """Take the steps start + 1 .. stop from `z` + `carry`, in place; returns OK or why the run ends."""
    now, every = run.opened, run.every
    row, left = start // every, every - start % every  # the last full record, and steps to the next
    reason, done = OK, start
    z, carry, after, trial = run.z, run.carry, run.after, run.dropped
    if start == 0:
        for k in range(run.n_flows):
            forget(run.flows[k])
        if run.mends:
            forget(run.flows[run.n_flows])
            run.flows[run.n_flows].foreseen.enough = CERTAIN if run.flows[0].constrained else LITTLE
            fill(run.others[MOVED], 0.0)
            for k in range(3):
                fill(run.past[k], 0.0)
    open_step(run, z)
    for step in range(start + 1, stop + 1):
        reason, iterations = one_step(run, z, carry, after, trial)
        run.tally.iterations += iterations
        if reason != OK:
            break
        if run.memory > 0:
            remember(run, z, after)
        if not run.mends:
            open_step(run, after)
        elif not mended(run, z, after, now):
            reason = NONFINITE
            break
        reason = admitted(run, now)  # increments are finite: see newton.finish
        done = completed(run, step, reason, now)
        if done == step:
            run.counts[row] += iterations
            z, after, carry, trial = after, z, trial, carry
            left -= 1
            if left == 0:
                row, left = row + 1, every
                copy_into(run.states[row], z)
                copy_into(run.records[row], now)
        if reason != OK:
            break
    if left < every and done > start:  # the last completed state is a record, too
        open_step(run, z)
        copy_into(run.states[row + 1], z)
        copy_into(run.records[row + 1], now)
    copy_into(run.z, z)
    copy_into(run.carry, carry)
    run.tally.steps = done
    return reason


LOOPS = Library("time loop", march, begin, verdict)
STATES = Library("states of others", monitor, add_increments)  # for methods in Python, whose steps are not compiled
