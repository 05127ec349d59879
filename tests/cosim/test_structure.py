"""Structural parameters: sizes of arrays that are set when a component is added."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign import making, pulses
from pages import ROOT

from cosim import ComponentError, CosimError, System, SystemState, WiringError

EXAMPLES = str(ROOT / "docs" / "examples" / "fmi3")


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    sys.path.insert(0, EXAMPLES)
    try:
        from small_fmu import build
        from structural_parameters import SUMS
    finally:
        sys.path.remove(EXAMPLES)
    return build("running_sums", SUMS, tmp_path_factory.mktemp("structure"))


def sums(fmu: Path, n: int, **options: Any) -> System:
    system = System()
    system.add("c", fmu, step=1, parameters={"n": n}, start={"u": np.arange(1.0, n + 1.0)}, **options)
    return system


@pytest.mark.parametrize("isolated", [False, True])
@pytest.mark.parametrize("n", [1, 3, 16])
def test_arrays_have_the_size_that_is_given(fmu: Path, n: int, isolated: bool) -> None:
    with sums(fmu, n, isolated=isolated) as system:
        for _ in range(2):  # after a reset too
            found = system.run(1, record=["c.sum", "c.n"])
            assert [found[f"c.sum[{i + 1}]"][-1] for i in range(n)] == np.cumsum(np.arange(1.0, n + 1.0)).tolist()
            assert found["c.n"].tolist() == [float(n)] * 2
        assert len(system["c"].description.arrays["u"]) == n


def test_one_file_has_several_sizes_in_a_system(fmu: Path) -> None:
    with sums(fmu, 4) as system:
        system.add("own", fmu, step=1, start={"u": [1.0, 1.0, 1.0]})
        system.add("more", fmu, step=1, parameters={"n": 4})
        system.connect("c.sum", "more.u")
        found = system.run(2, record=["own.sum", "more.sum"])
        with pytest.raises(WiringError, match=r"c\.sum has 4 element\(s\), own\.u has 3"):
            system.connect("c.sum", "own.u")
    assert [found[f"own.sum[{i}]"][-1] for i in (1, 2, 3)] == [1.0, 2.0, 3.0]
    assert [found[f"more.sum[{i}]"][-1] for i in (1, 2, 3, 4)] == [1.0, 4.0, 10.0, 20.0]


def test_matrices_of_other_shapes_are_not_connected(fmu: Path, tmp_path: Path) -> None:
    """They may have the same number of elements."""
    square = b'<Dimension valueReference="0"/>'
    more = tmp_path / "Matrices.fmu"
    size = b'<UInt64 name="m" valueReference="51" causality="structuralParameter" variability="fixed" start="3"/>'
    with System(allow_unconnected=True) as system:
        first = b'<Float64 name="u"'
        making.redescribed(fmu, more, (square, square + b'<Dimension valueReference="51"/>'), (first, size + first))
        system.add("a", more, step=1, parameters={"n": 4, "m": 2})
        system.add("b", more, step=1, parameters={"n": 2, "m": 4})
        with pytest.raises(WiringError, match=r"a\.sum has 4 x 2 elements, b\.u has 2 x 4: connect element by element"):
            system.connect("a.sum", "b.u")
        assert len(system.connect("a.sum", "a.u")) == 8


def test_the_size_of_the_fmu_itself_changes_nothing(fmu: Path, tmp_path: Path) -> None:
    with sums(fmu, 3) as system:
        assert system.export_fmu(tmp_path / "System.fmu").is_file()


def test_states_belong_to_one_size(fmu: Path) -> None:
    with sums(fmu, 4) as system, system.initialize() as simulation:
        simulation.advance(1)
        state = simulation.save()
        simulation.advance(2)
        simulation.restore(state)
    with sums(fmu, 5) as other, pytest.raises(CosimError):
        other.initialize(state=state)
    assert isinstance(state, SystemState)


def test_what_cannot_be_set_is_refused(fmu: Path, tmp_path: Path, refused: Callable[..., None]) -> None:
    with sums(fmu, 4) as system:
        refused(
            CosimError,
            lambda: system["c"].set(n=5),
            lambda: system.add("d", fmu, step=1, parameters={"n": 17}),
            lambda: system.add("d", fmu, step=1, parameters={"n": 2.5}),
            lambda: system.add("d", fmu, step=1, parameters={"n": 4}, start={"u": [1.0]}),
            lambda: system.export_fmu(tmp_path / "System.fmu"),
            lambda: system.export_ssp(tmp_path / "System.ssp"),
        )


def test_an_fmu_that_refuses_configuration_mode_ends_the_run(tmp_path: Path) -> None:
    path = making.redescribed(
        pulses.build(tmp_path),
        tmp_path / "Refuses.fmu",
        (
            b'<Float64 name="x"',
            b'<UInt64 name="n" valueReference="50" causality="structuralParameter" variability="fixed" start="2"/>'
            b'<Float64 name="x"',
        ),
    )
    with System(allow_unconnected=True) as system:
        system.add("c", path, step="10 ms", parameters={"n": 3})
        with pytest.raises(ComponentError, match="'c': fmi3EnterConfigurationMode returned Error"):
            system.run(0.1)
