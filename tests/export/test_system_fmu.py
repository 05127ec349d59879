"""A system of this project's FMUs and of third-party FMUs, as one FMU.

The same numbers, its description, its states, what it refuses.
"""

from __future__ import annotations

import json
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import awkward
import fmpy
import numpy as np
import pytest
from built import FMUS, BuiltFmus
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu
from foreign import calculating, eventful, making, relay, sloped
from same import bits

from cosim import CosimError, Fmu, FmuError, PythonComponent, Record, System, WiringError
from cosim.experiments.bench import EXPERIMENT
from cosim.experiments.bench.runs import Case, wire
from cosim.fmu.validation import Verdict
from cosim.study import FmuSet, Runner

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")
IN_ECOS = Path(__file__).parents[1] / "conformance" / "run_in_ecos.py"
RECORD = ["plant.body.az", "plant.tire.deflection", "controller.force", "road.road.height"]


@pytest.fixture(scope="module")
def ride(built_fmus: BuiltFmus, tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:  # noqa: ARG001
    """The test bench under its LQR as one FMU, by FMI version, as the command line exports it."""
    folder = tmp_path_factory.mktemp("ride")
    program, outputs = Path(sys.executable).with_name("cosim"), [x for n in RECORD for x in ("--output", n)]
    found = {fmi: folder / str(fmi) / "Ride.fmu" for fmi in (2, 3)}
    for fmi, path in found.items():
        command = ["export", "bench", "--controller", "lqr", "--fmus", FMUS, "--fmi", fmi, "--fmu", path, *outputs]
        subprocess.run([program, *map(str, command)], check=True, capture_output=True)
    return found


@pytest.fixture(scope="module")
def shown(built_fmus: BuiltFmus) -> np.ndarray:  # noqa: ARG001
    """What the system itself shows every 10 ms of 2 s, plant values at their time and commands of the sample before."""
    with Runner(EXPERIMENT, FmuSet(FMUS)) as runner, runner.system(Case("lqr")).initialize(record=RECORD) as simulation:
        rows = [[simulation[n] for n in RECORD]]
        for k in range(1, 201):
            simulation.advance(f"{k}/100")
            rows.append([simulation[n] for n in RECORD])
    return np.array(rows)


@pytest.mark.parametrize("fmi", [2, 3])
def test_fmpy_sees_what_the_system_shows(ride, shown, fmi):
    assert not validate_fmu(ride[fmi])
    assert Fmu(ride[fmi], strict=True).verdict == Verdict()
    result = fmpy.simulate_fmu(ride[fmi], stop_time=2.0, output_interval=0.01, output=RECORD)
    np.testing.assert_array_equal(bits([list(row)[1:] for row in result]), bits(shown))


@pytest.mark.parametrize("fmi", [2, 3])
def test_ecos_sees_what_the_system_shows(ride, shown, fmi, tmp_path):
    """An importer of another origin, in a process of its own."""
    job = {
        "fmus": [str(ride[fmi])],
        "step": 0.01,
        "steps": len(shown) - 1,
        "inputs": {},
        "outputs": RECORD,
        "kinds": dict.fromkeys(RECORD, "real"),
    }
    done = subprocess.run(
        [sys.executable, str(IN_ECOS)], input=json.dumps(job), capture_output=True, text=True, cwd=tmp_path, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    np.testing.assert_array_equal(bits(json.loads(done.stdout.splitlines()[-1])[0]), bits(shown))


def test_a_container_in_a_container_shows_the_same(built_fmus, tmp_path):
    """Linked from its sources like any other FMU of this project, two instances of it; FMI 2.0 inside of FMI 3.0."""
    signals = ["car.body.z", "car.wheel.vz"]
    with System() as alone:
        alone.add("car", built_fmus.path("QuarterCarBench", 2), start={"road.height": 0.02})
        alone.add("law", built_fmus.path("LqrBench", 3))
        alone.connect_matching("car", "law", "*")
        alone.connect_matching("law", "car", "*")
        member = alone.export_fmu(tmp_path / "Ride.fmu", fmi=2, outputs=signals)
        shown = alone.run(2, record=Record(signals, interval="10 ms")).data
    with System() as inner:
        inner.add("one", member, step="10 ms")
        inner.add("two", member, step="10 ms")
        nested = inner.export_fmu(tmp_path / "Nested.fmu", fmi=3)
    assert not validate_fmu(nested)
    assert Fmu(nested, strict=True).verdict == Verdict()
    with zipfile.ZipFile(nested) as archive:
        assert [m["linked"] for m in json.loads(archive.read("resources/components.json"))] == [True]
    with System() as outer:
        outer.add("all", nested, step="10 ms")
        result = outer.run(2, record=[f"all.{which}.{n}" for which in ("one", "two") for n in signals])
    assert (np.ptp(shown, axis=0) > 0).all()
    np.testing.assert_array_equal(bits(result.data), bits(np.hstack([shown, shown])))


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_last_row_of_a_run_is_what_the_fmu_shows(ride, fmi):
    """Plant values at their time; sampled values, which an FMU shows from its next step on, one step of 1 ms later."""
    with Runner(EXPERIMENT, FmuSet(FMUS)) as runner:
        run = runner.system(Case("lqr")).run("1/10", record=Record(RECORD, "1 ms"))
    with System() as outer:
        outer.add("ride", ride[fmi], step="1 ms")
        fmu = outer.run("101/1000", record=Record([f"ride.{n}" for n in RECORD], "1 ms"))
    plant = [n.startswith("plant.") for n in RECORD]
    for i, n in enumerate(RECORD):
        shown = fmu.data[:-1, i] if plant[i] else fmu.data[1:, i]
        np.testing.assert_array_equal(bits(shown), bits(run.data[:, i]), err_msg=n)


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_discrete_system_as_one_fmu_runs_at_the_stop_time(built_fmus, fmi, tmp_path):
    """Like any discrete component; it refuses a step beyond the stop time that it is told."""

    def car(law: Path, prefix: str) -> System:
        system = System()
        system.add("road", built_fmus.path("RoadSine", fmi), step="1 ms")
        system.add("car", built_fmus.path("FullCarHmmwvModified", fmi), step="1 ms")
        system.add("law", law, step="1 ms")
        system.connect_matching("road", "car", "road.*")
        system.connect("car.x", "road.x")
        for corner in ("fl", "fr", "rl", "rr"):
            system.connect(f"law.{prefix}force.{corner}", f"car.force.{corner}")
        for state in ("az", "pitch", "roll"):
            system.connect(f"car.body.{state}", f"law.{prefix}body.{state}")
        return system

    with car(built_fmus.path("GpcImplicit", fmi), "") as system:
        record = ["car.body.*", "law.force.*"]
        expected = system.run("1/2", record=record)
        fmu = system.export_fmu(tmp_path / "Law.fmu", without=["road", "car"], fmi=fmi)
    with car(fmu, "law.") as system:
        assert system["law"].kind == "discrete"
        for until in ("1/2", 1):
            found = system.run(until, record=["car.body.*", "law.law.force.*"])
            np.testing.assert_array_equal(bits(found.data[: len(expected)]), bits(expected.data))


@pytest.mark.parametrize("fmi", [2, 3])
def test_states_continue_with_the_same_bits(ride, fmi):
    """Saved, restored, serialized into another instance; also a system with FMUs of others."""
    with System() as system:
        system.add("ride", ride[fmi], step="10 ms")
        with system.initialize(record=[f"ride.{n}" for n in RECORD]) as simulation:
            simulation.advance("1/2")
            state, data = simulation.save(), system["ride"].implementation.serialize()
            simulation.advance(1)
            first = simulation.recording
            simulation.restore(state)
            simulation.advance(1)
            np.testing.assert_array_equal(bits(simulation.recording.data), bits(first.data))
            simulation.restore(state)
            system["ride"].implementation.deserialize(data)
            simulation.advance(1)
            np.testing.assert_array_equal(bits(simulation.recording.data), bits(first.data))


def test_damaged_states_are_refused(ride):
    with System() as system:
        system.add("ride", ride[3], step="10 ms")
        with system.initialize() as simulation:
            simulation.advance("1/10")
            component = system["ride"].implementation
            data = component.serialize()
            for place in (0, 4, 8, 16, 24, 32, 60, 200, len(data) // 2, len(data) - 1):
                damaged = bytearray(data)
                damaged[place] ^= 0x41
                with pytest.raises(Exception, match=r"damaged|not a state|belongs to another|format|cannot be a state"):
                    component.deserialize(bytes(damaged))
            for length in (0, 5, 39, 40, 100, len(data) - 1):
                with pytest.raises(Exception, match=r"damaged|not a serialized state|NULL"):
                    component.deserialize(data[:length])
            component.deserialize(data)
            simulation.advance("2/10")


def test_what_others_made_travels_in_resources(follower, built_fmus, tmp_path):
    """Both versions of FMI, converted units and offsets, values of every type that the system sets.

    Beside an FMU of this project.
    """
    with System() as system:
        for version in (2, 3):
            system.add(
                f"f{version}", follower[version], step="2 ms", parameters={"rate": 7.0}, start={"u": 30.0, "on": True}
            )
        large = {"uint32_in": 3 * 10**9, "int64_in": 2**40}
        system.add("again", follower[3], step="1 ms", start={"w": [1.0, 2.0, 3.0], **large})
        system.add("ours", built_fmus.path("QuarterCarHmmwv", 3), step="1 ms", start={"force": 100.0})
        system.connect("f2.y", "f3.u")
        system.connect("f3.total[2]", "again.w[1]")
        system.connect("f2.count", "f3.count_in")
        names = ["f3.y", "f3.count", "f3.off", "again.total[1]", "again.total[3]", "ours.body.z"]
        names += ["again.uint32_out", "again.int64_out"]
        fmu = system.export_fmu(tmp_path / "Mixed.fmu", outputs=names, fmi=2)
        with system.initialize(record=names) as simulation:
            simulation.advance("1/10")
            expected = [simulation[n] for n in names]
    assert expected[-2:] == [*large.values()]
    with zipfile.ZipFile(fmu) as archive:
        held = archive.namelist()
        assert {m["name"]: m["linked"] for m in json.loads(archive.read("resources/components.json"))} == {
            "follower": False,
            "follower_2": False,
            "QuarterCarHmmwv": True,
        }
    assert len([n for n in held if n.startswith("resources/follower") and n.endswith(".so")]) == 2
    assert any(n.startswith("documentation/licenses/QuarterCarHmmwv/") for n in held)
    assert not validate_fmu(fmu)
    assert Fmu(fmu, strict=True).verdict == Verdict()
    result = fmpy.simulate_fmu(fmu, stop_time=0.1, output_interval=0.002, output=names)
    np.testing.assert_array_equal(bits([float(result[n][-1]) for n in names]), bits(expected))


def test_inputs_and_parameters_act_as_in_the_system(built_fmus, tmp_path):
    """A bench with its road outside: what the road drove are inputs, and the tunable law is among the parameters."""
    fmus = FmuSet(built_fmus.path("RoadBenchBump", 3).parents[1])
    with wire(fmus, Case("lqr", encoders=True)) as system:
        system["plant"].set({"body.mass": 2.5})
        fmu = system.export_fmu(tmp_path / "Open.fmu", without=["road"], outputs=["plant.*"])
    with System() as outer:
        component = outer.add("open", fmu)
        assert component.step == 1 / 1000 or float(component.step) == 1e-3
        assert component.kind == "continuous"
        inputs = component.description.inputs
        assert {"plant.road.height", "encoders.encoder.road", "plant.road.rate"} <= set(inputs)
        assert inputs["plant.road.height"].unit_name == "m"
        parameter = component.description.parameters["controller.gain[1]"]
        assert (parameter.variability, parameter.source is not None) == ("tunable", True)
        with outer.initialize(record=["open.plant.body.az"]) as simulation:
            simulation.advance("1/100")
            still = simulation["open.plant.body.az"]
            simulation.set("open.plant.road.height", 0.01)
            simulation.advance("2/100")
            assert simulation["open.plant.body.az"] != still
            simulation.set("open.controller.gain[1]", 0.0)
            assert component.implementation.get([parameter]) == [0.0]


def test_the_same_system_gives_the_same_bytes(follower, tmp_path):
    made = []
    for k in (1, 2):
        with System() as system:
            for name in ("a", "b") if k == 1 else ("b", "a"):
                system.add(name, follower[3], step="1 ms")
            system.connect("a.y", "b.u")
            made.append(system.export_fmu(tmp_path / str(k) / "Same.fmu").read_bytes())
    assert made[0] == made[1]


def test_steps_and_times_are_whole_ticks(follower, tmp_path, raises):
    """Within 1e-9 of a tick; errors name the tick. From any start that is a simple fraction of a second."""
    with System() as system:
        system.add("a", follower[3], step="2 ms", start={"u": 30.0})
        system.add("b", follower[3], step="5 ms")
        system.connect("a.y", "b.u")
        fmu = system.export_fmu(tmp_path / "Ticks.fmu")
    for begin in (0.0, 0.001, 1 / 3, 100.0):
        with System() as outer:
            outer.add("ticks", fmu, step="10 ms")
            with outer.initialize(begin, record=["ticks.b.y"]) as simulation:
                simulation.advance(begin + 0.1)
                assert simulation["ticks.b.y"] > 0
    with System() as outer:
        outer.add("ticks", fmu, step="1.5 ms")
        with raises(CosimError):
            outer.run(0.1)
    with System() as outer:
        outer.add("ticks", fmu, step="1 ms")
        with raises(CosimError):
            outer.run(1, start_time=0.1234567890123)


class InPython(PythonComponent):
    outputs = ("y",)

    def step(self, t: float, h: float, u: Any, y: Any) -> None: ...


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"without": ["p"], "inputs": ["b.u"]},
        {"without": ["p"], "inputs": ["a.rate"]},
        {"without": ["p"], "inputs": ["a.int64_in"]},
        {"without": ["p"], "inputs": ["a.w[2]"]},
        {"without": ["p"], "outputs": ["a.z"]},
        {"without": ["q"]},
        {"without": ["p"], "fmi": 1},
        {"without": ["p"], "file": "My System.fmu"},
    ],
)
def test_what_cannot_be_in_it_is_named(follower, tmp_path, options, raises):
    with System() as system:
        system.add("p", InPython(), step="1 ms")
        for name in ("a", "b"):
            system.add(name, follower[3], step="1 ms")
        system.connect("a.y", "b.u")
        options = dict(options)
        path = tmp_path / options.pop("file", "No.fmu")
        with raises((WiringError, CosimError)):
            system.export_fmu(path, **options)
        assert not path.exists()


TEXTS = ["", "plain", "<a href=\"x\"> & 'b'", "line\nand\ttab", "Größe %s \\ ??/"]


@pytest.mark.parametrize("text", TEXTS)
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("version", [2, 3])
def test_texts_are_parameters_of_the_fmu(tmp_path_factory, tmp_path, version, fmi, text):
    """With the values of the system as start values, as the component gets them, and as the importer changes them."""
    path = calculating.build(tmp_path_factory.getbasetemp(), version)
    with System() as system:
        for name in ("a", "b"):
            system.add(name, path, step="1 ms")
        system["a"].set(name=text)
        fmu = system.export_fmu(tmp_path / "Texts.fmu", fmi=fmi)
        expected = system.run(0.002, record=["a.seen"])["a.seen"][-1]
    assert not validate_fmu(fmu)
    assert Fmu(fmu, strict=True).verdict == Verdict()
    shown = fmpy.simulate_fmu(fmu, stop_time=0.002, output_interval=0.001)
    assert shown["a.seen"][-1] == expected
    with System() as outer:
        one = outer.add("all", fmu, step="1 ms")
        inside = {v.name: v for v in one.description.parameters.values()}
        assert (inside["a.name"].fmi_type, inside["a.name"].start, inside["b.name"].start) == ("String", text, "")
        assert inside["a.name"].variability == "fixed"
        one.set({"b.name": text, "a.name": "other"})
        with outer.initialize(record=["all.b.seen"]) as simulation:
            assert one.implementation.get([inside["b.name"], inside["a.name"]]) == [text, "other"]
            assert simulation["all.b.seen"] == expected


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_call_with_a_text_that_a_component_refuses_changes_nothing(tmp_path, fmi):
    with System() as system:
        for name in ("a", "b"):
            system.add(name, calculating.build(tmp_path, 3), step="1 ms")
        fmu = system.export_fmu(tmp_path / "Texts.fmu", fmi=fmi)
    description = fmpy.read_model_description(fmu)
    references = [v.valueReference for v in description.modelVariables if v.name in ("a.name", "b.name")]
    said = []

    def texts(of):
        return [text.decode() if isinstance(text, bytes) else text for text in slave.getString(of)]

    slave = (FMU2Slave if fmi == 2 else FMU3Slave)(
        guid=description.guid,
        unzipDirectory=fmpy.extract(fmu, tmp_path / "files"),
        modelIdentifier="Texts",
        **({} if fmi == 2 else {"instanceName": "one"}),
    )
    try:
        logs = fmpy.fmi2.fmi2CallbackLoggerTYPE if fmi == 2 else fmpy.fmi3.fmi3LogMessageCallback
        logger = logs(lambda *given: said.append(given[-1].decode()))
        if fmi == 2:
            callbacks = fmpy.fmi2.fmi2CallbackFunctions()
            callbacks.logger = logger
            slave.instantiate(callbacks=callbacks)
            slave.setupExperiment()
        else:
            slave.instantiate(logMessage=logger)
        slave.enterInitializationMode()
        put = slave.setString
        put(references, ["first", "second"])
        with pytest.raises(fmpy.fmi1.FMICallException):
            put(references, ["changed", 70 * "x"])
        assert "b.name" in said[-1]
        assert texts([*references, references[0]]) == ["first", "second", "first"]
        slave.exitInitializationMode()
        with pytest.raises(fmpy.fmi1.FMICallException):
            put(references[:1], ["late"])
        assert "a.name cannot be set in state 'step mode'" in said[-1]
        assert texts(references) == ["first", "second"]
    finally:
        slave.freeInstance()


def test_parameters_of_other_types(tmp_path, raises):
    """Enumerations are integers there; what no FMU of a system has is named, unless it was chosen by a pattern."""
    with System() as system:
        system.add("a", calculating.build(tmp_path, 3), step="1 ms")
        system["a"].set(mode=2, large=7, key=b"\x01")
        fmu = system.export_fmu(tmp_path / "Modes.fmu")
        for name in ("large", "key", "q[1]"):
            with raises(WiringError):
                system.export_fmu(tmp_path / "No.fmu", parameters=[f"a.{name}"])
        system["a"].set(name="bell \a")
        with raises(WiringError):
            system.export_fmu(tmp_path / "No.fmu")
        system.export_fmu(tmp_path / "Less.fmu", parameters=["a.p"])
    parameters = Fmu(fmu).description.parameters
    assert sorted(parameters) == ["a.factor", "a.mode", "a.n", "a.name", "a.p"]
    assert (parameters["a.mode"].fmi_type, parameters["a.mode"].start) == ("Int32", 2)
    assert "Enumeration as Int32" in parameters["a.mode"].description
    for mode in (1, 2):
        start = {"a.mode": mode} if mode == 1 else {}
        shown = fmpy.simulate_fmu(fmu, stop_time=0.002, output_interval=0.001, start_values=start)
        assert shown["a.seen"][-1] == 7 + 1 + 0.25 * (mode - 1)


def test_a_platform_without_a_library_is_named(follower, tmp_path):
    with System() as system:
        system.add("a", follower[3], step="1 ms")
        with pytest.raises(CosimError, match=r"'a' .*x86_64-windows"):
            system.export_fmu(tmp_path / "No.fmu", platforms="x86_64-windows")
        with pytest.raises(CosimError, match=r"unknown platform 'foo'; choose from host, all"):
            system.export_fmu(tmp_path / "No.fmu", platforms="foo")


def test_a_library_that_is_gone_is_named(follower, tmp_path):
    with System() as system:
        system.add("a", follower[3], step="1 ms")
        fmu = system.export_fmu(tmp_path / "Gone.fmu")
    folder = Path(fmpy.extract(fmu, tmp_path / "gone"))
    next(folder.glob("resources/follower/binaries/*/*")).unlink()
    with System() as outer:
        outer.add("gone", folder)
        with pytest.raises(FmuError, match=r"(?s)component 'a'.*follower"):
            outer.run(0.1)


@pytest.mark.parametrize(("rate", "status"), [(-1.0, 3), (-2.0, 4)])
@pytest.mark.parametrize("fmi", [2, 3])
def test_no_step_follows_an_error_of_a_member(follower, tmp_path, fmi, rate, status):
    """A component whose values cannot be read while initializing.

    The system is in the state "error", whatever is set afterwards.
    """
    with System() as system:
        system.add("a", follower[fmi], step="1 ms")
        about = fmpy.read_model_description(
            path := system.export_fmu(tmp_path / "Failing.fmu", fmi=fmi, parameters=["a.rate"])
        )
    reference = {v.name: v.valueReference for v in about.modelVariables}
    folder = fmpy.extract(path, tmp_path / "extracted")
    made = (FMU2Slave if fmi == 2 else FMU3Slave)(
        guid=about.guid,
        unzipDirectory=folder,
        modelIdentifier=about.coSimulation.modelIdentifier,
        instanceName="system",
    )
    made.instantiate()
    get, put = (made.getReal, made.setReal) if fmi == 2 else (made.getFloat64, made.setFloat64)
    made.enterInitializationMode()
    put([reference["a.rate"]], [rate])
    refused = [
        lambda: get([reference["a.y"]]),
        lambda: put([reference["a.rate"]], [1.0]),
        made.exitInitializationMode,
        lambda: made.doStep(0.0, 0.001),
    ]
    for call in refused:
        with pytest.raises(fmpy.fmi1.FMICallException):
            call()
    if status == 3:
        made.reset()
        made.enterInitializationMode()
        made.exitInitializationMode()
        made.doStep(0.0, 0.001)
    made.freeInstance()


def test_names_of_others_are_texts_in_c(built_fmus: BuiltFmus, awkward_fmus: dict[int, Path], tmp_path: Path) -> None:
    """Trigraphs, ends of comments and strings, backslashes. The library compiles."""
    names, output, unlike = ['"', "a\\", "é😀"], "sure??!", "??/*/"
    named = (b'name="y"', f'name="{output}"'.encode()), (b'name="u"', f'name="{unlike}"'.encode())
    with System() as system:
        for name in names:
            system.add(name, built_fmus.path("QuarterCarHmmwv", 3), step="1 ms")
        system.add("m", making.redescribed(awkward_fmus[3], tmp_path / "Odd.fmu", *named), step="1 ms")
        system.connect('".body.z', f"m.{unlike}")
        path = system.export_fmu(tmp_path / "Named.fmu", outputs=["*.body.z", f"m.{output}"])
    with System() as again:
        again.add("all", path)
        assert sorted(again["all"].description.outputs) == sorted([*(f"{n}.body.z" for n in names), f"m.{output}"])
        again.allow_unconnected = True
        again.run("1/1000", record=[])


def run_to_its_end(path: Path, folder: Path) -> tuple[float, dict[str, float]]:
    """Where an FMU ends that asks for it within 1 s, and what it shows then; it takes no step after that."""
    about = fmpy.read_model_description(path)
    made = fmpy.instantiate_fmu(fmpy.extract(path, folder), about, "CoSimulation")
    fmi = int(about.fmiVersion[0])
    if fmi == 2:
        made.setupExperiment()
    made.enterInitializationMode()
    made.exitInitializationMode()
    if fmi == 2:
        with pytest.raises(fmpy.fmi1.FMICallException, match="status 2"):
            [made.doStep(0.25 * k, 0.25) for k in range(4)]
        assert made.getBooleanStatus(fmpy.fmi2.fmi2Terminated)
        reached = made.getRealStatus(fmpy.fmi2.fmi2LastSuccessfulTime)
    else:
        steps = (made.doStep(0.25 * k, 0.25) for k in range(4))
        early, reached = next((early, last) for _, terminated, early, last in steps if terminated)
        assert not early, "mightReturnEarlyFromDoStep is false"
    outputs = {v.name: v.valueReference for v in about.modelVariables if v.causality == "output"}
    shown = (made.getReal if fmi == 2 else made.getFloat64)([*outputs.values()])
    with pytest.raises(fmpy.fmi1.FMICallException):
        made.doStep(reached, 0.25)
    made.terminate()
    made.freeInstance()
    return reached, dict(zip(outputs, shown, strict=True))


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("trouble", [awkward.END, awkward.END_EARLY, awkward.END_UNTOLD])
@pytest.mark.parametrize("kind", ["continuous", "discrete"])
def test_a_member_that_asks_for_the_end_ends_the_system_where_a_run_ends(
    awkward_fmus, tmp_path, fmi, version, trouble, kind
):
    """Done, its step ends; all others go on until then. It is in the middle of a step of the system."""
    with System() as system:
        own = {"trouble": trouble, "at": 0.3}
        system.add("plant", awkward_fmus[version], parameters=own, kind=kind, step="0.1 s")
        system.add("law", awkward_fmus[version], kind="discrete", step="0.1 s")
        system.add("fast", awkward_fmus[version], step="10 ms")
        result = system.run(1.0, record=Record(interval="50 ms"))
        path = system.export_fmu(tmp_path / "Ending.fmu", fmi=fmi, outputs=["plant.y", "law.y", "fast.y"])
    reached, shown = run_to_its_end(path, tmp_path / "extracted")
    assert reached == result.time[-1]
    assert shown == {name: result[name][-1] for name in shown}
    if fmi == 3:
        alone = fmpy.simulate_fmu(path, stop_time=1.0, output_interval=0.25, output=["plant.y"])
        assert alone["plant.y"][-1] == result["plant.y"][-1]
        for depth in (1, 2):
            with System() as outer:
                outer.add("s", path, step="0.25 s")
                again, path = outer.run(1.0, record=[]), outer.export_fmu(tmp_path / f"Nested{depth}.fmu")
            assert "'s' asked to end" in str(again.stopped_by)
            assert again.time[-1] == 0.25, "its step was not whole"


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("first", ["relay 2", "relay 3", "continuous", "discrete"])
def test_a_request_in_the_first_event_iteration_ends_the_system_in_its_first_step(tmp_path, fmi, first):
    """With the row of a run, in which the discrete component c has had its step."""
    with System(allow_unconnected=True) as system:
        if first in ("continuous", "discrete"):
            own = {"kind": eventful.KINDS.index("ending"), "period": 0.0}
            system.add("a", eventful.build(tmp_path), kind=first, step="0.125 s", parameters=own)
        else:
            own = {"gain": 0.0, "on": -1.0, "off": -1.0, "ends": 1.0}
            system.add("a", relay.build(int(first[-1]), tmp_path), step="0.125 s", parameters=own)
        system.add("b", relay.build(3, tmp_path), step="0.125 s", parameters=own if first == "relay 2" else {})
        system.add("c", sloped.build(3, tmp_path), kind="discrete", step="0.125 s")
        for target in ("b.u", "c.p"):
            system.connect("a.y" if first.startswith("relay") else "a.count", target)
        result = system.run(1.0, record=["b.y", "c.a"])
        path = system.export_fmu(tmp_path / "Ending.fmu", fmi=fmi, outputs=["b.y", "c.a"])
    assert result["c.a"].tolist() == [0.125 + np.sin(1.0)]
    assert run_to_its_end(path, tmp_path / "extracted") == (0.0, {n: result[n][0] for n in result.names})
    with System() as outer:
        outer.add("s", path, step="0.25 s")
        found = outer.run(1.0, record=["s.b.y"])
    assert (found.time.tolist(), found["s.b.y"].tolist()) == ([0.0], result["b.y"].tolist())
    assert "'s' asked to end" in str(found.stopped_by)
    assert "component 'a' requests termination" in str(found.stopped_by)
