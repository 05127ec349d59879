"""Random systems as one FMU: in this master and in FMPy they show what the system itself shows, bit by bit."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from random_systems import systems, wired
from same import bits

from cosim import LoopError, Record, System

pytestmark = pytest.mark.filterwarnings(
    "ignore::cosim.UnconnectedInputsWarning",
    "ignore::cosim.AlgebraicLoopWarning",
    "ignore:initial values do not settle",
)
END = 0.06


def shown(system: System, names: list[str], times: list[Fraction]) -> np.ndarray:
    """What `advance` to each of these times shows."""
    with system.initialize(record=names) as simulation:
        rows = []
        for t in times:
            simulation.advance(t)
            rows.append([simulation[n] for n in names])
        return np.array(rows)


def stepped(fmu: Path, names: list[str], times: list[Fraction]) -> np.ndarray:
    """What FMPy reads after a doStep from each of these times to the next."""
    about = fmpy.read_model_description(fmu)
    references = {v.name: v for v in about.modelVariables}
    folder = fmpy.extract(fmu)
    instance = fmpy.instantiate_fmu(folder, about, "CoSimulation")
    if about.fmiVersion == "2.0":
        instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
        kinds = {"Real": instance.getReal, "Integer": instance.getInteger, "Boolean": instance.getBoolean}
    else:
        instance.enterInitializationMode(startTime=0.0)
        kinds = {"Float64": instance.getFloat64, "Int32": instance.getInt32, "Boolean": instance.getBoolean}
    instance.exitInitializationMode()
    rows, now = [], Fraction(0)
    for t in times:
        if t > now:
            instance.doStep(currentCommunicationPoint=float(now), communicationStepSize=float(t - now))
        now = t
        rows.append([float(kinds[references[n].type]([references[n].valueReference])[0]) for n in names])
    instance.terminate()
    instance.freeInstance()
    return np.array(rows)


# Shrinking would build hundreds of FMUs more.
@settings(
    max_examples=25,
    deadline=None,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(plan=systems(python=False), fmi=st.sampled_from([2, 3]), every=st.integers(1, 7))
def test_one_fmu_shows_what_the_system_shows(plan: dict[str, Any], fmi: int, every: int, follower, tmp_path_factory):
    try:
        with wired(plan, follower) as system:
            tick = system.schedule().tick
            names = [f"{m}.{v}" for m in system.components for v in ("y", "count", "off")]
            fmu = system.export_fmu(tmp_path_factory.mktemp("one") / "One.fmu", fmi=fmi, outputs=names)
            step = every * max(tick, Fraction(int(END / 60 / tick) * tick) or tick)
            times = [k * step for k in range(int(END / step) + 1)]
            expected = shown(system, names, times)
    except LoopError:
        return  # refused before anything is exported
    np.testing.assert_array_equal(bits(stepped(fmu, names, times)), bits(expected))
    with System() as outer:
        outer.add("one", fmu, step=step, kind="continuous")  # so that a row shows what the step before it has reached
        whole = outer.run(times[-1], record=Record([f"one.{n}" for n in names], step))
    np.testing.assert_array_equal(bits(whole.data), bits(expected))
