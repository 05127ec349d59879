"""The project's own FMUs in the master: saved states, arrays, linear models, the messages of refused values."""

import pickle

import casadi as ca
import numpy as np
import pytest
from built import OBJECTS

from build_fmus.compile import resolve_platforms
from build_fmus.component import Component
from build_fmus.package import build_fmu
from cosim import ComponentError, CosimError, Execution, PythonComponent, System

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")


def mass():
    """A mass on a spring to the ground, pushed by a force."""
    c = Component("Mass", kind="continuous", description="mass on a spring", source="test")
    m = c.parameter("mass", 2.0, "kg", "mass", min=1e-3, source="none")
    k = c.parameter("stiffness", 50.0, "N/m", "spring", tunable=True, source="none")
    force = c.input("force", "N", "push")
    x = c.state("x", "m", "position", start=0.1, output=True)
    v = c.state("v", "m/s", "velocity", output=True)
    c.derivative(x, v)
    c.derivative(v, (force - k * x) / m)
    c.output("a", (force - k * x) / m, "m/s2", "acceleration")
    return c


def chain():
    """Like `mass`, with its two states in one vector and a vector of forces."""
    c = Component("Chain", kind="continuous", description="mass on a spring", source="test")
    force = c.input("force", "N", "pushes", shape=(2,))
    x = c.state("x", None, "position and velocity", shape=(2,), start=0.1, output=True)
    c.derivative(x, ca.vertcat(x[1], -25 * x[0] + 0.5 * force[0] + 2 * force[1]))
    return c


def mixer():
    """A component with y = gain u, a vector and a matrix."""
    c = Component("Mixer", kind="discrete", sample_time=0.001, description="matrix gain", source="test")
    gain = c.parameter("gain", np.zeros((2, 3)), "1", "gains", source="none")
    u = c.input("u", "m", "input", shape=(3,), start=1.0)
    c.output("y", gain @ u, "m", "output")
    return c


@pytest.fixture(scope="session")
def native(tmp_path_factory):
    folder = tmp_path_factory.mktemp("native")
    paths = {}
    both = [(make, version, False) for make in (mass, mixer) for version in (2, 3)]
    variants = [*both, (mixer, 3, True), (chain, 3, True)]
    for make, version, arrays in variants:
        name = f"{make.__name__}{version}{'a' if arrays else ''}"
        paths[name] = folder / f"{name}.fmu"
        paths[name].write_bytes(build_fmu(make(), version, resolve_platforms("host"), OBJECTS, arrays=arrays))
    return paths


@pytest.mark.parametrize("version", [2, 3])
def test_saved_states_continue_bit_for_bit(native, version, raises):
    with System() as system:
        system.add("mass", native[f"mass{version}"], parameters={"mass": 1.0})
        simulation = system.initialize()
        simulation.advance(0.5)
        state = simulation.save()
        simulation.advance(1.0)
        first = simulation.recording
        simulation.restore(state)
        simulation.advance(1.0)
        np.testing.assert_array_equal(simulation.recording.data, first.data)
        system.initialize()
        with raises(CosimError):
            simulation.restore(state)
        continued = system.run(1.0, state=state)
        np.testing.assert_array_equal(continued["mass.x"], first["mass.x"][500:])
        saved = state.components["mass"]
        system.initialize().forget(state)
        with raises(CosimError):
            system["mass"].implementation.restore(saved)
        np.testing.assert_allclose(first["mass.x"], 0.1 * np.cos(np.sqrt(50) * first.time), atol=1e-6)


@pytest.mark.parametrize("version", [2, 3])
def test_linear_model_of_an_fmu(native, version):
    with System() as system:
        component = system.add("mass", native[f"mass{version}"])
        system.initialize()
        about = component.description
        a, b, c, d = component.implementation.linearize([about.variables["force"]], [about.variables["a"]])
        np.testing.assert_allclose(a, [[0, 1], [-25, 0]])
        np.testing.assert_allclose(b, [[0], [0.5]])
        np.testing.assert_allclose(c, [[-25, 0]])
        np.testing.assert_allclose(d, [[0.5]])
        assert system.coupled_spectral_radius().radius == pytest.approx(1.0, abs=1e-9)


def test_linear_model_with_arrays(native):
    with System() as system:
        component = system.add("chain", native["chain3a"])
        system.initialize()
        about = component.description
        a, b, c, _ = component.implementation.linearize([about.variables["force[2]"]], [about.variables["x[2]"]])
        np.testing.assert_allclose(a, [[0, 1], [-25, 0]])
        np.testing.assert_allclose(b, [[0], [2]])
        np.testing.assert_allclose(c, [[0, 1]])


@pytest.mark.parametrize("name", ["mixer2", "mixer3", "mixer3a"])
def test_arrays_are_wired_and_set_by_element(native, name):
    gain = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    with System() as system:
        system.add("mixer", native[name], parameters={"gain": gain, "gain[2,3]": 60.0})
        system.add("source", Source())
        system.connect("source.y", "mixer.u[2]")
        for record in (["mixer.y"], ["mixer.y[2]"]):
            result = system.run(0.003, record=record)
            np.testing.assert_allclose(result["mixer.y[2]"], [4 + 5 * 7 + 60] * 4)
        np.testing.assert_allclose(system.run(0.003, record=["mixer.y[1]"])["mixer.y[1]"], [1 + 14 + 3] * 4)


class Source(PythonComponent):
    """7 meters."""

    kind = "discrete"
    default_step = "1 ms"
    outputs = ("y [m]",)

    def start(self, u, y):  # noqa: ARG002
        y[0] = 7.0

    def step(self, t, h, u, y):  # noqa: ARG002
        self.start(u, y)


class Broken(PythonComponent):
    """Gives up at 50 ms."""

    kind = "discrete"
    default_step = "10 ms"
    outputs = ("f [N]",)

    def step(self, t, h, u, y):  # noqa: ARG002
        y[0] = np.nan if t >= 0.05 else 1.0


@pytest.mark.parametrize("version", [2, 3])
def test_a_value_that_is_not_finite_ends_the_run_and_is_named(native, version):
    with System() as system:
        system.add("mass", native[f"mass{version}"])
        system.add("source", Broken())
        system.connect("source.f", "mass.force")
        with pytest.raises(ComponentError, match=r"'source': f is nan at t = 0\.05 s"):
            system.run(1.0)
        with pytest.raises(ComponentError, match=r"(?s)'mass'.*t = 0\.05 s.*force") as caught:
            system.run(1.0, execution=Execution(allow_nan=True))
        assert caught.value.recording.time[-1] == 0.05
        crossed = pickle.loads(pickle.dumps(caught.value))  # as from a worker process of a study
        assert str(crossed) == str(caught.value)
        assert (crossed.component, crossed.recording) == ("mass", None)
        with pytest.raises(ComponentError):  # and again, on the reset instance
            system.run(1.0)
        system.disconnect("mass.force")
        assert system.run(0.1, record="mass.*").time[-1] == 0.1  # nobody reads the source any more


@pytest.mark.parametrize("version", [2, 3])
def test_tunable_and_fixed_parameters(native, version, raises):
    with System() as system:
        system.add("mass", native[f"mass{version}"])
        simulation = system.initialize()
        simulation.advance(0.1)
        simulation.set("mass.stiffness", 80.0)
        with raises(CosimError):
            simulation.set("mass.mass", 1.0)
        simulation.advance(0.2)
        assert simulation.time == 0.2
