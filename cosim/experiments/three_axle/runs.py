"""Runs of the linear part of paper 003: road, pitch reference, 6x6 and controller, wired and measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from operator import attrgetter

import numpy as np

from cosim import Recording, System
from cosim.core.signals import columns, peak, rms
from cosim.experiments.options import Controlled, speed_option
from cosim.experiments.steps import exchange_step, set_solver_step
from cosim.study import FmuSet, Metric, Row, Run, option
from fmu_sources.controllers.mpc.three_axle import ESTIMATORS, FORCES, PREDICTION, SAMPLE_TIME
from fmu_sources.models.corners import SIX_CORNERS

CONTROLLERS = {"passive": None, "lqr": "LqrThreeAxle", "mpc": "MpcThreeAxle", "mpc-preview": "MpcThreeAxle"}
FMUS = ("SpeedProfile", "RoadShallowTrench", "PitchReference", "ThreeAxleRide", "LqrThreeAxle", "MpcThreeAxle")
EXCHANGE = Fraction(1, 1000)  # s, of the vehicle
HORIZON = PREDICTION * SAMPLE_TIME  # s, of the predictive controllers
stop_time = 25.0  # s; the reference is back at 0 at 24 s
SETTLED = (1.0, 0.3)  # s before the end of the hold: where the steady-state error is taken; preview acts after that
CLEAR = 0.5  # s before the reference rises: what comes earlier counts as the trench's
EDGE_BEGINS = 0.0025  # of the depth
LIMIT = 150.0  # kN, Table 4.5

_MPC = (lambda c: c.controller.startswith("mpc"), "the predictive controllers")


@dataclass(frozen=True)
class Case(Controlled):
    """One run: speed, trench, controller."""

    speed_kmh: float = speed_option(5.0, (0, 60))
    depth: float = option(
        0.15, unit="m", within=(0, 1), help="depth of the trench", label=lambda m: f"{1e3 * m:g}mm", always=True
    )
    controller: str = option("mpc-preview", choices=CONTROLLERS, aliases=("system",), help="control law", always=True)
    estimator: str = option("offsets", choices=ESTIMATORS, only=_MPC, help="observer of the predictive controllers")
    hold_height: bool = option(False, only=_MPC, help="weigh the height of the body too", label="height")


structure = attrgetter("controller", "exchange_parts")
"""What of a case decides the wiring."""


def wire(fmus: FmuSet, case: Case) -> System:
    """Everything every millisecond, the predictive controllers every five."""
    system = System(allow_unconnected=True)  # the controllers' `case` stays 0; nothing drives a passive vehicle
    system.add("speed", fmus.path("SpeedProfile"))
    system.add("road", fmus.path("RoadShallowTrench"))
    system.add("reference", fmus.path("PitchReference"))
    system.add("car", fmus.path("ThreeAxleRide"), step=exchange_step(EXCHANGE, case))
    system.connect_matching("speed", "road")
    system.connect_matching("road", "car", "road.*")
    controller = CONTROLLERS[case.controller]
    if controller is None:
        return system
    system.add("controller", fmus.path(controller))
    system.connect_matching("car", "controller")
    system.connect_matching("controller", "car", "force.*")
    if case.controller == "lqr":
        system.connect("reference.reference.pitch[1]", "controller.reference.pitch")
        return system
    system.connect_matching("road", "controller", "preview.*")
    if case.controller == "mpc-preview":
        system.connect("reference.reference.pitch", "controller.reference.pitch")
    else:  # without preview the reference, too, is known only as it stands now
        for i in range(PREDICTION):
            system.connect("reference.reference.pitch[1]", f"controller.reference.pitch[{i + 1}]")
    return system


def configure(system: System, case: Case) -> None:
    """Set the parameters of a case."""
    set_solver_step(system["car"], case)
    system["speed"].set({"start.speed": case.speed_kmh / 3.6, "start.x": 0.0})
    system["road"].set({"trench.depth": case.depth})
    configure_controller(system, case)


def configure_controller(system: System, case: Case) -> None:
    """What of a case concerns its controller, on any road."""
    if CONTROLLERS[case.controller] == "MpcThreeAxle":
        system["controller"].set(
            {
                "estimator": ESTIMATORS.index(case.estimator),
                "hold_height": case.hold_height,
                "use_preview": case.controller == "mpc-preview",
            }
        )


def recorded(case: Case) -> Sequence[str]:
    """What is recorded."""
    names = ["car.body.pitch", "car.body.roll", "car.body.z", "car.body.az", "reference.reference.pitch[1]"]
    names += [f"road.road.{k}.height" for k in SIX_CORNERS]
    if case.controller != "passive":
        names += [f"controller.{f}" for f in FORCES]
    if case.controller.startswith("mpc"):
        names += [f"controller.{n}" for n in ("solver.status", "solver.residual", "solver.iterations", "slack")]
    return names


METRICS = {
    "peak_error_deg": Metric("peak error at the trench", "deg", form="{:.4f}"),
    "rms_error_deg": Metric("rms error at the trench", "deg", form="{:.4f}"),
    "ramp_error_deg": Metric("rms error on the ramp", "deg", form="{:.4f}"),
    "steady_error_deg": Metric("steady error", "deg", form="{:.4f}"),
    "peak_heave_m": Metric("peak heave", "mm", 1e3, "{:.1f}"),
    "rms_az": Metric("rms vertical acceleration", "m/s2", form="{:.3f}"),
    "peak_force_kN": Metric("peak force", "kN", form="{:.1f}"),
    "force_before_edge_kN": Metric("force before the edge", "kN", form="{:.2f}"),
    "slack": Metric("largest slack", "-", form="{:.2f}"),
}
"""What is compared between the controllers. Errors are those of pitch."""


def pitch_error(recording: Recording) -> np.ndarray:
    """Pitch less its reference [rad]."""
    return recording["car.body.pitch"] - recording["reference.reference.pitch[1]"]


def forces(recording: Recording) -> np.ndarray:
    """Commanded forces (samples, 6) [N] by corner; zero for the passive vehicle."""
    return columns(recording, "controller.{}", FORCES, optional=True)


def edge_time(time: np.ndarray, height: np.ndarray, depth: float) -> float:
    """Time at which the first axle comes to where the road begins to fall [s]; inf if it never does.

    Args:
        time: (samples,) [s].
        height: of the road under the first axle (samples,), in the unit of `depth`.
        depth: of the trench. Begun means 0.25 % of the depth, three times the rounding ahead of the edge.
    """
    begun = np.flatnonzero(height < -EDGE_BEGINS * depth)
    return float(time[begun[0]]) if len(begun) else math.inf


def measure(run: Run) -> Row:
    """`METRICS`, and what else the claims need; a run that ends before the reference lacks its figures."""
    r, t, error = run.recording, run.recording.time, np.degrees(pitch_error(run.recording))
    rises, ramp, hold, back = (
        float(run.start(f"reference.{n}")) for n in ("ramp.start", "ramp.duration", "hold.duration", "return.duration")
    )
    trench, ends = t < rises - CLEAR, rises + ramp + hold
    force = np.abs(forces(r)) / 1e3
    before_edge = t < edge_time(t, r["road.road.a1l.height"], run.case.depth)
    found: Row = {
        "peak_error_deg": peak(error[trench]),
        "rms_error_deg": rms(error[trench]),
        "peak_force_kN": float(force.max()),
        "at_limit": float(np.mean(force >= LIMIT - 1e-6)),
        "force_before_edge_kN": float(force[before_edge].max()),
        "peak_heave_m": peak(r["car.body.z"]),
        "rms_az": rms(r["car.body.az"][trench]),
    }
    if t[-1] >= ends + back:
        ahead = forces(r)[(t >= rises - HORIZON) & (t < rises)] / 1e3
        settled = (t >= ends - SETTLED[0]) & (t < ends - SETTLED[1])
        found["force_before_ramp_kN"] = peak(ahead - ahead[0])  # change within the horizon
        found["ramp_error_deg"] = rms(error[(t >= rises) & (t < rises + ramp)])
        found["steady_error_deg"] = peak(error[settled])
    if "controller.solver.status" in r:
        found["solver_failures"] = int(np.count_nonzero(r["controller.solver.status"]))
        found["solver_residual"] = float(r["controller.solver.residual"].max())
        found["solver_iterations"] = int(r["controller.solver.iterations"].max())
        found["slack"] = float(r["controller.slack"].max())
    return found


def signals(run: Run) -> Row:
    """Signals over time for the figures, at 200 Hz: angles [deg], forces [kN], the road [mm], to six digits."""
    r, force = run.recording, forces(run.recording) / 1e3
    shown = {
        "time": r.time,
        "pitch": np.degrees(r["car.body.pitch"]),
        "reference": np.degrees(r["reference.reference.pitch[1]"]),
        "road": 1e3 * r["road.road.a1l.height"],
        **{f"force.{k}": force[:, i] for i, k in enumerate(SIX_CORNERS) if k.endswith("l")},
    }
    return {name: [float(f"{x:.6g}") for x in signal] for name, signal in shown.items()}
