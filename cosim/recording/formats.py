"""Recordings as files of other programs, by the ending of the file: CSV, Parquet, NetCDF (which is HDF5) and MF4.

A writer takes what a `Recording` holds, a reader restores it: bit-identical values, names, units and order, and types
but for CSV, which has none. Nothing in a file depends on when it was written. Libraries come with the extra [data] and
are imported when they are used.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any, Protocol, cast

import numpy as np

from build_fmus.base import extras, safe_files
from build_fmus.base.checks import plain
from build_fmus.base.csv_table import CsvTable
from cosim.core.base_error import CosimError
from cosim.core.signals import Array
from cosim.recording.reading import NotRead, answer, read_apart

TIME = "time"
_HEADER = re.compile(r"(.*?)(?: \[(.*)\])?", re.DOTALL)
_INDEX = re.compile(r"(.+)\[(\d{1,9}(?:,\d{1,9})*)\]", re.DOTALL)
_TYPES = {"integer": np.int64, "boolean": np.bool_}  # of columns that are no doubles in a file
_TOOL = "suspension-fmus"
_LONGEST = 2**53  # integers up to here are doubles


class FormatError(CosimError, ValueError):
    """A file that cannot be written or read as a recording; the message names it and says what can."""

    def __init__(self, message: str):
        super().__init__(plain(message))


class Recorded(Protocol):
    """Recorded data: `time` (samples,) [s], `data` (samples, variables), `names`, `units` and `types` by name.

    `types` are "integer" and "boolean"; doubles are not listed.
    """

    time: Array
    names: list[str]
    data: Array
    units: dict[str, str]
    types: dict[str, str]


@dataclass
class Content:
    """What was read."""

    time: Array
    names: list[str]
    data: Array
    units: dict[str, str] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Format:
    """A file format: its name, and the functions that write and read it.

    `extra`: whether it needs an optional extra; `apart`: whether its library does not withstand damaged files, so that
    it reads in a process of its own.
    """

    name: str
    write: Callable[[IO[bytes], Recorded], None]
    read: Callable[[Path], Content]
    extra: bool = True
    apart: bool = False


def format_of(path: str | os.PathLike[str]) -> Format:
    """The format that an ending stands for. What is there and no regular file (`/dev/stdout`) takes CSV.

    Raises:
        FormatError: no format has this ending.
        MissingExtraError: its libraries are not installed.
    """
    path = Path(path)
    ending = path.suffix.lower()
    found = FORMATS.get(ending)
    if found is None and path.exists() and not path.is_file() and not path.is_dir():
        found = FORMATS[".csv"]
    if found is None:
        what = (
            f"no format has the extension {ending!r}" if ending else "the name of a recording's file needs an extension"
        )
        raise FormatError(f"{path}: {what}; choose one of {', '.join(FORMATS)}")
    if found.extra:
        extras.require("data", f"a recording as {found.name}")
    return found


def write(path: str | os.PathLike[str], recorded: Recorded) -> Path:
    """Write a recording in the format of the file's ending; it appears when it is whole, and its folder is made.

    Raises:
        FormatError, MissingExtraError: see `format_of`; also for names that the format cannot hold.
        OSError: naming the path.
    """
    form = format_of(path)
    _check(path, recorded)
    with safe_files.opened(path, "wb" if form.name == "CSV" else "w+b") as file:
        form.write(file, recorded)
    return Path(path)


def read(path: str | os.PathLike[str]) -> Content:
    """Read a file that `write` wrote.

    Raises FormatError naming the file (for CSV also the line) that cannot be read, and as `format_of` does.
    """
    path = Path(path)
    form = format_of(path)
    if not path.is_file():
        raise FormatError(f"{path}: there is no such file")
    if form.name == "CSV":
        return read_csv(path)
    try:
        return (
            Content(**read_apart(path, "from cosim.recording.formats import _answer; _answer()"))
            if form.apart
            else form.read(path)
        )
    except FormatError:
        raise
    except Exception as error:  # whatever a library makes of a file that nobody wrote
        if isinstance(error, NotRead) and error.refused:
            raise FormatError(f"{path}: {error}") from None
        detail = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise FormatError(f"{path}: cannot be read as {form.name}: {detail}") from None


def _answer() -> None:
    """The process in which a file is read."""
    answer(lambda path: format_of(path).read(path))


def _check(path: str | os.PathLike[str], recorded: Recorded) -> None:
    twice = {n for n in (TIME, *recorded.names) if (n == TIME and n in recorded.names) or recorded.names.count(n) > 1}
    if twice and Path(path).suffix.lower() != ".csv":
        raise FormatError(f"{path}: the name '{sorted(twice)[0]}' appears twice")


def columns(recorded: Recorded) -> Iterator[tuple[str, np.ndarray[Any, Any], str]]:
    """Name, values in their own type, and unit of each variable."""
    for i, name in enumerate(recorded.names):
        yield name, typed(recorded.data[:, i], recorded.types.get(name)), recorded.units.get(name, "")


def typed(values: Array, kind: str | None) -> np.ndarray[Any, Any]:
    """Doubles as what they stand for. What no such type holds (a NaN that a run was allowed to show) stays as it is."""
    if kind is None or not np.isfinite(values).all() or np.any(np.abs(values) > _LONGEST):
        return np.ascontiguousarray(values)
    return values.astype(_TYPES[kind])


def _gathered(time: Any, found: Sequence[tuple[str, Any, str]]) -> Content:
    """A content from columns of whatever type."""
    names = [name for name, _, _ in found]
    data = np.empty((len(time), len(names)), order="F")
    types: dict[str, str] = {}
    for i, (name, values, _) in enumerate(found):
        kind = np.asarray(values).dtype.kind
        if kind in "bui":
            types[name] = "boolean" if kind == "b" else "integer"
        elif kind != "f":
            raise FormatError(f"'{name}' holds no numbers")
        data[:, i] = values
    return Content(np.asarray(time, dtype=float).copy(), names, data, {n: u for n, _, u in found}, types)


# --------------------------------------------------------------------------------------------------------------- CSV


def write_csv(file: IO[bytes], recorded: Recorded) -> None:
    """Write `time [s]` and every column with a header `name [unit]`; floats are bit-identical when read back."""
    units = [recorded.units.get(name, "") for name in recorded.names]
    header = ["time [s]", *(f"{n} [{u}]" if u else n for n, u in zip(recorded.names, units, strict=True))]
    with _as_text(file) as text:
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(header)
        for t, row in zip(recorded.time.tolist(), recorded.data.tolist(), strict=True):
            writer.writerow([t, *row])


@contextmanager
def _as_text(file: IO[bytes]) -> Iterator[io.TextIOWrapper]:
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    try:
        yield text
        text.flush()
    finally:
        text.detach()


def read_csv(path: Path) -> Content:
    """Raises FormatError naming the file and line that cannot be read, OSError."""
    file = CsvTable.read(path, FormatError, "a recording has the header 'time [s],...'", separators=",")
    if split_unit(file.header[0])[0] != TIME:
        file.refuse(-1, "the first column must be 'time [s]'")
    table = file.numbers()
    if table is None:
        gap = "a recording has a number in each cell"
        rows = enumerate(file.rows(gap))
        cells = [[file.number(k, h, c, gap) for h, c in zip(file.header, row, strict=True)] for k, row in rows]
        table = np.array(cells, dtype=float).reshape(len(cells), len(file.header))
    pairs = [split_unit(text) for text in file.header[1:]]
    return Content(table[:, 0], [name for name, _ in pairs], table[:, 1:], dict(pairs))


def split_unit(header: str) -> tuple[str, str]:
    """`name [unit]` -> both; no unit is an empty text."""
    match = _HEADER.fullmatch(header)
    assert match is not None
    return match[1], match[2] or ""


# ----------------------------------------------------------------------------------------------------------- Parquet


def write_parquet(file: IO[bytes], recorded: Recorded) -> None:
    """One column per variable, `time` first; units in the fields' metadata, and as `attrs["units"]` for pandas."""
    import pyarrow as pa
    from pyarrow import parquet

    found = [(TIME, recorded.time, "s"), *columns(recorded)]
    fields = [
        pa.field(name, pa.from_numpy_dtype(v.dtype), nullable=False, metadata={"unit": u} if u else None)
        for name, v, u in found
    ]
    attributes = json.dumps({"units": {name: u for name, _, u in found if u}})
    schema = pa.schema(fields, metadata={"PANDAS_ATTRS": attributes})
    parquet.write_table(pa.table([pa.array(v) for _, v, _ in found], schema=schema), file)


def parquet_table(path: Path, columns: list[str] | None = None) -> Any:
    """A Parquet file as a table of Arrow, all of it or some columns, read by the thread that asks.

    Arrow's own threads read ahead by default (`pre_buffer`) and let go of what they read when they please; when the
    interpreter has ended in the meantime, they abort the process.
    """
    from pyarrow import parquet

    with parquet.ParquetFile(path, pre_buffer=False) as file:
        return file.read(columns, use_threads=False)


def whole_parquet(path: Path) -> bool:
    """Whether a file is there and begins and ends as one of Parquet; one that was cut short does not."""
    try:
        with path.open("rb") as file:
            begin = file.read(4)
            file.seek(-4, os.SEEK_END)
            return begin == file.read(4) == b"PAR1" and file.tell() > 8
    except OSError:
        return False


def read_parquet(path: Path) -> Content:
    """Read a Parquet file; raises FormatError if it is not a recording."""
    table = parquet_table(path)
    found = [
        (f.name, table.column(i).to_numpy(), (f.metadata or {}).get(b"unit", b"").decode())
        for i, f in enumerate(table.schema)
    ]
    if not found or found[0][0] != TIME:
        raise FormatError(f"{path}: the first column must be 'time'")
    return _gathered(found[0][1], found[1:])


# ------------------------------------------------------------------------------------------------- NetCDF, hence HDF5


@dataclass(frozen=True)
class Block:
    """A variable with the columns that are its elements; `shape` is () for a scalar."""

    name: str
    shape: tuple[int, ...]
    columns: tuple[int, ...]
    unit: str
    type: str | None

    def values(self, recorded: Recorded) -> np.ndarray[Any, Any]:
        """(samples, *shape), in its own type."""
        picked = recorded.data[:, self.columns]
        return typed(picked.reshape(len(picked), *self.shape), self.type)


def blocks(recorded: Recorded) -> list[Block]:
    """The variables of a recording, arrays whole where all their elements were recorded with one unit and type."""
    elements: dict[str, dict[tuple[int, ...], int]] = {}
    for i, name in enumerate(recorded.names):
        if match := _INDEX.fullmatch(name):
            elements.setdefault(match[1], {})[tuple(map(int, match[2].split(",")))] = i
    found: list[Block] = []
    gone: set[int] = set()
    for i, name in enumerate(recorded.names):
        if i in gone:
            continue
        match = _INDEX.fullmatch(name)
        block = None if match is None else _whole(recorded, match[1], elements[match[1]])
        found.append(block or Block(name, (), (i,), recorded.units.get(name, ""), recorded.types.get(name)))
        gone.update(found[-1].columns)
    return found


def _whole(recorded: Recorded, name: str, places: Mapping[tuple[int, ...], int]) -> Block | None:
    """The array of these elements, if none is missing."""
    if len({len(index) for index in places}) > 1 or name in recorded.names:
        return None
    shape = tuple(max(index[k] for index in places) for k in range(len(next(iter(places)))))
    kinds = {(recorded.units.get(n, ""), recorded.types.get(n)) for n in (recorded.names[i] for i in places.values())}
    if math.prod(shape) != len(places) or len(kinds) > 1 or any(0 in index for index in places):
        return None
    unit, kind = kinds.pop()
    return Block(name, shape, tuple(places[tuple(k + 1 for k in index)] for index in np.ndindex(*shape)), unit, kind)


def write_netcdf(file: IO[bytes], recorded: Recorded) -> None:
    """Variables over the dimension `time`, arrays with further ones that count from 1; units as the attribute `units`.

    Names that HDF5 would take for folders are changed; `name` holds every name as it is, `names` those of the columns
    in order.
    """
    import h5netcdf

    with h5netcdf.File(file, "w") as out:
        out.attrs["source"] = _TOOL
        out.attrs["names"] = json.dumps(recorded.names)
        out.dimensions[TIME] = len(recorded.time)
        out.create_variable(TIME, (TIME,), float, data=recorded.time).attrs["units"] = "s"
        taken = {TIME}
        for block in blocks(recorded):
            own = _free(block.name.replace("/", "_"), taken)
            axes = [TIME]
            for k, n in enumerate(block.shape, start=1):
                axes.append(_free(f"{own}_{k}", taken))
                out.dimensions[axes[-1]] = n
                out.create_variable(axes[-1], (axes[-1],), np.int64, data=np.arange(1, n + 1))
            values = block.values(recorded)
            boolean = values.dtype == np.bool_
            made = out.create_variable(own, tuple(axes), np.int8 if boolean else values.dtype, data=values)
            made.attrs["name"] = block.name
            if block.unit:
                made.attrs["units"] = block.unit
            if boolean:
                made.attrs["dtype"] = "bool"  # as xarray marks it


def _free(name: str, taken: set[str]) -> str:
    """A name that no other has, from now on taken."""
    while name in taken or not name:
        name += "_"
    taken.add(name)
    return name


def read_netcdf(path: Path) -> Content:
    """Read a netCDF or HDF5 file; raises FormatError if it is not a recording."""
    import h5netcdf

    with h5netcdf.File(path, "r") as file:
        if TIME not in file.variables:
            raise FormatError(f"{path}: there is no variable 'time'")
        time = np.asarray(file.variables[TIME][...])
        found: dict[str, tuple[str, Any, str]] = {}
        for own, variable in file.variables.items():
            if variable.dimensions[:1] != (TIME,) or own == TIME:
                continue
            name, unit = str(variable.attrs.get("name", own)), str(variable.attrs.get("units", ""))
            values = np.asarray(variable[...])
            if variable.attrs.get("dtype") == "bool":
                values = values.astype(bool)
            for index in np.ndindex(*values.shape[1:]):
                text = f"[{','.join(str(k + 1) for k in index)}]" if index else ""
                found[name + text] = (name + text, values[(slice(None), *index)], unit)
        order = [n for n in json.loads(file.attrs.get("names", "[]")) if n in found]
    return _gathered(time, [found[n] for n in dict.fromkeys([*order, *found])])


# --------------------------------------------------------------------------------------------------------------- MF4

_EPOCH = datetime.fromtimestamp(0, UTC)  # a recording's time is that of the simulation
_BOOLEAN = "boolean"  # the comment of a channel: MF4 has no such type


def write_mf4(file: IO[bytes], recorded: Recorded) -> None:
    """One group of channels over the time of the simulation, with their units (MDF 4.10)."""
    from asammdf import MDF, Signal
    from asammdf.blocks.v4_blocks import FileHistory

    history = FileHistory()
    history.time_stamp = _EPOCH
    history.comment = (
        "<FHcomment><TX>recording of a"
        f" co-simulation</TX><tool_id>{_TOOL}</tool_id><tool_vendor/><tool_version/></FHcomment>"
    )
    with MDF(version="4.10") as mdf:
        mdf.header.start_time = _EPOCH
        mdf.file_history.append(history)
        signals = [
            Signal(
                samples=values.view(np.uint8) if values.dtype == np.bool_ else values,
                timestamps=recorded.time,
                name=name,
                unit=unit,
                comment=_BOOLEAN if values.dtype == np.bool_ else "",
            )
            for name, values, unit in columns(recorded)
        ]
        mdf.append(
            signals or [Signal(samples=recorded.time, timestamps=recorded.time, name=TIME)], common_timebase=True
        )
        mdf.save(cast(Any, file), add_history_block=False)


def read_mf4(path: Path) -> Content:
    """Read an MF4 file; raises FormatError if it is not a recording."""
    from asammdf import MDF

    with MDF(path) as mdf:
        all_groups: Any = mdf.groups
        groups = [g for g, one in enumerate(all_groups) if one.channel_group.cycles_nr or len(all_groups) == 1]
        if len(groups) != 1:
            raise FormatError(
                f"{path}: {len(groups)} groups of channels, each with a time of its own; a recording has one"
            )
        (group,) = groups
        time: Any = mdf.get_master(group)
        found: list[tuple[str, Any, str]] = []
        for index, channel in enumerate(all_groups[group].channels):
            if index == mdf.masters_db.get(group) or channel.name == TIME:
                continue
            signal = mdf.get(group=group, index=index)
            values = np.asarray(signal.samples)
            found.append(
                (channel.name, values.astype(bool) if signal.comment == _BOOLEAN else values, signal.unit or "")
            )
    return _gathered(time, found)


CSV = Format("CSV", write_csv, read_csv, extra=False)
PARQUET = Format("Parquet", write_parquet, read_parquet)
NETCDF = Format("NetCDF", write_netcdf, read_netcdf, apart=True)
HDF5 = Format("HDF5", write_netcdf, read_netcdf, apart=True)
MF4 = Format("MF4", write_mf4, read_mf4, apart=True)
FORMATS: dict[str, Format] = {".csv": CSV, ".parquet": PARQUET, ".nc": NETCDF, ".h5": HDF5, ".hdf5": HDF5, ".mf4": MF4}
"""By the ending of a file, in small letters."""
