"""Options and checks that the commands of all experiments share."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated

import typer

Fmus = Annotated[Path, typer.Option(help="directory of the FMUs (see build-fmus)")]
Version = Annotated[int, typer.Option(help="FMI version of the FMUs to use: 2 or 3", min=2, max=3)]
Out = Annotated[Path, typer.Option(help="directory for results")]


def make_folder(path: Path) -> Path:
    """The folder, made and tried out before any work is done; OSError that says what to do."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError as error:
        raise OSError(f"cannot write to {path} ({error.strerror}); choose another directory with --out") from None
    return path
