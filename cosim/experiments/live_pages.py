"""The experiments that show themselves as a live web page, and these pages.

`python -m cosim.experiments.live_pages FOLDER`
"""

from __future__ import annotations

import argparse
from collections.abc import Collection
from pathlib import Path

from build_fmus.base.layout import FMUS
from cosim.experiments import EXPERIMENTS
from cosim.study import Experiment, FmuSet, load
from cosim.study.web import write_web


def shown() -> dict[str, Experiment]:
    """By name on the command line, those that lay out a page of their own."""
    found = {name: load(place) for name, place in EXPERIMENTS.items()}
    return {name: experiment for name, experiment in found.items() if experiment.web is not None}


def write_pages(fmus: FmuSet, folder: Path, names: Collection[str] | None = None) -> list[Path]:
    """`NAME.html` for each of them. `names`: the FMUs that there are; pages that need others are left out.

    Raises:
        FileNotFoundError: an FMU is not there; the message says how to build it.
        CompileError: no ziglang.
    """
    folder.mkdir(parents=True, exist_ok=True)
    chosen = {name: e for name, e in shown().items() if names is None or set(e.wiring.fmus) <= set(names)}
    return [write_web(e, fmus, folder / f"{name}.html", e.case()) for name, e in chosen.items()]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="receives the pages")
    parser.add_argument("--fmus", type=Path, default=FMUS, help="folder with fmi3/")
    arguments = parser.parse_args()
    for page in write_pages(FmuSet(arguments.fmus), arguments.folder):
        print(f"{page}: {page.stat().st_size / 1e6:.1f} MB")
