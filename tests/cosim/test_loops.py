"""Algebraic loops among continuous components.

Solved where they are certain or measured, warned of where they are only possible.
"""

from dataclasses import replace
from string import ascii_letters
from typing import Any

import numpy as np
import pytest
from foreign import sloped
from foreign.making import redescribed
from oracles.exchange_rule import by_the_rule
from probes import Integrator
from same import assert_same

from build_fmus.base import surface
from cosim import (
    AlgebraicLoopWarning,
    ComponentError,
    CosimError,
    Execution,
    LoopError,
    PythonComponent,
    Record,
    Recording,
    System,
    WiringError,
)
from cosim.batch import Batch
from cosim.core.dependencies import by_perturbation
from cosim.core.time import rational
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


class AnyTime(Declared):
    computes_on_get = True


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


def ring(*components: PythonComponent, delay: bool = False, letters: str = "abcdef") -> System:
    """Each drives the next one, and the last one the first."""
    system = System()
    names = letters[: len(components)]
    for name, component in zip(names, components, strict=True):
        system.add(name, component, step="1 ms")
    for i, name in enumerate(names):
        system.connect(f"{name}.y", f"{names[(i + 1) % len(names)]}.u", delay=delay and i == 0)
    return system


def pair(first: PythonComponent, second: PythonComponent) -> System:
    """a.y = 2 b.y + 1 and b.y = -3 a.y + 1: a.y = 3/7, b.y = -2/7."""
    system = ring(first, second)
    system["b"].set(gain=-3.0)
    return system


@pytest.mark.parametrize("made", [Declared, Line, AnyTime])
@pytest.mark.parametrize("other", [Declared, AnyTime])
def test_a_linear_loop_is_solved_whatever_its_gain(made, other):
    """Declared or measured, of components that compute at any time and of those whose steps are repeated."""
    result = pair(made(), other()).run(0.003, record=["a.y", "b.y"])
    np.testing.assert_allclose(result["a.y"], [3 / 7] * 4, rtol=1e-12)
    np.testing.assert_allclose(result["b.y"], [-2 / 7] * 4, rtol=1e-12)
    (effort,) = result.loops
    assert effort.unknowns == ("b.y",)
    assert effort.solutions in (5, 6)  # initialization once or twice, and four arrivals but for the first
    assert effort.most_evaluations == 3  # the guess, the difference, Newton's step


@pytest.mark.parametrize("made", [Declared, Line])
def test_a_loop_without_a_solution_ends_the_run_by_name(made):
    """a.y = b.y + 1 and b.y = a.y + 1."""
    system = ring(made(), made())
    system["a"].set(gain=1.0)
    system["b"].set(gain=1.0)
    with pytest.raises(ComponentError) as error:
        system.run(0.01)
    text = str(error.value)
    assert "no solution at t = 0 s" in text
    assert "b.y = 0 (residual 2)" in text
    assert "a.y -> b.u" in text
    assert "delay=True" in text
    assert error.value.status == "not solved"
    with surface.command(["--lanes"]), pytest.raises(ComponentError) as error:  # no option sets a connection
        system.run(0.01)
    assert "delay=True" not in str(error.value)


def test_the_schedule_tells_of_a_loop():
    text = str(pair(Declared(), Declared()).schedule())
    assert "Algebraic loop, solved for b.y at each exchange:\n    a.y -> b.u\n    b.y -> a.u" in text


class Cubic(PythonComponent):
    """y = t - u^3; with y = u the one real root of y^3 + y = t."""

    inputs = ("u",)
    outputs = ("y",)
    feedthrough = {"y": ("u",)}  # noqa: RUF012
    computes_on_get = True

    def begin(self) -> None:
        self.t = 0.0

    def start(self, u: Any, y: Any) -> None:
        y[0] = self.t - u[0] ** 3

    def step(self, t: float, h: float, u: Any, y: Any) -> None:
        self.t = t + h
        self.start(u, y)


class Relay(Cubic):
    """y = 1 below the time, else -1: without a solution from t = -1 to 1."""

    def start(self, u: Any, y: Any) -> None:
        y[0] = 2.0 if u[0] < 0.01 - self.t else -self.t


class Saturated(Cubic):
    """y = t - 5 u within +-0.1: the solution has kinks."""

    def start(self, u: Any, y: Any) -> None:
        y[0] = min(0.1, max(-0.1, self.t - 0.2 - 5.0 * u[0]))


def test_a_nonlinear_loop_is_solved_at_every_instant():
    result = ring(Cubic()).run(2, record=["a.y"])
    roots = [next(r.real for r in np.roots([1, 0, 1, -t]) if abs(r.imag) < 1e-9) for t in result.time]
    np.testing.assert_allclose(result["a.y"], roots, atol=1e-9)
    assert result.loops[0].most_evaluations <= 6


class Square(Line):
    """y = u^2 + shift: with shift = -2, the solutions of y = u are 2 and -1."""

    feedthrough = {"y": ("u",)}  # noqa: RUF012

    def start(self, u: Any, y: Any) -> None:
        y[0] = u[0] ** 2 - 2.0


class Root(Square):
    """y = sqrt(u - 1) + 2, without a value for u < 1; y = u is (5 + sqrt 5) / 2."""

    def start(self, u: Any, y: Any) -> None:
        y[0] = np.sqrt(u[0] - 1.0) + 2.0 if u[0] >= 1.0 else np.nan


def with_gain_of_1(first: PythonComponent, **starts: float) -> System:
    """Two components, the second of which passes its input on."""
    system = ring(first, AnyTime())
    system["b"].set(gain=1.0, shift=0.0)
    for name, start in starts.items():
        system[name].set(u=start)
    return system


@pytest.mark.parametrize(
    ("starts", "solution"), [({}, -1), ({"a": 2.001}, 2), ({"b": 2.001}, 2), ({"a": -3, "b": 9}, -1)]
)
def test_a_given_start_value_of_an_input_chooses_the_solution(starts, solution):
    system = with_gain_of_1(Square(), **starts)
    np.testing.assert_allclose(system.run(0.003, record=["a.y"])["a.y"], solution, rtol=1e-8)


def test_a_restart_begins_at_the_present_start_values():
    system = with_gain_of_1(Square(), b=2.001)
    with system.initialize(record=["a.y"]) as simulation:
        assert simulation["a.y"] == pytest.approx(2, rel=1e-8)
        system["b"].set(u=-1.001)
        simulation.restart()
        assert simulation["a.y"] == pytest.approx(-1, rel=1e-8)


def test_a_start_value_is_converted_to_that_of_the_output():
    system = System()
    system.add("a", Square(), step="1 ms", start={"u": 2.001})
    system.connect("a.y", "a.u", linear=(-1.0, 4.0))
    found = system.run(0.002, record=["a.y"])["a.y"]  # y = (4 - y)^2 - 2: (9 - sqrt 25) / 2 from 1.999
    np.testing.assert_allclose(found, 2.0, rtol=1e-8)


def test_a_loop_without_a_value_at_its_first_guess_says_what_to_do():
    with pytest.raises(ComponentError) as error:
        with_gain_of_1(Root()).run(0.003)
    text = str(error.value)
    assert "algebraic loop through 'a' has no solution at t = 0 s" in text
    assert "where a.y is nan" in text
    assert "start=" in text
    found = with_gain_of_1(Root(), a=2.6).run(0.003, record=["a.y"])["a.y"]
    np.testing.assert_allclose(found, (5 + np.sqrt(5)) / 2, rtol=1e-9)


def test_a_loop_with_kinks_is_solved_on_either_side():
    result = ring(Saturated()).run(1, record=["a.y"])
    expected = np.clip((result.time - 0.2) / 6, -0.1, 0.1)
    np.testing.assert_allclose(result["a.y"], expected, atol=1e-9)


def test_a_loop_that_loses_its_solution_keeps_the_recording():
    """Y = 2 for u < 0.01 - t, and -t for others: from t = 0.01 on no value is its own."""
    with pytest.raises(ComponentError, match="or its solution jumps there") as error:
        ring(Relay()).run(0.05, record=["a.y"])
    assert error.value.recording is None or len(error.value.recording) < 50


def test_a_loop_of_two_unknowns_and_one_behind_it():
    """X = A x + b with a full matrix, and a loop that reads its solution and is solved after it."""

    class Two(PythonComponent):
        inputs = ("u1", "u2")
        outputs = ("y1", "y2")
        feedthrough = {"y1": ("u1", "u2"), "y2": ("u1", "u2")}  # noqa: RUF012
        computes_on_get = True

        def start(self, u: Any, y: Any) -> None:
            y[:] = np.array([[0.5, -2.0], [4.0, 3.0]]) @ u + [1.0, 2.0]

        def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
            self.start(u, y)

    class Behind(Two):
        def start(self, u: Any, y: Any) -> None:
            y[:] = [-u[0] + u[1], 0.0]

    system = System()
    system.add("z", Two(), step="1 ms")
    system.add("a", Behind(), step="1 ms")
    system.connect("z.y1", "z.u1")
    system.connect("z.y2", "z.u2")
    system.connect("a.y1", "a.u1")
    system.connect("z.y1", "a.u2")
    result = system.run(0.002, record=["z.y1", "z.y2", "a.y1"])
    x = np.linalg.solve(np.eye(2) - [[0.5, -2.0], [4.0, 3.0]], [1.0, 2.0])
    np.testing.assert_allclose(result.data[-1], [*x, x[0] / 2], rtol=1e-9)
    assert [e.unknowns for e in result.loops] == [("z.y1", "z.y2"), ("a.y1",)]


def test_a_discrete_component_that_drives_a_loop_is_followed_at_once():
    """What is recorded solves the equations with the controller's new output; the controller reads a solved loop."""

    class Driven(Cubic):
        inputs = ("u", "force")
        feedthrough = {"y": ("u", "force")}  # noqa: RUF012

        def start(self, u: Any, y: Any) -> None:
            y[0] = u[1] - 4.0 * u[0]

    class Count(PythonComponent):
        inputs = ("y",)
        outputs = ("force", "seen")
        kind = "discrete"

        def begin(self) -> None:
            self.n = 0

        def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
            self.n += 1
            y[:] = self.n, u[0]

    system = System()
    system.add("a", Driven(), step="1 ms")
    system.add("c", Count(), step="2 ms")
    system.connect("a.y", "a.u")
    system.connect("c.force", "a.force")
    system.connect("a.y", "c.y")
    result = system.run(0.004, record=["a.y", "c.force", "c.seen"])
    np.testing.assert_allclose(result["c.force"], [1, 1, 2, 2, 3])
    np.testing.assert_allclose(result["a.y"], result["c.force"] / 5, rtol=1e-12)
    np.testing.assert_allclose(result["c.seen"], [0, 0, 0.2, 0.2, 0.4], atol=1e-12)


def test_a_loop_needs_one_rate_real_values_and_no_extrapolation():
    system = ring(Declared(), Declared())
    system["b"].step *= 2
    with pytest.raises(LoopError, match=r"'a' every 0\.001 s, 'b' every 0\.002 s"):
        system.schedule()
    system["b"].step /= 2
    system.disconnect("b.u")
    system.connect("a.y", "b.u", extrapolate=True)
    with pytest.raises(LoopError, match=r"a\.y -> b\.u is extrapolated"):
        system.schedule()


def test_a_component_whose_steps_cannot_be_repeated_is_named():
    class Fixed(Declared):
        def __init__(self) -> None:
            super().__init__()
            self.description = replace(self.description, can_save=False)

    with pytest.raises(LoopError, match="'a' is part of an algebraic loop, computes its outputs in steps only"):
        ring(Fixed()).run(0.01)


def test_the_tolerance_is_met_and_checked():
    exact, loose = (
        ring(Cubic()).run(1, record=["a.y"], execution=Execution(loop_tolerance=tolerance))
        for tolerance in (1e-12, 1e-3)
    )
    for result, tolerance in ((exact, 1e-12), (loose, 1e-3)):
        y = result["a.y"]
        assert np.abs(y + y**3 - result.time).max() <= tolerance
    assert loose.loops[0].evaluations < exact.loops[0].evaluations
    assert np.abs(loose["a.y"] - exact["a.y"]).max() > 1e-6
    for wrong in (0.0, -1.0, float("nan")):
        with pytest.raises(WiringError, match="loop_tolerance"):
            Execution(loop_tolerance=wrong)


def test_a_saved_state_continues_a_loop_bit_for_bit():
    whole = ring(Cubic()).run(0.1, record=["a.y"])
    simulation = ring(Cubic()).initialize(record=["a.y"])
    simulation.advance(0.05)
    state = simulation.save()
    simulation.advance(0.08)
    simulation.restore(state)
    simulation.advance(0.1, final=True)
    assert_same(simulation.recording, whole)


@pytest.mark.filterwarnings("ignore:initial values do not settle")
@pytest.mark.parametrize("made", [Declared, Line])
def test_a_delay_breaks_it(made):
    result = ring(made(), made(), delay=True).run(0.004, record=["a.y"])
    assert len(result) == 5


def test_an_integrator_breaks_it():
    result = ring(Line(), Integrator()).run(0.003, record=["a.y"])
    np.testing.assert_array_equal(result["a.y"][:2], [1, 1])


def test_sampling_breaks_it():
    """Once per sample x = 2 (2 x + 1) + 2: what a sampled controller of this gain does to a plant without memory.

    The initial values solve the equations of the loop, x = 2 (2 x + 1) + 1, by which they do not settle.
    """
    system = ring(Sampled(), Declared())
    simulation = system.initialize(record=["a.y"])
    assert abs(simulation["a.y"] + 1.0) < 1e-8
    assert simulation.recording.loops == ()
    simulation.set("a.shift", 2.0)
    simulation.advance(0.005)
    y = simulation.recording["a.y"]
    np.testing.assert_array_equal(y[2:5], 2 * (2 * y[1:4] + 1) + 2)
    assert y[5] > 300.0


def test_initial_values_of_a_sampled_loop_without_a_solution_are_warned_of(warns):
    """The values y = 2 u + 1 and y = u / 2 have none."""
    system = ring(Sampled(), Declared())
    system["b"].set(gain=0.5, shift=0.0)
    with warns(UserWarning):
        system.initialize(record=["a.y"])


class Sampled(Declared):
    kind = "discrete"


@pytest.mark.parametrize("n", [2, 40])
@pytest.mark.filterwarnings("error")
def test_initial_values_that_overflow_do_not_settle(n):
    """Those of y = 1e6 u + 1 grow by 1e6 per round; with 40 components there are enough rounds for infinity."""
    letters = "".join(sorted(ascii_letters))  # in order of execution
    system = ring(Sampled(), *(Declared() for _ in range(n - 1)), letters=letters)
    for name in letters[:n]:
        system[name].set(gain=1.0, shift=0.0)
    system["A"].set(gain=1e6, shift=1.0)
    with np.errstate(over="ignore"):
        begun = system.initialize(record=["A.y"])
    assert abs(begun["A.y"] + 1e-6) < 1e-9


def test_a_value_that_is_infinite_from_the_start_is_named_without_a_warning(recwarn):
    class Infinite(Declared):
        def start(self, u: Any, y: Any) -> None:  # noqa: ARG002
            y[0] = np.inf

    with pytest.raises(ComponentError, match="component 'a': y is inf"):
        ring(Infinite(), Integrator()).initialize()
    assert not recwarn.list


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
    assert set(system["a"].implementation.calls) == {1.0}


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
    (loop,) = system.schedule().loops
    assert str(loop).strip() == "a.y1 -> a.u2"


def test_one_loop_of_each_set_that_shares_components_is_named():
    system = System()
    for name in ("a", "b", "c", "d"):
        system.add(name, Late(), step="1 ms")
    for source, target in (("a", "b"), ("b", "a"), ("c", "d"), ("d", "c")):
        system.connect(f"{source}.y", f"{target}.u")
    connections = system.schedule().connections
    found = find_loops(connections, declared)
    assert [[m.name for m in loop.components] for loop in found] == [["a", "b"], ["c", "d"]]
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
    for settle in (0.0, 0.01):
        assert system.linearize([], ["a.y"], settle=settle).output_labels == ["a_y"]


# FMUs.


def of_two_slopes(path: Any, *, trouble: int = 0, second: Any = None) -> System:
    """Two components that offer directional derivatives, or the second one not; two values solve their loop."""
    system = System()
    for name, file in (("m", path), ("n", second or path)):
        system.add(name, file, step="10 ms", parameters={"k": 0.5, "trouble": float(trouble)})
    system.connect("m.a", "n.p", linear=(1.0, 0.1))
    system.connect("m.b", "n.q")
    system.connect("n.a", "m.p")
    system.connect("n.b", "m.q", linear=(-2.0, 0.0))
    return system


SLOPED = ("m.a", "m.b", "n.a", "n.b")


def is_solved(run: Recording) -> bool:
    """The recorded values satisfy the equations of both components."""
    ma, mb, na, nb = (run[n] for n in SLOPED)
    t, (p, q), (r, s) = run.time, (na, -2.0 * nb), (ma + 0.1, mb)
    pairs = (
        (ma, t + 0.5 * np.sin(p) + q / 4),
        (mb, p * q / 8 - 0.5 * np.cos(q)),
        (na, t + 0.5 * np.sin(r) + s / 4),
        (nb, r * s / 8 - 0.5 * np.cos(s)),
    )
    return all(np.abs(x - y).max() < 1e-8 for x, y in pairs)


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("isolated", [False, True])
def test_directional_derivatives_replace_evaluations_bit_for_bit_as_in_the_rule(fmi, isolated, tmp_path):
    path, silent = sloped.build(fmi, tmp_path), sloped.build(fmi, tmp_path, offers=False)
    execution = Execution(isolate=("*",) if isolated else ())
    effort = {}
    for name, files in {"both": (path, path), "one": (path, silent), "none": (silent, silent)}.items():
        with of_two_slopes(files[0], second=files[1]) as system:
            run = system.run(0.5, record=SLOPED, execution=execution)
        with of_two_slopes(files[0], second=files[1]) as system:
            assert_same(run, by_the_rule(system, "0.5", SLOPED))
        assert is_solved(run)
        (effort[name],) = run.loops
    both, one, none = effort.values()
    assert both.solutions == one.solutions == none.solutions
    assert none.derivatives == 0
    assert both.derivatives == 2 * one.derivatives > 0
    assert none.evaluations == one.evaluations > both.evaluations
    assert both.evaluations + both.derivatives // 2 == none.evaluations  # one column of the Jacobian needs both of them
    assert f", and {both.derivatives} directional derivatives" in str(both)


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("trouble", [1, 2, 3, 4])
def test_wrong_or_missing_directional_derivatives_do_not_change_the_solution(fmi, trouble, tmp_path):
    """Their step does not reduce the residual, or there is none: differences serve instead."""
    path = sloped.build(fmi, tmp_path)
    with of_two_slopes(path, trouble=trouble) as system:
        run = system.run(0.5, record=SLOPED)
    with of_two_slopes(path, trouble=trouble) as system:
        assert_same(run, by_the_rule(system, "0.5", SLOPED))
    with of_two_slopes(path) as system:
        right = system.run(0.5, record=SLOPED)
    assert is_solved(run)
    np.testing.assert_allclose(run.data, right.data, atol=1e-8)
    assert run.loops[0].evaluations > right.loops[0].evaluations


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("isolated", [False, True])
def test_discard_at_a_trial_point_halves_the_step(fmi, isolated, tmp_path):
    """The first step of Newton's method for a = sin p, p = a / 0.7 goes from p = 0.7 to -1.7; outputs need p >= -1."""
    with System() as system:
        system.add("m", sloped.build(fmi, tmp_path), step="10 ms", parameters={"trouble": 7.0}, start={"p": 0.7})
        system.connect("m.a", "m.p", linear=(1 / 0.7, 0.0))
        execution = Execution(isolate=("*",) if isolated else ())
        a = system.run(0.0, record=["m.a"], execution=execution)["m.a"]
    np.testing.assert_allclose(a, np.sin(a / 0.7), atol=1e-8)


def test_the_start_value_of_the_fmu_itself_counts_where_none_is_given(tmp_path):
    begin = b'name="p" valueReference="0" causality="input" variability="continuous" start='
    path = redescribed(sloped.build(3, tmp_path), tmp_path / "Started.fmu", (begin + b'"0.0"', begin + b'"1.3"'))
    with System() as system:
        system.add("m", path, step="10 ms")
        system.connect("m.a", "m.p", linear=(1 / 0.7, 0.0))
        assert system.run(0, record=["m.a"])["m.a"] == pytest.approx([0.98713], abs=1e-5)


def test_exported_systems_begin_loops_at_start_values(tmp_path):
    """Of a = sin p, p = a / 0.7, which has the solutions 0 and +-0.987."""
    ends = []
    for start in (0.0, 1.3, -1.3):
        with System() as system:
            system.add("m", sloped.build(3, tmp_path), step="10 ms", start={"p": start})
            system.connect("m.a", "m.p", linear=(1 / 0.7, 0.0))
            native = system.run(0.02, record=["m.a"])["m.a"]
            file = system.export_fmu(tmp_path / "Loop.fmu")
        with System() as system:
            system.add("whole", file, step="10 ms")
            np.testing.assert_array_equal(system.run(0.02, record=["whole.m.a"])["whole.m.a"], native)
        ends.append(native[0])
    np.testing.assert_allclose(ends, [0.0, 0.98713, -0.98713], atol=1e-5)


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_loop_among_initial_values_only_is_solved_there(fmi, tmp_path):
    """Of a = sin p + q / 4 with q = 1 - 8 a, which passing values on would not find."""
    later = [
        (b'<Output valueReference="2" dependencies="0 1"/>', b'<Output valueReference="2" dependencies=""/>'),
        (b'<Outputs><Unknown index="3" dependencies="1 2"/>', b'<Outputs><Unknown index="3" dependencies=""/>'),
    ]
    path = redescribed(sloped.build(fmi, tmp_path), tmp_path / "Initial.fmu", later[fmi == 2])
    with System() as system:
        system.add("m", path, step="10 ms", start={"p": 0.5})
        system.connect("m.a", "m.q", linear=(-8.0, 1.0))
        assert "Algebraic loop, solved for m.a in initialization only" in str(system.schedule())
        native = system.run(0.03, record=["m.a"])
        file = system.export_fmu(tmp_path / "Whole.fmu", fmi=fmi)
    found = native["m.a"]
    np.testing.assert_allclose(found[0], (np.sin(0.5) + 0.25) / 3, rtol=1e-9)
    lagging = np.sin(0.5) + native.time[1:] + 0.25 - 2 * found[:-1]  # it does not depend on q, says the FMU
    np.testing.assert_allclose(found[1:], lagging, rtol=1e-12)
    assert native.loops[0].solutions > 0
    with System() as system:
        system.add("whole", file, step="10 ms")
        np.testing.assert_array_equal(system.run(0.03, record=["whole.m.a"])["whole.m.a"], found)


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("isolated", [False, True])
def test_derivatives_that_are_declared_but_not_in_the_library_are_done_without(fmi, isolated, tmp_path):
    path = sloped.build(fmi, tmp_path, lacking=True)
    with of_two_slopes(path) as system:
        run = system.run(0.5, record=SLOPED, execution=Execution(isolate=("*",) if isolated else ()))
        file = system.export_fmu(tmp_path / "Loop.fmu")
    with System() as system:
        system.add("whole", file, step="10 ms")
        whole = system.run(0.5, record=[f"whole.{n}" for n in SLOPED])
    assert is_solved(run)
    np.testing.assert_array_equal(whole.data, run.data)
    if not isolated:
        assert run.loops[0].derivatives == 0


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_fmu_that_is_lost_when_asked_for_a_derivative_is_named(fmi, tmp_path):
    with (
        of_two_slopes(sloped.build(fmi, tmp_path), trouble=5) as system,
        pytest.raises(ComponentError, match=r"'m'.*GetDirectionalDerivative returned Fatal"),
    ):
        system.run(0.5)


def test_exported_systems_use_directional_derivatives_too(tmp_path):
    path = sloped.build(3, tmp_path)
    for files in ((path, path), (path, sloped.build(2, tmp_path)), (path, sloped.build(3, tmp_path, offers=False))):
        with of_two_slopes(files[0], second=files[1]) as system:
            native = system.run(0.3, record=SLOPED)
            file = system.export_fmu(tmp_path / "Loop.fmu")
        with System() as system:
            system.add("whole", file, step="10 ms")
            run = system.run(0.3, record=[f"whole.{n}" for n in SLOPED])
        np.testing.assert_array_equal(run.data, native.data)


def test_exported_systems_repeat_steps_and_continue_from_states(tmp_path):
    """Of FMUs that compute outputs in steps only; both versions in one system, each as the whole."""
    files = [sloped.build(fmi, tmp_path) for fmi in (2, 3)]
    with of_two_slopes(files[0], second=files[1], trouble=6) as system:
        native = system.run(0.3, record=SLOPED)
        whole = [system.export_fmu(tmp_path / f"Loop{fmi}.fmu", fmi=fmi) for fmi in (2, 3)]
    names = [f"whole.{n}" for n in SLOPED]
    assert native.loops[0].evaluations > 2 * native.loops[0].solutions
    with of_two_slopes(files[0], second=files[1]) as system:
        assert np.abs(native["m.a"] - system.run(0.3, record=SLOPED)["m.a"]).max() > 0.01  # the sums count
    for file in whole:
        with System() as system:
            system.add("whole", file, step="10 ms")
            run = system.run(0.3, record=names)
            np.testing.assert_array_equal(run.data, native.data)
            with system.initialize(record=names) as simulation:
                simulation.advance(0.1)
                state = simulation.save()
                simulation.advance(0.2)
                simulation.restore(state)
                simulation.advance(0.3, final=True)
                assert_same(simulation.recording, run)


@pytest.mark.parametrize("offers", [True, False])
@pytest.mark.parametrize("events", ["clock", "discrete"])
def test_loops_through_clocked_fmus_and_discrete_inputs_are_solved(events, offers, tmp_path):
    """Continuous inputs are set between steps; for a discrete one the step is repeated."""
    plain, path = (sloped.build(3, tmp_path, offers=offers, events=kind) for kind in ("", events))
    with of_two_slopes(plain) as system:
        right, adaptive = system.run(0.5, record=SLOPED), system.run(0.5, record=SLOPED, tolerance=1e-4)
    names = [f"whole.{n}" for n in SLOPED]
    for second in (path, plain):
        with of_two_slopes(path, second=second) as system:
            run = system.run(0.5, record=SLOPED)
            assert is_solved(run)
            np.testing.assert_allclose(run.data, right.data, atol=1e-8)
            isolated = system.run(0.5, record=SLOPED, execution=Execution(isolate=("*",)))
            np.testing.assert_array_equal(isolated.data, run.data)
            tolerant = system.run(0.5, record=SLOPED, tolerance=1e-4)
            assert tolerant.steps.accepted < 2 * adaptive.steps.accepted
            np.testing.assert_allclose(tolerant.data, right.data, atol=1e-4)
            whole = [system.export_fmu(tmp_path / f"Loop{fmi}.fmu", fmi=fmi) for fmi in (2, 3)]
        for file in whole:
            with System() as system:
                system.add("whole", file, step="10 ms")
                np.testing.assert_array_equal(system.run(0.5, record=names).data, run.data)


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_exported_system_names_the_component_whose_derivative_is_fatal(fmi, tmp_path):
    with of_two_slopes(sloped.build(fmi, tmp_path)) as system:
        file = system.export_fmu(tmp_path / "Loop.fmu")
    with System() as system:
        system.add("whole", file, step="10 ms", parameters={"n.trouble": 5.0})
        with pytest.raises(ComponentError, match=r"component 'n': GetDirectionalDerivative returned Fatal"):
            system.run(0.1)


def test_a_loop_through_a_model_exchange_fmu_is_solved_and_exported(built_fmus, tmp_path):
    with System(allow_unconnected=True) as system:
        path = built_fmus.path("QuarterCarHmmwv", 3)
        system.add("car", path, step="0.5 ms", start={"road.height": 0.05}, interface="me")
        system.connect("car.body.az", "car.force", linear=(-100.0, 0.0))
        exchanged, model = system.run(0.1, record=MOTION), system.linearize(["car.road.height"], ["car.body.az"])
        file = system.export_fmu(tmp_path / "Exchanged.fmu")
    with with_fed_back_acceleration(path, 100.0) as system:
        system["car"].step = rational("0.5 ms")
        stepped, same = system.run(0.1, record=MOTION), system.linearize(["car.road.height"], ["car.body.az"])
    assert exchanged.loops[0].derivatives > 0
    assert (np.abs(exchanged.data - stepped.data) < 1e-6 * np.abs(stepped.data).max(axis=0)).all()
    np.testing.assert_allclose(model.poles(), same.poles(), rtol=1e-12)
    with System(allow_unconnected=True) as system:
        system.add("whole", file, step="0.5 ms")
        whole = system.run(0.1, record=[f"whole.{n}" for n in MOTION])
    np.testing.assert_array_equal(whole.data, exchanged.data)


@pytest.mark.parametrize("interface", ["cs", "me"])
def test_a_sampled_linear_model_through_a_loop_repeats_the_run(built_fmus, interface):
    """Two cars, of which one has its acceleration fed back and pushes the other one, and a sampled damper."""
    import control

    class Damper(PythonComponent):
        inputs = ("v",)
        outputs = ("height",)
        kind = "discrete"

        def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
            y[0] = -0.05 * u[0]

    path = built_fmus.path("QuarterCarHmmwv", 3)
    with System(allow_unconnected=True) as system:
        for name in ("car", "other"):
            system.add(name, path, step="1 ms", interface=interface)
        system.add("damper", Damper(), step="2 ms")
        system.connect("car.body.az", "car.force", linear=(-100.0, 0.0))
        system.connect("car.body.az", "other.force", linear=(100.0, 0.0))
        system.connect("other.body.vz", "damper.v", linear=(1.0, 0.0))
        system.connect("damper.height", "car.road.height", linear=(1.0, 0.0))
        names = ["car.body.az", "other.body.z"]
        model = system.linearize(["other.road.height"], names, discrete=True)
        system["other"].set({"road.height": 0.01})
        run = system.run(0.2, record=Record(names, model.dt))
    times = model.dt * np.arange(len(run.time))
    predicted = control.forced_response(model, times, np.full((1, len(times)), 0.01)).outputs
    for name, y in zip(names, predicted, strict=True):
        assert np.abs(run[name] - y).max() < 1e-6 * np.abs(y).max()


@pytest.mark.parametrize("fmi", [2, 3])
def test_what_an_fmu_does_not_declare_is_measured_from_a_saved_state(follower, fmi):
    """`count` is `count_in` plus the number of steps, and `y` a state: the FMU says neither."""
    with System() as system:
        system.add("a", follower[fmi], step="1 ms", parameters={"rate": 50.0})
        system.add("b", follower[fmi], step="2 ms", start={"u": 3.0})
        system.connect("a.y", "b.u")
        system.connect("b.y", "a.u")
        with pytest.warns(AlgebraicLoopWarning, match=r"b\.y -> a\.u\n *a\.y -> b\.u"):
            system.run(0.01)
        system.connect("a.count", "b.count_in")
        system.connect("b.count", "a.count_in")
        with pytest.raises(LoopError, match=r"different steps.*\n *a\.count -> b\.count_in\n *b\.count -> a\.count_in"):
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
    monkeypatch.setattr("cosim.engine.initialization.measure", lambda *_: {})
    monkeypatch.setattr("cosim.engine.initialization.loops_of", lambda *_: ())
    assert_same(run(), measured)


def with_fed_back_acceleration(car: Any, mass: float) -> System:
    """A car on a step of the road whose actuator has the force -mass az, of the acceleration that it causes."""
    system = System()
    system.add("car", car, step="1 ms", start={"road.height": 0.05})
    system.connect("car.body.az", "car.force", linear=(-mass, 0.0))
    return system


MOTION = ("car.body.z", "car.body.az", "car.wheel.z")


@pytest.mark.parametrize("declared_by", ["the FMU", "measurement"])
def test_a_car_with_its_acceleration_fed_back_moves_as_its_closed_linear_model(built_fmus, declared_by):
    """Of the exchange only the hold of the force over a step is left, and its error halves with the step."""
    import control

    error = {}
    for step in ("1 ms", "0.5 ms"):
        with with_fed_back_acceleration(built_fmus.path("QuarterCarHmmwv", 3), 100.0) as system:
            system["car"].step = rational(step)
            model = system.linearize(["car.road.height"], ["car.body.az"])
            if declared_by == "measurement":
                system["car"].description.dependencies.clear()  # as of a tool that does not write them
            found = system.run(0.5, record=Record(MOTION, interval="1 ms"))
        exact = control.forced_response(model, found.time, np.full((1, len(found.time)), 0.05)).outputs
        error[step] = np.abs(found["car.body.az"] - exact).max()
        assert error[step] < 0.02 * np.abs(exact).max()
    assert 0.4 < error["0.5 ms"] / error["1 ms"] < 0.6


def test_both_versions_isolated_in_a_group_and_exported_give_the_same_bits(built_fmus, tmp_path):
    runs = []
    for fmi in (2, 3):
        with with_fed_back_acceleration(built_fmus.path("QuarterCarHmmwv", fmi), 100.0) as system:
            runs.append(system.run(0.1, record=MOTION))
            if fmi == 3:
                runs.append(system.run(0.1, record=MOTION, execution=Execution(isolate=("*",))))
                file = system.export_fmu(tmp_path / "Loop.fmu")
                system.group("group", ["car"], "gauss-seidel")
                runs.append(system.run(0.1, record=MOTION))
    for run in runs[1:]:
        assert_same(run, runs[0])
    with System() as system:
        system.add("whole", file, step="1 ms")
        whole = system.run(0.1, record=[f"whole.{n}" for n in MOTION])
    np.testing.assert_array_equal(whole.data, runs[0].data)


def test_a_batch_says_that_it_solves_no_loops(built_fmus):
    with (
        with_fed_back_acceleration(built_fmus.path("QuarterCarHmmwv", 3), 100.0) as system,
        pytest.raises(CosimError, match="'car' form an algebraic loop, which a batch does not solve"),
    ):
        Batch(system, 2)


def test_a_possible_loop_through_a_state_is_none(built_fmus):
    with System() as system:
        system.add("car", built_fmus.path("QuarterCarHmmwv", 3), step="1 ms")
        system["car"].description.dependencies.clear()
        system.connect("car.body.vz", "car.force", linear=(0.1, 0.0))
        with pytest.warns(AlgebraicLoopWarning, match=r"car\.body\.vz -> car\.force"):
            system.run(0.01)


def test_a_loop_of_integers_is_refused(follower, tmp_path):
    with System() as system:
        system.add("a", follower[2], step="1 ms")
        system.connect("a.count", "a.count_in")
        with pytest.raises(LoopError, match=r"a\.count is not a real number"):
            system.export_fmu(tmp_path / "Loop.fmu")
