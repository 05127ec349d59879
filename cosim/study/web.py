"""Cases of an experiment as a live web page: side by side, in groups to choose from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from build_fmus.base.checks import did_you_mean
from cosim.export.web.page import PageSystem, WebPage, export_web
from cosim.scenes import infer_scene
from cosim.scenes.scene import Scene
from cosim.study.case import CaseError, Field, fields, label
from cosim.study.experiment import Experiment, resolved
from cosim.study.fmus import FmuSet
from cosim.study.runner import Runner

CHARTS = 6  # of a page, of what an experiment records


@dataclass(frozen=True)
class LiveCase:
    """One system of a page.

    `values`: inputs and parameters, as `component.variable`, that differ from those of the case. Systems of the same
    `group` run side by side. `staged`: what the case makes of the scene that is inferred of its system.
    """

    title: str
    case: Any
    values: Mapping[str, float] = field(default_factory=dict)
    group: str = ""
    staged: Callable[[Scene], Scene] | None = None


@dataclass(frozen=True)
class Live:
    """What an experiment shows as a page: systems, and what is around them."""

    page: WebPage
    cases: Sequence[LiveCase]


def write_web(experiment: Experiment, fmus: FmuSet, path: Path, case: Any, beside: Sequence[str] = ()) -> Path:
    """Write the page of a case: as the experiment lays it out, or with others beside it.

    Args:
        experiment: of the case.
        fmus: its FMUs.
        path: of the page.
        case: the case.
        beside: each is one more system, the case with some options changed, "controller=lqr,speed=40".

    Raises:
        CaseError: an unknown option, or a value that it does not take.
        CosimError, CompileError: see `cosim.export.web.page.export_web`.
    """
    live = _layout(experiment, case, beside)
    with ExitStack() as open_:
        shown = []
        recorded: dict[str, None] = {}  # names of outputs
        for each in live.cases:
            # one each: cases alike share a system, and its values
            runner = open_.enter_context(Runner(experiment, fmus))
            system = runner.system(each.case)
            scene = infer_scene(system)
            if scene is not None and each.staged is not None:
                scene = each.staged(scene)
            shown.append(PageSystem(each.title, system, each.values, each.group, scene))
            record = experiment.run.recorded(each.case)
            if record is not None:
                outputs, chosen = ([f"{m.name}.{v.name}" for m, v in system.select(n)] for n in (None, record))
                recorded |= dict.fromkeys(n for n in chosen if n in outputs)
        plots = live.page.plots or list(recorded)[:CHARTS]
        return export_web(path, shown, replace(live.page, plots=plots))


def _layout(experiment: Experiment, case: Any, beside: Sequence[str]) -> Live:
    own = resolved(experiment.web)
    if own is not None and not beside:
        return own(case)  # type: ignore[no-any-return]
    cases = [case, *(_changed(case, text) for text in beside)]
    titles = [label(c) for c in cases] if beside else [experiment.title or experiment.name]
    return Live(
        WebPage(experiment.title or experiment.name), [LiveCase(t, c) for t, c in zip(titles, cases, strict=True)]
    )


def _changed(case: Any, text: str) -> Any:
    """The case with options changed."""
    known = {n: f for f in fields(type(case)) for n in (f.name, *f.option.aliases)}
    changes = {}
    for pair in text.split(","):
        name, equals, value = (part.strip() for part in pair.partition("="))
        if not equals or name not in known:
            raise CaseError(
                f"--beside {pair!r}: write OPTION=VALUE with an option of the case{did_you_mean(name, known)}"
            )
        changes[known[name].attribute] = _value(known[name], value)
    return replace(case, **changes)


def _value(f: Field, text: str) -> Any:
    """A value as people write it, of the field's type."""
    if f.type is bool:
        if text not in ("true", "false"):
            raise CaseError(f"--beside {f.name}={text}: write true or false")
        return text == "true"
    if f.type in (int, float):
        try:
            return f.type(text)
        except ValueError:
            raise CaseError(f"--beside {f.name}={text}: write a number") from None
    return text
