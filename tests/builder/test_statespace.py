"""Components that are linear models: matrices in, the same matrices out of the FMU."""

from pathlib import Path

import control
import numpy as np
import pytest
from built import OBJECTS

from build_fmus.compile import resolve_platforms
from build_fmus.component import Component, DeclarationError
from build_fmus.package import build_fmu
from cosim import Fmu

A, B = np.array([[0.9, 0.1], [-0.2, 0.7]]), np.array([[1.0, 0.0], [0.5, 2.0]])
C, D = np.array([[1.0, -3.0], [0.0, 2.0], [1.0, 0.0]]), np.array([[0.0, 4.0], [0.0, 0.0], [5.0, 0.0]])
SIGNALS = {"inputs": {"body.vz": "m/s", "body.z": "m"}, "outputs": {"force": "N", "other": None, "third": "W"}}
TEXT = {"description": "a law", "source": "test"}


def build(component: Component, folder: Path) -> Fmu:
    path = folder / f"{component.name}.fmu"
    path.write_bytes(build_fmu(component, 2, resolve_platforms("host"), OBJECTS))
    return Fmu(path)


@pytest.mark.parametrize("period", [0.01, None])
def test_the_fmu_is_the_state_space(period: float | None, tmp_path: Path) -> None:
    system = control.ss(A, B, C, D, period or 0)
    component = Component.from_statespace("Law", system, **SIGNALS, **TEXT)
    assert component.kind == ("discrete" if period else "continuous")
    model = build(component, tmp_path).linearize()
    assert model.dt == (period or 0)
    for name, expected in (("A", A), ("B", B), ("C", C), ("D", D)):
        np.testing.assert_allclose(getattr(model, name), expected, atol=1e-9)
    assert [model.names[n] for n in (*model.input_labels, *model.output_labels)] == [
        "body.vz",
        "body.z",
        "force",
        "other",
        "third",
    ]
    assert model.units["third"] == "W"


def test_zeros_of_the_direct_part_depend_on_nothing() -> None:
    """Else a strictly proper law would be an algebraic loop around a plant that shows its input at once."""
    component = Component.from_statespace("Law", (A, B, C, D), sample_time=0.01, **SIGNALS, **TEXT)
    dependencies = component.model().dependencies
    assert {n: dependencies[n] for n in ("force", "other", "third")} == {
        "force": ["body.z"],
        "other": [],
        "third": ["body.vz"],
    }


def test_names_and_units_come_from_the_system() -> None:
    named = control.ss(A, B, C, D, 0.01, inputs=["a", "b"], outputs=["c", "d", "e"])
    component = Component.from_statespace("Law", named, **TEXT)
    assert [e.name for e in component.model().elements("input")] == ["a", "b"]
    assert component.sample_time == 0.01
    gains = control.ss([], [], [], D)
    assert Component.from_statespace("Gains", gains, sample_time=0.02, **SIGNALS, **TEXT).sample_time == 0.02


@pytest.mark.parametrize(
    ("system", "options"),
    [
        (control.ss(A, B, C, D), {"sample_time": 0.01, **SIGNALS}),
        (control.ss(A, B, C, D, 0.02), {"sample_time": 0.01, **SIGNALS}),
        (control.ss(A, B, C, D, True), SIGNALS),
        ((A, B, C, D), {"sample_time": 0.01}),
        ((A, B, C.T, D), {"sample_time": 0.01, **SIGNALS}),
        (control.ss(A, B, C, D), {**SIGNALS, "inputs": {"one": "m"}}),
    ],
)
def test_what_does_not_fit_is_refused(system: object, options: dict[str, object], raises) -> None:
    with raises(DeclarationError):
        Component.from_statespace("Law", system, **options, **TEXT)  # type: ignore[arg-type]
