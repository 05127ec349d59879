"""Write a file that takes the place of an older one only when it is whole, and name the path in whatever goes wrong."""

from __future__ import annotations

import errno
import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

_count = itertools.count()


def write(path: str | os.PathLike[str], content: str | bytes) -> Path:
    """Write `content` (text in UTF-8, lines ended as they are) and return the path; see `opened`."""
    with opened(path, "wb") as file:
        file.write(content.encode() if isinstance(content, str) else content)
    return Path(path)


@contextmanager
def opened(path: str | os.PathLike[str], mode: str = "w", **options: Any) -> Iterator[IO[Any]]:
    """A file to write that appears under `path` when the block ends without error.

    `mode` and `options` are as of `open`. Until the end an older file stays as it is; after an error nothing is
    left of the new one. The folder is made. A link stays a link; what is no regular file (`/dev/stdout`) is written
    directly.

    Raises:
        OSError: it cannot be written, with `filename` set (a full disk has no name of its own).
    """
    given = Path(path)
    target = Path(os.path.realpath(given))
    part = target.with_name(f".{target.name[:40]}.{os.getpid()}-{next(_count)}.part")
    with named(given, part):
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists() and not target.is_file():
            with target.open(mode, **options) as file:
                yield file
            return
        try:
            with part.open(mode, **options) as file:
                yield file
            os.replace(part, target)
        finally:
            part.unlink(missing_ok=True)


@contextmanager
def named(path: str | os.PathLike[str], temporary: str | os.PathLike[str] | None = None) -> Iterator[None]:
    """Around work on `path`: an OSError without a file name (a full disk) gets this path.

    So does one that names the `temporary` file.
    """
    try:
        yield
    except OSError as error:
        unnamed = error.filename is None and error.errno is not None
        if unnamed or (temporary is not None and str(error.filename).startswith(str(temporary))):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def sentence(error: OSError) -> str:
    """An error of the operating system for people: the path, what is wrong, and for a full disk what to do."""
    if error.filename is None:
        return str(error) if error.errno is None else f"{error.strerror}"
    return (
        f"{error.filename}:"
        f" {error.strerror}{'; free disk space there, or write to another directory' if is_full(error) else ''}"
    )


def is_full(error: BaseException | None) -> bool:
    """Whether a full disk is behind an error, in whatever it was wrapped."""
    while error is not None and not (isinstance(error, OSError) and error.errno in _FULL):
        error = error.__cause__ or error.__context__
    return error is not None


_FULL = {errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC)}
