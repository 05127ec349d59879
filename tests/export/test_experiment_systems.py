"""The system of every experiment as one FMU, in both versions of FMI: valid, and without an error of `cosim check`."""

from __future__ import annotations

from pathlib import Path

import pytest
from built import BuiltFmus
from fmpy.validation import validate_fmu
from ssp.systems import EVERY, experiment_system

from cosim.check import Options, check
from cosim.fmu.file import FmuFile
from cosim.fmu.validation import Verdict

QUICK = "bench"
"""The smallest; `make test-full` checks all."""


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", [pytest.param(n, marks=() if n == QUICK else pytest.mark.full) for n in EVERY])
def test_exported_systems_keep_to_the_standard(built_fmus: BuiltFmus, tmp_path: Path, name: str, fmi: int) -> None:  # noqa: ARG001
    with experiment_system(name) as system:
        path = system.export_fmu(tmp_path / "System.fmu", fmi=fmi)
    assert validate_fmu(str(path)) == []
    assert FmuFile(path, strict=True).verdict == Verdict()
    report = check(path, Options(seconds=300.0))  # large systems on a busy machine
    assert [str(finding) for _, finding in report.findings() if finding.severity == "error"] == []
