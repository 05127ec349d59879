"""What FMUs of this world do: freeze unless told that nothing rolls back, ask for the end, return nonsense."""

import gc

import awkward
import numpy as np
import pytest
from probes import Clock, DiscreteProbe, Integrator

from cosim import ComponentError, CosimError, Execution, PythonComponent, Record, System, UnconnectedInputsWarning

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")
VERSIONS = pytest.mark.parametrize("version", [2, 3])


def plant(system, fmu, trouble=awkward.NONE, at=0.3, value=0.0, **kw):
    return system.add("plant", fmu, parameters={"trouble": trouble, "at": at, "value": value}, **kw)


# ------------------------------------------------------------------------------------------------- may be rolled back


@VERSIONS
def test_a_run_that_is_never_rolled_back_says_so(awkward_fmus, version):
    """Today's wrong result: an FMU that commits its steps only when they are final stood still, without a word."""
    with System() as system:
        plant(system, awkward_fmus[version], awkward.FREEZE)
        result = system.run(1)
        assert result["plant.y"][-1] == pytest.approx(1.0)
        assert result["plant.flags"][-1] == 0


@VERSIONS
def test_only_while_a_state_of_this_run_is_held_may_it_be_rolled_back(awkward_fmus, version, raises):
    with System() as system:
        plant(system, awkward_fmus[version])

        def revocable(simulation, until):
            """Steps announced as revocable from here to `until`."""
            before = simulation["plant.flags"]
            simulation.advance(until)
            return simulation["plant.flags"] - before

        simulation = system.initialize()
        assert revocable(simulation, 0.2) == 0
        first, second = simulation.save(), simulation.save()
        assert revocable(simulation, 0.5) == 3
        simulation.forget(first)
        assert revocable(simulation, 0.6) == 1
        simulation.restore(second)
        assert (simulation.time, simulation["plant.y"]) == (0.2, pytest.approx(0.2))
        assert revocable(simulation, 0.4) == 2
        simulation.forget(second)
        assert revocable(simulation, 0.6) == 0
        simulation.save()  # dropped at once: nobody can go back to it
        gc.collect()
        assert revocable(simulation, 0.8) == 0
        kept = simulation.save()
        again = system.initialize()  # what was saved in another run does not concern this one
        assert revocable(again, 0.5) == 0
        with raises(CosimError):
            again.restore(kept)
        continued = system.initialize(state=kept)
        assert revocable(continued, 1.2) == 0
        assert continued["plant.y"] == pytest.approx(1.2)


# ---------------------------------------------------------------------------------------------------- asks for the end


@VERSIONS
@pytest.mark.parametrize(("trouble", "last"), [(awkward.END, 0.4), (awkward.END_EARLY, 0.3)])
@pytest.mark.parametrize("kind", ["continuous", "discrete"])
def test_an_fmu_that_asks_to_end_ends_the_run_with_its_recording(awkward_fmus, version, trouble, last, kind):
    """In its step from 0.3 s. Done, the run ends at 0.4 s with everybody there; not done, at 0.3 s."""
    with System() as system:
        plant(system, awkward_fmus[version], trouble, kind=kind)
        system.add("fast", Integrator(), step="10 ms", start={"u": 1.0})
        system.add("clock", Clock(), step="50 ms")
        result = system.run(1, record=Record(interval="50 ms"))
        assert result.time[-1] == last
        assert "'plant' asked to end the simulation" in result.stopped_by
        assert "step from 0.3 s" in result.stopped_by
        assert result["fast.y"][-1] == pytest.approx(last)
        shown = {"continuous": last, "discrete": 0.4 if trouble == awkward.END else 0.3}[kind]
        assert result["plant.y"][-1] == pytest.approx(shown)
        assert result["clock.y"][-1] == pytest.approx(0.3 if trouble == awkward.END_EARLY else 0.35)
        np.testing.assert_allclose(np.diff(result.time), 0.05)
        assert system.run(0.2).stopped_by is None  # the system can be used again


def test_an_fmu_that_does_not_tell_how_far_it_came_ends_where_its_step_began(awkward_fmus):
    with System() as system:
        plant(system, awkward_fmus[2], awkward.END_UNTOLD)
        result = system.run(1, record=Record(interval="50 ms"))
    assert result.time[-1] == 0.3
    assert "it does not tell fmi2LastSuccessfulTime" in result.stopped_by


@VERSIONS
def test_the_end_comes_also_when_the_run_is_advanced_in_pieces(awkward_fmus, version, raises):
    with System() as system:
        plant(system, awkward_fmus[version], awkward.END)
        system.add("fast", Integrator(), step="10 ms", start={"u": 1.0})
        simulation = system.initialize(record=["fast.y"])
        assert simulation.advance(0.3) is None
        assert simulation.advance(0.35) is None
        assert "'plant' asked to end" in simulation.advance(0.7)
        assert simulation.time == 0.4
        assert simulation.finished
        with raises(CosimError):
            simulation.advance(0.8)
        assert len(simulation.recording) == 41


@VERSIONS
def test_of_two_that_ask_the_first_end_counts(awkward_fmus, version):
    with System() as system:
        plant(system, awkward_fmus[version], awkward.END, step="0.2 s", at=0.2)
        other = {"trouble": awkward.END_EARLY, "at": 0.2}
        system.add("other", awkward_fmus[version], parameters=other, step="0.1 s", kind="discrete")
        system.add("probe", DiscreteProbe(), step="0.1 s")
        result = system.run(1)
        assert "'other' asked to end" in result.stopped_by
        assert result.time[-1] == 0.2
        assert result["probe.y"][-1] == pytest.approx(0.2)  # what is left of the sample was done


# --------------------------------------------------------------------------------------------------- status and values


@VERSIONS
@pytest.mark.parametrize("status", [-1, 6, 77, -(2**31)])
@pytest.mark.parametrize(
    ("trouble", "function"), [(awkward.STATUS, "DoStep"), (awkward.GET_STATUS, "GetReal|GetFloat64")]
)
def test_a_status_that_fmi_does_not_know_is_an_error(awkward_fmus, version, status, trouble, function, raises):
    with System() as system:
        plant(system, awkward_fmus[version], trouble, value=status)
        with raises(ComponentError, match=f"(?s)fmi{version}({function}).*{status}") as e:
            system.run(1)
        assert e.value.status == str(status)
        assert e.value.recording.time[-1] == pytest.approx(0.3 if trouble == awkward.STATUS else 0.2)


@VERSIONS
def test_a_discarded_step_without_a_wish_to_end_is_an_error(awkward_fmus, version, raises):
    with System() as system:
        plant(system, awkward_fmus[version], awkward.STATUS, value=2)
        with raises(ComponentError) as caught:
            system.run(1)
        assert caught.value.status == "Discard"


def test_pending_is_no_status_of_fmi_3(awkward_fmus):
    texts = {}
    for version in (2, 3):
        with System() as system:
            plant(system, awkward_fmus[version], awkward.STATUS, value=5)
            with pytest.raises(ComponentError) as caught:
                system.run(1)
            texts[version] = str(caught.value)
    assert "Pending" in texts[2]
    assert "asynchronous" in texts[2]
    assert "5, which is no FMI status" in texts[3]


@VERSIONS
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("kind", ["continuous", "discrete"])
def test_a_value_that_is_not_finite_ends_the_run(awkward_fmus, version, value, kind):
    """Output y is not finite after the step from 0.2 s to 0.3 s; no other component reads it."""
    with System() as system:
        fmu = system.add(
            "plant", awkward_fmus[version], parameters={"trouble": awkward.NOT_FINITE, "at": 0.3}, kind=kind
        )
        fmu.values["value"] = value  # which `set` refuses
        seen = system.add("next", Integrator(), step="0.1 s")
        system.connect("plant.y", "next.u")
        at = 0.3 if kind == "continuous" else 0.2
        with pytest.raises(ComponentError, match=rf"'plant': y is {value} at t = {at} s.*allow_nan") as caught:
            system.run(1, record=["plant.y", "next.y"])
        assert (caught.value.component, caught.value.variable) == ("plant", "y")
        assert caught.value.time == pytest.approx(at)
        assert np.isfinite(caught.value.recording.data).all()
        assert np.isfinite(seen.implementation.x)
        result = system.run(1, execution=Execution(allow_nan=True))
        assert not np.isfinite(result["plant.y"][-1])


@VERSIONS
def test_not_finite_after_initialization(awkward_fmus, version):
    """Named is who made it, not the FMU that refuses it as an input."""
    with System() as system:
        fmu = plant(system, awkward_fmus[version], awkward.NOT_FINITE, at=-1.0)
        fmu.values["value"] = np.nan
        with pytest.raises(ComponentError, match="'plant': y is nan at t = 0 s"):
            system.run(1)
        system.add("next", awkward_fmus[version])
        system.connect("plant.y", "next.u")
        with pytest.raises(ComponentError, match="'plant': y is nan at t = 0 s"):
            system.run(1)
        with pytest.raises(ComponentError, match=r"'next': fmi.Set"):
            system.run(1, execution=Execution(allow_nan=True))


def test_within_a_gauss_seidel_group_nothing_that_is_not_finite_is_passed_on(awkward_fmus):
    with System() as system:
        fmu = plant(system, awkward_fmus[2], awkward.NOT_FINITE)
        fmu.values["value"] = np.inf
        system.add("next", awkward_fmus[2])  # refuses what is not finite
        system.connect("plant.y", "next.u")
        system.group("both", ["plant", "next"])
        with pytest.raises(ComponentError, match=r"'plant': y is inf at t = 0\.3 s"):
            system.run(1)


def test_many_side_by_side_are_all_looked_at(awkward_fmus):
    """Continuous components of several rates are looked at together; each is found by its own name."""
    for bad in range(4):
        with System() as system:
            for i in range(4):
                trouble = awkward.NOT_FINITE if i == bad else awkward.NONE
                system.add(f"p{i}", awkward_fmus[2], step=0.1 * (1 + i % 2), parameters={"trouble": trouble, "at": 0.4})
            system[f"p{bad}"].values["value"] = np.nan
            record = [f"p{i}.y" for i in range(4) if i != 1 or bad == 1]  # one without a value in between
            with pytest.raises(ComponentError, match=rf"'p{bad}': y is nan at t = 0\.4 s"):
                system.run(1, record=record)


class Large(PythonComponent):
    """Outputs that are finite while their sum is not, `count` of them at a time (the check has two ways)."""

    outputs = tuple(f"y{i}" for i in range(30))
    default_step = "0.1 s"

    def start(self, u, y):  # noqa: ARG002
        y[:] = np.finfo(float).max

    def step(self, t, h, u, y):  # noqa: ARG002
        if t > 0.35:
            y[3] = -np.inf


@pytest.mark.parametrize("count", [2, 4, 30])
def test_large_is_not_infinite(count):
    with System() as system:
        system.add("large", Large())
        record = [f"large.y{i}" for i in range(count)]
        if count < 4:
            assert system.run(1, record=record).time[-1] == 1
            return
        with pytest.raises(ComponentError, match=r"'large': y3 is -inf at t = 0\.5 s"):
            system.run(1, record=record)


def test_a_recorded_parameter_that_is_not_finite(awkward_fmus):
    with System() as system:
        fmu = plant(system, awkward_fmus[2])
        fmu.values["value"] = np.nan
        assert system.run(0.5).time[-1] == 0.5
        with pytest.raises(ComponentError, match="'plant': value is nan"):
            system.run(0.5, record=["plant.value"])
        assert np.isnan(
            system.run(0.5, record=["plant.value"], execution=Execution(allow_nan=True))["plant.value"]
        ).all()


def test_unconnected_inputs_still_warn(awkward_fmus):
    with System() as system:
        plant(system, awkward_fmus[2])
        with pytest.warns(UnconnectedInputsWarning, match=r"plant\.u"):
            system.run(0.1)
