"""Inputs of a system that columns of a table name: `cosim run --input FILE`."""

from __future__ import annotations

import os
import re
from pathlib import Path

from build_fmus.base.checks import did_you_mean
from cosim.system.wiring import Wiring
from cosim.tables.source import TableError, read
from cosim.tables.table import After, Table


def drive(system: Wiring, path: str | os.PathLike[str], *, after: After = "error") -> list[str]:
    """Let a file's columns drive the inputs of a system that they name, `component.variable`.

    They replace the former sources of these inputs; the new component has the name of the file. Columns are linear
    between rows, those of Integer and Boolean inputs held. Returns the names of these inputs. Raises TableError for a
    column that names no input, WiringError for units that do not fit.
    """
    path = Path(path)
    names = [s.name for s in read(path).columns]
    inputs = {f"{m.name}.{n}": v for m in system.components.values() for n, v in m.description.inputs.items()}
    targets = {name: system.canonical(name) for name in names}
    for name, target in targets.items():
        if target not in inputs:
            hint = did_you_mean(name, inputs)
            raise TableError(f"{path}: the column '{name}' names no input of the system, COMPONENT.INPUT{hint}")
    interpolation = {n: "linear" if inputs[t].type == "real" else "held" for n, t in targets.items()}
    stem = re.sub(r"[.\s*?]+", "_", path.stem) or "table"
    own = next(
        n for n in (stem, *(f"{stem}_{k}" for k in range(2, len(system.components) + 3))) if n not in system.components
    )
    system.add(own, Table(path, interpolation=interpolation, after=after))  # type: ignore[arg-type]
    for name, target in targets.items():
        if target in system.connections:
            system.disconnect(target)
        system.connect(f"{own}.{name}", target)
    return list(targets.values())
