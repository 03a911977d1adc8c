"""The run folder: rows as they come, tables at the end, one writer at a time.

Layout of a run folder::

    cells.jsonl          one line a finished cell, appended at once; the only source of truth
    tables/NAME.csv      the tidy tables (also NAME.parquet), written to a temporary name and renamed
    inputs/ID.json       what plugins have read for rows: files by hash, folders, variables, packages; rows name its ID
    provenance/ID.json   what measured the rows: commit, versions, machine; each line names its ID
    declared.json        methods and scenarios: claims, orders, formulas, constants
    manifest.json        the latest run: provenance, start, end, counts
    .lock                held (flock) by the one writer; the system drops it when the writer dies

Line format: ``{"key", "cell", "row", "provenance", "nonfinite"}``. JSON has no NaN and no infinity: they are
written as ``null``, and ``nonfinite`` maps the JSON pointer (RFC 6901) of each such ``null`` to ``"nan"``,
``"inf"`` or ``"-inf"``; reading puts them back. The same key may occur again (a retried cell): the last line
counts. Everything that is read back is data: JSON, CSV, Parquet; nothing is unpickled or executed.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import time
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from io import FileIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import TcbenchError
from ..files import HALF_WRITTEN
from .disk import cure, cured, hold_lock, replace_file
from .encoding import active, canonical_json, csv_bytes, decode_line, encode_line, parquet_bytes, pretty
from .rows import Rows, Values

if TYPE_CHECKING:
    from pandas import DataFrame

ROWS = "cells.jsonl"
SYNC_S = 0.5  # between two fsyncs, which cost more than most cells


class Store(Rows):
    """A run folder. `Store.open` to write (one writer at a time), `Store.read` to look, at any time."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder
        self.provenance_id = ""
        self._file: int | None = None
        self._lock: FileIO | None = None
        self._needs_newline = False
        self._next_sync = 0.0

    # -- opening and closing

    @classmethod
    def open(cls, folder: str | os.PathLike[str], fresh: bool = False) -> Store:
        """Lock the folder for writing and load the rows it has.

        fresh : set the earlier rows aside (renamed to `cells.N.old.jsonl`) and start with none.
        Raises `TcbenchError` when the folder cannot be written or another process is writing to it.
        """
        if not str(folder).strip():
            raise TcbenchError("The name of the output folder is empty; the current folder is '.'.")
        store = cls(Path(folder))
        try:
            with cured(store.folder):
                store.folder.mkdir(parents=True, exist_ok=True)
                store._lock = hold_lock(store.folder / ".lock")
                if fresh:
                    store._set_aside()
                rows = store.folder / ROWS
                if rows.exists() and not rows.is_file():
                    raise TcbenchError(f"{rows} is no file (a pipe, a device or a folder): move it away.")
                store._file = os.open(rows, os.O_RDWR | os.O_APPEND | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666)
                store._sweep()
                store._probe()
                store._load()
        except BaseException:
            store.close()
            raise
        return store

    @classmethod
    def read(cls, folder: str | os.PathLike[str]) -> Store:
        """The rows of a folder as they are now, without a lock: also while a run is writing to it.

        Raises `TcbenchError` when there is no run in the folder.
        """
        store = cls(Path(folder))
        if not store.folder.is_dir() or not any((store.folder / n).exists() for n in (ROWS, "tables", "manifest.json")):
            raise TcbenchError(
                f"There is no run in {store.folder}: no {ROWS}, no tables. tcbench run --output FOLDER makes one."
            )
        try:
            store._load()
        except OSError as error:
            raise TcbenchError(f"Cannot read the run in {store.folder}: {error.strerror or error}.") from error
        return store

    def close(self) -> None:
        """Release the folder. Safe to call twice."""
        if self._file is not None:
            with suppress(OSError):
                os.fsync(self._file)
            os.close(self._file)
            self._file = None
        if self._lock is not None:
            # closing drops the lock; the file stays, for removing it would race with the next writer
            self._lock.close()
            self._lock = None

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- rows

    def append(self, key: str, row: Values, cell: Values | None = None, provenance: str | None = None) -> None:
        """Write one row: it outlives the process at once, and the machine from the next fsync on (SYNC_S, or `close`).

        Raises `TcbenchError` when the disk is full or the file cannot be written; rows already written stay
        intact.
        """
        kept = {name: value for name, value in row.items() if name != "_inputs"}
        if "_inputs" in row:
            self._replace(self._inputs_file(row["inputs"]), pretty(row["_inputs"]))
        provenance = self.provenance_id if provenance is None else provenance
        self._write(encode_line(key, kept, cell, provenance))
        super().append(key, row, cell, provenance)

    def inputs(self, name: str) -> dict[str, Any] | None:
        """As `Rows.inputs`, from its file; its cells are measured again where that is lost."""
        if name not in self._inputs:
            self._inputs[name] = self._read_json(self._inputs_file(name))
        return self._inputs[name] or None

    def _inputs_file(self, name: str) -> Path:
        return self.folder / "inputs" / f"{re.sub('[^0-9a-f]', '', str(name))}.json"

    def renew(self, keys: Iterable[str], latest: Collection[str]) -> None:
        """Rows that are used again and are not among the latest, those of other sources being so, are written again."""
        for key in keys:
            line = self._lines.get(key)
            if line is not None and key not in latest:
                self.append(key, line["row"], line["cell"], line["provenance"])

    def add_provenance(self, data: Mapping[str, Any], default: bool = True) -> str:
        """Record what measures the rows that follow; returns the id that their lines carry.

        default : use it for every `append` that names no provenance of its own.
        """
        name = hashlib.sha256(canonical_json(data).encode()).hexdigest()[:16]
        self._replace(self.folder / "provenance" / f"{name}.json", pretty(data))
        if default:
            self.provenance_id = name
        return name

    def provenances(self) -> dict[str, dict[str, Any]]:
        """What `add_provenance` recorded, by id. Unreadable files are left out and reported in `problems`."""
        return {
            path.stem: data
            for path in sorted((self.folder / "provenance").glob("*.json"))
            if (data := self._read_json(path))
        }

    # -- tables and manifest

    def write_tables(self, tables: Mapping[str, DataFrame]) -> list[Path]:
        """Write `tables/NAME.csv` and `tables/NAME.parquet`, each complete or not at all; others are removed.

        CSV numbers carry every digit needed to read back the same double (up to 17); lists and dicts are
        JSON text.
        """
        paths = []
        for name, frame in tables.items():
            if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]*", name):
                raise TcbenchError(f"A table cannot be called {name!r}: use letters, digits, '_' and '-'.")
            for suffix, encode in ((".csv", csv_bytes), (".parquet", parquet_bytes)):
                paths.append(self.folder / "tables" / f"{name}{suffix}")
                self._replace(paths[-1], encode(frame))
        for path in (self.folder / "tables").glob("*.*"):
            if path.suffix in (".csv", ".parquet") and path not in paths:
                path.unlink(missing_ok=True)
        return paths

    def tables(self) -> list[str]:
        """The names of the tables that have been written."""
        return sorted({p.stem for p in (self.folder / "tables").glob("*.*") if p.suffix in (".csv", ".parquet")})

    def read_table(self, name: str) -> DataFrame:
        """One table, from Parquet where readable, else from CSV; `TcbenchError` when there is none."""
        import pandas

        # pandas 3 reads back the double that was written; before it had to be asked to
        exact: dict[str, Any] = {} if int(pandas.__version__.split(".")[0]) >= 3 else {"float_precision": "round_trip"}
        for suffix in (".parquet", ".csv"):
            file = self.folder / "tables" / f"{name}{suffix}"
            if file.is_file():
                try:
                    return pandas.read_parquet(file) if suffix == ".parquet" else active(pandas.read_csv(file, **exact))
                except (OSError, ValueError) as error:
                    self.problems.append(f"{file} cannot be read: {error}.")
        raise TcbenchError(
            f"There is no readable table {name!r} in {self.folder}. There are: {', '.join(self.tables())}."
        )

    def write_manifest(self, data: Mapping[str, Any]) -> None:
        """Write `manifest.json`, complete or not at all."""
        self._replace(self.folder / "manifest.json", pretty(data))

    def manifest(self) -> dict[str, Any]:
        """The manifest; empty when none has been written yet or it cannot be read (see `problems`)."""
        return self._read_json(self.folder / "manifest.json")

    def write_declared(self, data: Mapping[str, Any]) -> None:
        """Write `declared.json`, complete or not at all: what methods and scenarios say of themselves."""
        self._replace(self.folder / "declared.json", pretty(data))

    def declared(self) -> dict[str, Any]:
        """What `write_declared` wrote; empty in folders of versions that did not."""
        return self._read_json(self.folder / "declared.json")

    # -- internals

    def _writable(self) -> None:
        if self._file is None:
            raise TcbenchError(f"The run in {self.folder} was opened for reading; nothing can be written to it.")

    def _load(self) -> None:
        path = self.folder / ROWS
        if path.exists() and not path.is_file():
            raise TcbenchError(f"{path} is no file (a pipe, a device or a folder), so there is no run to read.")
        content = path.read_bytes() if path.exists() else b""
        self._needs_newline = bool(content) and not content.endswith(b"\n")
        pieces = content.split(b"\n")
        for number, piece in enumerate(pieces, start=1):
            if not piece.strip():
                continue
            try:
                line = decode_line(piece)
            except (ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError):
                torn = number == len(pieces)
                what = "is damaged"
                if torn:  # whoever holds the lock knows that nobody else is writing
                    alive = "" if self._lock else "it is being written, or "
                    what = f"is incomplete ({alive}its writer was killed)"
                self.problems.append(f"{path}, line {number}: {what}; skipped. Its cell will run again.")
                continue
            self._lines.pop(line["key"], None)
            self._lines[line["key"]] = line

    def _write(self, line: bytes) -> None:
        self._writable()
        assert self._file is not None
        data = (b"\n" if self._needs_newline else b"") + line
        self._still_there()
        start = os.fstat(self._file).st_size
        try:
            view = memoryview(data)
            while view:
                view = view[os.write(self._file, view) :]
            if time.monotonic() >= self._next_sync:
                os.fsync(self._file)
                self._next_sync = time.monotonic() + SYNC_S
        except OSError as error:
            try:  # a half-written line would be skipped on reading anyway; without it the file is whole
                os.ftruncate(self._file, start)
            except OSError:
                self._needs_newline = True
            raise cure(error, self.folder) from error
        self._needs_newline = False

    def _probe(self) -> None:
        """Find out before hours of computing, not after, whether the folder takes new files."""
        probe = self.folder / f".probe.{os.getpid():012x}"
        probe.touch()
        probe.unlink()

    def _replace(self, path: Path, content: bytes) -> None:
        self._writable()
        self._still_there()
        replace_file(path, content, self.folder)

    def _still_there(self) -> None:
        """What is written into a deleted file is lost without a word from the system."""
        assert self._file is not None
        try:
            same = os.path.samestat(os.fstat(self._file), os.stat(self.folder / ROWS))
        except FileNotFoundError:
            same = False
        if not same:
            raise TcbenchError(
                f"The run folder {self.folder} was deleted or replaced while the run was writing to it: its rows are "
                "gone. Run the same command again."
            )

    def _sweep(self) -> None:
        """Remove what writers that were killed have left: the lock is held, so nobody is writing."""
        for folder in (self.folder / name for name in ("", "tables", "provenance", "inputs")):
            for path in folder.glob(".*"):
                if HALF_WRITTEN.match(path.name):
                    path.unlink(missing_ok=True)

    def _set_aside(self) -> None:
        path = self.folder / ROWS
        if path.exists() and path.stat().st_size:
            number = 1
            while (aside := self.folder / f"cells.{number}.old.jsonl").exists():
                number += 1
            os.replace(path, aside)

    def _read_json(self, path: Path) -> dict[str, Any]:
        """What a file holds; nothing where there is none, or none that can be read (which `problems` say)."""
        if not path.exists():
            return {}
        try:
            if not path.is_file():
                raise ValueError("not a file")
            data = json.loads(path.read_bytes())
            if isinstance(data, dict):
                return data
            raise ValueError("not a JSON object")
        except (OSError, ValueError, RecursionError) as error:
            self.problems.append(f"{path} cannot be read: {error}.")
            return {}
