"""What tests that look at pages in Chromium need: Node.js with packages of npm, and the browser."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

MODULES = ("axe-core@4.14.1", "playwright-core@1.65.1")
PLACE = Path(__file__).parents[1] / "build" / "pages"


def looked_at(script: Path, *arguments: str | Path) -> Any:
    """What a script for Node.js prints as JSON (see `script_output`).

    Skips the test where something is not installed, and says what.
    """
    try:
        return script_output(script, *arguments)
    except FileNotFoundError as missing:
        pytest.skip(str(missing))


def script_output(script: Path, *arguments: str | Path) -> Any:
    """What a script for Node.js prints as JSON.

    It gets the folder of the packages before its arguments, and the browser as CHROMIUM.

    Raises:
        FileNotFoundError: something is not installed; it says what.
    """
    browser = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
    missing = [name for name in ("node", "npm") if shutil.which(name) is None] + ([] if browser else ["chromium"])
    if missing:
        raise FileNotFoundError(
            f"{', '.join(missing)} not found; pages are looked at in a browser by axe-core, a package of npm"
        )
    if not all(_installed(m) for m in MODULES):
        PLACE.mkdir(parents=True, exist_ok=True)
        options = ("--no-save", "--no-package-lock", "--ignore-scripts", "--prefix")
        subprocess.run(["npm", "install", *options, PLACE, *MODULES], check=True)
    command = ["node", script, PLACE, *arguments]
    done = subprocess.run(
        command, check=False, capture_output=True, text=True, env=os.environ | {"CHROMIUM": str(browser)}
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def _installed(module: str) -> bool:
    name, version = module.split("@")
    package = PLACE / "node_modules" / name / "package.json"
    return package.is_file() and json.loads(package.read_text())["version"] == version
