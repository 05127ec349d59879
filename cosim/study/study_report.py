"""The report of a study, declared section by section.

    report = StudyReport(EXPERIMENT, "Damping of a quarter car", claims=CLAIMS, looks={"soft": ("green", "dash")})


    @report.lead
    def main_result(study):
        yield f"The softest damper has {study[SOFT]['comfort']:.2f} m/s2."
        yield Figure("main-result", "Comfort over damping", "", [Panel("", ...)])


    @report.section("All runs")
    def runs(study):
        yield "One row for each run."
        rows = [{"damping [N.s/m]": case.damping, "comfort [m/s2]": row["comfort"]} for case, row in study.items()]
        yield Table.of("runs", "Runs", rows)

Sections appear in the order in which they are declared. A section yields texts, figures, tables and animations; the
page shows its texts first. Lines of a text are joined, and an empty line begins a paragraph. A section that needs a
failed run says so in its place, and one that yields nothing is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

from cosim.report import Animation, Figure, Map, Parameter, Report, Result, Section, Table
from cosim.report.model import Look
from cosim.study.experiment import Experiment
from cosim.study.fmus import FmuSet
from cosim.study.pages import make_lead, provenance, sections
from cosim.study.results import Results

Content = Iterator[str | Figure | Map | Table | Animation]
"""What a section shows."""

F = TypeVar("F", bound=Callable[[Any], Content])


@dataclass
class StudyReport:
    """A report that is written from the results of a study; `Study.report` of an experiment.

    Attributes:
        experiment: whose report it is.
        title: of the page.
        claims: a list of claims, which is judged on `view`; or a function of it that gives judged claims.
        parameters: of the FMUs, for the table at the end.
        looks: color and dash of each series by its name, the same in all figures.
        view: makes of results and FMUs what lead, sections and all functions below get; by default the results.
        results: single numbers at the top, a function of `view` and of the judged claims.
        animation: at the top, a function of `view` and FMUs.
        provenance: more of it, a function of `view`.
    """

    experiment: Experiment
    title: str
    claims: Any = None
    parameters: Callable[[FmuSet], list[Parameter]] = lambda _: []
    looks: Mapping[str, Look] = field(default_factory=dict)
    view: Callable[[Results, FmuSet], Any] = lambda results, _: results
    results: Callable[[Any, Any], list[Result]] = lambda *_: []
    animation: Callable[[Any, FmuSet], Animation | None] = lambda *_: None
    provenance: Callable[[Any], Mapping[str, object]] = lambda _: {}
    _lead: Callable[[Any], Content] = lambda _: iter(())
    _makers: list[Callable[[Any], list[Section]]] = field(default_factory=list)

    def lead(self, function: F) -> F:
        """Declare the message of the report: a sentence and its figure."""
        self._lead = function
        return function

    def section(self, title: str | Callable[[Any], str]) -> Callable[[F], F]:
        """Declare the next section; `title` may be a function of `view`."""

        def keep(function: F) -> F:
            maker: Any = partial(_sections, title, function)
            maker.__doc__ = title if isinstance(title, str) else function.__doc__
            self._makers.append(maker)
            return function

        return keep

    def __call__(self, results: Results, fmus: FmuSet) -> Report:
        """The page of a study."""
        view = self.view(results, fmus)
        lead, figure = make_lead(view, partial(_message, self._lead))
        claims = self.claims(view) if callable(self.claims) else self.claims.judge(view) if self.claims else ()
        return Report(
            experiment=self.experiment.name,
            title=self.title,
            lead=lead,
            figure=figure,
            animation=self.animation(view, fmus),
            claims=claims,
            results=self.results(view, claims),
            sections=sections(view, self._makers),
            parameters=self.parameters(fmus),
            provenance={**provenance(self.experiment, fmus), **self.provenance(view)},
            looks=self.looks,
        )


def section_of(title: str, content: Iterable[Any]) -> Section:
    """A section from what it shows."""
    items = list(content)
    return Section(
        title,
        [paragraph for text in items if isinstance(text, str) for paragraph in paragraphs(text)],
        [item for item in items if isinstance(item, Figure | Map)],
        [item for item in items if isinstance(item, Table)],
        [item for item in items if isinstance(item, Animation)],
    )


def paragraphs(text: str) -> list[str]:
    """Paragraphs of a text whose lines are broken anywhere, with an empty line between two of them."""
    return [" ".join(part.split()) for part in text.split("\n\n") if part.strip()]


def _sections(title: str | Callable[[Any], str], function: Callable[[Any], Content], view: Any) -> list[Section]:
    content = list(function(view))
    return [section_of(title if isinstance(title, str) else title(view), content)] if content else []


def _message(function: Callable[[Any], Content], view: Any) -> tuple[str, Figure | Map | None]:
    content = list(function(view))
    (text,) = (" ".join(item.split()) for item in content if isinstance(item, str))
    return text, next((item for item in content if isinstance(item, Figure | Map)), None)
