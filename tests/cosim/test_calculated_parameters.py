"""Calculated parameters of one FMU that are parameters of another one, set in initialization."""

from __future__ import annotations

from pathlib import Path

import fmpy
import pytest
from fmpy.fmi1 import FMICallException
from foreign import calculating

from cosim import Recording, System, WiringError
from cosim.batch import Batch


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    folder = tmp_path_factory.mktemp("calculating")
    return {version: calculating.build(folder, version) for version in (2, 3)}


def chain(fmu: Path, *, texts: bool = True, **options: bool) -> System:
    """`c` before `b` before `a` by what follows from what, though not by their names. FMI 3.0 has bytes, too."""
    system = System()
    for name in ("b", "c", "a"):
        system.add(name, fmu, step="1 ms", **options)
    system["b"].set(p=4.0, factor=3.0, n=7)
    for ends in ("b.scaled -> c.p", "c.scaled -> a.p", "b.next -> c.n", "c.next -> a.n"):
        system.connect(*ends.split(" -> "))
    arrays = "sums" in system["b"].description.arrays
    if arrays:
        system["b"].set(q=[1.0, 2.0])
        system.connect("b.sums", "c.q")
        system.connect("c.sums[2]", "a.q[1]")
    if texts:
        system["b"].set(name="you", **({"key": b"\x01\x02\x00"} if arrays else {}))
        for ends in ("b.greeting -> c.name", "c.greeting -> a.name", *(["b.lock -> c.key"] if arrays else [])):
            system.connect(*ends.split(" -> "))
    return system


def pair(path: Path) -> System:
    """Two components, not connected."""
    system = System()
    for name in ("a", "b"):
        system.add(name, path, step="1 ms")
    return system


def run(system: System) -> Recording:
    seen = ["*.seen"] if "seen" in system["a"].description.outputs else []
    return system.run(0.002, record=["*.y", *seen])


def seen(q: tuple[float, float], text: bytes, key: bytes) -> float:
    """As the FMU computes it."""
    total = q[0] + 10.0 * q[1]
    for byte in text + key:
        total = 2.0 * total + byte
    return total


def refused(path: Path) -> str:
    """What an exported FMU logs when it does not initialize."""
    said: list[str] = []
    with pytest.raises(FMICallException, match="Initial"):
        fmpy.simulate_fmu(str(path), stop_time=0.002, logger=lambda *given: said.append(given[-1].decode()))
    return said[-1]


@pytest.mark.parametrize("isolated", [False, True])
@pytest.mark.parametrize("version", [2, 3])
def test_they_arrive_in_a_chain_with_units(fmus: dict[int, Path], version: int, isolated: bool) -> None:
    """12 g of `b` are 0.012 kg of `c`, of which 2 times as many are g of `a`."""
    with chain(fmus[version], isolated=isolated) as system:
        found = run(system)
        assert "b.scaled -> c.p (g to kg)" in str(system.schedule())
        again = run(system)
    mass = 3.0 * 4.0 * 0.001
    assert found["c.y"].tolist() == [pytest.approx(mass + 8000.0, abs=1e-12)] * 3
    assert found["a.y"].tolist() == [pytest.approx(mass * 2 * 0.001 + 9000.0, abs=1e-12)] * 3
    assert all((found[n] == again[n]).all() for n in found.names)
    if version == 3:
        assert found["c.seen"][-1] == seen((5.0, 6.0), b"hello you", b"\x00\x02\x01")
        assert found["a.seen"][-1] == pytest.approx(seen((6.0 + mass, 0.0), b"hello hello you", b""), abs=1e-9)


def test_what_was_passed_on_is_shown_and_cannot_be_set_in_a_run(fmus: dict[int, Path], raises) -> None:
    with chain(fmus[3]) as system, system.initialize(record=["c.p", "b.n"]) as simulation:
        assert simulation["c.p"] == pytest.approx(0.012)
        assert simulation["b.n"] == 7
        with raises(WiringError):
            simulation.set("c.p", 1.0)


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("version", [2, 3])
def test_an_exported_fmu_passes_them_on_alike(
    fmus: dict[int, Path], tmp_path: Path, version: int, fmi: int, raises
) -> None:
    """Also those that follow from a parameter that the importer of the FMU sets."""
    start = {"b.p": 5.5, "b.n": 1}
    with chain(fmus[version]) as system:
        if version == 3:  # exactly: a double does not hold what follows
            system["b"].set(large=2**53)
            system.connect("b.larger", "c.large")
            system.connect("c.larger", "a.large")
        path = system.export_fmu(tmp_path / "Chain.fmu", fmi=fmi)
        with raises(WiringError):
            system.export_fmu(tmp_path / "Chain.fmu", fmi=fmi, parameters=["c.p"])
        system["b"].set(p=5.5, n=1)
        expected = run(system)
    assert fmpy.supported_platforms(str(path))
    names = {v.name for v in fmpy.read_model_description(str(path)).modelVariables}
    assert "b.p" in names
    assert "c.p" not in names
    assert "c.name" not in names
    if version == 3:
        assert expected["a.seen"][-1] != expected["b.seen"][-1]
        assert expected["c.seen"][-1] == seen((6.5, 7.5), b"hello you", b"\x00\x02\x01") + (2**53 + 1) % 1000
    shown = fmpy.simulate_fmu(str(path), stop_time=0.002, output_interval=0.001, start_values=start)
    for name in expected.names:
        assert shown[name][-1] == expected[name][-1]


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("version", [2, 3])
def test_texts_follow_from_those_that_the_importer_of_an_exported_fmu_sets(
    fmus: dict[int, Path], tmp_path: Path, version: int, fmi: int
) -> None:
    with pair(fmus[version]) as system:
        system.connect("a.greeting", "b.name")
        path = system.export_fmu(tmp_path / "Texts.fmu", fmi=fmi)
        system["a"].set(name="wörld")
        expected = run(system)
    shown = fmpy.simulate_fmu(str(path), stop_time=0.002, output_interval=0.001, start_values={"a.name": "wörld"})
    assert expected["b.seen"][-1] == seen((0.0, 0.0), "hello wörld".encode(), b"")
    assert (shown["a.seen"][-1], shown["b.seen"][-1]) == (expected["a.seen"][-1], expected["b.seen"][-1])


def test_a_calculated_text_that_the_parameter_refuses_ends_an_exported_fmu(
    fmus: dict[int, Path], tmp_path: Path
) -> None:
    with pair(fmus[3]) as system:
        system["a"].set(name=60 * "x")
        system.connect("a.greeting", "b.name")
        path = system.export_fmu(tmp_path / "Long.fmu")
    assert "component 'b'" in refused(path)
    assert "setting a parameter" in refused(path)


@pytest.mark.parametrize("version", [2, 3])
def test_parameters_that_follow_from_each_other_end_in_a_sentence(
    fmus: dict[int, Path], tmp_path: Path, version: int, raises
) -> None:
    with pair(fmus[version]) as system:
        system.connect("a.next", "b.n")
        system.connect("b.next", "a.n")
        path = system.export_fmu(tmp_path / "Circle.fmu")
        with raises(WiringError):
            run(system)
    assert refused(path) == "calculated parameters do not settle: some follow from each other"


def test_a_circle_through_other_parameters_settles(fmus: dict[int, Path]) -> None:
    """What `a` calculates from `p` is a factor of `b`, and what `b` calculates from `n` is `n` of `a`."""
    with pair(fmus[2]) as system:
        system.connect("a.scaled", "b.factor", linear=(1.0, 0.0))
        system.connect("b.next", "a.n")
        found = system.run(0.001, record=["*.y"])
    assert found["a.y"][-1] == 1.0 + 1000.0 * 4


def test_a_value_that_the_parameter_cannot_have_is_refused(fmus: dict[int, Path], tmp_path: Path, raises) -> None:
    with chain(fmus[2]) as system:
        system["b"].set(p=90.0, factor=2000.0)
        path = system.export_fmu(tmp_path / "Large.fmu")
        with raises(WiringError):
            run(system)
    assert refused(path) == (
        "c.p would be 180, a value that it cannot have: change the parameters that it is calculated from"
    )


@pytest.mark.parametrize("factor", [0.3, 1e12])
def test_a_value_that_is_no_integer_of_the_type_is_refused(
    fmus: dict[int, Path], tmp_path: Path, factor: float, raises
) -> None:
    """4 times the factor, in a run and in an exported FMU."""
    with pair(fmus[2]) as system:
        system.connect("b.next", "a.n", linear=(factor, 0.0))
        path = system.export_fmu(tmp_path / "Scaled.fmu")
        with raises(WiringError):
            run(system)
    assert refused(path) == (
        f"a.n would be {4 * factor:g}, a value that it cannot have: change the parameters that it is calculated from"
    )


@pytest.mark.parametrize(
    ("ends", "options"),
    [
        (("b.y", "c.p"), {}),
        (("b.p", "c.p"), {}),
        (("b.next", "c.p"), {"delay": True}),
        (("b.greeting", "c.key"), {}),
        (("b.sums", "c.p"), {}),
        (("b.lock", "c.key"), {"max_size": 5}),
    ],
)
def test_connections_that_do_not_fit_are_refused(
    fmus: dict[int, Path], ends: tuple[str, str], options: dict[str, bool], raises
) -> None:
    with System() as system:
        for name in ("b", "c"):
            system.add(name, fmus[3], step="1 ms")
        with raises(WiringError):
            system.connect(*ends, **options)


def test_runs_with_a_tolerance_pass_them_on_and_batches_refuse_them(fmus: dict[int, Path], raises) -> None:
    with chain(fmus[3], texts=False) as system:
        expected = run(system)
        found = system.run(0.002, record=expected.names, tolerance=1e-3)
        assert all(found[n][-1] == expected[n][-1] for n in expected.names)
        with raises(WiringError):
            Batch(system, 2)


def test_a_state_keeps_what_was_passed_on(fmus: dict[int, Path]) -> None:
    with chain(fmus[2]) as system:
        with system.initialize(record=["c.y"]) as simulation:
            simulation.advance(0.001)
            state = simulation.save()
        with system.initialize(record=["c.y"], state=state) as simulation:
            assert simulation["c.y"] == pytest.approx(8000.012)
