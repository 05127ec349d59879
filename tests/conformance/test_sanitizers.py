"""Runtime and generated code under AddressSanitizer (leaks included) and UndefinedBehaviorSanitizer."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from api import Library

DRIVER = Path(__file__).with_name("driver.c")
FLAGS = (
    "-std=c99", "-O1", "-g1", "-ffp-contract=off", "-fsanitize=address,undefined", "-fsanitize=float-cast-overflow",
    "-fno-sanitize-recover=all", "-fno-omit-frame-pointer",
)  # fmt: skip


@pytest.mark.sanitizer
@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc with AddressSanitizer")
def test_clean_under_sanitizers(fmu: Library, tmp_path: Path) -> None:
    sources = fmu.folder / "sources"
    program = tmp_path / "driver"
    build = subprocess.run(
        ["gcc", *FLAGS, f"-DFMI={fmu.fmi}", f"-DSTEP={fmu.step!r}", f"-I{sources}", str(DRIVER),
         *map(str, sorted(sources.rglob("*.c"))), "-lm", "-o", str(program)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert build.returncode == 0, build.stderr
    environment = {**os.environ, "ASAN_OPTIONS": "detect_leaks=1:detect_stack_use_after_return=1"}
    run = subprocess.run([str(program)], capture_output=True, text=True, check=False, env=environment, timeout=300)
    assert run.returncode == 0, run.stdout[-3000:] + run.stderr[-3000:]
    assert run.stderr == ""
