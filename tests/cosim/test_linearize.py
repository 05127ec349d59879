"""Linear models of FMUs and systems: small ones whose matrices are known, and the growth of runs."""

import casadi
import control
import numpy as np
import pytest
from built import OBJECTS
from deviations import deviation
from scipy.linalg import expm

from build_fmus.compile import resolve_platforms
from build_fmus.component import Component
from build_fmus.package import build_fmu
from cosim import CosimError, Fmu, LoopError, PythonComponent, Record, System, TimeError, WiringError
from cosim.linear import sampled_model

STIFFNESS, MASS = 50.0, 2.0


def mass():
    """A mass on a spring, pushed by a force in N."""
    c = Component("Mass", kind="continuous", description="mass on a spring", source="test")
    m = c.parameter("mass", MASS, "kg", "mass", min=1e-3, source="none")
    force = c.input("body.force", "N", "push")
    x = c.state("body.x", "m", "position", start=0.1, output=True)
    v = c.state("body.v", "m/s", "velocity", output=True)
    k = c.constant("stiffness", STIFFNESS, "N/m", "spring", source="none")
    c.derivative(x, v)
    c.derivative(v, (force - k * x) / m)
    c.output("body.a", (force - k * x) / m, "m/s2", "acceleration")
    return c


def pendulum():
    """Its linear model depends on where it stands."""
    c = Component("Pendulum", kind="continuous", description="pendulum", source="test")
    angle = c.state("angle", "rad", "angle", start=0.5, output=True)
    rate = c.state("rate", "rad/s", "rate", output=True)
    c.derivative(angle, rate)
    per_length = c.constant("gravity", 9.81, "1/s2", "gravity over the length", source="none")
    c.derivative(rate, -per_length * angle * angle)
    return c


def law():
    """Proportional and integral action on a position, with a hidden state, a constant and a counter."""
    c = Component("Law", kind="discrete", sample_time=0.004, description="PI", source="test")
    x = c.input("x", "m", "position")
    gain = c.parameter("gain", 30.0, "N/m", "gain", source="none")
    total = c.state("total", None, "sum [m.s]")
    trim = c.state("trim", "m", "trim", start=x)
    count = c.state("count", "1", "samples")
    c.update(total, total + (x - trim) * c.period)
    c.update(trim, trim)
    c.update(count, -count + 1)  # back after two samples
    c.output("force", -gain * (x - trim) - 500 * total, "N", "force")
    far = c.constant("far", 50.0, "m", "far away", source="none")
    c.output("high", x > far, None, "a flag", type=bool)
    return c


def damped():
    """A mass on a damper whose rates differ in compression and rebound, and one with a smooth square part.

    Both carry a large load.
    """
    c = Component("Damped", kind="continuous", description="damper", source="test")
    v = c.state("v", "m/s", "velocity", output=True)
    free = c.state("free", "m/s", "velocity without damper", output=True)
    static = c.parameter("static", 1e6, "m/s2", "load that is carried", source="none")
    square = c.constant("square", 3.0, "1/m", "smooth part", source="none")
    low, high = (c.constant(n, x, "1/s", "rate over mass", source="none") for n, x in (("low", 45.0), ("high", 165.0)))
    c.derivative(v, (static - casadi.if_else(v > 0, high, low) * v) - static)
    c.derivative(free, (static - low * free - square * free * free) - static)
    return c


def relay():
    c = Component("Relay", kind="discrete", sample_time=0.004, description="relay", source="test")
    x = c.input("x", "m", "position")
    c.output("force", abs(x), None, "force")
    return c


@pytest.fixture(scope="session")
def small(tmp_path_factory):
    folder = tmp_path_factory.mktemp("linearize")
    paths = {}
    for make, versions in ((mass, (2, 3)), (damped, (2, 3)), (pendulum, (2,)), (law, (2, 3)), (relay, (3,))):
        for version in versions:
            paths[f"{make.__name__}{version}"] = folder / f"{make.__name__}{version}.fmu"
            archive = build_fmu(make(), version, resolve_platforms("host"), OBJECTS)
            paths[f"{make.__name__}{version}"].write_bytes(archive)
    return paths


@pytest.mark.parametrize("version", [2, 3])
def test_an_fmu_is_a_state_space_with_names(small, version):
    model = Fmu(small[f"mass{version}"]).linearize(parameters={"mass": 4.0}, start={"body.x": 0.2, "body.force": 3.0})
    assert isinstance(model, control.StateSpace)
    assert model.dt == 0
    np.testing.assert_allclose(model.A, [[0, 1], [-12.5, 0]])
    np.testing.assert_allclose(model.B, [[0], [0.25]])
    np.testing.assert_allclose(model.C, [[1, 0], [0, 1], [-12.5, 0]])
    np.testing.assert_allclose(model.D, [[0], [0], [0.25]])
    assert model.input_labels == ["body_force"]
    assert model.state_labels == ["body_x", "body_v"]
    assert [model.names[n] for n in model.output_labels] == ["body.x", "body.v", "body.a"]
    assert model.units["body.a"] == "m/s2"
    assert model.operating_point == {
        "body.x": 0.2,
        "body.v": 0.0,
        "body.force": 3.0,
        "body.a": pytest.approx((3.0 - STIFFNESS * 0.2) / 4.0),
    }


def test_signals_are_chosen_by_name_and_pattern(small, raises, refused):
    fmu = Fmu(small["mass3"])
    model = fmu.linearize("body.force", ["body.a", "body.x"])
    assert model.output_labels == ["body_a", "body_x"]
    np.testing.assert_allclose(model.D, [[0.5], [0]])
    assert fmu.linearize([], "*.v").input_labels == ["nothing"]  # python-control has no models without inputs
    refused(WiringError, lambda: fmu.linearize("*.power"), lambda: fmu.linearize("body.x"))
    with pytest.raises(WiringError, match=r"no variable 'body\.acc'"):
        fmu.linearize(outputs="body.acc")
    with raises(WiringError):
        fmu.linearize(parameters={"mass": -1})


def test_it_stands_where_it_has_settled(small):
    fmu = Fmu(small["pendulum2"])
    with pytest.raises(TimeError, match=r"settle is -1 s; give 0 s or a longer time"):
        fmu.linearize(settle=-1)
    assert fmu.linearize().A[1, 0] == pytest.approx(-2 * 9.81 * 0.5)
    later = fmu.linearize(settle=0.2)
    assert later.operating_point["angle"] < 0.49
    assert later.A[1, 0] == pytest.approx(-2 * 9.81 * later.operating_point["angle"])


def test_names_that_would_be_one_are_refused(raises):
    class Two(PythonComponent):
        default_step = "1 ms"
        outputs = ("a.b", "a_b")

        def linearize(self, inputs, outputs):
            return (
                np.zeros((0, 0)),
                np.zeros((0, len(inputs))),
                np.zeros((len(outputs), 0)),
                np.zeros((len(outputs), len(inputs))),
            )

    system = System()
    system.add("two", Two())
    with raises(WiringError):
        system.linearize()
    assert system.linearize(outputs="two.a.b").output_labels == ["two_a_b"]


def test_foreign_fmus_are_refused_by_name(foreign, raises):
    with raises(CosimError):
        Fmu(foreign["AddOne2"]).linearize()
    system = System()
    system.add("other", foreign["AddOne2"], step="1 ms", kind="discrete")
    with raises(CosimError):
        system.linearize(discrete=True)


# Continuous systems.


class Gain(PythonComponent):
    """y = k u, continuous, in other units than what it is connected to."""

    default_step = "1 ms"
    inputs = ("u [mm]",)
    outputs = ("y [kN]",)
    parameters = {"k": -2.0}  # noqa: RUF012

    def step(self, t, h, u, y):  # noqa: ARG002
        y[0] = self.k * u[0]

    def start(self, u, y):
        self.step(0, 0, u, y)

    def linearize(self, inputs, outputs):
        d = np.full((len(outputs), len(inputs)), self.k)
        return np.zeros((0, 0)), np.zeros((0, len(inputs))), np.zeros((len(outputs), 0)), d


def test_members_are_coupled_with_units_and_without_delays(small, raises):
    with System() as system:
        system.add("mass", small["mass2"])
        system.add("gain", Gain())
        system.connect("mass.body.x", "gain.u")
        system.connect("gain.y", "mass.body.force")
        model = system.linearize()
        extra = -2.0 * 1e3 * 1e3  # N per m: 1e3 mm per m, 1e3 N per kN
        np.testing.assert_allclose(model.A, [[0, 1], [(extra - STIFFNESS) / MASS, 0]])
        assert model.input_labels == ["nothing"]
        assert not model.B.any()
        np.testing.assert_allclose(model.C[model.output_labels.index("gain_y")], [extra / 1e3, 0])
        with raises(WiringError):
            system.linearize("mass.body.force")
        system.disconnect("mass.body.force")
        system.connect("gain.y", "mass.body.force", delay=True)
        with raises(CosimError):
            system.linearize()


class Sum(Gain):
    inputs = ("u [1]", "r [1]")
    outputs = ("y [1]",)

    def linearize(self, inputs, outputs):  # noqa: ARG002
        return (
            np.zeros((0, 0)),
            np.zeros((0, 2)),
            np.zeros((1, 0)),
            np.array([[1.0 if i.name == "r" else self.k for i in inputs]]),
        )

    def step(self, t, h, u, y):  # noqa: ARG002
        y[0] = self.k * u[0] + u[1]


@pytest.mark.parametrize("k", [0.5, 1.0])
def test_algebraic_loops_are_solved_or_named(k, raises):
    system = System()
    system.add("sum", Sum(), parameters={"k": k})
    system.connect("sum.y", "sum.u")
    if k == 1.0:
        with raises(LoopError):
            system.linearize("sum.r", "sum.y")
    else:
        np.testing.assert_allclose(system.linearize("sum.r", "sum.y").D, [[2.0]])


@pytest.mark.parametrize("interface", ["cs", "me"])
@pytest.mark.parametrize("version", [2, 3])
def test_a_loop_through_a_mass_adds_to_it(small, version, interface):
    """The force -3 kg * a, in a loop with the acceleration: 5 kg on the spring, whichever interface is used."""
    with System() as system:
        system.add("mass", small[f"mass{version}"], step="1 ms", interface=interface)
        system.add("sum", Sum(), step="1 ms", parameters={"k": -3.0})
        system.connect("mass.body.a", "sum.u", linear=(1.0, 0.0))
        system.connect("sum.y", "mass.body.force", linear=(1.0, 0.0))
        model = system.linearize("sum.r", "mass.body.a")
    total = MASS + 3.0
    np.testing.assert_allclose(model.A, [[0, 1], [-STIFFNESS / total, 0]])
    np.testing.assert_allclose(model.B, [[0], [1.0 / total]])
    np.testing.assert_allclose(model.C, [[-STIFFNESS / total, 0]])
    np.testing.assert_allclose(model.D, [[1.0 / total]])


def test_all_loops_without_a_solution_are_named():
    """Which of two equal singular vectors comes last is LAPACK's choice."""
    system = System()
    for name in ("first", "second"):
        system.add(name, Sum(), parameters={"k": 1.0})
        system.connect(f"{name}.y", f"{name}.u")
    with pytest.raises(LoopError, match=r"no solution: first\.u, second\.u depend"):
        system.linearize("first.r", "first.y")


@pytest.mark.parametrize("version", [2, 3])
def test_a_plant_on_a_kink_is_refused(small, version, raises):
    """Both sides are looked at.

    Rounding of the large numbers that are subtracted is no kink, and neither is curvature.
    """
    fmu = Fmu(small[f"damped{version}"])
    with raises(CosimError):
        fmu.linearize()
    for speed, rate in ((0.1, 165.0), (-0.1, 45.0)):
        for free in (0.0, 0.5):
            model = fmu.linearize(start={"v": speed, "free": free})
            np.testing.assert_allclose(model.A, [[-rate, 0], [0, -45.0 - 6 * free]], atol=1e-6)


def test_work_is_bounded(small, monkeypatch, raises):
    monkeypatch.setattr(sampled_model, "LARGEST", 20)
    with raises(CosimError):
        Fmu(small["law3"]).linearize(period="8 ms")


def closed_loop(small, version=3, name="law", offset=0):
    system = System()
    system.add("mass", small[f"mass{version}"], start={"body.x": 0.0})
    system.add("law", small[f"{name}{version}"], offset=offset)
    system.connect("mass.body.x", "law.x")
    system.connect("law.force", "mass.body.force")
    return system


def test_commands_are_inputs_of_the_continuous_model(small, raises):
    with closed_loop(small) as system:
        model = system.linearize()
        assert model.input_labels == ["law_force"]
        np.testing.assert_allclose(model.B, [[0], [1 / MASS]])
        np.testing.assert_allclose(system.linearize("mass.body.force").B, model.B)
        with raises(WiringError):
            system.linearize(outputs="law.force")


# Sampled systems.


@pytest.mark.parametrize("version", [2, 3])
def test_the_sampled_law_is_what_was_declared(small, version):
    fmu = Fmu(small[f"law{version}"])
    with pytest.raises(
        CosimError, match=r"'Law' .* its state\[3\] counts, .*discrete='10 ms' .of one FMU: period='10 ms'."
    ):
        fmu.linearize()
    model = fmu.linearize(period="8 ms")
    assert model.dt == 0.008
    assert model.state_labels == ["state_1"]  # neither trim nor count
    np.testing.assert_allclose(model.A, [[1]], atol=1e-9)
    np.testing.assert_allclose(model.B, [[0.008]], atol=1e-9)
    np.testing.assert_allclose(model.C, [[-500]])
    np.testing.assert_allclose(model.D, [[-30]])


def test_the_sampled_model_is_that_of_theory(small):
    """Mass under a PI law, 4 ms: discretized by hand. The law acts at once on what it reads."""
    with closed_loop(small) as system:
        model = system.linearize(outputs=["mass.body.x", "law.force"], discrete="8 ms")
    names = [model.names[n] for n in model.state_labels]
    assert names == ["law.state[1]", "mass.body.x", "mass.body.v"]
    step = expm(np.array([[0, 1, 0], [-STIFFNESS / MASS, 0, 1 / MASS], [0, 0, 0]]) * 0.004)
    force = np.array([-500.0, -30.0, 0.0])  # of sum, position, velocity
    one = np.vstack([[1, 0.004, 0], np.hstack([np.zeros((2, 1)), step[:2, :2]]) + np.outer(step[:2, 2], force)])
    np.testing.assert_allclose(model.A, one @ one, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(model.C, [[0, 1, 0], force], atol=1e-8)


class Pusher(PythonComponent):
    """Adds a disturbance to a command, which arrives two samples later: floats and an array are its states."""

    kind = "discrete"
    inputs = ("u [kN]", "w [kN]")
    outputs = ("y [kN]",)

    def begin(self):
        self.last = np.zeros(2)
        self.filtered = 0.0

    def step(self, t, h, u, y):  # noqa: ARG002
        self.filtered = 0.5 * self.filtered + 0.5 * u[0]
        y[0] = self.filtered + self.last[1]
        self.last = np.array([u[1], self.last[0]])


@pytest.mark.parametrize("offset", [0, "1 ms"])
@pytest.mark.parametrize("delay", [False, True])
@pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")
def test_runs_deviate_as_the_model_says(small, offset, delay):
    """Rates of 1, 2 and 4 ms, an offset, a delayed connection, other units, memory in Python."""
    with closed_loop(small, offset=offset) as system:
        system.disconnect("mass.body.force")
        system.add("pusher", Pusher(), step="2 ms")
        system.connect("law.force", "pusher.u", delay=delay)
        system.connect("pusher.y", "mass.body.force")
        model = system.linearize(discrete="8 ms")
        assert {model.names[n] for n in model.state_labels} >= {"pusher.last[1]", "pusher.last[2]", "pusher.filtered"}
        seen, said = deviation(system, model, 1e-3, 40)
    assert np.abs(seen).max(axis=0).min() > 0
    np.testing.assert_allclose(said, seen, atol=1e-6 * np.abs(seen).max(axis=0).max(), rtol=1e-4)


def test_growth_is_the_spectral_radius(small):
    """An unstable law: from one period to the next the deviation grows as the largest eigenvalue says."""
    with closed_loop(small) as system:
        system["law"].set({"gain": -500.0})  # pushes away from rest
        radius = np.abs(control.poles(system.linearize(discrete="8 ms"))).max()
        system["mass"].set({"body.x": 1e-6})
        system["law"].set({"x": 0.0})
        x = np.abs(system.run(1.6, record=Record("mass.body.x", "8 ms"))["mass.body.x"])
    assert radius > 1.05
    assert (x[-1] / x[-51]) ** (1 / 50) == pytest.approx(radius, rel=1e-3)


def test_a_law_with_a_kink_is_refused(small, raises):
    with closed_loop(small, name="relay") as system:
        with raises(CosimError):
            system.linearize(discrete=True)
        system["mass"].set({"body.x": 0.1})  # elsewhere it has a slope
        assert system.linearize(outputs="mass.body.x", discrete=True).nstates == 2


def test_periods_and_extrapolation(small, raises):
    with closed_loop(small) as system:
        with raises(TimeError):
            system.linearize(discrete="6 ms")
        system.add("gain", Gain())
        system.connect("mass.body.x", "gain.u", extrapolate=True)
        with pytest.raises(CosimError, match=r"mass\.body\.x -> gain\.u .* is extrapolated"):
            system.linearize(discrete=True)


def test_lists_are_no_states(raises):
    class Remembers(Pusher):
        def begin(self):
            super().begin()
            self.past = [0.0]

    system = System()
    system.add("pusher", Remembers(), step="1 ms")
    with raises(CosimError):
        system.linearize(discrete=True)
