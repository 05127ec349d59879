"""Heights of two wheel tracks from an ASCII OpenCRG file (formats LRFI and LDFI).

Read are the grid, reference-line slope and banking. Curvature does not matter here: distance is measured along the
reference line. Binary files and file references are refused with the way out.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from build_fmus.checks import number
from fmu_sources.roads.errors import RoadError, check_length

_WIDTH = {"LRFI": 10, "LDFI": 20}  # characters of one value; lines have up to 80
_LINE = 80


def read_opencrg(path: Path, *, left: float, right: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance [m] along the reference line, and heights [m] at the lateral positions ``left`` and ``right`` [m].

    Raises:
        RoadError: naming the file and what is wrong.
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise RoadError(f"{path}: cannot be read: {error.strerror}") from None
    lines = raw.decode("latin-1").splitlines()
    end = next((i for i, text in enumerate(lines) if text.startswith("$$$$")), None)
    if end is None:
        raise RoadError(f"{path}: no line '$$$$' that ends the header; this is not an OpenCRG file")
    sections = _sections(lines[:end])
    if "ROAD_CRG_FILE" in sections:
        raise RoadError(f"{path}: refers to another file; give that file instead")
    head = _numbers(path, sections.get("ROAD_CRG", []))
    form, channels = _channels(path, sections.get("KD_DEFINITION", []))
    values = _values(path, lines[end + 1 :], end + 2, _WIDTH[form], len(channels))

    increment = head.get("REFERENCE_LINE_INCREMENT", 0.01)
    start = head.get("REFERENCE_LINE_START_U", 0.0)
    number(f"{path}: REFERENCE_LINE_INCREMENT", increment, "m", above=0, error=RoadError)
    distance = start + increment * np.arange(len(values))
    sections_at = [(i, text) for i, text in enumerate(channels) if text.startswith("long section")]
    v = _lateral(path, [text for _, text in sections_at], head)
    if right < v.min() - 1e-6 or left > v.max() + 1e-6:
        across = f"{v.min():g} to {v.max():g} m"
        raise RoadError(f"{path}: the road reaches {across} across, but the wheels run at {right:g} and {left:g} m")
    grid = values[:, [i for i, _ in sections_at]]
    order = np.argsort(v)
    slope = _along(channels, values, "reference line slope", head.get("REFERENCE_LINE_START_S", 0.0))
    banking = _along(channels, values, "reference line banking", head.get("REFERENCE_LINE_START_B", 0.0))
    line = np.concatenate([[0.0], np.cumsum(slope[1:] * increment)])
    tracks = []
    for at in (left, right):
        heights = np.array([np.interp(at, v[order], row[order]) for row in grid]) + line + banking * at
        missing = np.flatnonzero(~np.isfinite(heights))
        if missing.size:
            where = f"{at:g} m across at distance {distance[missing[0]]:g} m"
            raise RoadError(f"{path}: no height {where}; roads must not have gaps")
        tracks.append(heights)
    if len(distance) < 2:
        raise RoadError(f"{path}: {len(distance)} cross-section(s); a road needs at least two")
    return distance, tracks[0], tracks[1]


def _sections(lines: list[str]) -> dict[str, list[str]]:
    """Header sections by upper-case keyword, comments removed."""
    sections: dict[str, list[str]] = {}
    current: list[str] = []
    for raw in lines:
        if raw.startswith("*"):
            continue
        text = raw.split("!", 1)[0].strip()
        if text.startswith("$"):
            current = []
            if text != "$":
                sections[text[1:].split()[0].upper()] = current
        elif text:
            current.append(text)
    return sections


_HEAD = frozenset({
    "REFERENCE_LINE_INCREMENT", "REFERENCE_LINE_START_U", "REFERENCE_LINE_START_S", "REFERENCE_LINE_START_B",
    "LONG_SECTION_V_RIGHT", "LONG_SECTION_V_LEFT", "LONG_SECTION_V_INCREMENT",
})  # fmt: skip
"""What is read of the header; the rest, as positions on the map and curvature, does not matter here."""


def _numbers(path: Path, lines: list[str]) -> dict[str, float]:
    found = {}
    for text in lines:
        name, equals, value = (part.strip() for part in text.partition("="))
        if equals and name.upper() in _HEAD:
            found[name.upper()] = _number(value, f"{path}: {name.upper()}")
    return found


def _number(text: str, what: str) -> float:
    """A number as Fortran writes it (1.5D+02), of a size that roads have."""
    try:
        value = float(text.upper().replace("D", "E"))
    except ValueError:
        raise RoadError(f"{what} is {text[:40]!r}, which is not a number") from None
    return check_length(value, what)


def _channels(path: Path, lines: list[str]) -> tuple[str, list[str]]:
    form = next((text[2:].strip().upper() for text in lines if text.startswith("#:")), "KRBI")
    if form not in _WIDTH:
        known = ", ".join(_WIDTH)
        raise RoadError(f"{path}: data format {form}; only ASCII ({known}) is read; OpenCRG tools convert binary files")
    channels = [" ".join(text[2:].split(",")[0].split()).lower() for text in lines if text.upper().startswith("D:")]
    if sum(c.startswith("long section") for c in channels) < 2:
        raise RoadError(
            f"{path}: fewer than two 'D:long section' channels; a road surface needs a left and a right side"
        )
    return form, channels


def _values(path: Path, lines: list[str], first: int, width: int, count: int) -> np.ndarray:
    """Cross-sections x channels. A cross-section starts a new line and may take several; no number means no height."""
    per_record = -(-count * width // _LINE)
    lines = [text for text in lines if text.strip()]
    if len(lines) % per_record:
        raise RoadError(f"{path}: {len(lines)} lines of data, {per_record} per cross-section: the file is cut short")
    rows = []
    for at in range(0, len(lines), per_record):
        text = "".join(part.ljust(_LINE) for part in lines[at : at + per_record])
        row = []
        for k in range(count):
            cell = text[k * width : (k + 1) * width].strip()
            gap = not cell or "*" in cell or cell.lower().lstrip("+-") == "nan"
            where = f"{path}, line {first + at + k * width // _LINE}: value {k + 1} of {width} characters"
            row.append(np.nan if gap else _number(cell, where))
        rows.append(row)
    return np.array(rows, dtype=float).reshape(-1, count)


def _lateral(path: Path, names: list[str], head: dict[str, float]) -> np.ndarray:
    """Lateral position of each long section: given with it, or counted from the right in equal steps."""
    positions = [re.search(r"at v ?= ?(\S+)", text) for text in names]
    if all(positions):
        return np.array([_number(m[1], f"{path}: position of {m.string!r}") for m in positions if m])
    if any(positions):
        raise RoadError(f"{path}: some long sections have a position ('at v = ...'), others do not")
    right, increment = head.get("LONG_SECTION_V_RIGHT"), head.get("LONG_SECTION_V_INCREMENT")
    if increment is None and right is not None and (left := head.get("LONG_SECTION_V_LEFT")) is not None:
        increment = (left - right) / (len(names) - 1)
    if right is None or not increment:
        raise RoadError(
            f"{path}: LONG_SECTION_V_RIGHT and LONG_SECTION_V_INCREMENT are needed for numbered long sections"
        )
    return right + increment * np.arange(len(names))


def _along(channels: list[str], values: np.ndarray, name: str, constant: float) -> np.ndarray:
    if name not in channels:
        return np.full(len(values), constant)
    return np.nan_to_num(values[:, channels.index(name)])
