"""What `make` says before it installs anything."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="there is no make")
OLD = """#!/bin/sh
[ "$1" = --version ] && echo "Python 3.10.13" && exit 0
[ "$1" = -c ] && exit 1
echo "$@" >> "{called}"
"""


@pytest.mark.parametrize("place", ["python", "venv/bin/python"])
@pytest.mark.parametrize("target", ["run", "test"])
def test_an_old_python_is_refused_before_anything_is_installed(place: str, target: str, tmp_path: Path) -> None:
    """Chosen for the environment, or in one that is there."""
    python = tmp_path / place
    python.parent.mkdir(parents=True, exist_ok=True)
    for program in (python, python.with_name("pip")):
        program.write_text(OLD.format(called=tmp_path / "called"))
        program.chmod(0o755)
    command = ["make", "-C", str(ROOT), target, f"VENV={tmp_path / 'venv'}", f"PYTHON={tmp_path / 'python'}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    sentence = f"Python 3.11 or newer is needed; {python} is Python 3.10.13. Choose another one: make PYTHON=python3.12"
    assert done.returncode != 0
    assert sentence in done.stderr
    assert not (tmp_path / "called").exists()
