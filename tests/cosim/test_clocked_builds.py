"""Our sampled FMUs that are built with a clock (`build-fmus --clocks`).

The same numbers at its ticks, and without event mode as ever.
"""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from built import OBJECTS
from components import MAKERS
from fmpy.validation import validate_fmu

from build_fmus.compile import resolve_platforms
from build_fmus.package import build_fmu
from cosim import PythonComponent, System, SystemState
from cosim.check import check
from cosim.core.description import Clock
from cosim.core.errors import CallFailed
from cosim.fmu.component import FmuComponent
from cosim.fmu.file import FmuFile

NAMES = ("ProbeDiscrete", "ProbeQpDaqp")


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[bool, Path]]:
    """By name, without clocks and with."""
    folder = tmp_path_factory.mktemp("clocked")
    made: dict[str, dict[bool, Path]] = {}
    for name in NAMES:
        for clocks in (False, True):
            path = folder / str(clocks) / f"{name}.fmu"
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(build_fmu(MAKERS[name](), 3, resolve_platforms("host"), OBJECTS, clocks=clocks))
            made.setdefault(name, {})[clocks] = path
    return made


class Waves(PythonComponent):
    """Sines on eight outputs."""

    outputs = tuple(f"y{i}" for i in range(8))
    kind = "discrete"

    def step(self, t, h, u, y):  # noqa: ARG002
        y[:] = np.sin(7.0 * t + np.arange(8))


def recorded(path: Path, *, step: str | None = None, offset: str | int = 0) -> dict[str, np.ndarray]:
    with System() as system:
        law = system.add("law", path, step=step, offset=offset)
        system.add("waves", Waves(), step="1 ms")
        about = law.description
        for k, name in enumerate(n for n, v in about.inputs.items() if v.type == "real"):
            system.connect(f"waves.y{k % 8}", f"law.{name}", linear=(1.0, 0.0))
        system.allow_unconnected = True
        recording = system.run(0.4, record=["law.*"])  # type: ignore[arg-type]
        return {n: recording[n] for n in recording.names}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("options", [{}, {"offset": "3 ms"}, {"step": "70 ms"}], ids=str)
def test_the_same_bits_as_without(fmus: dict[str, dict[bool, Path]], name: str, options: dict[str, str]) -> None:
    plain, clocked = (recorded(fmus[name][clocks], **options) for clocks in (False, True))
    assert plain.keys() == clocked.keys()
    assert any(np.ptp(x) > 0 for x in plain.values())
    for signal in plain:
        np.testing.assert_array_equal(clocked[signal], plain[signal], err_msg=signal)


@pytest.mark.parametrize("name", NAMES)
def test_it_is_declared_and_valid(fmus: dict[str, dict[bool, Path]], name: str) -> None:
    path = fmus[name][True]
    assert validate_fmu(str(path)) == []
    about = FmuFile(path, strict=True).description
    period = about.sample_time
    assert about.event_mode
    assert [(c.name, c.kind, c.causality, c.interval, c.shift, c.fractions) for c in about.clocks] == [
        ("sample.clock", "constant", "input", period, Fraction(0), True)
    ]
    reference = about.clocks[0].reference
    for variable in about.variables.values():
        belongs = variable.causality in ("input", "output") and variable.fmi_type != "Clock"
        assert not belongs or (variable.clocks == (reference,) and variable.variability == "discrete")
    plain = FmuFile(fmus[name][False]).description
    assert not plain.event_mode
    assert plain.clocks == []
    assert isinstance(about.clocks[0], Clock)
    assert about.token != plain.token


def test_without_event_mode_it_counts_its_samples_itself(fmus: dict[str, dict[bool, Path]]) -> None:
    """As FMPy runs it by default, and as it runs where it is isolated."""
    import fmpy

    results = [
        fmpy.simulate_fmu(str(fmus["ProbeDiscrete"][clocks]), stop_time=0.3, output_interval=0.03)
        for clocks in (False, True)
    ]
    assert results[0].dtype.names == results[1].dtype.names
    for name in results[0].dtype.names:
        np.testing.assert_array_equal(results[0][name], results[1][name])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("interval", [0.03, 0.07])
def test_an_importer_need_not_tick(fmus: dict[str, dict[bool, Path]], name: str, interval: float) -> None:
    """FMPy with event mode: it sets inputs in step mode and ticks no clock."""
    import fmpy

    about = fmpy.read_model_description(str(fmus[name][True]))
    inputs = [v for v in about.modelVariables if v.causality == "input" and v.type == "Float64"]
    driven = np.zeros(
        4, dtype=[("time", float), *((v.name, float, tuple(d.start for d in v.dimensions)) for v in inputs)]
    )
    driven["time"] = 0.0, 0.05, 0.12, 0.2
    for k, v in enumerate(inputs):
        driven[v.name] = np.random.default_rng(k).normal(size=driven[v.name].shape)
    plain, with_events = (
        fmpy.simulate_fmu(
            str(fmus[name][True]), use_event_mode=events, stop_time=0.28, output_interval=interval, input=driven
        )
        for events in (False, True)
    )
    assert any(np.ptp(plain[n]) > 0 for n in plain.dtype.names[1:])
    for row in plain:
        assert with_events[with_events["time"] == row["time"]][-1] == row


def test_check_has_nothing_to_say(fmus: dict[str, dict[bool, Path]]) -> None:
    report = check(fmus["ProbeDiscrete"][True])
    assert [str(f) for _, f in report.findings() if f.severity != "note"] == []


def test_saved_states_continue(fmus: dict[str, dict[bool, Path]]) -> None:
    with System() as system:
        system.add("law", fmus["ProbeQpDaqp"][True])
        system.allow_unconnected = True
        with system.initialize(record=["law.*"]) as simulation:
            simulation.advance(0.1)
            state = simulation.save()
            simulation.advance(0.2)
            first = simulation.recording.data.copy()
            simulation.restore(state)
            simulation.advance(0.2)
            np.testing.assert_array_equal(simulation.recording.data, first)
            data = state.to_bytes()
        whole = system.run(0.2, record=["law.*"])
        found = system.run(0.2, state=SystemState.from_bytes(data), record=["law.*"])
        np.testing.assert_array_equal(found.data, whole.data[-len(found.time) :])
        assert found.time[0] == 0.1


def started(fmu: FmuFile) -> FmuComponent:
    """An instance in step mode, before its first tick."""
    component = FmuComponent(fmu)
    component.instantiate("law")
    component.enter_initialization(0.0, None)
    component.bind([], [], np.zeros(0), np.zeros(0))
    component.exit_initialization()
    return component


def tick(component: FmuComponent, reference: int) -> None:
    new = component._ffi.new
    component._must("SetClock", new("VR[]", [reference]), 1, new("bool[]", [True]))


def test_what_an_importer_does_wrong_is_said(fmus: dict[str, dict[bool, Path]], raises) -> None:
    """A tick at another time, an unknown clock, a sample that is not taken."""
    fmu = FmuFile(fmus["ProbeDiscrete"][True])
    period, clock = float(fmu.description.sample_time or 0), fmu.description.clocks[0].reference

    def twice(c: FmuComponent) -> None:
        c._must("EnterEventMode")
        tick(c, clock)
        flags = c._ffi.new("bool[5]")
        c._must("UpdateDiscreteStates", *(flags + k for k in range(5)), c._ffi.new("double*"))
        tick(c, clock)

    def untaken(c: FmuComponent) -> None:
        c._must("EnterEventMode")
        tick(c, clock)
        c._must("EnterStepMode")

    def unknown(c: FmuComponent) -> None:
        c._must("EnterEventMode")
        tick(c, clock + 1)

    for act, bit in (
        (twice, f"{period:g} s"),
        (untaken, "fmi3EnterStepMode"),
        (unknown, f"{clock + 1}"),
        (lambda c: tick(c, clock), "fmi3SetClock"),
    ):
        component = started(fmu)
        with raises(CallFailed, match=bit):
            act(component)
        component.close()
