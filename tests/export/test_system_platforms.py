"""One system for every platform, by ziglang.

All binaries are in one archive, of the right format, and run on old systems.
"""

from __future__ import annotations

import json
import re
import zipfile
from pathlib import Path

import binaries
import pytest
from built import BuiltFmus

from build_fmus.compile import PLATFORMS
from cosim import System

FORMATS = {".so": b"\x7fELF", ".dll": b"MZ", ".dylib": b"\xcf\xfa\xed\xfe"}  # first bytes; of 64 bits, little-endian
PROCESSORS = {".so": slice(18, 20), ".dylib": slice(4, 8)}  # where they tell the processor
CODES = {"x86_64-linux": 62, "aarch64-linux": 183, "x86_64-darwin": 0x01000007, "aarch64-darwin": 0x0100000C}


@pytest.mark.full  # half a minute where nothing has been compiled yet
@pytest.mark.parametrize("fmi", [2, 3])
def test_one_archive_for_all(built_fmus: BuiltFmus, tmp_path: Path, fmi: int) -> None:
    with System() as system:
        system.add("car", built_fmus.path("QuarterCarBench", 3))
        system.add("law", built_fmus.path("LqrBench", 2))
        system.connect_matching("car", "law")
        system.connect_matching("law", "car", "force")
        path = system.export_fmu(tmp_path / "Everywhere.fmu", fmi=fmi, platforms="all")
    with zipfile.ZipFile(path) as z:
        held = {n: z.read(n) for n in z.namelist() if n.startswith("binaries/")}
        linked = [m["linked"] for m in json.loads(z.read("resources/components.json"))]
        header = z.read(f"sources/fmi{fmi}Functions.h").decode()
    assert linked == [True, True]
    where = {p: f"binaries/{p.fmi2_name if fmi == 2 else p.name}/Everywhere{p.suffix}" for p in PLATFORMS.values()}
    assert set(held) == set(where.values())
    declared = set(re.findall(rf"^#define (fmi{fmi}[A-Z]\w+) +fmi{fmi}FullName\(", header, re.MULTILINE))
    for platform, file in where.items():
        data = held[file]
        assert data.startswith(FORMATS[platform.suffix]), file
        if platform.suffix in PROCESSORS:
            assert int.from_bytes(data[PROCESSORS[platform.suffix]], "little") == CODES[platform.name], file
        binary = binaries.read(data)
        assert binary.exported == declared, file
        if platform.suffix == ".so":
            assert (0, 0) < binary.glibc <= (2, 17)
            assert binary.libraries == {"libc.so.6"}
        elif platform.suffix == ".dylib":
            assert binary.macos == (11, 0, 0)
            assert binary.name == "@rpath/Everywhere.dylib"
