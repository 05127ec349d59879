"""An experiment: what is wired, run and measured for a case, which cases make a study, and what is claimed of them.

    EXPERIMENT = Experiment("ride", Ride, wire=wire, stop_time=5.0, record=["car.*"], measure=measure, plan=grid(Ride,
    ...))

Everything but case, `wire` and `measure` has a default. Functions are module-level functions, so that workers in
other processes find them.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

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
        component = self.system[owner]
        found = component.description.find(variable, owner)
        return component.values.get(found.name, found.start)


class Search(Protocol):
    """A task of a study that is more than one run, such as looking for the weight that matches a response.

    A frozen dataclass of JSON values at module level; `label` names it, `cost` is its rough time in runs. With an
    attribute `part` it gets a runner of that part of the experiment.
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


_WITH_UNIT = re.compile(r"(\S.*) \[([^\[\]]+)\]")


def undeclared(name: str) -> Metric:
    """Display of a metric that the experiment does not declare, by its name with the unit, "peak force [N]"."""
    found = _WITH_UNIT.fullmatch(name)
    return Metric(found[1], found[2]) if found else Metric(name)


@dataclass(frozen=True)
class Experiment:
    """See the module. `case` may be any frozen dataclass with fields made by `cosim.study.option`.

    Attributes:
        name: of its folder of results and on the command line.
        case: class of its cases.
        wire: makes the system of a case from the FMUs.
        measure: metrics of a run, JSON values by name.
        title: one line.
        fmus: names of the FMUs that any case needs; they are looked for before a study starts.
        structure: what of a case decides the wiring. Cases alike in it share one system, which `configure` sets for
            each. By default all cases share one when there is a `configure`, and none do when there is not.
        configure: sets the parameters of a case, all of them, in a system that was wired for its structure.
        stop_time: [s], a number or a function of system and case.
        record: names and patterns, or a function of the case; None for all outputs.
        record_interval: [s], a time or a function of the case; None for the smallest step.
        stop_when: conditions that end a run, a function of system and case.
        signals: what is kept of a run over time, JSON values by name, for tasks that ask for it.
        failed: metrics of a run that ended with an error, where that is an outcome and no failure of the study.
        plan: tasks (or cases) of the study, or a function that gives them.
        parts: experiments on parts of the same matter, with cases and wirings of their own, or "module:NAME" of them.
            The study does the plans of its parts too, and its own plan may hold cases of theirs; claims and report find
            them all in its results.
        metrics: how metrics are shown, by name, in the order of tables.
        baseline: the case that a run is shown beside, or None.
        own_baseline: likewise where FMUs are those of a user's vehicle, a function of the case and the FMUs; by default
            the same case.
        called: what a case is called in tables; by default its controller.
        about: what a baseline is, in words, a function of its case; by default the fields in which it differs from the
            run.
        relative: metrics of a run are also shown as per cent of the baseline's.
        compared: more metrics of a run beside its baseline, a function of both rows.
        remarks: what should be said of a run besides its metrics.
        page: writes a page about single runs: called with runs by name, FMUs and folder; gives the page's path.
        claims: published statements, a `cosim.study.ClaimList`, or "module:NAME" of one.
        report: the page of a study, a function of results and FMUs that gives a `cosim.report.Report`, or
            "module:NAME" of one; by default a table and curves over what differs.
        web: how a case is shown as a live web page, a function of the case that gives a `cosim.study.web.Live`,
            or "module:NAME" of one; by default the system alone.
        own_fmus: FMUs of a user's files, a function of experiment name, folder, FMI version, vehicle files and case;
            None where no files are taken.
        papers: sources by short name, for the provenance, or "module:NAME" of them.
        module: where the experiment can be imported from, `__name__` of the module that has it as EXPERIMENT; or its
            file.
    """

    name: str
    case: type
    wire: Callable[[FmuSet, Any], Any]
    measure: Callable[[Run], Row]
    title: str = ""
    fmus: Collection[str] = ()
    structure: Callable[[Any], Hashable] | None = None
    configure: Callable[[Any, Any], None] | None = None
    stop_time: float | Callable[[Any, Any], float] = 10.0
    record: Sequence[str] | Callable[[Any], Sequence[str]] | None = None
    record_interval: Any = None
    stop_when: Callable[[Any, Any], Sequence[Any]] | None = None
    signals: Callable[[Run], Row] | None = None
    failed: Callable[[Any, Exception], Row] | None = None
    plan: Iterable[Any] | Callable[..., Iterable[Any]] | None = None
    parts: Sequence[Experiment | str] = ()
    metrics: Mapping[str, Metric] = field(default_factory=dict)
    baseline: Callable[[Any], Any] | None = None
    own_baseline: Callable[[Any, FmuSet], Any] | None = None
    called: Callable[[Any], str] | None = None
    about: Callable[[Any], str] | None = None
    relative: bool = False
    compared: Callable[[Row, Row], Row] | None = None
    remarks: Callable[[Run], Sequence[str]] | None = None
    page: Callable[..., Any] | str | None = None
    claims: Any = None
    report: Callable[..., Any] | str | None = None
    web: Callable[[Any], Any] | str | None = None
    own_fmus: Callable[..., FmuSet] | str | None = None
    papers: Mapping[str, str] | str = field(default_factory=dict)
    module: str = ""

    def __post_init__(self) -> None:
        if not self.name or any(c.isspace() or c in "/\\" for c in self.name):
            raise CaseError(
                f"the name of an experiment becomes a folder: {self.name!r} is empty, or has blanks or slashes"
            )

    def measured(self, run: Run) -> Row:
        """What `measure` gives of a run.

        Raises:
            MeasureError: it is something else than values by name.
        """
        row: Any = self.measure(run)
        if not isinstance(row, Mapping) or not all(isinstance(name, str) for name in row):
            raise MeasureError(
                f"{self.name}: measure() returned {one_line(repr(row))}; it returns numbers by name, as in {{'peak':"
                " 1.5}"
            )
        return dict(row)

    def beside(self, case: Any, fmus: FmuSet) -> Any:
        """The baseline case that a run is compared with; None if the experiment names no baseline."""
        if self.own_baseline is not None and fmus.vehicles:
            return self.own_baseline(case, fmus)
        return self.baseline(case) if self.baseline else None

    def name_of(self, case: Any) -> str:
        """What a case is called beside others: the controller, where there is one."""
        return self.called(case) if self.called else str(getattr(case, "controller", None) or "run")

    def about_baseline(self, baseline: Any, case: Any) -> str:
        """What the baseline of a run is, in a sentence."""
        changed = ", ".join(f"{f.name} {getattr(baseline, f.attribute)}" for f in differing([case, baseline]))
        words = self.about(baseline) if self.about else f"the same run with {changed}"
        return f"{self.name_of(baseline)} is the baseline: {words}"

    @property
    def functions(self) -> list[Any]:
        """What a run's numbers depend on: the functions and classes that wire, run and measure."""
        parts = (
            self.case,
            self.wire,
            self.measure,
            self.structure,
            self.configure,
            self.stop_time,
            self.record,
            self.record_interval,
            self.stop_when,
            self.signals,
            self.failed,
        )
        return [p for p in parts if callable(p)]

    @property
    def every(self) -> list[Experiment]:
        """This experiment and its parts.

        Raises:
            CaseError: two of them have the same name or class of cases, or a part has parts itself.
        """
        found: list[Experiment] = [self, *(resolved(p) for p in self.parts)]
        for part in found[1:]:
            if part.parts:
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
    return (experiment.plan(**options) if callable(experiment.plan) else experiment.plan) or ()


def resolved(named: Any) -> Any:
    """The object that "module:NAME" names; any other value is returned as it is.

    Pages and claims are named in this way, because runs need not load them.
    """
    if isinstance(named, str):
        module, _, name = named.partition(":")
        return getattr(importlib.import_module(module), name)
    return named
