"""FMUs built with real FMI 3.0 arrays have the same numbers under fewer names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from api import Library, Signals
from built import PROBE_NAMES, BuiltFmus
from fmpy.validation import validate_fmu
from lxml import etree

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
            expanded.append(f"der({base[4:-1]}[{place}])" if shape and base.startswith("der(") else
                            f"{base}[{place}]" if shape else base)  # fmt: skip
    assert expanded == scalars.order


def test_same_numbers(both: tuple[Path, Library]) -> None:
    """Inputs held, because FMPy takes no signals for array inputs of different shapes. To rounding, because the step
    sizes it passes are differences of times."""
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
