"""The common layout of the experiments: what a folder holds under which names, and the `Experiment` that this makes.

`runs.py` has `Case`, `wire`, `FMUS`, `measure`, `METRICS`, `stop_time`, `recorded` and `passive`, which may be a method
of `Case`, and what it needs of the other names below; `FLAGS` are recorded signals, with what is remarked where one was
not 0. `published.py` has the plan; `claims.py` and `claims.toml` the claims; `report.py` the page of the study;
`web.py` the live page. The meaning of each is that of the field of `Experiment` to which it is given.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from cosim.study import Baseline, Experiment, Measures, Run, RunOptions, Study, Wiring

PAPERS = "fmu_sources.catalog:PAPERS"


def experiment(
    package: str,
    title: str,
    *,
    name: str = "",
    interval: Any = "1 ms",
    takes_files: bool = True,
    relative: bool = False,
    page: str | None = None,
    **study: Any,
) -> Experiment:
    """The experiment of a folder.

    Args:
        package: `__name__` of the folder's `__init__`.
        title: one line.
        name: of the experiment, by default that of the folder.
        interval: between two samples of the recording.
        takes_files: whether a user's vehicle files can stand in for the published ones.
        relative: whether metrics are also shown as per cent of the baseline's.
        page: of single runs, by its place.
        study: of the `Study`, besides or instead of what the folder holds.
    """
    runs, published = (import_module(f"{package}.{module}") for module in ("runs", "published"))

    def own(attribute: str) -> Any:
        return getattr(runs, attribute, None)

    def beside(module: str, attribute: str) -> str | None:
        return f"{package}.{module}:{attribute}" if find_spec(f"{package}.{module}") else None

    found = {"claims": beside("claims", "CLAIMS"), "report": beside("report", "report"), "papers": PAPERS}
    remarks = partial(remarked, own("FLAGS") or {}, own("remarks"))
    passive = own("passive") or getattr(runs.Case, "passive", None)
    own_fmus = "cosim.experiments.own_files:own_fmus" if takes_files else None
    return Experiment(
        name or package.rpartition(".")[2].replace("_", "-"),
        runs.Case,
        Wiring(runs.wire, own("structure"), own("configure"), runs.FMUS, own_fmus),
        Measures(runs.measure, runs.METRICS, own("signals"), own("failed"), remarks),
        RunOptions(runs.stop_time, runs.recorded, interval, own("stop_when"), own("begin")),
        Baseline(passive, own("own_baseline"), own("called"), own("about"), relative, own("compared")),
        Study(published.plan, **{**found, **study}),
        page=page,
        web=beside("web", "live"),
        title=title,
        module=package,
    )


def remarked(flags: Mapping[str, str], more: Callable[[Run], list[str]] | None, run: Run) -> list[str]:
    """What is remarked of a run: the texts of the flags that it raised, and more."""
    raised = [text for name, text in flags.items() if name in run.recording and run.recording[name].any()]
    return [*raised, *(more(run) if more else [])]
