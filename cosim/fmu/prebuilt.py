"""The FMUs of the catalog that come with a published wheel, packed on first use, without a compiler.

What FMUs share (runtime, headers, licenses) is in the store once: `prebuilt/fmus.zip` has one entry for each content,
named by its SHA-256, and `index.json` says which entries make which FMU. An FMU is put together from the compressed
entries as they are, so it has the bytes that were built, whatever compressor this Python has.
"""

from __future__ import annotations

import hashlib
import io
import json
import struct
import zipfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from build_fmus.base import safe_files
from cosim.core.errors import FmuError

STORE = Path(__file__).with_name("prebuilt") / "fmus.zip"
_INDEX = "index.json"
_LOCAL, _CENTRAL, _END = "<4s5H3L2H", "<4s6H3L5H2L", "<4s4H2LH"
_VERSION, _UNIX, _DATE = 20, 3, 33  # of the format; who made it; the first of January 1980


def store(fmus: Mapping[str, bytes]) -> bytes:
    """The store of FMUs by path (`fmi3/NAME.fmu`), for a wheel."""
    index: dict[str, Any] = {}
    files: dict[str, bytes] = {}
    for path, data in sorted(fmus.items()):
        with zipfile.ZipFile(io.BytesIO(data)) as z:
            held = {name: z.read(name) for name in z.namelist()}
        named = {name: _digest(content) for name, content in held.items()}
        files |= {named[name]: content for name, content in held.items()}
        index[path] = {"sha256": _digest(data), "files": named}
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as z:
        for name, content in [*sorted(files.items()), (_INDEX, json.dumps(index, sort_keys=True).encode())]:
            z.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    return out.getvalue()


@cache
def _index() -> dict[str, Any]:
    """What the store of this installation has; nothing in an installation from sources."""
    if not STORE.is_file():
        return {}
    with _opened() as z:
        return dict(json.loads(z.read(_INDEX)))


def packed(fmi: int, name: str) -> Path | None:
    """The file of an FMU of the store, among the user's caches; None for one that it does not have.

    Raises:
        FmuError: the store is damaged.
    """
    path = f"fmi{fmi}/{name}.fmu"
    entry = _index().get(path)
    if entry is None:
        return None
    file = safe_files.cache_directory() / "fmus" / entry["sha256"][:16] / path
    if not file.is_file() or _digest(file.read_bytes()) != entry["sha256"]:
        data = _archive(entry["files"])
        if _digest(data) != entry["sha256"]:
            raise FmuError(f"{STORE} is damaged ({path}): install the package again")
        safe_files.write(file, data)
    return file


def _archive(files: Mapping[str, str]) -> bytes:
    """An FMU from entries of the store, as `build_fmus.base.archives` writes it."""
    body, directory = io.BytesIO(), io.BytesIO()
    with _opened() as z, STORE.open("rb") as file:
        for name, digest in sorted(files.items()):
            try:
                info = z.getinfo(digest)
            except KeyError:
                raise FmuError(f"{STORE} is damaged ({name} is missing): install the package again") from None
            file.seek(info.header_offset + 26)
            lengths = struct.unpack("<2H", file.read(4))
            file.seek(sum(lengths), io.SEEK_CUR)
            data, place, encoded = file.read(info.compress_size), body.tell(), name.encode()
            head = (_VERSION, 0, zipfile.ZIP_DEFLATED, 0, _DATE, info.CRC, info.compress_size, info.file_size)
            body.write(struct.pack(_LOCAL, b"PK\x03\x04", *head, len(encoded), 0) + encoded + data)
            mode = (0o755 if name.startswith("binaries/") else 0o644) << 16
            tail = (len(encoded), 0, 0, 0, 0, mode, place)
            directory.write(struct.pack(_CENTRAL, b"PK\x01\x02", _UNIX << 8 | _VERSION, *head, *tail) + encoded)
    count, size, start = len(files), directory.tell(), body.tell()
    end = struct.pack(_END, b"PK\x05\x06", 0, 0, count, count, size, start, 0)
    return body.getvalue() + directory.getvalue() + end


def _opened() -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(STORE)
    except zipfile.BadZipFile as error:
        raise FmuError(f"{STORE} is damaged ({error}): install the package again") from None


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
