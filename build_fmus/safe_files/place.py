"""Where a user's caches lie."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path


def cache_directory() -> Path:
    """Where downloads and compiled solvers are kept: ``BUILD_FMUS_CACHE``, the user's cache folder, or a temporary one."""
    if chosen := os.environ.get("BUILD_FMUS_CACHE"):
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    candidates = [Path(base)] if base else []
    if os.environ.get("HOME") or os.environ.get("USERPROFILE"):
        candidates.append(Path.home() / ".cache")
    for candidate in candidates:
        directory = candidate / "suspension-fmus"
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(directory, os.W_OK):
            return directory
    return Path(tempfile.gettempdir()) / f"suspension-fmus-{getattr(os, 'getuid', lambda: 'user')()}"
