"""Related files of an FMU, as standards define them: its reference results and its bill of materials.

FMI-LS-REF lists the files with reference results; CycloneDX says of what the FMU is made and by which compiler.

Of FMI-LS-REF there is no release yet. The manifest follows its draft 1.0.0-beta.1, which has no checksums of files; the
experiments file follows the draft of the format that it refers to, MA-HS-Experiments, which has no versions.
"""

from __future__ import annotations

import hashlib
import io
import json
import posixpath
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from typing import Any

from lxml import etree

from build_fmus.compile import CFLAGS, Toolchain
from build_fmus.description_xml import TOOL
from build_fmus.licenses import Part

NAME = "org.fmi-standard.fmi-ls-ref"
FOLDER = f"extra/{NAME}"
VERSION = "1.0.0-beta.1"
BILL = f"{FOLDER}/bill-of-materials.cdx.json"
_NAMESPACE = "http://fmi-standard.org/fmi-ls-manifest"
_DESCRIPTION = "Layered Standard providing information on related files included in an FMU."  # prescribed


@dataclass(frozen=True)
class Related:
    """A file of an FMU and what it is for.

    Attributes:
        path: in the archive.
        role: one of those of FMI-LS-REF.
        type: MIME type.
    """

    path: str
    role: str
    type: str
    description: str


@dataclass(frozen=True)
class Experiment:
    """A run with known results: times [s], and paths of inputs and results in the archive.

    Inputs None: there are none.
    """

    stop: float
    step: float
    inputs: str | None
    references: str


def files(
    name: str,
    content: Mapping[str, bytes],
    parts: Iterable[Part],
    compilers: Mapping[str, Toolchain],
    *,
    experiment: Experiment | None = None,
    components: Sequence[Mapping[str, Any]] = (),
) -> dict[str, bytes]:
    """The files below `extra/` of the FMU `name`, by their path in the archive.

    Args:
        name: of the FMU.
        content: all other files of the archive.
        parts: third-party code in it.
        compilers: of the binaries, by their path.
        experiment: the one whose results are in `content`.
        components: bill entries of the FMUs inside this FMU.
    """
    made = {BILL: bill_of_materials(name, content, parts, compilers, components)}
    related = [Related(BILL, "meta-data", "application/vnd.cyclonedx+json", "Bill of materials of the FMU (CycloneDX)")]
    if experiment is not None:
        path = f"{FOLDER}/reference.exp"
        made[path] = _experiments(name, experiment)
        text = "Run with the inputs and results of the documentation"
        related.append(Related(path, "experiment/smoke-test", "application/x-ma-hs-experiments", text))
        related.append(Related(experiment.references, "result", "text/csv", "Outputs at the communication points"))
    if (provenance := "resources/provenance.json") in content:
        text = "Provenance of the model: numbers and their sources"
        related.append(Related(provenance, "meta-data", "application/json", text))
    made[f"{FOLDER}/fmi-ls-manifest.xml"] = _manifest(related)
    return made


def bill_of_materials(
    name: str,
    content: Mapping[str, bytes],
    parts: Iterable[Part],
    compilers: Mapping[str, Toolchain],
    components: Sequence[Mapping[str, Any]] = (),
) -> bytes:
    """Bill of one FMU: its libraries with their files, and its binaries with compiler and flags."""
    own = {
        "type": "library",
        "bom-ref": TOOL,
        "name": TOOL,
        "version": metadata.version(TOOL),
        "description": "The runtime, and what generated the code of the model",
        "licenses": [{"license": {"id": "BSD-3-Clause"}}],
    }
    libraries = [own, *(_library(p, content) for p in parts), *components]
    binaries = [
        {
            **_file(path, content),
            "properties": [
                {"name": f"{TOOL}:compiler", "value": toolchain.version},
                {"name": f"{TOOL}:flags", "value": " ".join(CFLAGS)},
            ],
        }
        for path, toolchain in sorted(compilers.items())
    ]
    dependencies = {"ref": f"{name}.fmu", "dependsOn": [c["bom-ref"] for c in libraries]}
    component = {"type": "library", "bom-ref": f"{name}.fmu", "name": f"{name}.fmu"}
    return bill(component, [*libraries, *binaries], dependencies=[dependencies])


def bill(component: Mapping[str, Any], components: Sequence[Mapping[str, Any]], **more: Any) -> bytes:
    """CycloneDX 1.6 as JSON, without time and serial number: the same thing has the same bill."""
    found = {
        "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": component},
        "components": components,
        **more,
    }
    return f"{json.dumps(found, indent=1)}\n".encode()


def archived(path: str, archive: bytes) -> dict[str, Any]:
    """The entry of an FMU, here `path`, in the bill of something that has it as a file."""
    with zipfile.ZipFile(io.BytesIO(archive)) as z:
        held = {BILL: z.read(BILL)} if BILL in z.namelist() else {}
    hashes = [{"alg": "SHA-256", "content": hashlib.sha256(archive).hexdigest()}]
    return {**component(path.removesuffix(".fmu"), held), "hashes": hashes}


def component(name: str, files: Mapping[str, bytes]) -> dict[str, Any]:
    """The entry in a system's bill of an FMU with these files: with all that its own bill lists, where it has one."""
    found: dict[str, Any] = {"type": "library", "bom-ref": f"{name}.fmu", "name": f"{name}.fmu"}
    if BILL in files:
        listed = [c for c in json.loads(files[BILL])["components"] if c["type"] != "file"]
        found["components"] = [{k: v for k, v in c.items() if k not in ("bom-ref", "components")} for c in listed]
    return found


def _library(part: Part, content: Mapping[str, bytes]) -> dict[str, Any]:
    held = [n for n in part.files if n in content]
    return {
        "type": "library",
        "bom-ref": part.name,
        "name": part.name,
        **({"version": part.version} if part.version[:1].isdigit() else {"description": part.version}),
        "licenses": [{"license": {"id": part.license}}],
        "components": [_file(n, content) for n in held],
    }


def _file(path: str, content: Mapping[str, bytes]) -> dict[str, Any]:
    return {
        "type": "file",
        "name": path,
        "hashes": [{"alg": "SHA-256", "content": hashlib.sha256(content[path]).hexdigest()}],
    }


def _experiments(name: str, experiment: Experiment) -> bytes:
    root = etree.Element("Experiments", name=name)
    one = etree.SubElement(
        root, "Experiment", name="reference", description="The run whose results are in the documentation"
    )
    times = {"startTime": 0.0, "stopTime": experiment.stop, "stepSize": experiment.step}
    etree.SubElement(one, "TransientSimulation", {k: repr(v) for k, v in times.items()})
    if experiment.inputs is not None:
        etree.SubElement(one, "Stimuli", source=_relative(experiment.inputs))
    etree.SubElement(one, "References", source=_relative(experiment.references))
    return _xml(root)


def _manifest(related: Iterable[Related]) -> bytes:
    rows = (
        {"type": r.type, "source": _relative(r.path), "role": r.role, "description": r.description} for r in related
    )
    return manifest("fmiReferences", NAME, VERSION, _DESCRIPTION, "Related", rows)


def manifest(
    root: str, name: str, version: str, description: str, element: str, rows: Iterable[Mapping[str, str]]
) -> bytes:
    """The manifest of a layered standard: elements of one kind with these attributes."""
    top = etree.Element(root, nsmap={"fmi-ls": _NAMESPACE})
    for key, value in (("name", name), ("version", version), ("description", description)):
        top.set(f"{{{_NAMESPACE}}}fmi-ls-{key}", value)
    for row in rows:
        etree.SubElement(top, element, row)
    return _xml(top)


def _relative(path: str) -> str:
    return posixpath.relpath(path, FOLDER)


def _xml(root: Any) -> bytes:
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True))
