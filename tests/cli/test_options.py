"""What the commands of all experiments share."""

from __future__ import annotations

from pathlib import Path

import pytest

from cosim.experiments.cli_options import study_page
from cosim.experiments.store import RunStore


@pytest.mark.parametrize("force", [False, True])
def test_force_makes_stored_runs_anew(force: bool, tmp_path: Path) -> None:
    made: list[int] = []

    def study(runs: Path, _: object) -> int:
        return RunStore(runs, "salt").get("case", lambda: len(made))

    def write(result: int, folder: Path) -> Path:
        made.append(result)
        return folder / "report.html"

    for _ in range(2):
        study_page("any", tmp_path, study, write, force=force)
    assert made == [0, 1 if force else 0]
