"""Algebraic loops through Model Exchange FMUs whose discrete states follow the values of the loop."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from foreign import relay
from oracles.adaptive_rule import by_the_adaptive_rule
from oracles.exchange_rule import by_the_rule
from same import assert_same, bits

from cosim import ComponentError, CosimError, Execution, System

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")

VERSIONS = pytest.mark.parametrize("version", [2, 3])
ISOLATED = pytest.mark.parametrize("isolated", [False, True], ids=["in process", "isolated"])
STEP = "0.125 s"


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("relays")


def ring(path, *parameters, isolated=False):
    """Relays `m0`, `m1`, ..., each of which reads y of the one before; `a` of the first one is the time."""
    system = System()
    system.add("ramp", path, step=STEP, parameters={"gain": 0.0, "on": -1.0, "off": -1.0})  # x is the time
    for i, given in enumerate(parameters):
        system.add(f"m{i}", path, step=STEP, isolated=isolated, parameters=given)
    for i in range(len(parameters)):
        system.connect(f"m{i}.y", f"m{(i + 1) % len(parameters)}.u")
    system.connect("ramp.x", "m0.a")
    return system


def one(path, *, isolated=False, **parameters):
    """Its y is t + y/2, or t + y/2 + offset, so y = t and t + 2 offset; it opens where 2 t >= 0.95, so at 0.5 s."""
    return ring(path, {"on": 0.95, "off": 0.95, **parameters}, isolated=isolated)


def two(path, *, isolated=False):
    """The second relay opens at 0.5 s, and so does the first one, since the second is open."""
    return ring(path, {"on": 1.9, "off": 1.9}, {"on": 0.3, "off": 0.3}, isolated=isolated)


@ISOLATED
@VERSIONS
def test_a_relay_opens_where_the_loop_reaches_its_limit(folder, version, isolated):
    with one(relay.build(version, folder), isolated=isolated) as system:
        found = system.run(1.0, record=["m0.y", "m0.open"])
    is_open = found.time >= 0.5
    assert found["m0.open"].tolist() == is_open.tolist()
    assert np.allclose(found["m0.y"], found.time + 2.0 * is_open, rtol=1e-8)


@ISOLATED
@VERSIONS
def test_relays_that_open_each_other_do_so_at_once(folder, version, isolated):
    with two(relay.build(version, folder), isolated=isolated) as system:
        found = system.run(1.0, record=["m*.y", "m*.open"])
    is_open = found.time >= 0.5
    for name in ("m0.open", "m1.open"):
        assert found[name].tolist() == is_open.tolist()
    sums = (found.time + 1.5 * is_open) * 4.0 / 3.0  # u + a of the first one
    assert np.allclose(found["m0.y"], sums / 2.0 + is_open, rtol=1e-8)
    assert np.allclose(found["m1.y"], sums / 4.0 + 1.5 * is_open, rtol=1e-8)


@VERSIONS
def test_the_first_event_iteration_is_a_part_of_the_loop(folder, version):
    with one(relay.build(version, folder), on=-1.0, off=-1.0) as system, system.initialize(record=["m0.*"]) as begun:
        assert begun["m0.open"] == 1.0
        assert abs(begun["m0.y"] - 2.0) < 1e-8


@pytest.mark.parametrize("rule", [{"delay": True}, {"extrapolate": True}])
@pytest.mark.parametrize("start", [0, 100])
def test_what_follows_begins_with_the_values_after_that(folder, rule, start):
    """Not with those before, nor with a line through both."""
    with one(relay.build(3, folder), on=-1.0, off=-1.0) as system:
        system.add("reader", relay.build(3, folder), step=STEP, parameters={"gain": 1.0, "on": 1e9, "off": 1e9})
        system.connect("m0.y", "reader.u", **rule)
        found = system.run(start + 0.25, record=["m0.y", "reader.y"], start_time=start)
    assert abs(found["m0.y"][0] - 2.0) < 1e-8
    assert abs(found["reader.y"][1] - 2.0) < 1e-8


@pytest.mark.parametrize("made", [one, two])
@ISOLATED
@VERSIONS
def test_relays_are_those_of_the_rule_bit_for_bit(folder, version, isolated, made):
    names = ["m0.y", "m0.open", "m0.updates", "m0.x"]
    with made(relay.build(version, folder), isolated=isolated) as system:
        assert_same(system.run(1.0, record=names), by_the_rule(system, 1.0, names))


@pytest.mark.parametrize("make", [one, two])
@VERSIONS
def test_a_run_with_a_tolerance_is_that_of_its_rule(folder, version, make):
    names = ["m0.y", "m0.open", "m0.x"]
    with make(relay.build(version, folder)) as system:
        expected, accepted, rejected = by_the_adaptive_rule(system, Fraction(1), names, 1e-4)
        found = system.run(1.0, record=names, tolerance=1e-4)
    assert_same(found, expected)
    assert (found.steps.accepted, found.steps.rejected) == (accepted, rejected)


@VERSIONS
def test_a_relay_that_closes_where_it_opens_ends_the_run_by_name(folder, version):
    text = r"loop through 'm0' has no solution at t = 0\.5 s: discrete states of its components change again"
    with one(relay.build(version, folder), offset=-4.0) as system, pytest.raises(ComponentError, match=text) as ended:
        system.run(1.0, record=["m0.y"])
    assert ended.value.recording.time[-1] == 0.375


@ISOLATED
@VERSIONS
def test_a_relay_that_asks_for_the_end_once_ends_the_run(folder, version, isolated):
    """In the update that follows the loop, which is not repeated."""
    with one(relay.build(version, folder), isolated=isolated, ends=1.0) as system:
        found = system.run(1.0, record=["m0.open"])
    assert found.time[-1] == 0.5
    assert found["m0.open"].tolist() == [0, 0, 0, 0, 1]


@ISOLATED
@VERSIONS
def test_a_relay_that_discards_an_update_fails_as_outside_of_a_loop(folder, version, isolated):
    """Once: its step, which updates it again, would not fail."""
    path, function = relay.build(version, folder), {2: "fmi2NewDiscreteStates", 3: "fmi3UpdateDiscreteStates"}[version]
    looped = one(path, isolated=isolated, ends=2.0)
    alone = one(path, isolated=isolated, ends=2.0)
    alone.disconnect("m0.u")
    for system in (looped, alone):
        with system, pytest.raises(ComponentError, match=f"'m0': {function} returned Discard"):
            system.run(2.0, record=["m0.open"])


@VERSIONS
def test_so_it_does_in_an_exported_system(folder, version):
    with one(relay.build(version, folder), ends=2.0) as system:
        path = system.export_fmu(folder / f"Discarding{version}.fmu", fmi=version)
    with System() as system:
        system.add("s", path, step=STEP)
        with pytest.raises(ComponentError, match=r"'m0': DoStep returned Discard at time 0\.5 s"):
            system.run(2.0)


@VERSIONS
def test_an_exported_system_does_the_same(folder, version):
    names = ["m0.y", "m1.y", "m0.open", "m1.open"]
    with two(relay.build(version, folder)) as system:
        expected = system.run(1.0, record=names)
        path = system.export_fmu(folder / f"Two{version}.fmu", fmi=version)
    with System() as system:
        system.add("s", path, step=STEP)
        found = system.run(1.0, record=[f"s.{n}" for n in names])
    for name in names:
        assert bits(found[f"s.{name}"]).tolist() == bits(expected[name]).tolist()


def test_an_exported_system_without_a_solution_says_so(folder):
    with one(relay.build(3, folder), offset=-4.0) as system:
        path = system.export_fmu(folder / "None.fmu")
    with System() as system:
        system.add("s", path, step=STEP)
        with pytest.raises(CosimError, match=r"time 0\.5 s: discrete states of its components change again"):
            system.run(1.0)


@VERSIONS
def test_a_run_with_a_tolerance_meets_it_with_relays(folder, version):
    with one(relay.build(version, folder)) as system:
        found = system.run(1.0, record=["m0.y", "m0.open"], tolerance=1e-4)
    is_open = found["m0.open"]
    assert is_open.tolist() == sorted(is_open)
    assert np.allclose(found["m0.y"], found.time + 2.0 * is_open, rtol=1e-4)


@VERSIONS
def test_residuals_of_a_loop_are_no_errors_of_steps(folder, version):
    """The values are straight lines but for one jump: the steps are long before and after it."""
    with two(relay.build(version, folder)) as system:
        found = system.run(1.0, record=["m0.y"], execution=Execution(tolerance=1e-4, loop_tolerance=1e-3))
    is_open = found.time >= 0.5
    assert np.allclose(found["m0.y"], (found.time + 1.5 * is_open) * 2.0 / 3.0 + is_open, rtol=1e-4)
    assert found.steps.accepted < 100


@VERSIONS
def test_initial_values_of_a_loop_through_a_sampled_component_are_solved(folder, version):
    """Those of y = 2 u + 1 and, once per sample, y = -3 u + 1 would grow if they were passed on."""
    names = ["plant.y", "controller.y"]
    with System() as system:
        shifts = {"plant": (2.0, 0.5), "controller": (-3.0, -1.0 / 3.0)}
        for name, (gain, shift) in shifts.items():
            kind = "discrete" if name == "controller" else "continuous"
            given = {"gain": gain, "on": 1e9}
            system.add(name, relay.build(version, folder), step=STEP, kind=kind, parameters=given, start={"a": shift})
        system.connect("plant.y", "controller.u")
        system.connect("controller.y", "plant.u")
        with system.initialize(record=names) as begun:
            expected = [begun[n] for n in names]
        system.components["plant"].set({"gain": 0.1})  # by which initial values settle
        path = system.export_fmu(folder / f"Sampled{version}.fmu", fmi=version)
    assert np.allclose(expected, [3.0 / 7.0, -2.0 / 7.0], rtol=1e-8)
    with System(allow_unconnected=True) as system:
        system.add("s", path, step=STEP, parameters={"plant.gain": 2.0})
        with system.initialize(record=[f"s.{n}" for n in names]) as begun:
            assert [begun[f"s.{n}"] for n in names] == expected
