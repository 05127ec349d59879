"""The integrator of Model Exchange FMUs under sanitizers, with saved memories that no integrator has written."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import fmpy
import pytest
from sanitized import FLAGS, gcc

from cosim.engine.library import INTEGRATOR
from cosim.fmu.environment import HEADER as ENVIRONMENT

DRIVER = Path(__file__).with_name("integrator_driver.c")
HEADERS = Path(fmpy.__file__).parent / "c-code"


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc with its sanitizers")
@pytest.mark.parametrize("version", [2, 3])
def test_nothing_is_written_outside_its_memory(version, tmp_path):
    program = tmp_path / "driver"
    include = (f"-I{HEADERS}", f"-I{INTEGRATOR.parent}", f"-I{ENVIRONMENT.parent}")
    gcc(
        *FLAGS,
        "-O1",
        f"-DFMI={version}",
        *include,
        str(DRIVER),
        str(INTEGRATOR.with_suffix(".c")),
        "-lm",
        "-o",
        str(program),
    )
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    counts = re.fullmatch(r"(\d+) steps, (\d+) failures\n", done.stdout)
    assert counts
    assert int(counts[1]) > 1000
    assert int(counts[2]) > 20
