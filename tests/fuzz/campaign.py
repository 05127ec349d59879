"""Many cases of one target, in a process of their own: whatever ends it is the failure of the case that it was at.

The process is fresh, so that the memory it may use is that of a user's script, and it writes the number of each case
into a file before it begins.
"""

from __future__ import annotations

import gzip
import hashlib
import os
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from . import bench
from .targets import target

ROOT = Path(__file__).parents[2]
CORPUS = Path(__file__).parent / "corpus"
MEMORY = Path("/dev/shm")  # where there is such a place: folders are made and removed by the thousand
SILENCE = 2 * bench.HANGS  # s without a new case, after which the process is ended
_NUMBER = struct.Struct("<q")


@dataclass(frozen=True)
class Failure:
    """A case that did not end as it should: its number, what came of it, and the file that has it now."""

    target: str
    seed: int
    number: int
    what: str
    file: Path

    def __str__(self) -> str:
        return f"{self.target} --seed {self.seed} --first {self.number} --cases 1: {self.file}\n{self.what.rstrip()}"


def campaign(
    name: str,
    seed: int,
    first: int,
    count: int,
    *,
    corpus: Path = CORPUS,
    most: int = 20,
    longest: float = bench.LONGEST,
) -> tuple[list[Failure], int]:
    """Failures among the cases `first` to `first + count - 1`, at most `most`, and the number of cases tried."""
    failures: list[Failure] = []
    at, end = first, first + count
    while at < end and len(failures) < most:
        reached, what = _worker(name, seed, at, end, longest)
        if what is None:
            return failures, count
        failures.append(Failure(name, seed, reached, what, _keep(name, seed, reached, corpus)))
        at = reached + 1
    return failures, at - first


def replay(name: str, files: Sequence[Path], longest: float = bench.LONGEST) -> str | None:
    """What is wrong with how the cases in some files end, in a process of its own, or None."""
    command = _command("--replay", name, str(longest), *map(str, files))
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return (
        None if done.returncode == 0 else f"{done.stdout}{done.stderr}" or f"the process ended with {done.returncode}"
    )


def _keep(name: str, seed: int, number: int, corpus: Path) -> Path:
    """The case as a file of the corpus, packed: some are a bracket a hundred thousand times."""
    case = target(name).make(bench.seeded(name, seed, number))
    file = corpus / name / f"{hashlib.sha256(case).hexdigest()[:16]}.gz"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(gzip.compress(case, mtime=0))
    return file


def kept(file: Path) -> bytes:
    """The case in a file of the corpus."""
    return gzip.decompress(file.read_bytes())


def _command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "tests.fuzz", *arguments]


def _worker(name: str, seed: int, first: int, end: int, longest: float) -> tuple[int, str | None]:
    """Run cases from `first`; the number of the case that failed, and how; or None when none did."""
    with tempfile.TemporaryDirectory(prefix="fuzz-", dir=MEMORY if MEMORY.is_dir() else None) as folder:
        progress, out = Path(folder) / "progress", Path(folder) / "out"
        progress.write_bytes(_NUMBER.pack(first))
        temporary = {**os.environ, "TMPDIR": folder, "BUILD_FMUS_CACHE": os.environ.get("BUILD_FMUS_CACHE", folder)}
        command = _command("--work", name, str(seed), str(first), str(end), str(progress), str(longest))
        with out.open("w") as stream:
            process = subprocess.Popen(command, cwd=ROOT, stdout=stream, stderr=subprocess.STDOUT, env=temporary)
            code = _wait(process, progress)
        reached = _NUMBER.unpack(progress.read_bytes())[0]
        said = out.read_text(errors="replace")
    if code == 0:
        return reached, None
    return reached, said if code == 1 and said else f"the process ended with {code}\n{said[-2000:]}"


def _wait(process: subprocess.Popen[bytes], progress: Path) -> int | str:
    """How the process ends; one that hangs is killed."""
    seen, since = b"", time.monotonic()
    while True:
        try:
            return process.wait(timeout=1)
        except subprocess.TimeoutExpired:
            now = progress.read_bytes()
            if now != seen:
                seen, since = now, time.monotonic()
            elif time.monotonic() - since > SILENCE:
                process.kill()
                process.wait()
                return f"a kill: no case ended for {SILENCE:g} s"
        except BaseException:
            process.kill()
            raise


def work(name: str, seed: int, first: int, end: int, progress: Path, longest: float) -> int:
    """In the process: run the cases; 1 at the first that fails, which is told on the standard output."""
    module = target(name)
    with progress.open("r+b", buffering=0) as file:
        for number in range(first, end):
            os.pwrite(file.fileno(), _NUMBER.pack(number), 0)
            if what := bench.failure(module, module.make(bench.seeded(name, seed, number)), longest):
                print(what)
                return 1
    return 0
