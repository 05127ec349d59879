"""An experiment: what is wired, run and measured for a case, which cases make a study, and what is claimed of them.

    EXPERIMENT = Experiment(
        "ride",
        Ride,
        Wiring(wire, configure=configure),
        Measures(measure),
        RunOptions(stop_time=5.0, record=["car.*"]),
        study=Study(grid(Ride, speed=(30, 50))),
    )

Everything but case, `wire` and `measure` has a default. Functions are module-level functions, so that workers in
other processes find them.
"""

from __future__ import annotations

import importlib
import json
import math
import re
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from build_fmus.base import surface
from build_fmus.base.checks import one_line
from cosim.core.errors import CosimError
from cosim.study.case import CaseError, differing, label
from cosim.study.fmus import FmuSet

Row = dict[str, Any]
"""What is measured of a run: JSON values by name."""


class MeasureError(CosimError, TypeError):
    """What `measure` returned are no numbers by name."""


@dataclass(frozen=True)
class Run:
    """A run that has ended: its case, what was recorded, and the system as it was wired and set for it."""

    case: Any
    recording: Any
    system: Any

    def start(self, name: str) -> Any:
        """Start value `component.variable` of this run: as set for it, else the FMU's own."""
        owner, variable = self.system.components.parts(name)
        return self.system[owner].start(variable)


class Search(Protocol):
    """A task of a study that is more than one run, such as looking for the weight that matches a response.

    A frozen dataclass of JSON values at module level; `label` names it, `cost` is its rough time in runs. With an
    attribute `part` it gets a runner of that part of the experiment. Searches with the same attribute `beside` are done
    together, so that their runs can be made in lanes: they ask for metrics only, and do little else.
    """

    @property
    def label(self) -> str:
        """For people: which one it is."""

    def __call__(self, runner: Any) -> Any:
        """Do it with a `cosim.study.Runner`; the result is a JSON value."""


@dataclass(frozen=True)
class Task:
    """One run of a study: its case, whether time histories are kept besides the metrics, and its rough relative time.

    `part`: name of the part of the experiment that the case belongs to, which the experiment fills in.
    """

    case: Any
    signals: bool = False
    cost: float = 1.0
    part: str = ""

    @property
    def label(self) -> str:
        """Names the run, also among those of other parts."""
        own = str(getattr(self.case, "label", None) or label(self.case))
        return f"{self.part}: {own}" if self.part else own


@dataclass(frozen=True)
class DefaultExchangeError:
    """A search: the error of the exchange in the run of the default case, as the sentence that a page shows."""

    variables: tuple[str, ...]
    label: str = "error of the exchange in the default run"
    cost: float = 6.0

    def __call__(self, runner: Any) -> str:
        """The sentence."""
        found: str = runner.exchange_error(runner.experiment.case(), self.variables).advice()
        return found


@dataclass(frozen=True)
class Metric:
    """How a metric is shown: words, unit, the factor to it from what was measured (SI), and a format."""

    text: str
    unit: str = ""
    factor: float = 1.0
    form: str = "{:.4g}"

    @property
    def heading(self) -> str:
        """Words and unit."""
        return f"{self.text} [{self.unit}]" if self.unit else self.text

    def shown(self, value: float | str | None) -> str:
        """The value as people read it; a text as it is, a dash for None."""
        return "-" if value is None else value if isinstance(value, str) else self.form.format(self.factor * value)


def beside(task: Task | Search) -> str:
    """Which searches a task is done with; empty for one that is done alone."""
    return str(getattr(task, "beside", ""))


_WITH_UNIT = re.compile(r"(\S.*) \[([^\[\]]+)\]")


def undeclared(name: str) -> Metric:
    """Display of a metric that the experiment does not declare, by its name with the unit, "peak force [N]"."""
    found = _WITH_UNIT.fullmatch(name)
    return Metric(found[1], found[2]) if found else Metric(name)


@dataclass(frozen=True)
class Wiring:
    """How the system of a case is made.

    Attributes:
        wire: makes the system of a case from the FMUs.
        structure: what of a case decides the wiring. Cases alike in it share one system, which `configure` sets for
            each. By default all cases share one when there is a `configure`, and none do when there is not.
        configure: sets the parameters of a case, all of them, in a system that was wired for its structure.
        fmus: names of the FMUs that any case needs; they are looked for before a study starts.
        own_fmus: FMUs of a user's files, a function of experiment name, folder, FMI version, vehicle files and case, or
            "module:NAME" of one; None where no files are taken.
        takes_fmus: whether `wire` takes FMUs from the set that it is given; otherwise commands refuse `--fmus`.
    """

    wire: Callable[[FmuSet, Any], Any]
    structure: Callable[[Any], Hashable] | None = None
    configure: Callable[[Any, Any], None] | None = None
    fmus: Collection[str] = ()
    own_fmus: Callable[..., FmuSet] | str | None = None
    takes_fmus: bool = True

    def shared(self, case: Any) -> Hashable:
        """What cases that share a system are alike in."""
        return self.structure(case) if self.structure else None if self.configure else case


@dataclass(frozen=True)
class RunOptions:
    """How long a case runs, and what is recorded of it.

    Attributes:
        stop_time: [s], a number or a function of system and case.
        record: names and patterns, or a function of the case; None for all outputs.
        interval: [s], a time or a function of the case; None for the smallest step.
        stop_when: conditions that end a run, a function of system and case.
        begin: when metrics begin [s], likewise; a case that ends before is refused.
    """

    stop_time: float | Callable[[Any, Any], float] = 10.0
    record: Sequence[str] | Callable[[Any], Sequence[str]] | None = None
    interval: Any = None
    stop_when: Callable[[Any, Any], Sequence[Any]] | None = None
    begin: Callable[[Any, Any], float] | None = None

    def end(self, system: Any, case: Any) -> float:
        """How long a case runs at most [s].

        Raises:
            CaseError: it would end before its metrics begin.
        """
        end = self.stop_time(system, case) if callable(self.stop_time) else self.stop_time
        if self.begin is not None and end <= (begin := self.begin(system, case)):
            remedy = surface.given(duration=math.floor(begin) + 1) if hasattr(case, "duration") else "a longer run"
            raise CaseError(f"the run ends after {end:g} s, before its metrics begin at {begin:.3g} s: give {remedy}")
        return end

    def recorded(self, case: Any) -> Sequence[str] | None:
        """Names and patterns of what is recorded of a case."""
        return self.record(case) if callable(self.record) else self.record

    def interval_of(self, case: Any) -> Any:
        """Time between two samples of the recording of a case."""
        return self.interval(case) if callable(self.interval) else self.interval


@dataclass(frozen=True)
class Measures:
    """What is measured of a run, and how it is shown.

    Attributes:
        measure: metrics of a run, JSON values by name.
        metrics: how metrics are shown, by name, in the order of tables.
        signals: what is kept of a run over time, JSON values by name, for tasks that ask for it.
        failed: metrics of a run that ended with an error, where that is an outcome and no failure of the study.
        remarks: what should be said of a run besides its metrics.
    """

    measure: Callable[[Run], Row]
    metrics: Mapping[str, Metric] = field(default_factory=dict)
    signals: Callable[[Run], Row] | None = None
    failed: Callable[[Any, Exception], Row] | None = None
    remarks: Callable[[Run], Sequence[str]] | None = None


@dataclass(frozen=True)
class Baseline:
    """The run that a run is shown beside.

    Attributes:
        case: the baseline of a case, or None.
        own: likewise where FMUs are those of a user's vehicle, a function of the case and the FMUs; by default the same
            case.
        called: what a case is called in tables; by default its controller.
        about: what a baseline is, in words, a function of its case; by default the fields in which it differs from the
            run.
        relative: metrics of a run are also shown as per cent of the baseline's.
        compared: more metrics of a run beside its baseline, a function of both rows.
    """

    case: Callable[[Any], Any] | None = None
    own: Callable[[Any, FmuSet], Any] | None = None
    called: Callable[[Any], str] | None = None
    about: Callable[[Any], str] | None = None
    relative: bool = False
    compared: Callable[[Row, Row], Row] | None = None

    def beside(self, case: Any, fmus: FmuSet) -> Any:
        """The baseline case that a run is compared with; None if there is none."""
        if self.own is not None and fmus.vehicles:
            return self.own(case, fmus)
        return self.case(case) if self.case else None

    def name_of(self, case: Any) -> str:
        """What a case is called beside others: the controller, where there is one."""
        return self.called(case) if self.called else str(getattr(case, "controller", None) or "run")

    def sentence(self, baseline: Any, case: Any) -> str:
        """What the baseline of a run is."""
        changed = ", ".join(f"{f.name} {getattr(baseline, f.attribute)}" for f in differing([case, baseline]))
        words = self.about(baseline) if self.about else f"the same run with {changed}"
        return f"{self.name_of(baseline)} is the baseline: {words}"


@dataclass(frozen=True)
class Study:
    """The runs of a study, and its page.

    Attributes:
        plan: tasks (or cases) of the study, or a function that gives them; its `click.option`s are options of the
            command.
        parts: experiments on parts of the same matter, with cases and wirings of their own, or "module:NAME" of them.
            The study does the plans of its parts too, and its own plan may hold cases of theirs; claims and report find
            them all in its results.
        claims: published statements, a `cosim.study.ClaimList`, or "module:NAME" of one.
        exchange_error: names and patterns of variables; the study also estimates their error of the exchange in the
            run of the default case, and its page tells it.
        report: the page of a study, a function of results and FMUs that gives a `cosim.report.Report`, or
            "module:NAME" of one; by default a table and curves over what differs.
        papers: sources by short name, for the provenance, or "module:NAME" of them.
    """

    plan: Iterable[Any] | Callable[..., Iterable[Any]] | None = None
    parts: Sequence[Experiment | str] = ()
    claims: Any = None
    exchange_error: Sequence[str] = ()
    report: Callable[..., Any] | str | None = None
    papers: Mapping[str, str] | str = field(default_factory=dict)


@dataclass(frozen=True)
class Experiment:
    """See the module.

    Attributes:
        name: of its folder of results and on the command line.
        case: class of its cases, any frozen dataclass with fields made by `cosim.study.option`.
        wiring: how the system of a case is made.
        measures: what is measured of a run.
        run: how long a case runs, and what is recorded of it.
        baseline: what a run is shown beside.
        study: the runs of a study, and its page.
        page: writes a page about single runs: called with runs by name, FMUs and folder; gives the page's path.
        web: how a case is shown as a live web page, a function of the case that gives a `cosim.study.web.Live`,
            or "module:NAME" of one; by default the system alone.
        title: one line.
        module: where the experiment can be imported from, `__name__` of the module that has it as EXPERIMENT; or its
            file.
    """

    name: str
    case: type
    wiring: Wiring
    measures: Measures
    run: RunOptions = RunOptions()
    baseline: Baseline = Baseline()
    study: Study = Study()
    page: Callable[..., Any] | str | None = None
    web: Callable[[Any], Any] | str | None = None
    title: str = ""
    module: str = ""

    def __post_init__(self) -> None:
        if not self.name or any(c.isspace() or c in "/\\" for c in self.name):
            raise CaseError(
                f"the name of an experiment becomes a folder: {self.name!r} is empty, or has blanks or slashes"
            )

    def measured(self, run: Run) -> Row:
        """What `measure` gives of a run.

        Raises:
            MeasureError: it is something else than JSON values by name; numbers of NumPy become Python's.
        """
        row: Any = self.measures.measure(run)
        if not isinstance(row, Mapping) or not all(isinstance(name, str) for name in row):
            raise MeasureError(
                f"{self.name}: measure() returned {one_line(repr(row))}; it returns numbers by name, as in {{'peak':"
                " 1.5}"
            )
        found = {name: value.item() if isinstance(value, np.generic) else value for name, value in row.items()}
        for name, value in found.items():
            try:
                json.dumps(value)
            except (TypeError, ValueError):
                raise MeasureError(
                    f"{self.name}: measure() returned {one_line(repr(value), 80)} as '{name}'; it returns numbers by"
                    " name, as in {'peak': 1.5}"
                ) from None
        return found

    @property
    def functions(self) -> list[Any]:
        """What a run's numbers depend on: the functions and classes that wire, run and measure."""
        wiring, run, measures = self.wiring, self.run, self.measures
        parts = (
            self.case,
            *(wiring.wire, wiring.structure, wiring.configure),
            *(run.stop_time, run.record, run.interval, run.stop_when, run.begin),
            *(measures.measure, measures.signals, measures.failed),
        )
        return [p for p in parts if callable(p)]

    @property
    def every(self) -> list[Experiment]:
        """This experiment and its parts.

        Raises:
            CaseError: two of them have the same name or class of cases, or a part has parts itself.
        """
        found: list[Experiment] = [self, *(resolved(p) for p in self.study.parts)]
        for part in found[1:]:
            if part.study.parts:
                raise CaseError(f"{part.name} is a part of {self.name} and has parts itself; name them in {self.name}")
        for what, values in (("name", [e.name for e in found]), ("class of cases", [e.case for e in found])):
            if len(set(values)) < len(values):
                raise CaseError(f"{self.name} and its parts: each needs its own {what}, which tells their runs apart")
        return found

    def part(self, name: str) -> Experiment:
        """The part of this name; the experiment itself by its own name or an empty one."""
        return next(e for e in self.every if e.name == (name or self.name))

    def tasks(self, **options: Any) -> list[Task | Search]:
        """The tasks of the study and of its parts, each once. `options` are those of the plan.

        Raises:
            CaseError: the experiment has no plan, or one that is empty.
        """
        return self.placed([*_planned(self, options), *(t for part in self.every[1:] for t in _planned(part, {}))])

    def placed(self, tasks: Iterable[Any]) -> list[Task | Search]:
        """Tasks as the study runs them, each once: a case alone is a task, and each knows its part.

        Raises:
            CaseError: there are none.
        """
        kinds = {e.case: e.name for e in self.every[1:]}
        found = []
        for t in tasks:
            task = Task(t) if isinstance(t, (self.case, *kinds)) else t
            found.append(replace(task, part=kinds.get(type(task.case), "")) if isinstance(task, Task) else task)
        if not found:
            raise CaseError(f"{self.name} has no plan: name the values that its study runs over")
        return list(dict.fromkeys(found))


def _planned(experiment: Experiment, options: Mapping[str, Any]) -> Iterable[Any]:
    plan = experiment.study.plan
    found = [*((plan(**options) if callable(plan) else plan) or ())]
    variables = experiment.study.exchange_error
    return [*found, DefaultExchangeError(tuple(variables))] if found and variables else found


def resolved(named: Any) -> Any:
    """The object that "module:NAME" names; any other value is returned as it is.

    Pages and claims are named in this way, because runs need not load them.
    """
    if isinstance(named, str):
        module, _, name = named.partition(":")
        return getattr(importlib.import_module(module), name)
    return named
