"""Reads signals over time from a CSV or Parquet file, a DataFrame, a mapping of arrays or a recording.

Nothing is guessed and nothing filled: a gap, a NaN, text, a time that does not increase or a unit that nobody knows is
refused with the line (of a file) or row, the column and what to do.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from build_fmus.base import extras
from build_fmus.base.checks import did_you_mean, one_line, plain
from build_fmus.base.csv_table import BOOLEANS, CsvTable
from build_fmus.base.units import KNOWN, Unit, conversion
from cosim.core.errors import CosimError
from cosim.core.signals import Array
from cosim.recording.formats import TIME, parquet_table
from cosim.recording.recording import Recording

TIMES = ("time", "t", "timestamp", "timestamps", "time stamp", "time_stamp")
"""Names of a time column that is not named, small letters."""
_UNIT = re.compile(r"(.*?)\s*(?:\[([^\[\]]*)\]|(?<=\s)\(([^()]*)\))?\s*", re.DOTALL)
_NONE = ("-", "–", "1")  # how people write that a number has no dimension


class TableError(CosimError, ValueError):
    """A table that holds no signals, or not those that are asked for; the message names its file, line and column."""

    def __init__(self, message: str):
        super().__init__(plain(message))


@dataclass(frozen=True)
class Signal:
    """A column: finite values (rows,), its unit if it has one, and "real", "integer" or "boolean"."""

    name: str
    values: Array
    unit: Unit | None
    type: str


@dataclass(frozen=True)
class Signals:
    """What a table holds: `time` [s] (rows,), which increases, and columns. `name` says where it is from."""

    name: str
    time: Array
    columns: tuple[Signal, ...]


@dataclass(frozen=True)
class _Raw:
    """Columns as read: header, values of any type, and unit and type if the file declares them apart from the header.

    `row`: names the row of an index. `whole`: numbers without a fraction count as integers (text has no types).
    """

    name: str
    columns: Sequence[tuple[str, Any, str | None, str | None]]
    row: Callable[[int], str]
    whole: bool = False


def read(
    source: Any,
    *,
    time: str | None = None,
    columns: Iterable[str] | None = None,
    units: Mapping[str, str] | None = None,
) -> Signals:
    """Read the signals of a table.

    `time`: the column of the time, else found by its name; `columns`: those to take, default all; `units`: by column,
    for those that have none or a wrong one ("" for none). Raises TableError.
    """
    wanted = None if columns is None else list(dict.fromkeys([columns] if isinstance(columns, str) else columns))
    raw = _found(source, None if wanted is None else [*wanted, *([time] if time else [])])
    headers = [split_header(text) for text, *_ in raw.columns]
    names = [name for name, _ in headers]
    for name in names:
        if not name or names.count(name) > 1:
            what = f"the column {name!r} appears twice" if name else "a column has no name"
            raise TableError(f"{raw.name}: {what}; columns become variables, whose names must differ")
    given = dict(units or {})
    for name in (*given, *(wanted or ())):
        if name not in names:
            raise TableError(
                f"{raw.name}: no column '{name}'{did_you_mean(name, names)} (there are: {', '.join(names)})"
            )
    own = {
        n: given.get(n, told if told is not None else unit)
        for (n, unit), (_, _, told, _) in zip(headers, raw.columns, strict=True)
    }
    at = _time_column(raw, names, time)
    clock = _times(raw, names[at], raw.columns[at][1], own[names[at]])
    picked = [i for i, n in enumerate(names) if i != at and (wanted is None or n in wanted)]
    if not picked:
        raise TableError(f"{raw.name}: no column but the time '{names[at]}'")
    found = [
        _signal(raw, names[i], *_plain_values(raw, names[i], raw.columns[i][1]), own[names[i]], raw.columns[i][3])
        for i in picked
    ]
    return Signals(raw.name, clock, tuple(found))


def split_header(text: str) -> tuple[str, str]:
    """`z [m]`, `z (m)` -> name and unit; `z[3]` is an element of an array."""
    match = _UNIT.fullmatch(text.strip())
    if match is None or (match[2] is None and match[3] is None):
        return text.strip(), ""
    unit = match[2] if match[2] is not None else match[3]
    if match[2] is not None and re.fullmatch(r"\d+(,\d+)*", unit) and not text[: text.rindex("[")].endswith(" "):
        return text.strip(), ""
    return match[1].strip(), unit.strip()


def unit_of(where: str, name: str, text: str) -> Unit | None:
    """A unit by its name; None for none. Raises TableError for one that is not known."""
    if not text:
        return None
    if text in _NONE:
        return KNOWN["1"]
    if text in KNOWN:
        return KNOWN[text]
    bare = [u for u in KNOWN if _bare(u) == _bare(text)]
    hint = did_you_mean(text, bare or KNOWN)
    raise TableError(
        f"{where}: the column '{name}' has the unknown unit '{one_line(text, 40)}'{hint}; give another with"
        f" units={{'{name}': ...}}, '' for none"
    )


def _bare(name: str) -> str:
    return name.translate(str.maketrans("²³", "23", ".*·^ "))


# ---------------------------------------------------------------------------------------------------- where it is from


def _found(source: Any, only: Sequence[str] | None) -> _Raw:
    if isinstance(source, Recording):
        return _of_recording(source)
    if isinstance(source, str | os.PathLike):
        return _of_file(Path(source), only)
    if isinstance(source, Mapping):
        return _Raw("table", [(str(k), np.asarray(v), None, None) for k, v in source.items()], _row)
    if hasattr(source, "columns") and hasattr(source, "index"):
        return _of_frame(source)
    raise TableError(
        "a table is a file (.csv, .parquet), a DataFrame, a mapping of names to arrays or a Recording, not a"
        f" {type(source).__name__}"
    )


def _row(k: int) -> str:
    return f"row {k + 1}"


def _of_recording(recording: Recording) -> _Raw:
    found = [
        (n, recording.data[:, i], recording.units.get(n, ""), recording.types.get(n))
        for i, n in enumerate(recording.names)
    ]
    return _Raw("recording", [(TIME, recording.time, "s", None), *found], _row)


def _of_frame(frame: Any) -> _Raw:
    """A pandas DataFrame; its time is a column, or else its index."""
    units = dict(frame.attrs.get("units", {})) if isinstance(frame.attrs.get("units", {}), Mapping) else {}
    found = [(str(n), frame.iloc[:, i].to_numpy(), units.get(n), None) for i, n in enumerate(frame.columns)]
    index = frame.index
    named = str(index.name).lower() in TIMES if index.name is not None else index.dtype.kind in "mM"
    if named:
        found.insert(0, (str(index.name or TIME), index.to_numpy(), units.get(index.name), None))
    return _Raw("DataFrame", found, _row)


def _of_file(path: Path, only: Sequence[str] | None) -> _Raw:
    if path.suffix.lower() not in (".csv", ".txt", ".tsv", ".parquet"):
        raise TableError(
            f"{path}: a table is .csv or .parquet; other recordings are read by Recording.read, which a Table takes as"
            " well"
        )
    if not path.is_file():
        raise TableError(f"{path}: there is no such file")
    return _of_parquet(path, only) if path.suffix.lower() == ".parquet" else _of_csv(path, only)


def _of_parquet(path: Path, only: Sequence[str] | None) -> _Raw:
    extras.require("data", "a table from Parquet")
    from pyarrow import parquet

    try:
        schema = parquet.read_schema(path)
        wanted = None
        if only is not None:  # the others are not read at all
            wanted = [n for n in schema.names if _taken(split_header(n)[0], only)]
        table = parquet_table(path, wanted)
    except Exception as error:  # whatever a library makes of a file that nobody wrote
        raise TableError(
            f"{path}: cannot be read as Parquet: {str(error).splitlines()[0] if str(error) else error!r}"
        ) from None
    found = []
    for i, field in enumerate(table.schema):
        column = table.column(i)
        name, missing = split_header(field.name)[0], column.null_count
        if missing:
            first = int(np.flatnonzero(column.is_null().to_numpy())[0])
            raise TableError(f"{path}, {_row(first)}: no value in column '{name}'; {_GAP}")
        about = field.metadata or {}
        unit = about.get(b"unit", about.get(b"units"))
        found.append((field.name, column.to_numpy(), None if unit is None else unit.decode("utf-8", "replace"), None))
    return _Raw(str(path), found, _row)


_GAP = "signals must not have gaps: fill them before"


def _taken(name: str, only: Sequence[str] | None) -> bool:
    return only is None or name in only or name.lower() in TIMES


def _of_csv(path: Path, only: Sequence[str] | None) -> _Raw:
    csv = CsvTable.read(path, TableError, "a table has a header such as 'time [s],z [m]' and lines of numbers")
    table = csv.numbers()
    kinds: list[str | None] = [None] * len(csv.header)
    if table is None or not np.isfinite(table).all():
        table, kinds = _by_cell(csv, only)
    found = [(h, table[:, i], None, kinds[i]) for i, h in enumerate(csv.header)]
    return _Raw(str(path), found, lambda k: f"line {csv.first + k}", whole=True)


def _by_cell(csv: CsvTable, only: Sequence[str] | None) -> tuple[Array, list[str | None]]:
    """Read cell by cell, with errors that name the cell; also returns the columns of `true` and `false`.

    Columns that are not taken may hold anything.
    """
    names = [split_header(h)[0] for h in csv.header]
    table = np.full((len(csv.lines), len(names)), np.nan)
    taken = [(i, n) for i, n in enumerate(names) if _taken(n, only)]
    booleans: set[int] = set()
    for k, cells in enumerate(csv.rows(_GAP)):
        for i, name in taken:
            if cells[i].lower() in BOOLEANS:
                booleans.add(i)
            table[k, i] = csv.number(k, f"column '{name}'", cells[i], _GAP)
    for i in booleans:
        mixed = np.flatnonzero(~np.isin(table[:, i], (0.0, 1.0)))
        if mixed.size:
            csv.refuse(int(mixed[0]), f"column '{names[i]}' is a number, but other rows are true or false")
    return table, ["boolean" if i in booleans else None for i in range(len(names))]


# ------------------------------------------------------------------------------------------------------- what is in it


def _time_column(raw: _Raw, names: Sequence[str], given: str | None) -> int:
    if given is not None:
        if given not in names:
            raise TableError(
                f"{raw.name}: no column '{given}' for the time{did_you_mean(given, names)} (there are:"
                f" {', '.join(names)})"
            )
        return list(names).index(given)
    small = [n.lower() for n in names]
    found = next((small.index(n) for n in TIMES if n in small), None)
    if found is None:
        raise TableError(
            f"{raw.name}: no column is the time ({', '.join(TIMES[:3])}) among {', '.join(names) or 'none'}; name it"
            " with time=..."
        )
    return found


def _plain_values(raw: _Raw, name: str, values: Any) -> tuple[Array, str]:
    """One-dimensional doubles, and "real", "integer" or "boolean" by the type of the array."""
    array = np.asarray(values)
    if array.ndim != 1 or len(array) != len(np.asarray(raw.columns[0][1])):
        raise TableError(
            f"{raw.name}: the column '{name}' has shape {array.shape}; columns are one-dimensional and of one length"
        )
    if array.dtype.kind == "O":
        array = _objects(raw, name, array)
    if array.dtype.kind not in "fbiu":
        raise TableError(
            f"{raw.name}: the column '{name}' holds {_KINDS.get(array.dtype.kind, 'no numbers')}, not numbers"
        )
    return array.astype(float), {"b": "boolean", "f": "real"}.get(array.dtype.kind, "integer")


_KINDS = {"U": "text", "S": "text", "T": "text", "M": "dates", "m": "durations", "c": "complex numbers", "O": "objects"}


def _objects(raw: _Raw, name: str, array: Any) -> Any:
    """Python's numbers (a column with None); text in it is named."""
    for k, value in enumerate(array):
        if value is None:
            raise TableError(f"{raw.name}, {raw.row(k)}: no value in column '{name}'; {_GAP}")
        if not isinstance(value, bool | int | float | np.number | np.bool_):
            shown = one_line(str(value), 40)
            raise TableError(f"{raw.name}, {raw.row(k)}: column '{name}' is {shown!r}, which is not a number")
    return (
        np.array([bool(v) for v in array])
        if all(isinstance(v, bool | np.bool_) for v in array)
        else array.astype(float)
    )


def _signal(raw: _Raw, name: str, values: Array, kind: str, unit: str, told: str | None) -> Signal:
    _finite(raw, name, values)
    if kind == "real" and told is None and raw.whole and np.array_equal(values, np.rint(values)):
        told = "whole"
    return Signal(name, values, unit_of(raw.name, name, unit), told or kind)


def _finite(raw: _Raw, name: str, values: Array) -> None:
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise TableError(f"{raw.name}, {raw.row(int(bad[0]))}: column '{name}' is {values[bad[0]]}; {_GAP}")


def _times(raw: _Raw, name: str, values: Any, unit: str) -> Array:
    """Times [s], which are finite and increase. Dates count from the first one."""
    array = np.asarray(values)
    if array.dtype.kind in "mM":
        missing = np.flatnonzero(np.isnat(array))
        if missing.size:
            raise TableError(f"{raw.name}, {raw.row(int(missing[0]))}: no time; {_GAP}")
        since = array if array.dtype.kind == "m" or not len(array) else array - array[0]
        seconds = since.astype("timedelta64[ns]").astype(np.int64) / 1e9
    else:
        seconds, _ = _plain_values(raw, name, array)
        _finite(raw, name, seconds)
        own = unit_of(raw.name, name, unit)
        if own is not None and own.exponents != KNOWN["s"].exponents:
            raise TableError(
                f"{raw.name}: the time column '{name}' has the unit '{unit}', which is not a unit of time (s, ms)"
            )
        scale, _ = conversion(own, KNOWN["s"])
        seconds = seconds if scale == 1.0 else seconds * scale
    if len(seconds) < 2:
        raise TableError(
            f"{raw.name}: {len(seconds)} row(s) of numbers; a signal needs two at least (start values hold one)"
        )
    wrong = np.flatnonzero(np.diff(seconds) <= 0)
    if wrong.size:
        k = int(wrong[0]) + 1
        what = "repeats" if seconds[k] == seconds[k - 1] else "goes back"
        raise TableError(
            f"{raw.name}, {raw.row(k)}: the time {what}, {seconds[k]:.12g} s after {seconds[k - 1]:.12g} s; times must"
            " increase from row to row (a jump needs two rows a little apart)"
        )
    return seconds
