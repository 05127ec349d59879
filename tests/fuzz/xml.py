"""Descriptions of FMUs, ours and those of others, changed by elements and attributes and by bytes.

A case is a modelDescription.xml. It is opened as an unpacked FMU; what can be opened is shown, wired and scheduled.
"""

from __future__ import annotations

import ast
import random
import re
import zipfile
from contextlib import suppress
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

from lxml import etree
from rich.console import Console

from cosim import CosimError, Fmu, System, describe, wiring
from cosim.fmu.calls import platform_folder

from . import mutate

ALLOWED = (CosimError,)
ROOT = Path(__file__).parents[2]
LARGEST_SEED = 20_000  # bytes
_SCHEMAS = "cosim/fmu/third_party/*/*.xsd"
_OWN = {
    "element": ("Component", "Input", "Variable", "nonsense"),
    "attribute": (
        *("mustEqual", "constant", "sampleTime", "kind", "source"),
        "{http://www.w3.org/2001/XMLSchema-instance}schemaLocation",
        "{http://www.w3.org/2001/XMLSchema-instance}type",
        "{http://www.w3.org/XML/1998/namespace}base",
    ),
}
"""Names that are not in the schemas: of our annotations, and of what XML itself knows."""
_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@cache
def names(kind: str) -> tuple[str, ...]:
    """Names of elements or of attributes, those of the schemas of the standard first."""
    found = (e for path in ROOT.glob(_SCHEMAS) for e in etree.parse(path).iter(f"{{*}}{kind}"))
    return (*sorted({e.get("name") for e in found} - {None}), *_OWN[kind])


@cache
def seeds() -> tuple[bytes, ...]:
    """Small descriptions: of our FMUs that are built, of the tests' own, of PythonFMU."""
    import awkward
    from foreign import followers

    found = [awkward.description(2), awkward.description(3)]
    found += [followers.description(v, "Follower").encode() for v in (2, 3)]
    for path in sorted([*ROOT.glob("fmus/fmi?/*.fmu"), *ROOT.glob("fmus/.probes/arrays/fmi3/*.fmu")]):
        with zipfile.ZipFile(path) as archive:
            if archive.getinfo("modelDescription.xml").file_size <= LARGEST_SEED:
                found.append(archive.read("modelDescription.xml"))
    return (*found, *_python_fmus())


def _python_fmus() -> list[bytes]:
    """What PythonFMU writes, for each FMI version."""
    import pythonfmu
    import pythonfmu3

    class Two(pythonfmu.Fmi2Slave):  # type: ignore[misc]
        def __init__(self, **options: Any):
            super().__init__(**options)
            self.u, self.y, self.n = 0.0, 0.0, 1
            self.register_variable(pythonfmu.Real("u", causality=pythonfmu.Fmi2Causality.input))
            self.register_variable(pythonfmu.Real("y", causality=pythonfmu.Fmi2Causality.output))
            self.register_variable(pythonfmu.Integer("n", causality=pythonfmu.Fmi2Causality.output))

        def do_step(self, _time: float, _step: float) -> bool:
            return True

    class Three(pythonfmu3.Fmi3Slave):  # type: ignore[misc]
        def __init__(self, **options: Any):
            super().__init__(**options)
            self.u, self.y = 0.0, 0.0
            self.register_variable(pythonfmu3.Float64("u", causality=pythonfmu3.Fmi3Causality.input))
            self.register_variable(pythonfmu3.Float64("y", causality=pythonfmu3.Fmi3Causality.output))

        def do_step(self, _time: float, _step: float) -> bool:
            return True

    made = []
    for kind in (Two, Three):
        root = kind(instance_name="a").to_xml()
        for name, value in (
            ("guid", "g"),
            ("instantiationToken", "g"),
            ("generationDateAndTime", "2026-01-01T00:00:00Z"),
        ):
            if root.get(name):
                root.set(name, value)
        from xml.etree import ElementTree

        made.append(ElementTree.tostring(root))
    return made


# ----------------------------------------------------------------------------------------------------------- mutation


def make(rng: random.Random) -> bytes:
    xml = rng.choice(seeds())
    way = rng.random()
    if way < 0.75:
        xml = structure(rng, xml)
    if way > 0.65:
        xml = mutate.several(rng, xml, (*mutate.BYTES, mutate.number, mutate.word, mutate.encoding, head), 4)
    if rng.random() < 0.0005:
        xml = _grow(rng, xml)
    return xml


def structure(rng: random.Random, xml: bytes) -> bytes:
    root = etree.fromstring(xml)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        elements = [e for e in root.iter() if isinstance(e.tag, str)]
        rng.choice(_CHANGES)(rng, rng.choice(elements), elements)
    return bytes(
        etree.tostring(
            root, xml_declaration=rng.random() < 0.5, encoding=rng.choice(("UTF-8", "UTF-8", "US-ASCII", "UTF-16"))
        )
    )


def _valid(text: str) -> str:
    return _NOT_XML.sub("?", text)


def _set(rng: random.Random, element: Any, elements: list[Any]) -> None:
    name = rng.choice([*element.attrib, rng.choice(names("attribute"))])
    other = rng.choice(elements)
    values = [
        *other.attrib.values(),
        *(e.get(name) for e in rng.sample(elements, min(3, len(elements))) if e.get(name) is not None),
    ]
    element.set(name, rng.choice(values) if values and rng.random() < 0.5 else _valid(mutate.odd(rng)))


def _unset(rng: random.Random, element: Any, _elements: list[Any]) -> None:
    if element.attrib:
        del element.attrib[rng.choice(list(element.attrib))]


def _all(rng: random.Random, element: Any, elements: list[Any]) -> None:
    """One attribute of all elements of a kind gets the same value."""
    name, value = rng.choice([*element.attrib, "name"]), _valid(mutate.odd(rng))[:300]
    for one in elements:
        if one.tag == element.tag:
            one.set(name, value)


def _remove(_rng: random.Random, element: Any, _elements: list[Any]) -> None:
    if element.getparent() is not None:
        element.getparent().remove(element)


def _copy(rng: random.Random, element: Any, elements: list[Any]) -> None:
    target = rng.choice((element.getparent(), rng.choice(elements)))
    if target is None or sum(1 for _ in element.iter()) > 100 or len(elements) > 5000:
        return
    original = deepcopy(element)  # the place of the copies may be within it
    for _ in range(rng.choice((1, 1, 1, 2, 40))):
        copied = deepcopy(original)
        if rng.random() < 0.3:
            copied.set("name", _valid(mutate.odd(rng))[:300])
        target.insert(rng.randint(0, len(target)), copied)


def _move(rng: random.Random, element: Any, elements: list[Any]) -> None:
    target = rng.choice(elements)
    if element.getparent() is not None and element not in (target, *target.iterancestors()):
        target.insert(rng.randint(0, len(target)), element)


def _rename(rng: random.Random, element: Any, elements: list[Any]) -> None:
    element.tag = rng.choice((*names("element"), rng.choice(elements).tag, "{urn:x}Real"))


def _new(rng: random.Random, element: Any, _elements: list[Any]) -> None:
    made = etree.SubElement(element, rng.choice(names("element")))
    for _ in range(rng.randint(0, 5)):
        made.set(rng.choice(names("attribute")), _valid(mutate.odd(rng)))


def _dimension(rng: random.Random, element: Any, elements: list[Any]) -> None:
    """An array, often a large one, of what was none."""
    variables = [
        e
        for e in elements
        if e.get("valueReference") and e.getparent() is not None and e.getparent().tag == "ModelVariables"
    ]
    target = rng.choice(variables or [element])
    for _ in range(rng.choice((1, 1, 2, 3, 40))):
        made = etree.SubElement(target, "Dimension")
        value = rng.choice(("1", "2", "3", "0", "-1", "100", "1000", "10000", "100000", "9" * 18, mutate.odd(rng)))
        made.set(rng.choice(("start", "start", "start", "valueReference")), _valid(value))


def _deep(rng: random.Random, element: Any, _elements: list[Any]) -> None:
    for _ in range(rng.choice((10, 200, 300, 3000))):
        element = etree.SubElement(element, "Annotations")


def _text(rng: random.Random, element: Any, _elements: list[Any]) -> None:
    element.text = _valid(mutate.odd(rng))
    element.append(rng.choice((etree.Comment("x"), etree.ProcessingInstruction("x", "y"))))


_CHANGES = (*[_set] * 8, *(_unset, _remove, _copy, _move, _new) * 2, *(_all, _rename, _dimension, _deep, _text))


def head(rng: random.Random, xml: bytes) -> bytes:
    """Another declaration, a document type, another version."""
    body = re.sub(rb"^\s*<\?xml[^>]*\?>", b"", xml)
    declared = rng.choice(("UTF-8", "utf-16", "latin1", "UTF-7", "cp037", "nonsense", "ISO-8859-15", "UCS-4"))
    kind = rng.choice(
        (
            '<!DOCTYPE a [<!ENTITY b "bbbbbbbbbb">]>',
            '<!DOCTYPE a SYSTEM "/dev/zero">',
            "<!doctype a>",
            "<?x y?>",
            "<!-- -->",
            "",
            "",
            '<!DOCTYPE a [<!ENTITY % p SYSTEM "/etc/passwd"> %p;]>',
        )
    )
    changed = re.sub(
        rb'fmiVersion="[^"]*"',
        b'fmiVersion="%s"' % rng.choice((b"2.0", b"3.0", b"1.0", b"3.0-beta.1", b"2.", b"")),
        body,
        count=1,
    )
    text = f'<?xml version="{rng.choice(("1.0", "1.1", "2"))}" encoding="{declared}"?>{kind}'.encode()
    with_it = text + rng.choice((body, changed))
    return with_it.decode("latin-1").encode("utf-16") if declared == "utf-16" and rng.random() < 0.5 else with_it


def _grow(rng: random.Random, xml: bytes) -> bytes:
    """Megabytes: an element or an attribute many times, a long value, an element within itself."""
    part = rng.choice(
        (
            b"<a/>",
            b'<Real start="1"/>',
            b'<ScalarVariable name="a"><Real/></ScalarVariable>',
            b"<a>",
            b" ",
            b"<!-- -->",
            b"x='1' ",
        )
    )
    at = rng.choice([m.end() for m in re.finditer(rb">", xml)] or [0])
    return xml[:at] + part * (rng.choice((10**5, 10**6, 3 * 10**6, 10**7)) // len(part) * 3) + xml[at:]


# -------------------------------------------------------------------------------------------------------------- trial


def run(case: bytes, folder: Path) -> None:
    (folder / "modelDescription.xml").write_bytes(case)
    fmu = Fmu(folder)
    about = fmu.description
    if len(about.variables) < 500 and len(case) % 8 == 0:  # most of the time of a case
        with (folder / "shown").open("w", encoding="utf-8", errors="replace") as file:
            Console(file=file, width=100).print(describe(fmu))
    ast.parse(wiring(fmu))
    binary = folder / fmu.binary
    if binary.parent != folder / "binaries" / platform_folder(fmu.major)[0]:
        raise AssertionError(f"a library outside of its folder: {binary}")
    with suppress(OSError, ValueError):  # a name that is none for a file
        binary.parent.mkdir(parents=True)
        binary.touch()
    rng, inputs = random.Random(len(case)), [*about.inputs]
    with System() as system:
        system.add("one", fmu, step=None if about.default_step else "10 ms")
        system.add("two", fmu, step="1 ms")
        for name, variable in list(about.variables.items())[:50]:
            system["one"].description.find(name)
            if variable.causality == "output" and about.inputs:
                with suppress(CosimError):  # units or types that differ
                    system.connect(f"one.{name}", f"two.{rng.choice(inputs)}")
        str(system.schedule())
        system.unconnected()
        system.select("one.*")
