"""Derivatives by the samples of a table, beside exact ones, differences of runs, and those carried forward."""

from __future__ import annotations

import runpy
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from built import BuiltFmus
from rides import RIDES, bench_step, system_of
from same import bits

from cosim import System, Table, WiringError
from cosim.batch import Batch, adjoint
from cosim.core.signals import Array
from cosim.experiments.gpc import EXPERIMENT as GPC
from cosim.experiments.gpc.runs import Case as GpcCase
from cosim.gradient import Final, Gradient, GradientError, Mean, Metric, Peak, QuadraticCost, Rms
from cosim.gradient.gradient import DIRECTIONS

pytestmark = [
    pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning"),
    pytest.mark.usefixtures("built_fmus"),
]
ROOT = Path(__file__).parents[2]
ROWS = 16
TIMES = np.cumsum(np.random.default_rng(3).uniform(0.011, 0.04, ROWS)) - 0.011  # not multiples of a step
TIMES[0] = 0.0
FORCES = np.random.default_rng(4).normal(size=ROWS)
END = 0.25  # s, within the table
METRICS: Mapping[str, Metric] = {
    "end": Final("car.body.z"),
    "ride": Rms("car.body.az"),
    "peak": Peak("car.body.az"),
    "effort": QuadraticCost({"driver.force": 1.0, "car.body.z": 1e4}),
}


def driven(built_fmus: BuiltFmus, how: Any = "linear", force: str = "force", **rule: Any) -> System:
    """A quarter car with a force and a road from one table."""
    system = System(allow_unconnected=True)
    columns = {force: FORCES, "road [mm]": 3.0 * FORCES[::-1], "number": np.arange(ROWS), "on": FORCES > 0}
    table = Table({"t": TIMES, **columns}, interpolation={"force": how, "number": "held"}, after="hold")
    system.add("driver", table)
    system.add("car", built_fmus.path("QuarterCarBench", 3), step="1 ms", start={"body.z": 0.01})
    system.connect("driver.force", "car.force", **rule)
    return system


def both(system: System, parameters: Any, metrics: Mapping[str, Metric] = METRICS, **options: Any) -> list[Gradient]:
    """Carried forward, and by the adjoint, which agree."""
    found = [system.gradient(metrics, parameters, mode=mode, **options) for mode in ("forward", "adjoint")]
    forward, back = found
    np.testing.assert_array_equal(bits(back.recording.data), bits(forward.recording.data))
    size = np.abs(forward.jacobian).max(axis=1, keepdims=True)
    assert (size > 0.0).all()
    assert (np.abs(back.jacobian - forward.jacobian) < 1e-12 * size).all()
    return found


def exact(values: Mapping[str, float], how: str, steps: int) -> Array:
    """Derivatives (steps + 1, rows) of body.z of the bench by the samples of its force.

    The force counts at the begin of each millisecond, of which the Runge-Kutta method makes two steps.
    """
    step, by_force = bench_step(values)
    x, found = np.zeros((4, ROWS)), []
    for n in range(steps + 1):
        found.append(x[0])
        t = n / 1000
        if how == "linear":
            share = np.array([np.interp(t, TIMES, row) for row in np.eye(ROWS)])
        else:
            share = np.eye(ROWS)[np.searchsorted(TIMES, t, "right") - 1]
        for _ in range(2):
            x = step @ x + np.outer(by_force, share)
    return np.array(found)


@pytest.mark.parametrize("how", ["linear", "held"])
def test_derivatives_of_a_linear_run_are_exact(built_fmus: BuiltFmus, how: str) -> None:
    with driven(built_fmus, how) as system:
        forward, back = both(system, "driver.force", stop_time=END)
        car = system["car"]
        parameters = {n: float(car.start(n)) for n in car.description.parameters if "." in n and n != "solver.step"}
        by_sample = exact(parameters, how, 250)
        np.testing.assert_allclose(forward.tangents[:, 0], by_sample, rtol=1e-9, atol=1e-11 * np.abs(by_sample).max())
        np.testing.assert_allclose(back["end"]["driver.force"], by_sample[-1], rtol=1e-9)
        alone = system.run(END, record=["car.body.z", "car.body.az", "driver.force"])
        np.testing.assert_array_equal(bits(forward.recording.data), bits(alone.data))
        for found in (forward, back):
            trust = found.trust()
            assert trust.parameters == ["driver.force"]
            assert np.abs(trust.deviation).max() < 1e-8
        beyond = np.flatnonzero(TIMES > END)[1:]  # samples that the run does not see
        assert len(beyond)
        assert (back.jacobian[0, beyond] == 0.0).all()


def test_series_stand_beside_parameters(built_fmus: BuiltFmus) -> None:
    """In the order given, each under its name; a column in other units, at a rate of its own."""
    with driven(built_fmus) as system:
        system.connect("driver.road", "car.road.height")  # mm to m
        names = ["car.body.mass", "driver.force", "car.body.z", "driver.road", "car.*.damping"]
        _, back = both(system, names, stop_time=END, interval="3 ms")
        series = {n: [f"{n}[{k}]" for k in range(1, ROWS + 1)] for n in ("driver.force", "driver.road")}
        expected = ["car.body.mass", *series["driver.force"], "car.body.z", *series["driver.road"]]
        assert list(back.parameters) == [*expected, "car.suspension.damping", "car.tire.damping"]
        assert len(back.parameters) > 2 * DIRECTIONS  # forward, copies of more directions
        np.testing.assert_array_equal(back.at[1 : ROWS + 1], FORCES)
        ride = back["ride"]
        assert list(ride) == [*names[:-1], "car.suspension.damping", "car.tire.damping"]
        np.testing.assert_array_equal(ride["driver.road"], back.jacobian[1, ROWS + 2 : 2 * ROWS + 2])
        assert ride["car.body.z"] == back.jacobian[1, ROWS + 1]
        low, high = ride["driver.road"].min(), ride["driver.road"].max()
        text = f"    driver.road             {low:+.9e} to {high:+.9e}, 16 samples"
        assert text in str(back)
        trust = back.trust()
        assert list(trust.parameters) == list(ride)
        assert np.abs(trust.deviation).max() < 1e-8
        for metric in METRICS:  # a difference of one sample
            k, h, ends = 4, 1e-3, []
            for sign in (1.0, -1.0):
                system["driver"].set({"road": 3.0 * FORCES[::-1] + sign * h * (np.arange(ROWS) == k)})
                run = system.run(END, record=["car.body.z", "car.body.az", "driver.force"])
                thinned = [run[n][::3] if len(run.time) > 84 else run[n] for n in METRICS[metric].names]
                ends.append(METRICS[metric].of(thinned)[0])
            slope = (ends[0] - ends[1]) / (2 * h)
            assert back[metric]["driver.road"][k] == pytest.approx(slope, rel=1e-5, abs=1e-9)
        with pytest.raises(GradientError, match="the system has other parameters than when this gradient was computed"):
            back.trust()


@pytest.mark.parametrize("rule", [{"delay": True}, {"linear": (2.0, 0.001)}])
def test_rules_of_exchange(built_fmus: BuiltFmus, rule: Mapping[str, Any]) -> None:
    with driven(built_fmus, **rule) as system:
        for found in both(system, ["driver.force", "car.body.mass"], stop_time=END):
            assert np.abs(found.trust().deviation).max() < 1e-8


@pytest.mark.parametrize("segments", [1, 7, 250])
def test_the_number_of_segments_does_not_matter(
    built_fmus: BuiltFmus, monkeypatch: pytest.MonkeyPatch, segments: int
) -> None:
    with driven(built_fmus) as system:
        names = ["car.body.mass", "driver.force"]
        found = system.gradient(METRICS, names, stop_time=END, mode="adjoint")
        monkeypatch.setattr(adjoint, "SEGMENTS", segments)
        monkeypatch.setattr(adjoint, "_ENTRIES", 4)  # a tape that must grow, for the samples alone
        again = system.gradient(METRICS, names, stop_time=END, mode="adjoint")
        np.testing.assert_allclose(again.jacobian, found.jacobian, rtol=1e-12, atol=1e-13)


def test_a_full_car_under_gpc_with_one_force_from_a_table() -> None:
    """Static equilibrium, feedback of the other forces, several rates."""
    system = system_of(GPC, GpcCase())
    time = np.arange(30) * 0.1
    system.add("force", Table({"t": time, "fl [N]": 400.0 * np.cos(5.0 * time)}))
    system.disconnect("car.force.fl")
    system.connect("force.fl", "car.force.fl")
    _, back = both(system, ["force.fl", "car.tire.stiffness"], RIDES, stop_time=2.5, interval="10 ms")
    assert system.gradient(RIDES, "force.fl", stop_time=0.1).mode == "adjoint"  # 30 samples
    assert np.abs(back.trust().deviation).max() < 1e-8
    system.close()


def test_components_without_derivatives_are_followed_by_differences(built_fmus: BuiltFmus) -> None:
    """Two instances for each sample, at first too: body.az at the begin depends on the first sample."""
    metrics = {"end": Final("car.body.z"), "mean": Mean("car.body.az"), "effort": QuadraticCost({"driver.force": 1.0})}
    with driven(built_fmus) as system:
        forward = system.gradient(metrics, "driver.force", stop_time=END)
        assert forward.tangents[0, 1, 0] == pytest.approx(1.0 / float(system["car"].start("body.mass")))
        system.isolate("car")
        found = system.gradient(metrics, "driver.force", stop_time=END)
        assert list(found.by_difference) == ["car"]
        np.testing.assert_allclose(found.tangents, forward.tangents, rtol=1e-5, atol=1e-7)
        with pytest.raises(GradientError, match="'car' has no adjoint"):
            system.gradient(metrics, "driver.force", stop_time=END, mode="adjoint")


def test_a_table_that_nothing_depends_on_has_an_adjoint_beside_it(built_fmus: BuiltFmus) -> None:
    with driven(built_fmus) as system:
        both(system, ["car.body.mass", "car.body.z"], stop_time=END)


def test_a_table_alone_has_an_adjoint() -> None:
    with System() as system:
        system.add("driver", Table({"t": TIMES, "force": FORCES}))
        both(system, "driver.force", {"end": Final("driver.force")}, stop_time=END)


def test_samples_are_set_for_the_next_run(built_fmus: BuiltFmus, raises: Any) -> None:
    with driven(built_fmus) as system:
        given = np.linspace(-1.0, 1.0, ROWS)
        system["driver"].set({"force": given})
        given[:] = 0.0  # it is copied
        recording = system.run(END, record=["driver.force", "driver.road"])
        np.testing.assert_allclose(
            recording["driver.force"], np.interp(recording.time, TIMES, np.linspace(-1.0, 1.0, ROWS)), atol=1e-15
        )
        np.testing.assert_allclose(
            recording["driver.road"], np.interp(recording.time, TIMES, 3.0 * FORCES[::-1]), atol=1e-14
        )
        wrong: Sequence[Any] = (np.zeros(ROWS - 1), 1.0, "many", [[1.0] * ROWS], np.full(ROWS, np.nan))
        for samples in wrong:
            with raises(WiringError):
                system["driver"].set({"force": samples})
        with raises(WiringError):
            system["driver"].set({"number": np.arange(ROWS)})
        for name, expected in {"force": np.linspace(-1.0, 1.0, ROWS), "road": 3.0 * FORCES[::-1]}.items():
            np.testing.assert_array_equal(system["driver"].start(name), expected)
            with pytest.raises(ValueError, match="read-only"):
                system["driver"].start(name)[0] = 5.0


def test_copies_have_samples_of_their_own(built_fmus: BuiltFmus) -> None:
    with driven(built_fmus) as system:
        each = np.stack([FORCES, 2.0 * FORCES, -FORCES])
        with Batch(system, 3, start={"driver.force": each}, record=["car.body.z"]) as batch:
            batch.advance(END, final=True)
            found = batch.recording["car.body.z"]
        for samples, row in zip(each, found, strict=True):
            system["driver"].set({"force": samples})
            np.testing.assert_array_equal(bits(row), bits(system.run(END, record=["car.body.z"])["car.body.z"]))
        assert np.ptp(found[:, -1]) > 0.0


def test_mistakes_are_named(built_fmus: BuiltFmus, raises: Any) -> None:
    with driven(built_fmus) as system:
        for name in ("driver.number", "driver.on", "driver.road"):
            with raises(GradientError):
                system.gradient({"end": Final("car.body.z")}, name, stop_time=END)
        for name in ("driver.forces", "drive.force"):
            with raises(WiringError):
                system.gradient({"end": Final("car.body.z")}, name, stop_time=END)
        shown = system.gradient({"end": Final("driver.road")}, "driver.road", stop_time=TIMES[5])
        assert shown["end"]["driver.road"].sum() == pytest.approx(1.0)  # read by a metric, it counts


def test_the_example_finds_forces_below_those_of_preview_lq(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    example = runpy.run_path(str(ROOT / "docs" / "examples" / "open_loop_forces.py"))
    open_loop, limit = example["OpenLoop"](), 1000.0
    passive, controlled = (example["measure"](s) for s in (open_loop.system, example["with_preview_lq"]()))
    forces = open_loop.search(limit)
    assert np.abs(forces).max() == pytest.approx(limit)
    assert open_loop.runs < 60
    _, slopes = open_loop.index(forces / example["SCALE"])
    free = (np.abs(forces) < limit * (1 - 1e-9)).ravel()
    assert np.abs(slopes[free]).max() < 1e-3 * np.abs(open_loop.index(0.0 * forces)[1]).max()
    open_loop.set(open_loop.search())
    best = example["measure"](open_loop.system)
    assert best["index"] < 0.9 * controlled["index"] < 0.6 * passive["index"]
