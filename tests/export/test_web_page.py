"""A system as a web page: one file that needs nothing else, what its script is told, and what it refuses."""

from __future__ import annotations

import base64
import gzip
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from built import FMUS, BuiltFmus
from web_host import TYPES, WebHost

from cosim import CosimError, Record, System, WiringError
from cosim.experiments.live_pages import shown as shown_experiments
from cosim.experiments.live_pages import write_pages
from cosim.experiments.metrics.crossing import LIMITS
from cosim.experiments.trench import EXPERIMENT as TRENCH
from cosim.experiments.trench.web import live
from cosim.export.web import page as page_module
from cosim.export.web.module import Module
from cosim.export.web.page import Control, Drive, Finish, Measure, PageSystem, WebPage, export_web
from cosim.scenes import infer_scene
from cosim.scenes.scene import Value
from cosim.study import FmuSet, Runner
from cosim.study.case import CaseError
from cosim.study.web import _changed

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")


def bench(built_fmus: BuiltFmus, law: str) -> System:
    system = System()
    for name, fmu, more in (
        ("speed", "SpeedProfile", {}),
        ("road", "RoadHoleBump", {}),
        ("car", "QuarterCarHmmwv", {"step": "1 ms"}),
    ):
        system.add(name, built_fmus.path(fmu, 3), **more)
    system.connect("speed.x", "road.x")
    system.connect("speed.speed", "road.speed")
    system.connect("road.road.fl.height", "car.road.height")
    system.connect("road.road.fl.rate", "car.road.rate")
    if law:
        system.add("law", built_fmus.path(law, 3))
    return system


@pytest.fixture(scope="module")
def systems(built_fmus: BuiltFmus):
    found = [bench(built_fmus, ""), bench(built_fmus, "RideComfort")]
    found[1].connect("car.body.az", "law.body.az")
    yield found
    for s in found:
        s.close()


PAGE = WebPage(
    "A quarter car",
    "On <bumps> & more.",
    [
        Control("speed", ["speed.start.speed"], 2.0, 20.0, keys=("ArrowDown", "ArrowUp")),
        Control("side", ["road.side"], choices={"both": 0, "left": 1, "right": 2}),
    ],
    ["car.body.az"],
    [Measure("acceleration", ["car.body.az"], "rms", "g", 1 / 9.80665, limit=0.5)],
    Finish(Value({"speed.x": 1.0}, -40.0), 20.0),
    group_label="car",
)


@pytest.fixture(scope="module")
def page(systems, tmp_path_factory: pytest.TempPathFactory) -> Path:
    shown = [
        PageSystem("Alone", systems[0], {"car.body.mass": 900.0}, "one", infer_scene(systems[0])),
        PageSystem("Judged", systems[1], group="two", scene=infer_scene(systems[1])),
    ]
    return export_web(tmp_path_factory.mktemp("page") / "quarter.html", shown, PAGE)


def block(path: Path, name: str) -> bytes:
    """What the page carries packed."""
    found = re.search(rf'id="{name}">([^<]*)<', path.read_text())
    assert found is not None
    return gzip.decompress(base64.b64decode(found[1]))


@pytest.fixture(scope="module")
def data(page: Path) -> dict[str, Any]:
    return json.loads(block(page, "data"))


def test_one_file_that_asks_for_nothing(page: Path) -> None:
    text = re.sub(r"<pre>.*?</pre>", "", page.read_text(), flags=re.DOTALL)  # licenses name addresses
    assert not re.findall(r"(?:src|href)\s*=\s*\"(?!data:,)", text)
    assert not re.findall(r"\b(?:fetch|XMLHttpRequest|import)\s*\(|https?://|url\(", text)
    assert "On &lt;bumps&gt; &amp; more." in text
    assert page.stat().st_size < 1e6


def test_it_carries_the_licenses(page: Path) -> None:
    text = page.read_text()
    assert "musl" in text
    assert "Permission is hereby granted" in text


def test_the_same_bytes_again(page: Path, systems, tmp_path: Path) -> None:
    shown = [
        PageSystem("Alone", systems[0], {"car.body.mass": 900.0}, "one", infer_scene(systems[0])),
        PageSystem("Judged", systems[1], group="two", scene=infer_scene(systems[1])),
    ]
    assert export_web(tmp_path / "again.html", shown, PAGE).read_bytes() == page.read_bytes()


def test_what_the_script_is_told(data: dict[str, Any]) -> None:
    assert data["interval"] == 0.005
    assert data["keep"] == 1
    assert data["groups"] == ["one", "two"]
    assert [s["title"] for s in data["systems"]] == ["Alone", "Judged"]
    assert data["systems"][0]["values"] == {"car.body.mass": 900.0}
    speed, side = data["controls"]
    assert (speed["unit"], speed["min"], speed["max"], speed["step"]) == ("km/h", 7.2, 72.0, 0.32)
    assert speed["factor"] == pytest.approx(3.6)
    assert (side["kind"], side["whole"], speed["whole"]) == ("choice", True, False)
    assert side["choices"] == [["both", 0], ["left", 1], ["right", 2]]
    variables = {v["name"]: v for v in data["systems"][0]["variables"]}
    mass = variables["car.body.mass"]
    assert (mass["role"], mass["unit"], mass["tunable"]) == ("parameter", "kg", False)
    assert variables["car.force"]["role"] == "input"
    assert variables["car.body.z"]["role"] == "output"
    assert data["finish"] == {"when": {"terms": {"speed.x": 1.0}, "offset": -40.0}, "patience": 20.0}


def test_the_module_shows_what_the_variables_say(page: Path, data: dict[str, Any], systems) -> None:
    """Value references and models of the data are those of the module."""
    for i, system in enumerate(systems):
        about = data["systems"][i]
        shown = sorted((v for v in about["variables"] if v["role"] == "output"), key=lambda v: v["type"])
        names = [v["name"] for v in shown]
        kinds = list(TYPES)
        host = WebHost(block(page, "module"), [(v["reference"], kinds[v["type"]]) for v in shown], about["model"])
        for name, value in about["values"].items():
            v = next(v for v in about["variables"] if v["name"] == name)
            assert host.set(v["reference"], kinds[v["type"]], [value]) == 0
        assert host.start(data["interval"]) == 0
        row = host.run(400)[-1]
        for name, value in about["values"].items():
            component, variable = name.split(".", 1)
            system[component].set({variable: value})
        system.allow_unconnected = True
        with system.initialize(record=names) as simulation:
            simulation.advance(2)
            assert row.tolist() == [float(simulation[n]) for n in names]
        assert abs(row[names.index("car.body.z")]) > 1e-6


def test_the_road_is_asked_with_its_own_parameters(page: Path, data: dict[str, Any], systems) -> None:
    road = data["systems"][0]["road"]
    host = WebHost(block(page, "module"), [(road["sides"]["left"]["reference"], "Float64")], road["model"])
    for kind, reference, values in road["starts"]:
        assert host.set(reference, list(TYPES)[kind], values) == 0
    assert host.start(road["step"]) == 0
    of = {n: float(v.start) for n, v in systems[0]["road"].description.parameters.items()}
    bump = of["hole.start"] + of["hole.length"] + of["gap"] + 0.5 * of["bump.length"]
    assert host.set(road["x"], "Float64", [bump - road["sides"]["left"]["ahead"]]) == 0
    assert host.run(1)[0, 0] > 0.01


@pytest.mark.parametrize(
    "change",
    [
        {"controls": [Control("mass", ["car.body.mas"])]},
        {"controls": [Control("force", ["car.force"], keys=("a", "b"))]},
        {"controls": [Control("speed", ["speed.start.speed"], follows={"car.body.mas": [Value({}, 1.0)]})]},
        {"controls": [Control("speed", ["speed.start.speed"], follows={"car.body.mass": [Value({"car.mas": 1.0})]})]},
        {"controls": [Control("nothing", [])]},
        {"controls": [Control("mass", ["car.body.mass"], drive=Drive(1.0, 1.0))]},
        {"controls": [Control("force", ["car.force"], drive=Drive(1.0, 1.0))]},
        {"controls": [Control("force", ["car.force"], 1.0, 2.0, drive=Drive(1.0, 1.0))]},
        {"controls": [Control("side", ["road.side"], drive=Drive(1.0, 1.0, rest=1.0))]},
        {
            "controls": [
                Control("force", ["car.force"], -1.0, 1.0, drive=Drive(1.0, 1.0, raised_by=("a",), lowered_by=("s",))),
                Control("speed", ["speed.start.speed"], 2.0, 20.0, keys=("s", "d")),
            ]
        },
        {"plots": ["car.body.zz"]},
        {"measures": [Measure("m", ["car.zz"])]},
        {"finish": Finish(Value({"car.zz": 1.0}), 1.0)},
        {"interval": 0.00033},
        {"interval": -1},
        {"pace": 3.0},
    ],
)
def test_what_names_nothing_is_refused(systems, tmp_path: Path, change: dict[str, Any], raises) -> None:
    with raises((WiringError, CosimError, ValueError)):
        export_web(tmp_path / "x.html", [PageSystem("One", systems[0])], WebPage("One", **change))
    assert not (tmp_path / "x.html").exists()


def test_what_else_is_refused(systems, tmp_path: Path, raises) -> None:
    with raises(WiringError):
        export_web(tmp_path / "x.html", [PageSystem("One", systems[0], {"car.bod": 1.0})], WebPage("One"))
    with raises(CosimError):
        export_web(tmp_path / "x.htm", [PageSystem("One", systems[0])], WebPage("One"))
    with raises(CosimError):
        export_web(tmp_path / "x.html", [PageSystem(str(i), systems[0]) for i in range(5)], WebPage("One"))
    with raises(CosimError):
        export_web(tmp_path / "x.html", [], WebPage("One"))
    with raises(CosimError):
        Measure("m", ["car.body.z"], "least")  # type: ignore[arg-type]
    with raises(ValueError):
        Drive(0.0, 1.0)
    with raises(ValueError):
        Drive(1.0, 1.0, float("nan"))


def test_a_system_writes_its_own_page(systems, tmp_path: Path) -> None:
    force = Control("push", ["car.force"], -500.0, 500.0, drive=Drive(1e3, 1e4, raised_by=("ArrowUp",), button=7))
    path = systems[0].export_web(
        tmp_path / "own.html",
        controls=["speed.start.speed", force],
        plots=["car.wheel.z", "car.force"],
        scene=infer_scene(systems[0]),
    )
    about = json.loads(block(path, "data"))
    assert "Hold the keys beside push" in path.read_text()
    assert about["controls"][1]["drive"] == {
        "rate": 1e3,
        "back": 1e4,
        "rest": 0.0,
        "raised_by": ["ArrowUp"],
        "lowered_by": [],
        "axis": None,
        "button": 7,
        "low": -500.0,
        "high": 500.0,
    }
    assert about["systems"][0]["scene"]["what"]
    assert about["controls"][0]["label"] == "speed.start.speed"
    assert about["plots"] == ["car.wheel.z", "car.force"]


def test_what_stands_beside(raises) -> None:
    case = TRENCH.case()
    assert _changed(case, "controller=lqr, length=2").controller == "lqr"
    assert _changed(case, "length=2").length == 2.0
    assert _changed(case, "hydropneumatic=true").hydropneumatic is True
    for text in (
        "lenght=2",
        "length",
        "length=wide",
        "hydropneumatic=yes",
        "controller=lqg",
    ):
        with raises(CaseError):
            _changed(case, text)


@pytest.mark.parametrize("speed", [6.0, 12.0])
def test_the_trench_page_judges_as_the_study_does(built_fmus: BuiltFmus, speed: float) -> None:  # noqa: ARG001
    """What it shows of the passive vehicle are the quantities of Table 5.3 of that run.

    It is over where a run of the study ends.
    """
    layout = live(TRENCH.case(speed_kmh=speed))
    page, first = layout.page, layout.cases[0]
    assert (first.case.controller, dict(first.values)) == ("passive", {})
    with Runner(TRENCH, FmuSet(FMUS)) as runner:
        expected = TRENCH.measures.measure(runner.run(TRENCH.case(controller="passive", speed_kmh=speed)))
        system = runner.system(first.case)
        recording = system.run(
            TRENCH.run.stop_time(system, first.case),
            record=Record(["car.x", *(n for m in page.measures for n in m.names)], page.interval),
            stop_when=TRENCH.run.stop_when(system, first.case),
        )
        car = system["car"]
        own = {
            f"car.{n}": float(car.values.get(n, v.start))
            for n, v in {**car.description.parameters, **car.description.inputs}.items()
            if v.start is not None
        }
        (control,) = (c for c in page.controls if c.follows)
        (begins,) = control.follows.values()
        assert max(v.of(own) for v in begins) == pytest.approx(
            own["car.trench.start"], abs=1e-3
        )  # which the study rounds
        assert page.finish.when.of({**own, "car.x": recording["car.x"][-1]}) == pytest.approx(0.0, abs=1e-3)
    assert [m.limit for m in page.measures[:-1]] == list(LIMITS.as_dict().values())
    for m, name in zip(page.measures[:-1], LIMITS.as_dict(), strict=True):
        columns = np.column_stack([recording[n] for n in m.names])
        value = {"peak": np.abs(columns).max(), "rms": np.sqrt((columns**2).mean(axis=0)).max()}[m.how]
        assert m.factor * value == pytest.approx(expected[name], rel=0.01), name


def test_pages_of_the_fmus_that_there_are(
    built_fmus: BuiltFmus,  # noqa: ARG001
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As releases write them: those whose FMUs are all among the named. `test_web_module.py` compiles modules."""
    monkeypatch.setattr(
        page_module, "compile_module", lambda codes, alone: Module(b"none", len(codes), tuple(dict.fromkeys(alone)))
    )
    pages = shown_experiments()
    assert set(pages) == {"handling", "hmmwv", "preview-lq", "ride", "semi-active", "trench"}
    fmus = FmuSet(FMUS)
    assert write_pages(fmus, tmp_path / "none", ["SpeedProfile"]) == []
    (path,) = write_pages(fmus, tmp_path / "one", pages["trench"].wiring.fmus)
    assert path == tmp_path / "one" / "trench.html"
    assert [s["title"] for s in json.loads(block(path, "data"))["systems"]] == ["Passive", "LQR", "MPC"]
    for name, path in zip(pages, write_pages(fmus, tmp_path / "all"), strict=True):
        systems = json.loads(block(path, "data"))["systems"]
        assert (path.stem, [s["model"] for s in systems]) == (name, list(range(len(systems))))
        assert block(path, "module") == b"none"
