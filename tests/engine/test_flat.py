"""Long runs and many systems leave nothing behind: memory, mappings, files, temporary folders."""

from __future__ import annotations

import gc
import os
import sys
import tempfile
from itertools import pairwise
from pathlib import Path

import pytest

from cosim import Record, System

pytestmark = [
    pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning"),
    pytest.mark.skipif(sys.platform != "linux", reason="reads /proc"),
]


def held() -> dict[str, int]:
    """What this process has: resident memory [pages], mappings, open files, temporary folders of ours."""
    gc.collect()
    folders = list(Path(tempfile.gettempdir()).glob("suspension-fmus-*/*"))
    return {
        "pages": int(Path("/proc/self/statm").read_text().split()[1]),
        "mappings": len(Path("/proc/self/maps").read_text().splitlines()),
        "files": len(os.listdir("/proc/self/fd")),
        "folders": len(folders),
    }


def least_growth(seen: list[dict[str, int]]) -> dict[str, int]:
    """Of each, between one look and the next.

    Only what a step, or a system, leaves behind grows every time. What the interpreter maps or touches once grows once.
    """
    return {what: min(after[what] - before[what] for before, after in pairwise(seen)) for what in seen[0]}


def chain(system: System, follower: dict[int, Path]) -> None:
    for name, version in (("a", 2), ("b", 3), ("c", 2)):
        system.add(name, follower[version], step="1 ms")
    system.connect("a.y", "b.u")
    system.connect("b.y", "c.u")


def test_a_million_steps_take_no_memory(follower, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))  # other workers have theirs at the same time
    with System() as system:
        chain(system, follower)
        with system.initialize(record=Record(["c.y"], "10 s")) as simulation:
            simulation.advance(10)
            seen = [held()]
            for _ in range(4):
                simulation.advance(250)  # 10^6 steps of each member in all
                seen.append(held())
    grown = least_growth(seen)
    assert grown["pages"] < 16
    assert max(grown["mappings"], grown["files"], grown["folders"]) <= 0


@pytest.mark.parametrize("count", [400, pytest.param(1000, marks=pytest.mark.full)])
def test_many_systems_leave_nothing(follower, tmp_path, monkeypatch, count):
    monkeypatch.setattr(
        tempfile, "tempdir", str(tmp_path)
    )  # of this test alone: other workers have theirs at the same time
    seen = []
    for k in range(count):
        with System() as system:
            chain(system, follower)
            system.run(0.005)
        if k >= 199 and (k - 199) % 50 == 0:  # the first ones load what all need
            seen.append(held())
    grown = least_growth(seen)
    assert grown["pages"] < 3 * 50  # pages of 4 kB; what cffi kept of every library was 6 for each system
    assert max(grown["mappings"], grown["files"], grown["folders"]) <= 0
    assert seen[-1]["folders"] == 0
