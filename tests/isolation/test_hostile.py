"""Hostile FMUs in processes of their own.

The host lives, the error names component, function and time, and what was recorded is there.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from foreign.hostile import ENDS, HARMLESS, LIES, PHASES, STEPPING, build
from processes import children, gone

from cosim import ComponentError, CosimError, IsolationCrashedWarning, System

VERSIONS = (2, 3)
PATIENCE, NEVER = 1.5, 60.0  # s, of a call where a deed takes forever, and of one where none does
FUNCTIONS = {
    "load": "loading its library",
    "instantiate": "fmi.Instantiate",
    "enter": "fmi.(SetupExperiment|EnterInitializationMode)",
    "exit": "fmi.ExitInitializationMode",
    "set": "fmi.Set(Real|Float64)",
    "step": "fmi.DoStep",
    "get": "fmi.(Get(Real|Float64)|DoStep)",
    "terminate": "fmi.Terminate",
    "free": "fmi.FreeInstance",
    "save": "fmi.GetFMU[sS]tate",
    "restore": "fmi.SetFMU[sS]tate",
    "size": "fmi.SerializedFMU[sS]tateSize",
    "serialize": "fmi.SerializeFMU[sS]tate",
    "deserialize": "fmi.De[sS]erializeFMU[sS]tate",
}


@pytest.fixture
def system() -> Iterator[System]:
    with System() as made:
        yield made


def wired(system: System, path: Path, **limits: object) -> System:
    """The FMU between two that do nothing wrong."""
    good = build(2, path.parent, "step", "nothing")
    system.add("before", good)
    takes_forever = ENDS.get(path.stem.rpartition("_")[2], "").startswith("step_timeout")
    timeout = PATIENCE if takes_forever else NEVER
    system.add("bad", path, isolated=True, **{"step_timeout": timeout, "memory_limit": 100_000_000, **limits})  # type: ignore[arg-type]
    system.add("after", good)
    system.connect("before.y", "bad.u")
    system.connect("bad.y", "after.u")
    return system


def run(system: System) -> None:
    system.allow_unconnected = True
    system.run(0.02, record=["before.y", "bad.y", "after.y"])


def words(deed: str) -> str:
    return {**ENDS, **LIES}[deed]


def check(error: ComponentError, phase: str, deed: str) -> None:
    assert error.component == "bad"
    assert re.search(words(deed), str(error)), error
    assert re.search(FUNCTIONS[phase], error.function), error
    if deed in ENDS:
        assert error.status == "lost"
    if phase == "step":
        assert error.time == pytest.approx(0.009)
        assert error.recording is not None
        assert error.recording["bad.y"][:9].tolist() == pytest.approx([*range(9)], abs=0.1)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("deed", [*ENDS, *LIES])
def test_a_bad_deed_in_a_step_is_an_error_that_names_it(system: System, folder: Path, version: int, deed: str) -> None:
    with pytest.raises(ComponentError) as caught:
        run(wired(system, build(version, folder, "step", deed)))
    check(caught.value, "step", deed)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("phase", [p for p in PHASES[: PHASES.index("terminate")] if p not in ("step",)])
def test_a_crash_in_any_phase_is_an_error_that_names_the_function(
    system: System, folder: Path, version: int, phase: str
) -> None:
    with pytest.raises(ComponentError) as caught:
        run(wired(system, build(version, folder, phase, "segfault")))
    check(caught.value, phase, "segfault")


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("phase", ["terminate", "free"])
@pytest.mark.parametrize("deed", ["abort", "hang"])
def test_a_loss_after_the_last_step_is_a_warning(folder: Path, version: int, phase: str, deed: str) -> None:
    with pytest.warns(IsolationCrashedWarning, match=FUNCTIONS[phase]), System(allow_unconnected=True) as system:
        recording = wired(system, build(version, folder, phase, deed)).run(0.02, record=["bad.y"])
    assert recording["bad.y"][-1] > 19


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("deed", HARMLESS)
def test_what_hurts_nobody_passes(system: System, folder: Path, version: int, deed: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run(wired(system, build(version, folder, "step", deed)))


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("phase", ["save", "restore", "size", "serialize", "deserialize"])
@pytest.mark.parametrize("deed", ["segfault", "hang"])
def test_a_loss_while_a_state_is_handled_is_an_error(
    system: System, folder: Path, version: int, phase: str, deed: str
) -> None:
    wired(system, build(version, folder, phase, deed))
    system.allow_unconnected = True
    simulation = system.initialize(record=["bad.y"])
    simulation.advance(0.005)
    component = system["bad"].implementation

    def there_and_back() -> None:
        simulation.restore(simulation.save())
        component.deserialize(component.serialize())  # type: ignore[attr-defined]

    with pytest.raises(CosimError, match=FUNCTIONS[phase]) as caught:
        there_and_back()
    assert re.search(words(deed), str(caught.value))


@pytest.mark.parametrize("version", VERSIONS)
def test_memory_that_is_overwritten_hurts_only_who_did_it(system: System, folder: Path, version: int) -> None:
    with pytest.raises(ComponentError) as caught:
        run(wired(system, build(version, folder, "step", "scribble")))
    assert caught.value.component == "bad"
    assert caught.value.recording is not None


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux gives detached processes to the one that watches")
@pytest.mark.parametrize("end", ["lost", "closed"])
@pytest.mark.filterwarnings("ignore::cosim.IsolationCrashedWarning")
def test_detached_processes_end_with_their_fmu(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str
) -> None:
    """Whether it is the master that ends the FMU, or the FMU itself."""
    proof = tmp_path / "pid"
    monkeypatch.setenv("HOSTILE_PROOF", str(proof))
    with System() as system:
        run(wired(system, build(3, folder, "step", "detach")))
        pid = int(proof.read_text())
        os.kill(pid, 0)  # it is there
        if end == "lost":
            launcher = system["bad"].implementation._library._process.pid  # type: ignore[attr-defined]
            (worker,) = (child for child in children(launcher) if child != pid)
            os.kill(worker, signal.SIGKILL)
            assert gone(pid)
    assert gone(pid)


@pytest.mark.parametrize("version", VERSIONS)
def test_the_others_can_be_used_again(system: System, folder: Path, version: int) -> None:
    wired(system, build(version, folder, "step", "segfault"))
    for _ in range(3):
        with pytest.raises(ComponentError):
            run(system)
    system["bad"].implementation.fmu = type(system["bad"].implementation.fmu)(build(version, folder, "step", "nothing"))  # type: ignore[attr-defined]
    run(system)


@pytest.mark.full
@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("phase", PHASES[: PHASES.index("terminate")])
@pytest.mark.parametrize("deed", [*ENDS, *LIES])
def test_every_deed_in_every_phase(system: System, folder: Path, version: int, phase: str, deed: str) -> None:
    if phase in ("load", "instantiate") and deed in ("words", *LIES):
        phase = "enter"  # nobody can speak, and there is no status yet
    if phase in STEPPING and deed in LIES and phase != "step":
        phase = "step"
    with pytest.raises(CosimError) as caught:
        run(wired(system, build(version, folder, phase, deed)))
    assert re.search(words(deed), str(caught.value)) or deed in LIES, caught.value


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("isolated", [False, True])
def test_a_state_of_any_size_is_refused_before_room_is_made_for_it(
    system: System, folder: Path, version: int, isolated: bool
) -> None:
    component: Any = system.add("bad", build(version, folder, "size", "huge"), isolated=isolated).implementation
    system.allow_unconnected = True
    system.initialize(record=[])
    with pytest.raises(CosimError, match="1,152,921,504,606,846,976 bytes"):
        component.serialize()


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize(("phase", "function"), [("late-set", "Set(Real|Float64)"), ("late-get", "Get(Real|Float64)")])
@pytest.mark.parametrize("deed", ["segfault", "sleep"])
def test_the_function_that_was_called_is_named_also_when_it_travels_with_a_step(
    system: System, folder: Path, version: int, phase: str, function: str, deed: str
) -> None:
    with pytest.raises(ComponentError) as caught:
        run(wired(system, build(version, folder, phase, deed)))
    assert re.fullmatch(f"fmi{version}{function}", caught.value.function), caught.value


def test_after_a_loss_nothing_of_it_is_called(system: System, folder: Path, raises) -> None:
    wired(system, build(3, folder, "step", "segfault"))
    with pytest.raises(ComponentError):
        run(system)
    component: Any = system["bad"].implementation
    outputs = list(component.description.outputs.values())
    for call in (lambda: component.get(outputs), component.serialize, component.save):
        with raises(CosimError):
            call()


def test_memory_that_is_shrunk_there_is_refused(system: System, folder: Path) -> None:
    run(wired(system, build(3, folder, "step", "shrink")))


def test_what_it_prints_before_it_crashes_is_there(folder: Path) -> None:
    code = f"""
from cosim import System
with System(allow_unconnected=True) as system:
    system.add("bad", {str(build(2, folder, "step", "print"))!r}, isolated=True)
    try:
        system.run(0.02)
    except Exception as error:
        print(type(error).__name__)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["this was printed", "ComponentError"]


def test_what_it_has_started_ends_with_it(system: System, folder: Path) -> None:
    run(wired(system, build(2, folder, "step", "child")))
    launcher = system["bad"].implementation._library._process.pid  # type: ignore[attr-defined]
    (worker,) = children(launcher)
    (child,) = children(worker)
    system.close()
    assert all(gone(pid) for pid in (launcher, worker, child))


def test_a_refused_component_is_not_in_the_system(system: System, harmless: Path) -> None:
    for wrong in ({"isolated": True, "step_timeout": -1.0}, {"step_timeout": 1.0}):
        with pytest.raises(ValueError, match="step_timeout"):
            system.add("a", harmless, **wrong)  # type: ignore[arg-type]
    system.add("a", harmless, isolated=True)
