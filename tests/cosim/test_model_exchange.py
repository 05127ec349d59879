"""Model Exchange FMUs are integrated inside the communication step: compared with analytic solutions and with CVode."""

from __future__ import annotations

import math
import platform
import warnings

import fmpy
import fmpy.sundials
import numpy as np
import pytest
from foreign import exchanged, followers
from foreign.making import redescribed
from probes import Clock

from cosim import ComponentError, CosimError, Fmu, FmuError, FmuWarning, ModelExchange, System, SystemState, WiringError
from cosim.batch import Batch
from cosim.fmu.component import FmuComponent

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")

SOLVERS = ("auto", "explicit", "implicit")
LAG, BALL, TIMED, STIFF, RAMP, NAN, ENDLESS, CHATTER, ENDS, ERROR, NEVER_LATER, DIVERGES, DISCARDS, OSCILLATOR = range(
    14
)
UPWARD, NOWHERE, NOMINALS = 14, 15, 16


@pytest.fixture(scope="session")
def exchanges(tmp_path_factory):
    folder = tmp_path_factory.mktemp("exchanged")
    return {version: exchanged.build(version, folder) for version in (2, 3)}


@pytest.fixture(params=(2, 3))
def fmu(exchanges, request):
    return exchanges[request.param]


def one(fmu, kind, *, step="10 ms", tolerance=1e-9, solver="auto", x=1.0, isolated=False, **parameters):
    """A system of one FMU."""
    system = System()
    exchange = ModelExchange(tolerance=tolerance, solver=solver)
    given = {"kind": kind, **parameters}
    system.add("m", fmu, step=step, interface=exchange, parameters=given, start={"x": x}, isolated=isolated)
    return system


def counts(system):
    """What the integrator of `one` did."""
    component = system["m"].implementation
    assert isinstance(component, FmuComponent)
    assert component.integration is not None
    return component.integration.counts


def bounces(t):
    """Height of the ball after rebounds at 0.8 of its speed, and the time of its last rebound."""
    g, speed, begin = 9.81, 0.0, 0.0
    duration = math.sqrt(2.0 / g)
    height, last = 1.0, 0.0
    while begin + duration <= t:
        begin += duration
        last, speed, height = begin, 0.8 * (g * duration if speed == 0.0 else speed), 0.0
        duration = 2.0 * speed / g
    s = t - begin
    return height + speed * s - g * s * s / 2.0, last


SOLUTIONS = {
    LAG: lambda t: np.exp(-t),
    STIFF: np.cos,
    RAMP: lambda t: 1.0 + t**3,
    DISCARDS: lambda t: 1.0 - 0.5 * np.exp(-t),
}


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("kind", SOLUTIONS)
def test_analytic_solutions(fmu, kind, solver):
    with one(fmu, kind, solver=solver, x=0.5 if kind == DISCARDS else 1.0) as system:
        result = system.run(1)
        np.testing.assert_allclose(result["m.x"], SOLUTIONS[kind](result.time), rtol=0, atol=2e-8)
        done = counts(system)
        assert done["steps"] == result["m.steps"][-1]  # of all of which it was told


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("step", ["1 ms", "10 ms", "1/3"])
def test_a_ball_bounces_at_the_analytic_times(fmu, step, solver):
    with one(fmu, BALL, step=step, solver=solver) as system:
        result = system.run(2)
        expected = np.array([bounces(t) for t in result.time])
        np.testing.assert_allclose(result["m.last"], expected[:, 1], rtol=0, atol=1e-9)
        np.testing.assert_allclose(result["m.x"], expected[:, 0], rtol=0, atol=1e-8)
        assert counts(system)["events"] == result["m.count"][-1] == 3


@pytest.mark.parametrize("solver", ["explicit", "implicit"])
def test_events_of_an_oscillator_are_located_within_long_steps(fmu, solver):
    w = 40.0
    with one(fmu, OSCILLATOR, step="0.05", solver=solver, tolerance=1e-12, k=w) as system:
        result = system.run(1)
        crossings = (np.arange(1, 14) - 0.5) * math.pi / w
        last = [crossings[crossings <= t].max(initial=0.0) for t in result.time]
        np.testing.assert_allclose(result["m.last"], last, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(result["m.count"], [np.sum(crossings <= t) for t in result.time])


def test_time_events_are_exact(fmu):
    with one(fmu, TIMED, step="0.07") as system:
        result = system.run("1.4")
        events = np.array([0.1, *(0.1 + 0.2 * np.cumsum(np.ones(6)))])
        expected = [1.0 + np.sum(events <= t + 1e-12) for t in result.time]
        np.testing.assert_array_equal(result["m.x"], expected)
    with one(fmu, TIMED, step="0.1") as system:  # events at the ends of steps, but for rounding, belong to these ends
        np.testing.assert_array_equal(system.run("0.9")["m.count"], [0, 1, 1, 2, 2, 3, 3, 4, 4, 5])


@pytest.mark.parametrize(("solver", "order"), [("explicit", 5), ("implicit", 4)])
def test_errors_fall_with_the_tolerance(fmu, solver, order):
    """An error of h^p needs 10^(1/p) times the steps for a tenth of it."""
    steps = []
    for tolerance in (1e-6, 1e-8, 1e-10):
        with one(fmu, OSCILLATOR, step=1, solver=solver, tolerance=tolerance, k=40.0) as system:
            x = system.run(1)["m.x"][-1]
            assert abs(x - math.cos(40.0)) < 300.0 * tolerance  # added up over the run
            steps.append(counts(system)["steps"] - counts(system)["events"])
    np.testing.assert_allclose(np.diff(np.log10(steps)), 2.0 / order, atol=0.08)


def test_a_stiff_model_is_noticed(fmu):
    with one(fmu, STIFF, step="0.1") as system:
        system.run(1)
        automatic = counts(system)
    with one(fmu, STIFF, step="0.1", solver="explicit") as system:
        system.run(1)
        assert counts(system)["steps"] > 50 * automatic["steps"]


@pytest.mark.parametrize("kind", [BALL, STIFF, OSCILLATOR, NOMINALS])
def test_cvode_agrees(fmu, kind):
    options = {"start_values": {"kind": float(kind), "k": 10.0}, "fmi_type": "ModelExchange", "solver": "CVode"}
    theirs = fmpy.simulate_fmu(str(fmu), stop_time=1, output_interval=0.01, relative_tolerance=1e-10, **options)
    with one(fmu, kind, tolerance=1e-10, k=10.0) as system:
        ours = system.run(1)
    rows = np.searchsorted(theirs["time"], ours.time + 1e-9) - 1
    for name in ("x", "v"):
        np.testing.assert_allclose(ours[f"m.{name}"], theirs[name][rows], rtol=0, atol=2e-6)


@pytest.mark.parametrize("name", ["QuarterCarHmmwv", "HydraulicActuator", "RideCarSedan"])
@pytest.mark.parametrize("version", [2, 3])
def test_fmus_of_this_project_run_by_both_interfaces(built_fmus, name, version):
    results = []
    for interface in ("cs", ModelExchange(tolerance=1e-10)):
        with System() as system:
            system.add("m", built_fmus.path(name, version), step="1 ms", interface=interface)
            given = {n: 0.01 for n, v in system["m"].description.inputs.items() if v.type == "real"}
            system["m"].set(given)
            results.append(system.run("0.3"))
    reference = np.max(np.abs(results[0].data), axis=0) + 1e-6
    np.testing.assert_allclose(results[1].data / reference, results[0].data / reference, rtol=0, atol=2e-4)


def test_both_interfaces_in_one_system(fmu, tmp_path):
    """A lag by Model Exchange drives a lag by Co-Simulation, at another rate, and is driven by its output."""
    follower = followers.build(2, tmp_path, units=False)
    rows = []
    for step in ("10 ms", "1 ms"):
        with System() as system:
            system.add("a", fmu, step=step, parameters={"k": -1.0})
            system.add("b", follower, step="2 ms")
            system.connect("a.x", "b.u")
            system.connect("b.y", "a.u")
            result = system.run(1)
            rows.append([result[n][-1] for n in ("a.x", "b.y")])
    exact = [math.exp(-1.0) * math.cos(1.0), math.exp(-1.0) * math.sin(1.0)]  # x' = -y - x, y' = x - y
    assert np.abs(np.subtract(rows[0], exact)).max() < 5e-3
    assert np.abs(np.subtract(rows[1], exact)).max() < 1e-3


@pytest.mark.parametrize("isolated", [False, True])
@pytest.mark.parametrize("kind", [BALL, STIFF, OSCILLATOR, NOMINALS])
def test_saved_states_continue_bit_for_bit(fmu, kind, isolated):
    with one(fmu, kind, k=40.0, isolated=isolated) as system:
        simulation = system.initialize()
        simulation.advance("0.5")
        state = simulation.save()
        packed = state.to_bytes()
        simulation.advance(1)
        whole = simulation.recording
        simulation.restore(state)
        simulation.advance(1)
        np.testing.assert_array_equal(simulation.recording.data, whole.data)
    with one(fmu, kind, k=40.0) as system:
        simulation = system.initialize(state=SystemState.from_bytes(packed))
        simulation.advance(1)
        tail = simulation.recording
        np.testing.assert_array_equal(tail.data, whole.data[-len(tail.data) :])


def test_runs_repeat(fmu):
    with one(fmu, BALL) as system:
        first, second = system.run(1), system.run(1)
        np.testing.assert_array_equal(first.data, second.data)


@pytest.mark.parametrize("kind", [LAG, BALL, TIMED, STIFF, OSCILLATOR])
def test_an_isolated_fmu_gives_the_same_bits(fmu, kind):
    results = []
    for isolated in (False, True):
        with one(fmu, kind, k=40.0, isolated=isolated) as system:
            results.append(system.run(1))
            done = counts(system)
    np.testing.assert_array_equal(results[1].data, results[0].data)
    assert done["steps"] == results[1]["m.steps"][-1]


@pytest.mark.parametrize("kind", [NAN, ENDLESS, CHATTER, ERROR, NEVER_LATER, DIVERGES, NOWHERE])
def test_failures_are_explained(exchanges, kind, raises):
    x = 0.105 if kind == CHATTER else 0.0
    with one(exchanges[2], kind, solver="explicit", x=x) as system, raises(ComponentError) as caught:
        system.run(2)
    system = one(exchanges[2], kind, solver="explicit", x=x, isolated=True)
    with system, pytest.raises(ComponentError) as isolated:
        system.run(2)
    assert str(isolated.value) == str(caught.value)


def test_an_fmu_may_end_the_simulation(fmu):
    with one(fmu, ENDS) as system:
        assert system.run(1).time[-1] == 0.5


def test_the_interface_is_chosen(fmu, built_fmus, raises):
    assert Fmu(fmu).description.interface == "me"
    both = built_fmus.path("QuarterCarHmmwv", 2)
    assert Fmu(both).description.interface == "cs"
    with System() as system:
        system.add("m", Fmu(both), interface="me")
        assert system["m"].description.interface == "me"
    with raises(FmuError):
        System().add("m", fmu, step=1, interface="cs")


@pytest.mark.parametrize("wrong", [{"tolerance": 0.0}, {"tolerance": math.nan}, {"solver": "euler"}])
def test_options_are_checked(wrong, raises):
    with raises(WiringError):
        ModelExchange(**wrong)


def test_other_components_have_no_interface(raises):
    with raises(WiringError):
        System().add("m", Clock(), step=1, interface="me")


def test_an_ssp_keeps_the_interface(built_fmus, tmp_path):
    results = []
    with System() as system:
        system.add("car", built_fmus.path("QuarterCarHmmwv", 2), step="1 ms", interface="me", start={"force": 50.0})
        file = system.export_ssp(tmp_path / "car.ssp")
        results.append(system.run("0.1").data)
    with System.from_ssp(file) as system:
        assert system["car"].description.interface == "me"
        results.append(system.run("0.1").data)
    np.testing.assert_array_equal(*results)


def rounds_to_nearest() -> bool:
    """Whether arithmetic of this process still does."""
    values = np.array([1.0, 2.0**-60])
    return bool(values[0] + values[1] == 1.0)


@pytest.mark.parametrize("solver", ["explicit", "implicit"])
def test_the_rounding_mode_that_an_fmu_leaves_does_not_reach_the_integrator(fmu, solver):
    with one(fmu, LAG, solver=solver) as system:
        right = system.run(1, record=["m.x"])
    told = pytest.warns(UserWarning, match=r"'m' .* changes the rounding mode")
    with one(fmu, UPWARD, solver=solver) as system, told:
        found = system.run(1, record=["m.x"])
    np.testing.assert_array_equal(found["m.x"], right["m.x"])
    assert rounds_to_nearest()


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_exported_system_puts_back_the_rounding_mode_and_names_who_changed_it(exchanges, tmp_path, fmi, caplog):
    runs = [run_exported(exchanges[3], tmp_path, kind, fmi) for kind in (LAG, UPWARD)]
    np.testing.assert_array_equal(runs[0], runs[1])
    assert rounds_to_nearest()
    assert caplog.text.count("m: it changes the rounding mode of floating-point arithmetic") == 1


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the FMU knows the traps of this processor only")
def test_an_exported_system_puts_back_traps(exchanges, tmp_path, caplog):
    for _ in range(2):  # the second one would find them enabled
        caplog.clear()
        run_exported(exchanges[3], tmp_path, UPWARD, 3, u=1.0)
        assert caplog.text.count("m: it changes the traps of floating-point arithmetic") == 1


def run_exported(fmu, folder, kind, fmi, **start):
    """State x of the FMU in an exported system."""
    with one(fmu, kind) as system:
        system["m"].set(start)
        path = system.export_fmu(folder / f"Kind{kind}.fmu", fmi=fmi)
    with System(allow_unconnected=True) as system:
        system.add("s", path, step="10 ms")
        return system.run(1, record=["s.m.x"])["s.m.x"]


def test_copies_in_a_batch_are_integrated_one_by_one(built_fmus):
    with System() as system:
        system.add("car", built_fmus.path("QuarterCarHmmwv", 3), step="1 ms", interface="me", start={"force": 50.0})
        expected = system.run("0.1", record=["car.body.z"])["car.body.z"]
        with Batch(system, 3, outputs=["car.body.z"]) as batch:
            assert batch.scalar == {"car": "the master integrates it (Model Exchange)"}
            for _ in range(100):
                batch.step("1 ms")
            np.testing.assert_array_equal(batch.outputs[:, 0], np.full(3, expected[-1]))


def test_linear_models_of_both_interfaces_are_the_same(built_fmus):
    path = built_fmus.path("QuarterCarHmmwv", 3)
    one, other = (Fmu(path, interface=i).linearize() for i in ("cs", "me"))
    for matrix in ("A", "B", "C", "D"):
        np.testing.assert_array_equal(getattr(one, matrix), getattr(other, matrix))


def test_fmus_without_directional_derivatives_are_linearized_by_differences(fmu):
    """dx/dt = k u - x and x'' = -k^2 x, whose outputs x and v are states, with an input that lies on the other side."""
    with one(fmu, LAG, k=2.0) as system:
        model = system.linearize(inputs=["m.u"], outputs=["m.x", "m.v"])
    np.testing.assert_allclose(model.A, [[-1.0, 0.0], [0.0, 0.0]], rtol=0, atol=1e-9)
    np.testing.assert_allclose(model.B, [[2.0], [0.0]], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(model.C, np.eye(2))
    with one(fmu, OSCILLATOR, k=3.0) as system:
        model = system.linearize(inputs=["m.u"], outputs=["m.v"])
        np.testing.assert_allclose(model.A, [[0.0, 1.0], [-9.0, 0.0]], rtol=0, atol=1e-8)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    ("slope", "returned"), [("0.0", "OK"), ("NAN", "OK"), ("INFINITY", "OK"), ("0.0", "Discard"), ("0.0", "Error")]
)
def test_the_implicit_method_takes_differences_where_derivatives_do_not_agree(version, slope, returned, tmp_path):
    path = exchanged.build(version, tmp_path, slope=slope, returned=returned)
    with one(path, STIFF, step="0.1", solver="implicit") as system:
        run = system.run(1, record=["m.x"])
    np.testing.assert_allclose(run["m.x"], np.cos(run.time), atol=1e-6)


@pytest.mark.parametrize("version", [2, 3])
def test_a_linear_model_takes_differences_where_derivatives_do_not_agree(version, tmp_path):
    with one(exchanged.build(version, tmp_path, slope="0.0"), LAG, k=2.0) as system:
        with pytest.warns(FmuWarning, match="'m': the directional derivatives .* do not agree with differences"):
            model = system.linearize(inputs=["m.u"], outputs=["m.x"])
        np.testing.assert_allclose(model.A, [[-1.0, 0.0], [0.0, 0.0]], rtol=0, atol=1e-9)
        np.testing.assert_allclose(model.B, [[2.0], [0.0]], rtol=0, atol=1e-9)


def test_a_linear_model_takes_derivatives_that_agree(tmp_path):
    """The model of kind TIMED has none but zeros."""
    with one(exchanged.build(3, tmp_path, slope="0.0"), TIMED) as system, warnings.catch_warnings():
        warnings.simplefilter("error", FmuWarning)
        assert not system.linearize(inputs=["m.u"], outputs=["m.x"]).A.any()


def test_linearization_by_differences_changes_nothing(fmu):
    names = ["m.x", "m.v", "m.count"]
    runs = []
    for looks in (False, True):
        with one(fmu, OSCILLATOR, k=3.0) as system, system.initialize(record=names) as simulation:
            simulation.advance(1)
            if looks:
                component = system["m"].implementation
                variables = component.description.variables
                a, b, c, _ = component.linearize([variables["u"]], [variables["x"]])
                np.testing.assert_allclose(a, [[0.0, 1.0], [-9.0, 0.0]], rtol=0, atol=1e-8)
                np.testing.assert_array_equal(c, [[1.0, 0.0]])
                assert not b.any()
            simulation.advance(3)
            runs.append(simulation.recording.data)
    np.testing.assert_array_equal(*runs)


def test_what_cannot_be_linearized_by_differences_says_why(exchanges, tmp_path, raises):
    unsaved = redescribed(exchanges[3], tmp_path / "Unsaved.fmu", (b'canGetAndSetFMUState="true"', b""))
    discrete = redescribed(
        exchanges[3],
        tmp_path / "Discrete.fmu",
        (b'causality="input" variability="continuous"', b'causality="input" variability="discrete"'),
    )
    for path, options in ((unsaved, {}), (exchanges[3], {"isolated": True}), (discrete, {})):
        with one(path, LAG, **options) as system, raises(CosimError):
            system.linearize(inputs=["m.u"], outputs=["m.x"])


@pytest.mark.parametrize(
    ("before", "after", "function"),
    [
        (b'numberOfEventIndicators="1"', b'numberOfEventIndicators="7"', "GetEventIndicators"),
        (b'<Derivatives><Unknown index="3"/>', b"<Derivatives>", "States"),
    ],
)
def test_wrong_counts_are_errors_of_the_fmu(exchanges, tmp_path, before, after, function):
    path = redescribed(exchanges[2], tmp_path / "Wrong.fmu", (before, after))
    for isolated in (False, True):
        with System() as system:
            system.add("m", path, step=1, isolated=isolated)
            with pytest.raises(CosimError, match=f"component 'm': fmi2.*{function} returned Error"):
                system.run(1)
