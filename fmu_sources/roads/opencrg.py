"""Heights of two wheel tracks from an OpenCRG file: binary (KRBI, KDBI) and ASCII (LRFI, LDFI).

pyopencrg reads and evaluates the file. Slope and banking of the reference line and the file's own modifiers count. Its
heading does not matter here: distance is measured along the reference line, on which the car drives. This module
refuses what the library would pass over or guess, and says where in the file it stands.
"""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from build_fmus.base import extras
from build_fmus.base.checks import number
from fmu_sources.roads.errors import RoadError, check_length

_BINARY = {"KRBI": 4, "KDBI": 8}  # bytes of one value
_ASCII = {"LRFI": 10, "LDFI": 20}  # characters of one value; lines have up to 80
_LINE = 80
_TOLERANCE = 1e-6  # m
_CLOSE = 1e-3  # m, of positions across that are given twice
_GUESSED = ("cannot read", "badly written")  # how warnings of the library begin that name a value it has replaced


def read_opencrg(path: Path, *, left: float, right: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance [m] along the reference line, and heights [m] at the lateral positions `left` and `right` [m].

    Heights are those of the road that the file describes: grid, slope and banking, with the modifiers that it holds.
    Missing values are filled only where the file says how (`GRID_NAN_MODE`).

    Raises:
        RoadError: naming the file, the cross-section or line, and what is wrong.
        MissingExtraError: without the extra [data].
    """
    with extras.needed("data", "reading OpenCRG files"):
        import pyopencrg
        from pyopencrg import io
    try:
        path.open("rb").close()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of roads that are moved, which does not matter here
            header = io.read_ipl(path, meta_only=True)
            elsewhere, _ = io.cut_block(header.struct, "ROAD_CRG_FILE")
            data = path if elsewhere is None else _referred(path, elsewhere)
            if data != path:
                header = io.read_ipl(data, meta_only=True)
            _check_header(data, header)
            _check_data(data, header)
            road = pyopencrg.read(path, check=False)
            _check_reading(path, road)
            if road.mods:
                road = road.apply_mods()
            return _tracks(path, road, left, right)
    except RoadError:
        raise
    except OSError as error:
        raise RoadError(f"{path}: cannot be read: {error.strerror or error}") from None
    except Exception as error:  # whatever a library makes of a file that nobody wrote
        raise RoadError(f"{path}: {str(error).removeprefix(f'{path}: ') or type(error).__name__}") from None


def _referred(path: Path, block: list[str]) -> Path:
    """The file with the grid of one that holds options and modifiers only."""
    name = "".join(line.split("!", 1)[0].strip() for line in block if not line.startswith("*"))
    other = path.parent / os.path.expandvars(name)  # as the format says
    if not other.is_file():
        raise RoadError(f"{path}: refers to another file for its grid ($ROAD_CRG_FILE), {other}, which is not there")
    return other


def _check_header(path: Path, header: Any) -> None:
    """What must be in a header for the library not to guess."""
    if not header.kd_def:
        raise RoadError(
            f"{path}: no channels ('D:' in $KD_DEFINITION, before the line '$$$$'); this is not an OpenCRG file"
        )
    if header.fmt not in (*_BINARY, *_ASCII):
        raise RoadError(f"{path}: data format {header.fmt!r}; it must be one of {', '.join((*_BINARY, *_ASCII))}")
    head = _numbers(path, header.struct)
    names = [" ".join(text.split(",")[0].split()).lower() for text in header.kd_def]
    sections = [n for n in names if n.startswith("long section")]
    placed = [(name, name.partition("at v")[2].strip(" =")) for name in sections if "at v" in name]
    positions = [_number(text, f"{path}: position of {name!r}") for name, text in placed]
    if len(set(positions)) < len(positions):
        raise RoadError(f"{path}: two long sections have the same lateral position")
    if len(sections) < 2:
        raise RoadError(
            f"{path}: fewer than two 'D:long section' channels; a road surface needs a left and a right side"
        )
    given = {"LONG_SECTION_V_INCREMENT", "LONG_SECTION_V_LEFT"} & head.keys()
    if len(placed) < len(sections) and not ("LONG_SECTION_V_RIGHT" in head and given):
        raise RoadError(
            f"{path}: LONG_SECTION_V_RIGHT and LONG_SECTION_V_INCREMENT are needed for numbered long sections"
        )
    _check_sides(path, head, positions, len(sections))


def _check_sides(path: Path, head: dict[str, float], positions: list[float], sections: int) -> None:
    """Check that the header's statements about the lateral positions fit together.

    They count from right to left. Otherwise the sides may be swapped.
    """
    right, left, apart = (head.get(f"LONG_SECTION_V_{n}") for n in ("RIGHT", "LEFT", "INCREMENT"))
    swapped = "v counts to the left, so left and right are swapped"
    if right is not None and left is not None and right >= left:
        raise RoadError(
            f"{path}: LONG_SECTION_V_RIGHT = {right:g} m is not to the right of LONG_SECTION_V_LEFT = {left:g} m;"
            f" {swapped}"
        )
    if apart is not None and apart <= 0:
        raise RoadError(f"{path}: LONG_SECTION_V_INCREMENT = {apart:g} m is not above 0; {swapped}")
    first, last = right, left
    if positions:
        first, last = min(positions), max(positions)
    elif right is not None and apart is not None:
        last = right + apart * (sections - 1)
    for name, told, found in (("RIGHT", right, first), ("LEFT", left, last)):
        if told is not None and found is not None and abs(told - found) > _CLOSE:
            where = f"the outermost of {sections} long sections is at {found:g} m"
            raise RoadError(f"{path}: LONG_SECTION_V_{name} = {told:g} m, but {where}: left and right are ambiguous")


def _numbers(path: Path, lines: list[str]) -> dict[str, float]:
    """The numbers of the header, by upper-case keyword; what is used of them must be of a size that roads have."""
    found = {}
    for line in lines:
        name, equals, value = (part.strip() for part in line.split("!", 1)[0].partition("="))
        if not equals or line.startswith("*") or not name.upper().startswith(("REFERENCE_LINE_", "LONG_SECTION_")):
            continue
        found[name.upper()] = _number(value, f"{path}: {name.upper()}")
    if "REFERENCE_LINE_INCREMENT" in found:
        what = f"{path}: REFERENCE_LINE_INCREMENT"
        number(what, found["REFERENCE_LINE_INCREMENT"], "m", above=0, error=RoadError)
    return found


def _cross_sections(head: dict[str, float]) -> int | None:
    """How many the header announces; None where it does not say."""
    try:
        length = head["REFERENCE_LINE_END_U"] - head.get("REFERENCE_LINE_START_U", 0.0)
        return round(length / head["REFERENCE_LINE_INCREMENT"]) + 1
    except (KeyError, OverflowError):
        return None


def _check_data(path: Path, header: Any) -> None:
    """Check that the data are whole cross-sections, as many as announced.

    All of them are numbers, or `*` or NaN for what is missing.
    """
    channels = len(header.kd_def)
    announced = _cross_sections(_numbers(path, header.struct))
    binary = header.fmt in _BINARY
    found = _binary(path, header, channels, announced) if binary else _ascii(path, header, channels)
    if found < 2:
        raise RoadError(f"{path}: {found} cross-section(s); a road needs at least two")
    if announced is not None and found != announced:
        raise RoadError(
            f"{path}: {found} cross-sections of {channels} values, {announced} by REFERENCE_LINE_START_U, END_U and"
            " INCREMENT" + (f": it is cut short after cross-section {found}" if found < announced else "")
        )


def _binary(path: Path, header: Any, channels: int, announced: int | None) -> int:
    """The number of cross-sections; behind the last one nothing but NaN."""
    size = _BINARY[header.fmt]
    with path.open("rb") as file:
        file.seek(header.data_offset)
        data = file.read()
    n, rest = divmod(len(data), size)
    if rest and data[-rest:].strip():  # white space at the end does no harm
        raise RoadError(
            f"{path}: {len(data)} bytes of data are not whole values of {size} bytes ({header.fmt}): it is cut short in"
            f" cross-section {n // channels + 1}, or was changed as text"
        )
    values = np.frombuffer(data, dtype=f">f{size}", count=n)
    infinite = np.flatnonzero(np.isinf(values))
    if infinite.size:
        raise RoadError(f"{path}: cross-section {int(infinite[0]) // channels + 1} holds an infinite value")
    if announced is None:  # whole cross-sections, and NaN up to the end of the last block of 80 bytes
        filled = np.flatnonzero(~np.isnan(values))
        announced = -(-(int(filled[-1]) + 1) // channels) if filled.size else 0
        if announced * channels > n:
            raise RoadError(
                f"{path}: cross-section {announced} is cut short, at value {n - (announced - 1) * channels} of"
                f" {channels}"
            )
    more = np.flatnonzero(~np.isnan(values[announced * channels :]))
    if more.size:
        return announced + int(more[-1]) // channels + 1
    return min(announced, n // channels)


def _ascii(path: Path, header: Any, channels: int) -> int:
    """The number of cross-sections. Each starts a new line and may take several."""
    width = _ASCII[header.fmt]
    per_record = -(-channels * width // _LINE)
    with path.open("rb") as file:
        before = file.read(header.data_offset).count(b"\n")
        lines = file.read().decode("latin-1").split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    for at, line in enumerate(lines):
        used = min(_LINE, (channels - at % per_record * (_LINE // width)) * width)
        text = line.rstrip("\r")[:used]
        for begin in range(0, len(text), width):
            cell = text[begin : begin + width].strip()
            where = f"{path}, line {before + at + 1}, columns {begin + 1} to {begin + width}"
            if cell and "*" not in cell and cell.lower().lstrip("+-") != "nan":
                _number(cell, where)
    if len(lines) % per_record:
        raise RoadError(
            f"{path}: {len(lines)} lines of data, {per_record} per cross-section: it is cut short in cross-section"
            f" {len(lines) // per_record + 1}"
        )
    return len(lines) // per_record


def _number(text: str, what: str) -> float:
    """A number as Fortran writes it (1.5D+02), of a size that roads have."""
    try:
        value = float(text.upper().replace("D", "E"))
    except ValueError:
        raise RoadError(f"{what} is {text[:40]!r}, which is not a number") from None
    return check_length(value, what)


def _check_reading(path: Path, road: Any) -> None:
    """What the library has found wrong, or replaced by a default."""
    wrong = [*road.read_errors, *(w for w in road.read_warnings if w.startswith(_GUESSED))]
    if wrong:
        raise RoadError(f"{path}: {'; '.join(wrong)}")


def _tracks(path: Path, road: Any, left: float, right: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance and heights of two tracks, which are there and of a size that roads have."""
    v, distance = np.asarray(road.v, dtype=float), np.asarray(road.u, dtype=float)
    if right < v.min() - _TOLERANCE or left > v.max() + _TOLERANCE:
        across = f"{v.min():g} to {v.max():g} m"
        raise RoadError(f"{path}: the road reaches {across} across, but the wheels run at {right:g} and {left:g} m")
    for end in (distance[0], distance[-1]):
        check_length(float(end), f"{path}: the distance along the reference line")
    tracks = []
    with np.errstate(all="ignore"):  # of numbers beyond any road, which are looked at here
        for at in (left, right):
            heights = np.asarray(road.uv_to_z(distance, np.full(len(distance), at)), dtype=float)
            missing = np.flatnonzero(np.isnan(heights))
            if missing.size:
                k = int(missing[0])
                k += not np.isnan(road.z[k]).any()  # the library interpolates with weight 0 from the next one too
                where = f"{at:g} m across at distance {distance[k]:g} m (cross-section {k + 1})"
                raise RoadError(f"{path}: no height {where}; roads must not have gaps")
            worst = int(np.argmax(np.abs(heights)))
            check_length(float(heights[worst]), f"{path}: cross-section {worst + 1}: the height {at:g} m across")
            tracks.append(heights)
    return distance, tracks[0], tracks[1]
