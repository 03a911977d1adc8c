"""The run folder: rows as they come, tables at the end, one writer at a time.

    cells.jsonl          one line a finished cell, appended at once; the only source of truth
    tables/NAME.csv      the tidy tables (also NAME.parquet), written to a temporary name and renamed
    provenance/ID.json   what measured the rows: commit, versions, machine; each line names its ID
    declared.json        methods and scenarios: claims, orders, formulas, constants
    manifest.json        the latest run: provenance, start, end, counts
    .lock, .work/        held by the one writer (the system drops it when the writer dies); what its workers print

A line is ``{"crc", "key", "made_by", "provenance", "cell", "row"}`` (`codec`). The same key may occur again: the last
line counts. A line whose checksum is wrong is skipped and told; its cell runs again.
"""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import orjson

from ..errors import UNFINISHED, TcbenchError
from ..files import HALF_WRITTEN
from . import shapes
from .codec import (
    NAMES,
    canonical_json,
    csv_bytes,
    decode_line,
    digest,
    encode_line,
    from_json,
    parquet_bytes,
    pretty,
    row_bytes,
    unpack,
)  # fmt: skip
from .disk import WORK, cure, cured, hold_lock, replace_file

if TYPE_CHECKING:
    from filelock import FileLock
    from pandas import DataFrame

ROWS, MANIFEST, DECLARED = "cells.jsonl", "manifest.json", "declared.json"
SYNC_S = 0.5  # between two fsyncs, which cost more than most cells
# What the machine did to a cell, not the cell itself: worth another attempt on resume.
UNFINISHED_ERRORS = frozenset({"MemoryError", "ChangedError", "MachineError"})

Values = Mapping[str, Any]  # by name, as JSON has them


def is_finished(row: Values) -> bool:
    """Whether the row is final: any but crash, timeout, and what the machine did (memory, disk, absent packages)."""
    gone = row.get("status") in UNFINISHED or row.get("exception_type") in UNFINISHED_ERRORS
    return not (gone or row.get("of_the_machine"))


def _place(line: Values) -> tuple[Any, ...]:
    """By study, scenario, integrator and options: numbers by size, anything else as text."""
    cell = line["cell"]
    options = sorted(dict(cell.get("options", {})).items())
    sized = [(n, 0, v, "") if isinstance(v, int | float) else (n, 1, 0.0, canonical_json(v)) for n, v in options]
    return *(str(cell.get(name)) for name in ("study", "scenario", "integrator")), sized, line["key"]


class Rows:
    """Rows in memory, latest per key; a store of its own where nothing goes to disk."""

    def __init__(self) -> None:
        self._lines: dict[str, dict[str, Any]] = {}  # rows as they are on the disk, packed
        self.problems: list[str] = []

    def append(
        self, key: str, row: Values | bytes, cell: Values, provenance: str | None = None, made_by: str = ""
    ) -> None:
        """Keep the row of a cell; an earlier row of the same key is replaced. row : bytes of one that is encoded."""
        content = row if isinstance(row, bytes) else row_bytes(row)
        head = {"key": key, "made_by": made_by, "provenance": provenance or "", "cell": dict(cell)}
        self._keep(head | {"row": orjson.loads(content)})

    def _keep(self, line: dict[str, Any]) -> None:
        self._lines.pop(line["key"], None)
        self._lines[line["key"]] = line

    def line(self, key: str) -> dict[str, Any] | None:
        """The latest line of a key, its row packed: status and the like can be read, lists of numbers not."""
        return self._lines.get(key)

    def rows(self) -> dict[str, dict[str, Any]]:
        """The latest row of each key."""
        return {key: unpack(line["row"]) for key, line in self._lines.items()}

    def raw(self) -> list[dict[str, Any]]:
        """The latest line (key, made_by, provenance, cell, row) of each key, in the order of writing; rows packed."""
        return [*self._lines.values()]

    def records(self, study: str | None = None, keys: Iterable[str] | None = None) -> list[dict[str, Any]]:
        """Flat dicts for tables: study, integrator, scenario, the options, the row, and the key.

        In an order of their own: tables must not depend on which worker was the first to end.
        """
        lines = self._lines.values() if keys is None else [self._lines[key] for key in keys if key in self._lines]
        chosen = [line for line in lines if study is None or line["cell"].get("study") == study]
        return [
            {name: line["cell"].get(name) for name in NAMES}
            | dict(line["cell"].get("options", {})) | unpack(line["row"]) | {"key": line["key"]}
            for line in sorted(chosen, key=_place)
        ]  # fmt: skip


class Store(Rows):
    """A run folder. `Store.open` to write (one writer at a time), `Store.read` to look, at any time."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder
        self.provenance_id = ""
        self._file: int | None = None
        self._lock: FileLock | None = None
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
                store._lock = hold_lock(store.folder)
                if fresh:
                    store._set_aside()
                if (store.folder / ROWS).exists() and not (store.folder / ROWS).is_file():
                    raise TcbenchError(
                        f"{store.folder / ROWS} is no file (a pipe, a device or a folder): move it away."
                    )
                flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | getattr(os, "O_BINARY", 0)
                store._file = os.open(store.folder / ROWS, flags, 0o666)
                for place in (store.folder, store.folder / "tables", store.folder / "provenance"):
                    for path in place.glob(".*"):  # what writers that were killed have left
                        if HALF_WRITTEN.match(path.name):
                            path.unlink(missing_ok=True)
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

    @property
    def work(self) -> Path:
        """Where workers of the run under way leave what is theirs."""
        return self.folder / WORK

    def close(self) -> None:
        """Release the folder. Safe to call twice."""
        if self._file is not None:
            with suppress(OSError):
                os.fsync(self._file)
            os.close(self._file)
            self._file = None
        if self._lock is not None:
            shutil.rmtree(self.work, ignore_errors=True)
            self._lock.release()  # the file stays: removing it would race with the next writer
            self._lock = None

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- rows

    def append(
        self, key: str, row: Values | bytes, cell: Values, provenance: str | None = None, made_by: str = ""
    ) -> None:
        """Write one row: it outlives the process at once, and the machine from the next fsync on (SYNC_S, or `close`).

        Raises `TcbenchError` when the disk is full or the file cannot be written; rows already written stay intact.
        """
        content = row if isinstance(row, bytes) else row_bytes(row)
        origin = self.provenance_id if provenance is None else provenance
        self._write(encode_line(key, content, cell, origin, made_by))
        super().append(key, content, cell, origin, made_by)

    def _write(self, line: bytes) -> None:
        self._still_there()
        assert self._file is not None
        start = os.fstat(self._file).st_size
        try:
            view = memoryview(b"\n" + line if self._needs_newline else line)
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
                self._keep(decode_line(piece))
            except (ValueError, TypeError, KeyError, RecursionError):
                what = "is damaged, or of another version of tcbench"
                if number == len(pieces):  # whoever holds the lock knows that nobody else is writing
                    what = f"is incomplete ({'' if self._lock else 'it is being written, or '}its writer was killed)"
                self.problems.append(f"{path}, line {number}: {what}; skipped. Its cell will run again.")

    def _set_aside(self) -> None:
        path = self.folder / ROWS
        if path.exists() and path.stat().st_size:
            number = 1
            while (aside := self.folder / f"cells.{number}.old.jsonl").exists():
                number += 1
            os.replace(path, aside)

    # -- everything else of the folder

    def add_provenance(self, data: Values, default: bool = True) -> str:
        """Record what measures the rows that follow; returns the id that their lines carry.

        default : use it for every `append` that names no provenance of its own.
        """
        name = digest(data)[:16]
        self._replace(self.folder / "provenance" / f"{name}.json", pretty(data))
        if default:
            self.provenance_id = name
        return name

    def provenances(self) -> dict[str, dict[str, Any]]:
        """What `add_provenance` recorded, by id."""
        files = sorted((self.folder / "provenance").glob("*.json"))
        return {path.stem: self._read_json(path, shapes.MANIFEST) for path in files}

    def write_tables(self, tables: Mapping[str, DataFrame], gone: Iterable[str] = ()) -> list[Path]:
        """Write `tables/NAME.csv` and `tables/NAME.parquet`, each complete or not at all; those called `gone` go."""
        paths = []
        for name, frame in tables.items():
            if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]*", name):
                raise TcbenchError(f"A table cannot be called {name!r}: use letters, digits, '_' and '-'.")
            for suffix, encode in ((".csv", csv_bytes), (".parquet", parquet_bytes)):
                paths.append(self.folder / "tables" / f"{name}{suffix}")
                self._replace(paths[-1], encode(frame))
        for name in set(gone) - tables.keys():
            for suffix in (".csv", ".parquet"):
                (self.folder / "tables" / f"{name}{suffix}").unlink(missing_ok=True)
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
                    return pandas.read_parquet(file) if suffix == ".parquet" else pandas.read_csv(file, **exact)
                except (OSError, ValueError) as error:
                    self.problems.append(f"{file} cannot be read: {error}.")
        raise TcbenchError(
            f"There is no readable table {name!r} in {self.folder}. There are: {', '.join(self.tables())}."
        )

    def write_manifest(self, data: Values) -> None:
        """Write `manifest.json`, complete or not at all: what ran."""
        self._replace(self.folder / MANIFEST, pretty(data))

    def write_declared(self, data: Values) -> None:
        """Write `declared.json`, complete or not at all: what methods and scenarios say of themselves."""
        self._replace(self.folder / DECLARED, pretty(data))

    def manifest(self) -> dict[str, Any]:
        """The manifest; empty when none has been written yet or it cannot be read (see `problems`)."""
        return self._read_json(self.folder / MANIFEST, shapes.MANIFEST)

    def declared(self) -> dict[str, Any]:
        """What methods and scenarios say of themselves."""
        return self._read_json(self.folder / DECLARED, shapes.DECLARED)

    def _replace(self, path: Path, content: bytes) -> None:
        self._still_there()
        replace_file(path, content, self.folder)

    def _still_there(self) -> None:
        """What is written into a deleted file is lost without a word from the system."""
        if self._file is None:
            raise TcbenchError(f"The run in {self.folder} was opened for reading; nothing can be written to it.")
        try:
            same = os.path.samestat(os.fstat(self._file), os.stat(self.folder / ROWS))
        except FileNotFoundError:
            same = False
        if not same:
            raise TcbenchError(
                f"The run folder {self.folder} was deleted or replaced while the run was writing to it: its rows are "
                "gone. Run the same command again."
            )

    def _read_json(self, path: Path, kinds: Values) -> dict[str, Any]:
        """What a file holds; nothing where there is none, or none that can be read (which `problems` say)."""
        if not path.exists():
            return {}
        try:
            data = from_json(path.read_bytes()) if path.is_file() else None
            if not isinstance(data, dict):
                raise ValueError("not a JSON object")
        except (OSError, ValueError, TypeError, RecursionError) as error:
            self.problems.append(f"{path} cannot be read: {error}.")
            return {}
        misfits: list[str] = []
        fitting = shapes.fitting(data, kinds, misfits)
        if misfits:
            self.problems.append(f"{path}: {', '.join(misfits[:3])} is not what tcbench writes, and is left out.")
        return fitting
