"""Runs with a tolerance: the true error, the instants of discrete components, failures, and what is refused."""

from __future__ import annotations

import re
from fractions import Fraction
from typing import Any

import awkward
import numpy as np
import pytest
from foreign import clocked, exchanged, sloped
from masses import COUPLING, NAMES, K, Mass, exact
from probes import DiscreteProbe, Integrator
from same import assert_same, outcome
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from cosim import (
    ComponentError,
    CosimError,
    Execution,
    FmuWarning,
    PythonComponent,
    Record,
    Recording,
    StopWhen,
    System,
    WiringError,
)
from cosim.study.driver import refuse_tolerance

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")


class Spring(PythonComponent):
    """A force that depends directly on two displacements."""

    inputs = ("a", "b")
    outputs = ("force",)
    parameters = {"k": COUPLING}  # noqa: RUF012
    computes_on_get = True

    def start(self, u: Any, y: Any) -> None:
        y[0] = self.k * (u[1] - u[0])

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        self.start(u, y)


class StepwiseSpring(Spring):
    """The same, but it follows in steps only, and does not declare the dependency."""

    computes_on_get = False


def oscillator(
    d: float = 0.0, *, spring: type[Spring] | None = None, step: str = "2 ms", extrapolate: bool = False
) -> System:
    """Two masses, coupled by a spring that is a component of its own or a part of both."""
    system = System(allow_unconnected=True)
    system.add("a", Mass, step=step, parameters={"d": d})
    system.add("b", Mass, step=step, parameters={"x0": 0.0, "d": d})
    if spring:
        system.add("s", spring, step=step)
        system.connect("a.x", "s.a")
        system.connect("b.x", "s.b")
        system.connect("s.force", "a.force")
        system.connect("s.force", "b.force", linear=(-1.0, 0.0))
    else:
        system.connect("a.x", "b.force", linear=(COUPLING, 0.0), extrapolate=extrapolate)
        system.connect("b.x", "a.force", linear=(COUPLING, 0.0), extrapolate=extrapolate)
    return system


def relative_errors(run: Recording, d: float = 0.0, *, spring: bool = False) -> dict[str, float]:
    """Of each variable: the largest error, relative to the largest value."""
    true = exact(run.time, k=K + COUPLING * spring, d=d)
    return {n: float(np.abs(run[n] - x).max() / np.abs(x).max()) for n, x in true.items()}


@pytest.mark.parametrize("spring", [None, Spring, StepwiseSpring], ids=["pair", "spring", "stepwise"])
def test_the_tolerance_is_met_over_three_decades(spring):
    found = {}
    for tolerance in (1e-2, 1e-3, 1e-4, 1e-5):
        run = oscillator(spring=spring).run(1.0, record=Record(NAMES, "10 ms"), tolerance=tolerance)
        assert len(run) == 101
        errors = relative_errors(run, spring=spring is not None)
        found[tolerance] = max(errors.values()) / tolerance, run.steps.accepted
    assert all(0.003 < share < 0.2 for share, _ in found.values())
    for tolerance in (1e-2, 1e-3, 1e-4):  # of third order: ten times as accurate with 2.15 times the steps
        assert 1.8 < found[tolerance / 10][1] / found[tolerance][1] < 2.5


@pytest.mark.parametrize("size", [1.0, 3e-3], ids=["large", "small"])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-4])
@pytest.mark.parametrize("seed", range(8))
def test_the_tolerance_is_met_by_all_outputs_of_random_rings(seed, tolerance, size):
    """Of masses, each of which feels the one before it: relative to the largest value of each, nominal values are 1."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 5))
    k, x0 = np.exp(random.uniform(np.log(4), np.log(900), n)), size * random.uniform(-1, 1, n)
    d, coupling = 2 * random.uniform(0.02, 0.3, n) * np.sqrt(k), random.uniform(-0.6, 0.6, n) * k
    motion = np.zeros((2 * n, 2 * n))
    with System() as system:
        for i in range(n):
            system.add(f"m{i}", Mass, step="2 ms", parameters={"k": k[i], "d": d[i], "x0": x0[i]})
            motion[2 * i, 2 * i + 1] = 1.0
            motion[2 * i + 1, [2 * i, 2 * i + 1, 2 * (i - 1)]] = -k[i], -d[i], coupling[i]
        for i in range(n):
            system.connect(f"m{i - 1 if i else n - 1}.x", f"m{i}.force", linear=(coupling[i], 0.0))
        names = [f"m{i}.{what}" for i in range(n) for what in "xv"]
        run = system.run(2.0, record=Record(names, "10 ms"), tolerance=tolerance)
    step, states = expm(motion * 0.01), [np.column_stack([x0, np.zeros(n)]).ravel()]
    while len(states) < len(run):
        states.append(step @ states[-1])
    true = np.array(states)
    errors = np.abs(np.column_stack([run[name] for name in names]) - true).max(axis=0) / np.abs(true).max(axis=0)
    assert errors.max() < tolerance


def test_steep_flanks_whose_time_is_uncertain_exceed_the_tolerance():
    """Of the oscillator of van der Pol, x'' = 2 (1 - x^2) x' - x: the known limit of the rule."""

    class Rate(PythonComponent):
        inputs = ("x",)
        outputs = ("v",)
        feedthrough = {"v": ()}  # noqa: RUF012

        def begin(self) -> None:
            self.v = 0.0

        def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
            decay = 2.0 * (1.0 - u[0] ** 2)  # exact: x is held
            growth = np.expm1(decay * h) / decay if decay else h
            self.v += (decay * self.v - u[0]) * growth
            y[0] = self.v

    with System() as system:
        system.add("x", Integrator(), step="20 ms", parameters={"x0": 2.0})
        system.add("v", Rate(), step="20 ms")
        system.connect("x.y", "v.x")
        system.connect("v.v", "x.u")
        run = system.run(20.0, record=Record(["x.y", "v.v"], "50 ms"), tolerance=1e-4)
    true = solve_ivp(
        lambda _, z: [z[1], 2 * (1 - z[0] ** 2) * z[1] - z[0]],
        (0, 20),
        [2, 0],
        "DOP853",
        run.time,
        rtol=1e-11,
        atol=1e-12,
    ).y
    assert 1e-4 < np.abs(run["v.v"] - true[1]).max() / np.abs(true[1]).max() < 3e-4


def test_there_are_fewer_steps_than_fixed_ones_of_the_same_accuracy():
    """A motion that dies out: steps become longer."""
    d, record = 3.0, Record(NAMES, "20 ms")
    adaptive = oscillator(d).run(12.0, record=record, tolerance=1e-4)
    fixed = oscillator(d, extrapolate=True).run(12.0, record=record)
    errors = [max(relative_errors(run, d).values()) for run in (adaptive, fixed)]
    steps_of_the_same_accuracy = 6000 * np.sqrt(errors[1] / errors[0])
    assert adaptive.steps.accepted + adaptive.steps.rejected < 0.4 * steps_of_the_same_accuracy


def test_a_group_and_extrapolated_connections_have_no_meaning():
    system = oscillator(extrapolate=True)
    system.group("both", ["a", "b"], "gauss-seidel")
    assert_same(system.run(0.1, tolerance=1e-3), oscillator().run(0.1, tolerance=1e-3))


def test_discrete_components_run_at_their_exact_instants():
    system = oscillator()
    system.add("p", DiscreteProbe(), step="1/60")
    system.add("q", DiscreteProbe(), step="7 ms", offset="1 ms")
    system.connect("a.x", "p.u")
    run = system.run(0.5, record=Record(["p.y", "q.y", "a.x"], "1 ms"), tolerance=1e-4)
    for name, step, offset in (("p", Fraction(1, 60), 0), ("q", Fraction(7, 1000), Fraction(1, 1000))):
        known = [float(offset + step * k) for k in range(100) if offset + step * k <= Fraction(1, 2)]
        shown = [y for y in dict.fromkeys(run[f"{name}.y"].tolist()) if y >= 0]
        assert shown == known
    log = system["p"].implementation.log
    truth = {round(t, 6): x for t, x in zip(run.time, run["a.x"], strict=True)}
    assert all(abs(truth[round(t / 1000, 6)] - u / 1000) < 1e-3 for t, u in log if t % 50 == 0)


def test_rows_between_communication_points_are_interpolated_and_the_recording_says_so():
    run = oscillator().run(0.5, record=Record(NAMES, "0.1 ms"), tolerance=1e-4)
    steps = run.steps
    assert len(run) == 5001 > 5 * steps.accepted
    assert max(relative_errors(run).values()) < 1e-3
    assert steps.smallest <= steps.mean <= steps.largest
    assert steps.accepted * steps.mean == pytest.approx(0.5)
    assert f"{steps.accepted} communication steps" in str(steps)
    assert "between them are interpolated" in run._repr_html_()
    assert oscillator().run(0.1).steps is None


def test_an_input_that_is_set_takes_effect_at_once():
    """Within the step that is under way, which is repeated up to there."""
    with System(allow_unconnected=True) as system:
        system.add("i", Integrator(), step="1 ms")
        with system.initialize(record=["i.y"], execution=Execution(tolerance=1e-3)) as simulation:
            expected = 0.0
            for k in range(1, 40):
                simulation.set("i.u", float(k))
                simulation.advance(Fraction(13 * k, 1000))
                expected += 0.013 * k
                assert simulation["i.y"] == pytest.approx(expected, rel=1e-12)
            put = simulation.setter(["i.u"])
            for k in range(40, 60):
                put(np.array([float(k)]))
                simulation.advance(Fraction(13 * k, 1000))
                expected += 0.013 * k
            assert simulation["i.y"] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("value", [5.0, float("nan"), "raise"])
def test_a_component_that_fails_is_named_with_the_time(value):
    class Fails(Mass):
        def step(self, t: float, h: float, u: Any, y: Any) -> None:
            super().step(t, h, u, y)
            if t + h > 0.3:
                if value == "raise":
                    raise ValueError("the spring is broken")
                y[0] = value

    system = oscillator()
    system.add("f", Fails, step="2 ms")
    system.connect("a.x", "f.force", linear=(1.0, 0.0))
    if value == 5.0:
        assert system.run(0.5, tolerance=1e-3)["f.x"][-1] == 5.0
        return
    with pytest.raises(ComponentError) as caught:
        system.run(0.5, tolerance=1e-3)
    assert caught.value.component == "f"
    assert caught.value.time == pytest.approx(0.3, abs=2e-6 if value != "raise" else 0.13)
    assert ("x is nan" if value != "raise" else "the spring is broken") in str(caught.value)
    assert caught.value.recording.time[-1] > 0.28


def test_a_value_that_never_follows_ends_the_run_by_name():
    class Noise(PythonComponent):
        outputs = ("y",)

        def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
            y[0] = np.sin(1e9 * (t + h))

    system = System()
    system.add("n", Noise, step="1 ms")
    system.add("i", Integrator(), step="1 ms")
    system.connect("n.y", "i.u")
    with system.initialize(record=["n.y"], execution=Execution(tolerance=1e-4)) as simulation:
        with pytest.raises(
            ComponentError, match=r"the exchange of n\.y does not reach the tolerance of 0\.0001 at t = "
        ) as c:
            simulation.advance(0.1)
        assert c.value.component == "n"
        assert simulation["n.y"] == pytest.approx(np.sin(1e9 * float(simulation.time)), abs=1e-6)  # where it failed


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_value_that_is_not_finite_has_no_small_error(value):
    """Where the run lets such values pass (`allow_nan`), too; it is no error where no continuous component reads it."""

    class Breaks(PythonComponent):
        outputs = ("y",)

        def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
            y[0] = value if t + h > 0.05 else 1.0

    system = System()
    system.add("b", Breaks, step="1 ms")
    execution = Execution(tolerance=1e-4, allow_nan=True)
    assert not np.isfinite(system.run(0.1, record=["b.y"], execution=execution)["b.y"][-1])
    system.add("i", Integrator(), step="1 ms")
    system.connect("b.y", "i.u")
    with pytest.raises(ComponentError, match=r"the exchange of b\.y .* it is not finite in a step") as caught:
        system.run(0.1, record=["b.y", "i.y"], execution=execution)
    assert caught.value.time == pytest.approx(0.05, abs=1e-6)
    assert np.isfinite(caught.value.recording.data).all()


@pytest.mark.parametrize(("slope", "beyond"), [(1e4, 1), (1e7, 2)])
def test_a_value_that_jumps_and_is_steep_after_that_is_followed(slope, beyond):
    """A step of the steeper one, without slopes, exceeds the tolerance however small it is."""

    class Ramp(PythonComponent):
        outputs = ("y",)

        def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
            y[0] = 0.0 if t + h < 0.05 else 1.0 + slope * (t + h - 0.05)

    system = System()
    system.add("r", Ramp, step="1 ms")
    system.add("i", Integrator(), step="1 ms")
    system.connect("r.y", "i.u")
    run = system.run(0.06, record=["i.y"], tolerance=1e-4)
    assert run["i.y"][-1] == pytest.approx(0.01 + 0.5 * slope * 0.01**2, rel=1e-4)
    assert run.steps.beyond == beyond  # where it jumps, and after it
    assert str(run.steps).endswith(
        f"; {beyond} of the smallest possible length, 5.96e-11 s, exceed the tolerance, as where a value jumps,"
        " which is late by up to this length"
    )
    smooth = system.run(0.04, record=["i.y"], tolerance=1e-4).steps
    assert (smooth.beyond, "exceed" in str(smooth)) == (0, False)


class Lag(PythonComponent):
    """A first-order lag, exact for constant inputs."""

    inputs = ("u",)
    outputs = ("x",)
    feedthrough = {"x": ()}  # noqa: RUF012

    def begin(self) -> None:
        self.x = 0.0

    def start(self, u: Any, y: Any) -> None:  # noqa: ARG002
        y[0] = self.x

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        self.x -= np.expm1(-20.0 * h) * (u[0] - self.x)
        y[0] = self.x


class Relay(PythonComponent):
    """1 until its input is above 0.4, then -1 until it is below -0.4."""

    inputs = ("x",)
    outputs = ("u",)
    feedthrough = {"u": ("x",)}  # noqa: RUF012
    computes_on_get = True

    def begin(self) -> None:
        self.last = 1.0

    def start(self, u: Any, y: Any) -> None:
        y[0] = 1.0 if u[0] < -0.4 else -1.0 if u[0] > 0.4 else self.last

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        self.start(u, y)
        self.last = y[0]


def with_relay(internal: Fraction | None = None, *, step: str | Fraction = "1 ms") -> System:
    system = System()
    system.add("lag", Lag, step=step)
    system.add("relay", Relay, step=step)
    system.connect("lag.x", "relay.x")
    system.connect("relay.u", "lag.u")
    system["lag"].description.internal_step = internal
    return system


def test_ticks_of_steps_that_are_no_simple_fractions_are_not_too_short_for_doubles():
    with with_relay(step=Fraction(42023, 10**6)) as system:
        run = system.run(1000.1, record=["lag.x"], start_time=1000, tolerance=1e-5)
    assert run.time[-1] > 1000.08
    assert run.steps.least < 1e-3 * 42e-3
    assert run.steps.limited_by == "double-precision times"


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-5, 1e-6])
def test_the_tolerance_is_met_where_a_value_jumps_again_and_again(tolerance):
    """A relay that switches 24 times: its delays add up."""
    with with_relay() as system:
        run = system.run(1.0, record=Record(["lag.x"], "7 ms"), tolerance=tolerance)
    first, period = -np.log(0.6) / 20, np.log(1.4 / 0.6) / 20
    switched = np.floor((run.time - first) / period)
    toward = np.where(switched % 2, 1.0, -1.0)
    after = toward * (1.0 - 1.4 * np.exp(-20.0 * (run.time - first - switched * period)))
    true = np.where(switched < 0, 1.0 - np.exp(-20.0 * run.time), after)
    assert switched[-1] == 22
    assert np.abs(run["lag.x"] - true).max() / 0.4 < 0.1 * tolerance
    assert run.steps.limited_by == ""
    assert run.steps.rejected < 0.5 * run.steps.accepted < 40 * 24 / np.cbrt(tolerance / 1e-3)


@pytest.mark.parametrize(
    ("internal", "stop", "tolerance", "said"),
    [
        (Fraction(1, 10000), 0.1, 1e-2, "0.0001 s, exceed .*: fixed internal steps .* allow no shorter one"),
        (None, 20000, 1e-6, "3.05e-08 s, exceed .*: double-precision times allow no shorter one"),
    ],
)
def test_a_jump_that_cannot_be_located_as_exactly_as_the_tolerance_needs_is_told(internal, stop, tolerance, said):
    with (
        with_relay(internal) as system,
        system.initialize(record=["lag.x"], stop_time=stop, execution=Execution(tolerance=tolerance)) as simulation,
    ):
        simulation.advance(0.1)
        steps = simulation.recording.steps
    assert re.search(said, str(steps))
    assert steps.beyond > 0


@pytest.mark.parametrize("isolated", [False, True])
@pytest.mark.parametrize("fmi", [2, 3])
def test_fmus_give_the_same_bits_in_each_version_isolated_or_not(built_fmus, fmi, isolated):
    """Two quarter cars that push each other, one of which is controlled at 10 ms."""
    found = []
    for version, how in ((3, False), (fmi, isolated)):
        with System(allow_unconnected=True) as system:
            for name, height in (("a", 0.05), ("b", 0.0)):
                system.add(
                    name, built_fmus.path("QuarterCarHmmwv", version), step="4 ms", start={"road.height": height}
                )
            system.add("d", Integrator(), kind="discrete", step="10 ms")
            system.connect("a.suspension.deflection", "b.force", linear=(20e3, 0.0))
            system.connect("b.suspension.deflection", "a.force", linear=(20e3, 0.0))
            system.connect("a.body.vz", "d.u", linear=(1.0, 0.0))
            system.connect("d.y", "b.road.height", linear=(0.1, 0.0))
            execution = Execution(tolerance=1e-4, isolate=("?",) if how else ())
            found.append(system.run(0.3, record=["*.body.z", "d.y", "*.body.az"], execution=execution))
    assert_same(*found)
    assert found[0].steps == found[1].steps
    assert found[0].steps.rejected > 0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda s: s.connect("a.x", "c.u", delay=True, linear=(1.0, 0.0)), "has a delay of one step"),
        (lambda s: s.add("o", Integrator(), step="1 ms", offset="1 ms"), "'o' has an offset of 0.001 s"),
    ],
)
def test_what_is_refused(change, said):
    system = oscillator()
    system.add("c", Integrator(), step="1 ms")
    change(system)
    with pytest.raises(WiringError, match=said):
        system.run(0.1, tolerance=1e-3)


class Counting(Mass):
    """It keeps the steps that it took."""

    def begin(self) -> None:
        super().begin()
        self.taken: set[Fraction] = set()

    def step(self, t: float, h: float, u: Any, y: Any) -> None:
        self.taken.add(Fraction(h).limit_denominator(10**7))
        super().step(t, h, u, y)


def with_internal_steps(*, second: Fraction = Fraction(1, 10000), sampled: str = "7 ms") -> System:
    """The pair of masses with internal steps of 0.15 and 0.1 ms, and a discrete component."""
    system = System(allow_unconnected=True)
    for name, internal in {"a": Fraction(3, 20000), "b": second}.items():
        system.add(name, Counting, step="2 ms", parameters={"x0": float(name == "a")})
        system[name].description.internal_step = internal
    system.add("d", DiscreteProbe(), step=sampled)
    system.connect("a.x", "b.force", linear=(COUPLING, 0.0))
    system.connect("b.x", "a.force", linear=(COUPLING, 0.0))
    return system


def test_steps_are_multiples_of_fixed_internal_steps():
    with with_internal_steps(sampled="6 ms") as system:
        run = system.run(0.3, record=NAMES, tolerance=1e-2)
        taken = system["a"].implementation.taken
    assert max(relative_errors(run).values()) < 1e-2
    assert all((step / Fraction(3, 10000)).denominator == 1 for step in taken)
    assert len(taken) > 2
    assert run.steps.smallest >= 3e-4


def test_instants_between_internal_steps_are_warned_of_and_steps_that_do_not_meet_are_refused(refused):
    with with_internal_steps() as system:
        with pytest.warns(FmuWarning, match=r"'d' runs every 0.007 s, .* 0.0003 s"):
            system.run(0.1, record=["a.x", "b.x"], tolerance=1e-2)
        assert min(system["a"].implementation.taken) < Fraction(3, 10000)
    with with_internal_steps(second=Fraction(1, 9999)) as system:
        refused(WiringError, lambda: system.run(0.1, tolerance=1e-2))


@pytest.mark.parametrize(
    ("variable_step", "can_save", "said"),
    [(False, True, "steps of any length"), (True, False, "cannot save its state")],
)
def test_fmus_that_cannot_are_refused(follower, variable_step, can_save, said):
    with System() as system:
        system.add("f", follower[3], step="1 ms")
        system["f"].description.variable_step, system["f"].description.can_save = variable_step, can_save
        with pytest.raises(WiringError, match=f"'f' .*{said}.*without a tolerance"):
            system.run(0.1, tolerance=1e-3)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
def test_algebraic_loops_are_solved_at_each_communication_point(built_fmus, tolerance):
    """A car whose actuator has the force -m az, of the acceleration that it causes: as its closed linear model."""
    import control

    with System(allow_unconnected=True) as system:
        system.add("car", built_fmus.path("QuarterCarHmmwv", 3), step="1 ms", start={"road.height": 0.05})
        system.connect("car.body.az", "car.force", linear=(-100.0, 0.0))
        names = ["car.body.z", "car.body.az", "car.wheel.z"]
        model = system.linearize(["car.road.height"], names)
        run = system.run(0.5, record=Record(names, "1 ms"), tolerance=tolerance)
    exact_values = control.forced_response(model, run.time, np.full((1, len(run.time)), 0.05)).outputs
    errors = [np.abs(run[n] - y).max() / np.abs(y).max() for n, y in zip(names, exact_values, strict=True)]
    assert 1e-4 * tolerance < max(errors) < tolerance
    (effort,) = run.loops
    assert run.steps.accepted < effort.solutions <= run.steps.accepted + run.steps.rejected + 3
    assert effort.most_evaluations == 2


def test_a_step_that_ends_where_a_loop_has_no_solution_is_tried_again_and_fails_by_name():
    """The loop y = y^2 + t + 0.2 has a solution up to t = 0.05."""

    class Square(PythonComponent):
        inputs = ("u",)
        outputs = ("y",)
        feedthrough = {"y": ("u",)}  # noqa: RUF012
        computes_on_get = True

        def begin(self) -> None:
            self.t = 0.0

        def start(self, u: Any, y: Any) -> None:
            y[0] = u[0] ** 2 + self.t + 0.2

        def step(self, t: float, h: float, u: Any, y: Any) -> None:
            self.t = t + h
            self.start(u, y)

    with System() as system:
        system.add("s", Square(), step="1 ms")
        system.connect("s.y", "s.u")
        with pytest.raises(ComponentError, match=r"no solution.*s\.y") as caught:
            system.run(0.1, record=Record(["s.y"], "1 ms"), tolerance=1e-2)
    run = caught.value.recording
    assert 0.045 < run.time[-1] <= 0.05
    np.testing.assert_allclose(run["s.y"], 0.5 - np.sqrt(0.05 - run.time), atol=5e-3)


def test_states_of_other_simulations_and_the_error_of_fixed_steps_are_refused():
    system = oscillator(spring=Spring)
    with system.initialize(execution=Execution(tolerance=1e-3)) as simulation:
        simulation.advance(0.1)
        state = simulation.save()
        with pytest.raises(CosimError, match="cannot leave its process"):
            state.to_bytes()
    with system.initialize() as simulation:
        of_fixed_steps = simulation.save()
    for given, tolerance in ((state, None), (state, 1e-3), (of_fixed_steps, 1e-3)):
        with pytest.raises(CosimError, match="does not continue from a state of another simulation"):
            system.run(0.2, state=given, tolerance=tolerance)
    with pytest.raises(CosimError, match="that of fixed steps"):
        system.exchange_error(0.1, execution=Execution(tolerance=1e-3))


@pytest.mark.parametrize("tolerance", [0.0, -1.0, 2.0, float("nan")])
def test_a_tolerance_is_a_share(tolerance):
    with pytest.raises(WiringError, match="tolerance"):
        oscillator().run(0.1, tolerance=tolerance)


def test_without_continuous_components_a_tolerance_changes_nothing():
    system = System()
    system.add("d", DiscreteProbe(), step="1 ms")
    assert system.run(0.1, tolerance=1e-3).steps is None


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    ("trouble", "value", "said"),
    [
        (awkward.STATUS, 2.0, "DoStep returned Discard at t = 0.3"),
        (awkward.STATUS, 3.0, "DoStep returned Error at t = 0.3"),
        (awkward.GET_STATUS, 3.0, "returned Error at t = 0.25"),
        (awkward.NOT_FINITE, float("nan"), "'m': y is nan at t = 0.3"),
        (awkward.END, 0.0, "'m' asked to end the simulation"),
        (awkward.END_EARLY, 0.0, "'m' asked to end the simulation"),
    ],
)
def test_an_fmu_in_trouble(awkward_fmus, follower, version, trouble, value, said):
    """From 0.3 s on; its step is tried again with shorter ones where the standard allows that."""
    with System(allow_unconnected=True) as system:
        values = {"trouble": trouble, "at": 0.3}
        system.add("m", awkward_fmus[version], step="50 ms", kind="continuous", parameters=values)
        system["m"].values["value"] = value
        system["m"].description.variable_step = True
        system.add("z", follower[version], step="30 ms", kind="continuous")
        system.add("d", DiscreteProbe(), step="50 ms")
        system.connect("m.y", "z.u", linear=(1.0, 0.0))
        failure, recording = outcome(lambda: system.run(0.6, record=Record(["m.y"], "10 ms"), tolerance=1e-2))
    assert recording is not None
    assert said in failure + str(recording.stopped_by)
    assert 0.24 < recording.time[-1] <= 0.31
    np.testing.assert_allclose(recording["m.y"][1:-1], recording.time[1:-1], atol=1e-9)


@pytest.mark.filterwarnings("ignore::cosim.AlgebraicLoopWarning")
@pytest.mark.parametrize("version", [2, 3])
def test_model_exchange_fmus_go_back_too(tmp_path, version):
    """dx/dt = u - x of one, dx/dt = -u - x of the other: a decaying rotation."""
    path = exchanged.build(version, tmp_path)
    with System() as system:
        for name, k in (("a", 1.0), ("b", -1.0)):
            system.add(name, path, step="10 ms", parameters={"k": k, "kind": 0.0}, start={"x": 1.0})
        system.connect("a.x", "b.u")
        system.connect("b.x", "a.u")
        run = system.run(2.0, record=Record(["a.x", "b.x"], "20 ms"), tolerance=1e-4)
    t = run.time
    np.testing.assert_allclose(run["a.x"], np.exp(-t) * (np.cos(t) + np.sin(t)), atol=2e-4)
    np.testing.assert_allclose(run["b.x"], np.exp(-t) * (np.cos(t) - np.sin(t)), atol=2e-4)
    assert run.steps.rejected > 0


@pytest.mark.parametrize("events", ["", "clock", "discrete"])
def test_outputs_of_clocked_fmus_and_of_discrete_inputs_follow(events, tmp_path):
    """dx/dt = -b, b = x, of an FMU with event mode, whose input is discrete or not."""
    with System(allow_unconnected=True) as system:
        system.add("x", Integrator(), step="0.1 s", parameters={"x0": 1.0})
        system.add("f", sloped.build(3, tmp_path, events=events), step="0.1 s", start={"p": 8.0}, parameters={"k": 0.0})
        system.connect("f.b", "x.u", linear=(-1.0, 0.0))
        system.connect("x.y", "f.q")
        run = system.run(5, record=["x.y", "f.b"], tolerance=1e-4)
    for name in ("x.y", "f.b"):
        assert np.abs(run[name] - np.exp(-run.time)).max() < 1e-4
    assert run.steps.accepted < 1000


@pytest.mark.parametrize("isolated", [False, True])
@pytest.mark.parametrize(("kind", "period"), [("constant", 1 / 300), ("tunable", 0.01)])
def test_inputs_of_clocks_have_the_values_of_their_ticks(kind, period, isolated, tmp_path):
    """The sum of 1 + 2 a.x over the ticks, within steps that are longer; between communication points it stays."""
    with oscillator() as system:
        system.add("c", clocked.build(kind, tmp_path), step="10 ms", isolated=isolated)
        system.connect("a.x", "c.u", linear=(2.0, 1.0))
        run = system.run(0.5, record=Record(["c.y", "c.ticks"], "1 ms"), tolerance=1e-4)
    sums = np.append(0.0, np.cumsum(1.0 + 2.0 * exact(period * np.arange(150))["a.x"]))
    np.testing.assert_allclose(run["c.y"], sums[run["c.ticks"].astype(int)], atol=1e-4 * sums.max())


def test_inputs_of_the_clocks_of_discrete_components_have_the_values_of_their_samples(tmp_path):
    """Three ticks in each."""
    with oscillator() as system:
        system.add("c", clocked.build("constant", tmp_path), step="10 ms", kind="discrete")
        system.connect("a.x", "c.u")
        run = system.run(0.5, record=["c.y", "c.ticks"], tolerance=1e-4)
    sums = np.append(0.0, np.cumsum(np.repeat(exact(0.01 * np.arange(51))["a.x"], 3)))
    assert run["c.ticks"][-1] == 153
    np.testing.assert_allclose(run["c.y"], sums[run["c.ticks"].astype(int)], atol=1e-4 * sums.max())


def test_states_are_saved_in_the_same_memory(built_fmus):
    with System(allow_unconnected=True) as system:
        for name in "ab":
            system.add(name, built_fmus.path("QuarterCarHmmwv", 3), step="4 ms", start={"road.height": 0.05})
        system.connect("a.suspension.deflection", "b.force", linear=(20e3, 0.0))
        with system.initialize(execution=Execution(tolerance=1e-4)) as simulation:
            struct: Any = simulation.exchange.adaptive.struct
            before = [struct.states[i] for i in range(2)]
            simulation.advance(0.2)
            assert [struct.states[i] for i in range(2)] == before
            assert simulation.recording.steps.accepted > 10


@pytest.mark.parametrize("kind", ["python", "FMU"])
def test_an_input_takes_effect_at_once_in_a_restored_state_too(built_fmus, kind):
    """Also where it was saved within a step."""
    with System(allow_unconnected=True) as system:
        system.add("i", Integrator(), step="1 ms")
        if kind == "FMU":
            system.add("car", built_fmus.path("QuarterCarHmmwv", 3), step="1 ms", start={"road.height": 0.05})
            system.connect("car.body.z", "i.u", linear=(1.0, 0.0))
        with system.initialize(
            record=["*.y", *(["car.body.z"] if kind == "FMU" else [])], execution=Execution(tolerance=1e-3)
        ) as simulation:
            what, read = ("car.force", "car.body.z") if kind == "FMU" else ("i.u", "i.y")
            simulation.advance("5 ms")
            assert simulation.exchange.adaptive.within(simulation.exchange.tick)
            state = simulation.save()
            ends = []
            for value in (1.0, 2.0, 1.0):
                simulation.set(what, value)
                simulation.advance("300 ms")
                ends.append((simulation[read], simulation.recording.steps))
                simulation.restore(state)
            simulation.advance("20 ms")
            simulation.restore(state)
        assert ends[0] == ends[2]
        assert ends[0][0] != ends[1][0]
        if kind == "python":
            assert ends[0][0] == pytest.approx(0.295, rel=1e-9)


def test_stepping_by_hand_stop_conditions_and_another_run_change_nothing():
    system = oscillator()
    record, execution = Record(NAMES, "3 ms"), Execution(tolerance=1e-3)
    whole = system.run("0.3", record=record, execution=execution)
    with system.initialize(record=record, execution=execution, stop_time="0.3") as simulation:
        for _ in range(2):
            step = simulation.stepper("10 ms")
            for _ in range(30):
                step()
            simulation.advance("0.3", final=True)
            assert_same(simulation.recording, whole)
            assert simulation.recording.steps == whole.steps
            simulation.restart()
    stopped = system.run("0.3", record=record, execution=execution, stop_when=[StopWhen("a.x", "<", 0.0)])
    n = int(np.argmax(whole["a.x"] < 0.0))
    assert n - 1 <= len(stopped) <= n + 1
    np.testing.assert_array_equal(stopped.data[:n], whole.data[:n])
    assert stopped.stopped_by == "a.x < 0"


def test_sweeps_and_searches_do_not_run_with_a_tolerance():
    with pytest.raises(CosimError, match="sweeps and searches run with fixed steps"):
        refuse_tolerance(Execution(tolerance=1e-3))
