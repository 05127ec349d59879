"""Runs of paper 003's trench crossings: vehicle, crossing algorithm and controller, wired and measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from cosim import StopWhen, System
from cosim.core.signals import columns, peak
from cosim.experiments.metrics.crossing import LABELS, LIMITS, PSD_RATE, Crossing, cost, crossing, failures, psd
from cosim.experiments.options import AtSpeed, Controlled, speed_option
from cosim.experiments.steps import exchange_step
from cosim.recording.peaks import keep_peaks
from cosim.study import FmuSet, Metric, Row, Run, option
from fmu_sources.controllers.mpc.three_axle import SAMPLE_TIME
from fmu_sources.models.corners import SIX_CORNERS

# FMU, its parameters, whether it sees the road ahead
CONTROLLERS: dict[str, tuple[str, dict[str, Any], bool] | None] = {
    "passive": None,
    "mpc": ("MpcThreeAxle", {}, True),
    "mpc-no-preview": ("MpcThreeAxle", {}, False),
    "mpc-offsets": ("MpcThreeAxle", {"estimator": 1}, False),
    "mpc-free": ("MpcThreeAxle", {"retraction": 0}, True),
    "mpc-printed-sign": ("MpcThreeAxle", {"retraction": 2}, True),
    "mpc-no-height": ("MpcThreeAxle", {"hold_height": False}, True),
    "mpc-printed-limits": ("MpcThreeAxle", {"printed_limits": True}, True),
    "lqr": ("LqrThreeAxle", {}, False),
}
"""Kinds of control; what is not said of `mpc` holds for all of its variants."""

UNSEEING = tuple(name for name, kind in CONTROLLERS.items() if kind and not kind[2])
"""Those that do not see the road ahead."""

FMUS = ("ThreeAxleTrench", "TrenchCrossing", "MpcThreeAxle", "LqrThreeAxle")
MPC = {"estimator": 0, "retraction": 1, "hold_height": True, "printed_limits": False}
STEP = Fraction(1, 4000)  # s, of the vehicle's solver, its exchange and recordings; the study halves it
FRAME = Fraction(1, 50)  # s, between frames of an animation
RUN_OUT = 1.5  # m, that the last axle drives on behind the trench
LEAD = (0.6, 0.8)  # m, s times the speed: how far ahead of a trench the pitch reference begins
APPROACH = 0.2  # s, of level road before that
CLEAR = 0.3  # m, level road before the first thing that happens
TOUCH = 1.0  # N, body force that counts as contact


@dataclass(frozen=True)
class Case(AtSpeed, Controlled):
    """One run. None: as in the vehicle file."""

    length: float = option(1.6, unit="m", within=(0.2, 2.5), help="length of the trench", label="{:g}m", always=True)
    speed_kmh: float = speed_option(6.0, (0.5, 15))
    controller: str = option(
        "mpc",
        choices=CONTROLLERS,
        aliases=("control",),
        help="control law; mpc-...: mpc with one thing changed",
        always=True,
    )
    depth: float | None = option(None, unit="m", within=(0.01, 10), help="depth of the trench", label="{:g}m-deep")
    friction: float | None = option(
        None, within=(0.001, 2), help="friction coefficient of the tires", label="{:g}friction"
    )
    mass: float | None = option(None, unit="kg", within=(1, 1e5), help="sprung mass", label="{:g}kg")
    mass_factor: float = option(1.0, within=(0.1, 10), help="times the sprung mass", label="{:g}-times-mass")
    cg_offset: float | None = option(
        None, unit="m", within=(-0.5, 0.5), help="CG ahead of where the vehicle file has it", label="{:g}m-offset"
    )
    hydropneumatic: bool = option(False, help="gas springs instead of linear ones")
    spin: str = option(
        "body", choices=("body", "road"), help="reference of the imposed spin of the wheels", label="spin-on-{}"
    )
    travel_factor: float = option(
        1.0, within=(0.1, 5), help="times the travel of the struts up to their stops", label="{:g}-times-travel"
    )
    cg_height: float | None = option(
        None, unit="m", within=(0.1, 2), help="height of the CG above the wheel centers", label="{:g}m-high"
    )
    guided: bool = option(
        True,
        only=(lambda c: c.controller in UNSEEING, f"a controller without preview ({', '.join(UNSEEING)})"),
        help="pitch reference and forced ranges of the crossing algorithm, though the controller sees no trench",
    )


def step(case: Case) -> Fraction:
    """Exchange and recording step of the vehicle [s]."""
    return exchange_step(STEP, case)


@dataclass(frozen=True)
class Course:
    """Where the trench is on the vehicle's way, positions of the CG along the road [m], and how long a run may take."""

    start: float  # of the trench
    end: float  # of the run: the last axle is RUN_OUT behind the trench
    patience: float  # s

    @classmethod
    def of(cls, run: Run) -> Course:
        """The course of a run, or of one that has no recording yet: it follows from the vehicle's parameters."""
        case = run.case
        first, last = (float(run.start(f"car.wheel.{k}.x")) for k in ("a1l", "a3l"))
        nose = first + float(run.start("car.outline.front_overhang"))
        lead = LEAD[0] + LEAD[1] * case.speed
        start = round(max(nose, first + lead + APPROACH * case.speed) + CLEAR, 3)
        end = start + case.length - last + RUN_OUT
        return cls(start, end, round(1.25 * end / case.speed + 2.0, 3))


def structure(case: Case) -> tuple[object, ...]:
    """What decides the wiring."""
    chosen = CONTROLLERS[case.controller]
    return chosen and chosen[0], case.exchange_parts


def wire(fmus: FmuSet, case: Case) -> System:
    """Vehicle, crossing algorithm and controller; the two latter in this order every 5 ms (LQR every 1 ms)."""
    system = System()
    system.add("car", fmus.path("ThreeAxleTrench"), step=step(case))
    chosen = CONTROLLERS[case.controller]
    if chosen is None:
        system["car"].set({f"force.{k}": 0.0 for k in SIX_CORNERS})
        return system
    system.add("crossing", fmus.path("TrenchCrossing"))
    system.connect_matching("car", "crossing")
    system["crossing"].set({"lidar.start.valid": True, "lidar.finish.valid": True})
    system.add("controller", fmus.path(chosen[0]))
    system.connect_matching("car", "controller")
    if chosen[0] == "MpcThreeAxle":
        system.connect_matching("crossing", "controller")
    else:
        system.connect("crossing.reference.pitch[1]", "controller.reference.pitch")
    system.connect_matching("controller", "car", "force.*")
    return system


def configure(system: System, case: Case) -> None:
    """Set the parameters of a case."""
    car = system["car"]

    def given(name: str, value: Any) -> Any:
        return car.description.parameters[name].start if value is None else value

    named = {
        "trench.depth": case.depth,
        "disc.friction": case.friction,
        "body.cg_offset": case.cg_offset,
        "body.cg_height": case.cg_height,
    }
    car.set(
        {
            **{name: given(name, value) for name, value in named.items()},
            "body.mass": case.mass_factor * given("body.mass", case.mass),
            **{name: case.travel_factor * given(name, None) for name in ("strut.extension", "strut.compression")},
            "strut.hydropneumatic": case.hydropneumatic,
            "wheels.spin_on_road": case.spin == "road",
            "trench.length": case.length,
            "trench.start": Course.of(Run(case, None, system)).start,
            "target.speed": case.speed,
            "solver.step": float(STEP / case.solver_parts),
        }
    )
    chosen = CONTROLLERS[case.controller]
    if chosen is None:
        return
    pitch = system["crossing"].description.parameters
    system["crossing"].set({n: pitch[n].start if case.guided else 0.0 for n in ("pitch.entry", "pitch.exit")})
    if chosen[0] == "MpcThreeAxle":
        free = {} if case.guided else {"retraction": 0}
        system["controller"].set({**MPC, **chosen[1], **free, "use_preview": chosen[2]})


def stop_time(system: System, case: Case) -> float:
    """When a run is given up [s]."""
    return Course.of(Run(case, None, system)).patience


def stop_when(system: System, case: Case) -> list[StopWhen]:
    """A run ends when the last axle is clear of the trench."""
    return [StopWhen("car.x", ">=", Course.of(Run(case, None, system)).end)]


def recorded(case: Case) -> Sequence[str]:
    """What is recorded: metrics, figures and animations need it, and people who look at the file."""
    names = [f"car.{n}" for n in ("x", "speed", "body.az", "body.ax", "body.pitch", "body.roll", "body.z")]
    names += [f"car.{n}.force" for n in ("bumper.front", "bumper.rear", "belly")]
    for k in SIX_CORNERS:
        names += [f"car.hub.{k}.{n}" for n in ("fx", "x", "z")]
        if k.endswith("l"):
            names += [f"car.contact.{k}.{n}" for n in ("fx", "fz", "x", "z")] + [f"car.tire.{k}.deflection"]
    if case.controller != "passive":
        names += ["crossing.case", "crossing.reference.pitch[1]", *(f"controller.force.{k}" for k in SIX_CORNERS)]
    if case.controller.startswith("mpc"):
        names += [f"controller.solver.{n}" for n in ("status", "iterations", "residual")]
    return names


def _quantity(name: str) -> Metric:
    """One of Table 5.3, with its limit."""
    text, _, unit = LABELS[name].rstrip("]").partition(" [")
    return Metric(f"{text}, limit {getattr(LIMITS, name):g}", unit)


METRICS = {name: _quantity(name) for name in LABELS} | {
    "cost": Metric("cost", "-", form="{:.0f}"),
    "force": Metric("largest actuator force", "kN"),
    "bumper_front_kn": Metric("largest force on the front bumper", "kN"),
    "bumper_rear_kn": Metric("largest force on the rear bumper", "kN"),
    "belly_kn": Metric("largest force on the belly", "kN"),
    "outcome": Metric("outcome"),
}
"""What is compared between the controllers."""


def loads(run: Run) -> Crossing:
    """The quantities of Table 5.3."""
    r = run.recording
    hubs = columns(r, "car.hub.{}.fx", SIX_CORNERS)
    return crossing(r["car.body.az"], r["car.body.ax"], r["car.body.pitch"], hubs, float(1 / step(run.case)))


def measure(run: Run) -> Row:
    """The quantities of Table 5.3 and what became of the crossing."""
    r, measured, course = run.recording, loads(run), Course.of(run)
    touch = {n: float(r[f"car.{n}.force"].max()) for n in ("belly", "bumper.front", "bumper.rear")}
    arrived = bool(r["car.x"][-1] >= course.end - 1e-6)
    reasons = failures(measured, arrived=arrived, belly_contact=touch["belly"] > TOUCH)
    on_bumpers = touch["bumper.front"] + touch["bumper.rear"] > TOUCH
    row: Row = {
        "trench_start": course.start,
        **measured.as_dict(),
        "cost": cost(measured),
        "passed": not reasons,
        "failures": list(reasons),
        "outcome": outcome(reasons, on_bumpers=on_bumpers),
        "belly_kn": touch["belly"] / 1e3,
        "bumper_front_kn": touch["bumper.front"] / 1e3,
        "bumper_rear_kn": touch["bumper.rear"] / 1e3,
    }
    if "controller.solver.status" in r:
        steps = (r["controller.solver.status"] > 0).sum()
        row["solver_failures"] = round(steps * float(step(run.case)) / SAMPLE_TIME)
        row["solver_residual"] = float(r["controller.solver.residual"].max())
    if "controller.force.a1l" in r:
        row["force"] = max(peak(r[f"controller.force.{k}"]) for k in SIX_CORNERS) / 1e3
    return row


def outcome(reasons: Sequence[str], *, on_bumpers: bool) -> str:
    """How a run ended, in a few words."""
    if not reasons:
        return "passed, on its bumpers" if on_bumpers else "passed"
    words = {
        "az": "vertical acceleration",
        "ax": "longitudinal acceleration",
        "az_rms": "vertical rms",
        "ax_rms": "longitudinal rms",
        **dict.fromkeys(("hub_front", "hub_middle", "hub_rear"), "hub force"),
    }
    return "failed: " + ", ".join(dict.fromkeys(words.get(f, f) for f in reasons))


SIDE = tuple(k for k in SIX_CORNERS if k.endswith("l"))  # the other one moves alike
MOVING = (
    "car.x",
    "car.speed",
    "car.body.az",
    "car.body.pitch",
    "car.body.z",
    "car.hub.a1l.fx",
    *(f"car.{n}.force" for n in ("bumper.front", "bumper.rear", "belly")),
    *(f"car.hub.{k}.{n}" for k in SIDE for n in "xz"),
    *(f"car.contact.{k}.{n}" for k in SIDE for n in ("fx", "fz", "x", "z")),
    *(f"car.tire.{k}.deflection" for k in SIDE),
    "crossing.case",
)
"""Drawn in animations."""
CURVES = ("car.body.pitch", "car.body.az", "car.body.ax", "car.hub.a1l.fx")
"""Drawn over time."""


def signals(run: Run) -> Row:
    """What animations and figures draw, in the units of the FMUs.

    `frames`: `MOVING` every 20 ms. `curves`: time and values of `CURVES`, thinned so that peaks stay.
    `spectra`: frequency and density of both accelerations.
    """
    r = run.recording

    def rounded(name: str, values: np.ndarray) -> list[float]:
        found: list[float] = np.round(values, {"m": 4, "rad": 5, "N": 0}.get(r.units.get(name, ""), 3)).tolist()
        return found

    frame, sample = (int(interval / step(run.case)) for interval in (FRAME, 1 / Fraction(PSD_RATE)))
    thinned = {name: keep_peaks(r.time, r[name]) for name in CURVES}
    return {
        "frames": {name: rounded(name, r[name][::frame]) for name in MOVING if name in r},
        "curves": {
            name: [np.round(time, 5).tolist(), rounded(name, values)] for name, (time, values) in thinned.items()
        },
        "spectra": {axis: bands(*psd(r[f"car.body.{axis}"][::sample], PSD_RATE)) for axis in ("az", "ax")},
    }


def bands(frequency: np.ndarray, density: np.ndarray) -> tuple[list[float], list[float]]:
    """Means of a spectrum over bands of a twelfth of a decade, from 0.3 to 300 Hz; bands without a line are omitted."""
    edges = 10 ** np.arange(-0.5, 2.55, 1 / 12)
    number = np.digitize(frequency, edges)
    full = [i for i in range(1, len(edges)) if (number == i).any()]
    means = [float(density[number == i].mean()) for i in full]
    return [float(np.sqrt(edges[i - 1] * edges[i])) for i in full], means
