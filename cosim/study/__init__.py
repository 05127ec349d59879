"""Studies: cases, experiments, claims, and what runs them. Ours are written with it, and so may yours be.

    from cosim.study import Case, Experiment, option, run_study

What stands here is imported when it is used: a worker loads no plots, and a stored run does not depend on them.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cosim.report.claims import Band, Distribution
    from cosim.study.case import Case, CaseError, check_choice, fields, grid, option
    from cosim.study.claims import ClaimList, Evidence, Finding
    from cosim.study.driver import run_study
    from cosim.study.executors import dask
    from cosim.study.experiment import (
        Baseline,
        Experiment,
        MeasureError,
        Measures,
        Metric,
        Row,
        Run,
        RunOptions,
        Search,
        Study,
        Task,
        Wiring,
    )
    from cosim.study.fmus import FmuSet
    from cosim.study.loading import ExperimentError, load
    from cosim.study.pages import default_report, parameters, provenance
    from cosim.study.results import Results, RunFailed
    from cosim.study.runner import Runner
    from cosim.study.study_report import Content, StudyReport

_PLACES = {
    "cosim.report.claims": ("Band", "Distribution"),
    "cosim.study.case": ("Case", "CaseError", "check_choice", "fields", "grid", "option"),
    "cosim.study.claims": ("ClaimList", "Evidence", "Finding"),
    "cosim.study.driver": ("run_study",),
    "cosim.study.executors": ("dask",),
    "cosim.study.experiment": (
        "Baseline",
        "Experiment",
        "MeasureError",
        "Measures",
        "Metric",
        "Row",
        "Run",
        "RunOptions",
        "Search",
        "Study",
        "Task",
        "Wiring",
    ),
    "cosim.study.fmus": ("FmuSet",),
    "cosim.study.loading": ("ExperimentError", "load"),
    "cosim.study.pages": ("default_report", "parameters", "provenance"),
    "cosim.study.results": ("Results", "RunFailed"),
    "cosim.study.runner": ("Runner",),
    "cosim.study.study_report": ("Content", "StudyReport"),
}
_MODULES = {name: module for module, names in _PLACES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'cosim.study' has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULES[name]), name)


__all__ = [
    "Band",
    "Baseline",
    "Case",
    "CaseError",
    "ClaimList",
    "Content",
    "Distribution",
    "Evidence",
    "Experiment",
    "ExperimentError",
    "Finding",
    "FmuSet",
    "MeasureError",
    "Measures",
    "Metric",
    "Results",
    "Row",
    "Run",
    "RunFailed",
    "RunOptions",
    "Runner",
    "Search",
    "Study",
    "StudyReport",
    "Task",
    "Wiring",
    "check_choice",
    "dask",
    "default_report",
    "fields",
    "grid",
    "load",
    "option",
    "parameters",
    "provenance",
    "run_study",
]
