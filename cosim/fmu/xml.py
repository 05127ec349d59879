"""modelDescription.xml as a tree: nothing is loaded from elsewhere, and nothing grows beyond the limits."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

from lxml import etree

from build_fmus.base.checks import one_line
from cosim.core.errors import FmuError
from cosim.fmu.limits import Limits

HUGE = 10_000_000  # bytes of XML from which on the parser's own limits are lifted; ours hold

ATTRIBUTES = 1000  # of one element; they are looked at together

_ENCODING = re.compile(rb"^[^<]{0,4}<\?xml[^>]*?encoding\s*=\s*[\"']([^\"'>]*)[\"']")
_LIKE_ASCII = re.compile(
    rb"utf-?8|us-ascii|ascii|(iso-?8859|windows|cp)-?\d+(-\d+)?|latin-?\d|utf-?16(le|be)?", re.IGNORECASE
)
"""Encodings in which a document type declaration can be seen: others can hide it from whoever looks at bytes."""


@cache
def schema(path: Path) -> Any:
    """A compiled schema; what it includes lies beside it."""
    return etree.XMLSchema(etree.parse(str(path), etree.XMLParser(no_network=True)))


def tree(xml: bytes, where: str, limits: Limits, name: str = "modelDescription.xml") -> Any:
    """The root element of modelDescription.xml, or of another file of that `name`.

    `where` names the archive in errors. Raises FmuError.
    """
    file = f"{where}: {name}"
    limits.check("xml_bytes", len(xml), f"{file} has {len(xml)} bytes")
    wide = b"\0" in xml[:4]
    if b"<!DOCTYPE" in (xml.replace(b"\0", b"") if wide else xml):
        # Entities grow without limit; no exporter needs them.
        raise FmuError(f"{file} has a document type declaration, which the standard does not allow; remove it")
    declared = _ENCODING.match(xml)
    if (declared and not _LIKE_ASCII.fullmatch(declared[1])) or xml[:3] == b"\x4c\x6f\xa7":  # the last is EBCDIC
        name = declared[1].decode("ascii", "replace") if declared else "EBCDIC"
        raise FmuError(f"{file} is encoded as {one_line(name, 40)!r}; the standard requires UTF-8")
    nodes = xml.count(b"<") + xml.count(b"=")
    limits.check("xml_nodes", nodes, f"{file} has about {nodes} elements and attributes")
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        huge_tree=len(xml) > HUGE,
        remove_comments=True,
        remove_pis=True,
    )
    try:
        root = etree.fromstring(xml, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise FmuError(f"{file} is not well-formed ({one_line(str(error))})") from None
    if root.getroottree().docinfo.internalDTD is not None:
        raise FmuError(f"{file} has a document type declaration, which the standard does not allow; remove it")
    if root.xpath(f"boolean(//*[count(@*) > {ATTRIBUTES}])"):
        raise FmuError(
            f"{file} has an element with more than {ATTRIBUTES} attributes; no element of the standard has more than"
            " thirty"
        )
    return root
