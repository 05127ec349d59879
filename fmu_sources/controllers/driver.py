"""A driver: keeps a path and a speed with steering wheel and pedals, by preview and with a reaction time."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from build_fmus.component import Component
from fmu_sources.plants.free_body import MAX_SPEED, limit
from fmu_sources.plants.tables import linear_table
from fmu_sources.registration import component

POINTS = 64
SAMPLE_TIME = 0.01  # s
_MEMORY = 50  # samples: the longest reaction time
_WINDOW = 20.0  # m of path around the last place where the car is looked for


@component("Driver", "driver of a full car: path and speed in, steering wheel and pedals out")
def driver(name: str = "Driver") -> Component:
    """Preview driver: curvature toward a point of the path ahead, damped by the yaw rate; pedals by a PI control law.

    The circle that is tangent to the car's heading and meets the point has the curvature 2 e / d^2, with the offset e
    of the point to the side and its distance d. (Own; the idea is that of preview driver models such as MacAdam's.)
    """
    c = Component(
        name,
        kind="discrete",
        sample_time=SAMPLE_TIME,
        description="Driver that follows a path and a speed with steering wheel and pedals",
        source="own; preview of a point of the path",
        notes=_NOTES,
    )

    def number(of: str, start: Any, unit: str, text: str, low: float, high: float, **options: Any) -> Any:
        return c.parameter(of, start, unit, text, min=low, max=high, source="assumed", **options)

    ahead = number("preview_time", 0.9, "s", "time that the driver looks ahead", 0.05, 5.0)
    reaction = number(
        "reaction_time", 0.1, "s", "delay of wheel and pedals, in whole samples", 0.0, _MEMORY * SAMPLE_TIME
    )
    ratio = number("steering.ratio", 15.0, "1", "angle of the steering wheel per steer angle of the car", 1.0, 100.0)
    wheelbase = number("wheelbase", 3.302, "m", "wheelbase of the car", 0.5, 20.0)
    understeer = number(
        "understeer",
        0.0,
        "rad.s2/m",
        "steer angle per lateral acceleration that the driver expects",
        -0.1,
        0.1,
        nominal=0.01,
    )
    damping = number("yaw_rate_gain", 0.1, "s", "steer angle per missing yaw rate", 0.0, 2.0)
    fastest = number("steering.max_rate", 15.0, "rad/s", "fastest turn of the steering wheel", 0.1, 100.0)
    largest = number("steering.max_angle", 12.0, "rad", "largest turn of the steering wheel", 0.1, 50.0)
    gain = number("pedal.gain", 0.3, "s/m", "pedal per speed error", 0.0, 100.0)
    integral_gain = number("pedal.integral_gain", 0.05, "1/m", "pedal per integral of the speed error", 0.0, 100.0)
    row: dict[str, Any] = {"low": -1e5, "high": 1e5, "nominal": 100.0}
    path_x = number("path.x", 20.0 * np.arange(POINTS), "m", "points of the path in their order, along the road", **row)
    path_y = number("path.y", np.zeros(POINTS), "m", "points of the path in their order, to the left", **row)
    target = c.input(
        "target.speed", "m/s", "speed to keep", start=50 / 3.6, min=0.0, max=MAX_SPEED, display_unit="km/h"
    )
    x, y = (c.input(n, "m", f"position of the car {of}") for n, of in (("x", "along the road"), ("y", "to the left")))
    yaw = c.input("body.yaw", "rad", "yaw angle of the car, positive left", display_unit="deg")
    yaw_rate = c.input("body.yaw_rate", "rad/s", "yaw rate of the car")
    speed = c.input("speed", "m/s", "forward speed of the car", display_unit="km/h")
    window = c.constant(
        "window", _WINDOW, "m", "of path around the last place where the car is looked for", source="own"
    )
    nearest = c.constant("nearest", 3.0, "m", "distance of the previewed point at standstill", source="own")

    # Where the car is on the path: the nearest point of all lines between points, near the last one.
    steps = [(path_x[i + 1] - path_x[i], path_y[i + 1] - path_y[i]) for i in range(POINTS - 1)]
    lengths = [ca.sqrt(a**2 + b**2) for a, b in steps]
    stations: list[Any] = [0 * lengths[0]]
    for i, length in enumerate(lengths, 1):
        c.check(length, f"path.x[{i + 1}], path.y[{i + 1}] repeat the point before: each point needs another place")
        stations.append(stations[-1] + length)
    station_row = ca.vertcat(*stations)
    last = c.state("station", "m", "place on the path, from its first point", nominal=10.0)
    expected = last + speed * c.period
    best: Any = None
    station = expected
    for i, ((a, b), length) in enumerate(zip(steps, lengths, strict=True)):
        size = ca.if_else(length > 0, length, nearest)  # finite for points that check refuses
        along = ((x - path_x[i]) * a + (y - path_y[i]) * b) / size
        low, high = expected - window - stations[i], expected + window - stations[i]
        along = ca.fmax(0, ca.fmin(length, ca.fmax(low, ca.fmin(high, along))))
        away = (x - path_x[i] - along * a / size) ** 2 + (y - path_y[i] - along * b / size) ** 2
        outside = ca.logic_or(stations[i] > expected + window, stations[i + 1] < expected - window)
        if best is None:
            best, station, none = away, along, outside
            continue
        better = ca.logic_and(ca.logic_not(outside), ca.logic_or(none, away < best))
        station = ca.if_else(better, stations[i] + along, station)
        best = ca.if_else(better, away, best)
        none = ca.logic_and(none, outside)
    station = c.value("station_now", ca.if_else(none, expected, station), source="nearest point of the path")
    c.update(last, station)

    # Steering toward the previewed point; beyond the last one the path goes straight on.
    look = station + ca.sqrt((speed * ahead) ** 2 + nearest**2)
    at = [
        linear_table(look, station_row, ca.vertcat(row[0] + 0, *ca.vertsplit(row)[1:]), beyond=True)
        for row in (path_x, path_y)
    ]
    forward = ca.cos(yaw) * (at[0] - x) + ca.sin(yaw) * (at[1] - y)
    offset = ca.cos(yaw) * (at[1] - y) - ca.sin(yaw) * (at[0] - x)
    curvature = c.value("curvature", 2 * offset / ca.fmax(forward**2 + offset**2, nearest**2))
    steer = (wheelbase + understeer * speed**2) * curvature + damping * (speed * curvature - yaw_rate)
    requested = limit(ratio * steer, largest)

    # Pedals.
    error = target - speed
    total = c.state("integral", "m", "integral of the speed error", nominal=10.0)
    pedal = c.value("pedal", gain * error + integral_gain * total)
    winding_up = ca.logic_and(ca.fabs(pedal) > 1, pedal * error > 0)
    c.update(total, total + ca.if_else(winding_up, 0, error * c.period))

    # Reaction time, and the fastest turn of the wheel.
    samples = ca.floor(reaction / c.period + 0.5)
    delayed = []
    for of, value, unit in (("steering.wheel", requested, "rad"), ("pedal", limit(pedal, 1), "1")):
        memory = c.state(f"{of}.memory", unit, f"{of} of the last samples, newest first", shape=(_MEMORY,))
        c.update(memory, ca.vertcat(value, memory[:-1]))
        late = value
        for i in range(_MEMORY):
            late = ca.if_else(samples > i + 0.5, memory[i], late)
        delayed.append(late)
    wheel = c.state("steering.wheel.now", "rad", "angle of the steering wheel")
    turned = wheel + limit(delayed[0] - wheel, fastest * c.period)
    c.update(wheel, turned)
    c.output("steering.wheel", turned, "rad", "angle of the steering wheel, positive left", display_unit="deg")
    c.output("throttle", ca.fmax(0, delayed[1]), "1", "throttle pedal, 1: all the way down")
    c.output("brake", ca.fmax(0, -delayed[1]), "1", "brake pedal, 1: all the way down")
    c.output("path.offset", ca.sqrt(best), "m", "distance of the car from the path")
    c.reference_input(
        {
            "target.speed": lambda t: 15.0 if t < 0.5 else 10.0,
            "x": lambda t: 12.0 * t,
            "y": lambda t: 0.4 * np.sin(2.0 * t),
            "body.yaw": lambda t: 0.05 * np.sin(2.0 * t),
            "body.yaw_rate": lambda t: 0.1 * np.cos(2.0 * t),
            "speed": lambda t: 12.0 + np.sin(t),
        }
    )
    return c


_NOTES = (
    (
        f"The path is {POINTS} points in their order, path.x[i] and path.y[i], with straight lines between; it may"
        " close and cross itself, since the car is looked for within 20 m of path around its last place. It begins at"
        " the first point, and goes straight on after the last one. No two points in a row may be the same: a path with"
        " fewer corners gets more points on its lines."
    ),
    (
        "reaction_time delays wheel and pedals by whole samples, from 0 to 0.5 s; in the first samples of a run they"
        " are 0. The turn of the wheel is limited by steering.max_rate and steering.max_angle."
    ),
    (
        "Wiring: x, y, body.yaw, body.yaw_rate and speed from a full car; steering.wheel, throttle and brake to it,"
        " with its parameter driver.mode 1. steering.ratio and wheelbase are those of the car. Another driver, a"
        " recording, a steering wheel on the desk or a gamepad takes this place with the same three outputs."
    ),
)
