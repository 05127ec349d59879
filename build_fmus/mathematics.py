"""One mathematical library in every binary: the functions of musl that a component's code calls, as C files of its FMU.

The C headers of the runtime rename `sin` to `fmu_sin` and so on (`runtime/fmu_math.h`), so that no platform's own
library takes part: results are bit-identical on all platforms, and the FMU needs no recent system.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

FOLDER = "musl"
VERSION = "1.2.5"
HEADERS = ("fmu_math.h", f"{FOLDER}/libm.h")
_RUNTIME, THIRD_PARTY = (Path(__file__).parent / n for n in ("runtime", "third_party"))
_COMMENT = re.compile(rb"/\*.*?\*/|//[^\n]*", re.DOTALL)
_CALL = re.compile(rb"\b([A-Za-z_]\w*)\s*\(")
_HEADER = re.compile(rb'^#include "(fmu_math|equations|libm|\w+_data)\.h"', re.MULTILINE)


def math_files(sources: Iterable[bytes]) -> dict[str, bytes]:
    """C files and headers of the functions that C `sources` call, directly or not, by path in `sources/`.

    In musl each function and table lies in a file of its own name, so names that are called lead to the files.
    """
    library = _library()
    found = {name: _read(name) for name in HEADERS}
    texts = list(sources)
    while texts:
        for name in sorted(_names(texts.pop())):
            for path in (f"{FOLDER}/{name}.c", f"{FOLDER}/{name}.h"):
                if path in library and path not in found:
                    found[path] = library[path]
                    texts.append(library[path])
    return dict(sorted(found.items()))


def copyright_notice() -> bytes:
    """The license of musl (MIT) with its list of authors and of the works that it is derived from."""
    return _read(f"{FOLDER}/COPYRIGHT")


def _names(text: bytes) -> set[str]:
    headers = _HEADER.findall(text)
    calls = _CALL.findall(_COMMENT.sub(b" ", text)) if headers else []  # a ``log`` elsewhere is another one
    return {n.decode() for n in (*headers, *calls)}


def _read(name: str) -> bytes:
    return ((THIRD_PARTY if name.startswith(f"{FOLDER}/") else _RUNTIME) / name).read_bytes()


@lru_cache
def _library() -> dict[str, bytes]:
    return {f"{FOLDER}/{p.name}": p.read_bytes() for p in sorted((THIRD_PARTY / FOLDER).glob("*.[ch]"))}
