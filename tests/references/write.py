"""Write `NAME_in.csv.xz` and `NAME_ref.csv.xz` of catalog FMUs into this folder; `xz -dc FILE` shows one as text.

    python tests/references/write.py [NAME ...]      # all of the catalog when no name is given

The numbers are those of the FMU's documentation: the Python evaluation of the component's declaration, 200 steps with
its own stimulus. Run it after a change that is meant to change results, look at the differences that it prints, and
commit them.
"""

from __future__ import annotations

import lzma
import sys
import zipfile
from pathlib import Path

import numpy as np

from build_fmus.builder import Options
from fmu_sources import cli

HERE = Path(__file__).parent
OUT = HERE.parents[1] / "fmus"


def write_references(names: list[str], directory: Path = HERE) -> None:
    """Copy the reference results out of the FMUs, which are brought up to date first."""
    cli.build(names, Options(OUT))
    for name in names or list(cli.load_catalog()):
        with zipfile.ZipFile(Options(OUT).target(name, 3)) as z:
            for what in ("in", "ref"):
                text, file = z.read(f"documentation/{name}_{what}.csv"), directory / f"{name}_{what}.csv.xz"
                before = lzma.decompress(file.read_bytes()) if file.is_file() else b""
                if text != before:
                    file.write_bytes(lzma.compress(text, preset=9 | lzma.PRESET_EXTREME))
                    print(f"{file.name}: {difference(before, text)}")


def difference(before: bytes, after: bytes) -> str:
    """The column that has changed most, by its largest value."""
    (old, a), (new, b) = map(table, (before, after))
    if old != new or a.shape != b.shape:
        return "other columns or rows"
    changes = np.abs(b - a).max(axis=0) / np.maximum(np.abs(a).max(axis=0), 1e-12)
    return f"{new[changes.argmax()]} by {changes.max():.2g} of its largest value"


def table(text: bytes) -> tuple[list[str], np.ndarray]:
    """Names of the columns, and values."""
    head, _, rows = text.decode().partition("\n")
    return head.split(","), np.loadtxt(rows.splitlines(), delimiter=",", ndmin=2)


if __name__ == "__main__":
    write_references(sys.argv[1:])
