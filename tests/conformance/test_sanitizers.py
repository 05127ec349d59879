"""Runtime and generated code under AddressSanitizer (leaks included) and UndefinedBehaviorSanitizer."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
from pathlib import Path

import pytest
from api import Library
from built import FMUS

from build_fmus import safe_files
from build_fmus.compile import included_headers

DRIVER = Path(__file__).with_name("driver.c")
FLAGS = (
    "-std=c99", "-g1", "-ffp-contract=off", "-fsanitize=address,undefined", "-fsanitize=float-cast-overflow",
    "-fno-sanitize-recover=all", "-fno-omit-frame-pointer",
)  # fmt: skip
KEPT = FMUS / ".cache" / "sanitized"
VERSION = "" if shutil.which("gcc") is None else subprocess.check_output(["gcc", "--version"], text=True)


def kept_object(source: Path, include: Path, *told: str) -> Path:
    """One C file compiled; both FMI versions and all FMUs share most of theirs, from one test run to the next too. Thousands
    of lines of equations are optimized little: with -O1 compiling them takes twice as long, with -O0 running them does."""
    flags = (*FLAGS, "-Og" if source.name == "model.c" else "-O1", *told)
    parts = [" ".join(flags).encode(), VERSION.encode(), source.read_bytes()]
    parts += [h.name.encode() + b"\0" + h.read_bytes() for h in included_headers(source, [include])]
    key = hashlib.sha256(b"\0".join(parts)).hexdigest()[:32]
    try:
        return safe_files.kept_file(KEPT, key, ".o")
    except safe_files.NotKept:
        return safe_files.keep_file(
            KEPT, key, ".o", lambda out: gcc(*flags, f"-I{include}", "-c", str(source), "-o", str(out))
        )


def gcc(*arguments: str) -> None:
    build = subprocess.run(["gcc", *arguments], capture_output=True, text=True, check=False)
    assert build.returncode == 0, build.stderr


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
