"""Run the installed command lines as a user does, in a folder of the test's own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

BIN = Path(sys.executable).parent
ENVIRONMENT = {**os.environ, "COLUMNS": "200"}


def run(folder: Path, program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """The finished program with its output as text."""
    return subprocess.run(
        [BIN / program, *arguments],
        cwd=folder,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


def refused(folder: Path, program: str, *arguments: str) -> str:
    """The message with which the program refuses what it was asked: not a traceback, and not a success."""
    done = run(folder, program, *arguments)
    text = done.stderr + done.stdout
    assert done.returncode in (1, 2), text
    assert "Traceback" not in text
    return " ".join(text.replace("│", " ").split())
