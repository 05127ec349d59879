"""Names that object files define for others: what must be renamed before the same code can be in one library twice.

ELF (Linux), Mach-O (macOS) and COFF (Windows), of 64 bits, little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path


def defined(path: Path) -> set[str]:
    """External names that an object file defines, as C code writes them.

    Raises ValueError for files of another format.
    """
    data = path.read_bytes()
    try:
        if data[:5] == b"\x7fELF\x02":
            return set(_elf(data))
        if data[:4] == b"\xcf\xfa\xed\xfe":
            return {name.removeprefix("_") for name in _mach_o(data)}
        if data[:2] in (b"\x64\x86", b"\x64\xaa"):
            return set(_coff(data))
    except (struct.error, IndexError):
        raise ValueError(f"{path} is cut short") from None
    raise ValueError(f"{path} is no object file for ELF, Mach-O or COFF of 64 bits")


def _text(data: bytes, at: int) -> str:
    return data[at : data.index(b"\0", at)].decode()


def _elf(data: bytes) -> Iterator[str]:
    (sections,) = struct.unpack_from("<Q", data, 40)
    size, count = struct.unpack_from("<HH", data, 58)
    headers = [struct.unpack_from("<IIQQQQIIQQ", data, sections + i * size) for i in range(count)]
    for _, kind, _, _, at, length, link, *_ in headers:
        if kind != 2:  # SHT_SYMTAB
            continue
        names = headers[link][4]
        for place in range(at, at + length, 24):
            name, info, _, section = struct.unpack_from("<IBBH", data, place)
            if info >> 4 in (1, 2) and section:  # global or weak, and not undefined
                yield _text(data, names + name)


def _mach_o(data: bytes) -> Iterator[str]:
    (count,) = struct.unpack_from("<I", data, 16)
    place = 32
    for _ in range(count):
        kind, size = struct.unpack_from("<II", data, place)
        if kind == 2:  # LC_SYMTAB
            at, symbols, names, _ = struct.unpack_from("<IIII", data, place + 8)
            for symbol in range(at, at + symbols * 16, 16):
                name, flags = struct.unpack_from("<IB", data, symbol)
                if flags & 0x01 and flags & 0x0E:  # external, and not undefined
                    yield _text(data, names + name)
        place += size


def _coff(data: bytes) -> Iterator[str]:
    at, count = struct.unpack_from("<II", data, 8)
    names, skip = at + count * 18, 0
    for place in range(at, names, 18):
        if skip:
            skip -= 1
            continue
        section, _, storage, skip = struct.unpack_from("<hHBB", data, place + 12)
        if storage == 2 and section > 0:  # external, and in a section
            short, offset = data[place : place + 8], struct.unpack_from("<I", data, place + 4)[0]
            yield short.rstrip(b"\0").decode() if short[:4] != b"\0\0\0\0" else _text(data, names + offset)
