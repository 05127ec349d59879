"""Everything that determines the result of a run besides its case.

The code finds it, so stale results are never reused.

FMU files by content, a user's own and those that a case names among them; every module of the project (or of a user's
folder) that wiring, run and measurement load, with the data files beside it; the versions of the libraries that those
modules import, and of Python.
"""

from __future__ import annotations

import hashlib
import inspect
import platform
import sys
from collections.abc import Iterable
from functools import cache, partial
from importlib import metadata
from pathlib import Path
from typing import Any

from build_fmus.base.sources import imported, libraries
from cosim.study import case, loading, runner
from cosim.study.experiment import Experiment, Search
from cosim.study.fmus import FmuSet

JUDGED = "claims.toml"  # sentences on results and bounds for them, which no run reads
RUNS = (case.__file__, loading.__file__, runner.__file__)  # modules between every experiment and the master


def content_hash(paths: Iterable[Path]) -> str:
    """Hash of names and contents of files, in the given order."""
    digest = hashlib.sha256()
    for path in paths:
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def entry_modules(experiment: Experiment, searches: Iterable[Search] = ()) -> list[str]:
    """Files of the modules in which an experiment's runs begin."""
    parts = [p.func if isinstance(p, partial) else p for p in (*experiment.functions, *(type(s) for s in searches))]
    if experiment.module.endswith(".py"):
        parts.append(sys.modules[loading.module_name(experiment.module)])
    modules = {m for m in map(inspect.getmodule, parts) if m is not None}
    own = (m for m in modules if m.__name__.partition(".")[0] not in sys.stdlib_module_names)  # `operator.attrgetter`
    return sorted({*RUNS, *filter(None, map(inspect.getsourcefile, own))})


def code_files(experiment: Experiment, searches: Iterable[Search] = ()) -> list[Path]:
    """All files that the numbers depend on, FMUs aside."""
    return [p for p in imported(entry_modules(experiment, searches)) if p.name != JUDGED]


def salt(experiment: Experiment, fmus: FmuSet, files: Iterable[Path] = (), searches: Iterable[Search] = ()) -> str:
    """One text that changes when anything does that all runs of a study depend on.

    Args:
        experiment: whose code and FMUs count.
        fmus: where they are.
        files: FMU files besides those that the experiment names.
        searches: tasks of the study that are more than one run.
    """
    modules = entry_modules(experiment, searches)
    paths = sorted({*fmus.paths(experiment.wiring.fmus), *fmus.own_paths, *files})
    used = [f"{name} {version}" for name, version in versions(libraries(modules)).items()]
    return "|".join([content_hash(paths), content_hash(code_files(experiment, searches)), *used])


def versions(imports: Iterable[str]) -> dict[str, str]:
    """Versions of the distributions that provide top-level modules, and of Python."""
    known = _distributions()
    names = sorted({d for i in imports for d in known.get(i, ())})
    return {"python": ".".join(platform.python_version_tuple()[:2]), **{n: metadata.version(n) for n in names}}


@cache
def _distributions() -> Any:
    return metadata.packages_distributions()
