"""Files of results and caches: they are written atomically, and cache entries carry a hash.

The packages build_fmus, fmu_sources and cosim all use this package; it depends on none of them.
"""

from build_fmus.base.safe_files.kept import (
    CacheMiss,
    DamagedWarning,
    filesystem_time,
    ignore_cache,
    keep_file,
    keep_json,
    kept_file,
    kept_json,
    plain_warnings,
)
from build_fmus.base.safe_files.place import SharedFolderWarning, cache_directory
from build_fmus.base.safe_files.scratch import scratch, scratch_files
from build_fmus.base.safe_files.whole import is_full, named, opened, sentence, write

__all__ = [
    "CacheMiss",
    "DamagedWarning",
    "SharedFolderWarning",
    "cache_directory",
    "filesystem_time",
    "ignore_cache",
    "is_full",
    "keep_file",
    "keep_json",
    "kept_file",
    "kept_json",
    "named",
    "opened",
    "plain_warnings",
    "scratch",
    "scratch_files",
    "sentence",
    "write",
]
