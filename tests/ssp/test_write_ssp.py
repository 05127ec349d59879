"""Systems as SSP: what is in the files, what others read in them, what cannot travel."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from built import FMUS, BuiltFmus
from fmpy.ssp.ssd import read_ssd
from lxml import etree
from pyssp_standard.ssd import SSD
from pyssp_standard.ssv import SSV
from systems import EVERY, experiment_system

from cosim import CosimError, PythonComponent, System, WiringError
from cosim.ssp.names import ENTRY, OMS, OSP
from cosim.ssp.names import SSC as C
from cosim.ssp.names import SSD as D
from cosim.ssp.names import SSV as V

VERSIONS = ("1.0", "2.0")


def structure(path: Path) -> Any:
    with zipfile.ZipFile(path) as archive:
        return etree.fromstring(archive.read(ENTRY))


def values(path: Path, component: str) -> dict[str, str]:
    with zipfile.ZipFile(path) as archive:
        root = etree.fromstring(archive.read(f"resources/{component}.ssv"))
    return {p.get("name"): p[0].get("value") for p in root.iter(f"{V}Parameter")}


OMSIMULATOR_KNOWS = {
    "SystemStructureDescription": {"System", "Units", "Enumerations", "DefaultExperiment"},
    "System": {
        "Connectors",
        "ElementGeometry",
        "SystemGeometry",
        "ParameterBindings",
        "Elements",
        "Connections",
        "Annotations",
    },
    "Component": {"Connectors", "ElementGeometry", "ParameterBindings"},
}


def refused_by_omsimulator(path: Path) -> list[str]:
    """Elements for which OMSimulator refuses a file (ComponentFMUCS.cpp, System.cpp, Model.cpp).

    It compares names with their prefixes and ends at one that it does not know. Of annotations it looks at the first
    one only.
    """
    root, found = structure(path), []
    for parent, known in OMSIMULATOR_KNOWS.items():
        for element in root.iter(f"{D}{parent}"):
            tags = [f"{e.prefix}:{etree.QName(e).localname}" for e in element]
            found += [f"{t} in a {parent}" for t in tags if t not in {f"ssd:{k}" for k in known}]
    found += [
        f"a system without {OMS}"
        for s in root.iter(f"{D}System")
        if s.find(f"{D}Annotations")[0].get("type") != "org.openmodelica"
    ]
    return found


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", EVERY)
def test_every_experiment_is_a_file_that_judges_accept(
    built_fmus: BuiltFmus,  # noqa: ARG001
    tmp_path: Path,
    name: str,
    version: str,
) -> None:
    """By the schemas of pyssp_standard, and those of FMPy for SSP 1.0.

    With every FMU in the version of FMI that belongs to it.
    """
    with experiment_system(name) as system:
        path = system.export_ssp(tmp_path / "Case.ssp", version=version)
        components = set(system.components)
        connections = len(system.connections)
        held = {m for m in system.components if system[m].values}
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    with SSD(tmp_path / ENTRY) as judged:
        assert judged.version == version
        judged.__check_compliance__()
    sets = list(tmp_path.glob("resources/*.ssv"))
    assert held <= {s.stem for s in sets}
    for file in sets:
        with SSV(file) as judged:
            judged.__check_compliance__()
    if version == "1.0":
        read = read_ssd(str(path))
        assert {c.name for c in read.system.elements} == components
        assert len(read.system.connections) == connections
    assert refused_by_omsimulator(path) == []
    with zipfile.ZipFile(path) as archive:
        for fmu in (n for n in archive.namelist() if n.endswith(".fmu")):
            with zipfile.ZipFile(archive.open(fmu)) as inner:
                about = etree.fromstring(inner.read("modelDescription.xml"))
            assert about.get("fmiVersion") == {"1.0": "2.0", "2.0": "3.0"}[version]


@pytest.mark.parametrize("version", VERSIONS)
def test_the_same_system_gives_the_same_bytes(built_fmus: BuiltFmus, tmp_path: Path, version: str) -> None:  # noqa: ARG001
    made = []
    for k in range(2):
        with experiment_system("bench") as system:
            made.append(system.export_ssp(tmp_path / f"{k}" / "Bench.ssp", version=version).read_bytes())
    assert made[0] == made[1]


@pytest.fixture
def pair(built_fmus: BuiltFmus) -> Any:
    """A quarter car that one FMU shakes: the force has a value before the first step, and two parameters are set."""
    with System() as system:
        system.add(
            "speed", built_fmus.path("SpeedProfile", 3), step="2 ms", offset="1 ms", parameters={"start.speed": 0.5}
        )
        system.add("car", built_fmus.path("QuarterCarHmmwv", 3), step="1 ms", start={"road.height": 0.01})
        system.connect("speed.x", "car.road.height", delay=True)
        yield system


def test_what_others_read_of_rates_and_values(pair: System, tmp_path: Path) -> None:
    """Hints of the Open Simulation Platform and of OMSimulator, types and units of connectors, start values, places."""
    path = pair.export_ssp(tmp_path / "My pair.ssp", inputs="car.force", stop_time=3)
    root = structure(path)
    assert root.find(f"{D}System").get("name") == "My_pair"
    hints = {c.get("name"): [h.get("value") for h in c.iter(f"{OSP}StepSizeHint")] for c in root.iter(f"{D}Component")}
    assert hints == {"car": [], "speed": ["0.002"]}  # only what the base step and the FMU's own sample time do not say
    assert root.find(f".//{OSP}FixedStepAlgorithm").get("baseStepSize") == "0.001"
    assert root.find(f".//{OMS}FixedStepMaster").get("stepSize") == "0.001"
    experiment = root.find(f"{D}DefaultExperiment")
    assert (experiment.get("startTime"), experiment.get("stopTime")) == ("0.0", "3.0")
    car = root.find(f".//{D}Component[@name='car']")
    connectors = {c.get("name"): (c.get("kind"), c.find(f"{C}Real").get("unit")) for c in car.iter(f"{D}Connector")}
    assert connectors["road.height"] == ("input", "m")
    assert connectors["force"] == ("input", "N")  # of the system now
    assert connectors["body.az"] == ("output", "m/s2")
    units = {u.get("name"): dict(u[0].attrib) for u in root.iter(f"{C}Unit")}
    assert units["N"] == {"kg": "1", "m": "1", "s": "-2"}
    assert values(path, "speed")["start.speed"] == "0.5"
    assert values(path, "car") == {"road.height": "0.01"}
    boxes = [
        [float(c.find(f"{D}ElementGeometry").get(k)) for k in ("x1", "y1", "x2", "y2")]
        for c in root.iter(f"{D}Component")
    ]
    assert all(x1 < x2 and y1 < y2 for x1, y1, x2, y2 in boxes)
    right, left = sorted(boxes, reverse=True)
    assert left[2] < right[0]  # the source stands left of what it feeds


def test_connected_inputs_start_with_what_they_show(built_fmus: BuiltFmus, tmp_path: Path) -> None:
    """For readers that step before they exchange."""
    with System() as system:
        system.add("speed", built_fmus.path("SpeedProfile", 3), parameters={"start.speed": 20.0})
        system.add("car", built_fmus.path("FullCarHmmwv", 3))
        system.connect("speed.speed", "car.target.speed")
        path = system.export_ssp(tmp_path / "Pair.ssp")
    assert values(path, "car") == {"target.speed": "20.0"}


class Wave(PythonComponent):
    outputs = ("y [m]",)
    default_step = "1 ms"


def test_what_cannot_travel_is_refused_by_name(pair: System, follower: dict[int, Path], tmp_path: Path, raises) -> None:
    def refused(error: type[Exception] = CosimError, **options: Any) -> None:
        with raises(error):
            pair.export_ssp(tmp_path / "X.ssp", **options)
        assert not (tmp_path / "X.ssp").exists()

    refused(version="3.0")
    refused(WiringError, inputs="car.nothing")
    refused(WiringError, inputs="car.road.height")
    with raises(CosimError):
        pair.export_ssp(tmp_path / "X.zip")
    pair.isolate("car")
    refused()
    pair["car"].implementation.isolation = None  # type: ignore[attr-defined]
    pair.add("wave", Wave())
    refused()
    with System() as system:
        system.add("only3", follower[3], step="1 ms")
        with raises(CosimError):
            system.export_ssp(tmp_path / "X.ssp")
        system.add("only2", follower[2], step="1 ms")
        root = structure(system.export_ssp(tmp_path / "Mixed.ssp", version="2.0"))  # SSP 2.0 takes either
    types = {
        c.get("name"): {e.tag.split("}")[1] for e in c.iter() if e.getparent().tag == f"{D}Connector"}
        for c in root.iter(f"{D}Component")
    }
    assert "Real" in types["only2"]
    assert {"Float64", "Int64", "Boolean"} <= types["only3"]


def test_fmus_are_in_it_as_they_are(built_fmus: BuiltFmus, tmp_path: Path) -> None:
    """Two members of one file share it, files of one name do not."""
    own = tmp_path / "elsewhere" / "QuarterCarHmmwv.fmu"
    own.parent.mkdir()
    own.write_bytes(built_fmus.path("QuarterCarBench", 3).read_bytes())
    with System() as system:
        for name, fmu in (("a", "QuarterCarHmmwv"), ("b", "QuarterCarHmmwv")):
            system.add(name, built_fmus.path(fmu, 3))
        system.add("c", own)
        path = system.export_ssp(tmp_path / "Three.ssp", version="2.0")
    sources = {c.get("name"): c.get("source") for c in structure(path).iter(f"{D}Component")}
    assert sources["a"] == sources["b"] != sources["c"]
    with zipfile.ZipFile(path) as archive:
        assert archive.read(sources["a"]) == (FMUS / "fmi3" / "QuarterCarHmmwv.fmu").read_bytes()
        assert archive.read(sources["c"]) == own.read_bytes()
        assert np.unique([i.date_time for i in archive.infolist()], axis=0).tolist() == [[1980, 1, 1, 0, 0, 0]]
