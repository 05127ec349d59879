"""Kalman filters of paper 001 (section 1.4): from the sensors of Table 1.5 to the states that controllers need.

`kalman_hmmwv` estimates the 15 relative states, with the road's rate as white noise; `kalman_hmmwv_printed` is the
paper's filter of 14 absolute states that takes the road to be at height 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import casadi as ca
import numpy as np
import scipy.linalg

from build_fmus.component import Component
from fmu_sources.estimators.kalman_design import Filter, correction, kalman_filter, sampled_model
from fmu_sources.models.corners import CORNERS
from fmu_sources.models.hmmwv_states import (
    FORCES,
    RELATIVE_STATES,
    ROAD_HEIGHTS,
    ROAD_RATES,
    SUSPENSION,
    TIRE,
    relative_model,
)
from fmu_sources.registration import component
from fmu_sources.vehicles import SensorSet

SAMPLE_TIME = 5e-3  # s
LARGEST_GAP = 0.1  # m between tire and ground; assumed
POSE = ("body.z", "body.roll", "body.pitch")
POSE_RATES = ("body.vz", "body.roll_rate", "body.pitch_rate")
_HUBS = tuple(f"wheel.{k}.az" for k in CORNERS)
_ACCELERATIONS = ("body.az", "body.roll_acceleration", "body.pitch_acceleration")
_SENSORS = (
    *(f"lvdt.{k}" for k in CORNERS),
    *(f"hub.{k}.az" for k in CORNERS),
    "chassis.front.az",
    "chassis.rear.az",
    "gyro.pitch_rate",
    "gyro.roll_rate",
)
"""Measurements, in the order of the rows of C."""

Rows = Callable[[tuple[str, ...]], tuple[np.ndarray, np.ndarray, np.ndarray]]

START_SIGMA = {"deflection": 0.03, "z": 0.05, "vz": 0.5, "roll": 0.05, "pitch": 0.05, "rate": 0.3}
"""Standard deviations of the states before the first measurement, SI; assumed."""


def measurement_rows(sensors: SensorSet, output: Rows) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`C`, `D`, `F` of the twelve measurements, from a function that gives those of outputs of the car."""
    travel, hubs, body = output(SUSPENSION), output(_HUBS), output(_ACCELERATIONS)
    rates = output(("body.pitch_rate", "body.roll_rate"))
    places = np.array([[1.0, place.y.value, -place.x.value] for place in (sensors.chassis.front, sensors.chassis.rear)])
    rows = [np.vstack([travel[i], hubs[i], places @ body[i], rates[i]]) for i in range(3)]
    return rows[0], rows[1], rows[2]


def measurement_noise(sensors: SensorSet) -> np.ndarray:
    """Standard deviations of the twelve measurements."""
    n = sensors.noise
    return np.array([n.lvdt.value] * 4 + [n.hub.value] * 4 + [n.chassis.value] * 2 + [n.gyro.value] * 2)


def relative_filter(car: Component, sensors: SensorSet, road: float, period: float = SAMPLE_TIME) -> Filter:
    """Filter of the 15 relative states for a road whose rate has the intensity `road` [m2/s]."""
    model = relative_model(car)
    C, D, F = measurement_rows(sensors, model.output)
    sampled = sampled_model(
        model.A,
        model.B,
        model.E,
        C,
        D,
        F,
        measured=measurement_noise(sensors),
        force=sensors.noise.load_cell.value,
        road=road,
        period=period,
    )
    return kalman_filter(sampled)


def absolute_filter(car: Component, sensors: SensorSet, road: float, period: float = SAMPLE_TIME) -> tuple[Filter, Any]:
    """Filter of the car's own 14 states about a road at height 0, and what a known road height adds to it.

    The road's rate reaches these states through the damping of the tires alone.
    """
    lin = car.linearize()
    u, h, w = ([lin.inputs.index(n) for n in group] for group in (FORCES, ROAD_HEIGHTS, ROAD_RATES))

    def rows(columns: list[int]) -> Rows:
        def output(names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            r = [lin.outputs.index(n) for n in names]
            return lin.C[r], lin.D[np.ix_(r, u)], lin.D[np.ix_(r, columns)]

        return output

    noise = {"measured": measurement_noise(sensors), "force": sensors.noise.load_cell.value, "period": period}
    filters = []
    for columns in (w, h):
        C, D, F = measurement_rows(sensors, rows(columns))
        filters.append(sampled_model(lin.A, lin.B[:, u], lin.B[:, columns], C, D, F, road=road, **noise))  # type: ignore[arg-type]
    return kalman_filter(filters[0]), filters[1]


@component("Kalman{v}", "Kalman filter of 15 relative states (paper 001)", of="ride_car_hmmwv")
@component("Kalman{v}", "Kalman filter of the HMMWV's 15 relative states with these sensors", of="own_sensors")
def kalman_hmmwv(
    car: Component, sensors: SensorSet, name: str = "KalmanHmmwv", *, period: float = SAMPLE_TIME
) -> Component:
    """Kalman filter of the 15 relative states.

    Args:
        car: the ride car; the filter's model is its linear model.
        sensors: noise and places of the sensors, and what is assumed of the road.
        name: of the FMU.
        period: sample time [s].
    """
    filters = [
        relative_filter(car, sensors, q.value, period) for q in (sensors.estimator.road, sensors.estimator.known_road)
    ]
    c = _component(
        name, period, "Kalman filter of the 15 relative states of a ride car", "001 section 1.4, Table 1.5", _NOTES
    )
    varying = c.parameter(
        "time_varying",
        False,
        None,
        "carry the covariance along from its start, instead of using the steady-state gain",
        source="option",
    )
    use_road = _road_parameter(c)
    leak, follow = (
        c.parameter(
            f"pose.{what}",
            getattr(sensors.estimator, f"pose_{what}").value,
            "s",
            text,
            min=2 * period,
            max=1e4,
            tunable=True,
            source=getattr(sensors.estimator, f"pose_{what}").source,
        )
        for what, text in (
            ("leak", "time in which body.z, body.roll and body.pitch fade to 0"),
            ("correction", "time in which they follow the pose on a known road"),
        )
    )
    y, u = _measured_inputs(c)
    road, road_valid = _road_inputs(c)
    used = ca.logic_and(use_road > 0.5, road_valid)

    # ----------------------------------------------------- the sample before, now that the road's rate over it is known

    unknown, rest = filters
    m, n = unknown.model, len(RELATIVE_STATES)
    x = _estimate_state(c, RELATIVE_STATES)
    covariance = c.state(
        "covariance", None, "covariance of that prediction", shape=(n, n), start=_start_covariance(RELATIVE_STATES)
    )
    begun = c.state("begun", "1", "whether there was a sample before")
    last_y = c.state("measured.last", None, "its measurements", shape=(len(_SENSORS),), nominal=1.0)
    last_u = c.state("force.last", "N", "its forces", shape=(4,), nominal=100.0)
    last_road = c.state("road.last", "m", "its road heights", shape=(4,))
    had_road = c.state("road.had", "1", "whether they were known")

    between = ca.logic_and(used, had_road > 0.5)
    rate = ca.if_else(between, (road - last_road) / period, 0)

    def chosen(values: Callable[[Filter], np.ndarray]) -> Any:
        return ca.if_else(between, ca.DM(values(rest)), ca.DM(values(unknown)))

    def whitened(f: Filter) -> tuple[np.ndarray, np.ndarray]:
        """Rows of C for measurements with unit noise, and what makes measurements such."""
        inverse = np.linalg.inv(np.linalg.cholesky(f.model.R))
        return inverse @ m.C, inverse

    lost = _Tension(c, car, period)
    seen = last_y - ca.DM(m.D) @ last_u - ca.DM(m.F) @ rate - ca.DM(lost.measured) @ lost.force(x, between)
    gain, left = _sequential(covariance, chosen(lambda f: whitened(f)[0]))
    gain = ca.if_else(varying > 0.5, gain @ chosen(lambda f: whitened(f)[1]), chosen(lambda f: f.gain))
    corrected = x + gain @ (seen - ca.DM(m.C) @ x)
    A = chosen(lambda f: f.A)
    driven = ca.DM(m.B) @ ((last_u + u) / 2) + ca.DM(m.E) @ rate + ca.DM(lost.driving) @ lost.force(corrected, between)
    predicted = A @ corrected + driven + chosen(lambda f: f.Y) @ seen
    prior = ca.if_else(begun > 0.5, predicted, x)
    spread = A @ left @ A.T + chosen(lambda f: f.Q)
    spread = ca.if_else(begun > 0.5, (spread + spread.T) / 2, covariance)
    updates = {x: prior, covariance: spread, last_y: y, last_u: u, last_road: road, had_road: ca.if_else(used, 1, 0)}
    for state, value in {**updates, begun: 1}.items():
        c.update(state, value)

    # --------------------------------------------------------------- this sample, whose road's rate nobody knows as yet

    rows, root = whitened(unknown)
    gain_now, posterior_now = _sequential(spread, ca.DM(rows))
    steady = [correction(f.prior, m.C, m.R) for f in filters]
    gain = ca.if_else(varying > 0.5, gain_now @ ca.DM(root), ca.if_else(used, ca.DM(steady[1][0]), ca.DM(steady[0][0])))
    variance = ca.if_else(used, ca.DM(np.diag(steady[1][1])), ca.DM(np.diag(steady[0][1])))
    variance = ca.if_else(varying > 0.5, ca.diag(posterior_now), variance)
    expected = ca.DM(m.C) @ prior + ca.DM(m.D) @ u + ca.DM(lost.measured) @ lost.force(prior, used)
    estimate = prior + gain @ (y - expected)

    # ------------------------------------------------------------------------------------------------------------ pose

    pose = c.state("pose.last", None, "pose of the sample before", shape=(3,))
    rates_last = c.state("pose.rates", None, "its rates", shape=(3,))
    rates = estimate[[RELATIVE_STATES.index(r) for r in POSE_RATES]]
    moved = pose + period / 2 * (rates + rates_last)
    deflections = (estimate[[RELATIVE_STATES.index(r) for r in group]] for group in (SUSPENSION, TIRE))
    on_road = ca.DM(np.linalg.pinv(_corner_heights(car))) @ (sum(deflections) + road)
    now = moved - period / leak * moved + ca.if_else(used, period / follow, 0) * (on_road - moved)
    c.update(pose, now)
    c.update(rates_last, rates)

    _estimate_outputs(c, car, RELATIVE_STATES, estimate)
    _pose_outputs(c, car, now)
    C, D, _ = relative_model(car).output(("body.az",))
    c.output("body.az", ca.DM(C) @ estimate + ca.DM(D) @ u, "m/s2", "vertical acceleration of the CG, of the model")
    _deviation_outputs(c, car, [ca.sqrt(ca.fmax(0, variance[i])) for i in range(len(RELATIVE_STATES))])
    c.output("road.used", used, None, "the road under the wheels is used now", type=bool)
    c.provenance = {"car": car.name, "sensors": sensors.name, "period": period, "gain": unknown.gain.tolist()}
    c.reference_input(_reference_inputs())
    return c


@component("Kalman{v}Printed", "Kalman filter of 14 absolute states, as printed (paper 001)", of="ride_car_hmmwv")
def kalman_hmmwv_printed(
    car: Component, sensors: SensorSet, name: str = "KalmanHmmwvPrinted", *, period: float = SAMPLE_TIME
) -> Component:
    """The paper's form: the car's 14 absolute states, observable because the road is assumed at height 0."""
    f, by_height = absolute_filter(car, sensors, sensors.estimator.road.value, period)
    states = car.linearize().states
    c = _component(
        name,
        period,
        "Kalman filter of the 14 absolute states of a ride car that assumes a flat road",
        "001 section 1.4: 14 states on a model of 7 degrees of freedom",
        _NOTES_PRINTED,
    )
    use_road = _road_parameter(c)
    y, u = _measured_inputs(c)
    road, road_valid = _road_inputs(c)
    used = ca.logic_and(use_road > 0.5, road_valid)
    assumed = ca.if_else(used, road, 0)

    x = _estimate_state(c, tuple(states))
    last_road = c.state("road.last", "m", "road heights of the sample before", shape=(4,), start=assumed)
    rate = (assumed - last_road) / period
    c.update(last_road, assumed)
    m = f.model
    prior = x + ca.DM(by_height.E) @ last_road + ca.DM(m.E) @ rate
    shown = y - ca.DM(m.D) @ u - ca.DM(by_height.F) @ assumed - ca.DM(m.F) @ rate
    estimate = prior + ca.DM(f.gain) @ (shown - ca.DM(m.C) @ prior)
    # without the road's part of it, which is known one sample later
    c.update(x, ca.DM(f.A) @ estimate + ca.DM(m.B) @ u + ca.DM(f.Y) @ shown)

    lin = car.linearize()
    rows = [lin.outputs.index(n) for n in RELATIVE_STATES]
    heights = [lin.inputs.index(n) for n in ROAD_HEIGHTS]
    T, R = lin.C[rows], lin.D[np.ix_(rows, heights)]
    _estimate_outputs(c, car, RELATIVE_STATES, ca.DM(T) @ estimate + ca.DM(R) @ assumed)
    _pose_outputs(c, car, estimate[[states.index(n) for n in POSE]])
    row, forces = lin.outputs.index("body.az"), [lin.inputs.index(n) for n in FORCES]
    az = ca.DM(lin.C[row][None]) @ estimate + ca.DM(lin.D[row, forces][None]) @ u
    c.output("body.az", az, "m/s2", "vertical acceleration of the CG, of the model")
    sigma = np.sqrt(np.diag(T @ correction(f.prior, m.C, m.R)[1] @ T.T))
    _deviation_outputs(c, car, sigma, ", were the road flat")
    c.output("road.used", used, None, "the road under the wheels is used now", type=bool)
    c.provenance = {"car": car.name, "sensors": sensors.name, "period": period, "gain": f.gain.tolist()}
    c.reference_input(_reference_inputs())
    return c


# ------------------------------------------------------------------------------------------------------ what both share


def _component(name: str, period: float, description: str, source: str, notes: tuple[str, ...]) -> Component:
    return Component(
        name, kind="discrete", sample_time=period, description=description, source=source, symbols=ca.MX, notes=notes
    )


def _road_parameter(c: Component) -> Any:
    return c.parameter("use_road", False, None, "use road.*.height where road.valid", source="option")


def _measured_inputs(c: Component) -> tuple[Any, Any]:
    """Inputs of the twelve measurements and of the four forces, as columns."""
    forces = [c.input(f"loadcell.{k}", "N", f"measured force of the actuator at {k}") for k in CORNERS]
    units = {"lvdt": "m", "hub": "m/s2", "chassis": "m/s2", "gyro": "rad/s"}
    measured = [c.input(s, units[s.split(".")[0]], f"measurement {s}") for s in _SENSORS]
    return ca.vertcat(*measured), ca.vertcat(*forces)


def _road_inputs(c: Component) -> tuple[Any, Any]:
    road = [c.input(f"road.{k}.height", "m", f"height of the road under the {k} wheel now, if known") for k in CORNERS]
    return ca.vertcat(*road), c.input("road.valid", None, "road.*.height is known", start=True, type=bool) > 0.5


def _estimate_state(c: Component, names: tuple[str, ...]) -> Any:
    return c.state("estimate", None, f"prediction of {names[0]} ... {names[-1]}", shape=(len(names),), nominal=0.1)


def _estimate_outputs(c: Component, car: Component, names: tuple[str, ...], values: Any) -> None:
    for i, name in enumerate(names):
        v = car.variable(name)
        c.output(name, values[i], v.unit, f"estimate: {v.description}", display_unit=v.display_unit)


def _deviation_outputs(c: Component, car: Component, sigma: Iterable[Any], when: str = "") -> None:
    """Standard deviations of the relative states."""
    for state, value in zip(RELATIVE_STATES, sigma, strict=True):
        v = car.variable(state)
        c.output(f"sigma.{state}", value, v.unit, f"standard deviation of {state}{when}", display_unit=v.display_unit)


def _pose_outputs(c: Component, car: Component, values: Any) -> None:
    for i, name in enumerate(POSE):
        v = car.variable(name)
        c.output(name, values[i], v.unit, f"estimate: {v.description}", display_unit=v.display_unit)


def _sequential(covariance: Any, C: Any) -> tuple[Any, Any]:
    """Gain and covariance after measurements with unit noise, taken one after the other: no matrix is inverted.

    The gain is for all innovations at once, against the prediction before any of them.
    """
    P, gain = covariance, ca.MX.zeros(C.shape[1], 0)
    for i in range(C.shape[0]):
        h = C[i, :]
        Ph = P @ h.T
        k = Ph / (h @ Ph + 1)
        gain = ca.horzcat(gain - k @ (h @ gain), k)
        P = P - k @ Ph.T
    return gain, P


class _Tension:
    """Tension that the linear tires take and those of the car do not, once they have lost their static load.

    `force(x, known)` (4,) [N] on the wheels, for estimates x; `driving` (15, 4) and `measured` (12, 4) are what
    it does to the states over a sample and to the measurements.
    """

    def __init__(self, c: Component, car: Component, period: float) -> None:
        model, lin = relative_model(car), car.linearize()
        wheels = [RELATIVE_STATES.index(f"wheel.{k}.vz") for k in CORNERS]
        self._tires = [RELATIVE_STATES.index(n) for n in TIRE]
        per_mass = -model.B[wheels, range(4)]  # an actuator force pushes the wheel down
        self._stiffness = -model.A[wheels, self._tires] / per_mass
        plant = car.model()
        at_rest = np.asarray(
            plant.functions["out"](0.0, np.zeros(len(lin.states)), plant.vector("input"), plant.vector("parameter"))
        )
        slots = {e.name: e.slot for e in plant.elements("output")}
        self._static = at_rest.ravel()[[slots[f"tire.{k}.force"] for k in CORNERS]]
        self._lifting = c.parameter(
            "tires.lift_off",
            bool(car.variable("tires.lift_off").start[0]),  # type: ignore[index]
            None,
            "on a known road the tires of the model take no tension",
            tunable=True,
            source="vehicle file",
        )
        inputs = np.zeros((15, 4))
        inputs[wheels, range(4)] = per_mass
        block = np.zeros((19, 19))
        block[:15] = np.hstack([model.A, inputs])
        self.driving = scipy.linalg.expm(block * period)[:15, 15:]
        self.measured = np.zeros((len(_SENSORS), 4))
        self.measured[[_SENSORS.index(f"hub.{k}.az") for k in CORNERS], range(4)] = per_mass

    def force(self, x: Any, known: Any) -> Any:
        """Tension [N] of each tire that is to be taken off, 0 while the road is not `known`.

        Without the road nothing measures the gap under a wheel in the air: the tension would feed on its own estimate
        and grow without bound. The gap that counts is limited for the same reason.
        """
        stiffness = ca.DM(self._stiffness)
        beyond = ca.fmin(stiffness * x[self._tires] - ca.DM(self._static), stiffness * LARGEST_GAP)
        return ca.if_else(ca.logic_and(self._lifting > 0.5, known), ca.fmax(beyond, 0), 0)


def _corner_heights(car: Component) -> np.ndarray:
    """Heights of the body above the wheels (4,) per heave, roll and pitch."""
    lin = car.linearize()
    rows = [lin.outputs.index(n) for n in SUSPENSION]
    return lin.C[np.ix_(rows, [lin.states.index(n) for n in POSE])]


def _start_covariance(names: tuple[str, ...]) -> np.ndarray:
    return np.diag([START_SIGMA[n.rsplit("_", 1)[-1].rsplit(".", 1)[-1]] ** 2 for n in names])


def _reference_inputs() -> dict[str, Callable[[float], float]]:
    def wave(amplitude: float, rate: float, phase: float) -> Callable[[float], float]:
        return lambda t: amplitude * math.sin(rate * t + phase)

    size = {"lvdt": 0.02, "hub": 5.0, "chassis": 1.0, "gyro": 0.05}
    signals = {s: wave(size[s.split(".")[0]], 9.0 + i, 0.4 * i) for i, s in enumerate(_SENSORS)}
    for i, k in enumerate(CORNERS):
        signals[f"loadcell.{k}"] = wave(500.0, 7.0 + i, i)
        signals[f"road.{k}.height"] = wave(0.02, 8.0, 0.5 * i)
    return signals


_NOTES = (
    (
        "The filter's model is the linear model of RideCarHmmwv in relative coordinates: four suspension and four tire"
        " deflections, four wheel and three body velocities. Heights above a datum cannot be measured on a moving car"
        " and are not among its states. The road's rate under each wheel is white noise, held over a sample, with the"
        " intensity of the sensor file (0.007 m2/s); load cells are measured inputs whose noise reaches model and"
        " accelerometers alike, which the filter knows (cross-covariance)."
    ),
    (
        "Outputs at t use the measurements at t. sigma.* are the standard deviations of the estimates as the filter"
        " itself computes them; with time_varying the covariance starts from 30 mm, 0.5 m/s, 0.3 rad/s and is carried"
        " along, and the gain follows from it; without, both are those of the steady state, which all but body.vz reach"
        " within some tenths of a second; body.vz takes seconds."
    ),
    (
        "use_road: road.*.height is the road under the wheels now (from PreviewBuffer by a connection with delay; the"
        " buffer gives the road one sample ahead to make up for it). Where road.valid, its differences drive the model"
        " and only a remainder of the road's rate (0.001 m2/s) is noise; elsewhere the filter continues as without a"
        " road. The rate over a sample is known at its end, so each measurement is weighted again one sample later."
    ),
    (
        "Between samples forces are the mean of both ends. tires.lift_off: a tire of the model that has lost its static"
        " load takes no tension, as in RideCarHmmwv: the excess of the linear model is subtracted, the gain stays the"
        " same. It matters on a known road; without one, the accelerometer of an airborne wheel does not tell how high"
        " it is."
    ),
    (
        "body.z, body.roll, body.pitch: the integrals of the estimated rates, which fade within pose.leak (5 s), so a"
        " slope or a step of the road is forgotten; a pose that lasts is not observable without road. On a known road"
        " they also follow, within pose.correction (1 s), the pose that suspension, tires and road give. Following it"
        " at once is unstable: an error of the buffered road tilts the pose when the wheels reach it, and the range"
        " sensors, ahead of the front axle, put it into the buffer again 1.6 times as large."
    ),
    (
        "Noise levels and the road's intensity are build options (fmu_sources/vehicles/sensors_hmmwv.toml): gains"
        " follow from them. Friction and flow limits of the actuators do not matter here, since forces are measured."
    ),
)
_NOTES_PRINTED = (
    (
        "The paper's form, for comparison: heights of body and wheels are states, and they are observable only because"
        " the road is assumed at height 0 under every wheel. Over a bump tire deflections are wrong by most of"
        " their size, and so is the pose: (1.18) then sees a dip behind the bump that is not there. Use KalmanHmmwv for"
        " control."
    ),
    (
        "Process noise: the road's rate through the damping of the tires, with the same intensity as in KalmanHmmwv,"
        " and the load cells. use_road feeds road.*.height as the known height of the road; with PreviewBuffer that"
        " closes the loop which the paper reports to be unstable."
    ),
    "sigma.* is the standard deviation under the filter's assumptions; on a road that is not flat the errors are far"
    " larger.",
)
