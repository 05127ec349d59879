"""Temporary files of this process, in one private folder.

It is removed when the process ends, or by a later process if this one was killed.
"""

from __future__ import annotations

import multiprocessing.util
import os
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from build_fmus.base.safe_files.whole import named

if sys.platform != "win32":
    import fcntl

_PREFIX = "suspension-fmus-scratch-"
_NAME = re.compile(rf"{_PREFIX}[a-z0-9_]{{8}}")  # as `mkdtemp` completes it


def scratch() -> Path:
    """The folder of this process for temporary files, which only its user can enter.

    Raises:
        OSError: it cannot be made.
    """
    place = os.getpid(), tempfile.gettempdir()
    if not (folder := _scratch(*place)).is_dir():  # a program that cleans temporary folders has removed it
        _scratch.cache_clear()
        folder = _scratch(*place)
    return folder


@contextmanager
def scratch_files(files: Mapping[str, bytes]) -> Iterator[Path]:
    """A temporary folder with these files, by their paths in it, until the block ends.

    Raises:
        OSError: it cannot be made or written to; the error names the folder.
    """
    with tempfile.TemporaryDirectory(dir=scratch()) as folder, named(folder):
        for name, data in files.items():
            path = Path(folder, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        yield Path(folder)


@cache
def _scratch(_process: int, temporary: str) -> Path:
    _remove_abandoned(Path(temporary))
    while True:
        folder = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=temporary))
        with suppress(FileNotFoundError):  # another process took it for abandoned before it was locked
            _lock(folder)
            if folder.is_dir():
                # Also runs where a process of `multiprocessing` ends, unlike `atexit`; not in a fork of this process.
                multiprocessing.util.Finalize(
                    None, shutil.rmtree, (folder,), {"ignore_errors": True}, exitpriority=-100
                )
                return folder


def _lock(folder: Path) -> None:
    """Lock a folder until this process, and every fork of it, has ended in whatever way."""
    if sys.platform == "win32":
        os.open(folder / "lock", os.O_CREAT)  # an open file cannot be removed
    else:
        descriptor = os.open(folder, os.O_RDONLY)
        with suppress(OSError):  # a file system without locks: no process can lock it, so none removes it
            fcntl.flock(descriptor, fcntl.LOCK_EX)


def _remove_abandoned(temporary: Path) -> None:
    """Remove the folders that processes of this user have left because they were killed."""
    with suppress(OSError):
        for name in filter(_NAME.fullmatch, os.listdir(temporary)):
            with suppress(OSError):
                _remove_unlocked(temporary / name)


def _remove_unlocked(folder: Path) -> None:
    if sys.platform == "win32":
        (folder / "lock").unlink()
        shutil.rmtree(folder, ignore_errors=True)
        return
    about = folder.lstat()
    if about.st_uid != os.getuid() or not stat.S_ISDIR(about.st_mode):
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        shutil.rmtree(folder, ignore_errors=True)
    finally:
        os.close(descriptor)
