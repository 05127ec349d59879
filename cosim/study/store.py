"""Finished runs on disk, keyed by everything that determines them: an interrupted study continues where it stopped.

A folder of results in batches. A result is appended to a file of lines (`*.lines`) as soon as it is there, and the
operating system has it before anything else happens, so a process that is killed loses nothing that it was given. Lines
that make a batch are written as one Parquet file (`*.parquet`) of the same name, which appears whole or not at all;
then the lines are removed. Each process writes files of its own, so that several may work on one folder. Every result
carries a hash of its key and its text, which is checked whenever it is read.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import time
import warnings
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from build_fmus.base import extras, safe_files
from cosim.recording.formats import parquet_table

LINES, BATCH = ".lines", ".parquet"
STORED = "reading stored runs"  # what needs the extra [reports], in messages
_COLUMNS = ("key", "sha256", "entry")


class NotStored(LookupError):  # noqa: N818
    """There is no such result, or none that can be used."""


def pack(name: str, entry: Any) -> bytes:
    """The line of a result: the name of its key, a hash of both, and the result as JSON (NaN included)."""
    text = json.dumps(entry)
    return f"{name} {_digest(name, text)} {text}\n".encode()


def _digest(name: str, text: str) -> str:
    return hashlib.sha256(f"{name}\0{text}".encode()).hexdigest()


def _parts(line: bytes) -> tuple[str, str, str]:
    """Name, hash and text of a line; ValueError where it has no such parts."""
    name, digest, text = line.decode().rstrip("\n").split(" ", 2)
    return name, digest, text


class Store:
    """The results of a folder, read once and from then on as they come.

    Args:
        directory: made when something is stored.
        group: part of the names of files that this process writes, by which another one finds and takes them over
            (`absorb`).

    A file or a result that is not what was written is passed over with a `DamagedWarning`, and its runs are made
    again.
    """

    RESULTS = 4096
    """Of a batch, at most."""
    SIZE = 16_000_000
    """Of the texts of a batch [bytes]; a batch ends when it is exceeded."""
    CACHE = 8_000_000
    """Of batches that are kept in memory [bytes]."""
    SYNC = 1.0
    """How often lines are forced onto the disk at least, as long as there are new ones [s]: what a power failure may
    cost.
    """

    def __init__(self, directory: Path, group: str = "") -> None:
        self.directory = directory
        self.group = group
        self._lines: dict[bytes, bytes] = {}  # by key: results that are in no batch yet
        self._rows: dict[bytes, int] = {}  # by key: number of the batch << 32 | row in it
        self._batches: list[Path] = []
        self._cache: OrderedDict[int, Any] = OrderedDict()  # tables by number of the batch
        self._read: dict[str, int] = {}  # how far the files of others have been read [bytes]
        self._known: set[str] = set()  # names of batches
        self._path: Path | None = None
        self._file: Any = None
        self._own: list[bytes] = []  # keys of the lines of this process
        self._size = 0
        self._synced = 0.0
        self.refresh()

    # ---------------------------------------------------------------------------------------------------------- reading

    def text(self, name: str) -> str:
        """The stored text of a result by the name of its key.

        Raises:
            NotStored: no entry is stored, or a damaged one.
        """
        key = bytes.fromhex(name)
        for again in (False, True):
            line, row = self._lines.get(key), self._rows.get(key)
            if line is None and row is None:
                raise NotStored(name)
            try:
                found, digest, text = _parts(line) if line is not None else self._row(row)  # type: ignore[arg-type]
            except FileNotFoundError:  # another process has put these lines into a batch, or discarded the folder
                self._forget(row)
                if again or not self.refresh():
                    break
                continue
            except ValueError:
                found = digest = text = ""
            if found == name and digest == _digest(name, text):
                return text
            place = self._batches[row >> 32] if row is not None and line is None else self.directory
            warnings.warn(
                f"{place}: the result {name} is damaged; its run is repeated", safe_files.DamagedWarning, stacklevel=2
            )
            self._lines.pop(key, None)
            self._rows.pop(key, None)
            break
        raise NotStored(name)

    def __contains__(self, name: str) -> bool:
        key = bytes.fromhex(name)
        return key in self._lines or key in self._rows

    def __len__(self) -> int:
        return len(self._rows.keys() | self._lines.keys())

    def refresh(self) -> bool:
        """Look for what other processes have stored since; whether there is anything."""
        before = len(self._lines) + len(self._rows)
        try:
            with os.scandir(self.directory) as entries:
                files = sorted(e.name for e in entries if e.name.endswith((LINES, BATCH)))
        except FileNotFoundError:
            return False
        for file in files:
            stem, suffix = os.path.splitext(file)
            if self._path is not None and file == self._path.name:
                continue
            if suffix == BATCH and stem not in self._known:
                self._add_batch(self.directory / file)
            elif suffix == LINES and stem + BATCH not in files:
                self._add_lines(self.directory / file)
        return len(self._lines) + len(self._rows) > before

    def _add_lines(self, path: Path) -> None:
        with contextlib.suppress(FileNotFoundError), safe_files.named(path), path.open("rb") as file:
            file.seek(self._read.get(path.name, 0))
            for line in file:
                if not line.endswith(b"\n"):  # its writer was killed, or is at it
                    return
                self._read[path.name] = self._read.get(path.name, 0) + len(line)
                try:
                    key = bytes.fromhex(line[:32].decode())
                except ValueError:
                    warnings.warn(f"{path} is damaged; the run is repeated", safe_files.DamagedWarning, stacklevel=2)
                    continue
                self._lines[key] = line

    def _add_batch(self, path: Path) -> None:
        try:
            keys = [bytes.fromhex(k) for k in _read(path, ["key"])["key"].to_pylist()]
        except FileNotFoundError:
            return
        except (ValueError, TypeError, OSError) as error:
            if isinstance(error, OSError) and error.errno is not None:
                raise
            warnings.warn(
                f"{path} is damaged; it is discarded and created again", safe_files.DamagedWarning, stacklevel=2
            )
            path.unlink(missing_ok=True)
            return
        self._count(path, keys)

    def _count(self, path: Path, keys: Iterable[bytes]) -> None:
        """From now on these results are in a batch."""
        number = len(self._batches)
        self._known.add(path.stem)
        self._batches.append(path)
        for row, key in enumerate(keys):
            self._rows[key] = number << 32 | row
            self._lines.pop(key, None)

    def _row(self, place: int) -> tuple[str, str, str]:
        number, row = place >> 32, place & 0xFFFFFFFF
        if number not in self._cache:
            try:
                table = _read(self._batches[number], list(_COLUMNS))
            except OSError as error:
                if error.errno is not None:
                    raise
                raise ValueError(error) from None
            self._cache[number] = table
            while len(self._cache) > 1 and sum(t.nbytes for t in self._cache.values()) > self.CACHE:
                self._cache.popitem(last=False)
        self._cache.move_to_end(number)
        table = self._cache[number]
        return tuple(table[c][row].as_py() or "" for c in _COLUMNS)  # type: ignore[return-value]

    def _forget(self, row: int | None) -> None:
        """A batch that is no longer there."""
        if row is not None:
            self._rows = {k: r for k, r in self._rows.items() if r >> 32 != row >> 32}

    # ---------------------------------------------------------------------------------------------------------- writing

    def append(self, lines: Sequence[bytes]) -> None:
        """Store results, each as `pack` made it. They are safe from the end of this process when this returns.

        Raises:
            OSError: with the path; what had been stored before stays, and nothing of these is.
        """
        self._write(b"".join(lines))
        for line in lines:
            key = bytes.fromhex(line[:32].decode())
            self._lines[key] = line
            self._own.append(key)
        if len(self._own) >= self.RESULTS or self._size > self.SIZE:
            self.flush()

    def _write(self, data: bytes) -> None:
        if self._file is None:
            self._open()
        assert self._path is not None
        with safe_files.named(self._path):
            view = memoryview(data)
            try:
                while view:
                    view = view[self._file.write(view) :]
            except OSError:
                with contextlib.suppress(OSError):  # half a line would be joined with the next one
                    self._file.truncate(self._size)
                    self._file.seek(self._size)
                raise
            self._size += len(data)
            if (now := time.monotonic()) - self._synced > self.SYNC:
                os.fsync(self._file.fileno())
                self._synced = now

    def _open(self) -> None:
        self.directory.mkdir(parents=True, exist_ok=True)
        while self._file is None:
            path = self.directory / f"{time.time_ns():020d}-{os.getpid()}{self.group and '-' + self.group}{LINES}"
            with contextlib.suppress(FileExistsError), safe_files.named(path):
                self._file = path.open("xb", buffering=0)
                self._path = path

    def flush(self) -> None:
        """Put the lines of this process into a batch. Where the extra [reports] is missing they stay lines.

        Raises:
            OSError: it could not be written; the lines are still there.
        """
        if self._path is None or extras.missing("reports"):
            self.close()
            return
        path, keys = self._path.with_suffix(BATCH), [k for k in dict.fromkeys(self._own) if k in self._lines]
        _write(path, [self._lines[k] for k in keys])
        self._file.close()
        self._path.unlink(missing_ok=True)
        self._path = self._file = None
        self._own, self._size = [], 0
        self._count(path, keys)

    def close(self) -> None:
        """End what is being written; lines stay lines."""
        if self._file is not None:
            self._file.close()
            self._path = self._file = None
            self._own, self._size = [], 0

    def absorb(self, group: str) -> None:
        """Put the lines of a group's processes, which have ended, into batches."""
        for path in sorted(self.directory.glob(f"*-{group}{LINES}")) if not extras.missing("reports") else ():
            lines: dict[bytes, bytes] = {}
            for line in path.read_bytes().splitlines(keepends=True):
                if line.endswith(b"\n"):
                    lines[line[:32]] = line
            if lines:
                _write(path.with_suffix(BATCH), list(lines.values()))
            path.unlink()
        self.refresh()

    def discard(self) -> None:
        """Remove everything that is stored."""
        self.close()
        shutil.rmtree(self.directory, ignore_errors=True)
        self.__init__(self.directory, self.group)  # type: ignore[misc]


def _read(path: Path, columns: list[str]) -> Any:
    """Read a table of texts.

    Raises FileNotFoundError, or ValueError, TypeError or an OSError without a number if it is no such file.
    """
    try:
        with extras.needed("reports", STORED):
            table = parquet_table(path, columns)
    except (KeyError, RecursionError, MemoryError, NotImplementedError) as error:
        raise ValueError(error) from None
    if table.column_names != columns or any(str(f.type) != "string" for f in table.schema):
        raise ValueError(f"columns {table.schema}")
    return table


def _write(path: Path, lines: list[bytes]) -> None:
    rows = []
    for line in lines:
        with contextlib.suppress(ValueError):  # a damaged line of somebody else
            rows.append(_parts(line))
    write_table(path, dict(zip(_COLUMNS, zip(*rows, strict=True) if rows else ((), (), ()), strict=True)))


def write_table(path: Path, columns: Mapping[str, Any]) -> None:
    """A Parquet file of texts, whole numbers, real numbers and truth values, which is on the disk when this returns."""
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")  # that of Arrow keeps 10 MB for itself
    with extras.needed("reports", STORED):
        import pyarrow as pa
        from pyarrow import parquet

    table = pa.Table.from_arrays([_column(pa, values) for values in columns.values()], list(columns))
    with safe_files.opened(path, "wb") as file:
        parquet.write_table(table, file, compression="zstd", use_dictionary=False)
        file.flush()
        os.fsync(file.fileno())


def _column(pa: Any, values: Sequence[Any]) -> Any:
    """From buffers, since pa.array() imports pandas where it is installed (50 MB)."""
    n = len(values)
    if n == 0 or any(isinstance(v, str) for v in values):
        encoded = [str(t).encode() for t in values]
        offsets = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
        return pa.StringArray.from_buffers(n, pa.py_buffer(offsets), pa.py_buffer(b"".join(encoded)))
    array = np.asarray(values)
    if array.dtype == bool:
        return pa.Array.from_buffers(pa.bool_(), n, [None, pa.py_buffer(np.packbits(array, bitorder="little"))])
    kind, dtype = (pa.int64(), np.int64) if array.dtype.kind in "iu" else (pa.float64(), np.float64)
    return pa.Array.from_buffers(kind, n, [None, pa.py_buffer(np.ascontiguousarray(array, dtype=dtype))])


class RunStore:
    """Results by key; `salt` covers what all runs share (FMU files, code, library versions)."""

    def __init__(self, store: Store, salt: str) -> None:
        self.store = store
        self.salt = salt

    def name(self, key: Any) -> str:
        """What a key (any JSON value) is stored under."""
        text = json.dumps(key, sort_keys=True)
        return hashlib.sha256((self.salt + text).encode()).hexdigest()[:32]

    def get(self, key: Any) -> Any:
        """The result of a key.

        Raises:
            NotStored: it was never stored, or is damaged.
        """
        name = self.name(key)
        if name not in self.store:
            self.store.refresh()
        return json.loads(self.store.text(name))

    def find(self, key: Any) -> Any:
        """The result of a key, or None."""
        try:
            return self.get(key)
        except NotStored:
            return None

    def put(self, key: Any, result: Any) -> Any:
        """Store a result (a JSON value, NaN included), and return it as it will be read."""
        line = pack(self.name(key), result)
        self.store.append([line])
        return json.loads(_parts(line)[2])


class Stored(Sequence[Any]):
    """Results of a store by number, read when they are asked for; what was read last is kept."""

    CACHE = 2_000_000
    """Of texts whose values are kept [bytes]."""

    def __init__(self, store: Store, names: Sequence[str]) -> None:
        self._store = store
        self._names = names
        self._values: OrderedDict[int, tuple[Any, int]] = OrderedDict()
        self._size = 0

    def __len__(self) -> int:
        return len(self._names)

    def __getitem__(self, i: Any) -> Any:
        if i not in self._values:
            try:
                text = self._store.text(self._names[i])
            except NotStored:
                return {"failed": "its stored result is damaged; run it again"}
            self._values[i] = json.loads(text), len(text)
            self._size += len(text)
            while self._size > self.CACHE and len(self._values) > 1:
                self._size -= self._values.popitem(last=False)[1][1]
        self._values.move_to_end(i)
        return self._values[i][0]

    def __iter__(self) -> Iterator[Any]:
        return (self[i] for i in range(len(self)))
