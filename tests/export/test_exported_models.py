"""Systems with Model Exchange components as one FMU and as WebAssembly: the numbers of the system, bit by bit."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import fmpy
import numpy as np
import pytest
from built import BuiltFmus
from foreign import exchanged
from same import bits
from test_web_module import code_of, outputs
from web_host import WebHost

from cosim import ComponentError, ModelExchange, Record, System
from cosim.export.web.module import compile_module

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")
SHOWN = ["ball.x", "ball.last", "swing.x", "swing.count", "lag.x", "car.body.z"]
ASKS_TO_END, NO_SOLUTION = 8.0, 11.0


@pytest.fixture(scope="module", params=[2, 3])
def system(built_fmus: BuiltFmus, tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest):
    """Models that are carried, one by the implicit method, and an FMU of this project, whose sources are linked."""
    version = request.param
    fmu = exchanged.build(version, tmp_path_factory.mktemp("exchanged"))
    with System() as made:
        made.add("ball", fmu, step="10 ms", parameters={"kind": 1}, start={"x": 1.0})
        implicit = ModelExchange(solver="implicit")
        parameters = {"kind": 13, "k": 40.0}
        made.add("swing", fmu, step="5 ms", parameters=parameters, start={"x": 1.0}, interface=implicit)
        made.add("lag", fmu, step="2 ms", parameters={"k": 3.0}, start={"x": 1.0})
        car = made.add("car", built_fmus.path("QuarterCarHmmwv", version), step="1 ms", interface="me")
        car.set({"force": 100.0})
        made.connect("ball.x", "lag.u")
        yield made


@pytest.fixture(scope="module", params=[2, 3])
def exported(system: System, tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    path = tmp_path_factory.mktemp("exported") / "System.fmu"
    return system.export_fmu(path, outputs=SHOWN, fmi=request.param)


@pytest.fixture
def alone(exported: Path) -> Iterator[System]:
    """The exported FMU in a system of its own."""
    with System() as made:
        made.add("s", exported, step="10 ms")
        yield made


RECORD = Record([f"s.{n}" for n in SHOWN], "10 ms")


def test_an_exported_fmu_has_the_bits_of_the_system(system, exported, alone):
    expected = system.run(1, record=Record(SHOWN, "10 ms"))
    np.testing.assert_array_equal(bits(alone.run(1, record=RECORD).data), bits(expected.data))
    theirs = fmpy.simulate_fmu(str(exported), stop_time=1.0, output_interval=0.01, output=SHOWN)
    np.testing.assert_array_equal(bits([list(row)[1:] for row in theirs]), bits(expected.data))


def test_saved_states_of_exported_fmus_have_their_integrators(alone):
    simulation = alone.initialize(record=RECORD)
    simulation.advance("0.455")
    state = simulation.save()
    simulation.advance(1)
    whole = simulation.recording.data
    simulation.restore(state)
    simulation.advance(1)
    np.testing.assert_array_equal(bits(simulation.recording.data), bits(whole))


def test_failures_in_exported_fmus_are_explained(alone):
    name = "ball.kind"
    alone["s"].set({name: NO_SOLUTION})
    with pytest.raises(ComponentError, match="component 'ball': its integration failed at 1 s: the error of state n"):
        alone.run(2)
    alone["s"].set({name: ASKS_TO_END})
    assert alone.run(1).time[-1] < 0.6


def test_a_web_module_has_the_bits_of_the_system(built_fmus):
    with System() as system:
        system.add("road", built_fmus.path("RoadBenchRandom", 3))
        system.add("car", built_fmus.path("QuarterCarBench", 3), step="1 ms", interface="me")
        system.connect_matching("road", "car")
        code = code_of("s", system, {})
        shown = outputs(code)
        host = WebHost(compile_module([code], []).content, [(r, t) for r, t, _ in shown], 0)
        assert host.start(0.01) == 0, host.message
        simulation = system.initialize(record=Record([n for _, _, n in shown], "10 ms"))
        rows, expected = host.run(50), []
        for k in range(1, 51):
            simulation.advance(f"{k}/100")
            expected.append([float(simulation[n]) for _, _, n in shown])
        np.testing.assert_array_equal(bits(rows), bits(expected))
