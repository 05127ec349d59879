"""A program that ends without closing anything prints nothing, whatever is gone by then."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PRELUDE = """
import os, shutil, sys
import psutil
from build_fmus.base import safe_files
from cosim import System

def made(**options):
    system = System()
    system.add("a", sys.argv[1], step="1 ms", **options)
    simulation = system.initialize()
    simulation.advance(0.01)
    return simulation

isolated, native = made(isolated=True), made()
"""
ENDS = {
    "files": "shutil.rmtree(safe_files.scratch())",
    "descriptors": "os.closerange(3, 256)",
    "processes": "for p in psutil.Process().children(recursive=True):\n    p.kill(); p.wait()",
    "state": "state = isolated.save(); isolated.close()",
    "fork": "if os.fork() == 0:\n    sys.exit(0)\nos.wait()",
}


@pytest.mark.skipif(os.name == "nt", reason="FMUs are isolated on Linux and macOS only")
@pytest.mark.parametrize("end", ENDS)
def test_the_end_of_a_program_is_silent(end: str, harmless: Path, tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(PRELUDE + ENDS[end])
    command = [sys.executable, "-W", "ignore", str(tmp_path / "program.py"), str(harmless)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=300)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
