"""The verdicts that are kept in `docs/results`: what README and results.md say of each study."""

from __future__ import annotations

import json
import runpy
from pathlib import Path
from typing import Any

from cosim.report.write import summary
from cosim.study import Experiment, FmuSet, Results
from cosim.study.experiment import resolved

_FOLDER = Path(__file__).parents[2] / "docs" / "results"


def kept_claims(experiment: str) -> list[dict[str, Any]]:
    """Every claim as it is told, in the order of the report."""
    found: list[dict[str, Any]] = json.loads((_FOLDER / f"{experiment}.json").read_text(encoding="utf-8"))["claims"]
    return found


def kept_verdicts(experiment: str) -> dict[str, str]:
    """Verdict by claim, in the order of the report."""
    return {c["id"]: c["verdict"] for c in kept_claims(experiment)}


def is_kept(experiment: str) -> bool:
    """Whether the study was run on the newest FMUs; README and results.md name those that were not."""
    return (_FOLDER / f"{experiment}.json").is_file()


def kept_readings(experiment: str) -> dict[str, Any]:
    """Verdicts of a study under several readings, as `docs/write_results.py` keeps them."""
    found: dict[str, Any] = json.loads((_FOLDER / "readings" / f"{experiment}.json").read_text(encoding="utf-8"))
    return found


def readings_of(experiment: Experiment, results: Results, fmus: FmuSet) -> dict[str, Any]:
    """The same of a study that was run now."""
    writer = runpy.run_path(str(_FOLDER.parent / "write_results.py"))
    found: dict[str, Any] = writer["condense_readings"](summary(resolved(experiment.study.report)(results, fmus)))
    return found
