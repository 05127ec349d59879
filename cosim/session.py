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
import re
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from build_fmus.base import safe_files, surface
from cosim.core.description import RECORDABLE
from cosim.core.errors import CosimError, TimeError, UnconnectedInputsWarning, WiringError
from cosim.core.interrupt import held
from cosim.core.time import TimeLike, positive, rational, seconds_text
from cosim.engine.adaptive import for_tolerance
from cosim.engine.execution import Execution, Record
from cosim.engine.simulation import Simulation
from cosim.engine.state import SystemState
from cosim.engine.stops import StopCondition, watched_names
from cosim.fmu.file import FmuFile
from cosim.linear.stability import Stability, coupled_spectral_radius, warn_if_unstable
from cosim.recording.formats import format_of
from cosim.recording.recording import Recording
from cosim.recording.spool import Spool, spool_of
from cosim.system.schedule import Schedule
from cosim.system.wiring import Wiring

if TYPE_CHECKING:
    from cosim.export.web.page import Control
    from cosim.gradient import Gradient, Metric
    from cosim.linear.exchange_error import ExchangeError
    from cosim.linear.statespace import LinearModel, Matrices
    from cosim.scenes.scene import Scene


class System(Wiring):
    """Components, connections and rates, and their runs. See the module's docstring for an example.

    One simulation at a time runs on a system; every `run` and `initialize` starts from reset components, so
    repeated runs reuse the loaded FMUs. `close()` (or `with System() as system:`) frees them.
    """

    def __init__(self, *, allow_unconnected: bool = False) -> None:
        super().__init__(allow_unconnected=allow_unconnected)
        self._simulation: Simulation | None = None
        self._room: tempfile.TemporaryDirectory[str] | None = None  # files of an SSP
        self._ssp: Path | None = None

    @classmethod
    def from_ssp(
        cls,
        path: str | os.PathLike[str],
        *,
        variant: str | None = None,
        step: TimeLike | Mapping[str, TimeLike] | None = None,
        strict: bool = False,
    ) -> System:
        """The system of an SSP 1.0 or 2.0 file, of any tool, or of the folder of an unpacked one.

        An SSP that `export_ssp` has written gives bit-identical results.

        Components of nested systems are named `system.component`. `variant`: another description than
        SystemStructure.ssd, by its name or that of its file. `step` [s]: by name or pattern how often components are
        stepped, or one for all for which neither the SSP (annotations of this project, of the Open Simulation Platform,
        of OMSimulator) nor the FMU says it. `strict`: as in `add`. `experiment` has start and stop time of the file's
        default experiment. What the standard's schemas do not allow is warned of (SspWarning); what cannot be
        represented, or leads out of the file, is refused by name (SspError).
        """
        from cosim.ssp.read import read_ssp

        system = cls()
        system._room = room = tempfile.TemporaryDirectory(dir=safe_files.scratch())
        try:
            found = read_ssp(system, Path(path), Path(room.name), variant=variant, step=step, strict=strict)
        except BaseException:
            system.close()
            raise
        system.experiment = found.start_time, found.stop_time
        system._ssp = Path(path).absolute()
        return system

    @property
    def fmu_files(self) -> list[Path]:
        """The files behind its components: FMUs, or the SSP that they are from."""
        return super().fmu_files if self._ssp is None else [self._ssp]

    def __enter__(self) -> System:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def initialize(
        self,
        start_time: TimeLike | None = None,
        *,
        record: Record | str | Iterable[str] | None = None,
        stop_time: TimeLike | None = None,
        state: SystemState | None = None,
        execution: Execution | None = None,
    ) -> Simulation:
        """Reset and initialize all components and return the `Simulation` at `start_time` [s].

        The default is 0, or the start time of the system's SSP.

        `record`: a `Record`, or only its variables. Only the FMUs use `stop_time`. With `state`, saved in this system
        or, read from a file or unpickled, in one that was put together in the same way elsewhere, the simulation
        continues from there with bit-identical values (start_time is not used). Wiring, rates and parameters of
        components that are not in it may have changed, at a common multiple of all steps: several controllers can be
        tried from one instant. `execution`: an `Execution`; its `real_time` is for `run`, `Simulation.advance` has its
        own. Outputs that are NaN or infinite end the run with ComponentError unless it allows them. Inputs that nothing
        drives keep their start values, with an UnconnectedInputsWarning that names them unless `allow_unconnected` of
        this system.
        """
        self.end_simulation()
        kept, how = _named(Record.of(record)), execution or Execution()
        how.prepare(self)
        interval = None if kept.interval is None else positive(kept.interval, "the interval of the record")
        schedule = self.schedule(*([] if interval is None else [interval]))
        tolerance = how.tolerance if schedule.continuous else None
        if tolerance is not None:
            begin = rational(self.experiment[0] if start_time is None else start_time, "start_time")
            stop = None if stop_time is None else rational(stop_time, "stop_time")
            schedule = for_tolerance(schedule, tolerance, begin, stop)
        if schedule.unconnected and not self.allow_unconnected:
            listed = ", ".join(schedule.unconnected[:10])
            more = f" and {len(schedule.unconnected) - 10} more" if len(schedule.unconnected) > 10 else ""
            meant = surface.hint(f" ({UnconnectedInputsWarning.remedy})")
            text = f"unconnected inputs keep their start values: {listed}{more}{meant}"
            warnings.warn(text, UnconnectedInputsWarning, stacklevel=3)
        simulation = self._begin(
            schedule,
            start_time,
            record=self.select(kept.variables),
            record_interval=interval,
            watch=[pair for name in kept.watch for pair in self.select([name])],
            stop_time=stop_time,
            state=state,
            allow_nan=how.allow_nan,
            loop_tolerance=how.loop_tolerance,
            tolerance=tolerance,
        )
        if how.check_stability:
            simulation.guarded(lambda: warn_if_unstable(schedule))
        return simulation

    def _begin(self, schedule: Schedule, start_time: TimeLike | None = None, **arguments: Any) -> Simulation:
        """A simulation of this system by a schedule of it; `arguments` are those of `Simulation`."""
        start = self.experiment[0] if start_time is None else start_time
        self._simulation = Simulation(schedule, start, **arguments, lock=self.lock)
        return self._simulation

    def end_simulation(self) -> None:
        """See `Wiring.end_simulation`."""
        if self._simulation is not None:
            self._simulation.close()

    def run(
        self,
        stop_time: TimeLike,
        *,
        start_time: TimeLike | None = None,
        record: Record | str | Iterable[str] | None = None,
        stop_when: Sequence[StopCondition] = (),
        output: str | os.PathLike[str] | None = None,
        progress: bool = False,
        state: SystemState | None = None,
        execution: Execution | None = None,
        tolerance: float | None = None,
    ) -> Recording:
        """Initialize, run to `stop_time` [s], and return the recording.

        The run ends earlier at the first of `stop_when`, or where a component requests the end; `stopped_by` of the
        recording tells which. The last row is the row that a longer run has at that time: discrete components that are
        due at the stop time run there.

        `record`: a `Record`, or only its variables. `output`: a file for the recording, in the format of its ending, as
        `Recording.write` says. A failing component raises ComponentError, Ctrl-C raises Interrupted; both carry the
        recording so far, and with `output` it is on disk in any case: of a process that dies `NAME.csv.part`, from
        which `cosim recover` makes the file, has all but the last tenth of a second of its work. An ending that stands
        for no format raises FormatError before anything runs. `execution`: an `Execution`: isolation, pace, checks.
        `tolerance` is short for `Execution(tolerance=...)`. The other arguments are those of `initialize`.
        """
        kept, how = Record.of(record), execution or Execution()
        if tolerance is not None:
            how = replace(how, tolerance=tolerance)
        _check_stop_time(stop_time, self.experiment[0] if start_time is None else start_time, state)
        if output is not None:
            _check_writable(Path(output))
        watched = replace(kept, watch=[*kept.watch, *watched_names(stop_when)])
        with self.initialize(start_time, record=watched, stop_time=stop_time, state=state, execution=how) as simulation:
            with _written(simulation, output, kept.display_units):
                simulation.advance(
                    stop_time, stop_when=stop_when, progress=progress, real_time=how.real_time, final=True
                )
            return simulation.recording

    def coupled_spectral_radius(self) -> Stability:
        """Growth of a deviation of the coupled continuous components over one cycle of the schedule.

        They are linearized at their initial state; see `cosim.linear.stability`. Uses the simulation that is running,
        or initializes one. Raises CosimError when no component can be linearized.
        """
        running = self._simulation
        if running is None or running.finished:
            with self.initialize(record=[]) as simulation:
                return coupled_spectral_radius(simulation.schedule)
        return coupled_spectral_radius(running.schedule)

    def exchange_error(
        self,
        stop_time: TimeLike,
        *,
        start_time: TimeLike | None = None,
        record: Record | str | Iterable[str] | None = None,
        execution: Execution | None = None,
        contributions: bool = True,
        progress: Callable[[int, int], None] | None = None,
    ) -> ExchangeError:
        """How large the error is that the exchange of values once per communication step makes, by variable.

        Print it: each recorded variable with its error, the order of that error, the error of the solvers, the coupling
        that contributes most, and a sentence of advice. `cosim.linear.exchange_error` says how it is found: four runs
        to `stop_time` [s] with communication steps of h, h/2 and h/4 of the coupled continuous components, and one more
        for each pair of them unless `contributions=False`. `progress` is called with the runs that are done, and of
        all; the other arguments are those of `run`. Raises CosimError if the runs end at different times.
        """
        from cosim.linear.exchange_error import exchange_error

        if execution is not None and execution.tolerance is not None:
            raise CosimError("the error of the exchange is that of fixed steps: leave the tolerance out")
        kept = Record.of(record)
        if kept.interval is None:
            kept = replace(kept, interval=min(m.step for m in self.components.values()))
        return exchange_error(
            self,
            lambda: self.run(stop_time, start_time=start_time, record=kept, execution=execution),
            contributions=contributions,
            progress=progress,
        )

    def linearize(
        self,
        inputs: str | Iterable[str] | None = None,
        outputs: str | Iterable[str] | None = None,
        *,
        discrete: bool | TimeLike = False,
        settle: TimeLike = 0,
    ) -> LinearModel:
        """The system's linear model about where it stands `settle` [s] after its start, as a `control.StateSpace`.

        Continuous (default): the continuous components, coupled without the delays of the exchange; inputs are outputs
        of discrete components and inputs that no continuous component drives. With `discrete=True` the whole system,
        discrete components included, over the least common multiple of all steps, or over a multiple of it
        (`discrete="10 ms"`); inputs are those that nothing drives. `cosim.linear.linearization` says what the states
        are and what is left out.

        `inputs` and `outputs`: names and patterns (`controller.*`, `car.body.az`). Defaults: commands of the discrete
        components (continuous model) and all unconnected Real inputs; all Real outputs. Names in the model are as
        `cosim.linear.statespace` says (`car.body.az` is `car_body_az`), and its `names` lead back. As in a run,
        components are reset and initialized with their parameters and start values first. Raises CosimError naming the
        component or connection that has no linear model, with the reason, LoopError for an algebraic loop without a
        solution, WiringError for names that do not fit.
        """
        from cosim.linear.statespace import LinearModel

        return LinearModel(self._linearized(inputs, outputs, discrete, settle))

    def gradient(
        self,
        metrics: Mapping[str, Metric],
        parameters: str | Iterable[str],
        *,
        stop_time: TimeLike,
        interval: TimeLike | None = None,
        threads: int | None = None,
        mode: str | None = None,
    ) -> Gradient:
        """Derivatives of metrics of a run by parameters, start values, series and inputs that nothing drives.

            found = system.gradient({"ride": Rms("car.seat.az")}, ["car.body.mass"], stop_time="8 s", interval="10 ms")

        `metrics`: by a name of your choice, of `cosim.gradient` (Mean, Rms, Peak, Final, QuadraticCost), or your own.
        `parameters`: full names and patterns, of real numbers, or of columns of a `Table`, each sample of which counts
        as a parameter. `interval`: between samples that metrics read, as in `Record`; `threads`: default all cores.
        `mode`: "forward", whose cost grows with the number of parameters, "adjoint", whose cost does not, by default
        the one that costs less. `cosim.gradient.gradient` says what is differentiated and how, and `Gradient.trust()`
        compares with differences. Raises GradientError for what has no derivative, for runs that fail or end early, and
        for components that have no adjoint, CosimError where a system has no copies (`cosim.batch`), and WiringError
        for names that do not fit.
        """
        from cosim.gradient.gradient import GradientRun

        return GradientRun(self, metrics, parameters, stop_time, interval, threads, mode).gradient()

    def _linearized(
        self,
        inputs: str | Iterable[str] | None,
        outputs: str | Iterable[str] | None,
        discrete: bool | TimeLike,
        settle: TimeLike,
    ) -> Matrices:
        from cosim.linear import linearization as linear
        from cosim.linear.sampled_model import common_period, sampled_model

        sampled, after = discrete is not False, rational(settle, "settle")
        if after < 0:
            raise TimeError(f"settle is {seconds_text(after)}; give 0 s or a longer time")
        schedule = self.schedule()
        chosen_in = linear.choose_inputs(self.components, schedule, sampled, inputs)
        chosen_out = linear.choose_outputs(self.components, schedule, sampled, outputs)
        period = common_period(schedule, None if isinstance(discrete, bool) else positive(discrete, "discrete"))
        if sampled:
            schedule = self.schedule(period)
        self.end_simulation()
        interval = period if sampled else None
        with self._begin(schedule, record=chosen_out, record_interval=interval) as simulation:
            if not sampled:
                simulation.advance(after)
            ending = simulation.exchange.ending
            if ending is not None and simulation.exchange.tick >= ending.tick:
                raise CosimError(ending.text)
            if sampled:
                return sampled_model(simulation.exchange, period, after, chosen_in, chosen_out)
            return linear.continuous_model(simulation.schedule, chosen_in, chosen_out)

    def export_fmu(
        self,
        path: str | os.PathLike[str],
        *,
        inputs: str | Iterable[str] | None = None,
        outputs: str | Iterable[str] | None = None,
        parameters: str | Iterable[str] | None = "*",
        without: Iterable[str] = (),
        fmi: int = 3,
        platforms: str = "host",
        text: str = "",
    ) -> Path:
        """Write the system as one FMU, Co-Simulation, which any tool runs: engine, exchange and components in one file.

        Its variables are those of the components, as `component.variable`. `inputs`: names and patterns; default all
        that no component drives. `outputs`: as in `select`; default all outputs that are no array elements.
        `parameters`: default all of all components, starting at the values that they have here. `without`: components
        that stay outside, with their connections; what they drove become inputs. `fmi`: 2 or 3. `platforms`: "host",
        "all", or names separated by commas. `text`: the FMU's description.

        FMUs of this project are linked from their sources, for every platform; those of others travel with the
        libraries that they have. Its step is a whole number of ticks of the schedule; the numbers are those of
        `advance`. Needs the extra [build] and a C compiler or ziglang. Raises WiringError and CosimError naming what
        cannot be in it, CompileError.
        """
        from cosim.export.code import exported_schedule
        from cosim.export.system_fmu import export_fmu

        schedule, repeated = exported_schedule(self, without), None
        if schedule.loops or schedule.possible_loops:
            self.end_simulation()  # initialization finds which loops there are, and how they are solved
            with self._begin(schedule) as started:
                e, repeated = started.exchange, started.exchange.repeated
            schedule = replace(schedule, loops=e.loops, possible_loops=(), measured=e.measured or {})
        return export_fmu(
            schedule,
            Path(path),
            inputs=inputs,
            outputs=outputs,
            parameters=parameters,
            fmi=fmi,
            platforms=platforms,
            text=text,
            repeated=repeated,
        )

    def export_web(
        self,
        path: str | os.PathLike[str],
        *,
        title: str = "",
        text: str = "",
        values: Mapping[str, float] | None = None,
        controls: Sequence[str | Control] = (),
        plots: Sequence[str] = (),
        scene: Scene | None = None,
    ) -> Path:
        """Write the system as a web page, in which it runs live, compiled to WebAssembly.

        The page is one file that needs no server, no network and nothing installed. FMUs of this project only, of FMI
        3.0.

        `title` and `text` stand above it. `values`: inputs and parameters, `component.variable`, that it starts with.
        `controls`: inputs and parameters that get a slider at once (all of them have a field below), by name or as
        `cosim.export.web.page.Control`, with words, limits and keys of their own. `plots`: outputs of the charts at
        first. `scene`: what it looks like; `cosim.scenes.infer_scene(system)` finds that by the names of its variables.
        For several systems side by side and measures: `cosim.export.web.page.export_web`. Needs the extras [build] and
        [zig]. Raises WiringError and CosimError naming what cannot be in it, CompileError.
        """
        from cosim.export.web.page import Control, PageSystem, WebPage, export_web

        made = [c if isinstance(c, Control) else Control(c, [c]) for c in controls]
        page = WebPage(title or Path(path).stem, text, made, plots)
        return export_web(Path(path), [PageSystem(page.title, self, values or {}, scene=scene)], page)

    def export_ssp(
        self,
        path: str | os.PathLike[str],
        *,
        version: str = "1.0",
        inputs: str | Iterable[str] = (),
        stop_time: TimeLike | None = None,
        text: str = "",
    ) -> Path:
        """Write the system as an SSP, "1.0" or "2.0" (System Structure and Parameterization), which other tools read.

        It has the FMUs, their connections, their values, rates and places in a picture. `from_ssp` makes the same
        system of it again.

        SSP 1.0 takes FMUs of FMI 2.0: of one of FMI 3.0 that `build-fmus` has made, its other version. SSP 2.0 takes
        that of FMI 3.0 where there is one. `inputs`: names and patterns of inputs that nothing drives, which become
        inputs of the system (not every reader takes systems that have any); default none, they keep their start values.
        `stop_time` [s]: of the default experiment; default the longest of the components'. `text`: its description. The
        system is initialized, since readers that step before they exchange need what connected inputs show then. Raises
        SspError naming what cannot travel: components in Python, isolated ones, FMUs in no version that fits.
        """
        from cosim.ssp.write import export_ssp, files_of, open_inputs

        schedule = self.schedule()
        opened = open_inputs(schedule, [inputs] if isinstance(inputs, str) else inputs)
        files_of(schedule, version)  # before anything runs
        self.end_simulation()
        numbers = [c.target_name for c in schedule.connections if c.input.type in RECORDABLE]
        with self._begin(schedule, record=[], watch=self.select(numbers)) as started:
            initial = {name: started[name] for name in numbers}
        return export_ssp(
            self.components.values(),
            schedule,
            Path(path),
            version=version,
            inputs=opened,
            initial=initial,
            text=text,
            stop_time=None if stop_time is None else positive(stop_time, "stop_time"),
        )

    def draw(self, title: str = "") -> bytes:
        """The system as a picture, SVG: its components with their rates, a line for each bundle of signals.

        The same system gives the same bytes.
        """
        from cosim.picture.svg import draw

        return draw(self.schedule(), title)

    def reset(self) -> None:
        """End the simulation that is running, if any.

        The next `run` or `initialize` resets every component and sets its parameters again.
        """
        if self._simulation is not None:
            self._simulation.close()
            self._simulation = None

    def close(self) -> None:
        """Free all instances and remove unpacked FMUs."""
        self.reset()
        with self.lock, held():
            for component in self.components.values():
                component.implementation.close()
        for fmu in self._fmus.values():
            fmu.close()
        if self._room is not None:
            self._room.cleanup()


class Fmu(FmuFile):  # noqa: D101
    __doc__ = FmuFile.__doc__

    def linearize(
        self,
        inputs: str | Iterable[str] | None = None,
        outputs: str | Iterable[str] | None = None,
        *,
        parameters: Mapping[str, Any] | None = None,
        start: Mapping[str, Any] | None = None,
        settle: TimeLike = 0,
        period: TimeLike | None = None,
    ) -> LinearModel:
        """Its linear model as a `control.StateSpace` with the names of its signals.

        `body.az` becomes `body_az`; `names` maps back.

        `parameters` and `start` set variables before initialization, as in `System.add`; with `settle` [s] it is
        stepped so long with these inputs before. `inputs` and `outputs`: names and patterns, by default all Real ones.
        A continuous FMU needs directional derivatives, or Model Exchange for differences. A sampled one of this project
        gives a discrete model over its sample time, or over `period` [s], after which it does the same again. Raises
        CosimError with the reason where there is no linear model, WiringError for names and values that do not fit.
        """
        from cosim.linear.statespace import LinearModel

        name = re.sub(r"\W", "_", self.description.name)
        with System() as system:
            component = system.add(
                name, self, step=None if self.description.default_step else "1 ms", parameters=parameters, start=start
            )
            chosen_in, chosen_out = _below(name, inputs), _below(name, outputs)
            matrices = system._linearized(
                chosen_in, chosen_out, period or True if component.discrete else False, settle
            )
        return LinearModel(matrices.within(name))


def _named(kept: Record) -> Record:
    """Raise WiringError for what names no variables."""
    names = kept.names if isinstance(kept.variables, str | Iterable | None) else [kept.variables]
    if wrong := [n for n in names if not isinstance(n, str)]:
        raise WiringError(f"record holds {wrong[0]!r}; give names and patterns of variables, such as ['car.body.*']")
    return kept if kept.variables is None else replace(kept, variables=names)


def _check_stop_time(stop_time: TimeLike, start_time: TimeLike, state: SystemState | None) -> None:
    """Raise TimeError for a run that would end before it begins."""
    stop, start = rational(stop_time, "stop_time"), rational(start_time, "start_time")
    if state is None and stop < start:
        raise TimeError(
            f"stop_time is {seconds_text(stop)}, before the start at {seconds_text(start)}; give a time after the start"
        )


def _below(component: str, patterns: str | Iterable[str] | None) -> list[str] | None:
    """Names of a component's variables as those of a system."""
    return (
        None
        if patterns is None
        else [f"{component}.{p}" for p in ([patterns] if isinstance(patterns, str) else patterns)]
    )


@contextmanager
def _written(simulation: Simulation, file: str | os.PathLike[str] | None, display_units: bool) -> Iterator[None]:
    """The recording of what is done in the block goes to a file, row by row until the block ends, in whichever way."""
    if file is None:
        yield
        return
    path = Path(os.path.realpath(file))
    recording = simulation.recording
    spool = Spool(spool_of(path), recording.names, recording.units, recording.types) if path.is_file() else None
    simulation.spool(spool)
    written = False
    try:
        try:
            yield
        finally:
            recording = simulation.recording
            (recording.in_units() if display_units else recording).write(file)
            written = True
    finally:
        simulation.spool(None)
        if spool is not None:
            spool.close(keep=not written)


def _check_writable(path: Path) -> None:
    """Raise FormatError, MissingExtraError or CosimError now rather than after a long run."""
    format_of(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("a").close()
    except OSError as error:
        raise CosimError(f"cannot write the recording to {path}: {error.strerror or error}") from None
