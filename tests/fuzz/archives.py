"""FMU files: damaged archives, wrong statements about themselves, paths that lead elsewhere, zip bombs.

A case is a file. It is opened and unpacked, and its library, which is none, is loaded.
"""

from __future__ import annotations

import io
import random
import re
import struct
import tempfile
import warnings
import zipfile
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path

from cosim import CosimError, Fmu, FmuError
from cosim.fmu.calls import platform_folder

from . import mutate

ALLOWED = (CosimError,)
_NAMES = (
    "modelDescription.xml",
    "./modelDescription.xml",
    "modeldescription.xml",
    "/modelDescription.xml",
    "../outside",
    "resources/../../outside",
    "/tmp/outside-of-fuzz",
    "C:/outside",
    "C:outside",
    "\\\\host\\share\\x",
    "..\\outside",
    "a\\..\\..\\outside",
    "resources",
    "resources/",
    "resources/a",
    "resources/a/b",
    "binaries",
    "binaries/linux64",
    "binaries/linux64/a.so",
    "binaries/../binaries/x.so",
    "",
    ".",
    "..",
    "/",
    "//",
    "a//b",
    "a/./b",
    "con",
    "nul.txt",
    "a.",
    "a ",
    "x" * 300,
    "x/" * 500,
    "y" * 65_000,
    "a\0b",
    "a\nb",
    "\u202egnp.exe",
    "ä/😀",
    "-rf",
    "~/x",
    "$HOME",
    "%s%n",
    "a:b",
    "sources/model.c",
    "documentation/index.html",
)
_NUMBERS = (0, 1, 2, 7, 8, 9, 12, 14, 45, 63, 97, 0x800, 0x2000, 0xFFFE, 0xFFFF)
_WIDE = (0, 1, 22, 46, 1000, 2**20, 2**28, 2**31 - 1, 2**31, 2**32 - 2, 2**32 - 1)
_BOTH = {"flags": (6, 8, 2), "method": (8, 10, 2), "crc": (14, 16, 4), "packed": (18, 20, 4), "size": (22, 24, 4)}
"""Fields that an entry has in both of its headers: their places there, and bytes."""


def _fields(form: str) -> list[tuple[int, int]]:
    """(place, bytes) of the numbers of a header, by its format."""
    sizes = [
        struct.calcsize(f"<{sign}") for count, sign in re.findall(r"(\d*)([HI])", form) for _ in range(int(count or 1))
    ]
    return [(sum(sizes[:i]), size) for i, size in enumerate(sizes)]


_HEADERS = (
    (b"PK\x03\x04", _fields("I5H3I2H")),
    (b"PK\x01\x02", _fields("I6H3I5H2I")),
    (b"PK\x05\x06", _fields("I4H2IH")),
)


@cache
def description() -> bytes:
    import awkward

    return awkward.description(2)


@cache
def _zeros(size: int) -> bytes:
    """`size` zeros, deflated."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    block = bytes(2**20)
    return b"".join(packer.compress(block) for _ in range(size // len(block))) + packer.flush()


# ------------------------------------------------------------------------------------------------------------- making


def make(rng: random.Random) -> bytes:
    if rng.random() < 0.002:
        return _bomb(rng)
    data = _archive(rng)
    way = rng.random()
    if way < 0.2:
        return data
    if way < 0.75:
        return mutate.several(rng, data, CHANGES, 4)
    return mutate.several(rng, data, (*mutate.BYTES, *CHANGES), 3)


def _archive(rng: random.Random) -> bytes:
    """A whole archive, with entries that no honest one has."""
    binary = f"binaries/{platform_folder('2')[0]}/Awkward{platform_folder('2')[1]}"
    entries: list[tuple[str, bytes]] = [
        ("modelDescription.xml", description()),
        (binary, b"no library"),
        ("resources/a.txt", b"a" * 500),
    ]
    for _ in range(rng.choice((*(0, 0, 1, 1, 2, 5) * 5, 300))):
        content = rng.choice((b"", b"x", b"x" * 5000, description(), rng.randbytes(50)))
        entries.insert(rng.randint(0, len(entries)), (rng.choice(_NAMES), content))
    if rng.random() < 0.1:
        del entries[rng.randrange(len(entries))]
    if rng.random() < 0.05:
        entries.append(("inner.fmu", _archive(rng)))
    made = io.BytesIO()
    method = rng.choice((zipfile.ZIP_DEFLATED,) * 30 + (zipfile.ZIP_STORED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA))
    with zipfile.ZipFile(made, "w", method) as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, content in entries:
            entry = zipfile.ZipInfo("x")
            entry.filename = name
            entry.compress_type = method
            if rng.random() < 0.1:
                entry.external_attr = (
                    rng.choice((0o120777, 0o010644, 0o020666, 0o040000, 0o104755, 0)) << 16
                )  # a link, a pipe, a device, ...
                entry.create_system = 3
            archive.writestr(entry, content)
        if rng.random() < 0.1:
            archive.comment = rng.choice((b"PK\x05\x06" * 10, b"x" * 65_535, b"\0" * 22, b"PK\x06\x06"))
    return made.getvalue()


def _bomb(rng: random.Random) -> bytes:
    """Zeros, in one entry or in many that share their bytes, in a file or in the description.

    The sizes that the archive states are right or not.
    """
    size = rng.choice((2**26, 2**28, 2**29))
    packed = _zeros(size)
    told = rng.choice((size, size, 1000, 2**32 - 2))
    name = rng.choice((b"resources/zeros", b"modelDescription.xml", b"resources/zeros"))
    crc = zlib.crc32(description())
    local = (
        b"PK\x03\x04" + struct.pack("<5H3I2H", 20, 0, 8, 0, 0x21, crc, len(packed), told, len(name), 0) + name + packed
    )
    text = description()
    first = (
        b"PK\x03\x04"
        + struct.pack("<5H3I2H", 20, 0, 0, 0, 0x21, crc, len(text), len(text), 20, 0)
        + b"modelDescription.xml"
        + text
    )
    data, directory, count = first + local, b"", 0

    def entry(name: bytes, method: int, lengths: tuple[int, int], offset: int) -> bytes:
        return (
            b"PK\x01\x02"
            + struct.pack("<6H3I5H2I", 20, 20, 0, method, 0, 0x21, crc, *lengths, len(name), 0, 0, 0, 0, 0, offset)
            + name
        )

    if name != b"modelDescription.xml":
        directory += entry(b"modelDescription.xml", 0, (len(text), len(text)), 0)
        count += 1
    for i in range(rng.choice((1, 1, 1, 2, 50, 20_000))):
        directory += entry(name if not i else name + str(i).encode(), 8, (len(packed), told), len(first))
        count += 1
    return data + directory + b"PK\x05\x06" + struct.pack("<4H2IH", 0, 0, count, count, len(directory), len(data), 0)


def _field(rng: random.Random, data: bytes) -> bytes:
    """A number in one of the headers is another one."""
    signature, fields = rng.choice(_HEADERS)
    places = _places(data, signature)
    if not places:
        return data
    at = rng.choice(places)
    offset, size = rng.choice(fields)
    value = rng.choice((*_NUMBERS, rng.getrandbits(16)) if size == 2 else (*_WIDE, rng.getrandbits(32), len(data), at))
    return data[: at + offset] + value.to_bytes(size, "little") + data[at + offset + size :]


def _both(rng: random.Random, data: bytes) -> bytes:
    """The same field of an entry is changed in both of its headers: encrypted, packed otherwise, larger, smaller."""
    name = rng.choice(list(_BOTH))
    *offsets, size = _BOTH[name]
    changed = bytearray(data)
    value = rng.choice(_NUMBERS if size == 2 else _WIDE)
    which = rng.random()
    for (signature, _), offset in zip(_HEADERS, offsets, strict=False):
        if places := _places(data, signature):
            at = places[int(which * len(places))] + offset
            changed[at : at + size] = value.to_bytes(size, "little")
    return bytes(changed)


def _places(data: bytes, signature: bytes) -> list[int]:
    found: list[int] = []
    at = data.find(signature)
    while at >= 0 and len(found) < 500:
        found.append(at)
        at = data.find(signature, at + 1)
    return found


def _overlap(rng: random.Random, data: bytes) -> bytes:
    """Two entries have the same bytes."""
    places = _places(data, b"PK\x01\x02")
    if len(places) < 2:
        return data
    a, b = rng.choice(places), rng.choice(places)
    return data[: a + 42] + data[b + 42 : b + 46] + data[a + 46 :]


def _around(rng: random.Random, data: bytes) -> bytes:
    """Something stands before the archive, or after it."""
    junk = rng.choice((b"#!/bin/sh\n", b"\0" * 100, b"PK\x05\x06", b"PK\x05\x06" + b"\0" * 18, data, rng.randbytes(30)))
    return junk + data if rng.random() < 0.5 else data + junk


def _wide(rng: random.Random, data: bytes) -> bytes:
    """Records of archives beyond 4 GB, with sizes at random."""
    at = data.rfind(b"PK\x05\x06")
    if at < 0:
        return data
    numbers = [rng.choice((*_WIDE, 2**40, 2**63, 2**64 - 1, at)) for _ in range(4)]
    record = b"PK\x06\x06" + struct.pack("<QHHIIQQQQ", 44, 45, 45, 0, 0, *numbers)
    locator = b"PK\x06\x07" + struct.pack("<IQI", 0, rng.choice((at, 0, 2**63)), rng.choice((1, 1, 0, 5)))
    end = data[at : at + 12] + rng.choice((b"\xff" * 8, data[at + 12 : at + 20])) + data[at + 20 :]
    return data[:at] + record + locator + end


CHANGES: tuple[Callable[[random.Random, bytes], bytes], ...] = (
    *[_field] * 4,
    *[_both] * 2,
    *(_overlap, _around, _wide, mutate.cut),
)


# -------------------------------------------------------------------------------------------------------------- trial


def run(case: bytes, folder: Path) -> None:
    path, temporary, before = folder / "case.fmu", folder / "tmp" / "below", tempfile.tempdir
    path.write_bytes(case)
    temporary.mkdir(parents=True)
    tempfile.tempdir = str(temporary)
    fmu = None
    try:
        fmu = Fmu(path)
        fmu.platforms()
        fmu.library()
        raise AssertionError("a library was loaded that is none")
    except FmuError:
        _check(folder, path, temporary)
        raise
    finally:
        tempfile.tempdir = before
        if fmu is not None:
            fmu.close()
            if left := [p for own in temporary.iterdir() for p in own.iterdir()]:  # the process keeps its own folder
                raise AssertionError(f"left behind: {left}")


def _check(folder: Path, path: Path, temporary: Path) -> None:
    """Nothing lies outside of the folder for it, and nothing in it that is neither a file nor a folder."""
    if {*folder.iterdir()} != {path, folder / "tmp"} or [*(folder / "tmp").iterdir()] != [temporary]:
        raise AssertionError(f"something was unpacked elsewhere: {sorted(folder.rglob('*'))[:20]}")
    if Path("/tmp/outside-of-fuzz").exists():
        raise AssertionError("an absolute name was believed")
    for found in temporary.rglob("*"):
        if found.is_symlink() or not (found.is_file() or found.is_dir()):
            raise AssertionError(f"unpacked as neither a file nor a folder: {found}")
