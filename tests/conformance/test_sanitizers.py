"""Runtime and generated code under AddressSanitizer (leaks included) and UndefinedBehaviorSanitizer."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from api import Library
from built import NAMES
from sanitized import FLAGS, gcc, kept_object

DRIVER = Path(__file__).with_name("driver.c")
COSTLY = {"FullCarHmmwvPublic", "FullCarHmmwvTires", "ThreeAxleTrench"}
"""Plants for whose equations gcc takes 10 to 30 seconds with these flags; others have the same kinds of statements."""


OTHER_NUMBERS = {
    "ForceTrackingPhysical",
    "FullCarHmmwvModified",
    "HydraulicActuatorPhysical",
    "LqrHmmwvKilonewton",
    "PreviewLqComfort5ms",
    "PreviewLqRoadHolding",
    "RideCarSedan",
    "RoadProvingGround5ms",
    "RoadProvingGroundHmmwv",
    "RoadProvingGroundHmmwvPublic",
    "RoadProvingGroundThreeAxle",
}
"""Components of the same function as another one, from other numbers."""


def _full_where_costly_or_alike(name: str) -> Any:
    return pytest.param(name, marks=[pytest.mark.full] * (name in COSTLY | OTHER_NUMBERS))


@pytest.mark.parametrize("name", [*map(_full_where_costly_or_alike, NAMES)])
@pytest.mark.sanitizer
@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc with AddressSanitizer")
def test_clean_under_sanitizers(fmu: Library, tmp_path: Path) -> None:
    sources = fmu.folder / "sources"
    program = tmp_path / "driver"
    objects = [
        *(kept_object(c, sources) for c in sorted(sources.rglob("*.c"))),
        kept_object(DRIVER, sources, f"-DFMI={fmu.fmi}"),
    ]
    gcc(*FLAGS, *map(str, objects), "-lm", "-o", str(program))
    environment = {**os.environ, "ASAN_OPTIONS": "detect_leaks=1:detect_stack_use_after_return=1"}
    run = subprocess.run(
        [str(program), repr(fmu.step)], capture_output=True, text=True, check=False, env=environment, timeout=300
    )
    assert run.returncode == 0, run.stdout[-3000:] + run.stderr[-3000:]
    assert run.stderr == ""
