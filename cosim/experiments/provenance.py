"""What runs and reports depend on: FMU files, code and libraries."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import metadata
from pathlib import Path
from typing import Any

from build_fmus.sources import code_hash
from cosim.experiments.cases import FmuSet
from cosim.experiments.store import content_hash
from fmu_sources.catalog import PAPERS

COMPUTES = ("numpy", "scipy")  # libraries between FMUs and metrics


def salt(fmus: Iterable[Path], code: Iterable[str | Path]) -> str:
    """What all stored runs of an experiment depend on besides their case.

    Args:
        fmus: FMU files.
        code: modules (``__file__``) between FMUs and metrics; what they import of this project is added, the master too.
    """
    return content_hash(fmus) + code_hash(code) + "|".join(_versions(COMPUTES).values())


def provenance(fmus: FmuSet, files: Iterable[Path], libraries: Iterable[str] = ()) -> dict[str, Any]:
    """Versions, papers and hashes of the FMU ``files`` for a report; ``libraries`` are named besides the usual ones."""
    return {
        "versions": _versions(("suspension-fmus", *COMPUTES, "casadi", *libraries)),
        "papers": PAPERS,
        "FMI version": f"{fmus.fmi}.0",
        "FMUs (SHA-256)": {p.stem: content_hash([p]) for p in files},
    }


def _versions(names: Iterable[str]) -> dict[str, str]:
    return {n: metadata.version(n) for n in names}
