"""FMUs of other makers, FMI 2.0 and 3.0 mixed, obey the same rule; files that are no FMUs are refused clearly."""

import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from functools import partial

import numpy as np
import pytest
from foreign.making import pack, redescribed
from probes import Clock
from rich.console import Console

from cosim import ComponentError, CosimError, Fmu, FmuError, System, WiringError, describe, wiring

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")


def chain(foreign, kind):
    """Chain clock -> AddOne (FMI 2) -> AddOne (FMI 3) -> AddOne (FMI 2), 10 ms each."""
    system = System()
    system.add("clock", Clock(), step="10 ms")
    for name, fmu in (("first", "AddOne2"), ("second", "AddOne3"), ("third", "AddOne2")):
        system.add(name, foreign[fmu], step="10 ms", kind=kind)
    system.connect("clock.y", "first.u")
    system.connect("first.y", "second.u")
    system.connect("second.y", "third.u")
    return system


def lag(result, hops):
    """Steps by which third.y trails clock.y + hops, once the chain is filled."""
    clock, third = result["clock.y"], result["third.y"]
    return round(float(np.median(clock - (third - hops))) / 0.01)


@pytest.mark.parametrize(("kind", "seidel", "steps"), [("discrete", 0, 0), ("continuous", 0, 3), ("continuous", 1, 1)])
def test_a_chain_of_three_foreign_fmus(foreign, kind, seidel, steps):
    """Discrete: no lag.

    Continuous: a step takes one step; side by side that adds up to one per hop, in a Gauss-Seidel group the whole chain
    takes one.
    """
    with chain(foreign, kind) as system:
        if seidel:
            system.group("line", ["first", "second", "third"])
        result = system.run(0.3)
        assert lag(result, 3) == steps
        again = system.run(0.3)
        np.testing.assert_array_equal(again.data, result.data)
        assert result["third.steps"][-1] == 30 + (kind == "discrete")  # which runs at the stop time, too


def test_types_other_than_real_are_wired_and_recorded(foreign):
    with System() as system:
        system.add("a", foreign["AddOne2"], step=1, kind="discrete")
        system.add("b", foreign["AddOne3"], step=1, kind="discrete")
        system.connect("a.busy", "b.enable")
        system.connect("a.steps", "b.u")
        result = system.run(6)
    np.testing.assert_array_equal(result["a.busy"], [1, 0, 1, 0, 1, 0, 1])
    np.testing.assert_array_equal(result["b.y"], [2, 2, 4, 4, 6, 6, 8])  # Integer to Real; held while not enabled


def test_parameters_hold_after_reset(foreign):
    with System() as system:
        system.add("a", foreign["AddOne2"], step=1, parameters={"gain": 3.0}, start={"u": 2.0})
        for _ in range(2):
            assert system.run(3)["a.y"][-1] == 7.0
        system["a"].set(gain=4.0)
        assert system.run(3)["a.y"][-1] == 9.0


def test_tunable_parameters_and_free_inputs_change_while_it_runs(foreign):
    with System() as system:
        system.add("a", foreign["AddOne2"], step=1)
        simulation = system.initialize(record=["a.y", "a.u"])
        simulation.advance(2)
        simulation.set("a.u", 5.0)
        simulation.set("a.gain", 2.0)
        simulation.advance(4)
        np.testing.assert_array_equal(simulation.recording["a.y"], [0, 1, 1, 11, 11])
        np.testing.assert_array_equal(simulation.recording["a.u"], [0, 0, 5, 5, 5])


def test_a_failing_fmu_tells_its_own_message(foreign):
    with System() as system:
        system.add("strut", foreign["AddOne2"], step=0.1, parameters={"fail_at": 0.5})
        with pytest.raises(ComponentError, match=r"'strut': fmi2DoStep.*0\.5 s") as caught:
            system.run(1)
        assert "the spring is broken" in str(caught.value)
        assert caught.value.recording.time[-1] == 0.5
        system["strut"].set(fail_at=9.0)  # the system can be used again
        assert system.run(1).time[-1] == 1.0


def test_a_discarded_step_ends_the_run(foreign):
    """PythonFMU calls a step that returns False discarded, and itself terminated then."""
    with System() as system:
        system.add("strut", foreign["AddOne2"], step=0.1, parameters={"fail_at": 0.5, "how": "discard"})
        result = system.run(1)
        assert "'strut' asked to end the simulation (step from 0.5 s" in result.stopped_by
        assert result.time[-1] == 0.5


def test_fmus_that_cannot_save_are_named(foreign, raises):
    with chain(foreign, "continuous") as system, raises(CosimError):
        system.initialize().save()


def test_description_of_a_foreign_fmu(foreign):
    console = Console(width=120)
    with console.capture() as captured:
        console.print(describe(foreign["AddOne3"]))
    text = captured.get()
    assert "FMI 3.0" in text
    assert "needsExecutionTool" in text
    assert 'system.connect("OTHER.u", "addone3.u")' in wiring(foreign["AddOne3"]).splitlines()


def test_unpacked_folder_and_loaded_fmu(foreign, tmp_path):
    shutil.unpack_archive(foreign["AddOne2"], tmp_path / "AddOne2", "zip")
    fmu = Fmu(foreign["AddOne2"])
    with System() as system:
        system.add("folder", tmp_path / "AddOne2", step=1)
        system.add("loaded", fmu, step=1)
        result = system.run(2)
        np.testing.assert_array_equal(result["folder.y"], result["loaded.y"])
    fmu.close()


def test_a_missing_file_names_the_nearest(foreign, raises):
    with raises(FmuError):
        System().add("a", foreign["AddOne2"].with_name("AddOn2.fmu"))


def test_truncated_and_foreign_files(foreign, tmp_path):
    whole = foreign["AddOne2"].read_bytes()
    half = tmp_path / "half.fmu"
    half.write_bytes(whole[: len(whole) // 2])
    text = tmp_path / "text.fmu"
    text.write_text("not an FMU")
    empty = tmp_path / "empty.fmu"
    with zipfile.ZipFile(empty, "w") as archive:
        archive.writestr("hello.txt", "hello")
    for path, reason in ((half, "incomplete"), (text, "incomplete"), (empty, "contains no modelDescription.xml")):
        with pytest.raises(FmuError, match=f"{path.name}.*{reason}"):
            System().add("a", path)
    with pytest.raises(FmuError, match=r"contains no modelDescription\.xml"):
        Fmu(tmp_path)


def test_fmus_this_master_cannot_run(foreign, tmp_path, refused):
    changes = (
        (b'fmiVersion="2.0"', b'fmiVersion="1.0"'),
        (b"CoSimulation", b"ScheduledExecution"),
        (b"</fmiModelDescription>", b""),
        (b'valueReference="0"', b'valueReference="x"'),
    )
    paths = [redescribed(foreign["AddOne2"], tmp_path / f"bad{i}.fmu", c) for i, c in enumerate(changes)]
    refused(
        FmuError,
        *(partial(System().add, "a", path, step=1) for path in paths),
        partial(System().add, "a", paths[1], step=1, interface="cs"),
    )


def test_an_fmu_with_source_code_alone_says_how_to_compile_it(foreign, tmp_path):
    with zipfile.ZipFile(foreign["AddOne2"]) as archive:
        description = archive.read("modelDescription.xml")
    for name, text in (("sources/code.c", "but source code"), ("sources/readme.txt", "it has no binaries. Build")):
        path = pack(tmp_path / "bad.fmu", {"modelDescription.xml": description, name: b""})
        folder = tmp_path / name
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
        for place in (path, folder):
            with pytest.raises(FmuError, match=text):
                System().add("a", place, step=1)


def test_a_folder_with_source_code_alone_is_packed_first(foreign, tmp_path):
    """FMPy compiles files only."""
    folder = tmp_path / "un packed"
    (folder / "sources").mkdir(parents=True)
    (folder / "sources" / "code.c").touch()
    with zipfile.ZipFile(foreign["AddOne2"]) as archive:
        archive.extract("modelDescription.xml", folder)
    with pytest.raises(FmuError) as told:
        System().add("a", folder, step=1)
    found = re.search(r"\((python -m .*), then fmpy compile '(.*)'\)", str(told.value))
    subprocess.run([sys.executable, *shlex.split(found[1])[1:]], check=True)
    with zipfile.ZipFile(found[2]) as archive:
        assert {"modelDescription.xml", "sources/code.c"} <= set(archive.namelist())


def test_a_system_with_two_instances_of_an_fmu_that_allows_one_is_not_exported(foreign, tmp_path):
    change = b'OnlyOncePerProcess="false"', b'OnlyOncePerProcess="true"'
    path = redescribed(foreign["AddOne2"], tmp_path / "Once.fmu", change)
    with System(allow_unconnected=True) as system:
        for name in ("first", "second"):
            system.add(name, path, step=1)
        system.run(1)  # each instance has a library of its own
        with pytest.raises(WiringError, match=r"which allows one per process: .*without=\['second'\]"):
            system.export_fmu(tmp_path / "System.fmu")


def test_the_binaries_of_an_fmu_without_one_for_this_platform_are_named(foreign, tmp_path):
    other = (b'modelIdentifier="AddOne2"', b'modelIdentifier="Other"')
    path = redescribed(foreign["AddOne2"], tmp_path / "bad.fmu", other)
    with pytest.raises(FmuError, match=r"bad\.fmu .*\(binaries/.*binaries/.*/AddOne2\..*'Other'"):
        System().add("a", path, step=1)


def test_a_refused_instantiation_gives_the_reason(foreign):
    system = System()
    system.add("strut", foreign["Refuses2"], step=1)
    with pytest.raises(FmuError, match=r"(?s)Refuses2\.fmu: .*'strut':.*license of 100 %"):
        system.run(1)


@pytest.mark.skipif(
    not sysconfig.get_config_var("Py_ENABLE_SHARED"),
    reason="this Python has no library, which FMUs of PythonFMU expect in their process",
)
@pytest.mark.parametrize("name", ["AddOne2", "AddOne3"])
def test_fmus_in_python_run_isolated(foreign, name):
    """They leave symbols of Python to the process that loads them; the process of an isolated FMU has them too."""
    recordings = []
    for isolated in (False, True):
        with System() as system:
            system.add("a", foreign[name], step=1, start={"u": 2.0}, isolated=isolated)
            system.allow_unconnected = True
            recordings.append(system.run(3, record=["a.y"])["a.y"])
    np.testing.assert_array_equal(*recordings)
