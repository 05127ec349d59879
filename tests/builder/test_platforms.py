"""Binaries for every platform, by ziglang: what they export, what they need, what they call themselves.

On a machine without them ziglang first makes the C libraries of these systems, over a minute; `make test` takes one of
them.
"""

from __future__ import annotations

import io
import re
import zipfile

import binaries
import pytest
from built import FMUS
from components import filter_bank

from build_fmus.compile import PLATFORMS, ObjectCache
from build_fmus.package import build_fmu


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(
    "name", [n if n == "x86_64-linux" else pytest.param(n, marks=pytest.mark.full) for n in PLATFORMS]
)
def test_binaries_of_every_platform(name: str, fmi: int) -> None:
    platform = PLATFORMS[name]
    archive = build_fmu(filter_bank(), fmi, [platform], ObjectCache(FMUS / ".cache" / "ziglang"))
    with zipfile.ZipFile(io.BytesIO(archive)) as z:
        folder = platform.fmi2_name if fmi == 2 else platform.name
        binary = binaries.read(z.read(f"binaries/{folder}/ProbeDiscrete{platform.suffix}"))
        header = z.read(f"sources/fmi{fmi}Functions.h").decode()
        licenses = {n.rpartition("/")[2]: z.read(n) for n in z.namelist() if n.startswith("documentation/licenses/")}
    assert binary.exported == set(re.findall(rf"^#define (fmi{fmi}[A-Z]\w+) +fmi{fmi}FullName\(", header, re.MULTILINE))
    assert len(binary.exported) > 40
    assert ("MinGW-w64.txt" in licenses) == platform.is_windows
    if platform.suffix == ".so":
        assert (0, 0) < binary.glibc <= (2, 17)
        assert binary.libraries == {"libc.so.6"}
    elif platform.suffix == ".dylib":
        assert binary.macos == (11, 0, 0)
        assert binary.libraries == {"/usr/lib/libSystem.B.dylib"}
        assert binary.name == "@rpath/ProbeDiscrete.dylib"
    else:
        assert binary.name == "ProbeDiscrete.dll"
        assert b"(c) 2009 - 2013 by the mingw-w64 project" in licenses["MinGW-w64.txt"]
        assert f"    binaries/{folder}/ProbeDiscrete.dll\n" in licenses["license.txt"].decode()
        assert all(
            re.match(r"kernel32\.dll|ucrtbase\.dll|msvcrt\.dll|api-ms-win-crt-", x, re.I) for x in binary.libraries
        )
