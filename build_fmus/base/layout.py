"""Where built FMUs lie: in a folder by FMI version, `fmus/fmi3/NAME.fmu`."""

from __future__ import annotations

from pathlib import Path

FMUS = Path("fmus")
"""The folder that `build-fmus` writes to, below the working folder."""


def fmu_path(folder: Path, fmi: int, name: str) -> Path:
    """The file of one FMU."""
    return folder / f"fmi{fmi}" / f"{name}.fmu"
