"""What is imported at start-up: libraries that take long to load wait until something uses them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

SLOW = ("control", "matplotlib", "fmpy", "scipy", "casadi", "pandas", "plotly")
COMMAND = "import sys, suspension_fmus; sys.argv = {!r}\ntry: suspension_fmus.cosim_command()\nexcept SystemExit: pass"


@pytest.mark.parametrize(
    ("code", "never"),
    [
        ("import cosim", SLOW),
        ("from cosim import System; System().close()", SLOW),
        (COMMAND.format(["cosim", "--help"]), SLOW),
        (COMMAND.format(["cosim", "list"]), SLOW[:3]),
        (COMMAND.format(["cosim", "run", "gpc", "--help"]), SLOW[:3]),
    ],
    ids=["import cosim", "System", "cosim --help", "cosim list", "cosim run gpc --help"],
)
def test_slow_libraries_are_not_loaded(code: str, never: tuple[str, ...], tmp_path: Path) -> None:
    print_modules = "\nimport sys; print('loaded:', *sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code + print_modules], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    loaded = done.stdout.rpartition("loaded:")[2].split()
    assert "cosim" in loaded
    assert not set(never) & set(loaded)
