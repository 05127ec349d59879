"""Optimal preview LQ control of the car with seven degrees of freedom as a discrete component (paper 004, Theorem 1).

u = -K x + feed-forward. The feed-forward weighs the road ahead of each wheel over a horizon: the front wheels see the
preview, the rear wheels see what the front wheels passed one wheelbase earlier, from the controller's own memory. What
is used of it is a choice at run time (parameter `mode`).

With a period of 1 ms (the default) K is the exact sampled gain and the feed-forward the continuous integral (17) with
the road linear between samples. Any other period uses the exact sampled form of both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

from build_fmus.component import Component
from fmu_sources.controllers.lq.design import LinearPlant, continuous_lq, output_index, sampled_lq
from fmu_sources.controllers.lq.design.riccati import RESIDUAL_LIMIT
from fmu_sources.controllers.lq.design.tunable import tunable_taps
from fmu_sources.controllers.lq.preview_weights import PreviewLqWeights, control_weights, load_weights, output_weights
from fmu_sources.models.corners import CORNERS
from fmu_sources.registration import component

SIDES = {"l": ("fl", "rl"), "r": ("fr", "rr")}
MODES = {"active": 0, "delay": 1, "preview": 2}
SYMMETRY_LIMIT = 1e-6  # of the largest gain, by which those of the two sides may differ
CONTINUOUS_PERIOD = 1e-3  # s; feed-forward as in (17) at this period, exact sampled form at any other
WEIGHTED = (
    "body.az",
    "body.pitch_acceleration",
    "body.roll_acceleration",
    *(f"suspension.{k}.deflection" for k in CORNERS),
    *(f"tire.{k}.deflection" for k in CORNERS),
)
"""Outputs of the index (10), apart from the forces."""


@dataclass(frozen=True)
class Taps:
    """What the component needs of a design, on a grid of road samples one period apart, index j = 0, 1, ...

    With a horizon of n periods u = -K x + sum_{j<n} interior[j] w_j + end[n] w_n, and with the tail held + tail[n] w_n.
    Arrays (count, controls, wheels); `shift` (controls,) is what is left of a unit shift of everything when the tail
    is held, and is subtracted so that it is left unchanged exactly.
    """

    K: np.ndarray
    interior: np.ndarray
    end: np.ndarray
    tail: np.ndarray
    shift: np.ndarray


def ride_plant(car: Component, parameters: np.ndarray | None = None) -> LinearPlant:
    """The linear model of a ride car with road heights as disturbances, derived from its declaration.

    Args:
        car: the ride car.
        parameters: others than those it is declared with, in their order.

    Raises:
        ValueError: the car's outputs depend on road rates (tire damping): the index would need the road's slope.
    """
    lin = car.linearize(p=parameters)
    forces, heights, rates = (
        [pattern.format(k) for k in CORNERS] for pattern in ("force.{}", "road.{}.height", "road.{}.rate")
    )
    if np.abs(lin.B[:, [lin.inputs.index(n) for n in rates]]).max() > 0:
        raise ValueError(f"{car.name}: tire damping makes road rates a disturbance; preview LQ is for cars without it")
    return LinearPlant.of(lin, forces, heights, WEIGHTED)


def design_taps(plant: LinearPlant, weights: PreviewLqWeights, period: float, count: int) -> Taps:
    """Design the control law on a plant and lay its feed-forward out on `count` samples one period apart."""
    index = output_index(plant, weights.outputs(CORNERS), weights.controls(CORNERS))
    if np.any(index.Nuw):
        raise ValueError(
            "an output of the index depends on both a force and a road height at once: the control law then needs the"
            " road under the rear wheels now, which this controller does not measure"
        )
    sampled = sampled_lq(plant, index, period)
    if math.isclose(period, CONTINUOUS_PERIOD):
        foh = continuous_lq(plant, index).foh_weights(period, count)
        interior, end, tail = foh.interior, foh.end, foh.tail
    else:
        gains = sampled.preview_gains(count)
        interior, end = -gains, np.zeros_like(gains)
        tail = np.stack([-sampled.tail(n) for n in range(count)])
    # A unit shift of road, wheels and body must not ask for forces when the road is taken to continue.
    shift = -sampled.K @ _unit_shift(plant) + (interior[: count - 1].sum(axis=0) + end[-1] + tail[-1]).sum(axis=1)
    return Taps(sampled.K, interior, end, tail, shift)


@component("PreviewLqComfort{s}", "preview LQ controller of paper 004, ride comfort", of="sedan", weights="comfort")
@component(
    "PreviewLqComfort5ms{s}",
    "preview LQ controller of paper 004, ride comfort, sampled at 5 ms",
    of="sedan",
    weights="comfort",
    period=5e-3,
)
@component(
    "PreviewLqRoadHolding{s}", "preview LQ controller of paper 004, road holding", of="sedan", weights="road_holding"
)
@component(
    "PreviewLqTunable{s}",
    "preview LQ controller of paper 004, its weights parameters",
    of="sedan",
    weights="comfort",
    tunable=True,
)
def preview_lq(
    car: Component,
    weights: PreviewLqWeights | str | Path,
    *,
    name: str,
    period: float = CONTINUOUS_PERIOD,
    preview_count: int = 48,
    preview_step: float = 5e-3,
    memory: float = 0.5,
    tunable: bool = False,
) -> Component:
    """The controller FMU for a ride car.

    Args:
        car: the ride car.
        weights: of the index, or the name or path of their file; with `tunable` those at first.
        name: of the FMU.
        period: sample time [s].
        preview_count: number of points of the preview inputs.
        preview_step: their spacing [s], a multiple of the period.
        memory: longest delay of the rear wheels [s] that is remembered.
        tunable: the weights are parameters, and the FMU designs its control law when it is initialized.

    Raises:
        ValueError: the spacing is not a multiple of the period, or a tunable control law has another period than
            `CONTINUOUS_PERIOD`, or is for a car whose sides differ.
        LqError: the design has no stabilizing solution.
    """
    if not isinstance(weights, PreviewLqWeights):
        weights = load_weights(weights)
    every = round(preview_step / period)
    if every < 1 or not math.isclose(every * period, preview_step):
        raise ValueError(f"{name}: preview step {preview_step:g} s is not a multiple of the period {period:g} s")
    if tunable and not math.isclose(period, CONTINUOUS_PERIOD):
        raise ValueError(
            f"{name}: a control law with weights as parameters is sampled every {CONTINUOUS_PERIOD:g} s, not every"
            f" {period:g} s"
        )
    ahead = (preview_count - 1) * every  # periods
    past = math.ceil(memory / period)
    count = past + ahead + 1
    plant = ride_plant(car)
    taps = design_taps(plant, weights, period, count)

    c = Component(
        name,
        kind="discrete",
        sample_time=period,
        description=(
            "Optimal preview LQ controller of a car with seven degrees of freedom:"
            f" {'weights are parameters' if tunable else weights.name}"
        ),
        source="Marzbanrad, Hojjat, Zohoor, Nikravesh: Theorem 1, Table 2",
        symbols=ca.MX,
        notes=(*_NOTES, *(_NOTES_TUNABLE if tunable else ())),
    )
    mode = c.parameter(
        "mode",
        MODES["preview"],
        None,
        "0 active, 1 active and delay, 2 active and preview",
        min=0,
        max=2,
        source="004: the control laws of its Table 3",
    )
    preview_time = c.parameter(
        "preview_time", 0.12, "s", "preview used ahead of the front wheels", min=0.0, max=10.0, source="004"
    )
    hold_tail = c.parameter(
        "hold_tail",
        False,
        None,
        "take the road to continue at its last height beyond the horizon, instead of at 0",
        source="option; the paper's method is off",
    )
    front_x, rear_x = (car.variable(f"wheel.{k}.x").start for k in ("fl", "rl"))
    assert front_x is not None  # parameters always have start values
    assert rear_x is not None
    base = c.parameter(
        "wheelbase", front_x[0] - rear_x[0], "m", "distance between the axles", min=0.1, max=50.0, source="vehicle file"
    )
    x = ca.vertcat(*(c.input(s, car.variable(s).unit, car.variable(s).description) for s in plant.states))
    now = {k: c.input(f"road.{k}.height", "m", f"road height under wheel {k}") for k in ("fl", "fr")}
    preview = {
        k: c.input(
            f"preview.{k}",
            "m",
            f"road heights ahead of wheel {k}, {preview_step:g} s apart, index 1 now",
            shape=(preview_count,),
        )
        for k in ("fl", "fr")
    }
    c.constant_input(
        "preview.step", "s", "time between preview points: what this controller was built for", must_equal=preview_step
    )
    speed = c.input("speed", "m/s", "speed of the car; gives the rear wheels' delay", min=0.0)

    # Horizons in periods. The rear wheels follow by `delay`; beyond the memory, or at standstill, their road is
    # unknown.
    requested = ca.floor(preview_time / c.period + 0.5)
    front = ca.if_else(mode > 1.5, ca.fmin(requested, ahead), 0)
    least = c.constant("least.speed", 1e-6, "m/s", "speed by which at least the wheelbase is divided", source="own")
    delay = base / (ca.fmax(speed, least) * c.period)
    known = delay <= past
    whole = ca.if_else(known, ca.floor(delay), past)
    part = ca.if_else(known, delay - whole, 0)
    rear = ca.if_else(ca.logic_and(known, mode > 0.5), front + whole, 0)

    # Road of each side on the period grid: remembered, now, ahead (linear between preview points).
    grid = ca.DM(_interpolation(preview_count, every))
    j = ca.DM(np.arange(count, dtype=float))
    feedforward = ca.MX.zeros(len(CORNERS))

    law: _Fixed | _Designed
    if tunable:
        _check_sides(taps, name)
        law = _Designed(c, plant, weights, period, count)
    else:
        law = _Fixed(c, taps, [car.variable(s).unit or "1" for s in plant.states])
    last = []
    for wheel_front, wheel_rear in SIDES.values():
        memory_state = c.state(
            f"memory.{wheel_front}",
            "m",
            f"past road heights under wheel {wheel_front}, newest first",
            shape=(past,),
            start=ca.repmat(now[wheel_front], past, 1),
        )
        c.update(memory_state, ca.vertcat(now[wheel_front], memory_state[: past - 1]))
        coming = ca.vertcat(now[wheel_front], (grid @ preview[wheel_front])[1:])
        road = ca.vertcat(memory_state[::-1], coming)  # index past + k is k periods from now
        at_front = ca.vertcat(coming, ca.MX.zeros(past))
        newer = road[ca.fmin(j + past - whole, count - 1)]
        older = road[ca.fmax(ca.fmin(j + past - whole - 1, count - 1), 0)]
        at_rear = newer + part * (older - newer)
        for wheel, heights, n in ((wheel_front, at_front, front), (wheel_rear, at_rear, rear)):
            final = heights[n]
            last.append(final)
            feedforward += law.table("interior", wheel) @ ca.if_else(j < n, heights, 0)
            feedforward += final * (
                law.column("end", wheel, n) + ca.if_else(hold_tail, law.column("tail", wheel, n), 0)
            )
    feedforward -= ca.if_else(hold_tail, 1, 0) * law.shift * ca.sum1(ca.vertcat(*last)) / len(last)

    force = law.feedback @ x + feedforward
    for i, k in enumerate(CORNERS):
        c.output(f"force.{k}", force[i], "N", f"actuator force at corner {k}", display_unit="kN")
    truncated = ca.logic_or(ca.logic_and(mode > 1.5, requested > ahead), ca.logic_and(mode > 0.5, ca.logic_not(known)))
    c.output(
        "horizon_truncated",
        truncated,
        None,
        "the preview inputs or the memory reach less far than mode and preview_time ask for",
        type=bool,
    )
    c.provenance = {"weights": weights.as_dict(), "car": car.name, "period": period, "feedback": taps.K.tolist()}
    c.reference_input(_reference_inputs(plant.states, preview_count, preview_step))
    return c


class _Fixed:
    """A control law whose gains are constants of the FMU."""

    def __init__(self, c: Component, taps: Taps, units: Sequence[str]) -> None:
        self._c, self._taps = c, taps
        self.shift = self._gains("shift", taps.shift)
        self.feedback = c.constant(
            "feedback",
            -taps.K,
            None,
            "-K: force per state",
            rows=["N"] * len(CORNERS),
            columns=units,
            source="004 (14), designed on the car",
        )

    def _gains(self, name: str, values: np.ndarray) -> ca.MX:
        return self._c.constant(
            name, values, "N/m", "force per road height", source="004 Theorem 1, designed on the car"
        )

    def _values(self, kind: str, wheel: str) -> np.ndarray:
        return np.asarray(getattr(self._taps, kind)[:, :, CORNERS.index(wheel)].T)

    def table(self, kind: str, wheel: str) -> ca.MX:
        """Force of each corner (row) per height of the road at each node below a wheel."""
        return self._gains(f"{kind}.{wheel}", self._values(kind, wheel))

    def column(self, kind: str, wheel: str, n: ca.MX) -> ca.MX:
        """Column n of such a table."""
        return _column(self._gains(f"{kind}.{wheel}", self._values(kind, wheel).ravel(order="F")), n)


class _Designed:
    """A control law that is designed when the FMU is initialized, of weights that are parameters.

    Gains of the right wheels are those of the left ones with the sides changed.
    """

    def __init__(self, c: Component, plant: LinearPlant, weights: PreviewLqWeights, period: float, count: int) -> None:
        self._c, self._wheels = c, len(CORNERS)
        taps = tunable_taps(plant, _declared(c, weights), period, count)
        c.check(
            RESIDUAL_LIMIT - taps.residuals,
            "weight.*: no control law is found for these weights, which differ too much: bring them nearer to each"
            " other, or to those of a published control law",
        )
        self._taps = {"interior": taps.interior, "end": taps.end, "tail": taps.tail}
        self._kept: dict[tuple[str, str], ca.MX] = {}
        known = (count - 1) * self._wheels
        whole = ca.sum2(taps.interior[:, :known]) + ca.sum2(taps.end[:, known:]) + ca.sum2(taps.tail[:, known:])
        self.shift = c.initial_value(
            "shift", whole - taps.K @ ca.DM(_unit_shift(plant)), "N/m", "force per height of everything"
        )
        self.feedback = c.initial_value("feedback", -taps.K, None, "-K: force per state")

    def table(self, kind: str, wheel: str) -> ca.MX:
        """As of `_Fixed`."""
        return self._left(kind, wheel)[_seen_from(wheel), :]

    def column(self, kind: str, wheel: str, n: ca.MX) -> ca.MX:
        """As of `_Fixed`."""
        return _column(ca.vec(self._left(kind, wheel)), n)[_seen_from(wheel)]

    def _left(self, kind: str, wheel: str) -> ca.MX:
        left = f"{wheel[0]}l"
        if (kind, left) not in self._kept:
            part = self._taps[kind][:, CORNERS.index(left) :: self._wheels]
            self._kept[kind, left] = self._c.initial_value(
                f"{kind}.{left}", part, "N/m", f"force per road height below wheel {left}"
            )
        return self._kept[kind, left]


def _seen_from(wheel: str) -> list[int]:
    """Rows of the left wheel's gains for the corners, seen from a wheel."""
    return [CORNERS.index(k if wheel.endswith("l") else _opposite(k)) for k in CORNERS]


def _opposite(corner: str) -> str:
    """The corner at the other end of the axle."""
    return corner[0] + {"l": "r", "r": "l"}[corner[1]]


def _check_sides(taps: Taps, name: str) -> None:
    """Refuse a control law whose right wheels are not the left ones in a mirror.

    Raises:
        ValueError: they are not.
    """
    for table in (taps.interior, taps.end, taps.tail):
        for right in ("fr", "rr"):
            mirrored = table[:, _seen_from(right), CORNERS.index(_opposite(right))]
            if np.abs(table[:, :, CORNERS.index(right)] - mirrored).max() > SYMMETRY_LIMIT * np.abs(table).max():
                raise ValueError(
                    f"{name}: a control law with weights as parameters is for cars that are the same left and right"
                )


_LIMITS = {"acceleration": (0.0, 1e4), "suspension": (0.0, 1e7), "tire": (1.0, 1e8), "force": (1e-9, 1e-2)}
"""Smallest and largest weight of each kind. Without a weight of the tires nothing would tell the height of the car."""


def weight_parameters(weights: PreviewLqWeights) -> dict[str, float]:
    """Parameters that set these weights of a tunable control law: name -> value.

    Names are `weight.acceleration.heave`, `weight.tire.front`, ...
    """
    return {_parameter(name): value for name, value in weights.by_name().items()}


def _parameter(weight: str) -> str:
    return f"weight.{weight}"


def _declared(c: Component, weights: PreviewLqWeights) -> ca.MX:
    """The weights of a set as parameters, in the order of outputs and controls."""
    texts = weights.descriptions()
    own = {}
    for name, value in weights.by_name().items():
        least, most = _LIMITS[name.partition(".")[0]]
        # Without a unit to the check of dimensions: the design has the car's matrices in numbers, as constants have
        # that are designed in Python.
        own[name] = c.parameter(
            _parameter(name),
            value,
            None,
            f"weight of the squares of {texts[name]}",
            min=least,
            max=most,
            source=f"{weights.source}; any other designs another control law",
        )
    return ca.vertcat(*(own[n] for n in (*output_weights(CORNERS), *control_weights(CORNERS))))


def _unit_shift(plant: LinearPlant) -> np.ndarray:
    """The states where road, wheels and body are all 1 m higher."""
    return np.array(
        [1.0 if n == "body.z" or (n.startswith("wheel.") and n.endswith(".z")) else 0.0 for n in plant.states]
    )


def _interpolation(points: int, every: int) -> np.ndarray:
    """Matrix from preview points to the period grid, linear in between."""
    position = np.arange((points - 1) * every + 1) / every
    return np.maximum(0.0, 1.0 - np.abs(position[:, None] - np.arange(points)[None, :]))


def _column(table: ca.MX, n: ca.MX) -> ca.MX:
    """Column n of a table with a row for each corner, which is given column after column."""
    rows = len(CORNERS)
    return table[n * rows + ca.DM(np.arange(rows, dtype=float))]


def _reference_inputs(states: tuple[str, ...], points: int, step: float) -> dict[str, Callable[[float], float]]:
    def wave(amplitude: float, rate: float, phase: float) -> Callable[[float], float]:
        return lambda t: amplitude * math.sin(rate * t + phase)

    signals: dict[str, Callable[[float], float]] = {n: wave(0.01, 5.0 + i, 0.3 * i) for i, n in enumerate(states)}
    for i, k in enumerate(("fl", "fr")):
        signals[f"road.{k}.height"] = wave(0.02, 9.0, i)
        signals |= {f"preview.{k}[{m + 1}]": wave(0.02, 9.0, i + 9.0 * m * step) for m in range(points)}
    signals["speed"] = lambda t: 20.0
    return signals


_NOTES_TUNABLE = (
    (
        "Weights are parameters: the control law is designed for them on the car of the build when the FMU is"
        " initialized (two Riccati equations, solved by doubling). With the weights of a published control"
        " law it is that control law, to rounding."
    ),
)
_NOTES = (
    (
        "States and forces carry the names of the car's outputs and inputs. The feedback gain is the exact sampled LQ"
        " gain for the index with output weights; the feed-forward weighs the road under each wheel over its horizon."
    ),
    (
        "Horizons: mode 0 uses no road at all; mode 1 uses, for the rear wheels, the road that the front wheels have"
        " passed (delay wheelbase/speed, from the controller's own memory); mode 2 adds preview_time ahead of the front"
        " wheels, and as much more for the rear ones. Horizons are rounded to whole sample times. horizon_truncated"
        " tells when the preview inputs or the memory end before the horizon; what is there is used. At standstill, or"
        " so slowly that the delay exceeds the memory, the rear wheels have no feed-forward and horizon_truncated is"
        " true in modes 1 and 2."
    ),
    (
        "Beyond the horizon the road is taken to be at height 0 (the paper's method), so a constant offset of the whole"
        " road asks for forces. hold_tail takes the road to continue at its last height, and a constant offset changes"
        " nothing."
    ),
)
