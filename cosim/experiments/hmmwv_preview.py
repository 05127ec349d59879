"""The preview chain of paper 001 by itself: what the range sensors' heights are worth under each filter (Figures 1.5, 1.7).

Range sensors, filter, correction (1.18) and buffer on a car without control forces; and a known profile at the measured
distance beside the loads of the passive hydraulic car. ``sections`` and ``claims`` are parts of a report.
"""

from __future__ import annotations

import warnings
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from cosim import Recording, System, UnconnectedInputsWarning
from cosim.experiments.cases import FmuSet, check_choice
from cosim.experiments.hmmwv_wiring import (
    BUMPS,
    CONTROL_PERIOD,
    EXCHANGE,
    FIRST_BUMP,
    FRONT,
    SPEED_KMH,
    add_actuators,
    add_car,
    add_preview_chain,
    add_sensors,
    bump_parameters,
)
from cosim.experiments.store import RunStore
from cosim.report import Claims, Figure, Panel, Section, Series, Table
from cosim.report.model import Scalar
from fmu_sources.controllers.hmmwv_states import CORNERS
from fmu_sources.roads.bumps import BUMP_LENGTH
from fmu_sources.vehicles import load_sensors

Row = dict[str, list[float]]

SPEED, TRACK = SPEED_KMH / 3.6, BUMPS["track"]
SPOT = load_sensors("sensors_hmmwv").radar.spot.value  # m
FILTERS = {"printed": "KalmanHmmwvPrinted", "relative": "KalmanHmmwv"}
BEHIND = 6.0  # m behind a bump in which a dip counts
LONG, WINDOW = 20.0, 4.0  # s, of the runs that show drift, and of what they are judged by
SPEEDOMETER_ERRORS = (0.0, 0.01, 0.02)
FMUS = (
    "SpeedProfile", "RoadBumps", "RideCarHmmwv", "SensorSuite", *FILTERS.values(), "PreviewSensor", "PreviewBuffer",
    "HydraulicActuator",
)  # fmt: skip


@dataclass(frozen=True)
class Chain:
    """One run of the chain. ``noise`` scales all sensors' noise; with 0 the ranges are not rounded either."""

    filter: str = "relative"
    use_road: bool = True
    compensation: bool = False  # the paper's quarter cars, outside the filter
    bumps: tuple[tuple[int, float], ...] = ((1, 0.030),)
    noise: float = 0.0
    duration: float = 2.6
    dropout: tuple[float, float] = (0.0, 0.0)  # s, start and duration

    def __post_init__(self) -> None:
        check_choice("filter", self.filter, FILTERS)

    @property
    def label(self) -> str:
        """Name in tables and figures."""
        name = "flat road believed" if self.filter == "printed" else "relative states"
        return name + ", road fed back" * self.use_road + ", quarter cars added" * self.compensation


CHAINS = (
    Chain("printed", use_road=False),
    Chain("printed", use_road=False, compensation=True),
    Chain("printed"),
    Chain("relative", use_road=False),
    Chain(),
    Chain("relative", use_road=False, compensation=True),
    Chain(compensation=True),
)
"""Filters and compensations that are compared."""
PRINTED, COMPENSATED, PRINTED_FED, RELATIVE, FED = CHAINS[:5]


class PreviewBench:
    """The chain wired once per filter, and run as often as needed."""

    def __init__(self, fmus: FmuSet, store: RunStore | None = None) -> None:
        self.fmus, self.store = fmus, store
        self._systems: dict[str, System] = {}

    def record(self, chain: Chain) -> Recording:
        """Run the chain; samples of 5 ms."""
        if chain.filter not in self._systems:
            self._systems[chain.filter] = wire(self.fmus, FILTERS[chain.filter])
        system = self._systems[chain.filter]
        system["road"].set({**bump_parameters(dict(chain.bumps)), "length": 1000.0})
        system["speed"].set({"start.speed": SPEED, "start.x": 0.0})
        resolution = {
            n: v.start if chain.noise else 0.0
            for n, v in system["sensors"].description.parameters.items()
            if n.startswith("range.resolution")
        }
        start, lasting = chain.dropout
        system["sensors"].set(
            {**resolution, "noise.scale": chain.noise, "range.dropout.start": start, "range.dropout.duration": lasting}
        )
        system["kalman"].set({"use_road": chain.use_road})
        system["preview_sensor"].set({"compensation": int(chain.compensation)})
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UnconnectedInputsWarning)  # no actuators
            return system.run(chain.duration, record=_RECORDED, record_interval="5 ms")

    def row(self, chain: Chain) -> Row:
        """Signals of a run as lists; stored if possible."""
        return self._stored(["chain", asdict(chain)], lambda: signals(self.record(chain)))

    def generated(self, error: float) -> Row:
        """A known profile at the measured distance of a speedometer that shows ``error`` too much, and the loads."""

        def compute() -> Row:
            system = wire_generated(self.fmus)
            try:
                system["sensors"].set({"speed.gain": 1.0 + error})
                recording = system.run(3.0, record=["speed.x", "map.road.fl.height", "road.road.fl.height",
                                                    "sensors.loadcell.fl"], record_interval="5 ms")  # fmt: skip
            finally:
                system.close()
            names = {"x": "speed.x", "map": "map.road.fl.height", "road": "road.road.fl.height",
                     "load": "sensors.loadcell.fl"}  # fmt: skip
            return {k: _short(recording[n]) for k, n in names.items()}

        return self._stored(["generated", error], compute)

    def _stored(self, key: Any, compute: Any) -> Row:
        return compute() if self.store is None else self.store.get(key, compute)

    def close(self) -> None:
        """Free all FMUs."""
        for system in self._systems.values():
            system.close()
        self._systems.clear()


_RECORDED = [
    "speed.x", "sensors.range.left", "sensors.range.left.valid", "preview_sensor.sensed.left.x",
    "preview_sensor.sensed.left.height", "road.road.fl.height", "road.road.fl.rate", "buffer.preview.fl[1]",
    "buffer.preview.fl[2]", "buffer.preview.valid", "buffer.road.valid",
]  # fmt: skip


def wire(fmus: FmuSet, kalman: str) -> System:
    """Road, car without forces, sensors, filter, correction and buffer; the road goes back to filter and correction."""
    system = System()
    add_car(system, fmus, "RoadBumps", step="1 ms")
    system["car"].set({f"force.{k}": 0.0 for k in CORNERS})
    add_sensors(system, fmus)
    system.add("kalman", fmus.path(kalman))
    system.connect_matching("sensors", "kalman")
    add_preview_chain(system, fmus)
    return system


def wire_generated(fmus: FmuSet) -> System:
    """The passive hydraulic car on the test track, and the same track known beforehand at the measured distance."""
    system = System()
    add_car(system, fmus, "RoadBumps", step=EXCHANGE)
    system["speed"].set({"start.speed": SPEED, "start.x": 0.0})
    system.add("map", fmus.path("RoadBumps"))
    for name in ("road", "map"):
        system[name].set(bump_parameters(TRACK))
    add_actuators(system, fmus, driven=False)
    add_sensors(system, fmus)
    system.connect("sensors.x.measured", "map.x")
    system.connect("sensors.speed.measured", "map.speed")
    return system


def _short(values: Any) -> list[float]:
    return [float(f"{v:.6g}") for v in values]


def signals(recording: Recording) -> Row:
    """What is kept of a run, 5 ms apart. ``rate`` is the buffered road's, from two neighbouring preview heights."""
    height, later = (recording[f"buffer.preview.fl[{i}]"] for i in (1, 2))
    return {
        "t": _short(recording.time),
        "x": _short(recording["speed.x"]),
        "range": _short(recording["sensors.range.left"]),
        "range valid": _short(recording["sensors.range.left.valid"]),
        "sensed x": _short(recording["preview_sensor.sensed.left.x"]),
        "sensed": _short(recording["preview_sensor.sensed.left.height"]),
        "true": _short(recording["road.road.fl.height"]),
        "true rate": _short(recording["road.road.fl.rate"]),
        "buffered": _short(height),
        "rate": _short((later - height) / CONTROL_PERIOD),
        "preview valid": _short(recording["buffer.preview.valid"]),
        "road valid": _short(recording["buffer.road.valid"]),
    }


# ---------------------------------------------------------------------- evaluating


def behind(row: Row) -> tuple[float, float]:
    """Lowest and highest sensed height [m] on the flat road behind the first bump."""
    x, height = np.array(row["sensed x"]), np.array(row["sensed"])
    start = FIRST_BUMP + BUMP_LENGTH + SPOT / 2
    there = height[(x > start) & (x < start + BEHIND)]
    return float(there.min()), float(there.max())


def spread(row: Row) -> list[float]:
    """Standard deviation [m] of the buffered road about the true one in successive windows."""
    t, error = np.array(row["t"]), np.array(row["buffered"]) - np.array(row["true"])
    starts = np.arange(0.0, t[-1] - WINDOW / 2, WINDOW)
    return [float(np.std(error[(t >= s) & (t < s + WINDOW)])) for s in starts]


def true_rate(row: Row) -> np.ndarray:
    """Rate [m/s] of the true road as the mean over the 30 ms ahead, which is what two neighbouring preview heights give."""
    rate = np.array(row["true rate"])
    return np.convolve(rate, np.ones(6) / 6, "full")[5 : 5 + len(rate)]


def rate_error(row: Row) -> float:
    """Root mean square [m/s] of the error of the buffered road's rate, from where road is known under all wheels."""
    known = np.array(row["road valid"]) > 0.5
    return float(np.sqrt(np.mean((np.array(row["rate"]) - true_rate(row))[known] ** 2)))


def offsets(row: Row) -> list[float]:
    """How far [m] behind the known profile's bumps the car meets them, from the loads: for each bump of the track."""
    x, map_, load = (np.array(row[n]) for n in ("x", "map", "load"))
    found = []
    for place in TRACK:
        at = FIRST_BUMP + (place - 1) + BUMP_LENGTH / 2 - FRONT  # the CG with the front wheels on the crest
        near = np.abs(x - at) < 1.0
        shown = float(np.sum(x[near] * map_[near]) / max(np.sum(map_[near]), 1e-12))
        loads = np.abs(load[near])
        met = float(x[near][np.argmax(loads)])
        found.append(met - shown)
    return found


@dataclass
class PreviewStudy:
    """Runs of the chain, by what they are for."""

    without_noise: dict[tuple[Chain, float], Row]
    long: dict[Chain, Row]
    track: dict[Chain, Row]
    dropout: Row
    generated: dict[float, Row]


HEIGHTS = (0.030, 0.076)  # m
DRIFTING = (PRINTED, PRINTED_FED, RELATIVE, FED)
SHOWN = (PRINTED, COMPENSATED, FED)


def study(fmus: FmuSet, store: RunStore | None = None) -> PreviewStudy:
    """Run everything: about half a minute on one core."""
    bench = PreviewBench(fmus, store)

    def varied(chain: Chain, **changes: Any) -> Chain:
        return Chain(**{**asdict(chain), "bumps": chain.bumps, **changes})

    try:
        return PreviewStudy(
            {(c, h): bench.row(varied(c, bumps=((1, h),))) for c in CHAINS for h in HEIGHTS},
            {c: bench.row(varied(c, noise=1.0, duration=LONG)) for c in DRIFTING},
            {c: bench.row(varied(c, noise=1.0, bumps=tuple(TRACK.items()), duration=3.2)) for c in SHOWN},
            bench.row(varied(FED, noise=1.0, bumps=tuple(TRACK.items()), duration=3.6, dropout=(0.7, 0.2))),
            {e: bench.generated(e) for e in SPEEDOMETER_ERRORS},
        )
    finally:
        bench.close()


# ---------------------------------------------------------------------- reporting


def claims(s: PreviewStudy) -> Claims:
    """What the paper says of its preview, and what this project asks of its own."""
    result = Claims()
    claim = result.judge

    small, big = HEIGHTS
    seen = 1e3 * load_sensors("sensors_hmmwv").radar.resolution.value  # mm
    dips = {(c, h): 1e3 * behind(row)[0] for (c, h), row in s.without_noise.items()}
    bumps = {(c, h): 1e3 * behind(row)[1] for (c, h), row in s.without_noise.items()}
    claim(
        "preview-dip",
        "With a filter that knows nothing of the road, the corrected road has a negative bump behind the actual one",
        "a negative bump",
        f"{dips[PRINTED, big]:.0f} mm behind a bump of {1e3 * big:.0f} mm, {dips[PRINTED, small]:.0f} mm behind {1e3 * small:.0f} mm",
        dips[PRINTED, big] < -seen,
        "the range sensor could not show so flat a dip",
        "Figure 1.7",
        -dips[PRINTED, big],
        "mm",
        criterion=f"a dip deeper than the {seen:g} mm that the range sensor resolves, behind a bump of {1e3 * big:.0f} mm without noise",
    )
    claim(
        "preview-dip-compensated",
        "Quarter cars on the buffered road, outside the filter, remove it",
        "removed",
        f"{dips[COMPENSATED, big]:.0f} mm are left, and a rise of {bumps[COMPENSATED, big]:.0f} mm comes with it",
        max(-dips[COMPENSATED, big], bumps[COMPENSATED, big]) <= seen,
        "accelerometers and gyros show part of the body's motion even to a filter that believes in a flat road, and the quarter cars add "
        "all of it; through the buffer they close a loop of their own that keeps swinging",
        "section 1.5, Figure 1.7",
        max(-dips[COMPENSATED, big], bumps[COMPENSATED, big]),
        "mm",
        criterion=f"neither a dip nor a rise beyond the {seen:g} mm that the range sensor resolves is left",
    )
    growth = spread(s.long[PRINTED_FED])
    claim(
        "preview-unstable",
        "The road fed back into the filter makes the preview unstable",
        "unstable dynamics",
        f"the error of the buffered road grows from {1e3 * growth[0]:.1f} mm to {growth[-1]:.1f} m in {LONG:g} s of sensor noise",
        growth[-1] > 10 * growth[0] and all(b > a for a, b in pairwise(growth)),
        "the error does not grow without end",
        "section 1.5",
        growth[-1] / growth[0],
        "-",
        criterion=f"the error's standard deviation grows from every {WINDOW:g} s to the next, tenfold over {LONG:g} s",
        fitted="noise of the sensors assumed; it sets when the growth shows, not whether",
    )
    steady = spread(s.long[FED])
    result.check(
        "preview-fed",
        "Feeding the road back into a filter of relative states, whose pose follows it slowly, removes the dip and stays stable",
        "asked for as the more robust solution",
        f"{dips[FED, small]:.2f} mm behind a bump of {1e3 * small:.0f} mm ({dips[FED, big]:.2f} mm behind {1e3 * big:.0f} mm); "
        f"with noise the error stays at {1e3 * steady[-1]:.0f} mm for {LONG:g} s",
        dips[FED, small] >= -1.0 and 1e3 * max(steady) < 1e3 * small,
        "the dip is deeper than 1 mm or the error grows",
        "section 1.5",
        -dips[FED, small],
        "mm",
        criterion=f"dip of at most 1 mm behind {1e3 * small:.0f} mm without noise, and with noise an error below the bump's height for {LONG:g} s",
        fitted="noise of the sensors and times of the slow corrections assumed",
    )
    rates = {c: rate_error(row) for c, row in s.track.items()}
    claim(
        "preview-rate",
        "The correction improves the rate of the road, which MPC weighs most",
        "tremendously",
        f"error of the rate {rates[PRINTED]:.3f} m/s before, {rates[FED]:.3f} m/s with the road fed back, "
        f"{rates[COMPENSATED]:.3f} m/s with quarter cars",
        rates[FED] <= rates[PRINTED] / 2,
        "noise and resolution of the ranges make most of the error of the rate, and no correction touches them",
        "Figure 1.7",
        100 * (1 - rates[FED] / rates[PRINTED]),
        "%",
        criterion="rms error of the rate at least halved with the road fed back; the paper gives no size",
        fitted="noise of the sensors assumed",
    )
    exact = offsets(s.generated[0.0])
    claim(
        "generated-loads",
        "A known profile at the measured distance matches the peaks of the loads",
        "matched",
        f"peaks {1e3 * exact[0]:+.0f} and {1e3 * exact[1]:+.0f} mm from the crests",
        max(map(abs, exact)) <= BUMP_LENGTH / 2,
        "the load does not peak over the bump",
        "Figure 1.5",
        1e3 * max(map(abs, exact)),
        "mm",
        criterion="largest load while the wheel is on the bump, at most half its length from the crest, at both bumps of the track",
    )
    drift = offsets(s.generated[SPEEDOMETER_ERRORS[-1]])
    claim(
        "generated-drift",
        "Generated preview accumulates errors of the distance",
        "no longer accurate after 10 m",
        f"a speedometer that shows {100 * SPEEDOMETER_ERRORS[-1]:g} % too much: off by {1e3 * (drift[0] - exact[0]):.0f} mm at the first bump, "
        f"{1e3 * (drift[1] - exact[1]):.0f} mm at the second",
        abs(drift[1] - exact[1]) > max(abs(drift[0] - exact[0]), BUMP_LENGTH / 2),
        "the error does not grow with the distance, or the prediction is still on the bump",
        "section 1.5",
        1e3 * abs(drift[1] - exact[1]),
        "mm",
        criterion="further off at the second bump than at the first, and there by more than half the length of a bump",
        fitted=f"the speedometer's error of {100 * SPEEDOMETER_ERRORS[-1]:g} % is assumed",
    )
    return result


_LOOKS: dict[Chain, tuple[Any, Any]] = {
    PRINTED: ("orange", "dash"),
    COMPENSATED: ("purple", "dot"),
    FED: ("green", "solid"),
}


def sections(s: PreviewStudy) -> list[Section]:
    """The chain's part of a report."""
    return [_generated_section(s), _chain_section(s)]


def _generated_section(s: PreviewStudy) -> Section:
    panels = []
    for error, row in s.generated.items():
        x = np.array(row["x"]) + FRONT
        panels.append(
            Panel(
                f"speedometer {100 * error:+g} %",
                "distance of the front wheels [m]",
                "height [mm]",
                [
                    Series("known profile, at the measured distance", x, 1e3 * np.array(row["map"]), color="blue"),
                    Series("road under the wheel", x, 1e3 * np.array(row["road"]), color="black", dash="dot"),
                    Series("load cell, N / 100", x, np.array(row["load"]) / 100, color="vermilion"),
                ],
            )
        )
    rows: list[list[Scalar]] = [
        [f"{100 * e:+g} %", *(round(1e3 * o) for o in offsets(row))] for e, row in s.generated.items()
    ]
    return Section(
        "Generated preview",
        [
            "The test track is known beforehand and laid at the distance that the speedometer has counted. Load cells of the passive car "
            "show where the bumps are. An error of the speedometer moves the prediction further off with every metre.",
        ],
        [
            Figure(
                "preview-generated",
                "Figure 1.5: generated preview and loads",
                "Front left wheel, passive hydraulic car at 20 mph on the test track.",
                panels,
            )
        ],
        [
            Table(
                "preview-offsets",
                "Largest load behind the predicted crest",
                ["speedometer error [%]", "first bump [mm]", "second bump [mm]"],
                rows,
                "The load peaks where the strut moves fastest, not on the crest; what changes from row to row is the drift.",
            )
        ],
    )


def _chain_section(s: PreviewStudy) -> Section:
    first = next(iter(s.track.values()))
    x = np.array(first["x"]) + FRONT
    ranges = Panel(
        "range sensor, left",
        "distance of the front wheels [m]",
        "range [m]",
        [Series("range", np.array(first["x"]) + FRONT, first["range"], color="black")],
    )
    heights, rates = (
        Panel(
            title,
            "distance of the front wheels [m]",
            f"{what} [{unit}]",
            [
                Series("true", x, scale * np.array(true), color="black"),
                *(
                    Series(c.label, x, scale * np.array(row[key]), color=_LOOKS[c][0], dash=_LOOKS[c][1])
                    for c, row in s.track.items()
                ),
            ],
        )
        for title, what, unit, scale, true, key in (
            ("road under the front left wheel, from the buffer", "height", "mm", 1e3, first["true"], "buffered"),
            ("its rate, mean over the 30 ms ahead", "rate", "m/s", 1.0, true_rate(first), "rate"),
        )
    )
    t = np.array(s.dropout["t"])
    lost = Panel(
        "range sensors fail for 0.2 s",
        "time [s]",
        "height [mm]",
        [
            Series("true", t, 1e3 * np.array(s.dropout["true"]), color="black"),
            Series("buffered", t, 1e3 * np.array(s.dropout["buffered"]), color="green"),
            Series("preview.valid, 10 mm for true", t, 10 * np.array(s.dropout["preview valid"]), color="grey"),
        ],
    )
    dips: list[list[Scalar]] = [
        [c.label, *(round(1e3 * v, 1) for h in HEIGHTS for v in behind(s.without_noise[c, h]))] for c in CHAINS
    ]
    double = behind(s.without_noise[Chain("relative", use_road=False, compensation=True), HEIGHTS[0]])[1]
    drift: list[list[Scalar]] = [[c.label, *(round(1e3 * v, 1) for v in spread(row))] for c, row in s.long.items()]
    windows = [f"{a:g} to {a + WINDOW:g} s [mm]" for a in WINDOW * np.arange(len(drift[0]) - 1)]
    return Section(
        "Sensed preview",
        [
            "Two range sensors see the road 2.1 m ahead of the front axle. Their heights are only as good as the pose of the body that "
            "is taken off them (1.18). A filter that believes in a flat road takes the climb over a bump for something else, and the road "
            "behind the bump gets a dip that is not there.",
            "The paper adds the response of quarter cars to the pose, since feeding the road back into the filter was unstable. Both come out "
            "here. The reason for the instability is geometric: an error of the buffered road tilts the pose when the wheels reach it, and "
            "the sensors, ahead of the front axle, put 1.6 times that error into the buffer again. A filter of relative states integrates "
            "the pose from rates and lets it follow the buffered road within a second: short errors die out, long ones fade by two slow "
            "leaks, and the dip is gone. Most of that is due to the relative states: without any road their dip is as small. Quarter cars "
            f"added to their pose count the motion twice: {1e3 * double:.0f} mm of road that is not there, behind a bump of "
            f"{1e3 * HEIGHTS[0]:.0f} mm.",
        ],
        [
            Figure(
                "preview-chain",
                "Figure 1.7: range, corrected road and its rate",
                "Test track at 20 mph, radar with noise and its resolution of 10 mm, car without control forces.",
                [ranges, heights, rates],
            ),
            Figure(
                "preview-dropout",
                "A sensor that fails",
                "While the ranges are not valid the buffer goes on with the last height; preview.valid is false until all wheels have passed that stretch.",
                [lost],
            ),
        ],
        [
            Table(
                "preview-dips",
                "Lowest and highest sensed height on the flat road behind one bump, no noise",
                [
                    "correction",
                    *(f"{1e3 * h:.0f} mm bump, {what} [mm]" for h in HEIGHTS for what in ("lowest", "highest")),
                ],
                dips,
            ),
            Table(
                "preview-drift",
                "Standard deviation of the buffered road's error with noise",
                ["correction", *windows],
                drift,
                "One bump of 30 mm at the beginning, then a flat road.",
            ),
        ],
    )
