"""Wiring by name: units, types, nearest matches, parameters; every mistake is named."""

import re
import warnings
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from foreign.making import redescribed
from probes import Clock, Delta, Integrator

from build_fmus.base.units import KNOWN, Unit, UnitMismatchError, conversion
from cosim import CosimError, PythonComponent, Record, System, TimeError, UnconnectedInputsWarning, WiringError
from cosim.core.time import TimeBase, rational, seconds_text


class Road(PythonComponent):
    kind = "discrete"
    default_step = "1 ms"
    inputs = ("x [m]",)
    outputs = ("road.fl.height [mm]", "road.fr.height [m]", "preview.fl[1] [m]", "preview.fl[2] [m]", "speed [km/h]")

    def start(self, u, y):  # noqa: ARG002
        y[:] = 1000.0, 2.0, 3.0, 4.0, 36.0

    def step(self, t, h, u, y):  # noqa: ARG002
        self.start(u, y)


class Car(PythonComponent):
    default_step = "1 ms"
    inputs = ("road.fl.height [m]", "road.fr.height [m]", "preview.fl[1] [m]", "preview.fl[2] [m]", "speed [m/s]")
    outputs = ("x [m]", "body.az [m/s2]", "mass [kg]")
    parameters = {  # noqa: RUF012
        "k": 1.0,
        "on": True,
        "label": "a",
        **{f"gain[{i},{j}]": 0.0 for i in (1, 2) for j in (1, 2)},
    }

    def step(self, t, h, u, y): ...


pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")


def system():
    made = System()
    made.add("road", Road())
    made.add("car", Car())
    return made


def test_matching_names_are_connected_and_units_converted():
    s = system()
    made = s.connect_matching("road", "car", "road.*")
    assert [c.target_name for c in made] == ["car.road.fl.height", "car.road.fr.height"]
    s.connect("road.preview.fl", "car.preview.fl")
    s.connect("road.speed", "car.speed")
    result = s.run(0.002, record=["car.road.*", "car.preview.*", "car.speed"])
    np.testing.assert_allclose(result.data[-1], [1.0, 2.0, 3.0, 4.0, 10.0])
    assert result.units["car.speed"] == "m/s"
    assert "km/h to m/s" in str(s.schedule())
    np.testing.assert_allclose(s["car"].implementation._u, [1.0, 2.0, 3.0, 4.0, 10.0])


@pytest.mark.parametrize(
    ("source", "target"),
    [
        ("rod.x", "car.speed"),
        ("road.road.fl.heigth", "car.speed"),
        ("road.road.fl.height", "car.road.fl.hight"),
        ("road.x", "car.speed"),
        ("road.speed", "car.x"),
        ("car.mass", "road.x"),
        ("road", "car.speed"),
        ("road.preview.fl", "car.speed"),
    ],
)
def test_mistakes_in_connections(source, target, raises):
    with raises(WiringError):
        system().connect(source, target)


def test_an_input_has_one_source(raises):
    s = system()
    s.connect("car.x", "road.x")
    with raises(WiringError):
        s.connect("car.x", "road.x")


def test_connect_matching_without_a_match_lists_what_there_is():
    with pytest.raises(WiringError, match=r"fits 'wheel\.\*'.*inputs: road\.fl\.height"):
        system().connect_matching("road", "car", "wheel.*")


def test_connect_matching_connects_all_or_nothing():
    class Front(PythonComponent):
        outputs = ("a [m]", "b [s]")

    class Back(PythonComponent):
        inputs = ("a [m]", "b [kg]")

    s = System()
    s.add("front", Front(), step=1)
    s.add("back", Back(), step=1)
    with pytest.raises(WiringError, match=r"front\.b \[s\] -> back\.b \[kg\]"):
        s.connect_matching("front", "back")
    assert not s.connections
    assert [c.target_name for c in s.connect_matching("front", "back", "a")] == ["back.a"]


@pytest.mark.parametrize("fmi_type", ["String", "Binary"])
def test_texts_and_binaries_are_not_connected(fmi_type, raises):
    s = System()
    for name in ("a", "b"):
        component = Delta()
        about = component.description
        kind = "string" if fmi_type == "String" else "other"
        about.variables |= {n: replace(v, type=kind, fmi_type=fmi_type) for n, v in about.variables.items()}
        about.__post_init__()
        s.add(name, component, step=1)
    with raises(WiringError, match=f"{fmi_type}"):
        s.connect("a.y", "b.u")


def test_integers_that_doubles_do_not_hold_are_named(follower, warns):
    with System() as s:
        for name in ("a", "b"):
            s.add(name, follower[3], step="1 ms", kind="discrete", start={"int64_in": 2**53 - 2, "uint64_in": 0})
        s.connect("a.int64_out", "b.int64_in")
        s.allow_unconnected = True
        options = {"record": ["b.int64_out", "a.uint64_out"]}
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            s.run(0.01, **options)
        s["a"].set(int64_in=2**53 + 1)
        with warns(UserWarning):
            s.run(0.01, **options)
        s["a"].set(int64_in=0, uint64_in=2**64 - 1)
        with s.initialize(**options) as simulation, pytest.warns(UserWarning, match=r"^a\.uint64_out: integers"):
            assert len(simulation.recording) == 1


@pytest.mark.parametrize(
    ("step", "fits"), [("0.1 ms", True), (None, True), ("0.25 ms", False), ("0.05 ms", False), (0.1, True)]
)
def test_steps_that_the_fixed_internal_step_does_not_fit_are_warned_of(follower, tmp_path, step, fits):
    fixed = (b"<CoSimulation ", b'<CoSimulation fixedInternalStepSize="1e-4" ')
    path = redescribed(follower[3], tmp_path / "Fixed.fmu", fixed)
    with warnings.catch_warnings(record=True) as found, System() as s:
        warnings.simplefilter("always")
        assert s.add("a", path, step=step).step == (Fraction(1, 10_000) if step is None else rational(step))
    said = [str(w.message) for w in found if "fixed internal step" in str(w.message)]
    assert [t.split(":")[0] for t in said] == [] if fits else ["component 'a' (Follower3)"]


def test_type_mismatch(foreign, refused):
    s = system()
    s.add("foreign", foreign["AddOne2"], step=1)
    refused(
        WiringError, lambda: s.connect("road.speed", "foreign.enable"), lambda: s.connect("foreign.busy", "foreign.u")
    )


def test_unconnected_inputs_are_reported_unless_they_were_given_a_value(raises, warns):
    s = System()
    s.add("car", Car(), start={"speed": 3.0})
    s.add("road", Road(), start={"x": 0.0})
    s.connect_matching("road", "car", "road.*")
    assert s.check() == ["car.preview.fl[1]", "car.preview.fl[2]"]
    with pytest.warns(UnconnectedInputsWarning, match=r"car\.preview\.fl\[1\], car\.preview\.fl\[2\]"):
        s.run(0.001)
    with warns(UnconnectedInputsWarning):
        s.initialize()
    s.reset()
    with pytest.warns(UnconnectedInputsWarning), raises(CosimError):
        s.coupled_spectral_radius()


@pytest.mark.filterwarnings("error")
def test_unconnected_inputs_that_are_meant_so_are_not_reported(raises):
    s = System()
    s.add("car", Car(), start={"speed": 3.0})
    s.add("road", Road(), start={"x": 0.0})
    s.connect_matching("road", "car", "road.*")
    s.allow_unconnected = True
    assert len(s.run(0.001))
    s.allow_unconnected = True
    assert s.initialize().time_ns == 0
    s.reset()
    with raises(CosimError):
        s.coupled_spectral_radius()
    s.connect("road.preview.fl", "car.preview.fl")
    assert s.check() == []
    s.run(0.001)


@pytest.mark.parametrize(
    "values", [{"kk": 1}, {"k": "stiff"}, {"k": float("nan")}, {"on": 3}, {"x": 3}, {"gain": np.zeros((3, 2))}]
)
def test_mistakes_in_parameters(values, raises):
    with raises(WiringError):
        system()["car"].set(values)


def test_arrays_are_set_whole_or_by_element():
    s = system()
    s["car"].set({"gain": np.array([[1, 2], [3, 4]]), "gain[2,1]": 7}, label="b")
    assert s["car"].values == {"gain[1,1]": 1, "gain[1,2]": 2, "gain[2,1]": 7, "gain[2,2]": 4, "label": "b"}


def test_values_are_set_all_or_none():
    s = system()
    with pytest.raises(WiringError):
        s["car"].set({"gain[2,1]": 7, "missing": 1})
    assert not s["car"].values


@pytest.mark.parametrize(
    "arguments",
    [
        {"name": "a..b"},
        {"name": ".a"},
        {"name": "a b"},
        {"name": "a*"},
        {"name": "a?"},
        {"name": None},
        {"isolated": "yes"},
        {"name": "car"},
        {"step": 0},
        {"step": "fast"},
        {"step": None},
        {"offset": -1},
        {"kind": "hybrid"},
        {"fmu": 3},
    ],
)
def test_mistakes_in_components(arguments, raises):
    given = {"name": "new", "fmu": Integrator(), "step": 1, **arguments}
    with raises((WiringError, TimeError)):
        system().add(given.pop("name"), given.pop("fmu"), **given)


def test_a_record_names_variables(refused):
    refused(
        WiringError,
        lambda: system().run(0.1, record=3),
        lambda: system().run(0.1, record=["car.z", 3]),
        lambda: system().initialize(record=Record(3)),
    )


def test_mistakes_in_groups(raises):
    s = system()
    with pytest.raises(WiringError, match="'road' is discrete"):
        s.group("g", ["road"])
    with raises(WiringError):
        s.group("g", ["car"], "newton")
    s.group("g", ["car"])
    with raises(WiringError):
        s.group("h", ["car"])


def test_extrapolation_is_between_continuous_components(raises):
    s = System()
    s.add("a", Clock(), step=1)
    s.add("b", Integrator(), step=1)
    with raises(WiringError):
        s.connect("a.y", "b.u", extrapolate=True)


def test_what_cannot_be_recorded_is_named(refused):
    s = system()
    refused(
        WiringError, lambda: s.select("car.bodi.a*"), lambda: s.select(["car.body.ax"]), lambda: s.select("car.label")
    )
    assert [v.name for _, v in s.select("road.preview.fl[2]")] == ["preview.fl[2]"]
    assert len(s.select(None)) == 6


@pytest.mark.parametrize(
    ("step", "text"),
    [
        ("1.234567 ms", "0.001234567 s"),
        ("1/60", "1/60 s"),
        (1 / 60, "1/60 s"),
        (0.001, "0.001 s"),
        ("1 min", "60 s"),
        ("3 ns", "3e-09 s"),
        ("0.12345678901234567891", "12345678901234567891/100000000000000000000 s"),
        (1000.0625, "1000.0625 s"),
    ],
)
def test_a_step_is_shown_as_it_is(step, text, raises):
    s = System()
    s.add("a", Clock(), step=step)
    assert f"every {text}\n" in str(s.schedule())
    assert f"base tick {text}\n" in str(s.schedule())
    with raises(TimeError, match=re.escape(f"{text}")):
        TimeBase(Fraction(7000)).count(s["a"].step)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1.0])
def test_what_is_no_duration_is_shown_too(value):
    assert seconds_text(value).startswith(f"{value:g}")


def test_empty_system(raises):
    with raises(WiringError):
        System().run(1)


def test_driven_inputs_are_not_set_and_unknown_values_not_read(raises):
    s = System()
    s.add("a", Delta(), step=1)
    s.add("b", Delta(), step=1)
    s.connect("a.y", "b.u")
    simulation = s.initialize()
    with pytest.raises(WiringError, match=r"driven by a\.y"):
        simulation.set("b.u", 1.0)
    with raises(KeyError):
        simulation["a.z"]


def test_an_array_with_a_driven_element_is_not_set(refused):
    class Vector(Delta):
        inputs = ("u[1]", "u[2]")

    s = System()
    s.add("a", Delta(), step=1, start={"u": 0})
    s.add("g", Vector(), step=1, start={"u": [1, 2]})
    s.connect("a.y", "g.u[2]")
    with s.initialize(record=Record(watch=["g.u[1]"])) as simulation:
        refused(WiringError, lambda: simulation.set("g.u", [3.0, 4.0]), lambda: simulation.setter(["g.u[1]", "g.u[2]"]))
        assert simulation["g.u[1]"] == 1.0
        simulation.set("g.u[1]", 3.0)
        assert simulation["g.u[1]"] == 3.0


def test_unit_conversion(refused):
    assert conversion(KNOWN["km/h"], KNOWN["m/s"]) == pytest.approx((1 / 3.6, 0.0))
    scale, offset = conversion(KNOWN["degC"], KNOWN["K"])
    assert scale * 20 + offset == pytest.approx(293.15)
    assert conversion(KNOWN["degC"], KNOWN["K"], relative=True) == (1.0, 0.0)
    assert conversion(None, KNOWN["K"]) == conversion(Unit("x"), Unit("x")) == (1.0, 0.0)
    refused(
        UnitMismatchError,
        lambda: conversion(Unit("furlong"), KNOWN["m"]),
        lambda: conversion(KNOWN["rad/s"], KNOWN["Hz"]),
    )
