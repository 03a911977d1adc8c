"""Cells in this process: the start of one takes a second, which tests of what rows say need not wait for."""

from __future__ import annotations

import pkgutil

from tcbench.runner.ledger import Ledger, plan
from tcbench.runner.worker import complete_row


def run_cells(cells, measure, context, store, *, on_event=None, retry_failed=False, machine="", **_):
    """As `scheduler.run_cells`, one after the other; hangs and crashes are this process's own."""
    to_run, summary = plan(cells, store, retry_failed, context.get("made_by"), machine=machine)
    ledger = Ledger(store, summary, on_event, len(to_run), context.get("made_by", {}))
    for cell in sorted(to_run, key=lambda cell: cell.timed):
        ledger.start(cell, 1)
        told = cell.as_dict()
        found = complete_row(lambda told=told: pkgutil.resolve_name(measure)(told, context), {"timed": cell.timed})
        ledger.write(cell, found, 0)
    return summary
