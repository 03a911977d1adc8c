"""Cells to rows on a Dask cluster: shares of cells, each of one integrator, go to Dask workers, where the same child
processes run them. Rows come back to the submitting process, the only writer.

Dask uses pickle between client, scheduler and workers: connect to your own scheduler only, and give the TLS options.
"""

from __future__ import annotations

import re
import socket
import time
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

from ..errors import TcbenchError
from .cell import Cell
from .codec import from_json, row_bytes, to_json
from .ledger import Event, Ledger, Summary, plan
from .rows import Rows, Store
from .scheduler import crash_row, run_cells

if TYPE_CHECKING:
    from distributed import Client

SHARE = 20  # cells of one integrator that are sent at a time
LOST_LIMIT = 3  # times that a cell may be lost, the last of them alone, before it is recorded as a crash
CONNECT_LIMIT_S = 30.0
REMEDY = "Start one with `dask scheduler`, give the address that it prints, and the TLS files if it asks for them."


def run_on_dask(
    cells: Iterable[Cell], measure: str, context: Mapping[str, Any], store: Rows, address: str, *,
    security: Mapping[str, Any] | None = None, jobs: int | None = None, timeout: float = 60.0,
    memory_limit: int | None = None, on_event: Callable[[Event], None] | None = None, retry_failed: bool = False,
    machine: str = "",
) -> Summary:  # fmt: skip
    """As `run_cells`, on the workers of a Dask scheduler ("tcp://host:8786"); timed cells as one share, after all
    others. Ctrl-C cancels what waits and keeps what has come back."""
    began = time.monotonic()
    to_run, summary = plan(cells, store, retry_failed, context.get("made_by"), machine=machine)
    if not to_run:
        return summary
    limits = {"jobs": jobs or 1, "timeout": timeout, "memory_limit": memory_limit}
    job = {"measure": measure, "context": dict(context), "limits": limits}
    ledger = Ledger(store, summary, on_event, len(to_run), context.get("made_by", {}))
    by_method: dict[str, list[Cell]] = {}
    for cell in to_run:
        by_method.setdefault("" if cell.timed else cell.integrator, []).append(cell)
    alone, lost, client = by_method.pop("", []), dict[str, int](), _connect(address, security)
    from distributed import as_completed

    try:
        for shares in ([c[i : i + SHARE] for c in by_method.values() for i in range(0, len(c), SHARE)], [alone]):
            sent = {_send(client, job, share): share for share in shares if share}
            arriving = as_completed(list(sent), loop=client.loop)
            for future in arriving:
                share = sent.pop(future)
                for again in _receive(client, future, share, ledger, lost, len(sent)):
                    sent[new := _send(client, job, again)] = again
                    arriving.add(new)
    except KeyboardInterrupt:
        summary.interrupted = True
    finally:
        client.cancel(list(sent))
        client.close(timeout=5)
    summary.elapsed_s = time.monotonic() - began
    return summary


def _send(client: Client, job: Mapping[str, Any], share: list[Cell]) -> Any:
    data = {**job, "cells": [cell.as_dict() for cell in share]}
    return client.submit(run_share, to_json(data), pure=False)


def run_share(job: bytes) -> tuple[dict[str, Any], list[tuple[str, bytes]]]:
    """In a Dask worker: the provenance of this machine, and key and row of each cell of a share."""
    from .provenance import cpu_model, provenance

    data, rows = from_json(job), Rows()
    run_cells((Cell(**cell) for cell in data["cells"]), data["measure"], data["context"], rows, **data["limits"])
    encoded = [(key, row_bytes(row | {"worker_host_cpu": cpu_model()})) for key, row in rows.rows().items()]
    return provenance(command=[]), encoded


def _receive(
    client: Client, future: Any, share: list[Cell], ledger: Ledger, lost: dict[str, int], running: int
) -> list[list[Cell]]:
    """Write the rows of a share that has come back; returns what is to be sent again."""
    if future.status == "finished":
        origin, rows = future.result()
        provenance_id = ledger.store.add_provenance(origin, default=False) if isinstance(ledger.store, Store) else None
        cells = {cell.key: cell for cell in share}
        for key, row in rows:
            ledger.write(cells[key], row, running, provenance_id)
        return []
    problem = future.exception() if future.status == "error" else None
    text = f"{type(problem).__name__}: {problem}" if problem else str(future.status)
    if isinstance(problem, ImportError) and "tcbench" in str(problem):
        raise TcbenchError(
            f"The Dask workers cannot import tcbench ({problem}). Install the same tcbench, with its plugins, on every "
            "worker."
        ) from problem
    if client.status != "running":
        raise TcbenchError(
            f"The connection to the Dask scheduler was lost ({text}). The rows finished so far are intact: run the "
            "same command again when the scheduler is back; it goes on where it stopped."
        ) from problem
    again = []
    for cell in share:  # each alone from now on, so that what kills Dask workers costs its own cell
        lost[cell.key] = lost.get(cell.key, 0) + 1
        if lost[cell.key] < LOST_LIMIT:
            again.append(cell)
        else:
            failure = f"The Dask worker was lost {LOST_LIMIT} times while it ran this cell ({text[:300]})."
            ledger.write(cell, row_bytes(crash_row(None) | {"failure": failure, "timed": cell.timed}), running)
    return [again] if again and again[0].timed and len(again) < len(share) else [[cell] for cell in again]


def _connect(address: str, security: Mapping[str, Any] | None) -> Client:
    """A client of the scheduler, with at least one worker there; `TcbenchError` with the remedy otherwise."""
    try:
        from distributed import Client, Security
    except ImportError as error:
        raise TcbenchError(
            f"Running on a cluster needs dask and distributed ({error}). Install them: pip install 'tcbench[cluster]'."
        ) from error
    knock(address)
    try:
        options = Security(**security) if security else None
        client = Client(address, security=options, timeout=CONNECT_LIMIT_S, set_as_default=False)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        raise TcbenchError(f"No Dask scheduler answers at {address} ({error}). {REMEDY}") from error
    try:
        client.wait_for_workers(1, timeout=CONNECT_LIMIT_S)
    except TimeoutError as error:
        client.close()
        raise TcbenchError(
            f"The Dask scheduler at {address} has no workers. Start some with `dask worker {address}`."
        ) from error
    return client


def knock(address: str) -> None:
    """Raise TcbenchError unless somebody listens there: a `Client` that does not get through keeps its threads."""
    match = re.fullmatch(r"(tcp|tls|ws|wss)://(?P<host>\[[^\]]+\]|[^:/\[\]]+):(?P<port>\d{1,5})", str(address))
    if match is None:
        raise TcbenchError(f"{address!r} is no address of a Dask scheduler, such as tcp://host:8786. {REMEDY}")
    try:
        socket.create_connection((match["host"].strip("[]"), int(match["port"])), CONNECT_LIMIT_S).close()
    except (OSError, OverflowError) as error:
        raise TcbenchError(f"No Dask scheduler answers at {address} ({error}). {REMEDY}") from error
