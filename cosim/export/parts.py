"""How the FMUs of a system travel in its FMU: linked from their sources, or carried in its resources."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from lxml import etree

from build_fmus.compile import ObjectCache, Toolchain
from build_fmus.description_xml import TOOL
from cosim.export.symbols import defined
from cosim.fmu.file import FmuFile

SOURCES = "sources/"
_FMI = re.compile(r"fmi[23][A-Z]\w*")
_PATH = re.compile(r"(?:[A-Za-z0-9_]+/)*[A-Za-z0-9_]+\.c")
_PREFIXED = {  # what gives the functions of FMI a prefix; not every header of FMI 2.0 knows FMI2_FUNCTION_PREFIX
    2: '#include "fmi2Functions.h"\n#undef fmi2FullName\n#define fmi2FullName(name) {prefix}##name\n',
    3: "#undef FMI3_FUNCTION_PREFIX\n#define FMI3_FUNCTION_PREFIX {prefix}\n",
}


@dataclass(frozen=True, eq=False)
class Part:
    """One FMU in the FMU of a system; several components may be instances of it.

    Attributes:
        name: an identifier, unique in the system's FMU.
        linked: from its sources; otherwise it is carried as it is.
        files: what there is of it, by path in its own archive.
        c_files: those to compile, by path below `sources/`.
    """

    name: str
    fmu: FmuFile
    linked: bool
    files: dict[str, bytes] = field(repr=False)
    c_files: tuple[str, ...] = ()

    @property
    def prefix(self) -> str:
        """Of all its names in the library."""
        return prefix_of(self.name)

    @property
    def version(self) -> int:
        """Major FMI version of the FMU."""
        return int(self.fmu.major)

    @property
    def resources(self) -> str:
        """Folder of its own resources below those of the system's FMU."""
        return self.name if self.linked else f"{self.name}/resources"

    def resource_files(self) -> dict[str, bytes]:
        """What goes below `resources/` of the system's FMU."""
        if not self.linked:
            wanted = ("binaries/", "resources/", "modelDescription.xml")
            return {f"{self.name}/{n}": d for n, d in self.files.items() if n.startswith(wanted)}
        own = {n.removeprefix("resources/"): d for n, d in self.files.items() if n.startswith("resources/")}
        return {f"{self.name}/{n}": d for n, d in own.items() if n != "provenance.json" or len(own) > 1}

    def licenses(self) -> dict[str, bytes]:
        """Its license texts, by path below `documentation/licenses/` of the system's FMU."""
        folders = ("documentation/licenses/", "licenses/")
        return {
            f"{self.name}/{n.removeprefix(f)}": d for f in folders for n, d in self.files.items() if n.startswith(f)
        }

    def platforms(self) -> list[str]:
        """Platforms that it has a library for, in the words of its own version of FMI."""
        return self.fmu.platforms()

    def sources(self) -> dict[str, bytes]:
        """Its own sources, in a folder of their own below `sources/` of the system's FMU."""
        return {f"{self.name}/{n.removeprefix(SOURCES)}": d for n, d in self.files.items() if n.startswith(SOURCES)}

    def wrappers(self, names: Sequence[str], exchange: Sequence[str] = ()) -> dict[str, bytes]:
        """C files that compile its sources under names of their own, the header with these, and its function tables.

        `exchange`: functions that an integrator calls, in the order of its table.
        """
        files = wrappers(self.name, self.version, self.c_files, names)
        if exchange:
            calls = [f"fmi{self.version}{name}" for name in exchange]
            own, table = f"{self.prefix}functions.c", f"const ExchangeCall {self.prefix}exchange[]"
            declared = "".join(f"{name}TYPE {name};\n" for name in calls)
            listed = ", ".join(f"(ExchangeCall){name}" for name in calls)
            files[own] += f"{declared}extern {table};\n{table} = {{{listed}}};\n".encode()
        return files

    def names(self, folder: Path, toolchain: Toolchain) -> list[str]:
        """Names that its sources define for each other, but for the functions of FMI; `folder` holds its sources."""
        return defined_names(folder, self.c_files, [folder], toolchain)


def prefix_of(name: str) -> str:
    """What stands before the names of what is linked under a name of its own."""
    return f"{name}_"


def wrappers(name: str, version: int, c_files: Sequence[str], names: Sequence[str]) -> dict[str, bytes]:
    """C files that compile sources below the folder `name` under names of their own, a header, and a function table.

    The header has these names; the table lists the FMI functions of the sources. `names`: symbols that the sources
    define for each other.
    """
    prefix = prefix_of(name)
    renamed = "".join(f"#undef {n}\n#define {n} {prefix}{n}\n" for n in names)
    header = f"/* Names of {name} in this library. Generated. */\n{_PREFIXED[version].format(prefix=prefix)}{renamed}"
    files = {f"{name}/names.h": header.encode()}
    for file in c_files:
        flat = file.replace("/", "_")
        files[f"{prefix}{flat}"] = f'#include "{name}/names.h"\n#include "{name}/{file}"\n'.encode()
    files[f"{prefix}functions.c"] = (
        f'#include "{name}/names.h"\n#include "component.h"\n\nDECLARED{version}\n'
        f"extern const Functions{version} {prefix}functions;\n"
        f"const Functions{version} {prefix}functions = FUNCTIONS{version};\n"
    ).encode()
    return files


def defined_names(folder: Path, c_files: Sequence[str], include: Sequence[Path], toolchain: Toolchain) -> list[str]:
    """Names that C files define for each other, but for the functions of FMI."""
    objects = [ObjectCache.of_user().object(toolchain, folder / name, include) for name in c_files]
    return sorted(n for path in objects for n in defined(path) if not _FMI.fullmatch(n))


def part_of(name: str, fmu: FmuFile) -> Part:
    """How an FMU travels: those of this project from their sources, others as they are."""
    files = fmu.files()
    c_files = _c_files(files) if fmu.description.tool.startswith(TOOL) else ()
    if any(f"{SOURCES}{name}" not in files or not _PATH.fullmatch(name) for name in c_files):
        c_files = ()  # not what build-fmus writes
    return Part(name, fmu, bool(c_files), files, c_files)


def _c_files(files: dict[str, bytes]) -> tuple[str, ...]:
    """Sources to compile, as the FMU itself lists them: any platform's, for any C99 compiler."""
    if "sources/buildDescription.xml" in files:
        root = etree.fromstring(files["sources/buildDescription.xml"])
        for configuration in root.iterfind("BuildConfiguration"):
            if configuration.get("platform") is None:
                return tuple(e.get("name") for e in configuration.iterfind("SourceFileSet/SourceFile"))
        return ()
    root = etree.fromstring(files["modelDescription.xml"])
    return tuple(e.get("name") for e in root.iterfind("CoSimulation/SourceFiles/File"))


def shown(parts: Sequence[Part]) -> str:
    """What is where, for people and programs: `resources/components.json`."""
    about = [
        {"name": p.name, "model": p.fmu.description.name, "fmi": p.fmu.description.fmi_version, "linked": p.linked}
        for p in parts
    ]
    return json.dumps(about, indent=1) + "\n"
