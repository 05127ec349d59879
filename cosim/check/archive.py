"""Checks of the archive: what a ZIP file must be to be an FMU, and what must lie where in it."""

from __future__ import annotations

import posixpath
import re
import zipfile
from collections.abc import Iterable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from build_fmus.base.checks import one_line
from cosim.check.description_rules import File
from cosim.check.rules import Found, file_check, names, note, require, warning
from cosim.core.errors import FmuError
from cosim.core.terminals import BUS, FLOWS, PLUG, RULES
from cosim.fmu.limits import Limits
from cosim.fmu.xml import schema as xml_schema
from cosim.fmu.xml import tree

_TOP3 = {"modelDescription.xml", "documentation", "sources", "binaries", "resources", "extra", "terminalsAndIcons"}
_TOP = {"2": {*_TOP3, "model.png", "icons", "licenses"}, "3": _TOP3}


def entries(file: File) -> list[str]:
    """Paths of all files, with forward slashes."""
    root = file.folder
    return sorted(p.relative_to(root).as_posix() for p in root.rglob("*") if p.is_file())


@file_check(
    "archive.zip",
    "the ZIP file uses only features that every tool can read",
    fmi2="2.3 FMU Distribution",
    fmi3="2.5 FMU Distribution",
    advice="Pack with deflate (or store), no encryption, forward slashes in paths, and the ending .fmu.",
)
def zip_file(file: File) -> Found:
    require(not file.archive.is_folder, "it is a folder, not an archive")
    if file.archive.path.suffix != ".fmu":
        yield warning(f"the name {file.archive.path.name!r} does not end in .fmu")
    with zipfile.ZipFile(file.archive.path) as archive:
        seen: set[str] = set()
        for info in archive.infolist():
            name = info.orig_filename
            what = f"file {one_line(name, 80)!r} in the archive"
            if "\\" in name:
                yield f"{what} has a backslash in its path"
            if info.flag_bits & 1:
                yield f"{what} is encrypted"
            if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                yield f"{what} is compressed with method {info.compress_type}; FMI allows store and deflate"
            if file.model.version == "3" and info.extract_version > 20 and info.file_size < 2**32 - 1:
                yield warning(f"{what} needs version {info.extract_version / 10:g} of ZIP; FMI 3.0 allows 2.0")
            if name.lower() in seen:
                yield warning(f"{what} appears twice on file systems that ignore case")
            seen.add(name.lower())


@file_check(
    "archive.layout",
    "files are in the folders that the standard defines",
    fmi2="2.3 FMU Distribution (structure of the ZIP file)",
    fmi3="2.5.1 Structure of the ZIP file",
    advice=(
        "Move your own data to resources/ or extra/; add index.html to the documentation and an entry file to the"
        " licenses."
    ),
)
def layout(file: File) -> Found:
    found, v = entries(file), file.model.version
    others = sorted({p.split("/")[0] for p in found} - _TOP[v])
    if others:
        yield note(f"{names(others)} at the top level of the archive is not defined by the standard")
    inside = {p for p in found if p.startswith("documentation/")}
    if any(p.count("/") == 1 for p in inside) and not inside & {"documentation/index.html", "documentation/_main.html"}:
        yield note("there is documentation, but no entry page documentation/index.html")
    licenses = [p.lower() for p in inside if p.startswith("documentation/licenses/")]
    entry = {f"documentation/licenses/license.{e}" for e in ("txt", "html", "spdx")}
    if v == "3" and licenses and not entry & set(licenses):
        yield "documentation/licenses/ has no entry file: license.txt, license.html or license.spdx"
    wrong = [p for p in found if re.fullmatch(r"documentation/licen[cs]e(s?)\.(txt|html)|licenses?/.*", p)]
    if v == "3" and wrong and not licenses:
        yield note(f"{wrong[0]}: licenses belong in documentation/licenses/")


@file_check(
    "archive.implementation",
    "every interface has a binary or sources",
    fmi2="2.3 FMU Distribution",
    fmi3="2.5 FMU Distribution",
    advice=(
        "Name each library after modelIdentifier, in the folder of its platform, or add the sources with their"
        " description."
    ),
)
def implementation(file: File) -> Found:
    m = file.model
    found = file.archive.libraries()
    with_backslashes = [p.split("\\") for p in entries(file)]  # archive.zip tells of them
    found += [(p[1], p[2]) for p in with_backslashes if len(p) == 3 and p[0] == "binaries"]
    sources = any(p.startswith("sources/") for p in entries(file))
    for i in m.interfaces.values():
        platforms = {folder for folder, name in found if name.rpartition(".")[0] == i.identifier}
        if platforms or sources:
            continue
        there = f"; it holds {names((f'{a}/{b}' for a, b in found), 3)}" if found else ""
        yield i.line, f"there is neither a library {i.identifier!r} nor a source file{there}"


@file_check(
    "archive.sources",
    "all source files that are listed exist, with a build description",
    fmi2="2.3 FMU Distribution; 3.3.1, 4.3.1 (SourceFiles)",
    fmi3="2.5.1.4 Directory sources",
    advice="List every file to compile, by its path from sources/; FMI 3.0 wants a buildDescription.xml.",
)
def sources(file: File) -> Found:
    found = entries(file)
    there = {p.removeprefix("sources/") for p in found if p.startswith("sources/")}
    listed = file.model.version == "2" and file.root.find(".//SourceFiles") is not None
    require(there or listed, "there are no sources")
    if file.model.version == "2":
        named = [*file.root.iterfind(".//SourceFiles/File")]
        if not there:
            yield warning(
                f"it lists {len(named)} source files, but has no folder sources/", named[0].sourceline if named else 0
            )
            return
        for element in named:
            if posixpath.normpath(element.get("name", "")) not in there:
                yield element.sourceline, f"source file {element.get('name')!r} is not in sources/"
        return
    if "buildDescription.xml" not in there:
        yield warning("sources/ has no buildDescription.xml, which says what to compile")
        return
    build = yield from _validated(file, "sources/buildDescription.xml", "fmi3BuildDescription.xsd")
    if build is None:
        return
    identifiers = {i.identifier for i in file.model.interfaces.values()}
    for configuration in build.iterfind("BuildConfiguration"):
        if identifiers and configuration.get("modelIdentifier") not in identifiers and not file.model.scheduled:
            yield (
                f"sources/buildDescription.xml, line {configuration.sourceline}: no interface has the modelIdentifier"
                f" {configuration.get('modelIdentifier')!r}"
            )
    for element in build.iter("SourceFile"):
        if element.get("name") not in there:
            yield f"sources/buildDescription.xml, line {element.sourceline}: {element.get('name')!r} is not in sources/"


@file_check(
    "archive.terminals",
    "terminals conform to their schema, refer to existing variables, and can be matched",
    fmi3="2.4.9 Terminals and Icons",
    advice="Correct terminalsAndIcons/terminalsAndIcons.xml.",
)
def terminals(file: File) -> Found:
    path = "terminalsAndIcons/terminalsAndIcons.xml"
    require((file.folder / path).is_file(), "there are no terminals")
    root = yield from _validated(file, path, "fmi3TerminalsAndIcons.xsd")
    if root is None:
        return
    causality = {n: v.causality for v in file.model.variables for n in (v.name, *v.aliases)}
    for element in root.iter("TerminalMemberVariable", "TerminalStreamMemberVariable"):
        for attribute in ("variableName", "inStreamVariableName", "outStreamVariableName"):
            name, at = element.get(attribute), f"{path}, line {element.sourceline}"
            if name is None:
                continue
            if name not in causality:
                yield f"{at}: there is no variable {name!r}"
            elif causality[name] not in ("input", "output", "parameter", "calculatedParameter"):
                yield f"{at}: variable {name!r} is {causality[name]}; a terminal has inputs, outputs and parameters"
    for holder in root.iter("Terminals", "Terminal"):
        yield from (
            f"{path}, line {line}: terminal {name!r} is defined twice"
            for name, line in _twice(holder.iterfind("Terminal"), "name")
        )
    for terminal in root.iter("Terminal"):
        yield from (f"{path}, {text}" for text in _unmatchable(terminal))


def _unmatchable(terminal: Any) -> Iterator[str]:
    """Reasons why variables of a terminal cannot be matched."""
    members = terminal.findall("TerminalMemberVariable")
    rule, line = terminal.get("matchingRule", ""), f"line {terminal.sourceline}"
    if rule not in RULES and "." not in rule:
        yield (
            f"{line}: matching rule {rule!r} is none of FMI's ({', '.join(RULES)}), nor a name in reverse domain"
            " notation"
        )
    if rule in (PLUG, BUS):
        yield from (
            f"line {m.sourceline}: a variable of a {rule} needs a memberName"
            for m in members
            if not m.get("memberName")
        )
        yield from (f"line {at}: there is a memberName {name!r} already" for name, at in _twice(members, "memberName"))
    flows = sum(m.get("variableKind") in FLOWS for m in members)
    if terminal.find("TerminalStreamMemberVariable") is not None and flows > 1:
        yield f"{line}: streams need exactly one flow, and this terminal has {flows}"


def _twice(elements: Iterable[Any], attribute: str) -> Iterator[tuple[str, int]]:
    """Names that an element before had, with the line."""
    seen: set[str] = set()
    for element in elements:
        name = element.get(attribute)
        if name in seen:
            yield name, element.sourceline
        if name:
            seen.add(name)


def _validated(file: File, path: str, schema: str) -> Any:
    """Yields what is wrong with an XML file; returns its root, None if it cannot be read."""
    try:
        root = tree((file.folder / path).read_bytes(), path, Limits())
    except (FmuError, OSError) as error:
        yield str(error)
        return None
    validator = xml_schema(Path(str(find_spec("fmpy").origin)).with_name("schema") / "fmi3" / schema)  # type: ignore[union-attr]
    if not validator.validate(root):
        for entry in list(validator.error_log)[:5]:
            yield f"{path}, line {entry.line}: {one_line(entry.message)}"
    return root
