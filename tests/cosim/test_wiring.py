"""Wiring by name: units, types, nearest matches, parameters; every mistake is named."""

import re
import warnings
import zipfile
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from probes import Clock, Delta, Integrator

from build_fmus.units import KNOWN, Unit, UnitMismatchError, conversion
from cosim import CosimError, PythonComponent, System, TimeError, UnconnectedInputsWarning, WiringError
from cosim.time import TimeBase, rational, seconds_text


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
    np.testing.assert_allclose(s["car"].component._u, [1.0, 2.0, 3.0, 4.0, 10.0])


@pytest.mark.parametrize(
    ("source", "target", "message"),
    [
        ("rod.x", "car.speed", "no component 'rod'; did you mean 'road'?"),
        ("road.road.fl.heigth", "car.speed", "has no variable 'road.fl.heigth'; did you mean 'road.fl.height'"),
        ("road.road.fl.height", "car.road.fl.hight", "did you mean 'road.fl.height'"),
        ("road.x", "car.speed", "'road.x' is an input, not an output"),
        ("road.speed", "car.x", "'car.x' is an output, not an input"),
        ("car.mass", "road.x", "units differ: car.mass [kg] -> road.x [m]: they measure different quantities"),
        ("road", "car.speed", "write component.variable"),
        ("road.preview.fl", "car.speed", "has 2 element(s)"),
    ],
)
def test_mistakes_in_connections(source, target, message):
    with pytest.raises(WiringError, match=re.escape(message)):
        system().connect(source, target)


def test_an_input_has_one_source():
    s = system()
    s.connect("car.x", "road.x")
    with pytest.raises(WiringError, match=r"already connected to car\.x"):
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


@pytest.mark.parametrize(
    ("fmi_type", "remedy"), [("String", r"; set a text before the run: system\['b'\]\.set\(\{'u': "), ("Binary", "$")]
)
def test_texts_and_binaries_are_not_connected(fmi_type, remedy):
    s = System()
    for name in ("a", "b"):
        component = Delta()
        about = component.description
        kind = "string" if fmi_type == "String" else "other"
        about.variables |= {n: replace(v, type=kind, fmi_type=fmi_type) for n, v in about.variables.items()}
        about.__post_init__()
        s.add(name, component, step=1)
    with pytest.raises(
        WiringError, match=rf"a\.y -> b\.u: a\.y is a {fmi_type}, and only numbers and Booleans are exchanged{remedy}"
    ):
        s.connect("a.y", "b.u")


def test_integers_that_doubles_do_not_hold_are_named(follower):
    with System() as s:
        for name in ("a", "b"):
            s.add(name, follower[3], step="1 ms", kind="discrete", start={"int64_in": 2**53 - 2, "uint64_in": 0})
        s.connect("a.int64_out", "b.int64_in")
        options = {"record": ["b.int64_out", "a.uint64_out"], "allow_unconnected": True}
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            s.run(0.01, **options)
        s["a"].set(int64_in=2**53 + 1)
        with pytest.warns(
            UserWarning,
            match=r"^a\.int64_out, b\.int64_out: integers from 2\^53 on are exchanged and recorded as doubles",
        ):
            s.run(0.01, **options)
        s["a"].set(int64_in=0, uint64_in=2**64 - 1)
        with s.initialize(**options) as simulation, pytest.warns(UserWarning, match=r"^a\.uint64_out: integers"):
            assert len(simulation.recording) == 1


@pytest.mark.parametrize(
    ("step", "fits"), [("0.1 ms", True), (None, True), ("0.25 ms", False), ("0.05 ms", False), (0.1, True)]
)
def test_steps_that_the_fixed_internal_step_does_not_fit_are_warned_of(follower, tmp_path, step, fits):
    path = tmp_path / "Fixed.fmu"
    with zipfile.ZipFile(follower[3]) as made, zipfile.ZipFile(path, "w") as fixed:
        for name in made.namelist():
            fixed.writestr(
                name, made.read(name).replace(b"<CoSimulation ", b'<CoSimulation fixedInternalStepSize="1e-4" ')
            )
    with warnings.catch_warnings(record=True) as found, System() as s:
        warnings.simplefilter("always")
        assert s.add("a", path, step=step).step == (Fraction(1, 10_000) if step is None else rational(step))
    said = [str(w.message) for w in found if "fixed internal step" in str(w.message)]
    assert [t.split(":")[0] for t in said] == [] if fits else ["component 'a' (Follower3)"]


def test_type_mismatch(foreign):
    s = system()
    s.add("foreign", foreign["AddOne2"], step=1)
    with pytest.raises(WiringError, match="types differ, Real to Boolean"):
        s.connect("road.speed", "foreign.enable")
    with pytest.raises(WiringError, match="types differ, Boolean to Real"):
        s.connect("foreign.busy", "foreign.u")


def test_unconnected_inputs_are_reported_unless_they_were_given_a_value():
    s = System()
    s.add("car", Car(), start={"speed": 3.0})
    s.add("road", Road(), start={"x": 0.0})
    s.connect_matching("road", "car", "road.*")
    assert s.check() == ["car.preview.fl[1]", "car.preview.fl[2]"]
    with pytest.warns(UnconnectedInputsWarning, match=r"car\.preview\.fl\[1\], car\.preview\.fl\[2\]"):
        s.run(0.001)
    with pytest.warns(UnconnectedInputsWarning, match=r"\(allow_unconnected=True if that is meant\)"):
        s.initialize()
    s.reset()
    with pytest.warns(UnconnectedInputsWarning), pytest.raises(CosimError, match="it offers no linear model"):
        s.coupled_spectral_radius()


@pytest.mark.filterwarnings("error")
def test_unconnected_inputs_that_are_meant_so_are_not_reported():
    s = System()
    s.add("car", Car(), start={"speed": 3.0})
    s.add("road", Road(), start={"x": 0.0})
    s.connect_matching("road", "car", "road.*")
    assert len(s.run(0.001, allow_unconnected=True))
    assert s.initialize(allow_unconnected=True).time_ns == 0
    s.reset()
    with pytest.raises(CosimError, match="it offers no linear model"):
        s.coupled_spectral_radius(allow_unconnected=True)
    s.connect("road.preview.fl", "car.preview.fl")
    assert s.check() == []
    s.run(0.001)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"kk": 1}, "has no variable 'kk'; did you mean 'k'?"),
        ({"k": "stiff"}, "car.k needs one number"),
        ({"k": float("nan")}, "car.k is nan; give a finite number"),
        ({"on": 3}, "car.on is a Boolean"),
        ({"x": 3}, "car.x cannot be set: it is an output"),
        ({"gain": np.zeros((3, 2))}, "car.gain has shape (2, 2), the value given has (3, 2)"),
    ],
)
def test_mistakes_in_parameters(values, message):
    with pytest.raises(WiringError, match=re.escape(message)):
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
    ("arguments", "message"),
    [
        ({"name": "a..b"}, "dots only between its parts"),
        ({"name": ".a"}, "dots only between its parts"),
        ({"name": "a b"}, "no blanks"),
        ({"name": "car"}, "already a component 'car'"),
        ({"step": 0}, "step of 'new' must be positive"),
        ({"step": "fast"}, "step of 'new': cannot read 'fast'"),
        ({"step": None}, "states no step of its own"),
        ({"offset": -1}, "must not be negative"),
        ({"kind": "hybrid"}, "kind is 'discrete' or 'continuous'"),
        ({"fmu": 3}, "cannot use 3"),
    ],
)
def test_mistakes_in_components(arguments, message):
    given = {"name": "new", "fmu": Integrator(), "step": 1, **arguments}
    with pytest.raises((WiringError, TimeError), match=re.escape(message)):
        system().add(given.pop("name"), given.pop("fmu"), **given)


def test_mistakes_in_groups():
    s = system()
    with pytest.raises(WiringError, match="'road' is discrete"):
        s.group("g", ["road"])
    with pytest.raises(WiringError, match="method is"):
        s.group("g", ["car"], "newton")
    s.group("g", ["car"])
    with pytest.raises(WiringError, match="already in group 'g'"):
        s.group("h", ["car"])


def test_extrapolation_is_between_continuous_components():
    s = System()
    s.add("a", Clock(), step=1)
    s.add("b", Integrator(), step=1)
    with pytest.raises(WiringError, match="between continuous"):
        s.connect("a.y", "b.u", extrapolate=True)


def test_what_cannot_be_recorded_is_named():
    s = system()
    with pytest.raises(WiringError, match=r"did you mean 'car\.body\.az'"):
        s.select("car.bodi.a*")
    with pytest.raises(WiringError, match=r"no variable 'body\.ax'; did you mean 'body\.az'"):
        s.select(["car.body.ax"])
    with pytest.raises(WiringError, match="cannot be recorded"):
        s.select("car.label")
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
def test_a_step_is_shown_as_it_is(step, text):
    s = System()
    s.add("a", Clock(), step=step)
    assert f"every {text}\n" in str(s.schedule())
    assert f"base tick {text}\n" in str(s.schedule())
    with pytest.raises(TimeError, match=re.escape(f"{text} is not a multiple of the base tick of 7000 s")):
        TimeBase(Fraction(7000)).count(s["a"].step)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1.0])
def test_what_is_no_duration_is_shown_too(value):
    assert seconds_text(value).startswith(f"{value:g}")


def test_empty_system():
    with pytest.raises(WiringError, match="no components"):
        System().run(1)


def test_driven_inputs_are_not_set_and_unknown_values_not_read():
    s = System()
    s.add("a", Delta(), step=1)
    s.add("b", Delta(), step=1)
    s.connect("a.y", "b.u")
    simulation = s.initialize()
    with pytest.raises(WiringError, match=r"driven by a\.y"):
        simulation.set("b.u", 1.0)
    with pytest.raises(KeyError, match="did you mean"):
        simulation["a.z"]


def test_an_array_with_a_driven_element_is_not_set():
    class Vector(Delta):
        inputs = ("u[1]", "u[2]")

    s = System()
    s.add("a", Delta(), step=1, start={"u": 0})
    s.add("g", Vector(), step=1, start={"u": [1, 2]})
    s.connect("a.y", "g.u[2]")
    with s.initialize(watch=["g.u[1]"]) as simulation:
        with pytest.raises(WiringError, match=r"g\.u\[2\] is driven by a\.y"):
            simulation.set("g.u", [3.0, 4.0])
        with pytest.raises(WiringError, match=r"g\.u\[2\] is driven by a\.y"):
            simulation.setter(["g.u[1]", "g.u[2]"])
        assert simulation["g.u[1]"] == 1.0
        simulation.set("g.u[1]", 3.0)
        assert simulation["g.u[1]"] == 3.0


def test_unit_conversion():
    assert conversion(KNOWN["km/h"], KNOWN["m/s"]) == pytest.approx((1 / 3.6, 0.0))
    scale, offset = conversion(KNOWN["degC"], KNOWN["K"])
    assert scale * 20 + offset == pytest.approx(293.15)
    assert conversion(KNOWN["degC"], KNOWN["K"], relative=True) == (1.0, 0.0)
    assert conversion(None, KNOWN["K"]) == conversion(Unit("x"), Unit("x")) == (1.0, 0.0)
    with pytest.raises(UnitMismatchError, match="does not define"):
        conversion(Unit("furlong"), KNOWN["m"])
    with pytest.raises(UnitMismatchError, match="different quantities"):
        conversion(KNOWN["rad/s"], KNOWN["Hz"])
