"""Third-party FMUs in this process.

What they do to the floating-point environment is put back, and a hang can be ended.
"""

from __future__ import annotations

import os
import platform
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from foreign import hostile
from same import assert_same

from cosim import CosimError, Recording, System
from cosim.recording.spool import recover

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")


def beside(follower: Path, culprit: Path) -> Recording:
    """What a neighbor computes whose numbers depend on rounding, in a run with that FMU before it."""
    with System() as system:
        system.add("culprit", culprit)
        system.add("neighbour", follower, step="1 ms", start={"u": 1.0})
        return system.run(0.05, record=["culprit.y", "neighbour.y"])  # type: ignore[arg-type]


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(("deed", "what"), [("round", "rounding"), ("flush", "subnormal")])
@pytest.mark.parametrize("phase", ["load", "step", "get", "enter"])
def test_the_floating_point_environment_is_put_back(folder, follower, harmless, version, deed, what, phase):
    right = beside(follower[version], harmless)
    with pytest.warns(UserWarning, match=rf"'culprit' .*{what}"):
        found = beside(follower[version], hostile.build(version, folder, phase, deed))
    assert_same(right, found)


DIVIDES = """
import sys
import numpy as np
from cosim import PythonComponent, System
class Divides(PythonComponent):
    outputs = ("y",)
    def step(self, t, h, u, y):
        with np.errstate(divide="ignore"):
            y[0] = np.isinf(np.array([1.0]) / np.array([0.0]))[0]
system = System(allow_unconnected=True)
system.add("culprit", sys.argv[1])
system.add("neighbour", Divides, step="1 ms")
print(system.run(0.05, record=["culprit.y", "neighbour.y"])["neighbour.y"][-1])
"""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="other processors may have no traps")
@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("phase", ["step", "get"])
def test_traps_are_put_back_before_the_next_component_divides_by_zero(folder, version, phase):
    culprit = hostile.build(version, folder, phase, "traps")
    run = subprocess.run(
        [sys.executable, "-c", DIVIDES, culprit], capture_output=True, text=True, timeout=120, check=False
    )
    assert (run.returncode, run.stdout.strip()) == (0, "1.0"), run.stderr
    assert "changes the traps of floating-point arithmetic" in " ".join(run.stderr.split())
    with System(allow_unconnected=True) as system:
        system.add("culprit", culprit, isolated=True)
        with pytest.raises(CosimError, match="it changed the traps of floating-point arithmetic"):
            system.run(0.05, record=["culprit.y"])


HANGS = """
import sys
from cosim import System
system = System(allow_unconnected=True)
system.add("bad", sys.argv[1], isolated=sys.argv[3] == "isolated")
try:
    system.run(0.5, record=["bad.y"], output=sys.argv[2])
    system.close()
except KeyboardInterrupt as error:
    print("interrupted:", error)
    sys.exit(7)
"""


@pytest.mark.parametrize("phase", ["step", "enter", "free"])
@pytest.mark.parametrize("where", ["isolated", "here"])
def test_a_second_interrupt_ends_a_hang(folder, tmp_path, phase, where):
    csv, proof = tmp_path / "out.csv", tmp_path / "hangs"
    command = [sys.executable, "-c", HANGS, hostile.build(2, folder, phase, "hang"), csv, where]
    environment = {**os.environ, "HOSTILE_PROOF": str(proof)}
    process = subprocess.Popen(list(map(str, command)), stdout=-1, stderr=-1, text=True, env=environment)
    end = time.monotonic() + 300
    while not proof.exists() and time.monotonic() < end:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    time.sleep(1.0)
    assert process.poll() is None  # the first one waits for the FMU
    process.send_signal(signal.SIGINT)
    said, errors = process.communicate(timeout=300)
    if where == "isolated":
        assert process.returncode == 7, errors
        assert "interrupted" in said
        assert phase == "enter" or csv.stat().st_size > 0
    else:
        assert process.returncode == 128 + signal.SIGINT, (said, errors)
        assert "does not come back" in errors
        assert "cosim recover" in errors


LOST = """
import os, sys
from cosim import System
system = System(allow_unconnected=True)
system.add("bad", sys.argv[1], start={"u": 0.0})
system.run(100, record=["bad.y"], output=sys.argv[2])
"""


@pytest.mark.parametrize("deed", ["segfault", "quit", "exit-0"])
def test_rows_that_were_spooled_outlive_the_process(folder, tmp_path, deed):
    """The FMU does its deed late: after half a second of steps that take a millisecond each."""
    csv = tmp_path / "out.csv"
    environment = {**os.environ, "HOSTILE_STEP": "400", "HOSTILE_SLOW": "1"}
    command = [sys.executable, "-c", LOST, hostile.build(3, folder, "step", deed), csv]
    done = subprocess.run(
        list(map(str, command)), env=environment, capture_output=True, check=False, timeout=300, text=True
    )
    assert done.returncode == {"segfault": -signal.SIGSEGV, "quit": 0, "exit-0": 1}[deed]
    assert ("an FMU has ended this process by a call of exit()" in done.stderr) == (deed == "exit-0")
    _, recovered = recover(csv)
    assert len(recovered) > 100
    assert recovered["bad.y"][:50].tolist() == list(range(50))


ENDS = """
import sys
from cosim import System
with System(allow_unconnected=True) as system:
    system.add("good", sys.argv[1])
    system.run(0.01, record=["good.y"])
{end}
"""


@pytest.mark.parametrize(("end", "code"), [("", 0), ("sys.exit(5)", 5)])
def test_a_process_that_python_ends_keeps_its_exit_code(harmless: Path, end: str, code: int) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", ENDS.format(end=end), harmless],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code
    assert "exit()" not in done.stderr
