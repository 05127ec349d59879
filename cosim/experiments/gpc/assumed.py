"""What other readings of paper 000 put between road, car and controller, and FMUs of theirs, built on first use."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import ClassVar

import numpy as np

from build_fmus.component import Component
from cosim import PythonComponent, System
from cosim.experiments.built import built
from cosim.fmu.file import FmuFile
from cosim.study.case import check_choice
from fmu_sources.controllers.gpc.component import RESPONSES, SAMPLE_TIME, TICK, gpc_controller
from fmu_sources.controllers.gpc.control_law import GpcLaw
from fmu_sources.controllers.gpc.identification import disturbance_of, measured_every
from fmu_sources.models.corners import CORNERS
from fmu_sources.roads import RoadLayout, WheelPosition, road_curb, road_perryman3, road_sine

Preview = tuple[int, float]  # heights ahead, and the time between them [s]


class Between(PythonComponent):
    """Passes signals on, under their names after "given."."""

    kind: ClassVar[str] = "discrete"

    def __init__(self, *names: str) -> None:
        self.inputs = names  # type: ignore[misc]
        self.outputs = tuple(f"given.{name}" for name in names)  # type: ignore[misc]
        super().__init__()

    def start(self, u: np.ndarray, y: np.ndarray) -> None:
        """As at every sample."""
        y[:] = u

    def step(self, t: float, h: float, u: np.ndarray, y: np.ndarray) -> None:  # noqa: ARG002
        """Keep the values until the next sample."""
        y[:] = u


class Drop(Between):
    """Lets a car come to rest on a road that is higher [m] than the one it then meets."""

    default_step = TICK

    def __init__(self, height: float) -> None:
        super().__init__(*(f"road.{k}.height [m]" for k in CORNERS))
        self.height = height

    def start(self, u: np.ndarray, y: np.ndarray) -> None:
        """The higher road."""
        y[:] = u + self.height


class EarlySample(Between):
    """Samples responses at the instant of a command."""

    default_step = SAMPLE_TIME

    def __init__(self) -> None:
        super().__init__(*(f"{name} [{unit}]" for name, unit, *_ in RESPONSES))


class MeasuredRoad(PythonComponent):
    """Gives a controller another quantity of the road than its height; units stay those of its inputs.

    Counted from a `datum`, which the controller does not subtract: the first sample, from which it counts, is without.
    `before` are the heights under the wheels one exchange earlier.
    """

    kind: ClassVar[str] = "discrete"
    default_step = SAMPLE_TIME

    def __init__(self, disturbance: str, datum: float = 0.0, horizon: int = 8) -> None:
        every = measured_every(disturbance)
        self.stride = round(SAMPLE_TIME / every)
        self.preview: Preview = ((horizon - 1) * self.stride + 1, every)
        ahead = [(k, [f"preview.{k}[{i + 1}] [m]" for i in range(self.preview[0])]) for k in CORNERS]
        names = [n for k, heights in ahead for n in (f"before.{k} [m]", f"road.{k}.height [m]", *heights)]
        self.inputs = (*names, "speed [m/s]")  # type: ignore[misc]
        self.outputs = tuple(  # type: ignore[misc]
            f"given.{n}" for k, heights in ahead for n in (f"road.{k}.height [m]", *heights[:horizon])
        )
        super().__init__()
        self.disturbance, self.datum = disturbance, datum

    def begin(self) -> None:
        """Before the first sample the road was level."""
        self.last: np.ndarray | None = None

    def step(self, t: float, h: float, u: np.ndarray, y: np.ndarray) -> None:  # noqa: ARG002
        """Difference to the height before, of that under a wheel and of those ahead of it."""
        heights, speed = u[:-1].reshape(len(CORNERS), -1), float(u[-1])
        now = heights[:, 1]
        past = heights[:, 0] if self.stride > 1 else now if self.last is None else self.last
        under = disturbance_of(np.array([past, now]), self.disturbance, speed)[1]
        ahead = np.column_stack([past, heights[:, 2:]]).T
        ahead = disturbance_of(ahead, self.disturbance, speed)[1 :: self.stride].T
        y[:] = np.column_stack([under, ahead]).ravel() + (0.0 if self.last is None else self.datum)
        self.last = now.copy()


def insert(system: System, name: str, component: PythonComponent, target: str) -> None:
    """Add a component whose outputs are inputs of a target after "given.", and connect those that the target has."""
    system.add(name, component)
    for output in component.description.outputs:
        if (given := output.removeprefix("given.")) in system[target].description.inputs:
            system.connect(f"{name}.{output}", f"{target}.{given}")


@cache
def other_road(published: Path, name: str, preview: Preview, roll_off: float, fmi: int) -> Path:
    """A road of the study with more preview; the synthetic course with a spectrum that falls steeper: `roll_off`.

    Args:
        published: FMU of that road, which says where the wheels are.
        name: "sine", "curb" or "perryman3".
        preview: heights ahead.
        roll_off: see `perryman3_table`.
        fmi: version.

    Raises:
        CaseError: another road.
    """
    makers: dict[str, Callable[..., Component]] = {
        "sine": road_sine,
        "curb": road_curb,
        "perryman3": partial(road_perryman3, roll_off=roll_off),
    }
    check_choice("road with other preview", name, makers)
    given = FmuFile(published).description.parameters
    wheels = [WheelPosition(k, float(given[f"wheel.{k}.x"].start), 1.0 if k.endswith("l") else -1.0) for k in CORNERS]  # type: ignore[arg-type]
    return built(makers[name](RoadLayout(tuple(wheels), *preview)), fmi)


_BUILT: dict[tuple[str, int, int], Path] = {}


def built_controller(law: GpcLaw, fmi: int) -> Path:
    """The FMU for control laws of the variant and the horizon of this one, whose gains are its start values."""
    key = law.variant, law.h_p, fmi
    if key not in _BUILT:
        _BUILT[key] = built(gpc_controller(law, name=f"Gpc{law.variant.capitalize()}{law.h_p}"), fmi)
    return _BUILT[key]
