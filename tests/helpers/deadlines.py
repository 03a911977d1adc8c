"""Deadlines without a clock: who says that it hangs is overdue at once, and all others have all the time they need."""

from tcbench.runner import scheduler

LIMIT = 1e4  # seconds, for --timeout: no cell takes so long, however busy the machine is
OVERDUE = scheduler.Worker._overdue


def hangs(worker, hanging, printing):
    """Whether the cell of a worker has said so, or has printed so much that its log was cut."""
    name, log = worker.cell.integrator, worker._log
    return (name in hanging and log.exists() and log.stat().st_size > 0) or (name in printing and worker._was_cut)


def only_for(patch, hanging=("hang",), printing=()):
    """From now on these are overdue, in workers of this process; `patch` is a monkeypatch."""

    def overdue(worker, now):
        return OVERDUE(worker, now + 2 * LIMIT if hangs(worker, hanging, printing) else now)

    patch.setattr(scheduler.Worker, "_overdue", overdue)
