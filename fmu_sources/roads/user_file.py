"""A road from a user's file: CSV with distance and heights, or ASCII OpenCRG."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from build_fmus.base import units
from build_fmus.base.checks import nearest
from build_fmus.base.csv_table import CsvTable
from build_fmus.component import Component
from fmu_sources.roads.enveloping import rolled
from fmu_sources.roads.errors import RoadError, check_length
from fmu_sources.roads.height_table import HeightTable, road_from_table
from fmu_sources.roads.layout import RoadLayout
from fmu_sources.roads.opencrg import read_opencrg

_COLUMNS = {
    "distance": ("distance", "x", "s", "station", "position"),
    "left": ("left", "left height", "z left", "zl"),
    "right": ("right", "right height", "z right", "zr"),
}
_SHORTEST = 0.01  # m
_COARSEST = 1.0  # m between heights: at 20 m/s, such a road excites nothing above 10 Hz, near which wheels resonate
_HEADER = "distance [m],left [m],right [m]"


def road_from_file(path: Path | str, layout: RoadLayout, name: str = "RoadUser", *, radius: float = 0.0) -> Component:
    """A road from a CSV file with the columns `distance [m],left [m],right [m]`, or from an OpenCRG file (`.crg`).

    Comma or semicolon separate; with semicolons a decimal comma is understood. Each column has its unit. Distances must
    increase. Equidistant points are used as they are, others are sampled at their smallest spacing, see
    `HeightTable.resampled`, which may be 1 m. From OpenCRG the tracks of the layout's wheels are sampled. Heights
    are shifted so that the road starts at 0 (mean of both tracks). With a `radius` [m] they are those that a rigid
    wheel follows, see `fmu_sources.roads.enveloping.rolled`.

    Raises:
        RoadError: naming the file, the line and what is wrong.
    """
    path = Path(path)
    distance, left, right = heights_from_file(path, max(abs(w.y) for w in layout.wheels))
    check_length(float(np.abs([left, right]).max()), f"{path}: the largest height")
    if not distance[-1] - distance[0] >= _SHORTEST:
        raise RoadError(
            f"{path}: the road is {distance[-1] - distance[0]:g} m long; a road needs {_SHORTEST:g} m at least"
        )
    datum = (left[0] + right[0]) / 2
    table = HeightTable.resampled(distance, left - datum, right - datum)
    if table.step > _COARSEST * (1 + 1e-6):
        raise RoadError(
            f"{path}: the heights are {table.step:.4g} m apart where they are closest, and a road needs them at most"
            f" {_COARSEST:g} m apart: at a speed v it excites frequencies up to v / (2 x {table.step:.4g} m),"
            f" {20 / (2 * table.step):.2g} Hz at 20 m/s, and wheels resonate near 10 Hz. Give more heights; measured"
            " roads have one every 0.1 m or less"
        )
    table = replace(table, left=rolled(table.left, table.step, radius), right=rolled(table.right, table.step, radius))
    return road_from_table(
        table,
        layout,
        name,
        description=f"Road from the file {path.name}",
        source=f"file {path.name}",
        notes=(
            (
                f"Heights from the file {path.name}: {len(distance)} points over {distance[-1] - distance[0]:g} m, held"
                f" every {table.step:g} m, which excites frequencies up to {0.5 / table.step:.3g} Hz for each m/s of"
                f" speed, shifted by {-datum:g} m so that the road starts at height 0."
            ),
            *((f"Heights are those that a rigid wheel of {radius:g} m radius follows.",) if radius else ()),
        ),
    )


def heights_from_file(path: Path, half_track: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance, left and right height [m] of a road file.

    Of OpenCRG at `half_track` [m] to both sides of the reference line.

    Raises:
        RoadError: as `road_from_file`.
    """
    if path.suffix.lower() == ".crg":
        return read_opencrg(path, left=half_track, right=-half_track)
    return read_csv(path)


def read_csv(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance, left and right height [m] of a CSV road; see `road_from_file`."""
    table = CsvTable.read(path, RoadError, f"a road is CSV with header {_HEADER!r}, or OpenCRG (.crg)")
    columns = _columns(table)
    rows: list[list[float]] = []
    for k, cells in enumerate(table.rows("remove it or fill the gap with heights")):
        row = []
        for name, index, unit in columns:
            number = table.number(k, f"column '{name}'", cells[index], "roads must not have gaps")
            row.append(check_length(units.convert(number, unit, "m"), f"{path}, line {table.first + k}: {name}"))
        if rows and row[0] <= rows[-1][0]:
            table.refuse(
                k,
                f"distance {row[0]:g} m after {rows[-1][0]:g} m; distances must increase from line to line (a vertical"
                " step needs two points a little apart)",
            )
        rows.append(row)
    if len(rows) < 2:
        raise RoadError(f"{path}: {len(rows)} line(s) of numbers; a road needs at least two points")
    distance, left, right = np.array(rows).T
    return distance, left, right


def _columns(table: CsvTable) -> list[tuple[str, int, str]]:
    """Name, index and unit of the distance, left and right columns."""
    names, given = [], []
    for cell in table.header:
        match = re.fullmatch(r"\s*\"?\s*([^\[\(\"]*?)\s*(?:[\[\(]\s*([^\]\)]*?)\s*[\]\)])?\s*\"?\s*", cell)
        name, unit = (match[1], match[2]) if match else (cell, None)
        names.append(re.sub(r"[\s_\-]+", " ", name).strip().lower())
        given.append(unit)
    found = []
    for column, variants in _COLUMNS.items():
        index = next((names.index(v) for v in variants if v in names), None)
        if index is None:
            near = nearest(column, names)
            hint = f"; is {near[0]!r} meant to be it?" if near else ""
            table.refuse(
                -1,
                f"no column {column!r} among {', '.join(map(repr, names))}{hint} (a road file starts with the line"
                f" {_HEADER!r})",
            )
        if not (unit := given[index]):
            table.refuse(
                -1,
                f"column {names[index]!r} has no unit; write it in brackets, such as '{names[index]} [m]' or"
                f" '{names[index]} [mm]'",
            )
        try:
            units.convert(1.0, unit, "m")
        except KeyError as error:
            table.refuse(-1, f"column {column!r}: {error.args[0]}")
        found.append((column, index, unit))
    return found
