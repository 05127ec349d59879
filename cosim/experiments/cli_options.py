"""Options and checks that the commands of all experiments share."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

Fmus = Annotated[Path, typer.Option(help="directory of the FMUs (see build-fmus)")]
Version = Annotated[int, typer.Option(help="FMI version of the FMUs to use: 2 or 3", min=2, max=3)]
Out = Annotated[Path, typer.Option(help="directory for results")]

console = Console(stderr=True, highlight=False, soft_wrap=True)


@contextmanager
def progress_bar(title: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on the terminal; the function that it gives is called with (done, total)."""
    columns = [
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    ]
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(title, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def make_folder(path: Path) -> Path:
    """The folder, made and tried out before any work is done; OSError that says what to do."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError as error:
        raise OSError(f"cannot write to {path} ({error.strerror}); choose another directory with --out") from None
    return path
