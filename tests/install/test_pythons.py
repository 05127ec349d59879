"""The wheel under every Python that the project names: installed from PyPI as a user would, an FMU built and run.

`make test-pythons`.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from built import ROOT
from environments import NAME, Environment
from test_installed import build

pytestmark = pytest.mark.pythons

CLASSIFIERS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["classifiers"]
SUPPORTED = tuple(m[1] for c in CLASSIFIERS if (m := re.fullmatch(r"Programming Language :: Python :: (3\.\d+)", c)))
RUN = """
import platform
from cosim import System
with System(allow_unconnected=True) as system:
    system.add("car", "fmus/fmi3/QuarterCarHmmwv.fmu", step="1 ms", start={"road.height": 0.05})
    z = system.run(8.0, record=["car.body.z"])["car.body.z"]
print(platform.python_version(), f"{z[-1]:.6f}", f"{max(z):.6f}")
"""


def found(version: str) -> Path | None:
    """An interpreter of that version.

    One that SUSPENSION_PYTHONS names (paths, separated as in PATH), of PATH, or of pyenv.
    """
    named = [Path(p) for p in os.environ.get("SUSPENSION_PYTHONS", "").split(os.pathsep) if p]
    of_path = shutil.which(f"python{version}")
    pyenv = sorted(Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")).glob(f"versions/{version}.*/bin/python"))
    for candidate in [*named, *([Path(of_path)] if of_path else []), *reversed(pyenv)]:
        say = "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2])"
        said = subprocess.run([candidate, "-c", say], capture_output=True, text=True, check=False)
        if said.returncode == 0 and said.stdout.strip() == version:
            return candidate
    return None


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(ROOT, tmp_path_factory.mktemp("wheel"))


def test_the_oldest_that_is_required_is_named() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["requires-python"] == f">={SUPPORTED[0]}"
    assert f"{sys.version_info.major}.{sys.version_info.minor}" in SUPPORTED


@pytest.mark.parametrize("version", SUPPORTED)
def test_install_build_and_run(version: str, wheel: Path, tmp_path: Path) -> None:
    python = found(version)
    if python is None:
        pytest.skip(f"there is no Python {version} on this machine: name one in SUSPENSION_PYTHONS")
    environment = Environment(tmp_path / "environment")
    subprocess.run([python, "-m", "venv", environment.folder], check=True)
    compiler = shutil.which(shlex.split(os.environ.get("CC", "cc"))[0])
    pip = [
        environment.folder / ("Scripts" if os.name == "nt" else "bin") / "python",
        "-m",
        "pip",
        "--disable-pip-version-check",
    ]
    subprocess.run(
        [*pip, "install", "--quiet", f"{wheel}[build{'' if compiler else ',zig'}]"], check=True, timeout=3600
    )
    assert NAME in environment.run("pip", "list", "--disable-pip-version-check")
    assert "No broken requirements" in environment.run("pip", "check")
    assert "1 built" in environment.run("build-fmus", "QuarterCarHmmwv", "--fmi", "3")
    said = environment.execute(RUN).split()
    assert said[0].startswith(f"{version}.")
    assert (float(said[1]), float(said[2]) > 0.05) == (pytest.approx(0.05, abs=1e-3), True), (
        "a car on a step of 50 mm settles on it, and overshoots"
    )
    assert "QuarterCarHmmwv" in environment.run("cosim", "fmu", "fmus/fmi3/QuarterCarHmmwv.fmu")
