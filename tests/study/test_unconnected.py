"""Inputs that nothing drives, in the runs of an experiment."""

from __future__ import annotations

import warnings
from dataclasses import replace

import pytest

from cosim import PythonComponent, System, UnconnectedInputsWarning
from cosim.study import Case, Experiment, FmuSet, Measures, Run, Runner, RunOptions, Wiring


class Pushed(PythonComponent):
    inputs = ("force [N]",)
    outputs = ("z [m]",)

    def step(self, t, h, u, y): ...


def wire(fmus: FmuSet, case: Case) -> System:  # noqa: ARG001
    system = System()
    system.add("mass", Pushed(), step="10 ms")
    return system


def wire_as_meant(fmus: FmuSet, case: Case) -> System:
    system = wire(fmus, case)
    system.allow_unconnected = True
    return system


def measure(run: Run) -> dict[str, float]:
    return {"last": float(run.recording["mass.z"][-1])}


FREE = Experiment("free", Case, Wiring(wire), Measures(measure), RunOptions(0.1, record=["mass.z"]))


def test_they_are_named_unless_the_system_allows_them(tmp_path) -> None:
    with Runner(FREE, FmuSet(tmp_path)) as runner, pytest.warns(UnconnectedInputsWarning, match=r"mass\.force"):
        runner.run(Case())
    with Runner(replace(FREE, wiring=Wiring(wire_as_meant)), FmuSet(tmp_path)) as runner, warnings.catch_warnings():
        warnings.simplefilter("error")
        assert runner.metrics(Case()) == {"last": 0.0}
