"""Tables 5.2 and 5.4 to 5.11 of paper 003, from runs of the FMUs, and what the crossing depends on.

``study`` runs the published matrix, passive and controlled; lengths and speeds between its grid points; vehicles that
differ from the one the controller knows; and control with one thing left out or as printed.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim import Recording, System, UnconnectedInputsWarning
from cosim.experiments import trench
from cosim.experiments.cases import FmuSet
from cosim.experiments.parallel import run_tasks
from cosim.experiments.provenance import salt
from cosim.experiments.store import RunStore
from cosim.experiments.trench import CONTROLS, Case, Row, TrenchBench
from cosim.experiments.trench_published import LENGTHS, SPEEDS
from cosim.metrics_crossing import normalised, scores

SYSTEMS = ("passive", "mpc")
BOLD = ((1.4, 9.0), (1.5, 1.0), (1.5, 3.0), (1.7, 6.0), (1.9, 1.0), (2.0, 9.0))  # shown in section 5.5
SPECTRUM = (1.8, 6.0)  # figure 5.39
BETWEEN = tuple((length, speed) for length in (1.25, 1.45, 1.65, 1.85, 1.95) for speed in (2.0, 4.5, 7.5))
SOME = tuple((length, speed) for length in (1.2, 1.6, 2.0) for speed in SPEEDS)  # for what is not published
OTHER_VEHICLES: dict[str, dict[str, Any]] = {
    "CG 2 cm ahead": {"cg_offset": 0.02},
    "CG 2 cm behind": {"cg_offset": -0.02},
    "CG 5 cm ahead": {"cg_offset": 0.05},
    "CG 5 cm behind": {"cg_offset": -0.05},
    "friction 0.6": {"friction": 0.6},
    "friction 0.4": {"friction": 0.4},
    "body 10 % heavier": {"mass": 1.1 * 17000.0},
    "body 20 % heavier": {"mass": 1.2 * 17000.0},
    "hydropneumatic struts": {"hydropneumatic": True},
}
WITHOUT = {
    "mpc-no-preview": "road ahead unknown, all states measured",
    "mpc-offsets": "MPC without preview as its tool has it by default (Table 4.1)",
    "mpc-free": "no forced retraction",
    "mpc-printed-sign": "forced ranges with the printed sign (Table 4.8)",
    "mpc-no-height": "body height not weighed (Table 4.10)",
    "mpc-printed-limits": "limits as printed (Tables 4.5, 4.6)",
    "lqr": "LQR (Table 4.1)",
}
LINEAR = (5.0, 0.15)  # km/h and depth [m] of the comparison of linear and nonlinear vehicle
LINEAR_START, LINEAR_LENGTH, LINEAR_EDGE = 6.0, 2.0, 0.2  # m


@dataclass
class Study:
    """Results; rows as :func:`trench.evaluate` makes them."""

    published: dict[tuple[float, float, str], Row] = field(default_factory=dict)  # (length, speed, system)
    refined: dict[tuple[float, float, str], Row] = field(default_factory=dict)  # the same at half the step
    between: list[Row] = field(default_factory=list)
    vehicles: dict[str, list[Row]] = field(default_factory=dict)
    without: dict[str, list[Row]] = field(default_factory=dict)
    frames: dict[tuple[float, float, str], Row] = field(default_factory=dict)
    linear: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)  # vehicle -> signal -> samples

    def rows(self, system: str) -> list[Row]:
        """Published matrix of one system, by length and speed."""
        return [self.published[length, speed, system] for length in LENGTHS for speed in SPEEDS]

    def verdict(self, length: float, speed: float, system: str) -> bool | None:
        """Whether a published crossing passes; None where halving the step changes the answer."""
        key = (length, speed, system)
        passed = bool(self.published[key]["passed"])
        return passed if self.refined[key]["passed"] == passed else None

    def costs(self) -> list[float]:
        """Of all published runs."""
        return [r["cost"] for s in SYSTEMS for r in self.rows(s)]

    def normalised(self, length: float, speed: float, system: str) -> float:
        """Normalised cost (Table 5.11)."""
        return normalised(self.published[length, speed, system]["cost"], self.costs())

    def scores(self) -> dict[tuple[float, float], float]:
        """Scores of the controlled runs (Table 5.9)."""
        values = scores(r["cost"] for r in self.rows("mpc"))
        return dict(zip(((a, b) for a in LENGTHS for b in SPEEDS), values, strict=True))


def tasks(*, published_only: bool = False) -> list[tuple[str, Case]]:
    """(group, case) of every run, the slow ones first."""
    found = [("published", Case(a, b, s)) for s in SYSTEMS for a in LENGTHS for b in SPEEDS]
    found += [("refined", replace(case, refine=2)) for _, case in found]
    if not published_only:
        found += [("between", Case(a, b, "mpc")) for a, b in BETWEEN]
        found += [(n, replace(Case(a, b, "mpc"), **v)) for n, v in OTHER_VEHICLES.items() for a, b in SOME]
        found += [(c, Case(a, b, c)) for c in WITHOUT for a, b in SOME]
    return sorted(found, key=lambda t: t[1].speed_kmh * (3.0 if t[1].control == "passive" else 1.0) / t[1].refine)


def fmu_names() -> list[str]:
    """Names of all FMUs of the study."""
    return sorted({n for c in trench.CONTROLS for n in Case(control=c).fmus()} | {"ThreeAxleRide"})


def study(
    fmus: FmuSet,
    cache: Path,
    *,
    published_only: bool = False,
    processes: int | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Study:
    """Run everything on all cores. Finished runs are kept in ``cache``, so an interrupted study goes on where it stopped."""
    result = Study()
    plan = tasks(published_only=published_only)
    done = 0

    def advance(_: Any, __: Any) -> None:
        nonlocal done
        done += 1
        progress(done, len(plan))

    progress(0, len(plan))
    args = (fmus, cache)
    rows = run_tasks(_work, plan, initializer=_start, initargs=args, processes=processes, done=advance)
    for (group, case), (row, frames) in zip(plan, rows, strict=True):
        key = (case.length, case.speed_kmh, case.control)
        if group == "published":
            result.published[key] = row
            if key[:2] in BOLD or key[:2] == SPECTRUM:
                result.frames[key] = frames
        elif group == "refined":
            result.refined[key] = row
        elif group == "between":
            result.between.append(row)
        elif group in OTHER_VEHICLES:
            result.vehicles.setdefault(group, []).append(row)
        else:
            result.without.setdefault(group, []).append(row)
    result.linear = compare_linear(fmus)
    return result


_bench: TrenchBench  # of this worker process


def _start(fmus: FmuSet, cache: Path) -> None:
    global _bench  # noqa: PLW0603
    _bench = TrenchBench(fmus, RunStore(cache, salt(fmus.paths(fmu_names()), [trench.__file__])))


def _work(task: tuple[str, Case]) -> tuple[Row, Row]:
    group, case = task
    wanted = group == "published" and (case.length, case.speed_kmh) in (*BOLD, SPECTRUM)
    return _bench.measure(case), _bench.frames(case) if wanted else {}


# ---------------------------------------------------------------------- linear against nonlinear


def compare_linear(fmus: FmuSet) -> dict[str, dict[str, np.ndarray]]:
    """Linear and nonlinear passive vehicle over a shallow trench with sloped edges (figures 5.1 to 5.3).

    Same masses, wheel positions and tyre damping; the linear one's speed is constant. Signals over ``x`` of the CG.
    """
    speed, depth = LINEAR[0] / 3.6, LINEAR[1]
    duration = round((LINEAR_START + LINEAR_LENGTH + 5.0) / speed, 3)
    out = {}
    with System() as linear, System() as nonlinear:
        linear.add("speed", fmus.path("SpeedProfile"), start={"start.speed": speed, "start.x": 0.0})
        sizes = {"start": LINEAR_START, "length": LINEAR_LENGTH, "depth": depth, "edge": LINEAR_EDGE}
        linear.add("road", fmus.path("RoadShallowTrench"), start={f"trench.{n}": v for n, v in sizes.items()})
        linear.add("car", fmus.path("ThreeAxleRide"), step="1 ms")
        linear.connect("speed.x", "road.x")
        linear.connect("speed.speed", "road.speed")
        linear.connect_matching("road", "car", "road.*")
        nonlinear.add("car", fmus.path("ThreeAxleTrench"), step="1 ms", start=_shallow(linear, speed, depth))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UnconnectedInputsWarning)  # nothing drives the actuators
            names = ["car.body.z", "car.body.pitch"]
            one = linear.run(duration, record=[*names, "speed.x", "speed.speed"], record_interval="10 ms")
            two = nonlinear.run(duration, record=[*names, "car.x", "car.speed"], record_interval="10 ms")
        out["linear"] = _signals(one, "speed.x", "speed.speed")
        out["nonlinear"] = _signals(two, "car.x", "car.speed")
    return out


def _shallow(linear: System, speed: float, depth: float) -> dict[str, Any]:
    """Start values of the nonlinear vehicle: that trench as an outline, geometry and tyres of the linear vehicle."""
    corners = (
        np.array([-1.0, 1.0]) * LINEAR_EDGE
    )  # the rounded edge as a straight slope as steep as it is in the middle
    x = [*(LINEAR_START + corners), *(LINEAR_START + LINEAR_LENGTH + corners)]
    z = [0.0, -depth, -depth, 0.0]
    values: dict[str, Any] = {"obstacle.shape": 2, "outline.points": 4, "target.speed": speed}
    for side in ("left", "right"):
        for i, (at, height) in enumerate(zip(x, z, strict=True), start=1):
            values |= {f"outline.{side}.x[{i}]": float(at), f"outline.{side}.z[{i}]": height}
    known = linear["car"].description.parameters
    for k in trench.CORNERS:
        for name in (f"wheel.{k}.x", f"tire.{k}.damping"):
            values[name] = known[name].start
    return values


def _signals(recording: Recording, x: str, speed: str) -> dict[str, np.ndarray]:
    return {
        "time": recording.time,
        "x": recording[x],
        "z": recording["car.body.z"],
        "pitch": np.degrees(recording["car.body.pitch"]),
        "speed": 3.6 * recording[speed],
    }


def passes(rows: list[Row]) -> int:
    """How many met Table 5.3 without belly contact."""
    return sum(r["passed"] for r in rows)


__all__ = ["BETWEEN", "BOLD", "CONTROLS", "OTHER_VEHICLES", "SOME", "WITHOUT", "Study", "passes", "study", "tasks"]
