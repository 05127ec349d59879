"""What the experiments' environments reward, on steps made by hand, and the ranges and ends that they have."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import radians
from typing import Any, cast

import numpy as np
import pytest
from built import FMUS, BuiltFmus

from cosim.experiments import environments
from cosim.experiments.bench import environment as bench
from cosim.experiments.hmmwv import environment as hmmwv
from cosim.experiments.trench import environment as trench
from cosim.gym import Step, SystemEnv


class MadeUp:
    """A step with the samples of each variable."""

    def __init__(
        self, samples: Mapping[str, Sequence[float]], action: Mapping[str, float] = {}, duration: float = 0.5
    ) -> None:
        self._samples, self.action, self.duration = samples, action, duration

    def over(self, name: str) -> np.ndarray[Any, Any]:
        return np.array(self._samples[name])


def step(samples: Mapping[str, Sequence[float]], action: Mapping[str, float] = {}, duration: float = 0.5) -> Step:
    return cast(Step, MadeUp(samples, action, duration))


def trench_step(**changed: Sequence[float]) -> Step:
    """Nothing happens, but for what is given; `__` stands for a dot."""
    names = [
        "body.az",
        "body.ax",
        "body.pitch",
        "belly.force",
        *(f"hub.a{i}{side}.fx" for i in (1, 2, 3) for side in "lr"),
    ]
    still = {f"car.{n}": [0.0] * 4 for n in names}
    return step(still | {f"car.{n.replace('__', '.')}": v for n, v in changed.items()})


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({}, 0.0),
        ({"body__az": [150.0, -75.0, 0.0, 0.0]}, 0.125 * 1.25 / 4),  # Kale, Tables 5.3 and 5.10: 150 m/s2, 12.5 %
        ({"body__ax": [50.0, -50.0, 50.0, 50.0]}, 0.175 / 4),
        ({"body__pitch": [radians(-7.5)] * 4}, 0.175 / 4),
        ({"hub__a1l__fx": [-112.5e3] * 4, "hub__a1r__fx": [45e3] * 4}, 0.1 / 4),  # the larger of both sides
        ({"hub__a2l__fx": [45e3] * 4, "hub__a2r__fx": [-112.5e3] * 4}, 0.075 / 4),
        ({"hub__a3r__fx": [225e3, 0.0, 0.0, 0.0]}, 0.075 / 4),
        ({"belly__force": [0.0, 0.0, 1e3, 0.0]}, 5.0 / 4),  # one sample of four on the ground
    ],
)
def test_limits_of_the_trench(changed: dict[str, Sequence[float]], expected: float) -> None:
    assert trench.cost(trench_step(**changed)) == pytest.approx(-0.5 * expected, rel=1e-12)  # of half a second


def test_index_of_the_bench() -> None:
    """Its LQR's weights of the paper: each state on its own, then the force."""
    still = {f"plant.{n}": [0.0] * 3 for n in bench.STATES}
    for name, weight in zip(bench.STATES, bench.WEIGHTS, strict=True):
        found = bench.cost(step({**still, f"plant.{name}": [0.1, -0.3, 0.0]}, {"plant.force": 0.0}))
        assert found == pytest.approx(-weight * 0.1 / 3, rel=1e-12)
    assert bench.cost(step(still, {"plant.force": 3.0})) == pytest.approx(-9.0 * bench.FORCE_WEIGHT, rel=1e-12)


def test_power_and_travel_of_the_hmmwv() -> None:
    still = {f"car.suspension.{k}.deflection": [0.0, 0.0] for k in ("fl", "fr", "rl", "rr")}
    power = {"comfort.absorbed_power": [4.0, 8.0]}
    assert hmmwv.cost(step(still | power)) == pytest.approx(-6.0, rel=1e-12)
    travel = hmmwv.WEIGHTS.max_travel
    beyond = {
        "car.suspension.rl.deflection": [-1.02 * travel, 0.0],
        "car.suspension.fr.deflection": [1.01 * travel, 0.5 * travel],
    }
    assert hmmwv.cost(step(still | power | beyond)) == pytest.approx(-6.0 - 2.0 / 2, rel=1e-12)


@pytest.fixture
def made(built_fmus: BuiltFmus, request: pytest.FixtureRequest) -> Iterator[SystemEnv]:  # noqa: ARG001
    env = environments.make(request.param.__name__, FMUS)
    yield env
    env.close()


@pytest.mark.parametrize(
    ("made", "length", "force", "failed", "ends"),
    [
        (
            bench,
            5.0,
            8.0,
            -1e3,
            [("plant.suspension.deflection", ">", 0.15), ("plant.suspension.deflection", "<", -0.15)],
        ),
        (hmmwv, 4.5, 8e3, -1e4, []),
        (trench, 17.9, 150e3, -1e3, [("car.x", ">=", 10.6)]),  # 1.25 times 10.6 m at 3 km/h, and 2 s
    ],
    indirect=["made"],
)
def test_episodes(
    made: SystemEnv, length: float, force: float, failed: float, ends: list[tuple[str, str, float]]
) -> None:
    settings = made._settings
    assert float(settings["length"]) == pytest.approx(length, abs=0.05)
    assert set(settings["actions"].values()) == {(-force, force)}
    assert settings["failure_reward"] == failed
    found = [(s.name, s.relation, s.value) for s in settings["terminated"]]
    assert found == [(name, relation, pytest.approx(value, rel=1e-9)) for name, relation, value in ends]


class End:
    """Random numbers at one end of their range."""

    def __init__(self, i: int) -> None:
        self._i = i

    def uniform(self, *ends: float) -> float:
        return ends[self._i]


def test_where_episodes_begin() -> None:
    low, high = (cast(np.random.Generator, End(i)) for i in (0, 1))
    assert trench.trench(low) == {"car.trench.length": 0.8, "car.target.speed": pytest.approx(3 / 3.6)}
    assert trench.trench(high) == {"car.trench.length": 1.6, "car.target.speed": pytest.approx(9 / 3.6)}
    assert [bench.somewhere(end) for end in (low, high)] == [{"road.offset": 0.0}, {"road.offset": 5e4}]
    assert [hmmwv.somewhere(end) for end in (low, high)] == [{"road.offset": 0.0}, {"road.offset": 600.0}]


def test_ranges_of_what_is_observed() -> None:
    """Symmetric, but for speeds; what is positive is so on both sides of a scaled observation."""
    assert {n: high for n, (_, high) in trench.OBSERVED.items() if not n.startswith("car.suspension")} == {
        "car.body.z": 0.5,
        "car.body.vz": 2.0,
        "car.body.pitch": 0.5,
        "car.body.pitch_rate": 2.0,
        "car.body.roll": 0.2,
        "car.body.roll_rate": 1.0,
        "car.speed": 5.0,
        "car.lidar.start.dx": 10.0,
        "car.lidar.finish.dx": 10.0,
        "car.lidar.start.dz": 3.0,
        "car.lidar.finish.dz": 3.0,
    }
    travel = {n: high for n, (_, high) in trench.OBSERVED.items() if n.startswith("car.suspension")}
    assert set(travel.items()) == {
        (f"car.suspension.a{i}{s}.{q}", v)
        for i in (1, 2, 3)
        for s in "lr"
        for q, v in (("deflection", 0.3), ("velocity", 5.0))
    }
    assert {n: high for n, (_, high) in bench.RANGES.items()} == {
        "suspension.deflection": 0.04,
        "body.vz": 0.5,
        "tire.deflection": 0.04,
        "wheel.vz": 1.0,
    }
    assert {n: high for n, (_, high) in {**hmmwv.RANGES, **hmmwv.BODY_RANGES}.items()} == {
        "car.suspension.{}.deflection": 0.2,
        "car.tire.{}.deflection": 0.1,
        "car.wheel.{}.vz": 5.0,
        "car.body.vz": 2.0,
        "car.body.roll_rate": 1.5,
        "car.body.pitch_rate": 1.5,
        "car.body.az": 20.0,
    }
    for name, (low, high) in {**trench.OBSERVED, **bench.RANGES, **hmmwv.RANGES, **hmmwv.BODY_RANGES}.items():
        assert low == (0.0 if name == "car.speed" else -high), name
