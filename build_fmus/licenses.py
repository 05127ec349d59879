"""Who wrote what in an FMU, and under which license: the texts in `documentation/licenses/`, with an entry point.

Texts come from where the code comes from, so that they are those of the version used.
"""

from __future__ import annotations

import importlib.util
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from build_fmus import mathematics
from build_fmus.qp_sources import SourceError, ThirdParty, license_file

FOLDER = "documentation/licenses"
ENTRY = f"{FOLDER}/license.txt"  # the name that FMI asks for


@dataclass(frozen=True)
class Part:
    """Work of others in an FMU.

    Attributes:
        license: SPDX identifier.
        files: paths in the archive.
        text: the license, with its copyright notice, as the authors give it.
        note: what it is, what was changed, what the license asks.
    """

    name: str
    version: str
    license: str
    files: tuple[str, ...]
    text: bytes
    note: str


def texts(name: str, parts: Iterable[Part]) -> dict[str, bytes]:
    """License files of the FMU `name` by their path in the archive: the entry point and one for each part."""
    parts = list(parts)
    own = textwrap.indent(license_file("suspension-fmus").decode(), "    ")
    lines = [
        f"Licenses of {name}.fmu",
        "",
        (
            "BSD-3-Clause, for everything that is not listed further down (a model that you have declared yourself is"
            " yours):"
        ),
        "",
        own.rstrip(),
        "",
        (
            "Parts by others are listed here with their license, whose text lies beside this file. The binaries contain"
            " them too."
        ),
    ]
    for part in parts:
        lines += ["", f"{part.name} {part.version}, {part.license}: {_file(part)}"]
        lines += [f"    {file}" for file in part.files]
        lines += ["", *textwrap.wrap(part.note, 100, initial_indent="    ", subsequent_indent="    ")]
    return {ENTRY: ("\n".join(lines) + "\n").encode(), **{f"{FOLDER}/{_file(p)}": p.text for p in parts}}


def of_sources(files: Mapping[str, bytes], solvers: Iterable[ThirdParty], *, uses_casadi: bool) -> list[Part]:
    """Third-party parts among the files of `sources/`, by their path below it.

    `solvers` are those of quadratic programs; `uses_casadi`: whether the equations are partly in the code of
    CasADi's generator.
    """
    parts = [_fmi_headers(files), *([_casadi()] if uses_casadi else [])]
    if musl := [n for n in files if n.startswith(f"{mathematics.FOLDER}/")]:
        note = "Mathematical functions. The head of libm.h says what was changed."
        text = mathematics.copyright_notice()
        parts.append(Part("musl", mathematics.VERSION, "MIT", _sources(musl), text, note))
    parts += [Part(s.name, s.version, s.spdx, _sources(s.files), s.license, s.note) for s in solvers]
    return parts


def of_windows(libraries: Iterable[str]) -> list[Part]:
    """What ziglang links into Windows `libraries`, by their path in the archive."""
    libraries = tuple(libraries)
    ziglang = importlib.util.find_spec("ziglang")
    if not libraries or ziglang is None or ziglang.origin is None:
        return []
    text = (Path(ziglang.origin).parent / "lib" / "libc" / "mingw" / "COPYING").read_bytes()
    note = "Start-up code of libraries, linked into them by the compiler; not in the sources."
    return [Part("MinGW-w64", f"of ziglang {metadata.version('ziglang')}", "ZPL-2.1", libraries, text, note)]


def _sources(names: Iterable[str]) -> tuple[str, ...]:
    return tuple(f"sources/{n}" for n in sorted(names))


def _file(part: Part) -> str:
    return f"{part.name.replace(' ', '-')}.txt"


def _fmi_headers(files: Mapping[str, bytes]) -> Part:
    """The text stands in the comment at the head of each of them."""
    names = sorted(n for n in files if n.startswith("fmi") and n.endswith(".h"))
    comment = files[next(n for n in names if n.endswith("Functions.h"))].decode().split("*/")[0]
    text = textwrap.dedent(comment[comment.rindex("\n", 0, comment.index("Copyright (C)")) :]).strip("\n")
    note = "The headers of FMI, unchanged, from the package fmpy."
    return Part(
        "FMI headers", "of the Modelica Association", "BSD-2-Clause", _sources(names), f"{text}\n".encode(), note
    )


def _casadi() -> Part:
    """The text stands at the head of the templates that CasADi's code generator copies from."""
    import casadi

    version = metadata.version("casadi")
    template = Path(casadi.GlobalOptions.getCasadiIncludePath()) / "casadi" / "core" / "runtime" / "casadi_copy.hpp"
    lines = template.read_text().splitlines() if template.is_file() else []
    head = lines[: next((i for i, line in enumerate(lines) if not line.startswith("//")), 0)]
    text = textwrap.dedent("\n".join(line.removeprefix("//") for line in head)).strip("\n")
    if "MIT No Attribution" not in text:
        raise SourceError(
            f"casadi {version} has no license text of its code templates in {template}; install casadi from PyPI"
        )
    note = (
        "Helper functions (casadi_...) that CasADi's code generator copies into generated code. Nothing else in the FMU"
        " is CasADi's: it (LGPL-3.0-or-later) made the code and is not part of it, and its authors claim no copyright"
        " in what it generates. So nothing is asked of those who pass the FMU on."
    )
    return Part("CasADi helpers", version, "MIT-0", ("sources/model.c",), f"{text}\n".encode(), note)
