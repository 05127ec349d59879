"""Derivatives of initial values, which pass through components several times."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from built import OBJECTS

from build_fmus.compile import resolve_platforms
from build_fmus.component import Component
from build_fmus.package import build_fmu
from cosim import System
from cosim.gradient import Final, Mean, Metric


@pytest.mark.parametrize("size", [1e-14, 1.0])
def test_a_small_derivative_goes_all_the_way_at_once(tmp_path: Path, size: float) -> None:
    """Through components without states, of which the first is passed twice."""
    first = Component("First", kind="continuous", description="two ways", source="none")
    level = first.parameter("level", 3.0, "1", "level", source="none")
    back = first.input("back", "1", "what comes back")
    first.output("there", (level - 3.0) * size, "1", "level")
    first.output("further", back, "1", "what came back")
    gain = Component("Gain", kind="continuous", description="one way", source="none")
    gain.output("y", 2.0 * gain.input("u", "1", "in"), "1", "out")
    with System() as system:
        for name, component in (("first", first), ("gain", gain), ("last", gain)):
            path = tmp_path / f"{component.name}.fmu"
            path.write_bytes(build_fmu(component, 3, resolve_platforms("host"), OBJECTS))
            system.add(name, path, step="10 ms")
        for source, target in (("first.there", "gain.u"), ("gain.y", "first.back"), ("first.further", "last.u")):
            system.connect(source, target)
        metrics: Mapping[str, Metric] = {"mean": Mean("last.y"), "end": Final("last.y")}
        for mode in ("forward", "adjoint"):
            found = system.gradient(metrics, "first.level", stop_time="50 ms", mode=mode)
            np.testing.assert_allclose(found.jacobian[:, 0], 4.0 * size, rtol=1e-12, err_msg=mode)
