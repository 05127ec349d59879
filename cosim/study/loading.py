"""Experiments by name or from a user's file.

A file has `EXPERIMENT`, or a function `system(**options)` that returns a System; beside that function it may have
`STOP_TIME`, `RECORD`, `measure(run)`, `METRICS` and `PLAN`, which mean what `cosim.study.Experiment`
says.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from build_fmus.base import extras
from build_fmus.base.checks import did_you_mean
from cosim.core.errors import CosimError
from cosim.core.signals import rms
from cosim.study import packages
from cosim.study.case import case_of, values
from cosim.study.experiment import Experiment, Measures, Metric, Row, Run, RunOptions, Study, Wiring
from cosim.study.fmus import FmuSet


class ExperimentError(CosimError, ValueError):
    """What was named is no experiment; the message says what it lacks."""


@cache
def load(place: str) -> Experiment:
    """The experiment of a module (`cosim.experiments.gpc`), of a Python file, or of an SSP file.

    Raises:
        ExperimentError: there is no such module or file, it cannot be run, or it has no experiment.
    """
    if place.lower().endswith(packages.SUFFIX):
        return packages.ssp_experiment(place, extremes)
    module = _from_file(Path(place)) if place.endswith(".py") else _from_name(place)
    found = getattr(module, "EXPERIMENT", None)
    if isinstance(found, Experiment):
        return _placed(found, place)
    if found is not None:
        raise ExperimentError(f"{place}: EXPERIMENT is of type {type(found).__name__}, not a cosim.study.Experiment")
    if callable(getattr(module, "system", None)):
        return _around(module, place)
    raise ExperimentError(f"{place} has neither EXPERIMENT nor a function system(**options) that returns a System")


def _placed(found: Experiment, place: str) -> Experiment:
    object.__setattr__(found, "module", place)
    return found


def _from_name(name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name and name.startswith(error.name):
            raise ExperimentError(f"there is no module {name}") from None
        raise


def module_name(file: str | Path) -> str:
    """Under which name the module of a user's file is imported."""
    return f"_experiment_{Path(file).stem}"


def _from_file(file: Path) -> ModuleType:
    """The module of a file, which can import its neighbors, as when Python runs it."""
    file = file.absolute()
    if not file.is_file():
        others = sorted(p.name for p in file.parent.glob("*.py"))
        raise ExperimentError(f"{file} does not exist{did_you_mean(file.name, others)}")
    name = module_name(file)
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    sys.path.insert(0, str(file.parent))
    try:
        spec.loader.exec_module(module)
    except SyntaxError as error:
        raise ExperimentError(f"{error.filename}, line {error.lineno}: {error.msg}") from None
    except ModuleNotFoundError as error:
        raise ExperimentError(f"{file} imports {error.name}, which is not installed") from error
    except extras.MissingExtraError:
        raise
    except ImportError as error:  # what another project's package of the same name would have
        raise ExperimentError(f"{file}: {error}") from error
    finally:
        sys.path.remove(str(file.parent))
    return module


# --------------------------------------------------------------------------------------- a file with system(**options)


def _around(module: ModuleType, place: str) -> Experiment:
    """The experiment that a function `system(**options)` makes."""
    case = case_of(module.system)
    return Experiment(
        name=Path(place).stem if place.endswith(".py") else place.rpartition(".")[2],
        title=(module.__doc__ or "").strip().partition("\n")[0],
        case=case,
        wiring=Wiring(partial(_wire, module.system, place), takes_fmus=False),
        measures=Measures(getattr(module, "measure", extremes), getattr(module, "METRICS", {})),
        run=RunOptions(getattr(module, "STOP_TIME", None) or _default_stop_time, getattr(module, "RECORD", None)),
        study=Study(getattr(module, "PLAN", None), report=getattr(module, "REPORT", None)),
        module=place,
    )


def _wire(system: Any, place: str, _: FmuSet, case: Any) -> Any:
    from cosim import System

    made = system(**values(case))
    if not isinstance(made, System):
        raise ExperimentError(f"{place}: system() returned {type(made).__name__}; it returns a cosim.System")
    return made


def _default_stop_time(system: Any, _: Any) -> float:
    """The longest that any component's default experiment lasts."""
    ends = [m.description.default_stop for m in system.components.values() if m.description.default_stop]
    if not ends:
        raise ExperimentError("no component declares a stop time: set STOP_TIME [s] in the file")
    return float(max(ends))


def extremes(run: Run) -> Row:
    """Smallest, largest, root mean square and last value of everything recorded."""
    found: Row = {}
    for name in run.recording:
        signal = np.asarray(run.recording[name], dtype=float)
        found |= {
            f"{name} min": float(signal.min()),
            f"{name} max": float(signal.max()),
            f"{name} rms": rms(signal),
            f"{name} last": float(signal[-1]),
        }
    return found


__all__ = ["ExperimentError", "Metric", "extremes", "load"]
