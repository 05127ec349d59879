"""Checks of layered standards (FMI 3.0, 2.6): which ones an FMU declares, and whether their manifests are valid."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from lxml import etree

from build_fmus.base.checks import one_line
from cosim.check.description_rules import File
from cosim.check.rules import Found, file_check, note, require, warning
from cosim.core.errors import FmuError
from cosim.fmu import validation
from cosim.fmu.limits import Limits
from cosim.fmu.xml import tree

MANIFEST = "fmi-ls-manifest.xml"
NAMESPACE = "http://fmi-standard.org/fmi-ls-manifest"
SCHEMAS = {
    "org.fmi-standard.fmi-ls-ref": ("fmi3LayeredStandardReferenceManifest.xsd", "1.0.0-beta.1"),
    "org.fmi-standard.fmi-ls-struct": ("fmi3LayeredStandardStructManifest.xsd", None),
    "org.fmi-standard.fmi-ls-xcp": ("fmi3LayeredStandardXcpManifest.xsd", "1.0.0"),
}
"""Layered standards whose schema is carried: its file, and the version that it belongs to (None: any)."""
MOST_SHOWN = 5
_FOLDERS = (Path(__file__).parent / "third_party", Path(validation.__file__).parent / "third_party" / "fmi3")


def manifests(file: File) -> list[str]:
    """Paths of the manifests of layered standards in the archive."""
    root = file.folder
    return sorted(p.relative_to(root).as_posix() for p in root.glob(f"extra/*/{MANIFEST}"))


def declared(file: File) -> list[str]:
    """Layered standards in the manifests, each with its version; the folder's name replaces a missing name."""
    found = []
    for path in manifests(file):
        root = _root(file, path)
        name, version = ("", "") if isinstance(root, str) else (_attribute(root, "name"), _attribute(root, "version"))
        found.append(one_line(f"{name or path.split('/')[1]} {version or '(no version)'}", 120))
    return found


@file_check(
    "archive.layered",
    "manifests of layered standards have the attributes that FMI requires and conform to their schema, if known",
    fmi2="2.3 FMU Distribution (extra), with FMI 3.0, 2.6 Versioning and Layered Standards",
    fmi3="2.6 Versioning and Layered Standards",
    advice="Correct fmi-ls-manifest.xml as the layered standard describes it.",
    worst="warning",
)
def layered(file: File) -> Found:
    found = manifests(file)
    require(found, "there are no layered standards")
    for path in found:
        root = _root(file, path)
        if isinstance(root, str):
            yield warning(root)
            continue
        for short in ("name", "version", "description"):
            if not _attribute(root, short):
                yield warning(
                    f"{path}, line {root.sourceline}: the root element has no attribute fmi-ls-{short} of the namespace"
                    f" {NAMESPACE}"
                )
        yield from _of_its_schema(file, path, root)


def _of_its_schema(file: File, path: str, root: Any) -> Found:
    """What the schema of a layered standard says, and which related files are missing."""
    name, version = _attribute(root, "name") or path.split("/")[1], _attribute(root, "version")
    if name not in SCHEMAS:
        return
    schema, of = SCHEMAS[name]
    other = of is not None and version not in ("", of)
    suffix = f" (the schema is that of version {of}; the manifest declares {one_line(version, 40)})" if other else ""
    validator, fixed = _schema(schema)
    texts = []
    if not validator.validate(root):
        missing = f"The attribute '{{{NAMESPACE}}}"  # has been said
        texts = [f"line {e.line}: {one_line(e.message)}" for e in validator.error_log if missing not in e.message]
    for short, value in fixed.items():
        if _attribute(root, short) not in ("", value):
            texts.append(f"line {root.sourceline}: fmi-ls-{short} must be {value!r}")
    yield from ((note if other else warning)(f"{path}, {text}{suffix}") for text in texts[:MOST_SHOWN])
    base = (file.folder / path).parent
    for element in root.iter("Related"):
        source = element.get("source", "")
        if source and ":" not in source and not (base / source).exists():
            yield note(f"{path}, line {element.sourceline}: {one_line(source, 120)!r} is not in the archive")


def _root(file: File, path: str) -> Any:
    """The root element, or a message that says why it cannot be read."""
    try:
        return tree((file.folder / path).read_bytes(), "the archive", Limits(), path)
    except (FmuError, OSError) as error:
        return str(error)


def _attribute(root: Any, short: str) -> str:
    return str(root.get(f"{{{NAMESPACE}}}fmi-ls-{short}", "")).strip()


@cache
def _schema(name: str) -> tuple[Any, dict[str, str]]:
    """A schema, and its prescribed values for attributes of the root element, which libxml2 does not compare."""
    parser = etree.XMLParser(no_network=True)
    parser.resolvers.add(_Carried())
    text = etree.parse(str(_FOLDERS[0] / name), parser)
    attributes = text.iter("{http://www.w3.org/2001/XMLSchema}attribute")
    return etree.XMLSchema(text), {
        str(a.get("ref")).rpartition("fmi-ls-")[2]: a.get("fixed")
        for a in attributes
        if a.get("ref") and a.get("fixed")
    }


class _Carried(etree.Resolver):
    """The schemas include others by their addresses on the web; here they come from the files beside them."""

    def resolve(self, url: str, public_id: str, context: Any) -> Any:  # noqa: ARG002
        for folder in _FOLDERS:
            path = folder / url.rpartition("/")[2]
            if path.is_file():
                return self.resolve_filename(str(path), context)
        return None
