"""Constants that a source and its target must agree on (preview step, spacing of a scan).

Refused by name when wired.
"""

import io

import pytest
from built import OBJECTS
from rich.console import Console

from build_fmus.compile import resolve_platforms
from build_fmus.component import Component
from build_fmus.package import build_fmu
from cosim import Fmu, PythonComponent, System, WiringError
from cosim.fmu.describe import describe
from cosim.fmu.model_description import parse

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")


def reader():
    """Made for heights 30 ms apart."""
    c = Component("Reader", kind="discrete", sample_time=0.01, description="reads heights", source="test")
    heights = c.input("height", "m", "heights ahead", shape=(3,))
    c.constant_input("height.step", "s", "time between heights", must_equal=0.03)
    c.output("sum", heights[0] + heights[1] + heights[2], "m", "their sum")
    return c


def road(step):
    """Gives heights that are `step` s apart."""
    c = Component(
        f"Road{step * 1e3:.0f}", kind="discrete", sample_time=0.01, description="gives heights", source="test"
    )
    slope = c.input("slope", "m/s", "rate of the height")
    c.output("height", slope * c.constant("step", step, "s", "step", source="none"), "m", "height")
    c.output("height.step", step, "s", "time between heights")
    return c


class Ruler(PythonComponent):
    """Says its step only when it runs, in milliseconds."""

    kind = "discrete"
    default_step = "10 ms"
    outputs = ("height.step [ms]",)
    parameters = {"spacing": 30.0}  # noqa: RUF012

    def start(self, u, y):  # noqa: ARG002
        y[0] = self.spacing

    def step(self, t, h, u, y):  # noqa: ARG002
        y[0] = self.spacing


@pytest.fixture(scope="session")
def fmus(tmp_path_factory):
    folder = tmp_path_factory.mktemp("constants")
    paths = {}
    for component in (reader(), road(0.03), road(0.01)):
        for version, arrays in ((2, False), (3, False), (3, True)):
            name = f"{component.name}{version}{'a' if arrays else ''}"
            paths[name] = folder / f"{name}.fmu"
            paths[name].write_bytes(build_fmu(component, version, resolve_platforms("host"), OBJECTS, arrays=arrays))
    return paths


VERSIONS = pytest.mark.parametrize("version", ["2", "3", "3a"])


@VERSIONS
def test_the_model_description_tells(fmus, version):
    step = Fmu(fmus[f"Reader{version}"]).description.inputs["height.step"]
    assert (step.must_equal, step.start, step.minimum, step.maximum) == (0.03, 0.0, None, None)
    assert step.tolerance == pytest.approx(3e-8)
    outputs = Fmu(fmus[f"Road10{version}"]).description.outputs
    assert (outputs["height.step"].constant, outputs["height"].constant) == (0.01, None)


@VERSIONS
def test_a_source_with_another_constant_is_refused_when_wired(fmus, version):
    with System() as system:
        system.add("road", fmus[f"Road10{version}"])
        system.add("reader", fmus[f"Reader{version}"])
        for connect in (
            lambda: system.connect("road.height.step", "reader.height.step"),
            lambda: system.connect_matching("road", "reader", "*.step"),
        ):
            with pytest.raises(
                WiringError, match=r"road\.height\.step -> reader\.height\.step.* must equal 0\.03 s, not 0\.01 s"
            ):
                connect()


@VERSIONS
def test_a_source_with_the_same_constant_runs(fmus, version):
    with System() as system:
        system.add("road", fmus[f"Road30{version}"])
        system.add("reader", fmus[f"Reader{version}"])
        system.connect("road.height.step", "reader.height.step")
        system.run(0.05)
        assert not system["reader"].implementation.problems


@VERSIONS
@pytest.mark.parametrize("spacing", [30.0, 0.0])
def test_a_source_may_say_so_in_other_units_or_nothing(fmus, version, spacing):
    with System() as system:
        system.add("ruler", Ruler(), parameters={"spacing": spacing})
        system.add("reader", fmus[f"Reader{version}"])
        system.connect("ruler.height.step", "reader.height.step")
        system.run(0.05)
        assert not system["reader"].implementation.problems


@VERSIONS
def test_a_source_that_shows_another_constant_is_refused_when_initialized(fmus, version):
    with System() as system:
        system.add("ruler", Ruler(), parameters={"spacing": 10.0})
        system.add("reader", fmus[f"Reader{version}"])
        system.connect("ruler.height.step", "reader.height.step")
        with pytest.raises(
            WiringError, match=r"ruler\.height\.step -> reader\.height\.step.* must equal 0\.03 s, not 0\.01"
        ):
            system.initialize()


@VERSIONS
def test_start_values_that_differ_are_refused(fmus, version):
    with System() as system:
        with pytest.raises(WiringError, match=r"reader\.height\.step must equal 0\.03 s, not 0\.02 s"):
            system.add("reader", fmus[f"Reader{version}"], start={"height.step": 0.02})
        component = system.add("reader", fmus[f"Reader{version}"], start={"height.step": 0.03})
        component.set({"height.step": 0})
        simulation = system.initialize()
        with pytest.raises(WiringError, match=r"reader\.height\.step must equal"):
            simulation.set("reader.height.step", 0.06)


def test_cosim_fmu_shows_it(fmus):
    shown = io.StringIO()
    Console(file=shown, width=200).print(describe(fmus["Reader3"]))
    assert "0.03 or 0" in shown.getvalue()


def test_constants_of_other_tools_are_known_by_their_variability():
    xml = b"""<fmiModelDescription fmiVersion="2.0" modelName="Foreign" guid="x"><CoSimulation modelIdentifier="f"/>
    <ModelVariables><ScalarVariable name="step" valueReference="0" causality="output" variability="constant">
    <Real start="0.01"/></ScalarVariable><ScalarVariable name="y" valueReference="1" causality="output">
    <Real start="0.01"/></ScalarVariable></ModelVariables></fmiModelDescription>"""
    outputs = parse(xml, "foreign.fmu").outputs
    assert (outputs["step"].constant, outputs["y"].constant) == (0.01, None)
