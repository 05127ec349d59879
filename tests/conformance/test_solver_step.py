"""A solver step that does not suit the parameters set: the FMU comes to the verdict of the build's own check."""

from __future__ import annotations

import re
from dataclasses import dataclass

import components
import numpy as np
import pytest
from api import ERROR, OK, Library, Model, Refused
from applies import applies_to, continuous
from built import FMUS

from build_fmus.component import Model as DeclaredModel
from build_fmus.stability import find_instability, matrices_by_point
from fmu_sources.catalog import Context, default_catalog

DRAWS = 40
_REFUSAL = re.compile(
    r"with the parameters set, solver \w+ with solver\.step (?P<set>\S+) s is unstable at (?:operating point"
    r" '(?P<point>.+)'|"
    r"the present state) \(eigenvalue (?P<re>[^ ]+?)(?P<im>[+-][^+-]+(?:e[+-]\d+)?)i 1/s\); "
    r"(?:a solver\.step of (?P<step>\S+) s would do|no solver\.step within its limits would do)"
)


@dataclass(frozen=True)
class Refusal:
    """What the FMU says."""

    point: str | None
    eigenvalue: complex
    step: float | None


def verdict(fmu: Library, values: dict[str, float], kind: str = "cs") -> Refusal | None:
    """None when initialization succeeds."""
    with fmu.instance(kind) as a:
        try:
            a.initialize(values)
        except Refused as error:
            found = _REFUSAL.search(str(error))
            if not found:
                raise
            step = float(found["step"]) if found["step"] else None
            return Refusal(found["point"], complex(float(found["re"]), float(found["im"])), step)
    return None


def declared(name: str) -> DeclaredModel:
    if name in components.MAKERS:
        return components.MAKERS[name]().model()
    return default_catalog()[name].make(Context(FMUS, FMUS / ".cache")).model()


def random_parameters(component: DeclaredModel, rng: np.random.Generator) -> dict[str, float]:
    """A few parameters, far from their start values but within their limits; half of the time another solver step."""
    reals = [e for e in component.elements("parameter") if e.variable.type == "Float64" and e.name != "solver.step"]
    values = {}
    for i in rng.choice(len(reals), size=min(len(reals), rng.integers(1, 7)), replace=False):
        e = reals[i]
        value = (e.start or 1.0) * 10.0 ** rng.uniform(-4, 4)
        low, high = (
            (-np.inf if e.variable.min is None else e.variable.min),
            (np.inf if e.variable.max is None else e.variable.max),
        )
        values[e.name] = float(np.clip(value, low, high))
    if rng.random() < 0.5:
        values["solver.step"] = float(10.0 ** rng.uniform(-3.5, -2))
    return values


def starts(fmu: Library, values: dict[str, float]) -> None:
    """Initialize and show all outputs."""
    with fmu.instance() as a:
        a.initialize(values)
        a.get(list(fmu.structure("Output")))


@applies_to(continuous)
def test_the_verdict_is_that_of_the_build(pair: tuple[Library, Library]) -> None:
    """Same verdict, same eigenvalue, same longest step as the Python check, for random parameters."""
    component = declared(pair[0].name)
    slots = {e.name: e.slot for e in component.elements("parameter")}
    rng, seen = np.random.default_rng(20), set()
    for _ in range(DRAWS):
        values = random_parameters(component, rng)
        p = component.vector("parameter")
        for n, v in values.items():
            p[slots[n]] = v
        if component.failed_checks(p=p):
            continue
        matrices = matrices_by_point(component, p)
        if not all(np.isfinite(m).all() for m in matrices.values()):  # such as no place of rest
            for fmu in pair:
                with pytest.raises(Refused, match="not finite"):
                    starts(fmu, values)
            continue
        expected = find_instability(component, matrices, p[0])
        seen.add(expected is None)
        for fmu in pair:
            said = verdict(fmu, values)
            if expected is None or said is None:
                assert said is None, (values, said)
                assert expected is None, (values, expected)
                continue
            assert abs(said.eigenvalue) == pytest.approx(abs(expected.eigenvalue), rel=1e-3), values
            assert said.step == (expected.step and pytest.approx(expected.step, rel=6e-3)), values
            assert said.point is not None
            there = np.linalg.eigvals(matrices[said.point])  # points with equal eigenvalues are equally good
            assert np.abs(there - said.eigenvalue).min() < 1e-3 * abs(said.eigenvalue)
    # ros2 follows every mode that decays, at any step.
    assert seen == ({True} if component.solver == "ros2" else {True, False}), "the draws are all of one kind"


def test_a_wheel_of_one_kilogram_is_refused(load) -> None:  # type: ignore[no-untyped-def]
    """Within its limits it would give 1e12 m/s2 after three steps. The step that is named does, for a second."""
    fmu: Library = load("FullCarHmmwv", 2)
    said = verdict(fmu, {"wheel.mass": 1.0})
    assert said is not None
    assert said.step is not None
    assert said.eigenvalue.real < -4000
    with fmu.instance() as a:
        a.initialize({"wheel.mass": 1.0, "solver.step": said.step, "road.fl.height": 0.02})
        a.set({"road.fl.height": 0.0})
        for _ in range(1000):
            a.step(1e-3)
        assert np.abs(a.get(["body.az", "wheel.fl.az"])).max() < 0.1
    assert verdict(fmu, {"wheel.mass": 1.0}, "me") is None, "Model Exchange: the tool's solver chooses its own steps"


def test_a_tunable_parameter_is_refused_when_it_is_set(load) -> None:  # type: ignore[no-untyped-def]
    """The call that sets it fails and changes nothing; the run continues with what was there before."""
    for fmi in (2, 3):
        fmu: Library = load("ProbeRk4", fmi)
        with fmu.instance() as a, fmu.instance() as b:
            for one in (a, b):
                one.initialize()
                one.step(fmu.step)
            assert a.try_set({"damping": 1e5, "force": 3.0}) == ERROR
            assert "is unstable" in a.last_message
            np.testing.assert_array_equal(a.get(["damping", "force"]), b.get(["damping", "force"]))
            for one in (a, b):
                one.set({"damping": 4.0})
                one.step(fmu.step)
            assert a.get(fmu.outputs).tobytes() == b.get(fmu.outputs).tobytes()
        with fmu.instance("me") as a:
            a.initialize()
            assert a.try_set({"damping": 1e5}) == OK


def options(fmu: Model) -> list[str]:
    """Boolean and Integer parameters."""
    return [*fmu.names("parameter", "boolean"), *fmu.names("parameter", "integer")]


@applies_to(continuous, options)
def test_no_option_is_refused(fmu: Library) -> None:
    """Every Boolean and Integer parameter, each of its values: what experiments switch on and off is no false alarm."""
    for name in options(fmu):
        v = fmu.variables[name]
        values = (0, 1) if v.kind == "boolean" else range(int(v.low or 0), int(v.high or 0) + 1)
        for value in values:
            assert verdict(fmu, {name: value}) is None, (name, value)
