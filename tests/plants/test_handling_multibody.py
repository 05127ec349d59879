"""Steering of the full cars beside an independent multibody code: yaw rate and roll in three manoeuvres."""

from math import radians
from pathlib import Path

import numpy as np
import pytest
from built import FMUS
from oracles.handling_multibody import HandlingCar
from oracles.multibody import MultibodyCar

from cosim import Record
from cosim.experiments.handling.runs import CARS, MANOEUVRES, Case, table, wire
from cosim.study import FmuSet
from fmu_sources.vehicles import load_full_car, load_wishbone_car

pytestmark = pytest.mark.usefixtures("built_fmus")
FILES = {"hmmwv": "hmmwv", "modified": "hmmwv_modified", "tires": "hmmwv_tires"}
COMPARED = ("step", "sine", "sine-with-dwell")
SETTLED = 0.9  # s: before the steering wheel moves, when the public car there has settled on its tires
GAIN, PEAK = 3.0, 5.0  # %


def both(case, seconds, parameters=None):
    """Yaw rate [rad/s] and roll [rad] over the same times, from `SETTLED` on: ours, theirs."""
    driven = table(MANOEUVRES[case.manoeuvre], radians(case.wheel_deg))
    speed = case.speed_kmh / 3.6

    def wheel(t):
        return float(np.interp(t, driven["time"], driven["steering.wheel"]))

    if case.car == "public":
        theirs = MultibodyCar(load_wishbone_car("hmmwv_public"), speed=speed, start=0.0, wheel=wheel).run(seconds, 2e-3)
    else:
        theirs = HandlingCar(load_full_car(FILES[case.car]), wheel, speed).run(seconds)
    with wire(FmuSet(FMUS), case) as system:
        system["car"].set(parameters or {})
        ours = system.run(seconds, record=Record(["car.body.*"], "1 ms"))
    after = theirs.time >= SETTLED
    at = theirs.time[after]
    names = ("body.yaw_rate", "body.roll")
    return (
        {n: np.interp(at, ours.time, ours[f"car.{n}"]) for n in names},
        {n: theirs[n][after] for n in names},
    )


def errors(ours, theirs):
    """Errors [%] of the last yaw rate, and of the largest yaw rate and roll."""
    gain = ours["body.yaw_rate"][-1] / theirs["body.yaw_rate"][-1]
    return [100 * (v - 1) for v in (gain, *(np.abs(ours[n]).max() / np.abs(theirs[n]).max() for n in ours))]


def printed():
    """Errors [%] that the page has, by car and manoeuvre."""
    text = (Path(__file__).parents[2] / "docs" / "reference" / "public-hmmwv.md").read_text(encoding="utf-8")
    table = text.split("<!-- steering: ")[1].split("<!-- end of steering -->")[0]
    rows = [[cell.strip(" `") for cell in row.strip("|").split("|")] for row in table.splitlines()[4:]]
    return {(car, manoeuvre): [float(v) if v != "-" else None for v in row] for car, manoeuvre, *row in rows}


def test_steers_as_rigid_bodies_do():
    found = both(Case(car="hmmwv", manoeuvre="step", speed_kmh=60.0, wheel_deg=45.0), 3.0)
    gain, yaw_rate, roll = errors(*found)
    assert abs(gain) < GAIN
    assert abs(yaw_rate) < PEAK
    assert abs(roll) < PEAK
    assert np.abs(found[1]["body.roll"]).max() > 0.05
    for n, close in (("body.yaw_rate", 0.03), ("body.roll", 0.05)):  # at every instant, of the largest value
        assert np.abs(found[0][n] - found[1][n]).max() < close * np.abs(found[1][n]).max()


@pytest.mark.full
@pytest.mark.parametrize("manoeuvre", COMPARED)
@pytest.mark.parametrize("car", [*FILES, "public"])
def test_three_manoeuvres_as_rigid_bodies_make_them(car, manoeuvre):
    case = Case(car=car, manoeuvre=manoeuvre, speed_kmh=60.0, wheel_deg=45.0)
    found = errors(*both(case, MANOEUVRES[manoeuvre].seconds))
    for error, most, on_page in zip(found, (GAIN, PEAK, PEAK), printed()[CARS[car], manoeuvre], strict=True):
        if on_page is not None:
            assert abs(error) < most
            assert error == pytest.approx(on_page, abs=0.1)


@pytest.mark.full
def test_without_rigid_wheels_the_yaw_gain_is_too_large():
    """Wheels whose mass acts at the CG, which is behind their common one, unload the front tires sideways."""
    case = Case(car="hmmwv", manoeuvre="step", speed_kmh=60.0, wheel_deg=45.0)
    gain, _, _ = errors(*both(case, 6.0, {"wheel.rigid_body": 0}))
    assert 8.0 < gain < 14.0
