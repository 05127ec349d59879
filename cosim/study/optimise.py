"""Optimization by Optuna, ask and tell: of anything that gives numbers for values, with one objective or several.

    found = optimise(evaluate, {"damping": (3e3, 24e3)}, {"comfort": "min", "grip": "min"}, trials=60,
    storage="ride.log")

`evaluate` is a function of the values by name that gives numbers by name (and may run in any executor), or
`CaseRuns`, the cases of an experiment: these go through `cosim.study.run_study`, so what was run once is
taken from its store. Needs the extra [optimisation].
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from build_fmus.base import extras, surface
from build_fmus.base.checks import unknown, whole_number
from cosim import Execution
from cosim.core.errors import CosimError
from cosim.report.fronts import non_dominated
from cosim.study.case import CaseError, fields
from cosim.study.driver import refuse_tolerance, run_study, salt_of
from cosim.study.experiment import Experiment, Row, Task
from cosim.study.fmus import FmuSet

with extras.needed("optimisation", "optimisation"):
    import optuna
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock
    from optuna.study import StudyDirection
    from optuna.trial import TrialState

Values = Mapping[str, Any]
Evaluate = Callable[[Values], Mapping[str, float]]
Limits = tuple[float, float] | tuple[float, float, str] | Sequence[str]
"""Lowest and highest value, whole numbers if both are; `(low, high, "log")` for a logarithmic scale; or a list of
texts to choose from.
"""


@runtime_checkable
class BatchEvaluation(Protocol):
    """What tries several values at once, as `CaseRuns` does."""

    def check(self, names: Sequence[str]) -> None:
        """Refuse names that it has not."""
        ...

    def identity(self) -> str:
        """A text that changes when anything does that the numbers depend on besides the values."""
        ...

    def evaluate_batch(self, tried: Sequence[Values]) -> list[Row]:
        """Numbers by name of each; `{"failed": message}` where one has none."""
        ...


class OptimisationError(CosimError, ValueError):
    """A search that cannot be made; the message names what is wrong with it."""


@dataclass(frozen=True)
class Trial:
    """What was tried: values, the numbers that they gave, and the message where they gave none."""

    number: int
    values: Values
    row: Mapping[str, float]
    failed: str = ""


@dataclass(frozen=True)
class Outcome:
    """All trials of a search, in the order in which they were made."""

    trials: Sequence[Trial]
    objectives: Mapping[str, str]

    @property
    def done(self) -> list[Trial]:
        """The trials that gave numbers."""
        return [t for t in self.trials if not t.failed]

    @property
    def front(self) -> list[Trial]:
        """Those that no other is better than in all objectives, by the first of these; with one objective the best.

        Raises:
            OptimisationError: no trial gave numbers.
        """
        done = self.done
        if not done:
            said = next((t.failed for t in self.trials), "there was none")
            raise OptimisationError(f"no trial gave numbers: {said}")
        signs = np.array([-1.0 if d == "max" else 1.0 for d in self.objectives.values()])
        points = np.array([[t.row[n] for n in self.objectives] for t in done]) * signs
        found = [t for t, best in zip(done, non_dominated(points), strict=True) if best]
        return sorted(found, key=lambda t: t.row[next(iter(self.objectives))])

    @property
    def best(self) -> Trial:
        """The best trial of a search with one objective."""
        if len(self.objectives) != 1:
            raise OptimisationError(
                f"there are {len(self.objectives)} objectives, so there is a Pareto front instead of one best trial"
            )
        return self.front[0]


@dataclass(frozen=True)
class CaseRuns:
    """Cases of an experiment as what is tried: values are fields of `case`, numbers are its metrics.

    Args:
        experiment: what is run.
        fmus: its FMUs.
        case: what the values do not name.
        store: folder of finished runs.
        executor, processes, execution: as of `cosim.study.run_study`.
    """

    experiment: Experiment
    fmus: FmuSet
    case: Any
    store: Path
    executor: Any = None
    processes: int | None = None
    execution: Execution | None = None

    def __post_init__(self) -> None:
        refuse_tolerance(self.execution)

    def check(self, names: Sequence[str]) -> None:
        """Refuse values that are no fields of the case."""
        known = [f.name for f in fields(type(self.case))]
        for name in names:
            if name not in known:
                raise OptimisationError(unknown(f"field of the cases of {self.experiment.name}", name, known))

    def identity(self) -> str:
        """Of code, FMUs and what the case is otherwise."""
        return f"{self.case!r}|{salt_of(self.experiment, '', self.fmus, [Task(self.case)])}"

    def evaluate_batch(self, tried: Sequence[Values]) -> list[Row]:
        """Rows of several cases; `{"failed": message}` where one has none."""
        cases: list[Any] = []
        for values in tried:
            try:
                cases.append(replace(self.case, **values))
            except CaseError as error:
                cases.append(str(error))
        wanted = list(dict.fromkeys(c for c in cases if not isinstance(c, str)))
        if not wanted:
            return [{"failed": c} for c in cases]
        results = run_study(
            self.experiment,
            self.fmus,
            self.store,
            tasks=wanted,
            executor=self.executor,
            processes=self.processes,
            execution=self.execution,
        )
        ran = set(results.ran)
        return [
            {"failed": c if isinstance(c, str) else results.failure(c)} if c not in ran else results[c] for c in cases
        ]


def optimise(
    evaluate: Evaluate | BatchEvaluation,
    space: Mapping[str, Limits],
    objectives: Mapping[str, str],
    *,
    trials: int,
    storage: str | os.PathLike[str] | None = None,
    name: str = "search",
    seed: int = 0,
    batch: int = 8,
    executor: Executor | None = None,
    first: Sequence[Values] = (),
    identity: str = "",
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Outcome:
    """Search for values that make the objectives small (or large).

    Args:
        evaluate: see the module.
        space: what may be tried, by name; see `Limits`.
        objectives: "min" or "max" by name of the number.
        trials: how many in all, those of the storage among them.
        storage: file in which every trial is kept as soon as it is known; the same search continues from it, and comes
            to the same trials as one that was never interrupted, or had as many trials at once where those before were
            whole batches. None: nothing is kept.
        name: of the search in this file.
        seed: of the sampler (tree-structured Parzen estimators).
        batch: trials that are chosen together, and evaluated side by side where there is an executor. The same batch
            gives the same trials with any executor.
        executor: any of `concurrent.futures`; None: one after the other in this process. Cases of an experiment have
            their own.
        first: values that are tried before all others, such as those that are published.
        identity: of what `evaluate` depends on besides the values; a storage with trials of another one is refused.
            Cases of an experiment have their own (code, FMUs, fixed options); of a function only its author knows.
        progress: called with (done, total).

    Raises:
        OptimisationError: limits, objectives or names that do not fit; no run has an objective's number; another search
            in the storage.
    """
    check_search(space, objectives, evaluate, first)
    whole_number("trials", trials, error=OptimisationError)
    whole_number("batch", batch, error=OptimisationError)
    model = evaluate.identity() if isinstance(evaluate, BatchEvaluation) else identity
    what = {
        "space": {n: list(limits) for n, limits in space.items()},
        "objectives": dict(objectives),
        "seed": seed,
        "batch": batch,
    }
    study = _study(storage, name, objectives, what, hashlib.sha256(model.encode()).hexdigest() if model else "")
    waiting = [t.number for t in study.get_trials(deepcopy=False) if t.state == TrialState.RUNNING]
    while True:
        known = study.get_trials(deepcopy=False)
        room = min(batch - len(known) % batch, trials - len(known))
        todo, waiting = waiting or _asked(study, space, room, seed, first), []
        if not todo:
            break
        progress(min(len(known), todo[0]), trials)
        chosen = [dict(study.get_trials(deepcopy=False)[n].params) for n in todo]
        lacking = []
        for number, row in zip(todo, _rows(evaluate, chosen, executor), strict=True):
            lacking += _tell(study, number, row, objectives)
        if lacking and not any(t.state == TrialState.COMPLETE for t in study.get_trials(deepcopy=False)):
            raise OptimisationError(f"{lacking[0]}: no trial has a value of this objective")
    progress(trials, trials)
    return Outcome(_trials(study), dict(objectives))


def _asked(study: Any, space: Mapping[str, Limits], count: int, seed: int, first: Sequence[Values]) -> list[int]:
    """Numbers of trials that are chosen now.

    The sampler begins from scratch with every batch, so an interruption of the search before does not matter.
    """
    if count <= 0:
        return []
    begin = len(study.get_trials(deepcopy=False))
    several = len(study.directions) > 1
    study.sampler = optuna.samplers.TPESampler(
        seed=seed + 1_000_003 * begin, multivariate=not several, constant_liar=True
    )
    found = []
    for number in range(begin, begin + count):
        if number < len(first):
            study.enqueue_trial(dict(first[number]))
        trial = study.ask()
        for name, limits in space.items():
            _suggest(trial, name, limits)
        found.append(trial.number)
    return found


def _suggest(trial: Any, name: str, limits: Limits) -> None:
    if isinstance(limits, list) or all(isinstance(v, str) for v in limits):
        trial.suggest_categorical(name, list(limits))
        return
    low, high = limits[:2]
    log = len(limits) == 3
    if isinstance(low, int) and isinstance(high, int):
        trial.suggest_int(name, low, high, log=log)
    else:
        trial.suggest_float(name, float(low), float(high), log=log)


def _rows(
    evaluate: Evaluate | BatchEvaluation, tried: Sequence[Values], executor: Executor | None
) -> Iterable[Mapping[str, Any]]:
    """The numbers of some trials, in their order, as they come."""
    if isinstance(evaluate, BatchEvaluation):
        return evaluate.evaluate_batch(tried)
    if executor is None:
        return (_row(evaluate, values) for values in tried)
    return executor.map(_row, [evaluate] * len(tried), tried)


def _row(evaluate: Evaluate, values: Values) -> Mapping[str, Any]:
    """The numbers of a trial; a failure is one that says so."""
    try:
        return dict(evaluate(values))
    except Exception as error:
        return {"failed": f"{type(error).__name__}: {error}"}


def _tell(study: Any, number: int, row: Mapping[str, Any], objectives: Mapping[str, str]) -> list[str]:
    """Tell the search the result of a trial.

    Returns messages about a run that finished without the number of an objective.
    """
    numbers = {k: float(v) for k, v in row.items() if isinstance(v, int | float) and math.isfinite(v)}
    failed = str(row.get("failed", ""))
    lacking = [] if failed else [unknown("number", name, row) for name in objectives if name not in row]
    infinite = [f"{name} is {row[name]}" for name in objectives if name in row and name not in numbers]
    failed = failed or next(iter([*lacking, *infinite]), "")
    # Not an attribute of the trial: one that another process has asked for is a record here, without public means to
    # change it.
    study.set_user_attr(_attribute(number), {"failed": failed} if failed else {"row": numbers})
    if failed:
        study.tell(number, state=TrialState.FAIL)
    else:
        study.tell(number, [numbers[n] for n in objectives])
    return lacking


def _attribute(number: int) -> str:
    """Name of the attribute of a study that says what came of a trial."""
    return f"trial {number}"


def _trials(study: Any) -> list[Trial]:
    came = study.user_attrs
    found = []
    for frozen in study.get_trials(deepcopy=False):
        # of the trial: as storages of earlier versions have it
        told = came.get(_attribute(frozen.number), frozen.user_attrs)
        found.append(Trial(frozen.number, dict(frozen.params), told.get("row", {}), told.get("failed", "")))
    return found


def _study(
    storage: str | os.PathLike[str] | None,
    name: str,
    objectives: Mapping[str, str],
    what: Mapping[str, Any],
    model: str,
) -> Any:
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    directions = [StudyDirection.MAXIMIZE if d == "max" else StudyDirection.MINIMIZE for d in objectives.values()]
    try:
        kept = None if storage is None else _opened(Path(storage))
        study = optuna.create_study(storage=kept, study_name=name, directions=directions, load_if_exists=True)
        empty = not any(t.state == TrialState.COMPLETE for t in study.get_trials(deepcopy=False))
        if kept is not None and empty and study.user_attrs.get("what") not in (None, what):
            # nothing was found: an objective's name was wrong, most likely
            optuna.delete_study(storage=kept, study_name=name)
            study = optuna.create_study(storage=kept, study_name=name, directions=directions)
    except (ValueError, KeyError, TypeError) as error:
        raise OptimisationError(f"{storage} cannot be read as the trials of a search: {error}") from None
    before, named = study.user_attrs.get("what"), surface.hint(f" '{name}'")
    remedy = surface.hint(
        "give another file or another name", "give another folder with --out, or --force to discard its trials and runs"
    )
    if before is None:
        study.set_user_attr("what", what)
        study.set_user_attr("model", model)
    elif before != what:
        other = next(k for k in what if before.get(k) != what[k])
        raise OptimisationError(
            f"{storage} holds another search{named}, with {other} {before.get(other)} instead of {what[other]};"
            f" {remedy}"
        )
    elif study.user_attrs.get("model", "") != model:
        raise OptimisationError(
            f"{storage} holds trials of the search{named} of another model: FMUs, code or fixed options have changed"
            f" since; {remedy}"
        )
    return study


def _opened(path: Path) -> Any:
    """The trials of a file; the end of a line that a killed process left is taken away."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.is_file() and not (text := path.read_bytes()).endswith(b"\n"):
        os.truncate(path, text.rfind(b"\n") + 1)
    return JournalStorage(JournalFileBackend(str(path), lock_obj=JournalFileOpenLock(str(path))))


def check_search(
    space: Mapping[str, Limits], objectives: Mapping[str, str], evaluate: Any, first: Sequence[Values]
) -> None:
    """Refuse a search that cannot be made.

    Raises:
        OptimisationError: nothing varies, or limits, directions or first values do not fit.
    """
    if not space or not objectives:
        raise OptimisationError("a search needs at least one parameter to vary and one objective")
    for name, direction in objectives.items():
        if direction not in ("min", "max"):
            raise OptimisationError(f"the objective {name} is {direction!r}; give 'min' or 'max'")
    if isinstance(evaluate, BatchEvaluation):
        evaluate.check(list(space))
    for name, limits in space.items():
        _check_limits(name, limits)
    for values in first:
        if set(values) != set(space):
            raise OptimisationError(f"the first values are for {', '.join(values)}; give values for {', '.join(space)}")


def _check_limits(name: str, limits: Limits) -> None:
    if (
        isinstance(limits, Sequence)
        and not isinstance(limits, str)
        and limits
        and all(isinstance(v, str) for v in limits)
    ):
        return
    try:
        low, high = (float(v) for v in limits[:2])
        scale = list(limits[2:])
    except (TypeError, ValueError):
        low, high, scale = math.nan, math.nan, []
    if scale not in ([], ["log"]) or not (math.isfinite(low) and math.isfinite(high)):
        raise OptimisationError(
            f"the limits of {name} are {limits!r}; give (low, high), (low, high, 'log') or a list of texts"
        )
    if not low < high:
        raise OptimisationError(f"the limits of {name} are {low:g} to {high:g}; the lower one comes first")
    if scale and low <= 0:
        raise OptimisationError(f"the limits of {name} are {low:g} to {high:g}; a logarithmic scale has positive ones")
