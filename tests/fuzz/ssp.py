"""Third-party SSP files: structures, parameter sets, mappings and dictionaries that are changed.

Elements, attributes and bytes of them are changed, and the archives around them.

A case is a line with the name of the file that is changed, then that file; the others are whole. What can be opened is
scheduled and drawn.
"""

from __future__ import annotations

import io
import random
import sys
import zipfile
from functools import cache
from pathlib import Path

from cosim import CosimError, System
from cosim.fmu.calls import platform_folder

from . import archives, mutate, xml

sys.path.append(str(Path(__file__).parents[1] / "ssp"))

import packages as made

ALLOWED = (CosimError,)
ARCHIVE = "archive"
STRUCTURE = "SystemStructure.ssd"


@cache
def files() -> dict[str, bytes]:
    """An SSP with everything: nested systems, units, transformations, values, mappings, a dictionary.

    Its FMUs are folders.
    """
    from foreign import followers

    binary = f"resources/follower/binaries/{platform_folder('2')[0]}/follower{platform_folder('2')[1]}"
    inner = made.system(
        "inner",
        made.component("deep", "resources/follower", "u:input:Real:deg", "y:output:Real:rad", "count_in:input:Integer"),
        made.connection("u", "deep.u") + made.connection("deep.y", "y"),
        "u:input:Real:deg",
        "y:output:Real:rad",
    )
    bound = (
        '<ssd:ParameterBinding source="values.ssv"><ssd:ParameterMapping source="names.ssm"/></ssd:ParameterBinding>'
        + made.inline(made.values(rate="Real 2"))
    )
    top = made.system(
        "top",
        made.component(
            "a",
            "resources/follower",
            "u:input:Real:deg",
            "y:output:Real:rad",
            "count:output:Integer",
            "rate:parameter:Real",
            bindings=bound,
        )
        + made.component("b", "resources/follower", "u:input:Real:deg", "y:output:Real:rad", "count_in:input:Integer")
        + inner
        + '<ssd:SignalDictionaryReference name="book" dictionary="words"><ssd:Connectors><ssd:Connector name="angle"'
        ' kind="inout"><ssc:Real unit="rad"/></ssd:Connector></ssd:Connectors></ssd:SignalDictionaryReference>',
        made.connection("a.y", "inner.u", '<ssc:LinearTransformation factor="2" offset="1"/>')
        + made.connection("a.y", "book.angle")
        + made.connection("book.angle", "b.u")
        + made.connection(
            "a.count",
            "b.count_in",
            '<ssc:IntegerMappingTransformation><ssc:MapEntry source="0"'
            ' target="3"/></ssc:IntegerMappingTransformation>',
        ),
        dictionaries='<ssd:SignalDictionary name="words" source="words.ssb"/>',
    )
    spaces = made.NAMESPACES
    return {
        STRUCTURE: made.structure(top, '<ssd:DefaultExperiment startTime="0" stopTime="1"/>').encode(),
        "values.ssv": made.values(Speed="Real 3").encode(),
        "names.ssm": (
            f'<ssm:ParameterMapping {spaces} version="1.0"><ssm:MappingEntry source="Speed"'
            ' target="rate"><ssc:LinearTransformation factor="3"/></ssm:MappingEntry></ssm:ParameterMapping>'.encode()
        ),
        "words.ssb": (
            f'<ssb:SignalDictionary {spaces} version="1.0"><ssb:DictionaryEntry name="angle"><ssc:Real'
            ' unit="rad"/></ssb:DictionaryEntry><ssb:Units><ssc:Unit name="rad"><ssc:BaseUnit'
            ' rad="1"/></ssc:Unit></ssb:Units></ssb:SignalDictionary>'.encode()
        ),
        "resources/follower/modelDescription.xml": followers.description(2, "Follower").encode(),
        binary: b"",
    }


@cache
def _archive() -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files().items():
            archive.writestr(name, content)
    return data.getvalue()


def make(rng: random.Random) -> bytes:
    name = rng.choice((STRUCTURE,) * 6 + ("values.ssv", "names.ssm", "words.ssb", ARCHIVE))
    if name == ARCHIVE:
        return name.encode() + b"\n" + mutate.several(rng, _archive(), (*mutate.BYTES, *archives.CHANGES), 3)
    content = files()[name]
    way = rng.random()
    if way < 0.8:
        content = xml.structure(rng, content)
    elif way < 0.9:
        content = mutate.several(rng, content, mutate.TEXTS)
    else:
        content = xml.head(rng, content)
    return name.encode() + b"\n" + content


def run(case: bytes, folder: Path) -> None:
    first, _, content = case.partition(b"\n")
    path = folder / "Case.ssp"
    if first.decode() == ARCHIVE:
        path.write_bytes(content)
    else:
        for name, whole in files().items():
            (path / name).parent.mkdir(parents=True, exist_ok=True)
            (path / name).write_bytes(content if name == first.decode() else whole)
    with System.from_ssp(path, step="1 ms") as system:
        str(system.schedule())
        system.unconnected()
        system.draw()
