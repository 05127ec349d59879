"""Runs cases of an experiment: systems are wired once per structure, reset and reused."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from build_fmus.base import surface
from cosim import ComponentError, Execution, Record, Recording, System
from cosim.recording.formats import write
from cosim.study.case import check, named_files, values
from cosim.study.experiment import Experiment, Row, Run
from cosim.study.fmus import FmuSet
from cosim.study.lanes import LaneRun, LaneRuns
from cosim.tables import TableError, drive

if TYPE_CHECKING:  # how results are kept is no part of what they depend on
    from cosim.study.store import RunStore


SYSTEMS = 32  # that stay open; beyond that the one used longest ago is closed


class Runner:
    """Runs of one experiment in this process.

    Args:
        experiment: what is run.
        fmus: the FMU files.
        store: where finished runs are kept; None: nowhere.
        execution: how systems are executed.
        inputs: files whose columns drive the inputs that they name, see `cosim.tables.drive`; their runs are not
            stored.
        hold_inputs: a run may last longer than these files.
    """

    def __init__(
        self,
        experiment: Experiment,
        fmus: FmuSet,
        store: RunStore | None = None,
        execution: Execution | None = None,
        *,
        inputs: Sequence[Path] = (),
        hold_inputs: bool = False,
    ) -> None:
        self.experiment = experiment
        self.fmus = fmus
        self.store = None if inputs else store
        self.execution = execution or Execution()
        self.inputs, self.hold_inputs = tuple(inputs), hold_inputs
        self._systems: dict[Hashable, System] = {}
        self._lanes: dict[str, LaneRuns] = {}  # by vectors

    def __enter__(self) -> Runner:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def system(self, case: Any) -> System:
        """The wired system of a case, with the parameters of this case set."""
        check(case)
        wiring = self.experiment.wiring
        key = wiring.shared(case)
        system = self._systems.pop(key, None)
        if system is None:
            while len(self._systems) >= (1 if not (wiring.configure or wiring.structure) else SYSTEMS):
                self._systems.pop(next(iter(self._systems))).close()
            system = wiring.wire(self.fmus, case)
            driven: dict[str, Path] = {}
            for path in self.inputs:
                for name in drive(system, path, after="hold" if self.hold_inputs else "error"):
                    if name in driven:
                        raise TableError(f"{driven[name]} and {path} both drive {name}: leave one of the columns out")
                    driven[name] = path
            self.execution.prepare(system, every=False)  # not every case has every component
        self._systems[key] = system
        if wiring.configure is not None:
            wiring.configure(system, case)
        return system

    def run(
        self,
        case: Any,
        *,
        output: Path | None = None,
        progress: bool = False,
        record: Record | Sequence[str] | None = None,
        stop_time: float | None = None,
        real_time: float | None = None,
    ) -> Run:
        """Run a case.

        Args:
            case: the case.
            output: file of the recording, see `cosim.System.run`.
            progress: show it.
            record: others than the experiment's; a `Record` without variables or interval has the experiment's.
            stop_time: [s], another than the experiment's.
            real_time: pace, see `cosim.System.run`.

        Raises:
            ComponentError: a component failed (a diverging loop, for one); `error.recording` holds what was recorded.
        """
        options, system = self.experiment.run, self.system(case)
        kept = Record.of(record or None)
        if kept.variables is None:
            kept = replace(kept, variables=options.recorded(case))
        if kept.interval is None:
            kept = replace(kept, interval=options.interval_of(case))
        recording = system.run(
            options.end(system, case) if stop_time is None else stop_time,
            record=kept,
            stop_when=options.stop_when(system, case) if options.stop_when else (),
            output=output,
            progress=progress,
            execution=replace(self.execution, isolate=(), real_time=real_time),
        )
        return Run(case, recording, system)

    def record(self, case: Any, **options: Any) -> Recording:
        """The recording of `run`."""
        found: Recording = self.run(case, **options).recording
        return found

    def exchange_error(
        self,
        case: Any,
        variables: Sequence[str] = (),
        *,
        contributions: bool = True,
        progress: Callable[[int, int], None] | None = None,
    ) -> Any:
        """A `cosim.linear.exchange_error.ExchangeError`: of the run of a case.

        `variables` are by default those that the experiment records.
        """
        options, system = self.experiment.run, self.system(case)
        return system.exchange_error(
            options.end(system, case),
            record=Record(variables or options.recorded(case), options.interval_of(case)),
            execution=self.execution,
            contributions=contributions,
            progress=progress,
        )

    def in_lanes(self, cases: Mapping[int, Any], vectors: str) -> Iterator[dict[int, LaneRun]]:
        """Those runs of numbered cases that are made in the lanes of these vectors, some at a time."""
        if self.inputs or replace(self.execution, lanes=None) != Execution():
            return iter(())
        if vectors not in self._lanes:
            self._lanes[vectors] = LaneRuns(self.experiment, self.system, vectors)
        return self._lanes[vectors].runs(cases)

    def entry(
        self, case: Any, *, signals: bool = False, history: Path | None = None, made: LaneRun | None = None
    ) -> Row:
        """`metrics` of a case, and `signals` if requested, as JSON values; stored if possible.

        `history`: file for the recording. `made`: the run of this case, if it was made already.
        """
        if self.store is None:
            return self._entry(case, signals=signals, history=history, made=made)
        found = self.stored(case, signals=signals)
        if found is None:
            found = self.store.put(entry_key(case, signals=signals), self._entry(case, signals=signals, made=made))
        return found

    def stored(self, case: Any, *, signals: bool = False) -> Row | None:
        """The stored entry of a case; None if it is not stored or its run failed, which is then made again."""
        found: Row | None = None if self.store is None else self.store.find(entry_key(case, signals=signals))
        return None if found is None or "failed" in found else found

    def metrics(self, case: Any) -> Row:
        """Metrics of a case; stored if possible."""
        found: Row = self.entry(case)["metrics"]
        return found

    def _entry(self, case: Any, *, signals: bool, history: Path | None = None, made: LaneRun | None = None) -> Row:
        measures = self.experiment.measures
        try:
            run = self.run(case) if made is None else Run(case, made.recording, made.system())
        except ComponentError as error:
            if history is not None and error.recording is not None:
                _keep(history, error.recording)
            if measures.failed is None:
                raise
            return {"metrics": measures.failed(case, error)}
        if history is not None:
            _keep(history, run.recording)
        found: Row = {"metrics": self.experiment.measured(run)}
        if signals and measures.signals is not None:
            found["signals"] = measures.signals(run)
        return found

    def close(self) -> None:
        """Free all FMUs."""
        for lanes in self._lanes.values():
            lanes.close()
        for system in self._systems.values():
            system.close()
        self._systems.clear()


class HistoryError(OSError):
    """A recording that was to be kept and cannot be written: no fault of the run, and no other one will fare better."""


def _keep(path: Path, recording: Recording) -> None:
    try:
        write(path, recording)
    except OSError as error:
        raise HistoryError(
            f"{path}: the recording of a run cannot be stored ({error.strerror or error}); free space or choose another"
            f" folder{surface.hint(shell=' with --out')}"
        ) from None


def entry_key(case: Any, *, signals: bool = False) -> Any:
    """Key of a run in a store; files that the case names count by their contents, one that is not there as none."""
    found = ["signals" if signals else "metrics", values(case)]
    contents = [hashlib.sha256(p.read_bytes()).hexdigest() if p.is_file() else "" for p in named_files(case)]
    return [*found, contents] if contents else found
