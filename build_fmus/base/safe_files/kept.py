"""What is kept to save work: every entry carries a hash of its content and its name, which is checked when it is read.

A damaged entry is removed with a `DamagedWarning` that names it, and counts as missing.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import tempfile
import warnings
from bisect import bisect_left
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any

from build_fmus.base.safe_files.whole import named, write

_since: ContextVar[int] = ContextVar("since", default=0)  # ns; entries older than this are not looked at


class DamagedWarning(UserWarning):
    """Something kept is not what was written; it is made again."""


class CacheMiss(LookupError):  # noqa: N818
    """There is no entry, or none that can be used."""


# ------------------------------------------------------------------------------------------------------------ values


def keep_json(path: Path, value: Any) -> None:
    """Keep a JSON value in a file."""
    write(path, json.dumps({"sha256": _digest(path.name, value), "value": value}) + "\n")


def kept_json(path: Path) -> Any:
    """The value that `keep_json` wrote there.

    Raises:
        CacheMiss: no such file, one that is older than `ignore_cache` allows, or a damaged one.
    """
    if not _usable(path):
        raise CacheMiss(path)
    try:
        entry = json.loads(path.read_bytes())
        if entry["sha256"] == _digest(path.name, entry["value"]):
            return entry["value"]
    except (ValueError, KeyError, TypeError, RecursionError):  # the last of brackets without an end
        pass
    _discard(path)
    raise CacheMiss(path)


def _digest(name: str, value: Any) -> str:
    """Hash of a value as it will be read: JSON has no tuples, and only text as keys."""
    read = json.loads(json.dumps(value))
    return hashlib.sha256(f"{name}\0{json.dumps(read, sort_keys=True)}".encode()).hexdigest()


# ------------------------------------------------------------------------------------------------------------- files


def keep_file(directory: Path, key: str, suffix: str, make: Callable[[Path], None]) -> Path:
    """Keep the file that `make` writes to the path it is given.

    Its name is made of `key` and the hash of its content.
    """
    directory.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=directory) as folder, named(directory, folder):
        made = Path(folder) / f"{key}{suffix}"
        make(made)
        path = directory / f"{key}-{_file_digest(key, made)}{suffix}"
        os.replace(made, path)
    _names.cache_clear()  # the clock of a file system may not have moved since
    return path


def kept_file(directory: Path, key: str, suffix: str) -> Path:
    """The file that `keep_file` kept under `key`.

    Raises:
        CacheMiss: no such file, one that is older than `ignore_cache` allows, or a damaged one.
    """
    with suppress(FileNotFoundError):  # nothing was kept yet, or another process has removed a file
        names = _names(directory, os.stat(directory).st_mtime_ns)
        for name in islice(names, bisect_left(names, f"{key}-"), None):
            if not name.startswith(f"{key}-"):
                break
            if not name.endswith(suffix):
                continue
            path = directory / name
            if name != f"{key}-{_file_digest(key, path)}{suffix}":
                _discard(path)
            elif _usable(path):
                return path
    raise CacheMiss(directory / f"{key}{suffix}")


@lru_cache(maxsize=16)
def _names(directory: Path, changed: int) -> list[str]:  # noqa: ARG001
    """Names in a directory that last changed then [ns], sorted: listing thousands takes longer than reading a file."""
    return sorted(os.listdir(directory))


def _file_digest(key: str, path: Path) -> str:
    return hashlib.sha256(f"{key}\0".encode() + path.read_bytes()).hexdigest()[:32]


# -------------------------------------------------------------------------------------------------------------- both


@contextmanager
def ignore_cache(since: int) -> Iterator[None]:
    """In the block, cache entries older than `since` (a time of `filesystem_time`; 0: no limit) count as missing."""
    token = _since.set(since)
    try:
        yield
    finally:
        _since.reset(token)


def filesystem_time(directory: Path) -> int:
    """Now [ns], by the clock that dates the files of a directory."""
    with named(directory):
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=directory) as file:
            file.write(b".")
            file.flush()
            return os.stat(file.name).st_mtime_ns


def plain_warnings() -> None:
    """For programs: show warnings as one line, without the place in the code that gave them."""

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        print(f"warning: {message}", file=sys.stderr)

    warnings.showwarning = show


def _usable(path: Path) -> bool:
    try:
        return path.stat().st_mtime_ns >= _since.get()
    except OSError:
        return False


def _discard(path: Path) -> None:
    warnings.warn(f"{path} is damaged; it is discarded and created again", DamagedWarning, stacklevel=3)
    path.unlink(missing_ok=True)
