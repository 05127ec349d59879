"""A system: put together, run, looked at, closed.

    system = System()
    system.add("road", "RoadSine.fmu")
    system.add("car", "FullCarHmmwv.fmu", step="1 ms")
    system.connect_matching("road", "car", "road.*")
    system.connect("car.x", "road.x")
    recording = system.run(5.0, record=["car.body.*"])

A name is `component.variable`; the component's name ends at the first dot.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import TracebackType

from cosim.errors import CosimError, UnconnectedInputsWarning
from cosim.master.simulation import Simulation
from cosim.master.stability import Stability, coupled_spectral_radius, warn_if_unstable
from cosim.master.state import SystemState
from cosim.master.stops import StopCondition, watched_names
from cosim.recording import Recording
from cosim.system.wiring import Wiring
from cosim.time import TimeLike, positive


class System(Wiring):
    """Components, connections and rates, and their runs. See the module's docstring for an example.

    One simulation at a time runs on a system; every `run` and `initialize` starts from reset components, so
    repeated runs reuse the loaded FMUs. `close()` (or `with System() as system:`) frees them.
    """

    def __init__(self) -> None:
        super().__init__()
        self._simulation: Simulation | None = None

    def __enter__(self) -> System:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def initialize(
        self,
        start_time: TimeLike = 0,
        *,
        record: str | Iterable[str] | None = None,
        record_interval: TimeLike | None = None,
        watch: Iterable[str] = (),
        stop_time: TimeLike | None = None,
        check_stability: bool = False,
        state: SystemState | None = None,
        allow_nan: bool = False,
    ) -> Simulation:
        """Reset and initialize all components and return the `Simulation` at `start_time`.

        `record`: names and patterns as in `select`; `record_interval` [s], default the smallest step; `watch`: further
        variables that can be read while it runs (`simulation["car.x"]`). `stop_time` is only told to the FMUs. With
        `state`, saved in this system, the components in it continue from there (start_time is not used) while wiring,
        rates and parameters of the others may have changed: several controllers can be tried from one instant.
        Outputs that are NaN or infinite end the run with ComponentError unless `allow_nan`.
        """
        if self._simulation is not None:
            self._simulation.close()
        interval = None if record_interval is None else positive(record_interval, "record_interval")
        schedule = self.schedule(*([] if interval is None else [interval]))
        if schedule.unconnected:
            listed = ", ".join(schedule.unconnected[:10])
            more = f" and {len(schedule.unconnected) - 10} more" if len(schedule.unconnected) > 10 else ""
            text = f"unconnected inputs keep their start values: {listed}{more}"
            warnings.warn(text, UnconnectedInputsWarning, stacklevel=3)
        self._simulation = Simulation(
            schedule,
            start_time,
            record=self.select(record),
            record_interval=interval,
            watch=[pair for name in watch for pair in self.select([name])],
            stop_time=stop_time,
            state=state,
            allow_nan=allow_nan,
        )
        if check_stability:
            warn_if_unstable(schedule)
        return self._simulation

    def run(
        self,
        stop_time: TimeLike,
        *,
        start_time: TimeLike = 0,
        record: str | Iterable[str] | None = None,
        record_interval: TimeLike | None = None,
        stop_when: Sequence[StopCondition] = (),
        watch: Iterable[str] = (),
        csv: str | os.PathLike[str] | None = None,
        progress: bool = False,
        check_stability: bool = False,
        state: SystemState | None = None,
        allow_nan: bool = False,
    ) -> Recording:
        """Initialize, run to `stop_time` [s], to the first of `stop_when` or to where a component asks to end, and return
        the recording, whose `stopped_by` tells which.

        A failing component raises ComponentError, Ctrl-C raises Interrupted; both carry the recording so far, and with
        `csv` it is on disk in any case.
        """
        if csv is not None:
            _check_writable(Path(csv))
        with self.initialize(
            start_time,
            record=record,
            record_interval=record_interval,
            watch=[*watch, *watched_names(stop_when)],
            stop_time=stop_time,
            check_stability=check_stability,
            state=state,
            allow_nan=allow_nan,
        ) as simulation:
            try:
                simulation.advance(stop_time, stop_when=stop_when, progress=progress)
            finally:
                if csv is not None:
                    simulation.recording.to_csv(csv)
            return simulation.recording

    def coupled_spectral_radius(self) -> Stability:
        """How the coupled continuous components, linearized at their initial state, amplify a deviation over one cycle
        of the schedule; see `cosim.master.stability`. Uses the simulation that is running, or initializes one. Raises
        CosimError when no component can be linearized."""
        running = self._simulation
        if running is None or running.finished:
            with self.initialize(record=[]) as simulation:
                return coupled_spectral_radius(simulation.schedule)
        return coupled_spectral_radius(running.schedule)

    def reset(self) -> None:
        """End the simulation that is running, if any. The next `run` or `initialize` resets every component and sets
        its parameters again."""
        if self._simulation is not None:
            self._simulation.close()
            self._simulation = None

    def close(self) -> None:
        """Free all instances and remove unpacked FMUs."""
        self.reset()
        for member in self.members.values():
            member.component.close()
        for fmu in self._fmus.values():
            fmu.close()


def _check_writable(path: Path) -> None:
    """Raise CosimError now rather than after a long run."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("a").close()
    except OSError as error:
        raise CosimError(f"cannot write the recording to {path}: {error.strerror or error}") from None
