"""Cells to rows on a Dask cluster: each Dask worker runs shares of the cells in the local engine.

Dask moves shares of cells and nothing else: it cannot kill a hung task, so isolation and deadlines are the
local engine's. Rows come back to the submitting process, the only writer. A share whose Dask worker dies is submitted
again.

Dask itself uses pickle between client, scheduler and workers: connect to your own scheduler only, and give
the TLS options.
"""

from __future__ import annotations

import json
import re
import socket
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..errors import TcbenchError
from ..store.cells import Cell
from ..store.encoding import canonical_json, decode_line, encode_line
from ..store.rows import Rows, Values
from ..store.store import Store
from .local import Event, Ledger, Summary, plan, run_cells
from .worker_slot import crash_row

if TYPE_CHECKING:
    from distributed import Client, Future

SHARES_PER_THREAD = 4  # small enough that the last share does not keep the rest waiting
LARGEST_SHARE = 50
LOST_LIMIT = 5  # Dask workers that may die under one share before its cells are recorded as crashed
CONNECT_LIMIT_S = 30.0


def run_on_dask(
    cells: Iterable[Cell],
    measure: str,
    context: Mapping[str, Any],
    store: Rows,
    address: str,
    *,
    security: Mapping[str, Any] | None = None,
    jobs: int | None = None,
    share_size: int | None = None,
    timeout: float = 60.0,
    memory_limit: int | None = None,
    on_event: Callable[[Event], None] | None = None,
    retry_failed: bool = False,
) -> Summary:
    """Run the unfinished cells on a Dask cluster; one row each in `store`, as `engine.run_cells`.

    Parameters
    ----------
    address : of the scheduler, as in "tcp://host:8786" or "tls://host:8786".
    security : arguments of `distributed.Security` (`tls_ca_file`, `tls_client_cert`, `tls_client_key`,
        `require_encryption`).
    jobs : processes of the local engine per share, one by default; a Dask worker runs as many shares as it has threads.
    share_size : cells sent at a time; by default some four shares a thread.

    Timed cells go as one share to one Dask worker, after all the others. Every row names its
    `worker_host_cpu`. Ctrl-C cancels the waiting shares and keeps what has come back; a share that is being
    run ends by itself, unread. While the cluster has no worker at all the run waits for one (queues may take
    hours to give one). Raises `TcbenchError` when dask is not installed, no scheduler or worker answers, or
    workers lack tcbench.
    """
    began = time.monotonic()
    to_run, summary = plan(cells, store, retry_failed, context=context, machines=_all_machines(store))
    if not to_run:
        return summary
    limits = {"jobs": jobs or 1, "timeout": timeout, "memory_limit": memory_limit}
    job = {"measure": measure, "context": dict(context), "limits": limits}
    client = _connect(address, security)
    run = _ClusterRun(client, job, Ledger(store, summary, on_event, len(to_run), context.get("marks", {})))
    try:
        threads = sum(info["nthreads"] for info in client.scheduler_info(n_workers=-1)["workers"].values())
        together = [cell for cell in to_run if not cell.timed]
        size = share_size or max(1, min(LARGEST_SHARE, len(together) // (SHARES_PER_THREAD * max(1, threads))))
        run.all([together[i : i + size] for i in range(0, len(together), size)])
        alone = [cell for cell in to_run if cell.timed]
        run.all([alone] if alone else [])
    except KeyboardInterrupt:
        summary.interrupted = True
    finally:
        run.cancel()
        client.close(timeout=5)
    summary.elapsed_s = time.monotonic() - began
    return summary


def _all_machines(store: Rows) -> set[str]:
    """Machines that rows were timed on: which worker a cell goes to is not known beforehand, nor which took it."""
    return {str(row["machine"]) for row in store.rows().values() if "worker_host_cpu" in row and row.get("machine")}


def run_share(job: str) -> tuple[str, list[str]]:
    """In a Dask worker: run a share (JSON: cells, measure, context, limits).

    Returns the provenance of this machine (JSON) and the rows, lines as in `cells.jsonl`. The processes of the cells
    end with this one.
    """
    from ..store.provenance import cpu_model, provenance

    data, cpu = json.loads(job), cpu_model()
    lines: list[str] = []

    class Lines(Rows):
        def append(self, key: str, row: Values, cell: Values | None = None, provenance: str | None = None) -> None:
            lines.append(encode_line(key, dict(row) | {"worker_host_cpu": cpu}, cell, "").decode())

    run_cells((Cell(**cell) for cell in data["cells"]), data["measure"], data["context"], Lines(), **data["limits"])
    return canonical_json(provenance(command=[])), lines


class _ClusterRun:
    """The state of one `run_on_dask`: which share is where, and how often each was lost."""

    def __init__(self, client: Client, job: dict[str, Any], ledger: Ledger) -> None:
        self.client, self.job, self.ledger = client, job, ledger
        self.shares: dict[Future[Any], list[Cell]] = {}
        self.losses: dict[str, int] = {}
        self.provenances: dict[str, str] = {}

    def all(self, shares: Sequence[list[Cell]]) -> None:
        """Send the shares, write the rows as they come back, send again what was lost."""
        from distributed import as_completed

        for share in shares:
            self._send(share)
        arriving = as_completed(list(self.shares), loop=self.client.loop)
        for future in arriving:
            share = self.shares.pop(future)
            for again in self._receive(share, future):
                arriving.add(self._send(again))
            future.release()

    def cancel(self) -> None:
        """Take back from the cluster what has not come back."""
        futures, self.shares = list(self.shares), {}
        for future in futures:
            future.cancel()

    def _send(self, share: list[Cell]) -> Future[Any]:
        for cell in share:
            self.ledger.start(cell, self._running())
        job = canonical_json(self.job | {"cells": [cell.as_dict() for cell in share]})
        # when a worker dies Dask itself sends its share to another, `allowed-failures` times; then
        # KilledWorker comes here
        future = self.client.submit(run_share, job, pure=False)
        self.shares[future] = share
        return future

    def _receive(self, share: list[Cell], future: Future[Any]) -> Iterator[list[Cell]]:
        """Write the rows of a share that has come back; yield what has to be sent again."""
        if future.status == "finished":
            missing = {cell.key: cell for cell in share}
            origin, lines = future.result()
            for line in map(decode_line, lines):
                cell = missing.pop(line["key"], None)
                if cell is not None:
                    self._write(cell, line["row"], origin)
            if missing:
                yield from self._lost(list(missing.values()), "it came back without them")
            return
        problem = future.exception() if future.status == "error" else None
        text = f"{type(problem).__name__}: {problem}" if problem else str(future.status)
        if isinstance(problem, ImportError) and "tcbench" in str(problem):
            raise TcbenchError(
                f"The Dask workers cannot import tcbench ({problem}). Install the same tcbench, with its "
                "plugins, on every worker."
            ) from problem
        if self.client.status != "running":
            raise TcbenchError(
                f"The connection to the Dask scheduler was lost ({text}). The rows finished so far are "
                "intact: run the same command "
                "again when the scheduler is back; it goes on where it stopped."
            ) from problem
        yield from self._lost(share, text)

    def _lost(self, share: list[Cell], how: str) -> Iterator[list[Cell]]:
        """Halve a lost share, so that what kills Dask workers ends up alone; give up after `LOST_LIMIT`."""
        again = []
        for cell in share:
            self.losses[cell.key] = self.losses.get(cell.key, 0) + 1
            if self.losses[cell.key] < LOST_LIMIT or (len(share) > 1 and not cell.timed):
                again.append(cell)
            else:
                times = self.losses[cell.key]
                failure = f"The Dask worker was lost {times} times while it ran this cell ({how[:300]})."
                self._write(cell, crash_row(None) | {"failure": failure, "timed": cell.timed})
        if again and again[0].timed:
            yield again  # timed cells stay in one share: they must not run side by side
        elif again:
            half = (len(again) + 1) // 2
            yield from (part for part in (again[:half], again[half:]) if part)

    def _running(self) -> int:
        return sum(len(share) for share in self.shares.values())

    def _write(self, cell: Cell, row: dict[str, Any], provenance: str = "") -> None:
        """provenance : of a Dask worker, JSON text, which is recorded in the store when it is new."""
        store, known = self.ledger.store, self.provenances
        if provenance and provenance not in known and isinstance(store, Store):
            known[provenance] = store.add_provenance(json.loads(provenance), default=False)
        self.ledger.write(cell, row, self._running(), known.get(provenance))


def _connect(address: str, security: Mapping[str, Any] | None) -> Client:
    """A client of the scheduler, with at least one worker there; `TcbenchError` with the remedy otherwise."""
    try:
        from distributed import Client, Security
    except ImportError as error:
        raise TcbenchError(
            f"Running on a cluster needs dask and distributed ({error}). Install them with: pip install "
            "'tcbench[cluster]'."
        ) from error
    knock(address)
    try:
        options = Security(**security) if security else None
        client = Client(address, security=options, timeout=CONNECT_LIMIT_S, set_as_default=False)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        raise TcbenchError(
            f"No Dask scheduler answers at {address} ({error}). Start one with `dask scheduler`, give the "
            "address that it "
            "prints, and the TLS files if it asks for them."
        ) from error
    try:
        client.wait_for_workers(1, timeout=CONNECT_LIMIT_S)
    except TimeoutError as error:
        client.close()
        raise TcbenchError(
            f"The Dask scheduler at {address} has no workers. Start some with `dask worker {address}`."
        ) from error
    return client


def knock(address: str) -> None:
    """Raise TcbenchError unless somebody listens there.

    A `Client` that does not get through keeps its threads, and the process, for long."""
    found = re.fullmatch(r"(tcp|tls|ws|wss)://(?P<host>\[[^\]]+\]|[^:/\[\]]+):(?P<port>\d{1,5})", str(address))
    remedy = "Start one with `dask scheduler`, give the address that it prints, and the TLS files if it asks for them."
    if found is None:
        raise TcbenchError(f"{address!r} is no address of a Dask scheduler, such as tcp://host:8786. {remedy}")
    try:
        socket.create_connection((found["host"].strip("[]"), int(found["port"])), CONNECT_LIMIT_S).close()
    except (OSError, OverflowError) as error:
        raise TcbenchError(f"No Dask scheduler answers at {address} ({error}). {remedy}") from error
