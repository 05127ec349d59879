"""Exact time, clocks, recordings, descriptions, the stability check."""

import re
from fractions import Fraction

import numpy as np
import pytest

from build_fmus import component
from cosim import CosimError, Execution, PythonComponent, Recording, StabilityWarning, System
from cosim.core.errors import FmuError
from cosim.core.time import TimeBase, gcd, rational
from cosim.engine.clock import Clock, cycle
from cosim.fmu.model_description import LONGEST_SOURCE, parse


@pytest.mark.parametrize(
    ("value", "seconds"),
    [
        (1e-3, "1/1000"),
        (1 / 60, "1/60"),
        ("1/60", "1/60"),
        ("10 ms", "1/100"),
        ("60 Hz", "1/60"),
        (".5ms", "1/2000"),
        ("1e-3", "1/1000"),
        ("1e-3 s", "1/1000"),
        (1e-7, "1/10000000"),
        (3, "3"),
        (np.float64(0.25), "1/4"),
        (np.int64(2), "2"),
        ("2 min", "120"),
        ("100us", "1/10000"),
    ],
)
def test_times_are_read_exactly(value, seconds):
    assert rational(value) == Fraction(seconds)


@pytest.mark.parametrize("value", ["", "ten", "1/0", "0 Hz", "3 parsec", float("nan"), float("inf"), None, [1]])
def test_unreadable_times(value):
    with pytest.raises(ValueError, match="step"):
        rational(value, "step")


def test_time_base(raises):
    base = TimeBase(gcd([Fraction(1, 60), Fraction(0), Fraction(1, 1000)]), Fraction(1, 2))
    assert base.tick == Fraction(1, 3000)
    assert base.count(Fraction(1, 60)) == 50
    assert base.seconds(50) == 0.5 + 1 / 60
    assert base.at_or_after(Fraction(1, 2) + Fraction(1, 7000)) == 1
    a, b, d = base.integers()
    assert (50 * a + b) / d == base.seconds(50)
    with raises(ValueError):
        base.count(Fraction(1, 7))


def test_clocks_and_their_cycle():
    clocks = [Clock(3), Clock(4, 5), Clock(6, 1)]
    assert [t for t in range(14) if clocks[1].due(t)] == [5, 9, 13]
    assert [clocks[1].next(t) for t in (0, 5, 6, 9, 10)] == [5, 5, 9, 9, 13]
    begin, length = cycle(clocks)
    assert (begin, length) == (12, 12)
    assert all(c.due(t) == c.due(t + length) for c in clocks for t in range(begin, begin + length))


def test_recording_survives_the_disk(tmp_path, raises):
    data = np.array([[1 / 3, -1e-17], [np.pi, 1e300]])
    recording = Recording(np.array([0.0, 0.1]), ["car.x", "gain.y[2,3]"], data, {"car.x": "m/s2"})
    path = recording.to_csv(tmp_path / "a" / "b.csv")
    assert path.read_text().splitlines()[0] == 'time [s],car.x [m/s2],"gain.y[2,3]"'
    back = Recording.read(path)
    assert back.names == recording.names
    assert back.units["car.x"] == "m/s2"
    assert back.units["gain.y[2,3]"] == ""
    np.testing.assert_array_equal(back.data, data)
    with raises(KeyError):
        back["car.y"]
    assert "car.x" in back
    assert list(back) == back.names
    path.write_text("time [s],x\n0,1\n1,oops\n")
    with pytest.raises(ValueError, match="line 3"):
        Recording.read(path)
    path.write_text("x,y\n")
    with raises(ValueError):
        Recording.read(path)


FMI3 = b"""<fmiModelDescription fmiVersion="3.0" modelName="Arrays" instantiationToken="t">
<CoSimulation modelIdentifier="Arrays" canGetAndSetFMUState="true" providesDirectionalDerivatives="true"/>
<UnitDefinitions><Unit name="mm"><BaseUnit m="1" factor="0.001"/></Unit></UnitDefinitions>
<TypeDefinitions><Float64Type name="Length" unit="mm" min="0"/></TypeDefinitions>
<DefaultExperiment stepSize="0.002"/>
<ModelVariables>
<UInt64 name="n" valueReference="1" causality="structuralParameter" start="2"/>
<Float64 name="u" valueReference="2" causality="input" start="1 2 3" declaredType="Length"><Dimension start="3"/>
</Float64>
<Float64 name="g" valueReference="3" causality="parameter" start="5"><Dimension valueReference="1"/>
<Dimension start="2"/></Float64>
<Float64 name="x" valueReference="4" causality="output" initial="exact" start="0"/>
<Float64 name="der(x)" valueReference="5" derivative="4"/>
<String name="s" valueReference="6" causality="parameter"><Start value="hello"/></String>
</ModelVariables>
<ModelStructure><Output valueReference="4" dependencies=""/>
<ContinuousStateDerivative valueReference="5" dependencies="2 4"/></ModelStructure>
<Annotations><Annotation type="suspension-fmus"><Component kind="discrete" sampleTime="1/60"/></Annotation>
</Annotations>
</fmiModelDescription>"""


def test_fmi3_arrays_expand_to_elements():
    about = parse(FMI3, "x.fmu")
    assert list(about.inputs) == ["u[1]", "u[2]", "u[3]"]
    assert about.arrays["g"] == ["g[1,1]", "g[1,2]", "g[2,1]", "g[2,2]"]
    third = about.variables["u[3]"]
    assert (third.reference, third.index, third.size, third.start, third.minimum) == (2, 2, 3, 3.0, 0.0)
    assert third.unit.factor == 0.001
    assert about.variables["g[2,2]"].start == 5.0
    assert about.variables["s"].start == "hello"
    assert (about.kind, about.sample_time, about.default_step) == ("discrete", Fraction(1, 60), Fraction(1, 500))
    assert [v.name for v in about.states] == ["x"]
    assert about.depends("x") == frozenset()


FMI2 = b"""<fmiModelDescription fmiVersion="2.0" modelName="Two" guid="g">
<CoSimulation modelIdentifier="Two" canGetAndSetFMUstate="true"/>
<TypeDefinitions><SimpleType name="Speed"><Real unit="m/s"/></SimpleType></TypeDefinitions>
<VendorAnnotations><Tool name="suspension-fmus"><Component kind="continuous"/></Tool></VendorAnnotations>
<ModelVariables>
<ScalarVariable name="x" valueReference="0" causality="output"><Real start="1"/></ScalarVariable>
<ScalarVariable name="v" valueReference="1"><Real derivative="1" declaredType="Speed"/></ScalarVariable>
<ScalarVariable name="a" valueReference="2" causality="input"><Real start="0"/></ScalarVariable>
<ScalarVariable name="b" valueReference="3" causality="input" variability="discrete"><Boolean start="true"/>
</ScalarVariable>
<ScalarVariable name="y" valueReference="4" causality="output"><Real/></ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="1" dependencies="3"/><Unknown index="5"/></Outputs><Derivatives>
<Unknown index="2"/></Derivatives></ModelStructure>
</fmiModelDescription>"""


def test_fmi2_dependencies_and_types():
    about = parse(FMI2, "x.fmu")
    assert about.depends("x") == {"a"}
    assert about.depends("y") == {"a", "b"}  # not said, so everything
    assert about.variables["v"].unit_name == "m/s"
    assert about.variables["b"].start is True
    assert [(d.name, s.name) for d, s in zip(about.derivatives, about.states, strict=True)] == [("v", "x")]
    assert about.kind == "continuous"
    with pytest.raises(FmuError, match="FMI version 'unknown'"):
        parse(b"<a/>", "x.fmu")


def annotated(xml, words):
    """`xml` with more in its annotation."""
    return re.sub(rb"(<Component [^>]*)/>", rb"\1>" + words.encode() + b"</Component>", xml)


@pytest.mark.parametrize("xml", [FMI2, FMI3])
def test_sources_of_values(xml):
    assert {v.source for v in parse(xml, "x.fmu").variables.values()} == {None}
    words = """<!-- <b> --><Variable name="x" source="Table 2 &lt;b&gt;"/><Variable name="gone" source="nowhere"/>
    <Variable name="a" source="  "/><Variable name="b"/><Variable source="whose?"/><Source name="y">no</Source>
    <Output name="y" constant="1"/><Variable name="y" source="both"/><Variable name="g" source="of an array"/>
    <Variable name="g[2,1]" source="of one element"/>"""
    variables = parse(annotated(xml, words), "x.fmu").variables
    of_arrays = {n: "of an array" for n in variables if n.startswith("g[")}
    of_arrays |= {"g[2,1]": "of one element"} if of_arrays else {}
    of_scalars = {"x": "Table 2 <b>"} | ({"y": "both"} if "y" in variables else {})
    assert {n: v.source for n, v in variables.items() if v.source is not None} == {**of_scalars, **of_arrays}
    assert "y" not in variables or variables["y"].constant == 1.0


@pytest.mark.parametrize("xml", [FMI2, FMI3])
def test_a_source_without_an_end_is_refused_by_name(xml, raises):
    fits = annotated(xml, f'<Variable name="x" source="{"s" * LONGEST_SOURCE}"/>')
    assert parse(fits, "x.fmu").variables["x"].source == "s" * LONGEST_SOURCE
    with raises(FmuError):
        parse(annotated(xml, f'<Variable name="x" source="{"s" * (LONGEST_SOURCE + 1)}"/>'), "x.fmu")
    assert LONGEST_SOURCE == component.LONGEST_SOURCE  # who writes them and who reads them agree


class Mass(PythonComponent):
    """m dv/dt = f - c v."""

    default_step = "1 ms"
    inputs = ("f [N]",)
    outputs = ("v [m/s]",)
    feedthrough = {"v": ()}  # noqa: RUF012
    parameters = {"m": 1.0, "c": 0.1}  # noqa: RUF012

    def begin(self):
        self.v = 1.0

    def start(self, u, y):  # noqa: ARG002
        y[0] = self.v

    def step(self, t, h, u, y):  # noqa: ARG002
        decay = np.exp(-self.c / self.m * h)
        y[0] = self.v = decay * self.v + (1 - decay) / self.c * u[0]

    def linearize(self, inputs, outputs):  # noqa: ARG002
        return tuple(np.array([[x]]) for x in (-self.c / self.m, 1 / self.m, 1.0, 0.0))


class Damper(PythonComponent):
    """tau df/dt = -d v - f: stiff."""

    default_step = "1 ms"
    inputs = ("v [m/s]",)
    outputs = ("f [N]",)
    feedthrough = {"f": ()}  # noqa: RUF012
    parameters = {"d": 1.0, "tau": 1e-5}  # noqa: RUF012

    def begin(self):
        self.f = 0.0

    def start(self, u, y):  # noqa: ARG002
        y[0] = self.f

    def step(self, t, h, u, y):  # noqa: ARG002
        decay = np.exp(-h / self.tau)
        y[0] = self.f = decay * self.f - (1 - decay) * self.d * u[0]

    def linearize(self, inputs, outputs):  # noqa: ARG002
        return tuple(np.array([[x]]) for x in (-1 / self.tau, -self.d / self.tau, 1.0, 0.0))


def strut(d, method, delay=False, damper_step="1 ms"):
    system = System()
    system.add("mass", Mass())
    system.add("damper", Damper(), step=damper_step, parameters={"d": d})
    system.connect("mass.v", "damper.v", delay=delay)
    system.connect("damper.f", "mass.f")
    system.group("strut", ["mass", "damper"], method)
    return system


@pytest.mark.parametrize(
    ("d", "method", "radius"),
    [
        (900, "jacobi", np.sqrt(0.9)),  # v(k+1) = v(k) - d h v(k-1)
        (1100, "jacobi", np.sqrt(1.1)),
        (1900, "gauss-seidel", 0.9),  # v(k+1) = (1 - d h) v(k)
        (2500, "gauss-seidel", 1.5),
    ],
)
def test_spectral_radius_of_the_exchange(d, method, radius):
    result = strut(d, method).coupled_spectral_radius()
    assert result.radius == pytest.approx(radius, rel=1e-3)
    assert result.stable == (radius < 1)
    assert result.coupled_radius < 1
    assert {name for name, _ in result.dominant} == {"mass", "damper"}
    assert "spectral radius" in str(result)


def test_equal_modes_have_equal_shares():
    """Four equal struts grow alike: which of them an eigenvector of LAPACK holds is chance."""
    system = System()
    for c in ("fl", "fr", "rl", "rr"):
        system.add(f"mass.{c}", Mass())
        system.add(f"damper.{c}", Damper(), step="1 ms", parameters={"d": 1100})
        system.connect(f"mass.{c}.v", f"damper.{c}.v")
        system.connect(f"damper.{c}.f", f"mass.{c}.f")
    shares = dict(system.coupled_spectral_radius().dominant)
    for kind in ("mass", "damper"):
        of_kind = [shares[f"{kind}.{c}"] for c in ("fl", "fr", "rl", "rr")]
        assert of_kind == pytest.approx([of_kind[0]] * 4, rel=1e-6)
        assert of_kind[0] > 0.02


@pytest.mark.parametrize("delay", [False, True])
@pytest.mark.parametrize("method", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("damper_step", ["1 ms", "0.5 ms", "2 ms"])
def test_spectral_radius_is_what_a_run_grows_by(method, delay, damper_step):
    system = strut(1300, method, delay, damper_step)
    result = system.coupled_spectral_radius()
    v = system.run(0.6)["mass.v"]
    cycles = 0.2 / result.cycle
    early, late = (np.max(np.abs(v[i : i + 100])) for i in (len(v) // 3, 2 * len(v) // 3))
    grown = (late / early) ** (1 / cycles)
    assert grown == pytest.approx(result.radius, rel=0.02)


def test_running_with_the_check_warns():
    with pytest.warns(StabilityWarning, match=r"mass \(66%\), damper \(34%\)"):
        strut(1100, "jacobi").run(0.01, execution=Execution(check_stability=True))


def test_integrators_give_no_false_alarm():
    class Body(Mass):
        parameters = {"m": 1.0}  # noqa: RUF012

        def linearize(self, inputs, outputs):  # noqa: ARG002
            a = np.diag(np.ones(3), 1)  # a chain of four integrators
            return a, np.array([[0], [0], [0], [1.0]]), np.array([[0, 0, 0, 1.0]]), np.zeros((1, 1))

    system = System()
    system.add("body", Body())
    system.add("damper", Damper(), parameters={"d": 0.0})
    system.connect("body.v", "damper.v")
    system.connect("damper.f", "body.f")
    system.group("g", ["body", "damper"])
    simulation = system.initialize()
    result = system.coupled_spectral_radius()
    assert result.radius == pytest.approx(1.0, abs=1e-3)
    assert result.stable
    assert not simulation.finished


def test_components_without_a_linear_model_are_named(foreign, raises):
    system = strut(100, "jacobi")
    system.add("foreign", foreign["AddOne2"], step="1 ms", start={"u": 0.0, "enable": True})
    assert "directional derivatives" in system.coupled_spectral_radius().unchecked["foreign"]
    alone = System()
    alone.add("foreign", foreign["AddOne2"], step="1 ms", start={"u": 0.0, "enable": True})
    with raises(CosimError):
        alone.coupled_spectral_radius()
