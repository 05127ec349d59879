"""FMUs that an experiment makes of a component where the catalog has none, for this machine and this process."""

from __future__ import annotations

import tempfile
from pathlib import Path

from build_fmus.base import safe_files
from build_fmus.compile import ObjectCache, resolve_platforms
from build_fmus.component import Component
from build_fmus.package import build_fmu


def built(component: Component, fmi: int) -> Path:
    """The FMU of a component, in a folder of its own that goes when the process ends."""
    folder = Path(tempfile.mkdtemp(dir=safe_files.scratch()))
    fmu = folder / f"{component.name}.fmu"
    safe_files.write(fmu, build_fmu(component, fmi, resolve_platforms("host"), ObjectCache(folder / "objects")))
    return fmu
