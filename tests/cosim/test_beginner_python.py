"""A beginner's mistakes in Python: each message names the thing and says what to do."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from pages import ROOT

from cosim import CosimError, Fmu, FmuError, PythonComponent, Recording, System
from cosim.fmu import find


class Spring(PythonComponent):
    """What the beginner wanted."""

    inputs = ("z [m]",)
    outputs = ("force [N]",)
    default_step = "1 ms"

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        y[0] = -100.0 * u[0]


def message(spring: Any = Spring, connections: tuple[tuple[str, str], ...] = (("car.body.z", "spring.z"),)) -> str:
    """How a system with a quarter car and a spring is refused, when it is put together or run."""
    with pytest.raises((CosimError, ValueError)) as refused:
        run(spring, connections)
    return str(refused.value)


def run(spring: Any = Spring, connections: tuple[tuple[str, str], ...] = (("car.body.z", "spring.z"),)) -> Recording:
    with System() as system:
        system.add("car", "QuarterCarBench", start={"force": 0.0, "road.height": 0.0, "road.rate": 0.0})
        system.add("spring", spring)
        for source, target in connections:
            system.connect(source, target)
        return system.run(0.01)


pytestmark = pytest.mark.usefixtures("workplace")


def test_the_system_of_these_mistakes_runs_without_them() -> None:
    assert len(run()) == 11


# ------------------------------------------------------------------------------------------------------ FMUs by name


def test_a_built_fmu_is_found_by_its_name(workplace: Path, raises) -> None:
    assert Fmu("QuarterCarBench").path == Path("fmus/fmi3/QuarterCarBench.fmu")
    with System() as system:
        for name, fmu in (("a", "QuarterCarBench"), ("b", "fmus/fmi3/QuarterCarBench.fmu")):
            system.add(name, fmu)
        assert len(system.fmu_files) == 1  # the same file, opened once
    (workplace / "mine").mkdir()
    with raises(FmuError):  # what lies there is a path
        Fmu("mine")


def test_a_mistyped_name_of_an_fmu(raises) -> None:
    with raises(FmuError):
        Fmu("QuarterCarBnch")


def test_a_name_with_nothing_close_lists_the_fmus() -> None:
    with pytest.raises(FmuError, match=r"'xyzzy' .*QuarterCarBench, .*TrenchCrossing"):
        Fmu("xyzzy")


def test_an_fmu_that_is_not_built(workplace: Path, monkeypatch: pytest.MonkeyPatch, raises) -> None:
    (workplace / "fmus").rename(workplace / "elsewhere")
    monkeypatch.setattr(find, "__file__", str(workplace / "cosim" / "fmu" / "find.py"))  # no checkout either
    with raises(FmuError):
        Fmu("QuarterCarBench")
    with pytest.raises(FmuError, match=r"no FMU 'xyzzy' \(`build-fmus` builds: BenchEncoders, "):
        Fmu("xyzzy")


# -------------------------------------------------------------------------------------------------- wiring and values


def test_input_and_output_exchanged(sentence) -> None:
    sentence(message(connections=(("car.force", "spring.force"),)))
    sentence(message(connections=(("car.body.mass", "spring.z"),)))


@pytest.mark.parametrize("given", ["500 kg", "0.5 t", "3 m"])
def test_a_number_with_its_unit_as_a_text(given: str, raises) -> None:
    with System() as system, raises(CosimError, match=f"'{given}'"):
        system.add("car", "QuarterCarBench", parameters={"body.mass": given})


def test_a_number_in_another_unit_is_converted_in_the_message(raises) -> None:
    with System() as system, raises(CosimError):
        system.add("car", "QuarterCarBench", start={"force": "1.5 kN"})


def test_a_stop_time_before_the_start(refused) -> None:
    with System() as system:
        system.add("spring", Spring, start={"z": 0.0})
        refused(CosimError, lambda: system.run(-1), lambda: system.run(1, start_time=2))


# ----------------------------------------------------------------------------------------------- components in Python


def test_an_unknown_unit() -> None:
    class Wrong(Spring):
        inputs = ("z [meter]",)

    assert "'meter'" in message(Wrong)


def test_a_unit_without_a_blank_before_it() -> None:
    class Wrong(Spring):
        inputs = ("z[m]",)

    assert "'z [m]'" in message(Wrong)


def test_a_component_without_step(sentence) -> None:
    class Wrong(PythonComponent):
        inputs, outputs, default_step = Spring.inputs, Spring.outputs, "1 ms"

    sentence(message(Wrong))


# --------------------------------------------------------------------------------------------------- an older Python


OLDER = "import sys, runpy; sys.version_info = (3, 10, 2); sys.argv = {!r}; {}"


@pytest.mark.parametrize("package", ["cosim", "build_fmus"])
def test_an_older_python_is_named_first(package: str) -> None:
    """As if it were one: nothing else of the project has been imported then."""
    run = f"sys.orig_argv = ['python', *sys.argv, '{package}']; runpy._run_module_as_main('{package}')"
    for code, start in (
        (OLDER.format(["-m"], run), "Python 3.11 or newer is needed; this is Python 3.10.2 ("),
        (OLDER.format(["x.py"], "import cosim"), "Traceback"),
    ):
        done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == 1
        assert done.stderr.startswith(start)
        assert "Python 3.11 or newer is needed; this is Python 3.10.2 (" in done.stderr.splitlines()[-1]
