"""Targets of the fuzzer.

A target is a module of this folder, named here, with

- `make(rng: random.Random) -> bytes`: a case, the same for the same state of `rng`;
- `run(case: bytes, folder: Path) -> None`: try it, in a folder of its own; what is raised is judged by `bench`;
- `ALLOWED`: the errors that may come of it, with a message of one line each (or several, one a mistake).
"""

from __future__ import annotations

import importlib
from types import ModuleType

TARGETS = {
    "xml": 15,
    "archives": 15,
    "data": 15,
    "ssp": 4,
    "terminals": 5,
    "api": 35,
    "states": 5,
    "hostile": 1,
    "writers": 5,
}
"""With the share of each in a campaign over all [%]: some cases take a thousandth of the time of others."""


def target(name: str) -> ModuleType:
    """The module of a target."""
    return importlib.import_module(f"{__package__}.{name}")
