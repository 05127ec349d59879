"""Checks against reference results that travel inside an FMU."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

from build_fmus.base.csv_table import CsvTable
from cosim.check.bench import Bench, Values
from cosim.check.calls import Ended, Instance, Refused
from cosim.check.model import Var
from cosim.check.rules import Found, NotApplicable, check, names, note, require
from cosim.core.errors import FmuError
from cosim.fmu.limits import Limits
from cosim.fmu.xml import tree

MOST_ROWS = 2000
TOLERANCE = 1e-3  # of the largest value of a column: what the FMI cross-check asks for is similar


@check(
    "references.results",
    "the FMU reproduces its reference results",
    fmi2="FMI Cross-Check Rules (NAME_in.csv, NAME_ref.csv); 2.3 FMU Distribution (documentation)",
    fmi3="FMI-LS-REF (reference results); 2.5.1.1 Directory documentation",
    advice="Regenerate the reference results, or find out what has changed.",
    kinds=("cs",),
    worst="warning",
)
def results(bench: Bench) -> Found:
    folder = bench.fmu.folder
    found = sorted({*folder.glob("documentation/**/*_ref.csv"), *folder.glob("resources/*_ref.csv"), *_listed(folder)})
    require(found, "there are no reference results inside (NAME_ref.csv)")
    for path in found[:4]:
        inputs = path.with_name(path.name.removesuffix("_ref.csv") + "_in.csv")
        try:
            reference = _table(path)
            signals = _table(inputs) if inputs.is_file() else ([], [])
        except ValueError as error:
            yield f"{path.name}: {error}"
            continue
        yield from _compared(bench, path.name, reference, signals)


LAYERED = "extra/org.fmi-standard.fmi-ls-ref"


def _listed(folder: Path) -> list[Path]:
    """Tables that FMI-LS-REF calls results: those of its manifest, and those by their names in its folder."""
    found = [*folder.glob(f"{LAYERED}/**/*_ref.csv")]
    manifest = folder / LAYERED / "fmi-ls-manifest.xml"
    if manifest.is_file():
        try:
            root = tree(manifest.read_bytes(), str(manifest), Limits())
        except FmuError:
            return found
        for related in root.iterfind(".//Related"):
            path = (manifest.parent / related.get("source", "")).resolve()
            if (
                related.get("role", "").startswith("result")
                and path.suffix == ".csv"
                and path.is_file()
                and folder.resolve() in path.parents
            ):
                found.append(folder / path.relative_to(folder.resolve()))
    return found


Table = tuple[list[str], list[list[float]]]


def _table(path: Path) -> Table:
    """Names and rows of a table that begins with time. Raises ValueError."""
    file = CsvTable.read(path, ValueError, "it is not a table whose first column is time", separators=",")
    if not file.lines or file.header[0].strip('"').lower() != "time":
        raise ValueError("it is not a table whose first column is time")
    gap = "a reference has a number in each cell"
    rows = itertools.islice(enumerate(file.rows(gap)), MOST_ROWS + 1)
    return list(file.header), [[file.number(k, "it", cell, gap) for cell in row] for k, row in rows]


def _compared(bench: Bench, name: str, reference: Table, signals: Table) -> Found:
    columns = _columns(bench, reference[0][1:])
    missing = [n for n in reference[0][1:] if n not in columns]
    if missing:
        yield note(f"{name}: there are no variables {names(missing)}")
    driven = _columns(bench, signals[0][1:]) if signals[0] else {}
    times = [row[0] for row in reference[1]]
    steps = [b - a for a, b in itertools.pairwise(times)]
    if not columns or not steps or min(steps) <= 0:
        raise NotApplicable("its reference results have no variables of the FMU, or times that do not increase")
    if not bench.interface.variable_step and max(steps) - min(steps) > 1e-6 * max(steps):
        raise NotApplicable("its reference results have steps of different lengths, which it does not support")

    def work(a: Instance) -> list[Values]:
        rows = []
        a.model.experiment["startTime"] = times[0]
        try:
            a.initialize(_values(driven, _row(signals, 0)))
            rows.append(a.get(list(columns.values())))
            k = 0
            for i in range(1, len(times)):
                while k + 1 < len(signals[1]) and signals[1][k + 1][0] <= times[i - 1] + 1e-9 * steps[0]:
                    k += 1
                if driven:
                    a.set(_values(driven, _row(signals, k)))
                a.step(times[i] - times[i - 1])
                rows.append(a.get(list(columns.values())))
        except Ended:
            pass
        return rows

    try:
        rows = bench.alone(work)
    except Refused as refused:
        yield f"{name}: {refused}"
        return
    worst, at = 0.0, ""
    for j, column in enumerate(reference[0][1:], start=1):
        v = columns.get(column)
        if v is None:
            continue
        expected = [row[j] for row in reference[1][: len(rows)]]
        scale = max(*map(abs, expected), 1e-9)
        for e, got in zip(expected, rows, strict=True):
            error = abs(float(got[v][0]) - e) / scale
            if not error <= worst:
                worst, at = (math.inf if math.isnan(error) else error), column
    bench.measures[f"deviation from {name}"] = f"{worst:.2g} of the largest value" if at else "none"
    if worst > TOLERANCE:
        yield f"{name}: {at!r} deviates by {100 * worst:.3g} % of its largest value"


def _columns(bench: Bench, header: list[str]) -> dict[str, Var]:
    by_name = {
        v.name: v
        for v in bench.fmu.readable(bench.model.variables)
        if v.size == 1 and (v.is_number or v.access == "Boolean")
    }
    return {n: by_name[n] for n in header if n in by_name}


def _row(signals: Table, k: int) -> dict[str, float]:
    names_, rows = signals
    return dict(zip(names_[1:], rows[k][1:], strict=True)) if rows else {}


def _values(driven: dict[str, Var], row: dict[str, float]) -> dict[Var, list[Any]]:
    return {v: [row[n] if v.is_float else int(row[n])] for n, v in driven.items()}
