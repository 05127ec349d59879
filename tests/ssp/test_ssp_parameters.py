"""Calculated parameters and bytes in SSP files: written and read again, and as other tools write them."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import packages as p
import pytest
from foreign import calculating, making, messages
from lxml import etree
from same import assert_same

from cosim import SspError, System
from cosim.ssp.names import ENTRY
from cosim.ssp.names import SSD as D

pytestmark = pytest.mark.filterwarnings("error::cosim.SspWarning", "ignore::cosim.FmuWarning")


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    folder = tmp_path_factory.mktemp("calculating")
    return {version: calculating.build(folder, version) for version in (2, 3)}


def wires(path: Path) -> list[tuple[str | None, ...]]:
    """Both ends of each connection, with their kinds."""
    with zipfile.ZipFile(path) as archive:
        root = etree.fromstring(archive.read(ENTRY))
    kinds = {(c.getparent().getparent().get("name"), c.get("name")): c.get("kind") for c in root.iter(f"{D}Connector")}
    found = []
    for c in root.iter(f"{D}Connection"):
        ends = [(c.get(f"{w}Element"), c.get(f"{w}Connector")) for w in ("start", "end")]
        found.append(tuple(x for end in ends for x in (*end, kinds[end])))
    return found


@pytest.mark.parametrize("version", ["1.0", "2.0"])
def test_calculated_parameters_are_written_and_come_back(fmus: dict[int, Path], tmp_path: Path, version: str) -> None:
    """With their units, and in SSP 2.0 as arrays, texts and bytes."""
    with System() as system:
        for name in ("b", "a"):
            system.add(name, fmus[2 if version == "1.0" else 3], step="1 ms")
        system["b"].set(p=4.0, factor=3.0)
        system.connect("b.scaled", "a.p")
        system.connect("b.next", "a.n", linear=(2.0, 1.0))
        if version == "2.0":
            system["b"].set(name="you", key=b"\x00\xff\x00")
            system["a"].set(q=[0.0, 3.0])
            for ends in ("b.sums[2] -> a.q[1]", "b.greeting -> a.name", "b.lock -> a.key"):
                system.connect(*ends.split(" -> "))
        path = system.export_ssp(tmp_path / "Pair.ssp", version=version)
        expected = system.run(0.002)
        with System.from_ssp(path) as again:
            assert str(again.schedule()) == str(system.schedule())
            assert {n: m.values for n, m in again.components.items()} == {
                n: m.values for n, m in system.components.items()
            }
            assert_same(again.run(0.002), expected)
    assert ("b", "scaled", "calculatedParameter", "a", "p", "parameter") in wires(path)


def test_texts_and_bytes_are_written_and_come_back(tmp_path: Path) -> None:
    """Connections with the bytes that they may have at most, and a start value with zeros in it."""
    fmu = messages.build(tmp_path, 3)
    with System(allow_unconnected=True) as system:
        for name in "ab":
            system.add(name, fmu, step="2 ms")
        system["a"].set(source=1, length=5, data_in=b"\x00\x10\x00")
        system.connect("a.text", "b.text_in", max_size=70)
        system.connect("a.data", "b.data_in", max_size=8, delay=True)
        system.connect("a.whole", "b.whole_in")
        path = system.export_ssp(tmp_path / "Texts.ssp", version="2.0")
        expected = system.run(0.01)
        with System.from_ssp(path) as again:
            again.allow_unconnected = True
            assert {n: c.size for n, c in again.connections.items()} == {
                n: c.size for n, c in system.connections.items()
            }
            assert again["a"].values == system["a"].values
            assert_same(again.run(0.01), expected)


def foreign(
    fmu: Path, path: Path, *, kind: str = "Binary", value: str = "00fF10", wire: str = "b.scaled -> a.p"
) -> Path:
    """A file with `key` of `b` as bytes, and calculated parameters that leave a system and enter one."""
    bound = p.inline(p.values("2.0", key=f"{kind} {value}"))
    inner = p.component("b", fmu.name, "scaled:calculatedParameter:Float64", "y:output:Float64", bindings=bound)
    system = p.system("s", inner, p.connection("b.scaled", "out"), "out:calculatedParameter:Float64")
    start, end = wire.replace("b.scaled", "s.out").split(" -> ")
    outer = p.component("a", fmu.name, "p:parameter:Float64", "key:parameter:Binary", "y:output:Float64")
    top = p.system("top", system + outer, p.connection(end, start))  # information flows by kinds, not by start and end
    return p.package(path, {ENTRY: p.structure(top, version="2.0"), fmu.name: fmu})


def test_files_of_others_with_nested_systems_and_bytes(fmus: dict[int, Path], tmp_path: Path) -> None:
    with System.from_ssp(foreign(fmus[3], tmp_path / "F.ssp")) as system:
        assert system["s.b"].values == {"key": b"\x00\xff\x10"}
        assert [str(c) for c in system.schedule().parameters] == ["s.b.scaled -> a.p (g to kg)"]
        found = system.run(0.002, record=["*.y", "s.b.seen"])
    assert found["a.y"][-1] == pytest.approx(3000.002, abs=1e-9)
    assert found["s.b.seen"][-1] == 2.0 * 255 + 16


@pytest.mark.parametrize(
    "wrong",
    [
        {"value": "0f1"},
        {"value": "hello"},
        {"kind": "String"},
        {"wire": "b.scaled -> a.key"},
    ],
)
def test_bytes_and_parameters_that_do_not_fit(
    fmus: dict[int, Path], tmp_path: Path, wrong: dict[str, Any], raises
) -> None:
    path = foreign(fmus[3], tmp_path / "F.ssp", **wrong)
    with raises(SspError):
        System.from_ssp(path)


def test_enumerations_are_written_by_their_items(fmus: dict[int, Path], tmp_path: Path) -> None:
    gear = b'<TypeDefinitions><SimpleType name="Gear"><Enumeration><Item name="low" value="3"/>'
    gear += b'<Item name="high" value="5"/></Enumeration></SimpleType></TypeDefinitions><ModelVariables>'
    fmu = making.redescribed(
        fmus[2],
        tmp_path / "Geared.fmu",
        (b"<ModelVariables>", gear),
        (b'<Integer start="3" />', b'<Enumeration declaredType="Gear" start="3"/>'),
    )
    with System() as system:
        system.add("b", fmu, step="1 ms", parameters={"n": 5})
        path = system.export_ssp(tmp_path / "Geared.ssp")
        with System.from_ssp(path) as again:
            assert again["b"].values == {"n": 5}
            assert_same(again.run(0.002), system.run(0.002))
    with zipfile.ZipFile(path) as archive:
        assert b'<ssv:Enumeration value="high"/>' in archive.read("resources/b.ssv")
