"""Reads files of C libraries (HDF5, MF4) in a process of its own, since damaged files may hang or crash a reader.

The process has a limit of processor time and of memory, and ends with its parent. It leaves arrays as `.npy` and the
rest as JSON, which hold no code.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from build_fmus.base import safe_files
from build_fmus.base.interpreters import PYTHON, environment
from cosim.core.base_error import CosimError
from cosim.core.memory import physical_memory

SECONDS = 60.0
"""Processor time that any file gets [s]; `_RATE` more for each byte."""
_RATE = 1e-6
ARRAYS, ABOUT = ("time", "data"), ("names", "units", "types")
"""Attributes of what is read."""
_SLACK = 4.0  # times the processor time, on a machine that does other things too


class NotRead(Exception):  # noqa: N818
    """The process has no answer; the text says why. `refused`: the file could be read, and is no recording."""

    def __init__(self, text: str, refused: bool = False):
        super().__init__(text)
        self.refused = refused


def read_apart(path: Path, program: str) -> dict[str, Any]:
    """What a program that calls `answer` makes of a file, in a process of its own: `ARRAYS` and `ABOUT` by name.

    Raises:
        NotRead: with what the library says of the file, or how its process ended.
    """
    seconds = SECONDS + _RATE * path.stat().st_size
    with safe_files.scratch_files({}) as folder:
        command = [*PYTHON, "-c", program, str(path.resolve()), str(folder), str(seconds), str(os.getpid())]
        null = subprocess.DEVNULL
        process = subprocess.Popen(command, stdin=null, stdout=null, stderr=null, env=environment())
        try:
            code = process.wait(_SLACK * seconds)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            process.kill()
            process.wait()
        return _answer(folder, code, seconds)


def _answer(folder: Path, code: int | None, seconds: float) -> dict[str, Any]:
    try:
        about = json.loads((folder / "about.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        how = f"did not end within {seconds:g} s" if code is None else f"ended with exit code {code}"
        raise NotRead(f"the process that read it {how}; the file is damaged, or too large for this machine") from None
    if "error" in about:
        raise NotRead(about["error"], about["refused"])
    return about | {name: np.load(folder / f"{name}.npy", allow_pickle=False) for name in ARRAYS}


def answer(read: Callable[[Path], Any]) -> None:
    """In the process: read the file, and leave what came of it in the folder."""
    path, folder, seconds, parent = Path(sys.argv[1]), Path(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4])
    _limit(seconds, parent)
    try:
        content = read(path)
        for name in ARRAYS:
            np.save(folder / f"{name}.npy", getattr(content, name), allow_pickle=False)
        text = json.dumps({name: getattr(content, name) for name in ABOUT})
    except MemoryError:
        text = json.dumps({"error": "it needs more than half of this machine's memory", "refused": False})
    except Exception as error:  # whatever a library makes of a file that nobody wrote
        lines = str(error).splitlines()
        said = (lines[0] if lines else type(error).__name__).removeprefix(f"{path}: ")
        text = json.dumps({"error": said, "refused": isinstance(error, CosimError)})
    (folder / "part.json").write_text(text, encoding="utf-8")
    (folder / "part.json").rename(folder / "about.json")


def _limit(seconds: float, parent: int) -> None:
    """Processor time and memory, where the system has such limits; on Linux it also ends when its parent does."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 2))
        resource.setrlimit(resource.RLIMIT_AS, (physical_memory() // 2, physical_memory() // 2))
    if sys.platform == "linux":
        import ctypes
        import signal

        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
        if os.getppid() != parent:  # which was gone before
            os._exit(1)
