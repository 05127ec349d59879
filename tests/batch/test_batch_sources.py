"""What of an FMU's sources becomes lanes, and what is refused with its reason: nothing is guessed."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import pytest
from built import FMUS, OBJECTS

from build_fmus.compile import resolve_platforms
from build_fmus.component import Component
from build_fmus.package import build_fmu
from cosim import System
from cosim.batch import Batch
from cosim.batch.lane_source import NoLanes, lane_source
from cosim.fmu.file import FmuFile

pytestmark = pytest.mark.usefixtures("built_fmus")
PLANT = FMUS / "fmi3" / "QuarterCarBench.fmu"


def changed(tmp_path: Path, change: Callable[[str, bytes], bytes | None]) -> Path:
    """The quarter car with other files; None leaves one out."""
    path = tmp_path / "Changed.fmu"
    with zipfile.ZipFile(PLANT) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            data = change(name, old.read(name))
            if data is not None:
                new.writestr(name, data)
    return path


@pytest.mark.parametrize(
    "change",
    [
        lambda n, d: None if n.startswith("sources/") else d,
        lambda n, d: None if n == "sources/model.c" else d,
        lambda n, d: re.sub(rb'"token":"[^"]*"', b'"token":"{other}"', d) if n == "sources/lanes.json" else d,
        lambda n, d: None if n == "sources/lanes.json" else d,
        lambda n, d: d.replace(b'"sizes":', b'"size":') if n == "sources/lanes.json" else d,
        lambda n, d: b"[" if n == "sources/lanes.json" else d,
        lambda n, d: b"[]" if n == "sources/lanes.json" else d,
        lambda n, d: d + b"\n/* */\n" if n == "sources/integrators.c" else d,
        lambda n, d: d.replace(b"static void outputs", b"static int outputs") if n == "sources/model.c" else d,
    ],
)
def test_sources_that_are_not_those_of_the_binary_are_not_used(
    tmp_path: Path, change: Callable[[str, bytes], bytes | None], raises
) -> None:
    path = changed(tmp_path, change)
    with raises(NoLanes):
        lane_source(FmuFile(path, quiet=True)).settings((0,))
    with System() as system:
        system.add("plant", path, step="1 ms")
        system.allow_unconnected = True
        with Batch(system, 2, threads=1, outputs="plant.body.z") as batch:
            batch.advance(0.01)
            assert list(batch.scalar) == ["plant"]


def test_operations_that_lanes_do_not_have_are_said(tmp_path: Path, raises) -> None:
    c = Component("Table", kind="discrete", description="a test", source="none", sample_time=0.1, symbols=ca.MX)
    table = ca.interpolant("table", "linear", [[0.0, 1.0, 2.0]], [0.0, 1.0, 4.0])
    c.output("read", table(c.input("x", "1", "x")), "1", "from a table")
    path = tmp_path / "Table.fmu"
    path.write_bytes(build_fmu(c, 3, resolve_platforms("host"), OBJECTS))
    with raises(NoLanes):
        lane_source(FmuFile(path))


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("MpcBench", "quadratic programs"),
        ("PreviewLqTunable", "linear equations"),
        ("HydraulicActuator", "ros2"),
        ("RoadRandom", ""),
        ("LqrBench", ""),
        ("ThreeAxleTrench", ""),
    ],
)
def test_which_of_our_fmus_have_copies_side_by_side(name: str, said: str) -> None:
    source = lane_source(FmuFile(FMUS / "fmi3" / f"{name}.fmu"))
    assert bool(source.one_at_a_time) == bool(said)
    assert said in source.one_at_a_time
    assert "#define N_SHOWN 1" in source.settings((0,))
