"""The 6x6 over trenches beside an independent multibody code: wheels in the trench, at its edges, the body on them."""

from functools import cache

import numpy as np
import pytest
from built import BuiltFmus
from oracles.multibody import Motion
from oracles.trench_multibody import MultibodyTrenchCar, Trench

from cosim import Record, System
from fmu_sources.vehicles import load_three_axle_trench

START, DEPTH = 3.5, 2.0  # m, of the trench: the front bumper begins at 3.25 m
SIGNALS = ("body.pitch", "body.ax", "body.az", "hub.a1.fx", "hub.a2.fx", "hub.a3.fx")
CROSSINGS = ((1.25, 9.0), (1.4, 9.0), (1.45, 6.0), (1.6, 6.0), (1.35, 5.0), (1.75, 9.0))  # m, km/h


def ours(
    fmus: BuiltFmus, length: float, speed: float, duration: float, *, on_road: bool = False
) -> dict[str, np.ndarray]:
    names = {name: name.replace(".fx", "l.fx") for name in ("x", *SIGNALS)}
    with System() as system:
        place = {"trench.length": length, "trench.start": START, "trench.depth": DEPTH}
        place["wheels.spin_on_road"] = on_road
        inputs = {f"force.a{axle}{side}": 0.0 for axle in (1, 2, 3) for side in "lr"}
        system.add(
            "car",
            fmus.path("ThreeAxleTrench", 3),
            step="1 ms",
            parameters=place,
            start={"target.speed": speed, **inputs},
        )
        r = system.run(duration, record=Record(["car.*"], "1 ms"))
        return {name: np.array(r[f"car.{own}"]) for name, own in names.items()}


@cache
def theirs(length: float, speed: float, duration: float, absolute_spin: bool) -> Motion:
    """The run of the multibody code, in which tests may have one in common."""
    trench = Trench(START, length, DEPTH)
    car = MultibodyTrenchCar(load_three_axle_trench("three_axle_trench"), trench, speed, absolute_spin=absolute_spin)
    return car.run(duration, 5e-4)


def compare(fmus: BuiltFmus, length: float, kmh: float, distance: float, *, on_road: bool = False) -> None:
    """Motion instant by instant, forces and accelerations by their root mean square and largest value."""
    speed = kmh / 3.6
    duration = round(distance / speed, 3)
    other = theirs(length, speed, duration, on_road)
    found = ours(fmus, length, speed, duration, on_road=on_road)
    times = np.arange(len(found["x"])) * 1e-3
    for name, most in (("x", 2e-3), ("body.pitch", 1e-3)):  # m, rad
        there = np.interp(times[1:], other.time, other[name])
        assert np.abs(found[name][1:] - there).max() < most, name
    for name in SIGNALS:
        assert np.std(found[name]) == pytest.approx(np.std(other[name]), rel=0.02), name
        assert np.abs(found[name]).max() == pytest.approx(np.abs(other[name]).max(), rel=0.06), name


def test_the_front_wheels_cross_as_rigid_bodies_do(built_fmus: BuiltFmus) -> None:
    compare(built_fmus, 1.3, 9.0, 4.0)


@pytest.mark.full
@pytest.mark.parametrize(("length", "kmh"), CROSSINGS)
def test_six_crossings_as_rigid_bodies_make_them(built_fmus: BuiltFmus, length: float, kmh: float) -> None:
    """Some end in the trench, with the belly on its edge."""
    compare(built_fmus, length, kmh, 9.0)


def test_spin_against_the_road(built_fmus: BuiltFmus) -> None:
    """As an option; by default the drives in the body turn the wheels against it, as in the runs above."""
    compare(built_fmus, 1.4, 9.0, 4.0, on_road=True)


def test_spin_counts_against_the_body(built_fmus: BuiltFmus) -> None:
    """The drives are in the body: with a spin that is imposed against the road the hubs feel other forces.

    The first edge is met by a pitching body, so the largest force on the front hub tells both apart.
    """
    speed, duration = 9 / 3.6, 1.6
    other = theirs(1.4, speed, duration, True)
    found = ours(built_fmus, 1.4, speed, duration)
    assert np.abs(other["hub.a1.fx"]).max() > 1.08 * np.abs(found["hub.a1.fx"]).max()
