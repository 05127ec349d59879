"""What memory this machine has, and what a process of it uses."""

from __future__ import annotations

import os
from contextlib import suppress

_UNKNOWN = 4 * 2**30


def physical_memory() -> int:
    """Bytes of this machine's memory; 4 GiB where the operating system does not tell."""
    with suppress(AttributeError, ValueError, OSError):  # Windows has no sysconf
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return _UNKNOWN


def resident_memory(process: int | str = "self") -> int | None:
    """Bytes of a process in memory, by its number; None where the operating system does not tell."""
    with suppress(OSError, ValueError, IndexError), open(f"/proc/{process}/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return None
