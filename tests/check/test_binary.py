"""The readers of libraries agree with one of other origin, on every platform, and refuse what is damaged."""

from __future__ import annotations

import contextlib
import random
from pathlib import Path

import binaries
import pytest

from build_fmus.compile import resolve_platforms
from cosim.check.binary import Unreadable, claimed, read


def test_our_libraries_by_two_readers(built_fmus) -> None:  # type: ignore[no-untyped-def]
    import zipfile

    for fmi in (2, 3):
        with zipfile.ZipFile(built_fmus.path("QuarterCarHmmwv", fmi)) as archive:
            (name,) = (n for n in archive.namelist() if n.startswith("binaries/"))
            data = archive.read(name)
        ours, theirs = read(data), binaries.read(data)
        assert ours.exported == theirs.exported
        assert set(ours.needed) - {theirs.name} == theirs.libraries
        assert (ours.glibc or (0, 0)) == theirs.glibc
        folder = claimed(name.split("/")[1], str(fmi))
        assert folder is not None
        assert ours.format == folder[0]
        assert folder[1:] in ours.machines


def foreign_libraries() -> list[Path]:
    """Libraries of other platforms that come with installed packages."""
    import fmpy

    root = Path(fmpy.__file__).parent
    return sorted(p for p in root.rglob("*") if p.suffix in (".dll", ".dylib", ".so"))


@pytest.mark.parametrize("path", foreign_libraries(), ids=lambda p: f"{p.parent.name}-{p.name}")
def test_libraries_of_others_by_two_readers(path: Path) -> None:
    import lief

    ours, theirs = read(path.read_bytes()), lief.parse(str(path))
    assert theirs is not None
    if isinstance(theirs, lief.PE.Binary):
        assert set(ours.needed) == {str(i.name) for i in theirs.imports}
        exported = {str(e.name) for e in theirs.get_export().entries} if theirs.has_exports else set()
        assert ours.exported == exported
    elif isinstance(theirs, lief.ELF.Binary):
        assert set(ours.needed) == set(map(str, theirs.libraries))
        assert ours.exported == {str(s.name) for s in theirs.exported_symbols}
    else:
        part = theirs.at(0) if isinstance(theirs, lief.MachO.FatBinary) else theirs
        own = lief.MachO.LoadCommand.TYPE.ID_DYLIB
        assert set(ours.needed) >= {str(x.name) for x in part.libraries if x.command != own}
    assert ours.machines


def test_damaged_libraries_are_refused_or_read() -> None:
    """Never anything but a Library or Unreadable."""
    rng = random.Random(5)
    for path in foreign_libraries()[:6]:
        data = bytearray(path.read_bytes())
        for _ in range(20):
            wrong = bytearray(data[: rng.randrange(len(data))]) if rng.random() < 0.3 else bytearray(data)
            for _ in range(rng.randrange(1, 30)):
                if wrong:
                    wrong[rng.randrange(min(len(wrong), 4096))] = rng.randrange(256)
            with contextlib.suppress(Unreadable):
                read(bytes(wrong))


def test_folders_of_platforms() -> None:
    for platform in resolve_platforms("all"):
        for version, folder in (("2", platform.fmi2_name), ("3", platform.name)):
            assert claimed(folder, version) is not None
    assert claimed("x86_64-windows-msvc140mt", "3") == ("PE", "x86_64", 64)
    assert claimed("linux64", "3") is None
    assert claimed("amiga", "2") is None
