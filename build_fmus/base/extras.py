"""What is installed on request only, and the one sentence that says so where it is missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

BUILD = ("casadi", "pydantic", "jinja2")
REPORTS = ("plotly", "jinja2", "pyarrow")
DATA = ("pandas", "pyarrow", "xarray", "h5netcdf", "h5py", "asammdf", "pyopencrg")
EXTRAS = {
    "build": BUILD,
    "reports": REPORTS,
    "studies": tuple(dict.fromkeys(BUILD + REPORTS)),
    "data": DATA,
    "learning": ("gymnasium",),
    "optimisation": ("optuna",),
    "cluster": ("distributed", "cryptography"),
    "sensitivity": ("SALib",),
}
"""Name of an extra of the distribution -> modules of others that come with it."""
OUTSIDE = {"jax": ("jax",), "torch": ("torch",)}
"""Likewise, of extras that are no part of [all]."""

BUILDING, WRITING = "building FMUs", "writing a report"  # what needs the first two, in messages


class MissingExtraError(ImportError):
    """What was called needs an extra that is not installed; the message names it and how to get it."""


def missing(extra: str) -> bool:
    """Whether a module of an extra is not installed."""
    return any(find_spec(module) is None for module in (EXTRAS | OUTSIDE)[extra])


def require(extra: str, what: str) -> None:
    """Refuse `what`, the subject of the sentence, where an extra is missing.

    Raises:
        MissingExtraError: it is.
    """
    if missing(extra):
        raise MissingExtraError(f"{what} needs {named(extra)}")


def named(extra: str) -> str:
    """An extra and how to get it, for a message."""
    return f"the extra [{extra}]: pip install 'suspension-fmus[{extra}]'"


@contextmanager
def needed(extra: str, what: str) -> Iterator[None]:
    """Around imports of an extra's modules: `require` where they fail."""
    try:
        yield
    except ModuleNotFoundError:
        require(extra, what)
        raise
