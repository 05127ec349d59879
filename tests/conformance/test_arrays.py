"""FMUs built with real FMI 3.0 arrays have the same numbers under fewer names."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from api import Library, Signals
from built import PROBE_NAMES, BuiltFmus
from fmpy.validation import validate_fmu
from lxml import etree

from cosim import System
from cosim.fmu.file import FmuFile
from cosim.fmu.validation import Verdict

SCHEMA = Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"


@pytest.fixture(params=PROBE_NAMES)
def both(
    request: pytest.FixtureRequest, built_fmus: BuiltFmus, load: Callable[[str, int], Library]
) -> tuple[Path, Library]:
    """The array build of a test component, and its scalar build."""
    return built_fmus.path(request.param, 3, arrays=True), load(request.param, 3)


def test_validates_without_finding(both: tuple[Path, Library]) -> None:
    path, scalars = both
    assert validate_fmu(str(path)) == []
    assert FmuFile(path, strict=True).verdict == Verdict()
    arrays = Library(path)
    assert arrays.token != scalars.token
    etree.XMLSchema(file=str(SCHEMA)).assertValid(
        etree.parse(arrays.folder / "terminalsAndIcons" / "terminalsAndIcons.xml")
    )


def test_dimensions_hold_the_elements(both: tuple[Path, Library]) -> None:
    path, scalars = both
    expanded = []
    for variable in fmpy.read_model_description(str(path)).modelVariables:
        shape = variable.shape or ()
        base = variable.name
        for index in np.ndindex(*shape):
            place = ",".join(str(i + 1) for i in index)
            expanded.append(
                f"der({base[4:-1]}[{place}])"
                if shape and base.startswith("der(")
                else f"{base}[{place}]"
                if shape
                else base
            )
    assert expanded == scalars.order


def test_same_numbers(both: tuple[Path, Library]) -> None:
    """Inputs held, because FMPy takes no signals for array inputs of different shapes.

    To rounding, because the step sizes it passes are differences of times.
    """
    path, scalars = both
    steps, h, row = 60, scalars.step, scalars.stimulus.row(20)
    start: dict[str, Any] = {}
    for v in fmpy.read_model_description(str(path)).modelVariables:
        if v.causality == "input":
            values = [row[n] for n in elements(v.name, v.shape or ())]
            start[v.name] = values if v.shape else values[0]
    result = fmpy.simulate_fmu(
        str(path), fmi_type="CoSimulation", stop_time=steps * h, output_interval=h, start_values=start
    )
    with scalars.instance() as a:
        a.initialize(row)
        held = Signals(np.zeros(1), np.array([list(row.values())]), list(row))
        rows = np.vstack([a.get(scalars.outputs), a.run(steps, held)])
    expected = dict(zip(scalars.outputs, rows.T, strict=True))
    for n in result.dtype.names[1:]:
        columns = result[n].astype(float).reshape(steps + 1, -1)
        for name, column in zip(elements(n, result[n].shape[1:]), columns.T, strict=True):
            np.testing.assert_allclose(column, expected.pop(name), rtol=1e-12, atol=1e-12, err_msg=name)
    assert not expected


def elements(name: str, shape: tuple[int, ...]) -> list[str]:
    """Scalar names of an array variable, last index fastest."""
    return [f"{name}[{','.join(str(i + 1) for i in index)}]" if index else name for index in np.ndindex(*shape)]


@pytest.fixture
def oscillator(built_fmus: BuiltFmus) -> Iterator[System]:
    """The array build of a test component in a system of its own, its inputs set."""
    if "ProbeRk4" not in PROBE_NAMES:
        pytest.skip("FMUS_UNDER_TEST leaves it out")
    start = {"force": 0.0, "corner.fl.kick": [0.0, 0.0, 0.0], "brake": False, "gear": 1}
    with System() as system:
        system.add("mass", built_fmus.path("ProbeRk4", 3, arrays=True), step="10 ms", start=start)
        yield system


def lags(system: System) -> list[float]:
    """The time constants as initialization has taken them."""
    simulation = system.initialize(record=["mass.lag"])
    return [simulation[f"mass.lag[{i}]"] for i in (1, 2, 3)]


def test_one_element_is_set_before_initialization(oscillator: System) -> None:
    """The others keep their start values; an FMU may not be asked for them yet."""
    assert lags(oscillator) == [0.05, 0.1, 0.2]
    oscillator["mass"].set({"lag[2]": 0.5})
    assert lags(oscillator) == [0.05, 0.5, 0.2]
    oscillator["mass"].set({"corner.fl.kick[3]": 2.0})
    assert oscillator.initialize()["mass.x"] == pytest.approx(-2.0 / 150.0)


def test_elements_go_to_their_places_in_any_order(oscillator: System) -> None:
    oscillator["mass"].set({"lag[3]": 0.3, "lag[1]": 0.4})
    assert lags(oscillator) == [0.4, 0.1, 0.3]
    oscillator["mass"].set({"lag[2]": 0.6})
    assert lags(oscillator) == [0.4, 0.6, 0.3]


def test_elements_set_one_after_the_other_add_up(oscillator: System) -> None:
    component = oscillator["mass"].implementation
    of = component.description.variables
    lag = [of[f"lag[{i}]"] for i in (1, 2, 3)]
    component.instantiate("mass")
    component.set({lag[0]: 0.6})
    component.set({lag[1]: 0.7})
    component.enter_initialization(0.0, None)
    assert component.get(lag) == [0.6, 0.7, 0.2]
    component.instantiate("mass")  # reset: start values again
    component.set({lag[2]: 0.8})
    component.enter_initialization(0.0, None)
    component.set({of["corner.fl.kick[2]"]: 1.5})
    assert component.get([*lag, of["corner.fl.kick[2]"]]) == [0.05, 0.1, 0.8, 1.5]
