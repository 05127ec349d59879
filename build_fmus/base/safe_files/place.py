"""Where a user's caches lie: in folders to which nobody else can write, since code is loaded from them."""

from __future__ import annotations

import os
import stat
import tempfile
import warnings
from functools import cache
from pathlib import Path

from build_fmus.base.safe_files.scratch import scratch


class SharedFolderWarning(UserWarning):
    """Other users can change what lies in a folder for caches, so it is not used."""


def cache_directory() -> Path:
    """Where downloads and compiled code are kept: `BUILD_FMUS_CACHE`, the user's cache folder, or a temporary one.

    A folder that belongs to another user, or to which others can write, is not used, with a
    `SharedFolderWarning`. Where no other is left, this process has a folder of its own, which is removed when it
    ends.
    """
    if chosen := os.environ.get("BUILD_FMUS_CACHE"):
        candidates = [Path(chosen)]
    else:
        bases = [os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")]
        if os.environ.get("HOME") or os.environ.get("USERPROFILE"):
            bases.append(str(Path.home() / ".cache"))
        candidates = [Path(base) / "suspension-fmus" for base in bases if base]
        if hasattr(os, "getuid"):
            candidates.append(Path(tempfile.gettempdir()) / f"suspension-fmus-{os.getuid()}")
    for candidate in candidates:
        if _usable(directory := candidate.absolute(), ours=not chosen):
            return directory
    private = scratch() / "cache"
    private.mkdir(mode=0o700, exist_ok=True)
    return private


def _usable(directory: Path, *, ours: bool) -> bool:
    """Whether a folder for caches is there, or can be made, and is private; `ours`: the user has not named it."""
    try:
        _make(directory)
        if reason := _open_to_others(directory):
            _warn(
                f"{directory} is not used for caches: {reason}, "
                "so others could place code there that this process would run"
            )
            return False
        if ours and hasattr(os, "getuid") and stat.S_IMODE(directory.stat().st_mode) & 0o077:
            directory.chmod(0o700)
    except OSError:
        return not ours  # whoever writes there says what is wrong with it
    return not ours or os.access(directory, os.W_OK)


def _make(directory: Path) -> None:
    if not directory.is_dir():
        if directory.parent != directory:
            _make(directory.parent)
        directory.mkdir(mode=0o700, exist_ok=True)


def _open_to_others(directory: Path, *, is_cache: bool = True) -> str:
    """Why other users than the administrator can change what lies in a folder; "" if they cannot.

    The folders above count too, since who can write to one can exchange what it holds; a sticky one (`/tmp`) protects
    what it holds. So do the folders that links lead to. Windows has no such modes: there a user's profile is private.
    """
    if not hasattr(os, "getuid"):
        return ""
    for place in (directory, *directory.parents):
        about = place.lstat()
        last = is_cache and place == directory
        link = stat.S_ISLNK(about.st_mode)
        if about.st_uid != os.getuid() and (about.st_uid != 0 or (last and not link)):
            return f"{place} belongs to another user"
        if link:
            if reason := _open_to_others(place.parent / os.readlink(place), is_cache=last):
                return reason
        elif about.st_mode & 0o022 and (last or not about.st_mode & stat.S_ISVTX):
            return f"other users can write to {place}"
    return ""


@cache
def _warn(text: str) -> None:
    """Once per process."""
    warnings.warn(text, SharedFolderWarning, stacklevel=4)
