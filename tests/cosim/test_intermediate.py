"""Inputs that follow inside the steps of FMUs with intermediate update."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import run_exported
from foreign import following, making

from cosim import ComponentError, FmuWarning, PythonComponent, Recording, System


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return following.build(tmp_path_factory.mktemp("following"))


class Parabola(PythonComponent):
    """t^2."""

    outputs = ("y",)

    def step(self, t, h, u, y):  # noqa: ARG002
        y[0] = (t + h) ** 2


class Ramp(Parabola):
    """3 t."""

    def step(self, t, h, u, y):  # noqa: ARG002
        y[0] = 3.0 * (t + h)


class Steps(PythonComponent):
    """t, from sample to sample."""

    kind = "discrete"
    outputs = ("y",)

    def step(self, t, h, u, y):  # noqa: ARG002
        y[0] = t


def run(
    path: Path,
    kind: str = "follows",
    source: PythonComponent | None = None,
    *,
    extrapolate: bool = True,
    target: str = "c.u",
    **options: bool,
) -> Recording:
    """Steps of 0.1 s of an integrator; the source has steps of 0.1 s too."""
    with System(allow_unconnected=True) as system:
        system.add("source", source or Ramp(), step="0.1 s")
        system.add("c", path, step="0.1 s", parameters={"kind": following.KINDS.index(kind)}, **options)
        system.connect("source.y", target, extrapolate=extrapolate)
        return system.run(1.0, record=["c.*", "source.y"])


def value(system: System, name: str) -> float:
    """What a variable of the component `c` is now."""
    component = system.components["c"].implementation
    return component.get([component.description.variables[name]])[0]


@pytest.mark.parametrize("isolated", [False, True])
def test_inputs_are_computed_in_the_rounding_mode_of_the_caller(fmu: Path, isolated: bool) -> None:
    """Whatever the FMU has at its callback, where it finds its own again."""
    found, right = (run(fmu, kind, isolated=isolated) for kind in ("upward", "follows"))
    for name in ("c.x", "c.y", "c.energy", "c.asked"):
        np.testing.assert_array_equal(found[name], right[name])


def test_an_input_follows_a_ramp_inside_the_step(fmu: Path) -> None:
    """The integral of 3 t, from the second step on: the first one does not know the slope."""
    found = run(fmu)
    t = found.time
    assert np.allclose(found["c.x"][1:], 1.5 * t[1:] ** 2 - 0.015, rtol=0, atol=1e-12)
    assert np.allclose(found["c.y"][2:], 3.0 * t[2:], rtol=0, atol=1e-12)
    assert found["c.asked"].tolist() == [10 * k for k in range(11)]


def test_the_exchange_is_of_second_order(fmu: Path) -> None:
    """Of t^2, the line through two points gives x to h^2; a value that is held, to h."""
    exact, errors = 1.0 / 3.0, {}
    for extrapolate in (True, False):
        for n in (10, 20):
            with System(allow_unconnected=True) as system:
                system.add("source", Parabola(), step=f"{1 / n} s")
                system.add("c", fmu, step=f"{1 / n} s")
                system.connect("source.y", "c.u", extrapolate=extrapolate)
                errors[extrapolate, n] = abs(system.run(1.0, record=["c.x"])["c.x"][-1] - exact)
    assert 3.5 < errors[True, 10] / errors[True, 20] < 4.5
    assert 1.8 < errors[False, 10] / errors[False, 20] < 2.2


def test_an_input_that_is_not_extrapolated_is_held(fmu: Path) -> None:
    found = run(fmu, extrapolate=False)
    assert np.allclose(found["c.y"][1:], found["source.y"][:-1], rtol=0, atol=1e-15)
    assert found["c.asked"][-1] == 100, "it has asked, and got nothing"


def test_other_inputs_have_the_value_of_the_middle(fmu: Path) -> None:
    with System(allow_unconnected=True) as system:
        system.add("source", Ramp(), step="0.1 s")
        system.add("c", fmu, step="0.1 s")
        system.connect("source.y", "c.free", extrapolate=True)
        with system.initialize(record=["c.asked"]) as simulation:
            simulation.advance(0.5)
            assert value(system, "free") == pytest.approx(3.0 * 0.45)


SHOWN = ("c.x", "c.y", "c.xs[1]", "c.xs[2]", "c.xs[3]", "c.energy", "c.asked", "b.x")


def of_fmus(fmu: Path, kind: str = "follows") -> System:
    """3 t of `a` follows in `b`, and the parabola of `b` in `c`, whose array has elements that are held and free."""
    system = System(allow_unconnected=True)
    system.add("a", fmu, step="0.05 s", start={"u": 3.0})
    system.add("b", fmu, step="0.1 s")
    system.add("c", fmu, step="0.1 s", parameters={"kind": following.KINDS.index(kind)}, start={"w[3]": 5.0})
    system.connect("a.x", "b.u", extrapolate=True)
    system.connect("b.x", "c.u", extrapolate=True, linear=(2.0, 1.0))
    system.connect("b.x", "c.w[1]", extrapolate=True)
    system.connect("a.x", "c.w[2]")
    return system


@pytest.mark.parametrize("divided", [False, True])
def test_inputs_follow_in_exported_systems_with_the_same_bits(fmu: Path, tmp_path: Path, divided: bool) -> None:
    """Also where the steps of the FMUs may end early; and after a state is restored."""
    if divided:
        early = b' mightReturnEarlyFromDoStep="true" providesIntermediateUpdate="true"'
        fmu = making.redescribed(fmu, tmp_path / "Early.fmu", (b' providesIntermediateUpdate="true"', early))
    with of_fmus(fmu) as system:
        path = system.export_fmu(tmp_path / "Followers.fmu", outputs=[*SHOWN])
        expected = system.run(1.0, record=[*SHOWN])
    found = run_exported(path, "0.1 s", 0.5, 0.8, 1.0)
    assert expected["c.asked"][-1] == 100
    assert expected["c.xs[3]"][-1] == pytest.approx(5.0)
    assert expected["b.x"][-1] == pytest.approx(1.5 - 0.015, abs=1e-12), "the first step does not know the slope"
    for n in SHOWN:
        assert np.array_equal(found[n], expected[n][::2]), n


def test_an_exported_system_names_the_component_that_asks_wrongly(fmu: Path, tmp_path: Path, refused) -> None:
    def run_exported(kind: str) -> None:
        with of_fmus(fmu, kind) as system:
            path = system.export_fmu(tmp_path / f"{kind}.fmu")
        with System(allow_unconnected=True) as system:
            system.add("s", path, step="0.1 s")
            system.run(0.2, record=[])

    refused(ComponentError, *(lambda kind=kind: run_exported(kind) for kind in ("late", "unsettable")))


def test_units_are_converted_on_the_line(fmu: Path) -> None:
    with System(allow_unconnected=True) as system:
        system.add("source", Ramp(), step="0.1 s")
        system.add("c", fmu, step="0.1 s")
        system.connect("source.y", "c.u", extrapolate=True, linear=(-2.0, 1.0))
        found = system.run(1.0, record=["c.y"])
    assert np.allclose(found["c.y"][2:], 1.0 - 6.0 * found.time[2:], rtol=0, atol=1e-12)


def of_arrays(fmu: Path, **options: Any) -> Recording:
    """`w[1]` and `u` follow t^2, `w[2]` holds 3 t, and nothing drives `w[3]`, which becomes 8 at 0.5 s."""
    with System(allow_unconnected=True) as system:
        system.add("square", Parabola(), step="0.1 s")
        system.add("ramp", Ramp(), step="0.1 s")
        system.add("c", fmu, step="0.1 s", **options)
        system.connect("square.y", "c.w[1]", extrapolate=True, linear=(2.0, 1.0))
        system.connect("ramp.y", "c.w[2]")
        system.connect("square.y", "c.u", extrapolate=True, linear=(2.0, 1.0))
        with system.initialize(record=["c.xs[*]", "c.x", "ramp.y"]) as simulation:
            simulation.advance(0.5)
            simulation.set("c.w[3]", 8.0)
            simulation.advance(1.0)
            return simulation.recording


def test_arrays_follow_element_by_element(fmu: Path) -> None:
    found = of_arrays(fmu)
    assert np.array_equal(found["c.xs[1]"], found["c.x"]), "as a scalar does"
    held = 0.1 * np.cumsum(found["ramp.y"][:-1])
    assert np.allclose(found["c.xs[2]"][1:], held, rtol=0, atol=1e-12)
    t = found.time
    assert np.allclose(found["c.xs[3]"], np.where(t < 0.55, 7.0 * t, 3.5 + 8.0 * (t - 0.5)), rtol=0, atol=1e-12)
    apart = of_arrays(fmu, isolated=True)
    assert all(np.array_equal(found[n], apart[n]) for n in found.names)


def test_whole_arrays_follow_in_repeated_and_saved_runs(fmu: Path) -> None:
    """States of such a component are saved by the engine."""
    with System(allow_unconnected=True) as system:
        for i, source in enumerate((Parabola(), Ramp(), Parabola()), start=1):
            system.add(f"s{i}", source, step="0.1 s")
        system.add("c", fmu, step="0.1 s")
        for i in (1, 2, 3):
            system.connect(f"s{i}.y", f"c.w[{i}]", extrapolate=True)
        first, second = (system.run(1.0, record=["c.xs[*]"]) for _ in range(2))
        with system.initialize(record=["c.xs[*]"]) as simulation:
            simulation.advance(0.5)
            state = simulation.save()
            simulation.advance(0.8)
            simulation.restore(state)
            simulation.advance(1.0)
            third = simulation.recording
    assert np.allclose(first["c.xs[2]"][1:], 1.5 * first.time[1:] ** 2 - 0.015, rtol=0, atol=1e-12)
    assert np.array_equal(first["c.xs[1]"], first["c.xs[3]"])
    assert np.array_equal(first.data, second.data)
    assert np.array_equal(first.data, third.data)


def in_tolerance(path: Path, **options: bool) -> Recording:
    """With a tolerance: `u` and `w[2]` follow a ramp, `w[1]` is of a discrete component, and nothing drives `w[3]`."""
    with System(allow_unconnected=True) as system:
        system.add("ramp", Ramp(), step="0.05 s")
        system.add("held", Steps(), step="0.25 s")
        system.add("c", path, step="0.05 s", **options)
        system.connect("ramp.y", "c.u", linear=(2.0, 1.0))
        system.connect("ramp.y", "c.w[2]", linear=(2.0, 1.0))
        system.connect("held.y", "c.w[1]")
        return system.run(1.0, record=["c.x", "c.xs[*]", "c.energy", "c.asked"], tolerance=1e-3)


def test_inputs_follow_in_runs_with_a_tolerance(fmu: Path, tmp_path: Path) -> None:
    """The square of a line is integrated as such, and not as that of its middle; isolated with the same bits."""
    found, apart = in_tolerance(fmu), in_tolerance(fmu, isolated=True)
    assert found["c.x"][-1] == pytest.approx(1.0 + 3.0, abs=1e-12)
    assert found["c.xs[2]"][-1] == found["c.x"][-1]
    assert found["c.xs[1]"][-1] == pytest.approx(0.25 * (0.0 + 0.25 + 0.5 + 0.75), abs=1e-12)
    assert found["c.xs[3]"][-1] == pytest.approx(7.0, abs=1e-12)
    exact = 1.0 + 6.0 + 12.0  # of (1 + 6 t)^2
    attributes = (b' intermediateUpdate="true"', b""), (b' providesIntermediateUpdate="true"', b"")
    middle = in_tolerance(making.redescribed(fmu, tmp_path / "Middle.fmu", *attributes))
    errors = [abs(r["c.energy"][-1] - exact) for r in (found, middle)]
    assert errors[0] < 0.05 * errors[1]
    assert middle["c.asked"][-1] == 0
    assert all(np.array_equal(found[n], apart[n]) for n in found.names)


def test_repeated_runs_and_saved_states_are_alike(fmu: Path) -> None:
    with System(allow_unconnected=True) as system:
        system.add("source", Ramp(), step="0.1 s")
        system.add("c", fmu, step="0.1 s")
        system.connect("source.y", "c.u", extrapolate=True)
        first, second = (system.run(1.0, record=["c.x"])["c.x"] for _ in range(2))
        with system.initialize(record=["c.x"]) as simulation:
            simulation.advance(0.5)
            state = simulation.save()
            simulation.advance(0.8)
            simulation.restore(state)
            simulation.advance(1.0)
            assert value(system, "x") == first[-1]
    assert np.array_equal(first, second)


def test_isolated_fmus_give_the_same_bits(fmu: Path) -> None:
    here, there = run(fmu, source=Parabola()), run(fmu, source=Parabola(), isolated=True)
    assert all(np.array_equal(here[n], there[n]) for n in here.names)


@pytest.mark.parametrize("isolated", [False, True])
@pytest.mark.parametrize("kind", ["outside", "no_pointers"])
def test_callbacks_outside_of_steps_or_without_places_do_no_harm(fmu: Path, kind: str, isolated: bool) -> None:
    found = run(fmu, kind, isolated=isolated)
    assert np.array_equal(found["c.x"], run(fmu)["c.x"])


@pytest.mark.parametrize("isolated", [False, True])
@pytest.mark.parametrize("kind", ["silent", "reads"])
def test_an_fmu_that_never_asks_is_warned_of(fmu: Path, kind: str, isolated: bool, warns) -> None:
    with warns(FmuWarning):
        found = run(fmu, kind, isolated=isolated)
    assert np.allclose(found["c.y"][1:], found["source.y"][:-1], rtol=0, atol=1e-15), "of the begin of each step"


@pytest.mark.parametrize("isolated", [False, True])
@pytest.mark.parametrize("kind", ["not_a_time", "late", "unsettable"])
def test_what_it_asks_wrongly_ends_the_run_in_a_sentence(fmu: Path, kind: str, isolated: bool, raises) -> None:
    with raises(ComponentError):
        run(fmu, kind, isolated=isolated)


def test_a_crash_in_the_callback_ends_an_isolated_fmu_only(fmu: Path) -> None:
    with pytest.raises(ComponentError, match="signal 11"):
        run(fmu, "crashes", isolated=True)


@pytest.mark.parametrize("allowed", [False, True])
def test_a_step_that_has_failed_ends_early_where_that_is_allowed(tmp_path: Path, allowed: bool) -> None:
    """The FMU is asked to return from its step at the first part of it, and does so only if it is able to."""
    with System(allow_unconnected=True) as system:
        system.add("source", Ramp(), step="0.1 s")
        fmu = following.build(tmp_path, early_return=allowed)
        system.add("c", fmu, step="0.1 s", parameters={"kind": following.KINDS.index("unsettable")})
        system.connect("source.y", "c.u", extrapolate=True)
        with system.initialize(record=["c.x"]) as simulation:
            with pytest.raises(ComponentError, match="SetFloat64 returned Error"):
                simulation.advance(0.1)
            assert value(system, "early") == int(allowed)
            assert value(system, "asked") == (1 if allowed else 10)
