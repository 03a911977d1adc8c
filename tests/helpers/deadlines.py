"""Deadlines without a clock: who says that it hangs is overdue at once, and all others have all the time they need."""

from tcbench.engine import worker_slot

LIMIT = 1e4  # seconds, for --timeout: no cell takes so long, however busy the machine is
OVERDUE = worker_slot.Slot._overdue


def hangs(slot, hanging, printing):
    """Whether the cell of a slot has said so, or has printed so much that its log was cut."""
    name, log = slot.cell.integrator, slot._log
    return (name in hanging and log.exists() and log.stat().st_size > 0) or (name in printing and slot._kept_output)


def only_for(patch, hanging=("hang",), printing=()):
    """From now on these are overdue, in workers of this process; `patch` is a monkeypatch."""

    def overdue(slot, now):
        return OVERDUE(slot, now + 2 * LIMIT if hangs(slot, hanging, printing) else now)

    patch.setattr(worker_slot.Slot, "_overdue", overdue)
