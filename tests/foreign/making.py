"""C files compiled to libraries of this machine, and archives with them, as somebody else would make FMUs."""

from __future__ import annotations

import subprocess
import zipfile
from collections.abc import Collection, Sequence
from pathlib import Path

import fmpy

from build_fmus.compile import find_toolchain, host
from cosim.check.binary import required
from cosim.fmu.calls import platform_folder

HERE = Path(__file__).parent
SCHEDULED = tuple(
    f"fmi3{n}"
    for n in ("ActivateModelPartition", "InstantiateScheduledExecution", "SetShiftDecimal", "SetShiftFraction")
)


def compile_library(folder: Path, name: str, version: int, sources: Sequence[Path], *flags: str) -> Path:
    """The library NAME of these sources, which have the headers of the standard and FMI=2 or 3, in a folder; once."""
    library = folder / f"{name}{platform_folder(str(version))[1]}"
    if library.is_file():
        return library
    command = [*find_toolchain(host()).command, "-O1", "-shared", "-fPIC", "-std=c99", "-w", f"-DFMI={version}"]
    command += [f"-I{Path(fmpy.__file__).parent / 'c-code'}", *map(str, sources), "-o", str(library), *flags, "-lm"]
    subprocess.run(command, check=True, capture_output=True)
    return library


def others(folder: Path, name: str, version: int, *, scheduled: bool = True, without: Collection[str] = ()) -> Path:
    """A C file with the functions that a library must have all the same, where it has none of its own: they fail.

    `scheduled`: those of FMI 3.0 too that importers look for, though only Scheduled Execution needs them.
    """
    wanted = [*required(str(version), {"cs", "me"}), *(SCHEDULED if version == 3 and scheduled else ())]
    file = folder / f"others_{name}.c"
    lines = (f"__attribute__((weak)) int {f}(void) {{ return 3; }}\n" for f in wanted if f not in without)
    file.write_text("".join(lines))
    return file


def contents(version: int, identifier: str, description: str, library: Path) -> dict[str, bytes]:
    """Files of an archive: the description and the library of this machine."""
    where, suffix = platform_folder(str(version))
    return {
        "modelDescription.xml": description.encode(),
        f"binaries/{where}/{identifier}{suffix}": library.read_bytes(),
    }


def redescribed(source: Path, path: Path, *replacements: tuple[bytes, bytes]) -> Path:
    """A copy of an FMU whose description has other words; of those in the list each must be there."""
    with zipfile.ZipFile(source) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    for before, after in replacements:
        assert before in files["modelDescription.xml"]
        files["modelDescription.xml"] = files["modelDescription.xml"].replace(before, after)
    return pack(path, files)


def pack(path: Path, files: dict[str, bytes]) -> Path:
    """An archive with these files."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path
