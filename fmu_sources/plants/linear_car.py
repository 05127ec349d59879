"""The linear ride car of a nonlinear car: its motion near rest in the coordinates of a ride car.

It follows from the nonlinear car's own derivatives. Coordinates q are those of `fmu_sources.plants.ride_car`: body
height, roll, pitch, and one height per wheel. With the linear model `dx/dt = A x + B u` of the nonlinear car at rest,
and `q = P x`,

Coordinates q are those of `fmu_sources.plants.ride_car`: body height, roll, pitch, and one height per wheel. With
the linear model `dx/dt = A x + B u` of the nonlinear car at rest, and `q = P x`,

    q'  = P A x                      (inputs do not move positions at once: P B = 0)
    q'' = P A A x + P A B u = N [q; q'] + P A B u

where N exists as soon as nothing but q and q' determines the ride. It does for a car that stands, with tires
that press on the road and neither drive nor steer (`WITHOUT_SLIP`): then N is exact, which is checked. The
notes of the component list the simplifications, among them dampers whose rates differ by direction and have no
derivative at rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from build_fmus.component import Component, Linearization, Model
from fmu_sources.models.corners import TWO_AXLES, Corner, Corners
from fmu_sources.plants.full_car import full_car
from fmu_sources.plants.ride_interface import bump_at_an_angle, ride_inputs, ride_outputs, ride_states
from fmu_sources.plants.seat import SEAT_NOTE
from fmu_sources.plants.wishbone_car import wishbone_car
from fmu_sources.registration import component
from fmu_sources.vehicles import FullCar, WishboneCar

CORNERS = tuple(TWO_AXLES)
POSITIONS = ("body.z", "body.roll", "body.pitch", *(f"wheel.{k}.z" for k in CORNERS))
WITHOUT_SLIP = {"tire.slip_stiffness": 0.0, "tire.cornering_stiffness": 0.0}
"""Parameters of a nonlinear car whose tires press on the road only."""
_EXACT = 1e-9  # of the largest number of a row, by which what was left out may change it
_DIGITS = 12  # of the largest number of a row; what is below is rounding
_COMPUTED = "computed: linearization of the car of the vehicle file at rest"


@dataclass(frozen=True)
class RideMotion:
    """Motion of a car near rest: `q'' = stiffness q + damping q' + inputs u`, and outputs likewise.

    Attributes:
        stiffness, damping: accelerations (7, 7) by `POSITIONS` and by their rates.
        inputs: accelerations by input, (7,) each.
        seen: of outputs by position (7,), by rate (7,), and by input.
        rest: of outputs, at rest.
    """

    stiffness: np.ndarray
    damping: np.ndarray
    inputs: Mapping[str, np.ndarray]
    seen: Mapping[str, tuple[np.ndarray, np.ndarray, Mapping[str, float]]]
    rest: Mapping[str, float]

    @property
    def matrix(self) -> np.ndarray:
        """A (14, 14) of `[q; q']`."""
        return np.block([[np.zeros((7, 7)), np.eye(7)], [self.stiffness, self.damping]])


def at_rest(car: Model, values: Mapping[str, float], speed: float = 0.0) -> Linearization:
    """The linear model of a nonlinear car that rests on a level road.

    With other `values` of parameters, at a `speed` [m/s].
    """
    return car.linearize(u=car.vector("input", {"target.speed": speed}), p=car.vector("parameter", values))


def positions_of(lin: Linearization) -> np.ndarray:
    """`POSITIONS` by state, (7, states)."""
    return lin.C[[lin.outputs.index(n) for n in POSITIONS]]


def ride_motion(car: Model, values: Mapping[str, float], outputs: Sequence[str] = ()) -> RideMotion:
    """The ride of a nonlinear car near rest.

    Args:
        car: with the outputs `POSITIONS` and inputs `road.*.height`, `road.*.slope`, `force.*`,
            `target.speed`.
        values: of its parameters, by which tires press on the road only (`WITHOUT_SLIP`).
        outputs: of the car, to be had of the linear one too.

    Raises:
        ValueError: something else than the ride determines the motion, or one of the outputs.
    """
    standing, rolling = (at_rest(car, values, v) for v in (0.0, 1.0))
    P, A = positions_of(standing), standing.A
    ride = np.vstack([P, P @ A])

    def by_ride(rows: np.ndarray, names: Sequence[str]) -> np.ndarray:
        found = np.linalg.lstsq(ride.T, rows.T, rcond=None)[0].T
        beside = np.abs(found @ ride - rows).max(axis=1) / np.maximum(np.abs(rows).max(axis=1), 1e-300)
        if beside.max(initial=0.0) > _EXACT:
            worst = names[int(beside.argmax())]
            raise ValueError(
                f"{car.name}: {worst} depends on more than body and wheels: a share of {beside.max():.1e} is not"
                " explained by their motion"
            )
        return np.asarray(found)

    accelerations = _cleaned(by_ride(P @ A @ A, [f"acceleration of {n}" for n in POSITIONS]))
    column = {n: i for i, n in enumerate(standing.inputs)}
    inputs = _by_input(column, P @ A @ standing.B, positions_of(rolling) @ rolling.A @ rolling.B)
    rows = [standing.outputs.index(n) for n in outputs]
    of_states = _cleaned(by_ride(standing.C[rows], outputs))
    of_inputs = _by_input(column, standing.D[rows], rolling.D[rows])
    rest = _outputs_at_rest(car, values, outputs)
    seen = {
        n: (of_states[i, :7], of_states[i, 7:], {k: float(v[i]) for k, v in of_inputs.items()})
        for i, n in enumerate(outputs)
    }
    return RideMotion(accelerations[:, :7], accelerations[:, 7:], inputs, seen, rest)


def _by_input(column: Mapping[str, int], standing: np.ndarray, rolling: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of heights, their rates and forces.

    A road rises under a wheel at slope x speed: its rate acts as the slope does per m/s, less what a slope does to a
    car that stands.
    """
    heights, slopes, forces = (
        [column[n.format(k)] for k in CORNERS] for n in ("road.{}.height", "road.{}.slope", "force.{}")
    )
    kinds = {
        "road.{}.height": standing[:, heights],
        "road.{}.rate": rolling[:, slopes] - standing[:, slopes],
        "force.{}": standing[:, forces],
    }
    return {
        name.format(k): v for name, values in kinds.items() for k, v in zip(CORNERS, _cleaned(values).T, strict=True)
    }


def _cleaned(matrix: np.ndarray) -> np.ndarray:
    """Without what is rounding: the same on every machine, and zero where left and right cancel."""
    scale = np.maximum(np.abs(matrix).max(axis=1, initial=0.0, keepdims=True), 1e-300)
    return np.asarray(np.round(matrix / scale, _DIGITS) * scale + 0.0)


def _outputs_at_rest(car: Model, values: Mapping[str, float], outputs: Sequence[str]) -> dict[str, float]:
    u, p = car.vector("input", {"target.speed": 0.0}), car.vector("parameter", values)
    x = np.asarray(car.functions["start"](car.vector("state"), u, p)).ravel()
    y = np.asarray(car.functions["out"](0.0, x, u, p)).ravel()
    places = {e.name: (x if e.variable.role == "state" else y)[e.slot] for e in car.output_elements()}
    return {n: float(places[n]) for n in outputs}


def over_the_road(motion: RideMotion) -> RideMotion:
    """The same car where its weight leans out of the plane of the road below, not out of the vertical.

    On a level road this is one thing. On others, deflections and velocities alone determine the motion, as controllers
    need that know nothing else: moving car and road together as one plane, d = (height, roll, pitch), changes nothing.
    `motion` has the deflections of the suspensions among its outputs.
    """
    rows = np.vstack([motion.seen[f"suspension.{k}.deflection"][0] for k in CORNERS])
    wheels = -np.linalg.solve(rows[:, 3:], rows[:, :3])  # heights of wheels and road per d, (4, 3)
    moved = np.vstack([np.eye(3), wheels])
    flat = np.linalg.solve(wheels.T @ wheels, wheels.T)  # d of the plane nearest to four heights
    heights = [f"road.{k}.height" for k in CORNERS]

    def less(by_position: np.ndarray, by_height: np.ndarray) -> np.ndarray:
        return np.asarray(by_height - (by_position @ moved + by_height @ wheels) @ flat)

    def named(columns: np.ndarray) -> dict[str, Any]:
        return dict(zip(heights, columns.T, strict=True))

    inputs = named(less(motion.stiffness, np.column_stack([motion.inputs[n] for n in heights])))
    seen = {
        name: (position, rate, {**given, **named(less(position, np.array([given[n] for n in heights])))})
        for name, (position, rate, given) in motion.seen.items()
        if name.startswith("seat")
    }
    return replace(motion, inputs={**motion.inputs, **inputs}, seen={**motion.seen, **seen})


def linear_values(vehicle: WishboneCar | FullCar) -> dict[str, float]:
    """Parameters with which the car of a file has a linear model at rest.

    Tires press on the road only, and the internal driver of a full car lets the pedals be. Both rates of a damper are
    their mean, by which it takes the same energy from a motion that is the same up and down.
    """
    values = dict(WITHOUT_SLIP)
    if isinstance(vehicle, FullCar):
        return {**values, "speed_control.gain": 0.0, "speed_control.integral_gain": 0.0}
    for name in ("front", "rear"):
        damper = getattr(vehicle.suspension, name).damper
        for where in ("", "outer_"):
            mean = (getattr(damper, f"{where}compression").value + getattr(damper, f"{where}rebound").value) / 2
            values |= {f"suspension.{name}.damper.{where}{way}": mean for way in ("compression", "rebound")}
    return values


# ------------------------------------------------------------------------------------------------------- the component

_UNITS = ("m", "rad", "rad", *("m" for _ in CORNERS))
_INPUTS = {  # of a corner -> name, unit, name of the matrix, words
    "road": ("road.{}.height", "m", "road_height", "road height"),
    "road_rate": ("road.{}.rate", "m/s", "road_rate", "rate of the road height"),
    "force": ("force.{}", "N", "force", "actuator force"),
}


@component("RideCar{v}", "linear 7-DOF ride car of that car near rest, by its own derivatives", of="hmmwv_public")
def linear_ride_car(
    vehicle: WishboneCar | FullCar,
    name: str = "RideCarHmmwvPublic",
    parameters: Mapping[str, float] | None = None,
    *,
    plane: bool = False,
) -> Component:
    """Ride car with seven degrees of freedom, linearized near rest.

    Its matrices are those of `wishbone_car` or `full_car` near rest, with other values of `parameters` by name; with
    `plane` those `over_the_road`.
    Inputs, states and outputs are those of `fmu_sources.plants.ride_car.ride_car`, by name and sign.
    """
    shown = (
        "seat.ax",
        "seat.az",
        *(f"suspension.{k}.deflection" for k in CORNERS),
        *(f"tire.{k}.force" for k in CORNERS),
    )
    car = full_car(vehicle, name) if isinstance(vehicle, FullCar) else wishbone_car(vehicle, name)
    motion = ride_motion(car.model(), {**(parameters or {}), **linear_values(vehicle)}, shown)
    motion = over_the_road(motion) if plane else motion
    c = Component(
        name,
        kind="continuous",
        description=f"Linear ride car, 7 degrees of freedom, of the nonlinear car near rest: {vehicle.name}",
        source="linearization of the nonlinear car of the same vehicle file, in the source of this component",
        solver="rk4",
        solver_step=5e-4,
        notes=(*_NOTES, SEAT_NOTE),
    )
    corners = Corners(TWO_AXLES)
    ride_inputs(c, corners)
    q, dq = ride_states(c, corners)
    inputs = {what: ca.vertcat(*corners.all(what)) for what in _INPUTS}

    # ------------------------------------------------------------------------------------------------------- matrices

    rows = [*(f"{unit}/s2" for unit in _UNITS), "m/s2", "m/s2"]

    def matrix(label: str, text: str, columns: Sequence[str], values: np.ndarray) -> Any:
        return c.parameter(
            f"acceleration.{label}",
            values,
            None,
            f"accelerations of body height, roll, pitch, wheels, and seat.ax, seat.az per {text}",
            nominal=max(1.0, float(np.abs(values).max())),
            rows=rows,
            columns=columns,
            source=_COMPUTED,
        )

    seat = [motion.seen[n] for n in shown[:2]]
    by_position = matrix("position", "position", _UNITS, np.vstack([motion.stiffness, *(s[0] for s in seat)]))
    by_rate = matrix(
        "rate", "rate of these", [f"{unit}/s" for unit in _UNITS], np.vstack([motion.damping, *(s[1] for s in seat)])
    )
    acceleration = by_position @ ca.vertcat(*q) + by_rate @ ca.vertcat(*dq)
    for what, (pattern, unit, label, text) in _INPUTS.items():
        values = np.column_stack(
            [[*motion.inputs[pattern.format(k)], *(s[2][pattern.format(k)] for s in seat)] for k in CORNERS]
        )
        acceleration += matrix(label, text, [unit] * len(CORNERS), values) @ inputs[what]
    *moving, ax, az = ca.vertsplit(acceleration)
    deflecting = c.parameter(
        "suspension.deflection",
        np.vstack([motion.seen[f"suspension.{k}.deflection"][0] for k in CORNERS]),
        None,
        "deflections of the suspensions per position",
        rows=["m"] * len(CORNERS),
        columns=_UNITS,
        source=_COMPUTED,
    )
    travel, travel_rate = (ca.vertsplit(deflecting @ ca.vertcat(*of)) for of in (q, dq))
    corners.each(
        stiffness=lambda k: _tire(
            c, motion, k, "stiffness", "N/m", "vertical stiffness of the tire, of its force", "height"
        ),
        damping=lambda k: _tire(c, motion, k, "damping", "N.s/m", "vertical damping of the tire, of its force", "rate"),
        static=lambda k: c.parameter(
            f"tire.{k}.load",
            motion.rest[f"tire.{k}.force"],
            "N",
            "load of the tire at rest",
            nominal=1e3,
            source=_COMPUTED,
        ),
    )

    # ------------------------------------------------------------------------------------------------------- equations

    for place, rate, value in zip(q, dq, moving, strict=True):
        c.derivative(place, rate)
        c.derivative(rate, value)

    for k in corners:
        k.travel, k.travel_rate = travel[k.place], travel_rate[k.place]
        k.deflection = q[3 + k.place] - k.road
        k.tire_force = k.static + (
            k.stiffness * (k.road - q[3 + k.place]) + k.damping * (k.road_rate - dq[3 + k.place])
        )
    ride_outputs(c, corners, moving, ax, az)
    c.reference_input(bump_at_an_angle(list(CORNERS)))
    return c


def _tire(c: Component, motion: RideMotion, k: Corner, what: str, unit: str, text: str, by: str) -> Any:
    value = motion.seen[f"tire.{k}.force"][2][f"road.{k}.{by}"]
    return c.parameter(f"tire.{k}.{what}", value, unit, text, source=_COMPUTED, nominal=1e3)


_NOTES = (
    (
        "The nonlinear car of the same vehicle file near rest, in the coordinates of a ride car. Every number is a"
        " derivative of that car's own equations; nothing is fitted. Displacements count from static equilibrium, so"
        " weight does not appear."
    ),
    (
        "It stands for small motions of that car with two differences. A damper whose rates differ by direction has no"
        " derivative at rest: both rates are their mean here, by which it takes the same energy from a motion that is"
        " the same up and down. Tires press on the road only: without drive and side forces the ride is free,"
        " at any speed, and the body rolls about where its masses and springs let it. Side forces of tires that toe in,"
        " and that change their track as they travel, stiffen and damp the real car somewhat; see the page of that car."
    ),
    (
        "road.*.rate acts on the damping of the tires. That a load on a slope also pushes lengthwise is left out, as in"
        " any ride car."
    ),
    (
        "acceleration.* are matrices: rows are body height, roll, pitch, wheels fl, fr, rl, rr, then seat.ax and"
        " seat.az; columns are the same seven positions, their rates, or corners. tire.*.stiffness and tire.*.damping"
        " are of the outputs tire.*.force only: their part in the motion is in the matrices."
    ),
    (
        "Every state is an output and may be set before the start. A, B, C and D of the linear model are the"
        " directional derivatives."
    ),
    (
        "Wiring: connect a road's outputs road.*.height and road.*.rate to the inputs of the same name; a controller"
        " drives force.*. Exchange at 1 ms."
    ),
)
