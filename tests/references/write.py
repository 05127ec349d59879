"""Write `NAME_in.csv` and `NAME_ref.csv` of catalog FMUs into this folder.

    python tests/references/write.py [NAME ...]      # all of the catalog when no name is given

The numbers are those of the FMU's documentation: the Python evaluation of the component's declaration, 200 steps with
its own stimulus. Run it after a change that is meant to change results, look at the difference, and commit it.
"""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path

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
                (directory / f"{name}_{what}.csv").write_bytes(z.read(f"documentation/{name}_{what}.csv"))


if __name__ == "__main__":
    write_references(sys.argv[1:])
