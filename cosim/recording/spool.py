"""Rows of a run on disk while it runs, so that a run that dies has lost no more than the last tenth of a second.

`NAME.csv.part` lies beside `NAME.csv` (as `NAME.parquet.part` beside `NAME.parquet`): a line that says what it is, a
line of JSON with names and units, then rows of little-endian doubles, time first. No text is made from numbers while a
system runs; the file is made at the end, or by `recover`.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from build_fmus.base import safe_files
from cosim.core.errors import CosimError
from cosim.core.signals import Array
from cosim.recording.recording import Recording

SUFFIX = ".part"
_MAGIC = b"rows of a co-simulation, version 1\n"
_ROW = np.dtype("<f8")


class Spool:
    """Takes rows and writes them at least every `EVERY` s of wall time, if it is asked often enough."""

    EVERY = 0.1

    def __init__(
        self, path: Path, names: Sequence[str], units: Mapping[str, str], types: Mapping[str, str] | None = None
    ):
        self.path = path
        self.count = 0  # rows that are written
        head = json.dumps({"names": list(names), "units": dict(units), "types": dict(types or {})}).encode() + b"\n"
        self._begin = len(_MAGIC) + len(head)
        self._width = (1 + len(names)) * _ROW.itemsize
        with safe_files.named(path):
            self._file = path.open("wb")
            self._file.write(_MAGIC + head)
            self._file.flush()
        self._since = time.perf_counter()

    @property
    def due(self) -> bool:
        """Whether the last rows were written long enough ago that new ones should be."""
        return time.perf_counter() - self._since >= self.EVERY

    def add(self, times: Array, data: Array) -> None:
        """Append rows: times (n,) [s], data (n, variables)."""
        with safe_files.named(self.path):
            self._file.write(np.column_stack([times, data]).astype(_ROW, copy=False).tobytes())
            self._file.flush()
        self.count += len(times)
        self._since = time.perf_counter()

    def cut(self, count: int) -> None:
        """Forget all rows after the first `count`."""
        if count < self.count:
            with safe_files.named(self.path):
                self._file.seek(self._begin + count * self._width)
                self._file.truncate()
            self.count = count

    def close(self, *, keep: bool) -> None:
        """Close the file, and remove it unless it is to be kept."""
        self._file.close()
        if not keep:
            self.path.unlink(missing_ok=True)


def spool_of(file: Path) -> Path:
    """Where the rows of a run lie until its file is made."""
    return file.with_name(file.name + SUFFIX)


def read_spool(path: str | os.PathLike[str]) -> Recording:
    """What a run has left; a last row that is not whole is left out. Raises CosimError for a file that is no spool."""
    with safe_files.named(path):
        data = Path(path).read_bytes()
    head, _, rows = data[len(_MAGIC) :].partition(b"\n")
    try:
        about = json.loads(head if data.startswith(_MAGIC) else b"")
        names = [str(n) for n in about["names"]]
        units, types = ({str(k): str(v) for k, v in about.get(key, {}).items()} for key in ("units", "types"))
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise CosimError(
            f"{path}: this file does not contain the rows of a run; give the NAME.csv{SUFFIX} that a crashed run"
            " with output=NAME.csv left"
        ) from None
    width = 1 + len(names)
    whole = len(rows) // (width * _ROW.itemsize) * width
    table = np.frombuffer(rows, dtype=_ROW, count=whole).reshape(-1, width).astype(float)
    return Recording(table[:, 0].copy(), names, np.asfortranarray(table[:, 1:]), units, types=types)


def recover(path: str | os.PathLike[str], to: str | os.PathLike[str] | None = None) -> tuple[Path, Recording]:
    """Recover the results of a crashed run from `NAME.csv.part` (or the `NAME.csv` next to it), and remove the rows.

    The result is `NAME.csv`, or `to`, in the format of its ending, as of `NAME.parquet`. Raises CosimError when there
    are no rows of a run, or when `NAME.csv` is not empty, FormatError for an ending that stands for no format.
    """
    part = Path(path)
    if part.suffix != SUFFIX:
        part = spool_of(part)
    target = Path(to) if to is not None else part.with_suffix("")
    if not part.is_file():
        raise CosimError(
            f"{part}: no such file; a run that ended normally has already written {part.with_suffix('').name}"
        )
    recording = read_spool(part)
    if to is None and target.exists() and target.stat().st_size:
        raise CosimError(f"{target} already exists: name another file with --to")
    recording.write(target)
    part.unlink()
    return target, recording
