"""Derivatives of whole runs beside exact ones, beside differences of runs, and what has none."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from built import OBJECTS, BuiltFmus
from foreign import relay, sloped
from rides import RIDES, bench_step, system_of
from same import bits

from build_fmus.compile import ObjectCache, resolve_platforms
from build_fmus.component import Component
from build_fmus.package import build_fmu
from cosim import CosimError, PythonComponent, Record, System
from cosim.batch import Batch
from cosim.batch.library import batch_library
from cosim.core.signals import Array
from cosim.experiments.bench import EXPERIMENT as BENCH
from cosim.experiments.bench.runs import Case as BenchCase
from cosim.experiments.gpc import EXPERIMENT as GPC
from cosim.experiments.gpc.runs import Case as GpcCase
from cosim.experiments.hmmwv import EXPERIMENT as HMMWV
from cosim.experiments.hmmwv.runs import Case as HmmwvCase
from cosim.experiments.preview_lq import EXPERIMENT as RIDE
from cosim.experiments.preview_lq.runs import Case as RideCase
from cosim.experiments.three_axle import EXPERIMENT as THREE_AXLE
from cosim.experiments.three_axle.runs import Case as ThreeAxleCase
from cosim.gradient import Final, Gradient, GradientError, Mean, Metric, Peak, QuadraticCost, Rms
from fmu_sources.roads.random_road import NODES

pytestmark = [
    pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning"),
    pytest.mark.usefixtures("built_fmus"),
]


@pytest.fixture(scope="module")
def quarter_car(built_fmus: BuiltFmus) -> System:
    system = System()
    system.add("car", built_fmus.path("QuarterCarBench", 3), step="1 ms")
    system["car"].set({"body.z": 0.01, "wheel.vz": -0.2})
    return system


def free_response(values: Mapping[str, complex], steps: int) -> Any:
    """body.z of the bench's equations, here over complex numbers."""
    step, _ = bench_step(values)
    x, found = np.array([values["body.z"], 0.0, 0.0, values["wheel.vz"]], dtype=complex), []
    for _ in range(steps + 1):
        found.append(x[0])
        x = step @ step @ x  # two solver steps in a communication step
    return np.array(found)


def test_derivatives_of_a_linear_run_are_exact(quarter_car: System) -> None:
    names = ["body.mass", "wheel.mass", "suspension.stiffness", "suspension.damping", "tire.stiffness", "tire.damping"]
    names += ["body.z", "wheel.vz"]
    found = quarter_car.gradient(
        {"end": Final("car.body.z"), "mean": Mean("car.body.z")}, [f"car.{n}" for n in names], stop_time="0.3 s"
    )
    values = dict(zip(names, found.at.tolist(), strict=True))
    for j, name in enumerate(names):
        h = 1e-30 * values[name]
        exact = free_response(values | {name: values[name] + 1j * h}, 300).imag / h
        np.testing.assert_allclose(found.tangents[:, 0, j], exact, rtol=1e-9, atol=1e-11 * np.abs(exact).max())
        assert found["end"][f"car.{name}"] == pytest.approx(exact[-1], rel=1e-9)
        assert found["mean"][f"car.{name}"] == pytest.approx(exact.mean(), rel=1e-9)
    assert found.values[0] == pytest.approx(free_response(values, 300)[-1].real, rel=1e-12)
    assert not found.by_difference


@pytest.mark.parametrize(
    ("experiment", "case", "stop"),
    [(GPC, GpcCase(), 1.0), (RIDE, RideCase(), 1.0), (BENCH, BenchCase(), 0.3)],
    ids=["gpc", "preview-lq", "bench"],
)
def test_the_run_has_the_bits_of_one_without(experiment: Any, case: Any, stop: float) -> None:
    system = system_of(experiment, case)
    car = "bench" if "bench" in system.components else "car" if "car" in system.components else "plant"
    found = system.gradient({"ride": Rms(f"{car}.body.az")}, f"{car}.body.mass", stop_time=stop, interval="10 ms")
    alone = system.run(stop, record=Record([f"{car}.body.az"], "10 ms"))
    np.testing.assert_array_equal(bits(found.recording.time), bits(alone.time))
    np.testing.assert_array_equal(bits(found.recording.data), bits(alone.data))
    assert found.jacobian[0, 0] != 0.0


def deviates(found: Gradient, parameter: str, limit: float) -> None:
    j = list(found.parameters).index(parameter)
    trust = found.trust()
    assert np.abs(trust.deviation[:, j]).max() < limit
    assert np.abs(found.jacobian[:, j]).min() > 0.0


@pytest.mark.parametrize("parameter", ["car.body.mass", "car.suspension.fl.stiffness", "car.body.z"])
def test_a_ride_car_under_preview_agrees_with_differences(parameter: str) -> None:
    system = system_of(RIDE, RideCase())
    deviates(system.gradient(RIDES, parameter, stop_time=1.5, interval="10 ms"), parameter, 1e-8)


def test_a_full_car_under_gpc_agrees_with_differences() -> None:
    system = system_of(GPC, GpcCase())
    names = ["controller.gain.preview[1,1]", "car.tire.stiffness"]
    found = system.gradient(RIDES, names, stop_time=2.5, interval="10 ms")
    trust = found.trust()
    assert np.abs(trust.deviation).max() < 1e-8
    assert (trust.smooth == trust.stop).all()  # no comparison had another outcome in the neighboring runs
    assert found.changes["road"] > 0  # the car passes pieces of the road


def test_an_fmu_without_derivatives_is_followed_by_differences() -> None:
    system = system_of(RIDE, RideCase())
    exact = system.gradient(RIDES, "car.body.mass", stop_time=1.0, interval="10 ms")
    system.isolate("controller")
    found = system.gradient(RIDES, "car.body.mass", stop_time=1.0, interval="10 ms")
    system.close()
    assert found.by_difference == {"controller": "it is isolated in a process of its own"}
    np.testing.assert_array_equal(found.values, exact.values)
    np.testing.assert_allclose(found.jacobian, exact.jacobian, rtol=1e-6)


@pytest.mark.parametrize(
    ("experiment", "case", "stop", "limit"),
    [
        # With four hydraulic actuators, whose solver is ros2. Rows are held and let go.
        pytest.param(HMMWV, HmmwvCase(tunable=True), 0.9, 1e-10, marks=pytest.mark.full),  # DAQP
        pytest.param(THREE_AXLE, ThreeAxleCase(), 0.6, 1e-8, marks=pytest.mark.full),  # DAQP
        # Programs that are solved until the residual is small, not until nothing changes.
        pytest.param(HMMWV, HmmwvCase(), 0.9, 1e-7, marks=pytest.mark.full),
        (BENCH, BenchCase(), 0.4, 1e-4),
    ],
    ids=["hmmwv-daqp", "three-axle", "hmmwv", "bench"],
)
def test_a_controller_with_quadratic_programs_agrees_with_differences(
    experiment: Any, case: Any, stop: float, limit: float
) -> None:
    system = system_of(experiment, case)
    car = "car" if "car" in system.components else "plant"
    found = system.gradient({"ride": Rms(f"{car}.body.az")}, f"{car}.body.mass", stop_time=stop, interval="2 ms")
    assert not found.by_difference
    deviates(found, f"{car}.body.mass", limit)


def test_a_derivative_of_an_fmu_is_read_and_differentiated(quarter_car: System) -> None:
    found = quarter_car.gradient({"rms": Rms("car.der(body.vz)")}, "car.body.mass", stop_time="0.2 s")
    exact = quarter_car.gradient({"rms": Rms("car.body.az")}, "car.body.mass", stop_time="0.2 s")
    alone = quarter_car.run("0.2 s", record=["car.der(body.vz)"])
    np.testing.assert_array_equal(bits(found.recording.data), bits(alone.data))
    assert found.by_difference == {"car": "its derivative der(body.vz) is read"}
    np.testing.assert_allclose(found.jacobian, exact.jacobian, rtol=1e-6)
    assert np.isnan(found.trust().smooth).all()


def test_values_that_are_equal_by_chance_move_apart(built_fmus: BuiltFmus) -> None:
    """The generated road takes the heights of one wheel for the other where both are at one place."""
    with System(allow_unconnected=True) as system:
        system.add("road", built_fmus.path("RoadSine", 3))
        system["road"].set({"x": 31.3})
        names = ["road.wheel.fl.x", "road.wheel.fr.x"]
        wheels = {"left": Final("road.road.fl.height"), "right": Final("road.road.fr.height")}
        found = system.gradient(wheels, names, stop_time="0.01 s")
        assert found.values[0] == found.values[1] != 0.0
        assert (found.jacobian == np.diag(np.diag(found.jacobian))).all()
        assert np.abs(found.trust().deviation).max() < 1e-6


def test_a_gradient_is_of_the_values_it_was_computed_at(quarter_car: System) -> None:
    found = quarter_car.gradient({"end": Final("car.body.z")}, "car.body.mass", stop_time="0.1 s")
    kept = dict(quarter_car["car"].values)
    quarter_car["car"].set({"body.mass": 1.5})
    try:
        with pytest.raises(GradientError, match="other parameters than when this gradient was computed"):
            found.trust()
    finally:
        quarter_car["car"].values = kept


def test_what_no_metric_depends_on_has_no_derivatives(built_fmus: BuiltFmus) -> None:
    system = System()
    system.add("car", built_fmus.path("QuarterCarBench", 3), step="1 ms", start={"body.z": 0.01})
    alone = system.gradient({"ride": Rms("car.body.az")}, "car.body.mass", stop_time="0.2 s")
    system.add("follower", built_fmus.path("QuarterCarBench", 3), step="1 ms")
    system.connect("car.body.z", "follower.road.height")
    mine, both = {"ride": Rms("car.body.az")}, {"ride": Rms("car.body.az"), "other": Rms("follower.body.az")}
    for mode in ("forward", "adjoint"):
        found = system.gradient(mine, "car.body.mass", stop_time="0.2 s", mode=mode)
        np.testing.assert_allclose(found.jacobian, alone.jacobian, rtol=1e-12)
        assert system.gradient(both, "car.body.mass", stop_time="0.2 s", mode=mode).jacobian[1, 0] != 0.0
        assert system.gradient(both, "follower.body.mass", stop_time="0.2 s", mode=mode).jacobian[0, 0] == 0.0
    system.isolate("follower")
    assert system.gradient(mine, "car.body.mass", stop_time="0.2 s").by_difference == {}
    assert list(system.gradient(both, "car.body.mass", stop_time="0.2 s").by_difference) == ["follower"]
    system.close()


def test_many_parameters_are_shared_among_copies() -> None:
    system = system_of(RIDE, RideCase())
    many = system.gradient(RIDES, "car.*.stiffness", stop_time=0.5, interval="10 ms", threads=2)
    names = ["car.*.mass", "car.*.damping", *many.parameters]
    more = system.gradient(RIDES, names, stop_time=0.5, interval="10 ms", mode="forward")
    assert len(more.parameters) > 16
    same = [list(more.parameters).index(n) for n in many.parameters]
    np.testing.assert_array_equal(bits(more.tangents[:, :, same]), bits(many.tangents))
    np.testing.assert_allclose(more.jacobian[:, same], many.jacobian, rtol=1e-12)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ("car.solver.step", "car.solver.step has no derivative: it sets the number of solver steps"),
        ("car.force", None),
        ("car.body.az", "car.body.az has no derivative: it is calculated, so no start value can be given"),
        ("car.no*", "'car.no*' fits no parameter, start value, series or unconnected input of real numbers"),
        ([], "there is no parameter to differentiate by: name one, such as car.body.mass"),
    ],
)
def test_what_has_no_derivative(quarter_car: System, parameters: Any, message: str | None) -> None:
    if message is None:
        assert quarter_car.gradient({"end": Final("car.body.z")}, parameters, stop_time="0.1 s").jacobian[0, 0] > 0.0
        return
    with pytest.raises(GradientError) as raised:
        quarter_car.gradient({"end": Final("car.body.z")}, parameters, stop_time="0.1 s")
    assert str(raised.value) == message


def test_a_linear_response_to_a_constant_input(quarter_car: System) -> None:
    found = quarter_car.gradient({"end": Final("car.body.z")}, "car.force", stop_time="0.2 s")
    kept, ends = dict(quarter_car["car"].values), []
    for force in (0.0, 100.0):
        quarter_car["car"].set({"force": force})
        ends.append(quarter_car.run("0.2 s", record=["car.body.z"])["car.body.z"][-1])
    quarter_car["car"].values = kept
    assert found["end"]["car.force"] == pytest.approx((ends[1] - ends[0]) / 100.0, rel=1e-9)


def test_a_parameter_at_the_end_of_its_range_has_a_derivative_but_no_neighbors(quarter_car: System) -> None:
    kept = dict(quarter_car["car"].values)
    quarter_car["car"].set({"suspension.damping": 0.0})
    found = quarter_car.gradient({"end": Final("car.body.z")}, "car.suspension.damping", stop_time="0.2 s")
    try:
        assert found.jacobian[0, 0] != 0.0
        with pytest.raises(
            GradientError, match=r"^car.suspension.damping cannot be compared with runs at 0 -\+ 0.0002: "
        ):
            found.trust()
    finally:
        quarter_car["car"].values = kept


def test_parameters_of_random_profiles_have_no_derivative(built_fmus: BuiltFmus) -> None:
    with System(allow_unconnected=True) as system:
        system.add("road", built_fmus.path("RoadRandom", 3))
        name = next(
            n
            for n, v in system["road"].description.variables.items()
            if v.causality == "parameter" and v.type == "real"
        )
        with pytest.raises(CosimError, match="RoadRandom computes random profiles from its parameters"):
            system.gradient({"end": Final("road.road.fl.height")}, f"road.{name}", stop_time="0.1 s")


def test_a_shorter_random_road_leaves_nothing_of_the_one_before(built_fmus: BuiltFmus) -> None:
    with System(allow_unconnected=True) as system:
        system.add("speed", built_fmus.path("SpeedProfile", 3))
        system.add("road", built_fmus.path("RoadRandom", 3))
        system.add("car", built_fmus.path("QuarterCarBench", 3))
        system.connect("speed.x", "road.x")
        system.connect("road.road.fl.height", "car.road.height")
        seeds = {"speed.start.x": np.ones((1, 8))}

        def profile(*lengths: float) -> Array:
            """Heights at all nodes of both tracks, after a reset to each length [m]."""
            with Batch(system, 1, outputs="car.body.z", seeds=seeds, begin=False) as batch:
                for length in lengths:
                    batch.reset({"road.length": length})
                lanes = batch._lanes[system["road"]]
                first = lanes.library.cosim_lanes_numbers()
                return lanes.whole[0, first : first + 2 * NODES[1], 0].copy()

        short, begun_longer = profile(100.0), profile(1500.0, 100.0)
        assert 0 < np.count_nonzero(short) < NODES[1]
        np.testing.assert_array_equal(begun_longer, short)


def test_a_compiler_that_fails_is_named(built_fmus: BuiltFmus, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """It is one for C++."""
    batch_library.cache_clear()
    monkeypatch.setattr("cosim.batch.library._loaded", {})
    monkeypatch.setattr("cosim.batch.library.ObjectCache.of_user", lambda: ObjectCache(tmp_path))
    monkeypatch.setattr("build_fmus.compile._CPP_FLAGS", ("-no-such-option",))
    with System(allow_unconnected=True) as system:
        system.add("car", built_fmus.path("QuarterCarBench", 3), step="1 ms")
        with pytest.raises(CosimError, match=r"^a gradient needs a C\+\+ compiler, and that failed: .*no-such-option"):
            system.gradient({"end": Final("car.body.z")}, "car.body.mass", stop_time="0.1 s")


def test_driven_inputs_and_integers_have_no_derivative() -> None:
    system = system_of(GPC, GpcCase())
    for name, why in {
        "controller.body.az": "car.body.az drives it",
        "car.driver.mode": "it is of type Int32, and only real numbers vary continuously",
    }.items():
        with pytest.raises(GradientError) as raised:
            system.gradient({"ride": Rms("car.body.az")}, name, stop_time=1.0)
        assert str(raised.value) == f"{name} has no derivative: {why}"


def test_a_run_that_fails_has_no_derivatives(quarter_car: System) -> None:
    kept = dict(quarter_car["car"].values)
    quarter_car["car"].set({"force": 1e300})
    try:
        with pytest.raises(GradientError, match=r"^the run has no derivatives, since it ends at t = .* diverged"):
            quarter_car.gradient({"end": Final("car.body.z")}, "car.body.mass", stop_time="5 s")
    finally:
        quarter_car["car"].values = kept


@pytest.mark.parametrize("first", [0.0, 1.0], ids=["begin", "later"])
def test_an_instance_beside_the_run_that_fails_is_named(first: float, tmp_path: Path) -> None:
    """The root of a level that is hardly above 0, at once or after the first sample: a little below there is none."""
    shifted = Component("Shifted", kind="discrete", description="a level", source="none", sample_time=0.01)
    height = shifted.parameter("height", 1.0 + 1e-9, "1", "height", source="assumed")
    more = shifted.state("more", "1", "more than the height, at first", start=first)
    shifted.update(more, 0.0)
    shifted.output("level", height + more - 1.0, "1", "level")
    root = Component("Root", kind="discrete", description="root of a level", source="none", sample_time=0.01)
    root.output("flow", ca.sqrt(root.input("level", "1", "level")), "1", "root of the level")
    with System() as system:
        for component in (shifted, root):
            path = tmp_path / f"{component.name}.fmu"
            path.write_bytes(build_fmu(component, 3, resolve_platforms("host"), OBJECTS))
            system.add(component.name.lower(), path, step="10 ms")
        system.connect("shifted.level", "root.level")
        system.isolate("root")
        with pytest.raises(CosimError, match="'root': an instance beside it, for differences, failed where it did not"):
            system.gradient({"end": Final("root.flow")}, "shifted.height", stop_time="0.1 s")


@pytest.mark.parametrize("first", [0.0, 1.0], ids=["begin", "later"])
def test_an_instance_beside_the_run_that_asks_for_the_end_is_named(first: float, tmp_path: Path) -> None:
    """FMUs at a level that is hardly below their limit, at once or after the first sample."""
    shifted = Component("Shifted", kind="discrete", description="a level", source="none", sample_time=0.01)
    height = shifted.parameter("height", 1.0 - 1e-9, "1", "height", source="assumed")
    less = shifted.state("less", "1", "less than the height, at first", start=first)
    shifted.update(less, 0.0)
    shifted.output("level", height - less, "1", "level")
    path = tmp_path / "Shifted.fmu"
    path.write_bytes(build_fmu(shifted, 3, resolve_platforms("host"), OBJECTS))
    fmus = {
        "me.u": (relay.build(3, tmp_path), {"ends": 1.0}),
        "cs.p": (sloped.build(3, tmp_path, events="discrete"), {"trouble": 10.0}),
    }
    for name, output in (("me.u", "me.y"), ("cs.p", "cs.a")):
        with System(allow_unconnected=True) as system:
            system.add("shifted", path, step="10 ms")
            system.add(name[:2], fmus[name][0], step="10 ms", parameters=fmus[name][1])
            for target in (name, *["cs.q"] * (name == "cs.p")):
                system.connect("shifted.level", target)
            when = "t = 0 s" if not first else "t = 0.01 s"
            text = f"ends at {when}: component '{name[:2]}': an instance beside it"
            with pytest.raises(GradientError, match=text):
                system.gradient({"end": Final(output)}, "shifted.height", stop_time="0.1 s")


def test_ties_are_told_with_their_time(tmp_path: Path) -> None:
    """Of a ramp that is cut off at 0: it is 0 in the sample at 0.05 s, or nearly, between two slopes."""
    ramp = Component("Ramp", kind="discrete", description="a ramp", source="none", sample_time=0.01)
    height = ramp.parameter("height", 1.0, "1", "height", source="assumed")
    count = ramp.state("count", "1", "samples so far", start=0.0)
    ramp.update(count, count + 1.0)
    ramp.output("cut", ca.fmax(count - 6.0 + height, 0.0), "1", "the ramp, at least 0")
    ramp.output("same", ca.fmax(height, 1.0 * height), "1", "equal numbers that do not move apart")
    ramp.output("rounding", ca.fmax(1e-16 * (height - 1.0), 0.0), "1", "a number that is 0 to rounding")
    path = tmp_path / "ramp.fmu"
    path.write_bytes(build_fmu(ramp, 3, resolve_platforms("host"), OBJECTS))
    metrics = {n: Final(f"ramp.{n}") for n in ("cut", "same", "rounding")}
    with System() as system:
        system.add("ramp", path, step="10 ms")
        found = system.gradient(metrics, "ramp.height", stop_time="0.05 s")
        assert found.ties == {"ramp": pytest.approx(0.05)}
        assert found["same"]["ramp.height"] == 1.0
        assert "ramp: at t = 0.05 s" in str(found)
        assert np.abs(found.trust().deviation[0, 0]) == pytest.approx(1.0)  # 1 or 0 beside the mean of both
        for height, ties in ((1.0 - 9e-9, found.ties), (1.0 + 9e-9, found.ties), (1.0 + 3e-8, {}), (1.5, {})):
            system["ramp"].set({"height": height})
            assert system.gradient(metrics, "ramp.height", stop_time="0.05 s").ties == ties


def test_python_in_a_gradient_is_refused_in_words_of_gradients(built_fmus: BuiltFmus) -> None:
    class Gain(PythonComponent):
        outputs = ("y",)

    with System(allow_unconnected=True) as system:
        system.add("car", built_fmus.path("QuarterCarBench", 3), step="1 ms")
        system.add("p", Gain(), step="1 ms")
        with pytest.raises(
            CosimError, match=r"^'p' is .* a gradient has no Python .* or compare runs with different v"
        ):
            system.gradient({"end": Final("car.body.z")}, "car.body.mass", stop_time="0.1 s")


def test_metrics_have_slopes_and_full_names(quarter_car: System) -> None:
    for metric, message in {
        Rms("car.*.z"): "the metric 'ride' reads a pattern: give full names, one metric for each",
        Rms("car.road.height"): "the metric 'ride' is 0, where it has no slope: use a QuadraticCost",
    }.items():
        with pytest.raises(GradientError) as raised:
            quarter_car.gradient({"ride": metric}, "car.body.mass", stop_time="0.1 s")
        assert str(raised.value) == message
    with pytest.raises(GradientError, match="a run needs time to depend on its parameters"):
        quarter_car.gradient({"ride": Rms("car.body.z")}, "car.body.mass", stop_time=0)


@pytest.mark.parametrize("shapes", [[(1, 13)], [(1, 8), (1, 16)], [(2, 8)], [(1, 0)]])
def test_seeds_of_other_shapes_are_refused(quarter_car: System, shapes: list[tuple[int, int]]) -> None:
    names = ["car.body.mass", "car.wheel.mass"]
    with pytest.raises(CosimError, match=r"^the seeds have the shapes .* where n is a multiple of [248]$"):
        Batch(quarter_car, 1, seeds={n: np.zeros(s) for n, s in zip(names, shapes, strict=False)})


def test_metrics_must_be_there_and_be_named(quarter_car: System) -> None:
    with pytest.raises(GradientError, match="there is no metric to differentiate"):
        quarter_car.gradient({}, "car.body.mass", stop_time="0.1 s")
    for metric in ("car.body.z", Final):
        with pytest.raises(GradientError, match=r"the metric 'end' is .*; give one of cosim\.gradient"):
            quarter_car.gradient({"end": metric}, "car.body.mass", stop_time="0.1 s")
    found = quarter_car.gradient({"end": Final("car.body.z")}, "car.body.mass", stop_time="0.1 s")
    with pytest.raises(KeyError, match="there is no metric 'begin'; there are: end"):
        found["begin"]
    with pytest.raises(GradientError, match="give a positive number"):
        found.trust(0.0)
    assert "end = " in str(found)
    assert "car.body.mass" in str(found)


@pytest.mark.parametrize(
    "metric", [Mean("y"), Rms("y"), Peak("y", power=8.0), Final("y"), QuadraticCost({"y": 3.0, "z": 0.5})]
)
def test_slopes_of_metrics(metric: Metric) -> None:
    random = np.random.default_rng(1)
    columns = [random.normal(size=7) for _ in metric.names]
    value, slopes = metric.of(columns)
    assert np.isfinite(value)
    for k, slope in enumerate(slopes):
        for i in range(7):
            both = []
            for h in (1e-6, -1e-6):
                moved = [c.copy() for c in columns]
                moved[k][i] += h
                both.append(metric.of(moved)[0])
            assert slope[i] == pytest.approx((both[0] - both[1]) / 2e-6, rel=1e-6, abs=1e-8)


def test_a_peak_is_close_to_the_largest_magnitude() -> None:
    y = np.array([0.3, -2.0, 1.9, 0.0])
    assert 2.0 <= Peak("y").of([y])[0] <= 2.0 * 4 ** (1 / 200)
    assert Peak("y").of([0.0 * y])[0] == 0.0
    with pytest.raises(CosimError, match="give a number from 2 to 1e6"):
        Peak("y", power=1.0)
