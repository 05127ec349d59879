"""Cases of an experiment that differ in numbers only, run as copies of one system in the lanes of a vector.

Each copy gives what a run of its own gives, bit for bit. A copy that cannot (it failed, or a component asked for the
end) gives nothing and is run alone: its failure is that of a single run too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from cosim import Record, Recording, StopWhen, System
from cosim.batch import Batch, CopyFailure
from cosim.core.errors import CosimError
from cosim.study.experiment import Experiment, Row

LANES_PAY = 10.0  # s of scalar work, beyond which it pays to compile it for vectors
TOGETHER, WITH_INSTANCES = 64, 16  # copies of a batch; of one in which each has FMU instances of its own
MEMORY = 64_000_000  # bytes that a batch records
BATCHES = 8  # that stay; beyond that the one used longest ago is closed

How = tuple[System, Record, tuple[StopWhen, ...]]
Values = Mapping[str, Mapping[str, Any]]
"""Parameters and start values by component."""


@dataclass(frozen=True)
class LaneRun:
    """A run that was made in lanes.

    Attributes:
        case: what was run.
        recording: what a run of its own gives.
    """

    case: Any
    recording: Recording
    _system: System
    _values: Values

    def system(self) -> System:
        """The system with the values of this run."""
        for name, values in self._values.items():
            self._system[name].values = dict(values)
        return self._system


class _QuietBatch(Batch):
    """A batch without warnings of failed copies, since these are run again."""

    def _ended(self, failure: CopyFailure) -> None:
        self.failures.append(failure)


def quiet_batch(
    system: System, record: Record, end: float, vectors: str, stops: Sequence[StopWhen] = ()
) -> Batch | None:
    """A batch of copies of a system for runs to `end` [s]; None where no component is vectorizable."""
    told, system.allow_unconnected = system.allow_unconnected, True  # single runs name unconnected inputs
    names = [f"{m.name}.{v.name}" for m, v in system.select(record.variables)]
    try:
        batch = _QuietBatch(
            system,
            1,
            record=replace(record, variables=names),
            stop_time=end,
            stop_when=stops,
            threads=1,
            vectors=vectors,
            begin=False,
        )
    except CosimError:
        return None
    finally:
        system.allow_unconnected = told
    if len(batch.scalar) == len(system.components):
        batch.close()
        return None
    return batch


class LaneRuns:
    """Batches for the cases of one experiment.

    Args:
        experiment: that is run.
        system: the wired system of a case, with the parameters of this case set.
        vectors: as in `cosim.batch.Batch`.
    """

    def __init__(self, experiment: Experiment, system: Callable[[Any], System], vectors: str) -> None:
        self._experiment, self._system, self._vectors = experiment, system, vectors
        self._batches: dict[Hashable, Batch | None] = {}  # None: it is not vectorizable

    def runs(self, cases: Mapping[int, Any]) -> Iterator[dict[int, LaneRun]]:
        """Those runs of numbered cases that are made in lanes, batch by batch."""
        if self._experiment.wiring.configure is None:
            return
        groups: dict[Hashable, tuple[How, dict[int, tuple[Values, float]]]] = {}
        for i, case in cases.items():
            try:
                key, how, own = self._described(case)
            except Exception:  # a run alone says what is wrong with it
                continue
            groups.setdefault(key, (how, {}))[1][i] = own
        for key, (how, copies) in groups.items():
            if len(copies) > 1:
                for found in self._group(key, how, copies):
                    yield {i: LaneRun(cases[i], one, how[0], copies[i][0]) for i, one in found.items()}

    def _described(self, case: Any) -> tuple[Hashable, How, tuple[Values, float]]:
        """What a case shares with the others of a batch; its own parameters and start values, and end [s]."""
        experiment, system = self._experiment, self._system(case)
        options = experiment.run
        stops = tuple(options.stop_when(system, case)) if options.stop_when else ()
        recorded = options.recorded(case)
        record = Record(recorded if recorded is None else tuple(recorded), options.interval_of(case))
        values = {m.name: dict(m.values) for m in system.components.values()}
        key = (experiment.wiring.shared(case), record, stops, tuple((m, *own) for m, own in values.items()))
        return key, (system, record, stops), (values, options.end(system, case))

    def _group(
        self, key: Hashable, how: How, copies: Mapping[int, tuple[Values, float]]
    ) -> Iterator[dict[int, Recording]]:
        """The recordings of one group; none where it is not vectorizable."""
        ends = {end for _, end in copies.values()}
        try:
            batch = self._batch(key, how, max(ends))
            if batch is None or (batch.scalar and len(ends) > 1):  # FMU instances may depend on their stop time
                return
            reached = {end: batch.end(end) for end in ends}
            recorded = 8 * reached[max(ends)][1] * len(batch.record_names)
            most = max(2, min(WITH_INSTANCES if batch.scalar else TOGETHER, MEMORY // max(1, recorded)))
            numbers = list(copies)
            for chosen in (numbers[i : i + most] for i in range(0, len(numbers), most)):
                batch.reset_each([copies[i][0] for i in chosen])
                batch.advance(max(copies[i][1] for i in chosen), final=True)
                recording = batch.recording
                last = [reached[copies[i][1]][0] for i in chosen]
                yield {
                    i: recording.one(k, last[k])
                    for k, i in enumerate(chosen)
                    if recording.failed.get(k, math.inf) > last[k]
                }
        except CosimError:  # scalar runs say why
            return

    def _batch(self, key: Hashable, how: How, end: float) -> Batch | None:
        system, record, stops = how
        known = key in self._batches
        batch = self._batches.pop(key, None)
        if batch is not None and (batch.system is not system or (batch.scalar and batch.stop_time != end)):
            batch.close()
            known = False
        if not known:
            while len(self._batches) >= BATCHES:
                oldest = self._batches.pop(next(iter(self._batches)))
                if oldest is not None:
                    oldest.close()
            batch = quiet_batch(system, record, end, self._vectors, stops)
        self._batches[key] = batch
        return batch

    def close(self) -> None:
        """Free all instances."""
        for batch in self._batches.values():
            if batch is not None:
                batch.close()
        self._batches.clear()


class _NotMade(BaseException):
    """A search needs a run that is not made yet."""


class SearchRuns:
    """A runner for searches that are done together: the runs for which they wait are made together, in lanes.

    A search ends at the first run that is not made, and begins again when it is; what it does besides must be quick.

    Args:
        runner: which makes the runs.
        vectors: as in `cosim.batch.Batch`.
    """

    def __init__(self, runner: Any, vectors: str) -> None:
        self._runner, self._vectors = runner, vectors
        self._made: dict[Any, Row | Exception] = {}
        self.in_lanes = 0
        """How many runs were copies in lanes."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._runner, name)

    def metrics(self, case: Any) -> Row:
        """Metrics of a case whose run is made."""
        if case not in self._made:
            if (stored := self._runner.stored(case)) is None:
                raise _NotMade(case)
            self._made[case] = stored["metrics"]
        found = self._made[case]
        if isinstance(found, Exception):
            raise found
        return found

    def results(self, searches: Mapping[int, Callable[[Any], Any]]) -> Iterator[tuple[int, Any]]:
        """What numbered searches find; nothing of those that fail, which fail alone too."""
        left = dict(searches)
        while left:
            missing: dict[Any, None] = {}
            for i, search in list(left.items()):
                try:
                    yield i, search(self)
                except _NotMade as run:
                    missing[run.args[0]] = None
                    continue
                except Exception:
                    pass
                del left[i]
            self._make(list(missing))

    def _make(self, cases: Sequence[Any]) -> None:
        alone = dict(enumerate(cases))
        for made in self._runner.in_lanes(dict(alone), self._vectors):
            self.in_lanes += len(made)
            for i, run in made.items():
                self._keep(alone.pop(i), run)
        for case in alone.values():
            self._keep(case, None)

    def _keep(self, case: Any, made: LaneRun | None) -> None:
        try:
            self._made[case] = self._runner.entry(case, made=made)["metrics"]
        except Exception as error:
            self._made[case] = error
