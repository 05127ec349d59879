"""SSP files of this project and of other tools as systems.

Same bits, names, rates, values, units, transformations, and what is wrong with files.
"""

from __future__ import annotations

import math
import re
import warnings
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import packages as p
import pytest
from built import BuiltFmus
from foreign import messages
from same import assert_same
from systems import EVERY, experiment_system

from cosim import ComponentError, ModelExchange, Recording, SspError, SspWarning, System

VERSIONS = ("1.0", "2.0")
pytestmark = pytest.mark.filterwarnings(
    "error::cosim.SspWarning", "ignore::cosim.FmuWarning", "ignore::cosim.UnconnectedInputsWarning"
)
SSD = "SystemStructure.ssd"


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", EVERY)
def test_ours_come_back_with_the_same_bits(built_fmus: BuiltFmus, tmp_path: Path, name: str, version: str) -> None:  # noqa: ARG001
    """Every experiment's system: schedule, values, and every output of half a second."""
    with experiment_system(name) as system:
        path = system.export_ssp(tmp_path / "Case.ssp", version=version)
        system.allow_unconnected = True
        expected = system.run("1/2")
        with System.from_ssp(path) as again:
            assert str(again.schedule()) == str(system.schedule())
            assert {n: m.values for n, m in again.components.items()} == {
                n: m.values for n, m in system.components.items()
            }
            again.allow_unconnected = True
            assert_same(again.run("1/2"), expected)
            twice = again.export_ssp(tmp_path / "again" / "Case.ssp", version=version)
        assert twice.read_bytes() == path.read_bytes()


@pytest.mark.parametrize("version", VERSIONS)
def test_what_only_our_annotations_say_comes_back(follower: dict[int, Path], tmp_path: Path, version: str) -> None:
    """Offsets, kinds, groups, delays, extrapolation, factors and arrays.

    Also steps that no float is, and names that are no identifiers.
    """
    with System() as system:
        v = 2 if version == "1.0" else 3
        for name, step in (("b-1", "1/60"), ("a", "1/120")):
            system.add(name, follower[v], step=step, start={"count_in": 3})
        system.add("law", follower[v], step="1/30", offset="1/60", kind="discrete", parameters={"rate": 0.1 + 0.2})
        system.connect("a.y", "b-1.u", linear=(2.0, 0.1))
        system.connect("b-1.y", "a.u")
        system.connect("b-1.y", "law.u", delay=True)
        system.connect("law.off", "a.on")
        if v == 3:
            system.connect("a.total", "b-1.w")
            system.connect("law.total[2]", "a.w[3]")
            system["law"].set({"w": [1.0, 2.0, 3.0]})
        system.group("pair", ["b-1", "a"], extrapolate=True)
        path = system.export_ssp(tmp_path / "Odd.ssp", version=version, inputs="b-1.on")
        with System.from_ssp(path) as again:
            assert str(again.schedule()) == str(system.schedule())
            assert set(again.groups) == {"pair"}
            assert [m.name for m in again.groups["pair"].components] == ["b-1", "a"]
            assert_same(again.run(1), system.run(1))


def follow(path: Path, **options: Any) -> tuple[dict[str, Any], Recording]:
    with System.from_ssp(path, **options) as system:
        return {n: (float(m.step), dict(m.values)) for n, m in system.components.items()}, system.run("1/10")


PAIR = ("u:input:Real", "y:output:Real")


def two(
    follower: dict[int, Path],
    tmp_path: Path,
    connections: str,
    *,
    one: tuple[str, ...] = PAIR,
    other: tuple[str, ...] = PAIR,
    v: int = 2,
    bindings: str = "",
    enumerations: str = "",
) -> Path:
    """Two followers, the second fed by the first."""
    elements = p.component("one", "resources/f.fmu", *one, bindings=bindings) + p.component(
        "two", "resources/f.fmu", *other
    )
    text = p.structure(
        p.system("top", elements, connections), version="1.0" if v == 2 else "2.0", enumerations=enumerations
    )
    return p.package(tmp_path / "Two.ssp", {SSD: text, "resources/f.fmu": follower[v]})


@pytest.mark.parametrize(
    ("inner", "more", "factor", "offset"),
    [
        ("", "", 180 / math.pi, 0.0),  # y [rad] to u [deg]
        ("", 'suppressUnitConversion="true"', 1.0, 0.0),
        ('<ssc:LinearTransformation factor="2" offset="5"/>', "", 2 * 180 / math.pi, 5.0),
        ('<ssc:LinearTransformation factor="2" offset="5"/>', 'suppressUnitConversion="true"', 2.0, 5.0),
    ],
)
def test_units_and_linear_transformations(follower, tmp_path, inner, more, factor, offset):
    """Units first, as the standard says; the direction is that of the kinds of the connectors, not of start and end."""
    for ends in (("one.y", "two.u"), ("two.u", "one.y")):
        path = two(follower, tmp_path, p.connection(*ends, inner, more))
        with System.from_ssp(path) as system:
            (c,) = system.connections.values()
            assert (c.source_name, c.target_name) == ("one.y", "two.u")
            assert math.isclose(c.scale, factor)
            assert c.offset == offset


def test_booleans_and_integers_are_mapped(follower, tmp_path, raises):
    one = ("on:input:Boolean", "off:output:Boolean", "count:output:Integer", "count_in:input:Integer")
    negated = (
        '<ssc:BooleanMappingTransformation><ssc:MapEntry source="true" target="false"/><ssc:MapEntry source="false"'
        ' target="true"/></ssc:BooleanMappingTransformation>'
    )
    mapped = "".join(f'<ssc:MapEntry source="{a}" target="{b}"/>' for a, b in ((k, k * k) for k in range(100)))
    path = two(
        follower,
        tmp_path,
        one=one,
        other=one,
        connections=p.connection("one.off", "two.on", negated)
        + p.connection(
            "one.count",
            "two.count_in",
            f"<ssc:IntegerMappingTransformation>{mapped}</ssc:IntegerMappingTransformation>",
        ),
    )
    with System.from_ssp(path) as system:
        for on in (False, True):
            system["one"].set({"on": on})
            recording = system.run("1/10", record=["one.off", "two.off", "one.count", "two.count_in"])
            assert recording["one.off"][-1] == recording["two.off"][-1] == (not on)
    np.testing.assert_array_equal(recording["two.count_in"], recording["one.count"] ** 2)
    assert recording["one.count"][-1] > 10
    short = two(
        follower,
        tmp_path,
        one=one,
        other=one,
        connections=p.connection(
            "one.count",
            "two.count_in",
            '<ssc:IntegerMappingTransformation><ssc:MapEntry source="0"'
            ' target="1"/></ssc:IntegerMappingTransformation>',
        ),
    )
    with (
        System.from_ssp(short) as system,
        raises(ComponentError),
    ):
        system.run("1/10")


def test_items_of_enumerations_are_mapped_by_their_values(follower, tmp_path, raises):
    one, other = ("count:output:Enumeration:Gear",), ("count_in:input:Enumeration:Mode",)
    kinds = (
        '<ssc:Enumeration name="Gear"><ssc:Item name="low" value="0"/><ssc:Item name="high"'
        ' value="1"/></ssc:Enumeration><ssc:Enumeration name="Mode"><ssc:Item name="slow" value="7"/><ssc:Item'
        ' name="fast" value="9"/></ssc:Enumeration>'
    )
    change = (
        '<ssc:EnumerationMappingTransformation><ssc:MapEntry source="low" target="slow"/><ssc:MapEntry source="{}"'
        ' target="fast"/></ssc:EnumerationMappingTransformation>'
    )
    path = two(
        follower,
        tmp_path,
        p.connection("one.count", "two.count_in", change.format("high")),
        one=one,
        other=other,
        enumerations=kinds,
    )
    with System.from_ssp(path) as system:
        assert system["one_count_mapped"].implementation.table == {0: 7, 1: 9}
    path = two(
        follower,
        tmp_path,
        p.connection("one.count", "two.count_in", change.format("hihg")),
        one=one,
        other=other,
        enumerations=kinds,
    )
    with raises(SspError):
        System.from_ssp(path)


def test_arrays_are_connected_whole_and_by_element(follower, tmp_path):
    one = ("w:input:Float64[3]", "total:output:Float64[3]", "u:input:Float64", "y:output:Float64")
    elements = (
        p.component("one", "f.fmu", *one) + p.component("two", "f.fmu", *one) + p.component("three", "f.fmu", *one)
    )
    wires = (
        p.connection("one.total", "two.w")
        + p.connection("one.total", "three.w", more='startIndices="2" endIndices="3"')
        + p.connection("one.total", "three.u", more='startIndices="1" suppressUnitConversion="true"')
    )
    path = p.package(
        tmp_path / "A.ssp", {SSD: p.structure(p.system("top", elements, wires), version="2.0"), "f.fmu": follower[3]}
    )
    with System.from_ssp(path) as system:
        found = {n: c.source_name for n, c in system.connections.items()}
    assert found == {f"two.w[{k}]": f"one.total[{k}]" for k in (1, 2, 3)} | {
        "three.w[3]": "one.total[2]",
        "three.u": "one.total[1]",
    }


def nested(follower: dict[int, Path], tmp_path: Path) -> Path:
    """A follower in a system in a system.

    It is fed through connectors of both and by a signal dictionary of the outermost.
    """
    book = (
        f'<ssd:SignalDictionary name="bus"><ssb:SignalDictionary {p.NAMESPACES} version="1.0"><ssb:DictionaryEntry'
        ' name="angle"><ssc:Real unit="rad"/></ssb:DictionaryEntry></ssb:SignalDictionary></ssd:SignalDictionary>'
    )
    reference = (
        '<ssd:SignalDictionaryReference name="{}" dictionary="bus">'
        + p.connectors("angle:inout")
        + "</ssd:SignalDictionaryReference>"
    )
    inner = p.system(
        "in ner",
        p.component("f", "f.fmu", "u:input:Real:deg", "y:output", "rate:parameter:Real") + reference.format("there"),
        p.connection("there.angle", "f.u", '<ssc:LinearTransformation factor="3"/>')
        + p.connection("f.y", "out")
        + p.connection("speed", "f.rate", '<ssc:LinearTransformation factor="10"/>'),
        "out:output",
        "speed:parameter:Real",
        bindings=p.inline(p.values(speed="Real 0.5")),
    )
    middle = p.system(
        "sub",
        inner,
        p.connection("in ner.out", "result", '<ssc:LinearTransformation offset="1"/>'),
        "result:output:Real:deg",
    )
    top = p.system(
        "top",
        middle + p.component("source", "f.fmu", *PAIR) + p.component("sink", "f.fmu", *PAIR) + reference.format("here"),
        p.connection("source.y", "here.angle")
        + p.connection("sub.result", "sink.u", '<ssc:LinearTransformation factor="2"/>'),
        dictionaries=book,
        bindings=p.inline(p.values(**{"sub__in ner__f__u": "Real 4@rad", "nothing__here": "Real 1"})),
    )
    return p.package(
        tmp_path / "Nested.ssp",
        {SSD: p.structure(top, '<ssd:DefaultExperiment startTime="0.5" stopTime="2"/>'), "f.fmu": follower[2]},
    )


def test_nested_systems_are_flat_and_their_signals_followed(follower, tmp_path):
    with System.from_ssp(nested(follower, tmp_path)) as system:
        assert list(system.components) == ["sub.in_ner.f", "source", "sink"]
        found = {n: (c.source_name, c.scale, c.offset) for n, c in system.connections.items()}
        degrees = 180 / math.pi
        assert found["sub.in_ner.f.u"] == ("source.y", pytest.approx(3 * degrees), 0.0)
        assert found["sink.u"] == ("sub.in_ner.f.y", pytest.approx(2 * degrees), pytest.approx(2.0))
        assert system["sub.in_ner.f"].values == {"rate": 5.0, "u": pytest.approx(4 * degrees)}
        recording = system.run(1, record=["sub.in_ner.f.y"])
        assert recording.time[0] == 0.5  # as the file says
        assert system.experiment[1] == 2
        with System.from_ssp(system.export_ssp(tmp_path / "Again.ssp")) as again:
            again.experiment = system.experiment
            assert_same(again.run(1, record=["sub.in_ner.f.y"]), recording)


def test_parameters_of_all_levels_and_mapped(follower, tmp_path):
    """Outer levels count, of one level the last; names are prefixed, mapped and transformed, in units."""
    change = (
        '<ssm:MappingEntry source="one.a" target="one.rate"><ssc:LinearTransformation factor="2"'
        ' offset="1"/></ssm:MappingEntry>'
    )
    count = (
        '<ssm:MappingEntry source="one.n" target="two.count_in"><ssc:IntegerMappingTransformation><ssc:MapEntry'
        ' source="4" target="40"/></ssc:IntegerMappingTransformation></ssm:MappingEntry>'
    )
    ignored = '<ssm:MappingEntry source="absent" target="one.u"/>'
    elements = p.component(
        "one",
        "f.fmu",
        bindings=p.inline(p.values(rate="Real 9", u="Real 3@rad"))
        + p.inline(p.values(u="Real 2@rad", on="Boolean true")),
    )
    elements += p.component("two", "f.fmu", bindings='<ssd:ParameterBinding source="two.ssv"/>')
    bindings = p.inline(
        p.values(a="Real 3", n="Integer 4", u="Real 1"), p.mapping(change, count, ignored), 'prefix="one."'
    )
    text = p.structure(p.system("top", elements, bindings=bindings))
    path = p.package(tmp_path / "P.ssp", {SSD: text, "f.fmu": follower[2], "two.ssv": p.values(rate="Real 1e-3")})
    components, _ = follow(path)
    assert components["one"][1] == {"rate": 7.0, "u": pytest.approx(2 * 180 / math.pi), "on": True}
    assert components["two"][1] == {"rate": 1e-3, "count_in": 40}


def test_steps_are_those_that_the_file_says_or_the_user(follower, tmp_path, raises):
    master = (
        '<ssd:Annotations><ssc:Annotation type="org.openmodelica"><oms:SimulationInformation'
        ' xmlns:oms="https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"><oms:FixedStepMaster'
        ' description="oms-ma"'
        ' stepSize="0.004"/></oms:SimulationInformation></ssc:Annotation></ssd:Annotations></ssd:System>'
    )
    osp = (
        '<ssd:DefaultExperiment><ssd:Annotations><ssc:Annotation type="com.opensimulationplatform"><osp:Algorithm'
        f" {p.OSP}><osp:FixedStepAlgorithm"
        ' baseStepSize="0.005"/></osp:Algorithm></ssc:Annotation></ssd:Annotations></ssd:DefaultExperiment>'
    )
    elements = p.component("hint", "f.fmu") + p.component("none", "f.fmu", step="")
    plain = p.system("top", elements)

    def steps(text: str, **options: Any) -> list[float]:
        components, _ = follow(p.package(tmp_path / "S.ssp", {SSD: text, "f.fmu": follower[2]}), **options)
        return [step for step, _ in components.values()]

    assert steps(p.structure(plain, osp)) == [0.002, 0.005]
    assert steps(p.structure(plain.replace("</ssd:System>", master), osp)) == [0.002, 0.004]
    with raises(SspError):
        steps(p.structure(plain))
    assert steps(p.structure(plain), step="1 ms") == [0.002, 0.001]
    assert steps(p.structure(plain), step={"*": "3 ms", "hint": "4 ms"}) == [0.004, 0.003]
    with pytest.raises(SspError, match=r"no component 'nobody'"):
        steps(p.structure(plain), step={"*": "3 ms", "nobody": "4 ms"})


def test_variants_are_chosen_by_name(follower, tmp_path, raises):
    files: dict[str, Any] = {
        f"{n}.ssd": p.structure(p.system("top", p.component(c, "f.fmu")), name=f"The {c}")
        for n, c in (("SystemStructure", "first"), ("Other", "second"))
    }
    path = p.package(tmp_path / "V.ssp", {**files, "f.fmu": follower[2]})
    for variant, component in (
        (None, "first"),
        ("Other", "second"),
        ("Other.ssd", "second"),
        ("The second", "second"),
        ("The first", "first"),
    ):
        assert list(follow(path, variant=variant)[0]) == [component]
    with raises(SspError):
        System.from_ssp(path, variant="Othr")


def test_packages_and_descriptions_in_packages(follower, tmp_path):
    """An SSP as a component of another one, twice a description of the same one, and a system by its id."""
    inner = p.package(
        tmp_path / "Inner.ssp",
        {
            SSD: p.structure(p.system("in", p.component("f", "f.fmu", *PAIR), p.connection("f.y", "y"), "y:output")),
            "f.fmu": follower[2],
        },
    )
    part = p.structure(p.system("part", p.component("g", "../f.fmu", *PAIR), p.connection("u", "g.u"), "u:input"))
    packed, described = 'type="application/x-ssp-package"', 'type="application/x-ssp-definition"'
    elements = p.component("whole", "resources/Inner.ssp", more=packed) + "".join(
        p.component(n, "parts/part.ssd", more=described, step="") for n in ("a", "b")
    )
    elements += p.system("original", p.component("h", "f.fmu", *PAIR), more='id="it"') + p.component(
        "copy", "#it", more=described, step=""
    )
    text = p.structure(p.system("top", elements, p.connection("whole.y", "a.u") + p.connection("whole.y", "b.u")))
    path = p.package(
        tmp_path / "Outer.ssp", {SSD: text, "f.fmu": follower[2], "resources/Inner.ssp": inner, "parts/part.ssd": part}
    )
    with System.from_ssp(path) as system:
        assert list(system.components) == ["whole.f", "a.g", "b.g", "original.h", "copy.h"]
        assert {n: c.source_name for n, c in system.connections.items()} == {"a.g.u": "whole.f.y", "b.g.u": "whole.f.y"}
        room = Path(system._room.name)  # type: ignore[union-attr]
        assert room.is_dir()
    assert not room.exists()


def test_a_folder_is_read_too(follower, tmp_path):
    path = two(follower, tmp_path, p.connection("one.y", "two.u"))
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path / "unpacked")
    assert_same(follow(tmp_path / "unpacked")[1], follow(path)[1])


# -------------------------------------------------------------------------------------------------- what is wrong


def broken(follower: dict[int, Path]) -> dict[str, dict[str, Any]]:
    """Files that a reader refuses."""
    fmu = follower[2]
    one, wire = p.component("one", "f.fmu", *PAIR), p.connection
    two = one + p.component("two", "f.fmu", *PAIR)
    described = 'type="application/x-ssp-definition"'

    def of(top: str, **more: Any) -> dict[str, Any]:
        return {SSD: p.structure(top), "f.fmu": fmu, **more}

    def wired(inner: str) -> dict[str, Any]:
        return of(p.system("top", two, inner))

    deep = (
        "".join(f'<ssd:System name="s{k}"><ssd:Elements>' for k in range(30))
        + one
        + "</ssd:Elements></ssd:System>" * 30
    )
    return {
        "nothing": {"readme.txt": "hello"},
        "not xml": {SSD: "hello"},
        "another element": {
            SSD: f'<ssv:ParameterSet {p.NAMESPACES} version="1.0" name="x"><ssv:Parameters/></ssv:ParameterSet>'
        },
        "bomb": {SSD: '<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><x>&b;</x>'},
        "no component": of(p.system("top", "").replace("<ssd:Elements></ssd:Elements>", "")),
        "missing fmu": of(p.system("top", p.component("one", "F.fmu"))),
        "outside": of(p.system("top", p.component("one", "../../f.fmu"))),
        "outside, encoded": of(p.system("top", p.component("one", "%2e%2e/%2e%2e/f.fmu"))),
        "absolute": of(p.system("top", p.component("one", "/etc/passwd"))),
        "elsewhere": of(p.system("top", p.component("one", "http://example.com/f.fmu"))),
        "local file": of(p.system("top", p.component("one", "file:///etc/passwd"))),
        "archive leads out": {SSD: p.structure(p.system("top", one)), "../f.fmu": fmu},
        "no fmu": of(p.system("top", p.component("one", "f.txt")), **{"f.txt": "hello"}),
        "no source": of(p.system("top", '<ssd:Component name="one"/>')),
        "other type": of(p.system("top", p.component("one", "f.fmu", more='type="application/x-modelica"'))),
        "model exchange": of(p.system("top", p.component("one", "f.fmu", more='implementation="ModelExchange"'))),
        "twice": of(p.system("top", one + one)),
        "connector twice": of(p.system("top", p.component("one", "f.fmu", *PAIR, "u:input"))),
        "same after patterns": of(p.system("top", p.component("a*", "f.fmu") + p.component("a_", "f.fmu"))),
        "same after blanks": of(p.system("top", p.component("a b", "f.fmu") + p.component("a_b", "f.fmu"))),
        "unknown element": wired(wire("on.y", "two.u")),
        "unknown connector": wired(wire("one.yy", "two.u")),
        "connector without variable": of(
            p.system("top", two.replace('name="y"', 'name="why"'), wire("one.why", "two.u"))
        ),
        "two outputs": wired(wire("one.y", "two.y")),
        "two inputs": wired(wire("one.u", "two.u")),
        "driven twice": wired(wire("one.y", "two.u") + wire("two.y", "two.u")),
        "wrong kind": of(
            p.system(
                "top",
                two.replace('name="u" kind="input"', 'name="u" kind="output"').replace(
                    'name="y" kind="output"', 'name="y" kind="input"'
                ),
                wire("one.u", "two.y"),
            )
        ),
        "wrong type": of(
            p.system(
                "top",
                p.component("one", "f.fmu", *PAIR) + p.component("two", "f.fmu", "on:input:Boolean"),
                wire("one.y", "two.on"),
            )
        ),
        "units that differ": of(
            p.system(
                "top",
                p.component("one", "f.fmu", *PAIR)
                + p.system("sub", p.component("two", "f.fmu", *PAIR), wire("m", "two.u"), "m:input:Real:kg"),
                wire("one.y", "sub.m"),
            )
        ),
        "unknown unit": of(p.system("top", p.component("one", "f.fmu", "u:input:Real:furlong"))),
        "unknown transformation": wired(wire("one.y", "two.u", '<ssc:CubicTransformation factor="2"/>')),
        "no number": wired(wire("one.y", "two.u", '<ssc:LinearTransformation factor="much"/>')),
        "infinite": wired(wire("one.y", "two.u", '<ssc:LinearTransformation factor="INF"/>')),
        "half a mapping": wired(
            wire(
                "one.y",
                "two.u",
                '<ssc:BooleanMappingTransformation><ssc:MapEntry source="true"'
                ' target="true"/></ssc:BooleanMappingTransformation>',
            )
        ),
        "table of reals": wired(
            wire(
                "one.y",
                "two.u",
                '<ssc:IntegerMappingTransformation><ssc:MapEntry source="1"'
                ' target="2"/></ssc:IntegerMappingTransformation>',
                'suppressUnitConversion="true"',
            )
        ),
        "mapped twice": wired(
            wire(
                "one.y",
                "two.u",
                '<ssc:IntegerMappingTransformation><ssc:MapEntry source="1" target="2"/><ssc:MapEntry source="1"'
                ' target="3"/></ssc:IntegerMappingTransformation>',
            )
        ),
        "calculated parameter": of(
            p.system(
                "top",
                p.component("one", "f.fmu", "y:calculatedParameter") + p.component("two", "f.fmu", "rate:parameter"),
                wire("one.y", "two.rate"),
            )
        ),
        "in a circle": of(
            p.system(
                "top",
                p.system("s", one, wire("a", "b") + wire("a", "one.u"), "a:input", "b:output"),
                wire("s.b", "s.a"),
            )
        ),
        "in itself": of(p.system("top", p.component("again", SSD, more=described))),
        "in itself by two": of(
            p.system("top", p.component("b", "b.ssd", more=described)),
            **{"b.ssd": p.structure(p.system("b", p.component("a", SSD, more=described)))},
        ),
        "in itself by id": of(p.system("top", p.component("a", "#me", more=described), more='id="me"')),
        "no such id": of(p.system("top", p.component("a", "#you", more=described))),
        "too deep": of(p.system("top", deep)),
        "too many": of(
            p.system("top", p.component("a", "1.ssd", more=described)),
            **{
                f"{k}.ssd": p.structure(
                    p.system(
                        "s",
                        "".join(
                            p.component(f"c{i}", f"{k + 1}.ssd" if k < 6 else "f.fmu", more=described if k < 6 else "")
                            for i in range(8)
                        ),
                    )
                )
                for k in range(1, 7)
            },
        ),
        "no dictionary": of(
            p.system(
                "top",
                one
                + '<ssd:SignalDictionaryReference name="r" dictionary="d">'
                + p.connectors("x:inout")
                + "</ssd:SignalDictionaryReference>",
                wire("one.y", "r.x"),
            )
        ),
        "missing parameters": of(
            p.system("top", p.component("one", "f.fmu", bindings='<ssd:ParameterBinding source="p.ssv"/>'))
        ),
        "not parameters": of(
            p.system("top", p.component("one", "f.fmu", bindings='<ssd:ParameterBinding source="p.ssv"/>')),
            **{"p.ssv": p.structure(p.system("top", one))},
        ),
        "text for a number": of(
            p.system("top", p.component("one", "f.fmu", bindings=p.inline(p.values(rate="String fast"))))
        ),
        "unit of a parameter": of(
            p.system("top", p.component("one", "f.fmu", bindings=p.inline(p.values(u="Real 1@kg"))))
        ),
        "value of an output": of(p.system("top", p.component("one", "f.fmu", bindings=p.inline(p.values(y="Real 1"))))),
        "half a whole number": of(
            p.system("top", p.component("one", "f.fmu", bindings=p.inline(p.values(count_in="Real 1.5"))))
        ),
        "several values": of(
            p.system("top", p.component("one", "f.fmu", bindings=p.inline(p.values("2.0", rate="Real 1 2"))))
        ),
        "parameter twice": of(
            p.system(
                "top",
                p.component(
                    "one",
                    "f.fmu",
                    bindings=p.inline(
                        p.values(rate="Real 1").replace(
                            "</ssv:Parameters>",
                            '<ssv:Parameter name="rate"><ssv:Real value="2"/></ssv:Parameter></ssv:Parameters>',
                        )
                    ),
                ),
            )
        ),
        "step of zero": of(p.system("top", p.component("one", "f.fmu", step=p.STEP.replace("0.002", "0")))),
        "step of words": of(p.system("top", p.component("one", "f.fmu", step=p.STEP.replace("0.002", "soon")))),
    }


NAMES = sorted(broken({2: Path()}))


@pytest.mark.parametrize("name", NAMES)
def test_what_is_wrong_is_said_in_a_sentence(follower: dict[int, Path], tmp_path: Path, name: str, raises) -> None:
    path = p.package(tmp_path / "Bad.ssp", broken(follower)[name])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SspWarning)
        with raises(SspError) as error:
            System.from_ssp(path)
    assert "\n" not in str(error.value)
    assert "Bad.ssp" in str(error.value)
    assert "cosim-ssp-" not in str(error.value)  # the folder where it was unpacked is nobody's business


def test_files_that_are_no_archives(tmp_path, raises):
    for content in (
        b"",
        b"PK\x03\x04 cut",
    ):
        (tmp_path / "x.ssp").write_bytes(content)
        with raises(SspError):
            System.from_ssp(tmp_path / "x.ssp")
    with raises(SspError):
        System.from_ssp(tmp_path / "y.ssp")
    with warnings.catch_warnings(), zipfile.ZipFile(tmp_path / "twice.ssp", "w") as archive:
        warnings.simplefilter("ignore")
        for _ in range(2):
            archive.writestr(SSD, p.structure(p.system("top", "")))
    with raises(SspError):
        System.from_ssp(tmp_path / "twice.ssp")


def test_deviations_from_the_standard_are_warned_of(follower, tmp_path):
    text = p.structure(p.system("top", p.component("one", "f.fmu"))).replace(
        'version="1.0" name="Foreign"', 'name="Foreign" colour="red" version="1.0"'
    )
    path = p.package(tmp_path / "D.ssp", {SSD: text, "f.fmu": follower[2]})
    with pytest.warns(SspWarning, match=r"SystemStructure\.ssd deviates from SSP 1\.0: line 1: .*colour"):
        System.from_ssp(path).close()


@pytest.mark.parametrize(
    ("unit", "value"),
    [
        ("", 90.0),
        ("[-]", 90.0),
        ("[rad]", math.degrees(90.0)),
        ("rad", math.degrees(90.0)),
    ],
)
def test_units_that_tools_write_though_the_file_does_not_define_them(follower, tmp_path, unit, value, warns):
    """Published files of two tools have `unit=""` and `unit="[m]"`.

    One warning for each text, of connectors and of parameters.
    """
    bound = p.inline(p.values(u="Real 90@deg").replace('unit="deg"', f'unit="{unit}"'))
    text = p.structure(
        p.system("top", p.component("one", "f.fmu", "u:input:Real:deg", "y:output:Real:rad", bindings=bound))
    )
    text = text.replace('unit="rad"', f'unit="{unit}"').replace(
        p.UNITS, p.UNITS.replace('<ssc:Unit name="rad"><ssc:BaseUnit rad="1"/></ssc:Unit>', "")
    )
    path = p.package(tmp_path / "U.ssp", {SSD: text, "f.fmu": follower[2]})
    with warns(SspWarning, match=re.escape(repr(unit))) as told:
        system = System.from_ssp(path)
    assert len([w for w in told if "among the Units" in str(w.message)]) == 1
    assert system["one"].values["u"] == pytest.approx(value)
    system.close()


def test_texts_and_bytes_are_connected(tmp_path: Path) -> None:
    """`a` writes a text and bytes, and `b` shows both a step later, as in the system put together in Python."""
    fmu = messages.build(tmp_path, 3)
    ends = ("text:output:String", "data:output:Binary"), ("text_in:input:String", "data_in:input:Binary")
    components = [p.component(name, fmu.name, *own) for name, own in zip("ab", ends, strict=True)]
    wires = p.connection("a.text", "b.text_in") + p.connection("a.data", "b.data_in")
    files = {SSD: p.structure(p.system("top", "".join(components), wires), version="2.0"), fmu.name: fmu}
    shown = []
    with System(allow_unconnected=True) as direct:
        for name in "ab":
            direct.add(name, fmu, step="2 ms")
        for variable in ("text", "data"):
            direct.connect(f"a.{variable}", f"b.{variable}_in")
        with System.from_ssp(p.package(tmp_path / "Texts.ssp", files)) as read:
            for system in (direct, read):
                system["a"].set(source=1, length=5)
                with system.initialize(record=[]) as simulation:
                    simulation.advance("0.006")
                    shown.append([simulation.text(f"b.{v}") for v in ("text", "data")])
    assert shown[0] == shown[1]
    assert all(shown[0])


def test_a_component_is_integrated_where_the_file_says_so(built_fmus: BuiltFmus, tmp_path: Path) -> None:
    """The same numbers as with interface="me" in Python, which are others than those of Co-Simulation."""
    fmu = built_fmus.path("QuarterCarBench", 2)
    parts = p.component("car", fmu.name, "body.z:output:Real", more='implementation="ModelExchange"')
    path = p.package(tmp_path / "Me.ssp", {SSD: p.structure(p.system("top", parts)), fmu.name: fmu})
    found = {}
    for interface in ("cs", "me"):
        with System(allow_unconnected=True) as system:
            system.add("car", fmu, step="2 ms", interface=interface, start={"body.z": 0.01})
            found[interface] = system.run(0.5, record=["car.body.z"])["car.body.z"]
    with System.from_ssp(path) as system:
        system["car"].set(**{"body.z": 0.01})
        again = system.run(0.5, record=["car.body.z"])["car.body.z"]
    assert np.array_equal(again, found["me"])
    assert not np.array_equal(again, found["cs"])


def test_the_options_of_an_integrator_travel(built_fmus: BuiltFmus, tmp_path: Path) -> None:
    how, path = ModelExchange(tolerance=1e-3, solver="implicit"), tmp_path / "Me.ssp"
    with System(allow_unconnected=True) as system:
        system.add("car", built_fmus.path("QuarterCarBench", 2), step="2 ms", interface=how, start={"body.z": 0.01})
        found = system.run(0.5, record=["car.body.z"])["car.body.z"]
        system.export_ssp(path)
    with System.from_ssp(path) as system:
        system.allow_unconnected = True
        assert np.array_equal(system.run(0.5, record=["car.body.z"])["car.body.z"], found)
    text = zipfile.ZipFile(path).read(SSD).decode()
    for before, after, said in (
        ('"0.001"', '"small"', "tolerance .*small"),
        ('"implicit"', '"best"', "no solver 'best'"),
    ):
        wrong = p.package(tmp_path / "Wrong.ssp", {SSD: text.replace(before, after), **_resources(path)})
        with pytest.raises(SspError, match=f"component 'car': .*{said}"):
            System.from_ssp(wrong)


def _resources(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {n: archive.read(n) for n in archive.namelist() if n.startswith("resources/")}
