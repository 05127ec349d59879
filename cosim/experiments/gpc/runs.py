"""Runs of paper 000: a nonlinear HMMWV on three roads, passive and under three GPC controllers, wired and measured."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from cosim import Recording, StopWhen, System
from cosim.core.signals import columns, peak, rms
from cosim.experiments.gpc.assumed import Drop, EarlySample, MeasuredRoad, built_controller, insert, other_road
from cosim.experiments.metrics import response as metrics
from cosim.experiments.options import Controlled, quantity, speed_option
from cosim.experiments.steps import Stepped, exchange_step, set_solver_step
from cosim.fmu.file import FmuFile
from cosim.study import FmuSet, Metric, Row, Run, option
from fmu_sources.controllers.gpc.component import FORCE_LIMIT, RESPONSE_TICK, SAMPLE_TIME, gain_parameters
from fmu_sources.controllers.gpc.control_law import GpcLaw
from fmu_sources.controllers.gpc.identification import (
    DISTURBANCES,
    DesignSettings,
    IdentificationSettings,
    IdentifiedModels,
    connect_road,
    identify,
    track_of,
)
from fmu_sources.models.corners import CORNERS

PLANT, SPEED = "FullCarHmmwvModified", "SpeedProfile"
ROADS = {"sine": "RoadSine", "curb": "RoadCurb", "perryman3": "RoadPerryman3"}
CONTROLLERS = {"passive": None, "implicit": "GpcImplicit", "explicit": "GpcExplicit", "preview": "GpcPreview"}
FMUS = (PLANT, SPEED, *ROADS.values(), *(c for c in CONTROLLERS.values() if c))
R_PUBLISHED = 1e-7  # 1/N2
TRAVEL = 150.0  # m, length of every run
SAMPLE_RATE = 100.0  # Hz, of all metrics
COURSE = "perryman3"  # on which controllers are identified
HORIZON = DesignSettings().h_p
PREVIEW = (HORIZON, SAMPLE_TIME)
EXCHANGE = Fraction(1, 1000)  # s, between car, road and controller


_CONTROLLED = (lambda c: c.controller != "passive", "a controlled car")
_MEASURING = (lambda c: c.controller in ("explicit", "preview"), "the explicit and the preview controller")


@dataclass(frozen=True, kw_only=True)
class OpenCase(Controlled):
    """What the paper leaves open; the defaults are the reading of the main study."""

    hold: bool = option(
        False,
        help="explicit only: let the last road height continue ahead",
        only=(lambda c: c.controller == "explicit", "the explicit controller"),
    )
    disturbance: str = option(
        "height",
        choices=DISTURBANCES,
        help="quantity of the road that explicit and preview measure",
        label="d-is-{}",
        only=_MEASURING,
    )
    from_rest: bool = option(False, help="identify from rest, with the leading zeros of equation (4)", only=_CONTROLLED)
    excitation: float = option(
        IdentificationSettings().excitation,
        unit="N",
        within=(1.0, 1e5),
        help="standard deviation of each actuator's force in the identification run",
        label="excited-{:g}N",
        only=_CONTROLLED,
    )
    roll_off: float = option(
        0.0,
        unit="Hz",
        within=(0.0, 50.0),
        help="corner frequency of the excitation; 0: white up to 50 Hz",
        label="roll-off-{:g}Hz",
        only=_CONTROLLED,
    )
    horizon: int = option(
        HORIZON,
        choices=(HORIZON, 2 * HORIZON),
        help="prediction horizon in samples, with as many of preview; only 8 is the paper's",
        label="horizon-{}",
        only=_CONTROLLED,
    )
    sampled_after: int = option(
        RESPONSE_TICK,
        choices=(0, RESPONSE_TICK),
        unit="ms",
        help="time after a command at which the controllers sample responses",
        label="sampled-after-{}ms",
        only=_CONTROLLED,
    )
    datum: float = option(
        0.0,
        unit="m",
        within=(-10.0, 10.0),
        help="height of the road at the start that the controllers do not subtract; 0: trimmed",
        label="datum-{:g}m",
        only=_MEASURING,
    )
    actuator: str = option(
        "wheel",
        choices=("wheel", "spring"),
        help="where the actuator acts: between wheel and body, or beside the spring, through its motion ratio",
        label="actuator-at-{}",
        only=_CONTROLLED,
    )
    limit: float = quantity(
        "limit [N]", FORCE_LIMIT, (1.0, 1e7), "force limit of each actuator", _CONTROLLED, "limit-{:g}N"
    )
    road_roll_off: float = option(
        0.0,
        unit="1/m",
        within=(0.0, 4.0),
        help="wave number above which the spectrum of the synthetic course falls two orders steeper; 0: nowhere",
        label="smoother-above-{:g}",
        only=(lambda c: c.controller != "passive" or c.road == COURSE, "controllers and that course"),
    )
    one_track: bool = option(False, help="one road profile under both sides of the car, that of the left")
    start_height: float = option(
        0.0,
        unit="m",
        within=(0.0, 0.5),
        help="height above its rest from which the car drops at the start",
        label="dropped-{:g}m",
    )


@dataclass(frozen=True)
class Case(OpenCase):
    """One run; `R` and `seed` matter for controlled runs only."""

    road: str = option("sine", choices=ROADS, files=".fmu", help="road under the wheels", always=True)
    speed_kmh: float = speed_option(50.0, (2, 200))
    controller: str = option("preview", choices=CONTROLLERS, help="control law", always=True)
    R: float = option(
        R_PUBLISHED, unit="1/N2", within=(1e-30, 1e30), name="weight", help="control weight R", label="R{:g}"
    )
    seed: int = option(0, within=(0, 2**31 - 1), help="seed of the identification run", label="seed{}")

    def passive(self) -> Case:
        """What a run is compared with: no controller, so no weight and no identification either."""
        return dataclasses.replace(super().passive(), R=R_PUBLISHED, seed=0)


OPEN = tuple(f for f in dataclasses.fields(OpenCase) if f.name not in Stepped.__dataclass_fields__)
"""Fields of a case that the paper leaves open."""

Assumed = tuple[tuple[str, Any], ...]  # values of open fields by name, those that are not the main study's


def assume(assumed: Assumed, case: Case) -> Case:
    """A case with other assumptions, of which those are kept that mean something for its controller."""
    rules = {f.name: f.metadata["option"].only for f in OPEN}
    kept = {name: value for name, value in assumed if rules[name] is None or rules[name][0](case)}
    return dataclasses.replace(case, **kept)


_ASSUMED = ("one_track", "disturbance", "horizon", "sampled_after", "datum", "actuator", "road_roll_off")
structure = attrgetter("road", "controller", "exchange_parts", *_ASSUMED, "start_height")
"""What of a case decides the wiring."""
_wired_from: WeakKeyDictionary[System, FmuSet] = WeakKeyDictionary()  # whose controllers are identified from them


def road_file(fmus: FmuSet, road: str) -> Path:
    """FMU of a road by its short name, or by its path."""
    return fmus.path(ROADS.get(road, road))


def wire(fmus: FmuSet, case: Case) -> System:
    """Car, road, speed profile and controller, as in the paper: car and exchange at 1 kHz, control at 100 Hz."""
    system = System(allow_unconnected=True)  # the driver keeps y = 0; nothing drives the passive car's actuators
    _wired_from[system] = fmus
    measured = MeasuredRoad(case.disturbance, case.datum, case.horizon)
    system.add("speed", fmus.path(SPEED))
    system.add("road", _road(fmus, case, case.road, measured.preview if case.controller == "preview" else PREVIEW))
    system.add("car", fmus.path(PLANT), step=exchange_step(EXCHANGE, case))
    system.connect("speed.speed", "car.target.speed")
    system.connect("car.x", "road.x")
    system.connect("car.speed", "road.speed")
    if case.start_height:
        insert(system, "drop", Drop(case.start_height), "car")
        connect_road(system, "drop", one_track=case.one_track)
    connect_road(system, "car", one_track=case.one_track)
    if name := CONTROLLERS[case.controller]:
        other = case.controller == "preview" and case.horizon != HORIZON
        system.add("controller", built_controller(control_law(fmus, case), fmus.fmi) if other else fmus.path(name))
        if case.sampled_after != RESPONSE_TICK:
            insert(system, "sampled_after", EarlySample(), "controller")
            system.connect_matching("car", "sampled_after")
        else:
            system.connect_matching("car", "controller", "body.*")
        if case.disturbance != "height" or case.datum:
            insert(system, "disturbance", measured, "controller")
            connect_road(system, "disturbance", "*", one_track=case.one_track)
            for k in CORNERS:
                before = f"road.road.{track_of(k, case.one_track)}.height"
                system.connect(before, f"disturbance.before.{k}", delay=True)
            system.connect("car.speed", "disturbance.speed")
            if case.controller == "preview" and measured.preview[1] == SAMPLE_TIME:
                system.connect("road.preview.step", "controller.preview.step")
        elif case.controller != "implicit":
            connect_road(system, "controller", "*", one_track=case.one_track)
        for k in CORNERS if case.actuator == "spring" else ():
            system.connect(f"controller.force.{k}", f"car.force.{k}", linear=(_lever(fmus, case), 0.0))
        if case.actuator == "wheel":
            system.connect_matching("controller", "car", "force.*")
    return system


def _road(fmus: FmuSet, case: Case, road: str, preview: tuple[int, float] = PREVIEW) -> Path:
    """FMU of a road as a case has it."""
    published, roll_off = road_file(fmus, road), case.road_roll_off if road == COURSE else 0.0
    return other_road(published, road, preview, roll_off, fmus.fmi) if roll_off or preview != PREVIEW else published


def _lever(fmus: FmuSet, case: Case) -> float:
    """Force on the wheel, of an actuator's force 1."""
    if case.actuator == "wheel":
        return 1.0
    return float(FmuFile(fmus.path(PLANT)).description.parameters["suspension.motion_ratio"].start)  # type: ignore[arg-type]


@cache
def models(plant: Path, road: Path, speed: Path, settings: IdentificationSettings) -> IdentifiedModels:
    """Models identified from these FMUs."""
    return identify(plant, road, speed, settings)


def identification(fmus: FmuSet, case: Case) -> IdentificationSettings:
    """The identification run of a case."""
    names = ("seed", "from_rest", "excitation", "roll_off", "one_track", "disturbance", "datum", "sampled_after")
    return IdentificationSettings(lever=_lever(fmus, case), **{name: getattr(case, name) for name in names})


def control_law(fmus: FmuSet, case: Case) -> GpcLaw:
    """The control law of a case, identified from these FMUs."""
    files = fmus.path(PLANT), _road(fmus, case, COURSE), fmus.path(SPEED)
    design = DesignSettings(R=case.R, h_p=case.horizon, h_c=case.horizon)
    return models(*files, identification(fmus, case)).law(case.controller, design, hold=case.hold)


def configure(system: System, case: Case) -> None:
    """Set the parameters of a case; the gains are those of a controller identified from these very FMUs."""
    set_solver_step(system["car"], case)
    system["speed"].set({"start.speed": case.speed_kmh / 3.6})
    if case.controller == "passive":
        return
    law = control_law(_wired_from[system], case)
    system["controller"].set({**gain_parameters(law), "limit": case.limit})
    if case.controller == "explicit":
        system["controller"].set({"hold_height": law.hold})


def stop_time(_: System, case: Case) -> float:
    """Longest run [s], for a car that is slowed down."""
    return 1.25 * TRAVEL / (case.speed_kmh / 3.6) + 1.0


def stop_when(system: System, _: Case) -> list[StopWhen]:
    """A run ends where the car has traveled its way."""
    start = float(system["car"].description.variables["start.x"].start)  # type: ignore[arg-type]
    return [StopWhen("car.x", ">=", start + TRAVEL)]


def recorded(case: Case) -> Sequence[str]:
    """What is recorded."""
    names = [f"car.{n}" for n in ("x", "speed", "body.z", "body.az", "body.pitch", "body.roll")]
    names += [f"car.{s}.{k}.{q}" for k in CORNERS for s, q in (("actuator", "power"), ("tire", "force"))]
    return names if case.controller == "passive" else [*names, *(f"controller.force.{k}" for k in CORNERS)]


METRICS = {
    "response": Metric("response objective J", form="{:.4f}"),
    "force": Metric("actuator force", "N", form="{:.0f}"),
    "power": Metric("actuator power", "W", form="{:.0f}"),
    "peak_force": Metric("peak force", "N", form="{:.0f}"),
    "rms_az": Metric("rms vertical acceleration", "m/s2", form="{:.3f}"),
    "rms_pitch": Metric("rms pitch", "rad", form="{:.5f}"),
    "rms_roll": Metric("rms roll", "rad", form="{:.5f}"),
    "improvement": Metric("response improvement", form="{:.3f}"),
}
"""What is compared between the controllers."""


def forces(recording: Recording) -> np.ndarray:
    """Commanded actuator forces (samples, 4) [N]; zero for the passive car."""
    return columns(recording, "controller.force.{}", CORNERS, optional=True)


def measure(run: Run) -> Row:
    """The published metrics of one run (equations 22a-c), and what else the claims need."""
    r = run.recording
    az, pitch, roll = (r[f"car.{n}"] for n in ("body.az", "body.pitch", "body.roll"))
    u = forces(r)
    return {
        "diverged": r.stopped_by is None,
        "response": metrics.response_objective(az, pitch, roll, SAMPLE_RATE),
        "force": metrics.actuator_force(u, SAMPLE_RATE),
        "power": metrics.actuator_power(columns(r, "car.actuator.{}.power", CORNERS), SAMPLE_RATE),
        "peak_force": peak(u),
        "peak_pitch": peak(pitch),
        "rms_az": rms(az),
        "rms_pitch": rms(pitch),
        "rms_roll": rms(roll),
    }


def compared(row: Row, baseline: Row) -> Row:
    """What a run gains on the passive car (23)."""
    return {"improvement": metrics.improvement(row["response"], baseline["response"])}


def failed(_: Case, error: Exception) -> Row:
    """Metrics of a run that a component ended: a closed loop that diverges is an outcome, and has no numbers."""
    return {"diverged": True, "reason": str(error)}


def remarks(run: Run) -> list[str]:
    """How much of the passive response is left is the published figure; a run that did not arrive says so."""
    return ["the run ended before its way was traveled"] if run.recording.stopped_by is None else []


def signals(run: Run) -> Row:
    """Signals of figures 8, 10 and 12 at 100 Hz: time [s], acceleration [m/s2], angles [deg], force [N]."""
    r: Any = run.recording
    shown = {
        "az": r["car.body.az"],
        "pitch": np.degrees(r["car.body.pitch"]),
        "roll": np.degrees(r["car.body.roll"]),
        "force": forces(r)[:, 0],
    }
    rounded = {k: [float(f"{x:.6g}") for x in v] for k, v in shown.items()}
    return {"time": np.round(r.time, 9).tolist(), **rounded}
