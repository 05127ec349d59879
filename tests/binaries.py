"""What a shared library of any platform says about itself: exports, imports, the systems that it runs on."""

from __future__ import annotations

from dataclasses import dataclass

import lief

lief.logging.disable()
# zig's linker for macOS exports these two of its own and has no option against it; nobody can call or replace them.
_OF_THE_LINKER = {"__mh_dylib_header", "___dso_handle"}


@dataclass(frozen=True)
class Binary:
    """A shared library.

    Attributes:
        exported, imported: symbols by their names in C.
        libraries: those that the loader must find.
        name: what it calls itself: SONAME (empty when it has none), name of the DLL, install name.
        glibc: newest version of glibc that a symbol needs, (0, 0) without; macos: oldest macOS that loads it.
    """

    exported: frozenset[str]
    imported: frozenset[str]
    libraries: frozenset[str]
    name: str
    glibc: tuple[int, ...] = (0, 0)
    macos: tuple[int, ...] = (0, 0)


def read(data: bytes) -> Binary:
    """Read an ELF, PE or Mach-O library."""
    parsed = lief.parse(list(data))
    assert parsed is not None, "neither ELF nor PE nor Mach-O"
    if isinstance(parsed, lief.ELF.Binary):
        versions = [a.name for v in parsed.symbols_version_requirement for a in v.get_auxiliary_symbols()]
        glibc = [tuple(map(int, v.removeprefix("GLIBC_").split("."))) for v in versions]
        soname = parsed.get(lief.ELF.DynamicEntry.TAG.SONAME)
        return Binary(
            frozenset(str(s.name) for s in parsed.exported_symbols),
            frozenset(str(s.name) for s in parsed.imported_symbols),
            frozenset(map(str, parsed.libraries)),
            str(soname.name) if soname else "",  # type: ignore[attr-defined]
            glibc=max(glibc, default=(0, 0)),
        )
    if isinstance(parsed, lief.PE.Binary):
        exports = parsed.get_export()
        return Binary(
            frozenset(str(e.name) for e in exports.entries),
            frozenset(str(e.name) for i in parsed.imports for e in i.entries),
            frozenset(str(i.name) for i in parsed.imports),
            str(exports.name),
        )
    mach_o = parsed.at(0) if isinstance(parsed, lief.MachO.FatBinary) else parsed
    assert isinstance(mach_o, lief.MachO.Binary)
    trie = mach_o.dyld_info or mach_o.dyld_exports_trie
    name = next(c.name for c in mach_o.commands if c.command == lief.MachO.LoadCommand.TYPE.ID_DYLIB)  # type: ignore[attr-defined]
    return Binary(
        frozenset(str(e.symbol.name).removeprefix("_") for e in trie.exports if e.symbol.name not in _OF_THE_LINKER),
        frozenset(str(s.name).removeprefix("_") for s in mach_o.imported_symbols),
        frozenset(str(x.name) for x in mach_o.libraries) - {name},
        name,
        macos=tuple(mach_o.build_version.minos),
    )
