"""The preview buffer of paper 001 (section 1.5).

Road heights by distance, from where they are sensed to the last wheel.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from build_fmus.component import Component
from fmu_sources.registration import component
from fmu_sources.roads import RoadLayout

SAMPLE_TIME = 5e-3  # s
SIDES = ("left", "right")
CELL = 0.025  # m
CELLS = 1024
MAX_SPEED = 30.0  # m/s
_FILL = 24  # cells that one sample may write at most
_CONTACT_POINTS = 11
_TINY = 1e-9


@component("PreviewBuffer{s}", "road ahead by distance, read under each wheel (paper 001)", of="ride_car_hmmwv")
def preview_buffer(
    layout: RoadLayout,
    name: str = "PreviewBuffer",
    *,
    period: float = SAMPLE_TIME,
    cell: float = CELL,
    cells: int = CELLS,
    max_speed: float = MAX_SPEED,
) -> Component:
    """Circular memory of each track's heights, one cell per `cell` meters of road, read ahead of each wheel.

    Args:
        layout: wheels, and number and spacing [s] of the preview heights, as for the road that it stands in for.
        name: of the FMU.
        period: sample time [s].
        cell: size of a cell [m].
        cells: their number, for each side.
        max_speed: speed [m/s] up to which the whole horizon lies in the buffer.

    Raises:
        ValueError: the horizon is longer than the buffer, or the preview step is no multiple of the period.
    """
    count, step = layout.preview_count, layout.preview_step
    every = round(step / period)
    if every < 1 or not math.isclose(every * period, step):
        raise ValueError(f"{name}: preview step {step:g} s is not a multiple of the sample time {period:g} s")
    reach = max(w.x for w in layout.wheels) - min(w.x for w in layout.wheels)
    needed = (count - 1) * step * max_speed + reach + (2 * _FILL + 2) * cell
    if needed > cells * cell:
        raise ValueError(
            f"{name}: a horizon of {count} heights {step:g} s apart at {max_speed:g} m/s, with the wheelbase, takes"
            f" {needed:.1f} m; the buffer holds {cells * cell:.1f} m: fewer heights, a lower max_speed, or more cells"
        )
    c = Component(
        name,
        kind="discrete",
        sample_time=period,
        description="Distance-indexed buffer of the sensed road, with the heights ahead of each wheel",
        source="001 section 1.5",
        symbols=ca.MX,
        notes=_NOTES,
    )
    forgetting = c.parameter(
        "forgetting",
        0.5,
        "1",
        "weight of a stored height when the same place is measured again: 0 takes the newest",
        min=0.0,
        max=0.999,
        tunable=True,
        source="assumed",
    )
    fade = c.parameter(
        "leak.time",
        10.0,
        "s",
        "time in which the mean of the sensed heights is forgotten",
        min=0.1,
        max=1e6,
        source="assumed",
    )
    contact = c.parameter(
        "contact.length",
        0.0,
        "m",
        "heights are means over this length around the wheel: the contact of the tire, where the "
        "range sensors' spot does not average already",
        min=0.0,
        max=1.0,
        source="option",
    )
    lead = c.parameter(
        "road.lead",
        period,
        "s",
        "road.* is the road under the wheels this much later: one sample, for a connection with delay",
        min=0.0,
        max=0.1,
        source="DESIGN of the exchange",
    )
    places = layout.declare_wheels(c)
    x = c.input("x", "m", "distance of the CG along the road, as in sensed.*.x")
    speed = c.input("speed", "m/s", "forward speed; negative backwards", display_unit="km/h")

    size = c.constant("cell", cell, "m", "size of a cell", source="build option")
    tiny = c.constant("tiny", _TINY, "m", "rounding of positions", source="own")
    heights: dict[str, Any] = {}
    known: dict[str, Any] = {}
    foremost: dict[str, Any] = {}
    fresh = []
    for side in SIDES:
        heights[side], known[side], foremost[side], valid = _written(
            c, side, x, cell=size, tiny=tiny, cells=cells, forgetting=forgetting, fade=fade
        )
        fresh.append(valid)

    # ------------------------------------------------------------------------------------------------------- read ahead

    spread = ca.DM(np.linspace(-0.5, 0.5, _CONTACT_POINTS))
    weights = np.ones(_CONTACT_POINTS)
    weights[[0, -1]] = 0.5
    mean = ca.DM(weights / weights.sum())

    def read(side: str, position: Any) -> tuple[Any, Any]:
        """Heights [m] at a column of positions [m], and whether they were measured (1) or are held."""
        n = position.numel()
        spots = ca.repmat(position, 1, _CONTACT_POINTS) + ca.repmat(spread.T, n, 1) * contact
        spots = ca.reshape(spots, n * _CONTACT_POINTS, 1) / size
        oldest = foremost[side] - (cells - _FILL - 2)
        inside = ca.fmin(ca.fmax(spots, oldest), foremost[side])
        left = ca.fmin(ca.floor(inside), foremost[side] - 1)
        part = inside - left
        at, after = (_slot(left + i, cells) for i in (0, 1))
        height = (1 - part) * heights[side][at] + part * heights[side][after]
        both = ca.fmin(ca.fmax(known[side][at], part > 1 - _TINY), ca.fmax(known[side][after], part < _TINY))
        reached = ca.logic_and(spots >= oldest - _TINY, spots <= foremost[side] + _TINY)
        sure = ca.reshape(ca.if_else(reached, both, 0), n, _CONTACT_POINTS) @ mean
        return ca.reshape(height, n, _CONTACT_POINTS) @ mean, sure > 1 - _TINY

    later = c.constant("later", np.arange(count) * step, "s", "times of the preview heights", source="road layout")
    under_known, ahead_known, previews = [], [], {}
    for w in layout.wheels:
        place = x + places[w.corner]
        position = ca.vertcat(place + speed * lead, place + speed * later)
        height, sure = read(w.side, position)
        c.output(
            f"road.{w.corner}.height",
            height[0],
            "m",
            f"road under the {w.corner} wheel, road.lead from now",
            display_unit="mm",
        )
        previews[w.corner] = height[1:]
        under_known.append(sure[0])
        beyond = position[1:] + contact / 2 > foremost[w.side] * size + tiny
        ahead_known.append(ca.mmin(ca.fmax(beyond, sure[1:])))
    c.output(
        "road.valid",
        ca.mmin(ca.vertcat(*under_known)) > 0.5,
        None,
        "road.*.height was measured at all wheels",
        type=bool,
    )
    for corner, height in previews.items():
        c.output(
            f"preview.{corner}",
            height,
            "m",
            f"height under the {corner} wheel now, preview.step later, ...; beyond what is sensed the last height",
            display_unit="mm",
        )
    c.output("preview.step", step, "s", "time between preview heights", display_unit="ms")
    good = ca.logic_and(ca.logic_and(*fresh), ca.mmin(ca.vertcat(*ahead_known)) > 0.5)
    c.output(
        "preview.valid",
        good,
        None,
        "both sides are being sensed, and all of preview.* up to there was measured",
        type=bool,
    )
    front = places[max(layout.wheels, key=lambda w: w.x).corner]
    sight = ca.fmin(*foremost.values()) * size - x - front
    c.output("preview.reach", ca.fmax(0, sight), "m", "how far ahead of the front wheels the road is known or held")
    c.reference_input(_reference_inputs())
    return c


def _slot(index: Any, cells: int) -> Any:
    """Place in the circular memory of a cell counted from distance 0; also right for negative ones."""
    return index - cells * ca.floor(index / cells)


def _written(
    c: Component, side: str, x: Any, *, cell: Any, tiny: Any, cells: int, forgetting: Any, fade: Any
) -> tuple[Any, Any, Any, Any]:
    """Memory of one side with this sample in it.

    Heights, whether measured, the foremost cell, and whether this is valid.
    """
    place = c.input(f"sensed.{side}.x", "m", f"distance along the road at which the {side} sensor sees it")
    height = c.input(f"sensed.{side}.height", "m", f"height of the road there, {side}")
    valid = c.input(f"sensed.{side}.valid", None, "it is measured", start=False, type=bool) > 0.5
    memory = c.state(f"{side}.height", "m", f"heights of the {side} track by distance", shape=(cells,))
    measured = c.state(f"{side}.measured", "1", "whether they were measured", shape=(cells,))
    begun = c.state(f"{side}.begun", "1", "whether there was a valid sample yet")
    was_valid = c.state(f"{side}.valid", "1", "whether the last sample was valid")
    foremost = c.state(f"{side}.foremost", "1", "foremost cell that was written", nominal=1e3)
    last_place = c.state(f"{side}.place", "m", "where the last sample was", nominal=100.0)
    last_height = c.state(f"{side}.last", "m", "its height")
    ahead = c.state(f"{side}.ahead", "m", "how far ahead of the CG the last valid sample was")
    mean = c.state(f"{side}.mean", "m", "slow mean of the sensed heights")

    # A sensor that fails leaves its last height, marked as not measured, as far ahead as it last saw.
    mean_now = mean + ca.if_else(valid, c.period / (c.period + fade), 0) * (height - mean)
    c.update(mean, mean_now)
    here = ca.if_else(valid, place, x + ahead)
    value = ca.if_else(valid, height - mean_now, last_height)
    c.update(ahead, ca.if_else(valid, place - x, ahead))

    newest = ca.floor(here / cell + _TINY)
    first = ca.ceil(ca.fmin(last_place, here) / cell - _TINY)
    last = ca.floor(ca.fmax(last_place, here) / cell + _TINY)
    jumped = ca.logic_or(last - first + 1 > _FILL, newest < foremost - (cells - 2 * _FILL))
    restart = ca.logic_and(valid, ca.logic_or(begun < 0.5, jumped))
    going = ca.logic_and(begun > 0.5, ca.logic_not(jumped))

    # All cells between the last sample and this one, in either direction, by interpolation. A held height never
    # replaces a measured one.
    index = first + ca.DM(np.arange(_FILL))
    slots = _slot(index, cells)
    stored, sure = memory[slots], measured[slots]
    span, meter = here - last_place, tiny / _TINY
    part = (index * cell - last_place) / ca.if_else(ca.fabs(span) > tiny, span, meter)
    drawn = last_height + ca.fmax(0, ca.fmin(1, part)) * (value - last_height)
    again = ca.logic_and(index <= foremost, sure > 0.5)
    mixed = drawn + ca.if_else(again, forgetting, 0) * (stored - drawn)
    writes = ca.logic_and(ca.logic_and(index <= last, going), ca.logic_or(valid, ca.logic_not(again)))
    both_valid = ca.if_else(ca.logic_and(valid, was_valid > 0.5), 1, 0)
    heights, known = ca.MX(memory), ca.MX(measured)
    heights.set_nz(ca.if_else(writes, mixed, stored), False, slots)
    known.set_nz(ca.if_else(writes, ca.fmax(both_valid, ca.if_else(again, sure, 0)), sure), False, slots)
    heights = ca.if_else(restart, value, heights)
    known = ca.if_else(restart, 0, known)
    front = ca.if_else(restart, newest, ca.if_else(going, ca.fmax(foremost, last), foremost))

    c.update(memory, heights)
    c.update(measured, known)
    c.update(foremost, front)
    moved = ca.logic_or(restart, going)
    c.update(last_place, ca.if_else(moved, here, last_place))
    c.update(last_height, ca.if_else(moved, value, last_height))
    c.update(was_valid, ca.if_else(valid, 1, 0))
    c.update(begun, ca.if_else(restart, 1, begun))
    return heights, known, front, valid


def _reference_inputs() -> dict[str, Callable[[float], float]]:
    signals: dict[str, Callable[[float], float]] = {"x": lambda t: 5.0 + 9.0 * t, "speed": lambda _: 9.0}

    def sensed(phase: float, dropout: float) -> tuple[Callable[[float], float], ...]:
        return (
            lambda t: 8.7 + 9.0 * t + 0.05 * math.sin(40.0 * t + phase),
            lambda t: 0.03 * math.sin(12.0 * t + phase),
            lambda t: 0.0 if dropout <= t < dropout + 0.1 else 1.0,
        )

    for i, side in enumerate(SIDES):
        for what, signal in zip(("x", "height", "valid"), sensed(i, 0.5 + 1e3 * (1 - i)), strict=True):
            signals[f"sensed.{side}.{what}"] = signal
    return signals


_NOTES = (
    (
        "Each side has a circular memory with one cell per 25 mm of road; a cell's place follows from its distance. A"
        " sample and the one before it give all cells between them by interpolation, so samples may come in any order"
        " and spacing; a place that is measured again is mixed with what is stored (forgetting). Samples more than 0.6"
        " m apart, or so far behind that the memory has moved on, restart it."
    ),
    (
        "Read: linear between cells, mean over contact.length, at the place where each wheel will be if the speed"
        " stays: also at standstill, where all of preview.* is the road under the wheel, and backwards, on the road"
        " that was driven over. Beyond the foremost cell the last height is held: its rate is 0, as for a controller"
        " without preview. preview.reach tells where that begins."
    ),
    (
        "A sensor that fails (sensed.*.valid false) leaves its last height, marked as not measured: preview.valid is"
        " false until the front and rear wheels have passed that stretch, road.valid while a wheel is on it. A run"
        " begins with a memory that holds the first height."
    ),
    (
        "leak.time: the slow mean of the sensed heights is taken off, so that a biased range, and what pose and buffer"
        " make of it in their loop, stays bounded. Slopes longer than that time at the speed driven are lost, which"
        " ride control does not need."
    ),
    (
        "Wiring: sensed.* from PreviewSensor, x and speed from where PreviewSensor has them. preview.* and preview.step"
        " to a controller. road.*.height and road.valid to KalmanHmmwv by connect_matching with delay=True (and to"
        " PreviewSensor, for its compensation 1): they are the road one sample later, which is when they arrive."
    ),
)
