"""C files compiled to libraries of this machine, and archives with them, as somebody else would make FMUs."""

from __future__ import annotations

import subprocess
import zipfile
from collections.abc import Sequence
from pathlib import Path

import fmpy

from build_fmus.compile import find_toolchain, host
from cosim.fmu.calls import platform_folder

HERE = Path(__file__).parent


def compile_library(folder: Path, name: str, version: int, sources: Sequence[Path], *flags: str) -> Path:
    """The library NAME of these sources, which have the headers of the standard and FMI=2 or 3, in a folder; once."""
    library = folder / f"{name}{platform_folder(str(version))[1]}"
    if library.is_file():
        return library
    command = [*find_toolchain(host()).command, "-O1", "-shared", "-fPIC", "-std=c99", "-w", f"-DFMI={version}"]
    command += [f"-I{Path(fmpy.__file__).parent / 'c-code'}", *map(str, sources), "-o", str(library), *flags, "-lm"]
    subprocess.run(command, check=True, capture_output=True)
    return library


def contents(version: int, identifier: str, description: str, library: Path) -> dict[str, bytes]:
    """Files of an archive: the description and the library of this machine."""
    where, suffix = platform_folder(str(version))
    return {
        "modelDescription.xml": description.encode(),
        f"binaries/{where}/{identifier}{suffix}": library.read_bytes(),
    }


def pack(path: Path, files: dict[str, bytes]) -> Path:
    """An archive with these files."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path
