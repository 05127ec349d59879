"""The same FMU from two compilers: what a component computes does not depend on who compiled it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from api import Library
from built import FMUS, BuiltFmus

from build_fmus.compile import ObjectCache, find_toolchain, host, resolve_platforms
from build_fmus.package import build_fmu
from fmu_sources.catalog import PAPERS, Context, default_catalog

# Tires (sin, cos, atan), stiff hydraulics (sqrt, ros2), noise (log, tan, cos), lidar (atan2), a quadratic program
NAMES = ("FullCarHmmwv", "HydraulicActuator", "SensorSuite", "TrenchCrossing", "MpcBench")


@pytest.mark.parametrize("name", NAMES)
def test_ziglang_and_the_host_compiler_give_the_same_bits(
    name: str, built_fmus: BuiltFmus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    component = default_catalog()[name].make(Context(FMUS, FMUS / ".cache"))
    component.bibliography = PAPERS  # which the code cites
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    assert "ziglang" in find_toolchain(host()).version
    path = tmp_path / f"{name}.fmu"
    path.write_bytes(build_fmu(component, 3, resolve_platforms("host"), ObjectCache(FMUS / ".cache" / "ziglang")))
    ours, theirs = Library(built_fmus.path(name, 3)), Library(path)
    assert ours.token == theirs.token
    results = []
    for fmu in (ours, theirs):
        with fmu.instance() as a:
            a.initialize(fmu.stimulus.row(0))
            first = a.get(fmu.outputs)
            results.append(np.vstack([first, a.run(len(fmu.stimulus.time) - 1, fmu.stimulus)]))
    assert np.ptp(results[0], axis=0).max() > 0  # something moves
    assert results[0].tobytes() == results[1].tobytes()
