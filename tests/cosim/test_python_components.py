"""Components written in Python.

Each run has them as new, and what a class forgets or mistakes is said in a sentence.
"""

from __future__ import annotations

import socket
import threading
from functools import partial
from typing import Any, ClassVar

import numpy as np
import pytest
from probes import Integrator

from cosim import ComponentError, CosimError, PythonComponent, System, SystemState, WiringError


class Pid(PythonComponent):
    """All of its state is set in `__init__`, in every kind of attribute."""

    inputs = ("y",)
    outputs = ("force",)
    parameters: ClassVar = {"kp": 2.0}
    feedthrough: ClassVar = {"force": ()}

    def __init__(self) -> None:
        super().__init__()
        self.integral, self.buffer, self.seen = 0.0, np.zeros(3), [[0.0]]
        self.last = self.buffer[:1]  # a view
        self.random = np.random.default_rng(1)
        self.act = self._act

    def step(self, t: float, h: float, u: Any, y: Any) -> None:
        self.act(t, h, u, y)

    def _act(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        self.late = getattr(self, "late", 0.0) + h
        self.integral += h * (1.0 - u[0])
        self.buffer[0] += self.integral
        self.seen[0].append(self.integral)
        y[0] = (
            self.kp * self.integral
            + self.last[0]
            + self.seen[0][0]
            + len(self.seen[0])
            + self.late
            + self.random.normal()
        )


def loop(pid: Any) -> System:
    system = System()
    system.add("pid", pid, step="10 ms")
    system.add("plant", Integrator(), step="10 ms")
    system.connect("pid.force", "plant.u")
    system.connect("plant.y", "pid.y")
    return system


def result(system: System, **options: Any) -> bytes:
    return bytes(system.run(0.2, record=["pid.force", "plant.y"], **options).data.tobytes())


@pytest.mark.parametrize("given", [Pid, Pid(), partial(Pid)], ids=["class", "object", "factory"])
def test_every_run_is_like_the_first(given: Any) -> None:
    expected = result(loop(Pid()))
    with loop(given) as system:
        for _ in range(3):
            assert result(system) == expected
        system["pid"].set(kp=3.0)
        assert result(system) != expected
        system["pid"].set(kp=2.0)
        with pytest.raises(CosimError):  # a run that ends halfway
            system.run(0.1, record=["nothing.*"])
        with system.initialize() as simulation:
            simulation.advance(0.05)
        assert result(system) == expected


def test_the_object_that_ran_is_there_and_the_one_that_was_added_is_as_it_was() -> None:
    pid = Pid()
    with loop(pid) as system:
        system.run(0.1)
        ran = system["pid"].implementation
        assert len(ran.seen[0]) == 11
        assert ran.act.__self__ is ran
        assert (pid.integral, pid.seen) == (0.0, [[0.0]])
        pid.integral = 1.0  # what is changed there counts in the next run
        system.run(0.01)
        assert system["pid"].implementation.integral > 1.0


def test_saved_states_continue_in_a_new_copy() -> None:
    class Plain(Pid):
        def __init__(self) -> None:
            super().__init__()
            del self.random, self.act, self.last

        def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
            self.late = getattr(self, "late", 0.0) + h
            self.seen[0].append(u[0])
            y[0] = self.late + len(self.seen[0])

    with loop(Plain()) as system:
        with system.initialize(record=["pid.force"]) as simulation:
            begun = simulation.save()
            simulation.advance(0.1)
            state = simulation.save()
            simulation.advance(0.2)
            whole = simulation.recording["pid.force"].copy()
            simulation.restore(begun)  # attributes that came later are gone again
            assert not hasattr(system["pid"].implementation, "late")
            simulation.advance(0.2)
            np.testing.assert_array_equal(simulation.recording["pid.force"], whole)
        for saved in (state, SystemState.from_bytes(state.to_bytes())):
            with system.initialize(state=saved, record=["pid.force"]) as simulation:
                simulation.advance(0.2)
                np.testing.assert_array_equal(simulation.recording["pid.force"], whole[10:])


class OnBus(PythonComponent):
    outputs = ("y",)

    def __init__(self, bus: dict[str, float], name: str, other: str) -> None:
        super().__init__()
        self.bus, self.name, self.other = bus, name, other

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        self.bus[self.name] = t + h
        y[0] = self.bus.get(self.other, -1.0)


def test_what_components_share_their_copies_share() -> None:
    bus: dict[str, float] = {}
    with System() as system:
        system.add("a", OnBus(bus, "a", "b"), step="0.1 s")
        system.add("b", OnBus(bus, "b", "a"), step="0.1 s")
        runs = [system.run(0.5, record=["a.y", "b.y"]).data for _ in range(2)]
    np.testing.assert_array_equal(runs[0], runs[1])
    assert runs[0].max() == 0.5
    assert bus == {}


class Linked(PythonComponent):
    outputs = ("y",)

    def __init__(self) -> None:
        super().__init__()
        self.link = socket.socket()
        self.count = 0

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        self.count += 1
        y[0] = self.count

    def close(self) -> None:
        self.link.close()


class Begun(Linked):
    def begin(self) -> None:
        self.count = 0


def test_what_cannot_be_copied_needs_begin_or_a_factory(raises) -> None:
    with System() as system:
        system.add("link", Linked(), step="0.1 s")
        with raises(CosimError):
            system.run(0.1)
    for given in (Linked, Begun()):
        with System() as system:
            system.add("link", given, step="0.1 s")
            assert [system.run(0.5, record=["link.y"])["link.y"][-1] for _ in range(2)] == [5.0, 5.0]
            with system.initialize() as simulation, raises(CosimError):
                simulation.save()
        assert system["link"].implementation.link.fileno() == -1


def test_threads_are_named_too() -> None:
    pid = Pid()
    pid.worker = threading.Thread()  # type: ignore[attr-defined]
    with loop(pid) as system, pytest.raises(CosimError, match="attribute worker"):
        system.run(0.1)


def test_what_a_run_changes_in_the_class_is_refused_in_the_next(raises) -> None:
    class Shared(PythonComponent):
        outputs = ("y",)
        memory: ClassVar[list[float]] = []

        def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
            self.memory.append(t)
            y[0] = len(self.memory)

    with System() as system:
        system.add("a", Shared(), step="0.1 s")
        system.run(0.5)
    with System() as system:  # another object of the class
        system.add("a", Shared(), step="0.1 s")
        with raises(CosimError):
            system.run(0.5)


class Forgetful(PythonComponent):
    outputs = ("y",)

    def __init__(self) -> None:
        pass


class NeedsGain(Pid):
    def __init__(self, gain: float) -> None:
        super().__init__()
        self.gain = gain


@pytest.mark.parametrize("given", [Forgetful(), Forgetful, NeedsGain, lambda: 5, System])
def test_what_is_no_component_is_said(given: Any, raises) -> None:
    with System() as system, raises(WiringError):
        system.add("pid", given, step="10 ms")


def test_a_factory_must_make_the_same_variables(raises) -> None:
    made = iter([Pid(), Integrator()])
    with System() as system:
        system.add("pid", lambda: next(made), step="10 ms")
        system.allow_unconnected = True
        system.run(0.1)
        with raises(CosimError):
            system.allow_unconnected = True
            system.run(0.1)


@pytest.mark.parametrize(
    "declared",
    [
        {"outputs": "force [N]"},
        {"inputs": "u"},
        {"inputs": ("u",), "outputs": ("y",), "feedthrough": {"y": "u"}},
        {"inputs": ("u",), "outputs": ("y",), "feedthrough": {"y": ("v",)}},
        {"inputs": ("u",), "outputs": ("y",), "feedthrough": {"z": ("u",)}},
        {"inputs": ("u [m]",), "outputs": ("u [N]",)},
        {"parameters": {"step": 1.0}},
    ],
)
def test_declarations_that_are_none(declared: dict[str, Any], raises) -> None:
    with raises(WiringError):
        type("Odd", (PythonComponent,), declared)()


@pytest.mark.parametrize("where", ["step", "start"])
def test_outputs_that_are_returned_are_refused(where: str, raises) -> None:
    def wrong(*_: Any) -> float:
        return 5.0

    def right(*arguments: Any) -> Any:
        arguments[-1][0] = 1.0
        return arguments[-1]  # the buffer itself may be returned

    other = "start" if where == "step" else "step"
    made = type(
        "Returning",
        (PythonComponent,),
        {"outputs": ("y",), where: lambda self, *a: wrong(*a), other: lambda self, *a: right(*a)},
    )
    with System() as system:
        system.add("a", made, step="0.1 s")
        with raises(ComponentError, match=f"{where}"):
            system.run(0.5)
