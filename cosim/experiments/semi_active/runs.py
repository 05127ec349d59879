"""Runs of the HMMWV with passive dampers, semi-active dampers and ideal actuators: wired and measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np

from build_fmus.base import surface
from cosim import System
from cosim.core.signals import columns, rms
from cosim.experiments.hmmwv.wiring import BUMPS, FIRST_BUMP, add_car, bump_parameters, published
from cosim.experiments.options import AtSpeed, quantity, speed_option, terrain_option
from cosim.experiments.steps import Stepped, exchange_step, set_solver_step
from cosim.study import CaseError, FmuSet, Metric, Row, Run, option
from fmu_sources.controllers.lq.hmmwv import lqr_gain, weighted_outputs
from fmu_sources.controllers.semi_active import HOOKS, PERIOD, WEIGHTS
from fmu_sources.models.comfort import weighted_acceleration
from fmu_sources.models.corners import CORNERS
from fmu_sources.plants import ride_car
from fmu_sources.roads.iso8608 import CLASSES
from fmu_sources.vehicles import load_ride_car

CONTROLLERS: dict[str, tuple[str, dict[str, Any]]] = {
    "passive": ("", {}),
    "skyhook": ("SemiActiveSkyhook", {"on_off": False}),
    "skyhook-on-off": ("SemiActiveSkyhook", {"on_off": True}),
    "groundhook": ("SemiActiveGroundhook", {"on_off": False}),
    "groundhook-on-off": ("SemiActiveGroundhook", {"on_off": True}),
    "add": ("SemiActiveAdd", {}),
    "sh-add": ("SemiActiveShAdd", {}),
    "lqr": ("SemiActiveLqr", {}),
    "mpc": ("SemiActiveMpc", {}),
}
"""Name -> FMU, parameters."""
IDEAL = ("skyhook", "lqr", "mpc")  # request a force that damps body and wheels by itself
TUNED = ("passive", "skyhook", "skyhook-on-off", "lqr")  # between comfort and road holding
ACTUATORS = ("dampers", "ideal")
ROADS = {"random": "RoadOffroadHmmwv", "bump": "RoadBumps", "rig": "RoadOffroadHmmwv"}
DAMPER = "SemiActiveDamper"
FLAGS = {
    "controller.command.held": "command.held: the solver found no solution at some samples; the last command was kept"
}
FMUS = (
    *("SpeedProfile", "RideCarHmmwv", DAMPER, *dict.fromkeys(ROADS.values())),
    *dict.fromkeys(fmu for fmu, _ in CONTROLLERS.values() if fmu),
)
EXCHANGE = Fraction(1, 1000)  # s, of car and dampers
RATE = 1000.0  # Hz, of all metrics
DURATION = {"random": 24.0, "bump": 3.0, "rig": 60.0}  # s
SETTLED = {"random": 3.0, "bump": 0.0, "rig": 3.0}  # s, where metrics begin: behind the ramp of the road
FLAT, RAMP = 5.0, 10.0  # m, how a random road starts
STRETCHES, STRETCH = 3, 340.0  # stretches of the random road that do not overlap, m
SOFTEST, HARDEST = 1500.0, 20000.0  # N.s/m, passive dampers from comfort to road holding
TIRE = (1e2, 1e7)  # 1/m2, weight of the tires in the LQR from comfort to road holding
SEGMENT = 4.0  # s, of spectra


@dataclass(frozen=True)
class Case(AtSpeed, Stepped):
    """One run of the car."""

    controller: str = option("sh-add", choices=CONTROLLERS, help="control law of the dampers", always=True)
    actuators: str = option(
        "dampers", choices=ACTUATORS, help="semi-active dampers, or ideal actuators that give any force", always=True
    )
    road: str = option(
        "random", choices=ROADS, help="road; rig: all wheels on the random road of the front left one", always=True
    )
    speed_kmh: float = speed_option(50.0, (5, 100), always=False)
    terrain: str = terrain_option("D", CLASSES, "a random road")
    stretch: int = option(0, within=(0, STRETCHES - 1), label="stretch{}", help="stretch of a random road")
    road_holding: float | None = quantity(
        "road holding",
        None,
        (0, 1),
        "from comfort (0) to road holding (1); by default as in the FMU",
        label="{:.2g}-road-holding",
    )
    hysteresis: bool = option(True, help="hysteresis of the semi-active dampers")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.actuators == "ideal" and self.controller not in IDEAL:
            raise CaseError(
                f"{self.controller} does not damp the car without dampers: give {surface.given(actuators='dampers')}"
            )
        if self.road_holding is not None and self.controller not in TUNED:
            raise CaseError(f"{self.controller} is not tuned between comfort and road holding: {', '.join(TUNED)} are")


def passive(case: Case) -> Case:
    """What a run is compared with."""
    return replace(case, controller="passive", actuators="dampers", road_holding=None, hysteresis=True)


# ------------------------------------------------------------------------------------------------------------- wiring


def structure(case: Case) -> tuple[object, ...]:
    """What decides the wiring."""
    return CONTROLLERS[case.controller][0], case.actuators, ROADS[case.road], case.road == "rig", case.exchange_parts


def wire(fmus: FmuSet, case: Case) -> System:
    """Road, car, four dampers or ideal actuators, controller."""
    system = System()
    step = exchange_step(EXCHANGE, case)
    add_car(system, fmus, ROADS[case.road], step=step, rig=case.road == "rig")
    controller = CONTROLLERS[case.controller][0]
    if not controller:
        system["car"].set({f"force.{k}": 0.0 for k in CORNERS})
        return system
    system.add("controller", fmus.path(controller))
    system.connect_matching("car", "controller")
    if case.actuators == "ideal":
        system.connect_matching("controller", "car", "force.*")
        return system
    for k in CORNERS:
        damper = f"damper_{k}"
        system.add(damper, fmus.path(DAMPER), step=step)
        for signal_ in ("velocity", "deflection"):
            system.connect(f"car.suspension.{k}.{signal_}", f"{damper}.suspension.{signal_}", extrapolate=True)
        system.connect(f"{damper}.force", f"car.force.{k}", extrapolate=True)
        system.connect(f"controller.current.{k}", f"{damper}.current")
    system.group("vehicle", ["car", *(f"damper_{k}" for k in CORNERS)])
    return system


@cache
def tuned_gain(road_holding: float) -> np.ndarray:
    """Gain (4, 15) of the LQR with the weight of the tires between those of `TIRE`, designed on the published car."""
    low, high = TIRE
    weights = replace(WEIGHTS, tire=low * (high / low) ** road_holding)
    return lqr_gain(ride_car(load_ride_car("ride_car_hmmwv"), name="RideCarHmmwv"), weights, PERIOD)[0]


def configure(system: System, case: Case) -> None:
    """Set the parameters of a case."""
    begin = FIRST_BUMP - published(system["car"], "wheel.fl.x") - 0.6 * case.speed if case.road == "bump" else 0.0
    system["speed"].set({"start.speed": case.speed, "start.x": begin})
    if case.road == "bump":
        system["road"].set(bump_parameters(BUMPS["bump"]))
    else:
        profile = {"class": CLASSES.index(case.terrain), "offset": case.stretch * STRETCH}
        system["road"].set({**profile, "flat": FLAT, "ramp": RAMP})
    configure_vehicle(system, case)


def configure_vehicle(system: System, case: Case) -> None:
    """What of a case concerns car, dampers and controller, on any road."""
    car = system["car"]
    set_solver_step(car, case)
    t = case.road_holding
    own = case.controller == "passive"
    for k in CORNERS:
        damping = published(car, f"suspension.{k}.damping") if t is None else SOFTEST * (HARDEST / SOFTEST) ** t
        car.set({f"suspension.{k}.damping": damping if own else 0.0})
    if own:
        return
    controller = system["controller"]
    parameters = dict(CONTROLLERS[case.controller][1])
    if "passive" in controller.description.parameters:
        parameters["passive"] = case.actuators == "dampers"
    if case.controller.startswith(("skyhook", "groundhook")):
        for i, n in enumerate(("damping.sky", "damping.ground")):
            value = published(controller, n)
            parameters[n] = value if t is None else (1 - t) * HOOKS["sky"][i] + t * HOOKS["ground"][i]
    if case.controller == "lqr":
        names = [n for n in controller.description.parameters if n.startswith("gain[")]
        gains = [published(controller, n) for n in names] if t is None else tuned_gain(t).ravel().tolist()
        parameters |= dict(zip(names, gains, strict=True))
    controller.set(parameters)
    for k in CORNERS if case.actuators == "dampers" else ():
        damper = system[f"damper_{k}"]
        shift = published(damper, "hysteresis.speed") if case.hysteresis else 0.0
        damper.set({"hysteresis.speed": shift})
        set_solver_step(damper, case)


def stop_time(_: System, case: Case) -> float:
    """Length of a run [s]."""
    return DURATION[case.road]


INDEX = weighted_outputs(WEIGHTS)


def recorded(case: Case) -> Sequence[str]:
    """What is recorded."""
    names = ["road.road.fl.rate", "car.seat.az", *(f"car.{n}" for n in INDEX)]
    names += [f"car.suspension.{k}.velocity" for k in CORNERS]
    if case.controller != "passive":
        names += ["controller.*"]
        if case.actuators == "dampers":
            names += [f"damper_{k}.*" for k in CORNERS]
    return names


# ---------------------------------------------------------------------------------------------------------- measuring

METRICS = {
    "body_rms": Metric("rms acceleration of the body", "m/s2", form="{:.3f}"),
    "iso2631_rms": Metric("ISO 2631-1 weighted rms of the seat", "m/s2", form="{:.3f}"),
    "tire_rms": Metric("rms tire deflection", "mm", 1e3, "{:.2f}"),
    "travel_rms": Metric("rms suspension travel", "mm", 1e3, "{:.1f}"),
    "index": Metric("index of the LQR without the force", "", form="{:.2f}"),
    "force_rms": Metric("rms force of a damper or actuator", "N", form="{:.0f}"),
    "power_taken": Metric("power that dampers or actuators take from the car", "W", form="{:.0f}"),
    "power_given": Metric("power that they give to it", "W", form="{:.1f}"),
    "power_bought": Metric("power from outside, of coils or actuators", "W", form="{:.1f}"),
    "power_coil": Metric("electrical power of the coils", "W", form="{:.1f}"),
}


def measure(run: Run) -> Row:
    """`METRICS` in SI units; powers are means over time of all corners, given and taken apart.

    Those of dampers are by their own velocity: that of the car differs by the error of the exchange.
    """
    case, r = run.case, run.recording
    counts = np.asarray(r.time >= SETTLED[case.road])

    def at_corners(pattern: str) -> np.ndarray:
        return columns(r, pattern, CORNERS)[counts]

    rate = at_corners("car.suspension.{}.velocity")
    if case.controller == "passive":
        damping = [run.start(f"car.suspension.{k}.damping") for k in CORNERS]
        force, coil = -np.array(damping) * rate, 0.0
    else:
        force = at_corners("damper_{}.force" if case.actuators == "dampers" else "controller.force.{}")
        coil = float(at_corners("damper_{}.coil.power").sum(axis=1).mean()) if case.actuators == "dampers" else 0.0
    power = at_corners("damper_{}.power") if "damper_fl.power" in r else force * rate
    given = float(np.maximum(power, 0.0).sum(axis=1).mean())
    row: Row = {
        "body_rms": rms(r["car.body.az"][counts]),
        "iso2631_rms": rms(weighted_acceleration(r["car.seat.az"], RATE)[counts]),
        "tire_rms": rms(at_corners("car.tire.{}.deflection")),
        "travel_rms": rms(at_corners("car.suspension.{}.deflection")),
        "index": float(sum(w * rms(r[f"car.{n}"][counts]) ** 2 for n, w in INDEX.items())),
        "force_rms": rms(force),
        "power_taken": float(np.maximum(-power, 0.0).sum(axis=1).mean()),
        "power_given": given,
        "power_bought": given if case.actuators == "ideal" else coil,
        "power_coil": coil,
    }
    if "controller.solver.status" in r:
        row |= {f"solver.{n}": float(np.max(r[f"controller.solver.{n}"])) for n in ("status", "residual")}
    if case.road == "rig":
        row |= _bands(*_gains(run))
    return row


BANDS = {"body": (1.0, 2.5), "between": (3.0, 7.0), "wheel": (8.0, 14.0)}
"""Bands of frequency [Hz]: about the resonances of body and wheel, and between them."""


def _gains(run: Run) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Frequencies [Hz], and amplitude over that of the road's rate, of acceleration [1/s] and tire deflection [s].

    Square roots of the ratio of spectra (Welch): for a control law that is not linear too, all power that the road
    causes counts.
    """
    from scipy.signal import welch  # half a second, of all commands that know this experiment

    r, per = run.recording, int(SEGMENT * RATE)
    begin = int(SETTLED[run.case.road] * RATE)
    spectra = {
        n: welch(r[column][begin:], RATE, nperseg=per)
        for n, column in (
            ("road", "road.road.fl.rate"),
            ("acceleration", "car.body.az"),
            ("tire", "car.tire.fl.deflection"),
        )
    }
    f, road = spectra.pop("road")
    keep = (f >= 0.5) & (f <= 20.0)
    return f[keep], {n: np.sqrt(s[keep] / road[keep]) for n, (_, s) in spectra.items()}


def _bands(f: np.ndarray, gains: dict[str, np.ndarray]) -> Row:
    """The rms gain of each of `BANDS`, and that of the acceleration at the frequency of `invariant`."""
    at = int(np.argmin(np.abs(f - invariant()[0])))
    return {"acceleration_invariant": float(gains["acceleration"][at])} | {
        f"{n}_{band}": rms(g[(f >= low) & (f <= high)]) for n, g in gains.items() for band, (low, high) in BANDS.items()
    }


@cache
def invariant() -> tuple[float, float]:
    """Frequency [Hz] at which no suspension changes the acceleration of the body, and the gain there [1/s].

    Forces of the suspension cancel in the sum over body and wheel, m_s a_s + m_u a_u = k_t (r - z_u). At omega^2 =
    k_t / m_u the wheel's own terms cancel, and m_s a_s = k_t r (Hedrick, Butsuen 1990).
    """
    car = load_ride_car("ride_car_hmmwv")
    stiffness, wheel = car.tire.front.stiffness.value, car.wheel.front.mass.value
    omega = np.sqrt(stiffness / wheel)
    return float(omega / 2 / np.pi), float(stiffness / (car.body.mass.value / len(CORNERS)) / omega)


def signals(run: Run) -> Row:
    """Gains over frequency on the rig; force and velocity of a damper, every 4 ms of 4 s, elsewhere."""
    if run.case.road == "rig":
        f, gains = _gains(run)
        return {"frequency": f.tolist(), **{n: g.tolist() for n, g in gains.items()}}
    r = run.recording
    begin = int(SETTLED[run.case.road] * RATE)
    part = slice(begin, begin + int(4 * RATE), 4)
    names = {"velocity": "car.suspension.fl.velocity", "force": "damper_fl.force", "acceleration": "car.body.az"}
    shown = {n: r[c][part].tolist() for n, c in names.items() if c in r}
    return {"time": (r.time[part] - r.time[begin]).tolist(), **shown}
