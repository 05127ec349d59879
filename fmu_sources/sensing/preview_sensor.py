"""From ranges to heights of the road ahead: the heave, pitch and roll correction (1.18) of paper 001."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import scipy.linalg

from build_fmus.component import Component
from fmu_sources.models.corners import CORNERS, Corners
from fmu_sources.registration import component
from fmu_sources.vehicles import RideCar, SensorSet, declare

SAMPLE_TIME = 5e-3  # s
SIDES = {"left": 1, "right": -1}
POSE = ("m", "rad", "rad")  # units of heave, roll and pitch
NONE, QUARTER_CAR = 0, 1


@component("PreviewSensor{s}", "road ahead from range sensors, equation (1.18) (paper 001)", of="ride_car_hmmwv")
@component("PreviewSensor{s}", "road ahead from these range sensors, equation (1.18)", of="own_sensors")
def preview_sensor(
    sensors: SensorSet, vehicle: RideCar, name: str = "PreviewSensor", *, period: float = SAMPLE_TIME
) -> Component:
    """Correction (1.18) of both range sensors, with the paper's external tire compensation as an option.

    In ISO 8855 (z up, pitch positive nose down, roll positive left side up) it reads

        Z_sens = H + z - x_m sin(pitch) + y_m sin(roll) + D_bias cos(alpha)
        Z_road = Z_sens - D cos(alpha - pitch),    X_road = x + x_m + (D - D_bias) sin(alpha - pitch)

    for a mount at (x_m, y_m) from the CG, H above the road at rest. The paper counts roll the other way round (its
    CG_lat is positive to the right), and leaves D_bias out of X_road.

    Args:
        sensors: geometry of the mount.
        vehicle: its quarter car, at each wheel, is the model of the external tire compensation.
        name: of the FMU.
        period: sample time [s].
    """
    c = Component(
        name,
        kind="discrete",
        sample_time=period,
        description="Heights of the road ahead from range sensors, corrected for heave, pitch and roll",
        source="001 equation (1.18), Figure 1.6",
        notes=_NOTES,
    )
    mount = declare(c, sensors.mount, "mount.")
    compensation = c.parameter(
        "compensation",
        NONE,
        None,
        "of the tires: 0 none, 1 quarter cars on the buffered road (the paper's)",
        min=0,
        max=1,
        source="001 section 1.5",
    )
    error = c.parameter(
        "position.error",
        0.0,
        "m",
        "added to sensed.*.x: for studies of a preview at the wrong place",
        min=-10.0,
        max=10.0,
        tunable=True,
        source="option",
    )
    radar = sensors.radar
    tilt = c.input(
        "range.tilt.used",
        "rad",
        "angle of the beams, forward from straight down",
        start=radar.tilt.value,
        min=0.0,
        max=1.4,
        display_unit="deg",
    )
    response = c.input(
        "range.response.used",
        "s",
        "age of the ranges",
        start=radar.response.value,
        min=0.0,
        max=period,
        display_unit="ms",
    )
    pose = ca.vertcat(
        c.input("body.z", "m", "CG height above static equilibrium"),
        c.input("body.roll", "rad", "roll angle, positive left side up", display_unit="deg"),
        c.input("body.pitch", "rad", "pitch angle, positive nose down", display_unit="deg"),
    )
    x = c.input("x", "m", "distance of the CG along the road")
    speed = c.input("speed", "m/s", "forward speed", display_unit="km/h")
    corners = Corners(vehicle.wheel.axle_of)
    corners.each(
        road=lambda k: c.input(f"road.{k}.height", "m", f"buffered road under the {k} wheel, for compensation 1")
    )

    pose = pose + ca.if_else(compensation > 0.5, _free_response(c, vehicle, corners, period), 0)
    last = c.state("pose.last", None, "heave, roll and pitch of the sample before", shape=(3,), start=pose, rows=POSE)
    c.update(last, pose)
    then = pose + response / c.period * (last - pose)  # when the ranges were taken
    z, roll, pitch = ca.vertsplit(then)
    for side, sign in SIDES.items():
        distance = c.input(f"range.{side}", "m", f"{side} range", start=mount_range(sensors))
        valid = c.input(f"range.{side}.valid", None, "this range is measured", start=True, type=bool)
        mounted = mount.height + z - mount.x * ca.sin(pitch) + sign * mount.y * ca.sin(roll)
        height = mounted + mount.bias * ca.cos(tilt) - distance * ca.cos(tilt - pitch)
        ahead = mount.x + (distance - mount.bias) * ca.sin(tilt - pitch)
        c.value(f"sensor_height_{side}", mounted + mount.bias * ca.cos(tilt), source="Z_sens of 001 (1.18)")
        c.output(
            f"sensed.{side}.x",
            x - speed * response + ahead + error,
            "m",
            f"X_road of the {side} range sensor",
            source="X_road of 001 (1.18)",
        )
        c.output(
            f"sensed.{side}.height",
            height,
            "m",
            f"Z_road of the {side} range sensor",
            display_unit="mm",
            source="Z_road of 001 (1.18)",
        )
        c.output(f"sensed.{side}.valid", valid, None, "from a range that is measured", type=bool)
    c.reference_input(_reference_inputs(mount_range(sensors)))
    return c


def mount_range(sensors: SensorSet) -> float:
    """Range of the radar at rest on a flat road [m]."""
    return sensors.mount.height.value / math.cos(sensors.radar.tilt.value) + sensors.mount.bias.value


def _free_response(c: Component, vehicle: RideCar, corners: Corners, period: float) -> Any:
    """Heave, roll and pitch of four quarter cars (1.1) that follow the buffered road, a quarter of the body on each."""
    heights, units = [], ["m", "m", "m/s", "m/s"]
    for k in corners:
        k.wheel, strut, tire = (getattr(part, k.axle) for part in (vehicle.wheel, vehicle.suspension, vehicle.tire))
        ms, mu = vehicle.body.mass.value / 4, k.wheel.mass.value
        ks, cs, kt, ct = strut.stiffness.value, strut.damping.value, tire.stiffness.value, tire.damping.value
        # body and wheel height and velocity; the wheel's velocity less ct/mu of the road, which spares the road's rate
        A = np.array(
            [
                [0, 0, 1, 0],
                [0, 0, 0, 1],
                [-ks / ms, ks / ms, -cs / ms, cs / ms],
                [ks / mu, -(ks + kt) / mu, cs / mu, -(cs + ct) / mu],
            ]
        )
        b = np.array([0, ct / mu, cs / ms * ct / mu, kt / mu - (cs + ct) / mu * ct / mu])
        block = np.zeros((5, 5))
        block[:4, :4], block[:4, 4] = A, b
        block = scipy.linalg.expm(block * period)
        state = c.state(f"quarter.{k}", None, f"quarter car at {k}", shape=(4,), nominal=0.1, rows=units)
        step = c.constant(
            f"quarter.{k}.A", block[:4, :4], None, "of the quarter car", rows=units, columns=units, source="001 (1.1)"
        )
        held = c.constant(
            f"quarter.{k}.b",
            block[:4, 4],
            None,
            "of the quarter car",
            rows=["1", "1", "1/s", "1/s"],
            source="001 (1.1)",
        )
        c.update(state, step @ state + held * k.road)
        heights.append(state[0])
    places = [[1.0, k.side * k.wheel.half_track.value, -k.wheel.x.value] for k in corners]
    by_heights = c.constant(
        "pose.by.heights",
        np.linalg.pinv(np.array(places)),
        None,
        "heave, roll and pitch of a plane",
        rows=POSE,
        columns=["m"] * len(corners),
        source="least squares",
    )
    return by_heights @ ca.vertcat(*heights)


def _reference_inputs(rest: float) -> dict[str, Callable[[float], float]]:
    def wave(mean: float, amplitude: float, rate: float) -> Callable[[float], float]:
        return lambda t: mean + amplitude * math.sin(rate * t)

    return {
        "range.left": wave(rest, 0.05, 30.0),
        "range.right": wave(rest, -0.04, 20.0),
        "body.z": wave(0.01, 0.02, 12.0),
        "body.roll": wave(0.0, 0.02, 14.0),
        "body.pitch": wave(0.0, 0.02, 11.0),
        "x": lambda t: 5.0 + 9.0 * t,
        "speed": lambda _: 9.0,
        "range.right.valid": lambda t: 0.0 if 0.3 <= t < 0.5 else 1.0,
        **{f"road.{k}.height": wave(0.0, 0.02, 9.0 + i) for i, k in enumerate(CORNERS)},
    }


_NOTES = (
    (
        "Equation (1.18) in ISO 8855: Z_sens = H + z - x_m sin(pitch) + y_m sin(roll) + D_bias cos(alpha), Z_road ="
        " Z_sens - D cos(alpha - pitch), X_road = x + x_m + (D - D_bias) sin(alpha - pitch). The paper's roll counts"
        " the other way round, and its X_road leaves D_bias out (it is 0 here). Pose and distance are those at which"
        " the range was taken, range.response.used ago."
    ),
    (
        "The road's height is as good as the pose: 1 mrad of pitch at the default mount is 3.7 mm. With the pose of"
        " KalmanHmmwvPrinted there is a dip behind each bump; with that of KalmanHmmwv and use_road it is gone."
    ),
    (
        "compensation 1 is the paper's: the free response of a quarter car at each wheel to the buffered road is added"
        " to the pose. It was meant for a filter that does not see this motion. A filter that does has it already: then"
        " it counts twice."
    ),
    "A range that is not valid gives sensed.*.valid false, and values that follow from the range held by the sensor.",
    (
        "Wiring: range.* from SensorSuite, body.* from a Kalman filter, x and speed from SensorSuite (x.measured,"
        " speed.measured) or from SpeedProfile; sensed.* to PreviewBuffer; road.*.height back from PreviewBuffer by a"
        " connection with delay, for compensation 1 only."
    ),
)
