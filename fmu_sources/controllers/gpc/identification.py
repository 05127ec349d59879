"""From a vehicle FMU to GPC controllers: excite it in a co-simulation, record, identify, design.

The run is that of the paper: the synthetic Perryman 3 road at 40 km/h, zero-order-hold Gaussian excitation of all four
actuators at 100 Hz. Responses and road heights are sampled as the controller FMU samples them (module `component`).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, ClassVar, cast, get_args

import numpy as np

from build_fmus.base import safe_files
from build_fmus.base.checks import number, whole_number
from build_fmus.base.sources import code_hash
from build_fmus.component import Component
from cosim import PythonComponent, Record, System
from fmu_sources.controllers.gpc.arx import ArxIdentification, identify_arx
from fmu_sources.controllers.gpc.component import (
    RESPONSE_TICK,
    RESPONSES,
    SAMPLE_TIME,
    TICK,
    TICKS_PER_SAMPLE,
    gpc_controller,
)
from fmu_sources.controllers.gpc.control_law import GpcLaw, Variant, gpc_law
from fmu_sources.controllers.gpc.prediction import multi_step_predictor
from fmu_sources.models.corners import CORNERS
from fmu_sources.registration import component, needs

VARIANTS: tuple[Variant, ...] = get_args(Variant)


DISTURBANCES = ("height", "rate", "slope", "rate-1kHz")


@dataclass(frozen=True)
class IdentificationSettings:
    """The identification run. Defaults: Table 2 of the paper; the excitation level and the settling are assumed.

    The paper leaves open whether the run starts `from_rest`, with the leading zeros of (4), where its excitation rolls
    off, whether both tracks of the road have one profile, what of the road is measured as disturbance and from which
    `datum`, when responses are sampled (`sampled_after`), and what force on the wheel an actuator's gives (`lever`).
    """

    seed: int = 0
    order: int = 8
    samples: int = 400
    settling_samples: int = 200  # unexcited running first
    excitation: float = 2000.0  # N, standard deviation per actuator
    speed: float = 40 / 3.6  # m/s
    from_rest: bool = False  # without settling
    roll_off: float = 0.0  # Hz, of the excitation (Butterworth, fourth order); 0: white up to 50 Hz
    one_track: bool = False
    disturbance: str = "height"  # one of DISTURBANCES
    datum: float = 0.0  # m, or m/s, 1: what the disturbance is at the start; 0: trimmed
    sampled_after: int = RESPONSE_TICK  # tick after a sample instant
    lever: float = 1.0

    def __post_init__(self) -> None:
        for name in ("order", "samples"):
            whole_number(f"identification: {name}", getattr(self, name))
        number("identification: excitation", self.excitation, "N", above=0)
        number("identification: speed", self.speed, "m/s", above=0)
        number("identification: roll_off", self.roll_off, "Hz", least=0, most=0.5 / SAMPLE_TIME)
        if self.disturbance not in DISTURBANCES:
            raise ValueError(f"identification: unknown disturbance {self.disturbance!r}")

    def told(self) -> dict[str, Any]:
        """As JSON values; of the last three, which came after FMUs were published, those that are assumed otherwise."""
        default = IdentificationSettings()
        late = {name for name in ("datum", "sampled_after", "lever") if getattr(self, name) == getattr(default, name)}
        return {name: value for name, value in asdict(self).items() if name not in late}

    @property
    def unexcited_samples(self) -> int:
        """Samples before the excitation begins."""
        return 0 if self.from_rest else self.settling_samples

    def excite(self) -> np.ndarray:
        """The forces (samples, 4) [N]: Gaussian, the same standard deviation with and without roll-off."""
        white = np.random.default_rng(self.seed).normal(0.0, self.excitation, (self.samples, len(CORNERS)))
        if not self.roll_off:
            return white
        from scipy.signal import butter, sosfilt  # slow to import

        low = sosfilt(butter(4, self.roll_off, fs=1 / SAMPLE_TIME, output="sos"), white, axis=0)
        return np.asarray(low * (self.excitation / np.std(low)))


@dataclass(frozen=True)
class DesignSettings:
    """Weights and horizons of the control laws: Table 2 of the paper."""

    h_p: int = 8
    h_c: int = 8
    Q: tuple[float, ...] = (50.0, 10.0, 1.0)  # vertical acceleration [1/g2], pitch, roll [1/deg2]
    R: float = 1e-7  # 1/N2


@dataclass(frozen=True)
class IdentificationData:
    """Samples at 100 Hz, trimmed.

    Commands u (n, 4) [N], responses y (n, 3) [g, deg, deg], road heights d (n, 4) [m].
    """

    u: np.ndarray
    y: np.ndarray
    d: np.ndarray


@dataclass(frozen=True)
class IdentifiedModels:
    """ARX models of one identification run: without and with the road as a measured input."""

    implicit: ArxIdentification
    explicit: ArxIdentification
    provenance: Mapping[str, Any]

    def law(self, variant: str, design: DesignSettings | None = None, *, hold: bool = False) -> GpcLaw:
        """The control law of a variant; quick, so studies over weights redesign as they go."""
        design = design or DesignSettings()
        model = (self.implicit if variant == "implicit" else self.explicit).model
        predictor = multi_step_predictor(model, design.h_p, design.h_c)
        return gpc_law(
            predictor,
            design.Q,
            design.R,
            cast(Variant, variant),
            hold=hold,
            provenance={**self.provenance, "design": asdict(design)},
        )


class Excitation(PythonComponent):
    """Plays back a force sequence (n, 4) [N], one row per step."""

    outputs: ClassVar[Sequence[str]] = tuple(f"force.{k} [N]" for k in CORNERS)
    feedthrough: ClassVar[Mapping[str, Sequence[str]]] = {f"force.{k}": () for k in CORNERS}
    kind: ClassVar[str] = "discrete"
    default_step = SAMPLE_TIME

    def __init__(self, sequence: np.ndarray) -> None:
        super().__init__()
        self.sequence = sequence

    def begin(self) -> None:
        """Start at the first row of the sequence."""
        self.row = 0

    def step(self, t: float, h: float, u: np.ndarray, y: np.ndarray) -> None:  # noqa: ARG002
        """Output the next row of the sequence; the last row is held."""
        y[:] = self.sequence[min(self.row, len(self.sequence) - 1)]
        self.row += 1


def record_identification(
    plant: Path, road: Path, speed: Path, settings: IdentificationSettings | None = None
) -> IdentificationData:
    """Run the excited vehicle and sample it as the controller would."""
    s = settings or IdentificationSettings()
    n = s.unexcited_samples + s.samples
    sequence = np.zeros((n + 1, len(CORNERS)))
    sequence[s.unexcited_samples : n] = s.excite()
    with System(allow_unconnected=True) as system:  # the driver keeps y = 0
        system.add("speed", speed, parameters={"start.speed": s.speed})
        system.add("road", road)
        system.add("car", plant, step=TICK)
        system.add("excitation", Excitation(sequence * s.lever))
        system.connect("speed.speed", "car.target.speed")
        for signal in ("x", "speed"):
            system.connect(f"car.{signal}", f"road.{signal}")
        connect_road(system, "car", one_track=s.one_track)
        system.connect_matching("excitation", "car")
        responses = [f"car.{name}" for name, *_ in RESPONSES]
        heights = [f"road.road.{track_of(k, s.one_track)}.height" for k in CORNERS]
        recording = system.run(
            n * Fraction(TICKS_PER_SAMPLE, 1000), record=Record([*responses, *heights], Fraction(1, 1000))
        )
    y = np.column_stack([recording[name] / scale for name, (_, _, _, scale) in zip(responses, RESPONSES, strict=True)])
    d = np.column_stack([recording[name] for name in heights])
    at = np.arange(n) * TICKS_PER_SAMPLE
    every = round(measured_every(s.disturbance) / TICK)
    d = disturbance_of((d - d[0])[::every], s.disturbance, s.speed)[:: TICKS_PER_SAMPLE // every][:n]
    return IdentificationData(sequence[:n], (y - y[0])[at + s.sampled_after], d + s.datum)


def track_of(corner: str, one_track: bool) -> str:
    """The corner whose road is under a wheel: its own, or that on the left where both tracks have one profile."""
    return f"{corner[0]}l" if one_track else corner


def connect_road(system: System, target: str, pattern: str = "road.*", *, one_track: bool = False) -> None:
    """Connect what lies under (and ahead of) each wheel to a component; with `one_track` that on the left to both."""
    for name in system[target].description.inputs if one_track else ():
        first, _, rest = name.partition(".")
        corner = next((k for k in CORNERS if rest.startswith(k) and k.endswith("r")), "")
        if first in ("road", "preview") and corner and f"{target}.{name}" not in system.connections:
            left = f"{first}.{track_of(corner, one_track)}{rest.removeprefix(corner)}"
            system.connect(f"road.{left}", f"{target}.{name}")
    system.connect_matching("road", target, pattern)


def measured_every(kind: str) -> float:
    """Time between two heights of which a disturbance is made [s]."""
    return TICK if kind == "rate-1kHz" else SAMPLE_TIME


def disturbance_of(heights: np.ndarray, kind: str, speed: float) -> np.ndarray:
    """The measured disturbance from heights (n, k) [m], one `measured_every` so many seconds.

    A rate [m/s] is their backward difference over that time, "slope" [-] that over the way at `speed` [m/s].
    """
    if kind == "height":
        return heights
    rate = np.diff(heights, axis=0, prepend=heights[:1]) / measured_every(kind)
    return rate / speed if kind == "slope" else rate


def identify(plant: Path, road: Path, speed: Path, settings: IdentificationSettings | None = None) -> IdentifiedModels:
    """Record and identify both ARX models (with and without the measured road)."""
    s = settings or IdentificationSettings()
    data = record_identification(plant, road, speed, s)
    implicit = identify_arx(data.u, data.y, order=s.order, samples=s.samples, from_rest=s.from_rest)
    explicit = identify_arx(data.u, data.y, data.d, order=s.order, samples=s.samples, from_rest=s.from_rest)
    provenance = {
        "identification": s.told(),
        "plant": plant.stem,
        "road": road.stem,
        "fmu_sha256": {p.stem: hashlib.sha256(p.read_bytes()).hexdigest() for p in (plant, road, speed)},
        "arx": {"implicit": implicit.summary(), "explicit": explicit.summary()},
    }
    return IdentifiedModels(implicit, explicit, provenance)


def published_laws(
    *, plant: Path, road: Path, speed: Path, cache: Path | None = None, settings: IdentificationSettings | None = None
) -> dict[str, GpcLaw]:
    """The three control laws with the paper's tuning, identified from the given FMUs.

    With `cache` the result is kept by the content of the FMUs, the settings and the code that computes it.
    """
    s = settings or IdentificationSettings()
    path = None
    if cache is not None:
        digest = hashlib.sha256(json.dumps([asdict(s), asdict(DesignSettings()), code_hash([__file__])]).encode())
        for p in (plant, road, speed):
            digest.update(p.read_bytes())
        path = cache / "laws" / f"{digest.hexdigest()[:32]}.json"
        with suppress(safe_files.CacheMiss):
            return {k: GpcLaw.from_dict(v) for k, v in safe_files.kept_json(path).items()}
    models = identify(plant, road, speed, s)
    laws: dict[str, GpcLaw] = {v: models.law(v) for v in VARIANTS}
    if path is not None:
        safe_files.keep_json(path, {k: v.to_dict() for k, v in laws.items()})
    return laws


@component("GpcImplicit{s}", "GPC with implicit disturbances (paper 000)", of="hmmwv_modified", variant="implicit")
@component("GpcExplicit{s}", "GPC with explicit disturbances (paper 000)", of="hmmwv_modified", variant="explicit")
@component("GpcPreview{s}", "GPC with preview (paper 000)", of="hmmwv_modified", variant="preview")
@needs("FullCar{v}", "RoadPerryman3{s}", "SpeedProfile")
def gpc_published(fmus: Sequence[Path], cache: Path, name: str, *, variant: Variant) -> Component:
    """Controller of a variant, from the FMUs of plant, road and speed. The identification is kept in `cache`."""
    plant, road, speed = fmus
    return gpc_controller(published_laws(plant=plant, road=road, speed=speed, cache=cache)[variant], name=name)
