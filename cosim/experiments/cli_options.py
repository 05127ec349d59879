"""Options and checks that the commands of all experiments share."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from build_fmus import safe_files
from build_fmus.terminal import console
from cosim.experiments.cases import FmuSet

Fmus = Annotated[Path, typer.Option(help="directory of the FMUs (see build-fmus)")]
Version = Annotated[int, typer.Option(metavar="2|3", help="FMI version of the FMUs to use", min=2, max=3)]
Vehicles = Annotated[
    list[Path] | None,
    typer.Option(
        "--vehicle",
        metavar="FILE",
        help="vehicle, actuator or sensors file whose FMUs are used instead (build-fmus --vehicle); several may be given",
    ),
]
Processes = Annotated[int | None, typer.Option(help="worker processes (default: all cores)", min=1)]
Force = Annotated[bool, typer.Option("--force", help="make every run anew; runs stored earlier are discarded")]
Out = Annotated[Path, typer.Option(help="directory for results")]

Progressed = Callable[[int, int], None]  # called with (done, total)
MetricRows = Mapping[str, tuple[str, str] | tuple[str, str, float]]
"""Label -> key, format, and a factor where the label has another unit than the metric."""


@contextmanager
def progress_bar(title: str, *, resumes: bool = True) -> Iterator[Progressed]:
    """A bar on the terminal; the function that it gives is called with (done, total).

    ``resumes``: finished runs are on disk, which whoever presses Ctrl-C is told.
    """
    columns = [
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    ]
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(title, total=None)
        try:
            yield lambda done, total: bar.update(task, completed=done, total=total)
        except KeyboardInterrupt:
            kept = "; finished runs are kept, the same command goes on from there" if resumes else ""
            raise KeyboardInterrupt(f"interrupted{kept}") from None


def study_page(
    name: str,
    out: Path,
    study: Callable[[Path, Progressed], Any],
    write: Callable[[Any, Path], Path],
    *,
    force: bool = False,
    resumes: bool = True,
) -> None:
    """Run a study under a progress bar and write its page.

    Args:
        name: of the experiment, and of its folder below ``out``.
        study: called with the folder for finished runs and with what shows progress.
        write: called with the study's result and the folder; gives the path of the page.
        force: discard finished runs first.
        resumes: as for :func:`progress_bar`.
    """
    folder = make_folder(out / name)
    runs = folder / ".runs"
    if force and runs.exists():
        shutil.rmtree(runs)
    with progress_bar(f"study {name}", resumes=resumes) as progress:
        result = study(runs, progress)
    console.print(f"report: {write(result, folder)}")


def metric_table(measured: Mapping[str, Mapping[str, Any]], rows: MetricRows) -> Table:
    """Metrics of several systems side by side; a metric that a system does not have is a dash."""
    table = Table("metric", *measured, box=None)
    for label, (key, form, *factor) in rows.items():
        scale = factor[0] if factor else 1.0
        cells = (form.format(scale * m[key]) if key in m else "-" for m in measured.values())
        table.add_row(Text(label), *cells)
    return table


@contextmanager
def kept_recording(csv: Path) -> Iterator[None]:
    """Around a run that writes ``csv``: when it fails or is interrupted, say what the file holds."""
    from cosim import ComponentError, Interrupted

    try:
        yield
    except (ComponentError, Interrupted) as error:
        if error.recording is not None and len(error.recording):
            console.print(f"{csv} holds the run up to t = {error.time:g} s")
        raise


def write_summary(csv: Path, measured: Mapping[str, Any], note: str = "") -> None:
    """The metrics as JSON beside the time histories, and where both are."""
    path = csv.with_suffix(".json")
    safe_files.write(path, json.dumps(measured, indent=1) + "\n")
    console.print(f"{csv} and {path.name}{note}")


def fmu_set(experiment: str, fmus: Path, fmi: int, vehicles: list[Path] | None, weights: Path | None = None) -> FmuSet:
    """The FMUs of an experiment, with those of a user's files; see :func:`cosim.experiments.own_files.own_fmus`."""
    if not vehicles and weights is None:
        return FmuSet(fmus, fmi)
    from cosim.experiments.own_files import own_fmus

    return own_fmus(experiment, fmus, fmi, vehicles, weights)


def make_folder(path: Path) -> Path:
    """The folder, made and tried out before any work is done; OSError that says what to do."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError as error:
        raise OSError(f"cannot write to {path} ({error.strerror}); choose another directory with --out") from None
    return path
