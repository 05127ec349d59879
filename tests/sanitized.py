"""C files compiled under sanitizers, each once per content."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from built import FMUS

from build_fmus.base import safe_files
from build_fmus.compile import included_headers

FLAGS = (
    "-std=c99",
    "-g1",
    "-ffp-contract=off",
    "-fsanitize=address,undefined",
    "-fsanitize=float-cast-overflow",
    "-fno-sanitize-recover=all",
    "-fno-omit-frame-pointer",
)
THREADS = ("-std=gnu99", "-g1", "-ffp-contract=off", "-fsanitize=thread")
KEPT = FMUS / ".cache" / "sanitized"
VERSION = "" if shutil.which("gcc") is None else subprocess.check_output(["gcc", "--version"], text=True)


def kept_object(source: Path, include: Path, *told: str, sanitizers: Sequence[str] = FLAGS) -> Path:
    """One C file compiled; both FMI versions and all FMUs share most of theirs, from one test run to the next too.

    Thousands of lines of equations are optimized little: with -O1 compiling them takes twice as long, with -O0 running
    them does.
    """
    flags = (*sanitizers, "-Og" if source.name == "model.c" else "-O1", *told)
    parts = [" ".join(flags).encode(), VERSION.encode(), source.read_bytes()]
    parts += [h.name.encode() + b"\0" + h.read_bytes() for h in included_headers(source, [include])]
    key = hashlib.sha256(b"\0".join(parts)).hexdigest()[:32]
    try:
        return safe_files.kept_file(KEPT, key, ".o")
    except safe_files.CacheMiss:
        return safe_files.keep_file(
            KEPT, key, ".o", lambda out: gcc(*flags, f"-I{include}", "-c", str(source), "-o", str(out))
        )


def gcc(*arguments: str) -> None:
    build = subprocess.run(["gcc", *arguments], capture_output=True, text=True, check=False)
    assert build.returncode == 0, build.stderr
