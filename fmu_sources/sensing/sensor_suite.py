"""The sensors of paper 001 (Tables 1.5 and 1.6): what a real HMMWV's computer measures of car and road."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca

from build_fmus.component import Component
from fmu_sources.models.corners import CORNERS
from fmu_sources.registration import component
from fmu_sources.roads import RoadScan
from fmu_sources.sensing.random_numbers import white_noise
from fmu_sources.vehicles import SensorSet, declare

SAMPLE_TIME = 1e-3  # s
RADAR, OPTICAL = 0, 1
SIDES = {"left": 1, "right": -1}
_DELAYS = 8  # samples of range kept for the response time
_SMALL = 1e-12


@component("SensorSuite{s}", "sensors of the HMMWV (paper 001, Tables 1.5 and 1.6)", of="sensors_hmmwv")
def sensor_suite(sensors: SensorSet, scan: RoadScan, name: str = "SensorSuite") -> Component:
    """Sensors of a ride car, with white noise, resolution, range and response time.

    Args:
        sensors: places, noise and data of both range sensors.
        scan: where the road gives the heights of its surface (`RoadLayout.scan` of the road).
        name: of the FMU.
    """
    c = Component(
        name,
        kind="discrete",
        sample_time=SAMPLE_TIME,
        description="Sensors of the HMMWV: load cells, LVDTs, accelerometers, gyros, range sensors, speedometer",
        source="001 Tables 1.5 and 1.6, Figure 1.6",
        notes=_NOTES,
    )
    scale = c.parameter(
        "noise.scale", 1.0, "1", "all noise times this: 0 for none", min=0.0, max=1e3, tunable=True, source="option"
    )
    seed = c.parameter("noise.seed", 1, None, "which noise", min=0, max=2**31 - 1, source="option")
    texts = type(sensors.noise).model_fields
    sigma = {}
    for quantity in texts:
        declared = type(sensors.noise).declared(quantity)
        value = getattr(sensors.noise, quantity)
        assert declared is not None
        sigma[quantity] = scale * c.parameter(
            f"noise.{quantity}",
            value.value,
            declared.unit,
            texts[quantity].description or "",
            min=0.0,
            max=declared.max,
            nominal=declared.nominal,
            display_unit=declared.display_unit,
            source=value.source,
        )

    noise = iter(white_noise(c, seed, 4 * 3 + 2 + 2 + 2 + 1))

    def measure(name: str, value: Any, quantity: str, unit: str, text: str, display_unit: str | None = None) -> None:
        c.output(name, value + sigma[quantity] * next(noise), unit, text, display_unit=display_unit)

    # ------------------------------------------------------------------------------------------------- on the vehicle

    for k in CORNERS:
        force = c.input(f"actuator.{k}.force", "N", f"force of the actuator at {k}, positive lifts the body")
        measure(f"loadcell.{k}", force, "load_cell", "N", f"load cell at the top of the actuator at {k}", "kN")
    for k in CORNERS:
        travel = c.input(f"suspension.{k}.deflection", "m", "body height minus wheel height", display_unit="mm")
        measure(f"lvdt.{k}", travel, "lvdt", "m", f"LVDT in the actuator at {k}: suspension deflection", "mm")
    for k in CORNERS:
        az = c.input(f"wheel.{k}.az", "m/s2", "vertical acceleration of the wheel")
        measure(f"hub.{k}.az", az, "hub", "m/s2", f"hub accelerometer at {k}")
    z = c.input("body.z", "m", "CG height above static equilibrium")
    roll = c.input("body.roll", "rad", "roll angle, positive left side up", display_unit="deg")
    pitch = c.input("body.pitch", "rad", "pitch angle, positive nose down", display_unit="deg")
    az = c.input("body.az", "m/s2", "vertical acceleration of the CG")
    roll_acceleration = c.input("body.roll_acceleration", "rad/s2", "roll acceleration")
    pitch_acceleration = c.input("body.pitch_acceleration", "rad/s2", "pitch acceleration")
    for end in ("front", "rear"):
        place = getattr(sensors.chassis, end)
        at = [
            c.parameter(
                f"chassis.{end}.{axis}",
                getattr(place, axis).value,
                "m",
                type(place).model_fields[axis].description or "",
                min=-50.0,
                max=50.0,
                source=getattr(place, axis).source,
            )
            for axis in "xy"
        ]
        value = az - at[0] * pitch_acceleration + at[1] * roll_acceleration
        measure(f"chassis.{end}.az", value, "chassis", "m/s2", f"{end} accelerometer on the chassis, vertical")
    for axis in ("pitch", "roll"):
        rate = c.input(f"body.{axis}_rate", "rad/s", f"{axis} rate", display_unit="deg/s")
        measure(f"gyro.{axis}_rate", rate, "gyro", "rad/s", f"rate gyro, {axis}", "deg/s")

    # -------------------------------------------------------------------------------------------------------- distance

    x = c.input("x", "m", "distance of the CG along the road")
    speed = c.input("speed", "m/s", "forward speed", display_unit="km/h")
    gain = c.parameter(
        "speed.gain",
        1.0,
        "1",
        "speedometer reading per true speed (tire wear, slip)",
        min=0.5,
        max=1.5,
        tunable=True,
        source="option",
    )
    offset = c.parameter(
        "x.offset", 0.0, "m", "error of the measured distance at the start", min=-1e3, max=1e3, source="option"
    )
    measured = gain * speed + sigma["speed"] * next(noise)
    c.output("speed.measured", measured, "m/s", "speedometer", display_unit="km/h")
    distance = c.state("distance", "m", "measured distance", start=x + offset, nominal=100.0)
    c.update(distance, distance + c.period * measured)
    c.output("x.measured", distance, "m", "distance from integrating speed.measured from the true start on")

    # -------------------------------------------------------------------------------------------------- range sensors

    kind = c.parameter(
        "range.sensor", RADAR, None, "range sensors: 0 radar, 1 optical", min=0, max=1, source="001 Table 1.6"
    )
    data = {}
    for field in ("near", "far", "resolution", "spot", "response", "tilt"):
        declared = type(sensors.radar).declared(field)
        assert declared is not None
        both = [getattr(getattr(sensors, n), field) for n in ("radar", "optical")]
        values = c.parameter(
            f"range.{field}",
            [q.value for q in both],
            declared.unit,
            f"{type(sensors.radar).model_fields[field].description}: radar, optical",
            min=declared.min,
            max=declared.max,
            nominal=declared.nominal,
            display_unit=declared.display_unit,
            source="; ".join(dict.fromkeys(q.source for q in both)),
        )
        chosen = ca.if_else(kind < 0.5, values[0], values[1])
        if field in ("response", "tilt"):
            c.output(
                f"range.{field}.used",
                chosen,
                declared.unit,
                f"range.{field} of the chosen sensor, for PreviewSensor",
                display_unit=declared.display_unit,
            )
        data[field] = chosen
    mount = declare(c, sensors.mount, "mount.")
    begin = c.parameter(
        "range.dropout.start", 0.0, "s", "time at which both range sensors fail", min=0.0, max=1e6, source="option"
    )
    lasting = c.parameter(
        "range.dropout.duration",
        0.0,
        "s",
        "how long both range sensors fail: 0 for never",
        min=0.0,
        max=1e6,
        source="option",
    )
    instant = c.constant("instant", _SMALL, "s", "rounding of times", source="own")
    small = c.constant("small", _SMALL, "m", "rounding of lengths", source="own")
    first = c.constant("scan.first", scan.start, "m", "first height of scan.*", source="road layout")
    apart = c.constant("scan.apart", scan.step, "m", "distance between heights of scan.*", source="road layout")
    off = c.parameter("range.off", False, None, "both range sensors see nothing", tunable=True, source="option")
    dropped = ca.logic_or(off > 0.5, ca.logic_and(c.time >= begin - instant, c.time < begin + lasting - instant))
    for what, value in (("start", scan.start), ("step", scan.step)):
        c.constant_input(
            f"scan.{what}",
            "m",
            f"{what} of scan.left and scan.right on the road: what these sensors were built for",
            must_equal=value,
        )
    beam = data["tilt"] - pitch  # from straight down
    beam = ca.fmax(0.0, ca.fmin(1.5, beam))
    for side, sign in SIDES.items():
        surface = c.input(f"scan.{side}", "m", f"heights of the {side} track ahead of the CG", shape=(scan.count,))
        top = mount.height + z - mount.x * ca.sin(pitch) + sign * mount.y * ca.sin(roll)
        seen = _averaged([surface[i] for i in range(scan.count)], data["spot"] / apart)
        hit, length = _cast(seen, top, beam, first - mount.x, apart, small)
        length += mount.bias
        rest = mount.height / ca.cos(data["tilt"]) + mount.bias
        now = ca.if_else(hit, length, rest)

        ring = c.state(
            f"range.{side}.ring",
            "m",
            "last true ranges, newest first",
            shape=(_DELAYS - 1,),
            start=ca.repmat(now, _DELAYS - 1, 1),
        )
        hits = c.state(
            f"range.{side}.hits",
            "1",
            "whether they hit the road",
            shape=(_DELAYS - 1,),
            start=ca.repmat(hit, _DELAYS - 1, 1),
        )
        lengths, were = ca.vertcat(now, ring), ca.vertcat(hit, hits)
        c.update(ring, lengths[:-1])
        c.update(hits, were[:-1])
        late = data["response"] / c.period
        weights = [ca.fmax(0, 1 - ca.fabs(late - i)) for i in range(_DELAYS)]
        shown = sum(w * lengths[i] for i, w in enumerate(weights)) + sigma["range"] * next(noise)
        missed = sum(ca.if_else(w > _SMALL, 1 - were[i], 0) for i, w in enumerate(weights))
        shown = _rounded(shown, data["resolution"], small)
        inside = ca.logic_and(shown >= data["near"] - small, shown <= data["far"] + small)
        valid = ca.logic_and(ca.logic_and(inside, missed < 0.5), ca.logic_not(dropped))
        held = c.state(f"range.{side}.held", "m", "last valid range", start=rest)
        reading = ca.if_else(valid, shown, held)
        c.update(held, reading)
        c.output(f"range.{side}", reading, "m", f"{side} range sensor: distance to the road along its beam")
        c.output(
            f"range.{side}.valid",
            valid,
            None,
            "the range is measured now; otherwise its last valid value is held",
            type=bool,
        )

    c.reference_input(_reference_inputs(scan))
    return c


def _averaged(heights: list[Any], spot: Any) -> list[Any]:
    """Mean of equidistant `heights` over a window of `spot` steps, each height standing for one step around it."""
    half = spot / 2
    reach = 6
    weights = [
        ca.fmax(0, ca.fmin(j + 0.5, half) - ca.fmax(j - 0.5, -half)) / ca.fmax(2 * half, _SMALL)
        for j in range(-reach, reach + 1)
    ]
    weights[reach] = ca.if_else(half > _SMALL, weights[reach], 1)
    last = len(heights) - 1
    return [
        sum(w * heights[max(0, min(last, i + j))] for j, w in zip(range(-reach, reach + 1), weights, strict=True))
        for i in range(len(heights))
    ]


def _cast(heights: list[Any], top: Any, beam: Any, start: Any, step: Any, small: Any) -> tuple[Any, Any]:
    """Where a beam from height `top` at angle `beam` from straight down first meets a profile.

    `heights` [m] are `step` m apart, the first one `start` m ahead of the sensor; a cubic goes through the four
    around the hit. Returns whether there is a hit within the profile, and the length of the beam [m].
    """
    slope = ca.tan(beam)
    ahead = [start + i * step for i in range(len(heights))]
    above = [(top - h) * slope - a for h, a in zip(heights, ahead, strict=True)]  # positive where the beam is above
    free = above[0] > 0
    hit: Any = 0
    picked: list[Any] = [0] * 7
    for i in range(1, len(heights) - 2):
        free = ca.logic_and(free, above[i] > 0)
        here = ca.logic_and(free, above[i + 1] <= 0)
        values = (*heights[i - 1 : i + 3], ahead[i], above[i], above[i + 1])
        picked = [ca.if_else(here, value, old) for value, old in zip(values, picked, strict=True)]
        hit = ca.if_else(here, 1, hit)
    before, left, right, beyond, place, high, low = picked
    drop = ca.fmax(high - low, small)

    def height(s: Any) -> Any:
        """Catmull-Rom cubic through the four heights."""
        return left + s / 2 * (
            right
            - before
            + s * (2 * before - 5 * left + 4 * right - beyond + s * (3 * (left - right) + beyond - before))
        )

    s = ca.fmin(1, ca.fmax(0, high / drop))
    for _ in range(5):
        s = ca.fmin(1, ca.fmax(0, s + ((top - height(s)) * slope - place - s * step) / drop))
    return hit, (top - height(s)) / ca.cos(beam)


def _rounded(value: Any, resolution: Any, small: Any) -> Any:
    steps = ca.floor(value / ca.fmax(resolution, small) + 0.5)
    return ca.if_else(resolution > small, steps * resolution, value)


def _reference_inputs(scan: RoadScan) -> dict[str, Callable[[float], float]]:
    def wave(amplitude: float, rate: float, phase: float) -> Callable[[float], float]:
        return lambda t: amplitude * math.sin(rate * t + phase)

    signals: dict[str, Callable[[float], float]] = {
        "body.z": wave(0.02, 12.0, 0.1),
        "body.roll": wave(0.02, 15.0, 0.2),
        "body.pitch": wave(0.02, 11.0, 0.3),
        "body.az": wave(2.9, 12.0, 3.2),
        "body.roll_rate": wave(0.3, 15.0, 1.7),
        "body.pitch_rate": wave(0.2, 11.0, 1.9),
        "x": lambda t: 5.0 + 9.0 * t,
        "speed": lambda t: 9.0,
    }
    for i, k in enumerate(CORNERS):
        signals[f"actuator.{k}.force"] = wave(1000.0, 20.0, i)
        signals[f"suspension.{k}.deflection"] = wave(0.03, 13.0, i)
        signals[f"wheel.{k}.az"] = wave(10.0, 60.0, i)

    def surface(i: int, height: float) -> Callable[[float], float]:
        return lambda t: height * max(0.0, 1 - ((5.0 + 9.0 * t + scan.start + i * scan.step - 9.5) / 0.15) ** 2)

    for side, height in (("left", 0.05), ("right", -0.03)):
        signals |= {f"scan.{side}[{i + 1}]": surface(i, height) for i in range(scan.count)}
    return signals


_NOTES = (
    (
        "Every sensor shows its true value at t plus white Gaussian noise, new at every sample of 1 ms and independent"
        " of all others. noise.seed chooses the numbers, noise.scale turns all of them down or off; switching one"
        " sensor's noise off leaves the others' numbers as they are. The numbers come from the generator MRG32k3a, kept"
        " in the FMU's own state: a run can be repeated, saved and restored."
    ),
    (
        "Range sensors: beams in the tracks of the wheels, tilted forward, cast against the road's scan.left and"
        " scan.right (a scan belongs to the road: RoadLayout.scan), so that a bump casts a shadow. The reading is a"
        " mean over range.spot, comes range.response late, is rounded to range.resolution, and counts only from"
        " range.near to range.far and within the scan; otherwise range.*.valid is false and the last valid value is"
        " held. range.dropout.* makes both fail for a while, range.off as long as it is set."
    ),
    (
        "range.sensor chooses between both sensors of Table 1.6; each parameter range.* has one value for either. "
        "range.tilt.used and range.response.used tell PreviewSensor which beam its ranges come from."
    ),
    (
        "The car's small-angle pose is taken as that of a rigid body. Left out: scatter of grazing beams, lateral"
        " offset by yaw, temperature and drift, quantization other than that of the range sensors (the paper gives"
        " none)."
    ),
    (
        "speed.measured is speed times speed.gain plus noise; x.measured is its integral from the true x at the start"
        " plus x.offset. A road driven by x.measured and speed.measured is the paper's generated preview: a known"
        " profile at a distance that drifts."
    ),
    (
        "Wiring: everything by name from RideCarHmmwv and the road; x and speed from SpeedProfile; actuator.*.force"
        " from the actuators' force. Nothing connected to scan.*: a flat road."
    ),
)
