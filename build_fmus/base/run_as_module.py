"""Imported first by the packages that `python -m` runs, before anything else is: they run as their commands do.

A Python that is too old is named before anything fails in it.

Linear algebra has one thread. The working folder, which Python has put on the import path, leaves it: a `numpy.py`
there would be executed.
"""

import os
import sys

from build_fmus.base.one_thread import one_thread

_PACKAGES = ("cosim", "build_fmus", "suspension_fmus")
_ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))


def _is_run() -> bool:
    """Whether Python runs one of the packages, or looks for it to run it."""
    if sys.argv[:1] == ["-m"]:
        return not {f"{option}{p}" for option in ("", "-m") for p in _PACKAGES}.isdisjoint(sys.orig_argv)
    spec = getattr(sys.modules["__main__"], "__spec__", None)
    return spec is not None and spec.name in {f"{p}.__main__" for p in _PACKAGES}


if sys.version_info < (3, 11):  # noqa: UP036 - in a checkout, which pip does not keep from other versions
    _version = ".".join(str(n) for n in sys.version_info[:3])
    _text = f"Python 3.11 or newer is needed; this is Python {_version} ({sys.executable})"
    if sys.argv[:1] == ["-m"] or _is_run():
        sys.exit(_text)
    raise ImportError(_text)

if _is_run():
    one_thread()
    if not sys.flags.safe_path and os.path.realpath(sys.path[0]) != os.path.realpath(_ROOT):
        del sys.path[0]
