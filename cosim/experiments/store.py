"""Finished runs on disk, keyed by everything that determines them: an interrupted study goes on where it stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from build_fmus import safe_files


class RunStore:
    """JSON results by key; ``salt`` covers what all runs share (FMU files, code, library versions).

    A file that is not what was written is discarded with a warning, and its run is made again.
    """

    def __init__(self, directory: Path, salt: str) -> None:
        self.directory = directory
        self.salt = salt

    def get(self, key: Any, compute: Callable[[], Any]) -> Any:
        """The stored result of ``key`` (any JSON value), computed and stored when it is not there yet."""
        text = json.dumps(key, sort_keys=True)
        path = self.directory / f"{hashlib.sha256((self.salt + text).encode()).hexdigest()[:32]}.json"
        try:
            return safe_files.kept_json(path)
        except safe_files.NotKept:
            result = compute()
        safe_files.keep_json(path, result)
        return result


def content_hash(paths: Iterable[Path]) -> str:
    """Hash of the contents of files, in the given order."""
    digest = hashlib.sha256()
    for path in paths:
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()
