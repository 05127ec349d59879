"""Finished runs on disk, keyed by everything that determines them: an interrupted study continues where it stopped."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from build_fmus import safe_files


class NotStored(LookupError):  # noqa: N818
    """There is no such result, or none that can be used."""


class RunStore:
    """JSON results by key; ``salt`` covers what all runs share (FMU files, code, library versions).

    A file that is not what was written is discarded with a warning, and its run is made again.
    """

    def __init__(self, directory: Path, salt: str) -> None:
        self.directory = directory
        self.salt = salt

    def path(self, key: Any) -> Path:
        """File of a key (any JSON value)."""
        text = json.dumps(key, sort_keys=True)
        return self.directory / f"{hashlib.sha256((self.salt + text).encode()).hexdigest()[:32]}.json"

    def get(self, key: Any) -> Any:
        """The result of a key.

        Raises:
            NotStored: it was never stored, or is damaged.
        """
        try:
            return safe_files.kept_json(self.path(key))
        except safe_files.NotKept:
            raise NotStored(key) from None

    def put(self, key: Any, result: Any) -> Any:
        """Store a result (a JSON value, NaN included), and return it as it will be read."""
        safe_files.keep_json(self.path(key), result)
        return json.loads(json.dumps(result))
