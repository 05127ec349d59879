"""Algebraic loops among continuous components.

Refused by name where they are certain, warned of where they are only possible.
"""

import warnings
from typing import Any

import numpy as np
import pytest
from probes import Integrator
from same import assert_same

from cosim import AlgebraicLoopWarning, LoopError, PythonComponent, Recording, System
from cosim.core.dependencies import by_perturbation
from cosim.system.loops import certain, declared, find_loops

pytestmark = pytest.mark.filterwarnings("error::cosim.AlgebraicLoopWarning", "ignore::cosim.UnconnectedInputsWarning")


class Line(PythonComponent):
    """y = gain u + shift, also among initial values; what depends on what is not declared."""

    inputs = ("u",)
    outputs = ("y",)
    parameters = {"gain": 2.0, "shift": 1.0}  # noqa: RUF012

    def start(self, u: Any, y: Any) -> None:
        y[0] = self.gain * u[0] + self.shift

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        self.start(u, y)


class Declared(Line):
    feedthrough = {"y": ("u",)}  # noqa: RUF012


class Late(Line):
    """Its initial output does not tell on what later ones depend."""

    def start(self, u: Any, y: Any) -> None: ...

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        y[0] = self.gain * u[0] + self.shift


class Attached(Line):
    """Holds what cannot be copied."""

    def __init__(self) -> None:
        super().__init__()
        self.generator = (x for x in ())

    def begin(self) -> None:
        """Without state: it can run as it is."""


def ring(*components: PythonComponent, delay: bool = False) -> System:
    """Each drives the next one, and the last one the first."""
    system = System()
    names = "abcdef"[: len(components)]
    for name, component in zip(names, components, strict=True):
        system.add(name, component, step="1 ms")
    for i, name in enumerate(names):
        system.connect(f"{name}.y", f"{names[(i + 1) % len(names)]}.u", delay=delay and i == 0)
    return system


@pytest.mark.parametrize("made", [Declared, Line])
def test_a_certain_loop_is_refused_by_name_before_anything_runs(made):
    system = ring(made(), made(), made())
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # nor is anything said beside it
        with pytest.raises(LoopError) as error:
            system.run(0.01)
    text = str(error.value)
    assert text.index("a.y -> b.u") < text.index("b.y -> c.u") < text.index("c.y -> a.u")
    assert "'a', 'b', 'c'" in text
    assert "delay=True" in text
    assert ("measured" in text) == (made is Line)


def test_a_declared_loop_is_refused_where_the_schedule_is_made():
    with pytest.raises(LoopError, match=r"a\.y -> a\.u"):
        ring(Declared()).schedule()


@pytest.mark.parametrize("gain", [0.5, 1.0, -1.0])
def test_whatever_its_gain(gain):
    system = ring(Line(), Line())
    system["a"].set(gain=gain)
    with pytest.raises(LoopError):
        system.initialize()


@pytest.mark.filterwarnings("ignore:initial values do not settle")
@pytest.mark.parametrize("made", [Declared, Line])
def test_a_delay_breaks_it(made):
    result = ring(made(), made(), delay=True).run(0.004, record=["a.y"])
    assert len(result) == 5


def test_an_integrator_breaks_it():
    result = ring(Line(), Integrator()).run(0.003, record=["a.y"])
    np.testing.assert_array_equal(result["a.y"][:2], [1, 1])


def test_sampling_breaks_it(warns):
    """Once per sample x = 2 x + 1: what a sampled controller of this gain does to a plant without memory."""
    system = ring(Sampled(), Declared())
    with warns(UserWarning):
        simulation = system.initialize(record=["a.y"])
    simulation.advance(0.005)
    y = simulation.recording["a.y"]
    np.testing.assert_array_equal(y[2:5], 2 * (2 * y[1:4] + 1) + 1)


class Sampled(Declared):
    kind = "discrete"


@pytest.mark.filterwarnings("ignore:initial values do not settle")
@pytest.mark.parametrize("made", [Late, Attached])
def test_a_loop_that_is_only_possible_is_warned_of_with_its_path(made):
    system = ring(made(), Declared(), Declared())
    schedule = str(system.schedule())
    assert "Possible algebraic loops" in schedule
    with pytest.warns(AlgebraicLoopWarning) as found:
        result = system.run(0.01, record=["b.y"])
    assert len(result) == 11
    (text,) = [str(w.message) for w in found if w.category is AlgebraicLoopWarning]
    assert "'a' does not declare" in text
    for connection in ("a.y -> b.u", "b.y -> c.u", "c.y -> a.u"):
        assert connection in text
        assert connection in schedule.split("Possible")[1]


def test_measuring_leaves_no_trace():
    class Counting(Late):
        def begin(self) -> None:
            self.calls: list[float] = []

        def start(self, u: Any, y: Any) -> None:  # noqa: ARG002
            self.calls.append(float(u[0]))

    system = ring(Counting(), Declared())
    with pytest.warns(AlgebraicLoopWarning):
        system.initialize(record=["a.y"])
    assert set(system["a"].implementation.calls) == {0.0, 1.0}


def test_loops_through_arrays_of_outputs_are_told_apart():
    class Cross(PythonComponent):
        inputs = ("u1", "u2")
        outputs = ("y1", "y2")
        feedthrough = {"y1": ("u2",), "y2": ()}  # noqa: RUF012

        def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
            y[0] = u[1]

    system = System()
    system.add("a", Cross(), step="1 ms")
    system.connect("a.y1", "a.u1")  # y1 depends on u2 only
    system.connect("a.y2", "a.u2")
    assert not system.schedule().possible_loops
    system.disconnect("a.u2")
    system.connect("a.y1", "a.u2")
    with pytest.raises(LoopError, match=r"a\.y1 -> a\.u2"):
        system.schedule()


def test_one_loop_of_each_set_that_shares_components_is_named():
    system = System()
    for name in ("a", "b", "c", "d"):
        system.add(name, Late(), step="1 ms")
    for source, target in (("a", "b"), ("b", "a"), ("c", "d"), ("d", "c")):
        system.connect(f"{source}.y", f"{target}.u")
    connections = system.schedule().connections
    assert [[c.source.name for c in loop] for loop in find_loops(connections, declared)] == [["a", "b"], ["c", "d"]]
    assert not find_loops(connections, certain)


def test_noise_is_no_dependency():
    """An output that does not come back when its input does, as an iteration within an FMU leaves it."""
    component = Line()
    component.instantiate("line")
    component.enter_initialization(0.0, None)
    noise = iter([0.0, 1e-7, 1e-8])
    names = list(component.description.inputs.values()), list(component.description.outputs.values())

    def compute() -> None:
        component._y[0] = 1.0 + next(noise)

    assert by_perturbation(component, *names, compute) == {"y": frozenset()}
    assert component.measure_dependencies(*names) == {"y": frozenset({"u"})}


def test_a_linear_model_solves_loops():
    class Static(Declared):
        def linearize(self, inputs: Any, outputs: Any) -> Any:  # noqa: ARG002
            return np.zeros((0, 0)), np.zeros((0, len(inputs))), np.zeros((1, 0)), np.array([[0.5] * len(inputs)])

    system = System()
    system.add("a", Static(), step="1 ms", parameters={"gain": 0.5})
    system.add("b", Static(), step="1 ms", parameters={"gain": 0.5})
    system.connect("a.y", "b.u")
    system.connect("b.y", "a.u")
    assert system.linearize([], ["a.y"]).output_labels == ["a_y"]
    with pytest.raises(LoopError):
        system.linearize([], ["a.y"], settle=0.01)


# FMUs.


@pytest.mark.parametrize("fmi", [2, 3])
def test_what_an_fmu_does_not_declare_is_measured_from_a_saved_state(follower, fmi):
    """`count` is `count_in` plus the number of steps, and `y` a state: the FMU says neither."""
    with System() as system:
        system.add("a", follower[fmi], step="1 ms", parameters={"rate": 50.0})
        system.add("b", follower[fmi], step="2 ms", start={"u": 3.0})
        system.connect("a.y", "b.u")
        system.connect("b.y", "a.u")
        with pytest.warns(AlgebraicLoopWarning, match=r"a\.y -> b\.u\n *b\.y -> a\.u"):
            system.run(0.01)
        system.connect("a.count", "b.count_in")
        system.connect("b.count", "a.count_in")
        with pytest.raises(LoopError, match=r"measured.*\n *a\.count -> b\.count_in\n *b\.count -> a\.count_in"):
            system.run(0.01)
        system.disconnect("b.count_in")
        system.connect("a.count", "b.count_in", delay=True)
        with pytest.warns(AlgebraicLoopWarning):
            assert system.run(0.01)["b.count"][-1] > 0


@pytest.mark.parametrize("fmi", [2, 3])
def test_measuring_changes_no_bit_of_a_run(follower, fmi, monkeypatch):
    def run() -> Recording:
        with System() as system:
            system.add("a", follower[fmi], step="1 ms", parameters={"rate": 50.0}, start={"count_in": 7})
            system.add("b", follower[fmi], step="2 ms", start={"on": True})
            system.connect("a.y", "b.u")
            system.connect("b.y", "a.u")
            return system.run(0.02)

    with pytest.warns(AlgebraicLoopWarning):
        measured = run()
    monkeypatch.setattr("cosim.engine.initialization.check_loops", lambda *_: None)
    assert_same(run(), measured)


def test_where_there_are_directional_derivatives_these_tell(built_fmus):
    def car(output: str) -> System:
        system = System()
        system.add("car", built_fmus.path("QuarterCarHmmwv", 3), step="1 ms")
        system["car"].description.dependencies.clear()  # as of a tool that does not write them
        system.connect(f"car.{output}", "car.force", linear=(0.1, 0.0))
        return system

    with car("body.az") as system, pytest.raises(LoopError, match=r"car\.body\.az -> car\.force"):
        system.run(0.01)
    with car("body.vz") as system, pytest.warns(AlgebraicLoopWarning, match=r"car\.body\.vz -> car\.force"):
        system.run(0.01)


def test_a_measured_loop_is_not_exported_either(follower, tmp_path):
    with System() as system:
        system.add("a", follower[2], step="1 ms")
        system.connect("a.count", "a.count_in")
        with pytest.raises(LoopError, match=r"a\.count -> a\.count_in"):
            system.export_fmu(tmp_path / "Loop.fmu")
