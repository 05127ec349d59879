"""Random systems run by the engine and by the Python master.

The results are bit-identical, whatever is wired, stopped, saved or converted.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from random_systems import systems, wired
from same import ENGINES, assert_same

from cosim import LoopError, Recording, StopWhen

pytestmark = pytest.mark.filterwarnings(
    "ignore::cosim.UnconnectedInputsWarning",
    "ignore::cosim.AlgebraicLoopWarning",
    "ignore:initial values do not settle",
)


def run(plan: dict[str, Any], follower: dict[int, Path], engine: str) -> Recording:
    """In pieces, with a state saved at one cut and gone back to at the next."""
    stop = [] if plan["stop"] is None else [StopWhen("m0.y", *plan["stop"])]
    with wired(plan, follower) as system:
        every = [
            f"{m}.{v}" for m in system.components for v in system.components[m].description.outputs if "[" not in v
        ]
        options = {"record_interval": plan["interval"], "engine": engine}
        with system.initialize(record=[*every, *(["m0.u"])], watch=["m0.y"], **options) as simulation:
            state = None
            for i, until in enumerate([*plan["cuts"], 0.12]):
                if simulation.advance(until, stop_when=stop):
                    break
                if i == plan["saved_at"]:
                    state = simulation.save()
                elif state is not None:
                    simulation.restore(state)
                    state = None
                    simulation.advance(until, stop_when=stop)
            return simulation.recording


@settings(
    max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(plan=systems())
def test_both_engines_give_the_same_bits(plan, follower):
    try:
        with wired(plan, follower) as system:
            system.schedule()
    except LoopError:
        return  # refused before anything runs
    one, other = (run(plan, follower, engine) for engine in ENGINES)
    assert_same(one, other)
    assert len(one)
