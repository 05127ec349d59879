"""Files of results and caches: they appear whole or not at all, and what is kept for later carries a hash.

Beside the three rooms, because all of them write files; it knows of nothing but files.
"""

from build_fmus.safe_files.kept import (
    CacheMiss,
    DamagedWarning,
    anew,
    clock,
    keep_file,
    keep_json,
    kept_file,
    kept_json,
    plain_warnings,
)
from build_fmus.safe_files.place import SharedFolderWarning, cache_directory
from build_fmus.safe_files.scratch import scratch
from build_fmus.safe_files.whole import is_full, named, opened, sentence, write

__all__ = [
    "CacheMiss",
    "DamagedWarning",
    "SharedFolderWarning",
    "anew",
    "cache_directory",
    "clock",
    "is_full",
    "keep_file",
    "keep_json",
    "kept_file",
    "kept_json",
    "named",
    "opened",
    "plain_warnings",
    "scratch",
    "sentence",
    "write",
]
