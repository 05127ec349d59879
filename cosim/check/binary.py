"""Reads the headers of a shared library (ELF, PE, Mach-O) and checks them against the name of its folder.

The readers need no library for this format and no matching platform, so an FMU can be checked on any machine.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from cosim.check.description_rules import File
from cosim.check.rules import Found, file_check, names, note, require


class Unreadable(ValueError):  # noqa: N818 (reads as what happened)
    """No library, or a damaged one; the argument says why."""


@dataclass
class Library:
    """A shared library.

    `format` is ELF, PE or Mach-O; `machines` are pairs (architecture, bits), several in a universal library; the other
    fields are names that it exports and libraries that it needs.
    """

    format: str
    machines: list[tuple[str, int]]
    exported: set[str] = field(default_factory=set)
    needed: list[str] = field(default_factory=list)
    glibc: tuple[int, ...] = ()
    shared: bool = True


def read(data: bytes) -> Library:
    """A library from its bytes. Raises Unreadable."""
    readers = {b"\x7fELF": _elf, b"MZ": _pe}
    reader = next((r for magic, r in readers.items() if data.startswith(magic)), None)
    if reader is None and data[:4] in (*_MACHO, *_FAT):
        reader = _mach_o
    if reader is None:
        raise Unreadable("it is not an ELF, PE or Mach-O library")
    try:
        return reader(data)
    except (struct.error, IndexError, KeyError, UnicodeDecodeError, OverflowError, MemoryError) as error:
        raise Unreadable(f"it is damaged or cut short ({type(error).__name__} while its tables were read)") from None


def _text(data: bytes, at: int) -> str:
    end = data.index(b"\0", at) if b"\0" in data[at : at + 4096] else at + 4096
    return data[at:end].decode("utf-8", "replace")


# ---------------------------------------------------------------------------------------------------------------- ELF

_ELF_MACHINES = {3: "x86", 62: "x86_64", 40: "arm", 183: "aarch64", 243: "riscv", 21: "ppc64", 8: "mips"}


def _elf(data: bytes) -> Library:
    wide, order = data[4] == 2, {1: "<", 2: ">"}[data[5]]
    kind, machine = struct.unpack_from(order + "HH", data, 16)
    library = Library("ELF", [(_ELF_MACHINES.get(machine, f"machine {machine}"), 64 if wide else 32)], shared=kind == 3)
    at, size, count = struct.unpack_from(order + ("32xQ14xHH" if wide else "28xI10xHH"), data)
    segments = []
    for i in range(count):
        if wide:
            type_, offset, address, length = struct.unpack_from(order + "I4xQQ8xQ", data, at + i * size)
        else:
            type_, offset, address, length = struct.unpack_from(order + "III4xI", data, at + i * size)
        segments.append((type_, offset, address, length))

    def place(address: int) -> int:
        for type_, offset, start, length in segments:
            if type_ == 1 and start <= address < start + length:
                return offset + address - start
        raise IndexError(address)

    dynamic: dict[int, list[int]] = {}
    for type_, offset, _, length in segments:
        if type_ != 2:
            continue
        entry = struct.Struct(order + ("qQ" if wide else "iI"))
        for i in range(length // entry.size):
            tag, value = entry.unpack_from(data, offset + i * entry.size)
            if tag == 0:
                break
            dynamic.setdefault(tag, []).append(value)
    if 5 not in dynamic:
        return library
    strings = place(dynamic[5][0])
    library.needed = [_text(data, strings + v) for v in dynamic.get(1, [])]
    symbol = struct.Struct(order + ("IBBHQQ" if wide else "IIIBBH"))
    first = place(dynamic[6][0]) if 6 in dynamic else 0
    for i in range(1, _elf_symbols(data, order, wide, dynamic, place) if first else 0):
        fields = symbol.unpack_from(data, first + i * symbol.size)
        name, info, section = (fields[0], fields[1], fields[3]) if wide else (fields[0], fields[3], fields[5])
        if section and info >> 4 in (1, 2):  # global or weak, and defined here
            library.exported.add(_text(data, strings + name))
    library.glibc = _glibc(data, order, strings, place(dynamic[0x6FFFFFFE][0]) if 0x6FFFFFFE in dynamic else 0)
    return library


def _elf_symbols(data: bytes, order: str, wide: bool, dynamic: dict[int, list[int]], place) -> int:  # type: ignore[no-untyped-def]
    """How many symbols there are, which only the hash tables say."""
    if 4 in dynamic:
        return int(struct.unpack_from(order + "I", data, place(dynamic[4][0]) + 4)[0])
    if 0x6FFFFEF5 not in dynamic:
        return 0
    at = place(dynamic[0x6FFFFEF5][0])
    buckets, first, bloom = struct.unpack_from(order + "III", data, at)
    table = at + 16 + bloom * (8 if wide else 4)
    last = max(struct.unpack_from(f"{order}{buckets}I", data, table), default=0)
    if last < first:
        return int(first)
    chain = table + 4 * buckets
    while not struct.unpack_from(order + "I", data, chain + 4 * (last - first))[0] & 1:
        last += 1
    return int(last + 1)


def _glibc(data: bytes, order: str, strings: int, at: int) -> tuple[int, ...]:
    """The newest version of glibc that a symbol needs."""
    newest: tuple[int, ...] = ()
    while at:
        _, count, _, aux, following = struct.unpack_from(order + "HHIII", data, at)
        entry = at + aux
        for _ in range(count):
            _, _, _, name, more = struct.unpack_from(order + "IHHII", data, entry)
            match = re.fullmatch(r"GLIBC_(\d+(?:\.\d+)+)", _text(data, strings + name))
            if match:
                newest = max(newest, tuple(map(int, match[1].split("."))))
            if not more:
                break
            entry += more
        at = at + following if following else 0
    return newest


# ----------------------------------------------------------------------------------------------------------------- PE

_PE_MACHINES = {0x14C: ("x86", 32), 0x8664: ("x86_64", 64), 0xAA64: ("aarch64", 64), 0x1C4: ("arm", 32)}


def _pe(data: bytes) -> Library:
    at = struct.unpack_from("<I", data, 60)[0]
    if data[at : at + 4] != b"PE\0\0":
        raise Unreadable("it is a DOS program, not a DLL")
    machine, sections, size, flags = struct.unpack_from("<HH12xHH", data, at + 4)
    library = Library("PE", [_PE_MACHINES.get(machine, (f"machine {machine:#x}", 0))], shared=bool(flags & 0x2000))
    optional = at + 24
    wide = struct.unpack_from("<H", data, optional)[0] == 0x20B
    tables = optional + (112 if wide else 96)
    rows = [struct.unpack_from("<8xIIII", data, optional + size + 40 * i) for i in range(sections)]

    def place(address: int) -> int:
        for virtual, start, raw, offset in rows:
            if start <= address < start + max(virtual, raw):
                return int(offset + address - start)
        raise IndexError(address)

    exports, _, imports = *struct.unpack_from("<II", data, tables), struct.unpack_from("<I", data, tables + 8)[0]
    if exports:
        count, _, entries = struct.unpack_from("<24xIII", data, place(exports))
        pointers = place(entries) if count else 0
        for i in range(count):
            library.exported.add(_text(data, place(struct.unpack_from("<I", data, pointers + 4 * i)[0])))
    if imports:
        entry = place(imports)
        while (name := struct.unpack_from("<12xI", data, entry)[0]) != 0:
            library.needed.append(_text(data, place(name)))
            entry += 20
    return library


# ------------------------------------------------------------------------------------------------------------- Mach-O

_MACHO = {
    b"\xce\xfa\xed\xfe": ("<", 32),
    b"\xcf\xfa\xed\xfe": ("<", 64),
    b"\xfe\xed\xfa\xce": (">", 32),
    b"\xfe\xed\xfa\xcf": (">", 64),
}
_FAT = {b"\xca\xfe\xba\xbe": ">5I", b"\xca\xfe\xba\xbf": ">IIQQI4x"}
_MACHO_MACHINES = {7: ("x86", 32), 0x01000007: ("x86_64", 64), 12: ("arm", 32), 0x0100000C: ("aarch64", 64)}


def _mach_o(data: bytes) -> Library:
    if data[:4] in _FAT:
        parts = []
        entry = struct.Struct(_FAT[data[:4]])
        for i in range(struct.unpack_from(">I", data, 4)[0]):
            _, _, offset, size, _ = entry.unpack_from(data, 8 + i * entry.size)
            parts.append(_mach_o(data[offset : offset + size]))
        whole = Library("Mach-O", [m for p in parts for m in p.machines], shared=all(p.shared for p in parts))
        whole.exported = set.intersection(*(p.exported for p in parts)) if parts else set()
        whole.needed = list(dict.fromkeys(n for p in parts for n in p.needed))
        return whole
    order, bits = _MACHO[data[:4]]
    machine, _, kind, count = struct.unpack_from(order + "IIII", data, 4)
    library = Library("Mach-O", [_MACHO_MACHINES.get(machine, (f"machine {machine:#x}", bits))], shared=kind in (6, 8))
    at = 32 if bits == 64 else 28
    for _ in range(count):
        command, size = struct.unpack_from(order + "II", data, at)
        if command in (0xC, 0x80000018, 0x8000001F, 0x80000023):
            library.needed.append(_text(data, at + struct.unpack_from(order + "I", data, at + 8)[0]))
        elif command == 2:
            symbols, n, strings, _ = struct.unpack_from(order + "IIII", data, at + 8)
            entry = struct.Struct(order + ("IBBHQ" if bits == 64 else "IBBHI"))
            for i in range(n):
                name, type_, _, _, _ = entry.unpack_from(data, symbols + i * entry.size)
                # external, defined in a section, no debug entry
                if type_ & 1 and type_ & 0xE == 0xE and not type_ & 0xE0:
                    library.exported.add(_text(data, strings + name).removeprefix("_"))
        at += max(size, 8)
    return library


# ------------------------------------------------------------------------------------------------------------- checks

FOLDERS2 = {
    f"{system}{bits}": (form, architecture, bits)
    for system, form in (("win", "PE"), ("linux", "ELF"), ("darwin", "Mach-O"))
    for architecture, bits in (("x86", 32), ("x86_64", 64))
}
_SYSTEMS = {"windows": "PE", "linux": "ELF", "darwin": "Mach-O"}
_ARCHITECTURES = {
    "x86_64": ("x86_64", 64),
    **dict.fromkeys(("i386", "i586", "i686", "x86"), ("x86", 32)),
    "aarch64": ("aarch64", 64),
    "aarch32": ("arm", 32),
    "riscv64": ("riscv", 64),
    "riscv32": ("riscv", 32),
    "ppc64": ("ppc64", 64),
}
ENDINGS = {"PE": ".dll", "ELF": ".so", "Mach-O": ".dylib"}


def claimed(folder: str, version: str) -> tuple[str, str, int] | None:
    """(format, architecture, bits) of the name of a folder below binaries/; None for a vendor's own name."""
    if version == "2" and folder in FOLDERS2:
        return FOLDERS2[folder]
    match = re.fullmatch(r"([a-z0-9]+(?:_64)?)-(windows|linux|darwin)(?:-.*)?", folder)
    if match is None or match[1] not in _ARCHITECTURES:
        return None
    return (_SYSTEMS[match[2]], *_ARCHITECTURES[match[1]])


_INTERFACES = {"ModelExchange": "me", "CoSimulation": "cs", "ScheduledExecution": "se"}
_DECLARED = re.compile(r"Functions for (?:FMI2 for )?([A-Z][\w -]+)|FMI\d_Export +\w+ +fmi\d(\w+);")
_LATER = ("SetShiftDecimal", "SetShiftFraction")  # not in the first headers of FMI 3.0


@cache
def functions(version: str) -> dict[str, list[str]]:
    """Functions that the header of the standard declares, by interface ("cs", "me", "se"; "" for those of all)."""
    header = Path(str(find_spec("fmpy").origin)).with_name("c-code") / f"fmi{version}Functions.h"  # type: ignore[union-attr]
    found: dict[str, list[str]] = {"": [], **{kind: [] for kind in _INTERFACES.values()}}
    kind = ""
    for title, name in _DECLARED.findall(header.read_text(encoding="utf-8").rpartition("Common Functions")[2]):
        if title:
            kind = _INTERFACES[re.sub("[ -]", "", title)]
        elif name not in _LATER:
            found[_INTERFACES.get(name.removeprefix("Instantiate"), kind)].append(name)
    return found


def required(version: str, kinds: set[str]) -> list[str]:
    """Functions that a library must have for its interfaces."""
    return [f"fmi{version}{name}" for kind in ("", *sorted(kinds)) for name in functions(version)[kind]]


def libraries(file: File) -> dict[str, tuple[Library | Unreadable, set[str]]]:
    """The libraries that the description names, by path, each with the interfaces that it serves."""
    found: dict[str, tuple[Library | Unreadable, set[str]]] = {}
    of = {kind: i.identifier for kind, i in file.model.interfaces.items()}
    for folder, name in file.archive.libraries():
        kinds = {kind for kind, identifier in of.items() if identifier == name.rpartition(".")[0]}
        if not kinds:
            continue
        try:
            library: Library | Unreadable = read((file.folder / "binaries" / folder / name).read_bytes())
        except Unreadable as error:
            library = error
        found[f"binaries/{folder}/{name}"] = library, kinds
    return found


def _readable(file: File) -> list[tuple[str, Library, set[str]]]:
    found = [
        (path, library, kinds) for path, (library, kinds) in libraries(file).items() if isinstance(library, Library)
    ]
    require(found, "no library can be read")
    return found


@file_check(
    "binary.header",
    "every library matches the platform of its folder: system, architecture and word size",
    fmi2="2.3 FMU Distribution (binaries)",
    fmi3="2.5.1.5 Directory binaries (platform tuple)",
    advice="Build each library for the platform of its folder.",
)
def header(file: File) -> Found:
    found = libraries(file)
    require(found, "there are no shared libraries")
    for path, (library, _) in found.items():
        folder = path.split("/")[1]
        claim = claimed(folder, file.model.version)
        if isinstance(library, Unreadable):
            yield f"{path}: {library}"
        elif claim is None:
            yield note(f"{path}: {folder!r} is not a platform of the standard; importers ignore this folder")
        elif library.format != claim[0]:
            yield f"{path} is a library of {library.format}, its folder is for {claim[0]}"
        elif claim[1:] not in library.machines:
            have = ", ".join(f"{m} {b} bit" for m, b in library.machines)
            yield f"{path} is for {have}, its folder for {claim[1]} {claim[2]} bit"
        elif not library.shared:
            yield f"{path} is not a shared library"
        elif not path.endswith(ENDINGS[library.format]):
            yield f"{path}: a library of {library.format} ends in {ENDINGS[library.format]}"


@file_check(
    "binary.symbols",
    "every library exports all functions of its interfaces",
    fmi2="2.3 FMU Distribution (functions that must be present)",
    fmi3="2.5 FMU Distribution (functions that must be present)",
    advice=(
        "Export every function of the interface, including those for unsupported capabilities: importers load all of"
        " them."
    ),
)
def symbols(file: File) -> Found:
    for path, library, kinds in _readable(file):
        missing = [n for n in required(file.model.version, kinds) if n not in library.exported]
        if missing:
            prefix = next((s for s in sorted(library.exported) if s.endswith("_" + missing[0])), None)
            hint = f"; it has {prefix}: compile with FMI{file.model.version}_OVERRIDE_FUNCTION_PREFIX" if prefix else ""
            yield f"{path} lacks {names(missing, 5)}{hint}"


_OF_SYSTEMS = re.compile(
    r"lib(c|m|dl|pthread|rt|util|resolv|nsl|crypt|gcc_s|stdc\+\+|anl|BrokenLocale)(\.so(\.\d+)*)?|ld-linux.*|linux-vdso.*|libc\.musl.*|"
    r"/usr/lib/.*|/System/Library/.*|"
    r"(?i:(kernel32|kernelbase|user32|gdi32|advapi32|shell32|ole32|oleaut32|ws2_32|wsock32|msvcrt|ucrtbase|ntdll|version|winmm|shlwapi|"
    r"psapi|dbghelp|rpcrt4|secur32|crypt32|bcrypt|comdlg32|comctl32|imm32|iphlpapi|userenv|setupapi|opengl32|winhttp|wininet|mpr|netapi32|"
    r"propsys|uxtheme|dwmapi|powrprof|api-ms-win-.*|ext-ms-.*)(\.dll|\.drv)?)"
)
_REDISTRIBUTED = re.compile(r"(?i)(vcruntime|msvcp|msvcr|concrt|vcomp|libgfortran|libgomp|libquadmath|libomp).*")


@file_check(
    "binary.libraries",
    "all dependencies of every library belong to a standard system or are in its folder",
    fmi2="2.3 FMU Distribution (binaries)",
    fmi3="2.5.1.5 Directory binaries (referenced resources)",
    advice="Link statically, or put the required libraries into the same folder (with RPATH $ORIGIN on Linux).",
    worst="warning",
)
def needed(file: File) -> Found:
    for path, library, _ in _readable(file):
        beside = {p.name.lower() for p in (file.folder / path).parent.iterdir()}
        lacking = [
            n for n in library.needed if n.rpartition("/")[2].lower() not in beside and not _OF_SYSTEMS.fullmatch(n)
        ]
        lacking = [n for n in lacking if n.rpartition("/")[2] != path.rpartition("/")[2]]
        usual = [n for n in lacking if _REDISTRIBUTED.fullmatch(n.rpartition("/")[2])]
        others = [n for n in lacking if n not in usual]
        if others:
            yield f"{path} needs {names(others)}, which is neither in its folder nor part of the system"
        if usual:
            yield note(f"{path} needs {names(usual)}, a compiler runtime that must be installed separately")
