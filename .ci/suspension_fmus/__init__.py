"""Components as FMUs and the master that runs them, under the one name that only this project has.

    from suspension_fmus import System

has all that `cosim` has. The packages `cosim`, `build_fmus` and `fmu_sources` can be imported by these names
too. Where other projects have packages called so, theirs are found, until `import suspension_fmus` makes ours the
ones that are.
"""

import gc
import importlib
import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

PACKAGES = ("build_fmus", "cosim", "fmu_sources")
COMMANDS = ("suspension-fmus", "cosim", "build-fmus")

_HERE = Path(__file__).absolute().parent
_ROOT = next(folder for folder in (_HERE, _HERE.parents[1]) if (folder / "cosim").is_dir())  # installed; repository
# What `python -m` runs. Not suspension_fmus.cosim: it would be a second copy of each module, with classes of its own.
__path__ = [str(_HERE / "_suspension_fmus")]


def _found(package: str) -> Path | None:
    """The folder from which a package is, or will be, imported."""
    try:
        spec = importlib.util.find_spec(package)
    except ValueError:  # a module made by hand
        return None
    return Path(spec.origin).parents[1] if spec is not None and spec.origin is not None else None


def _are_ours() -> bool:
    """Whether the three come from one folder: here, or where a developer has another copy of the project."""
    folders = {_found(p) for p in PACKAGES}
    return len(folders) == 1 and None not in folders


def _make_ours_first() -> None:
    if _are_ours():
        return
    root = str(_ROOT)
    sys.path[:] = [root, *(p for p in sys.path if p != root)]
    if _are_ours():
        return
    others = [f"{p} ({_found(p)})" for p in PACKAGES if _found(p) != _ROOT]
    text = (
        f"a package of another project was imported before suspension_fmus and has a name of ours: {', '.join(others)};"
        " import suspension_fmus first, or keep the two projects in environments of their own"
    )
    if (command := Path(*sys.argv[:1]).stem) in COMMANDS:
        sys.exit(f"{command}: {text}")
    raise ImportError(text)


_make_ours_first()


def __getattr__(name: str) -> Any:
    if name == "__all__":
        return importlib.import_module("cosim").__all__
    if name in PACKAGES:
        return importlib.import_module(name)
    if not name.startswith("_"):
        cosim = importlib.import_module("cosim")
        if name in cosim.__all__:
            return getattr(cosim, name)
    raise AttributeError(f"module 'suspension_fmus' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *PACKAGES, *__getattr__("__all__")])


def main(name: str = "suspension-fmus") -> None:
    """The command `suspension-fmus`."""
    _command(name, "cosim.cli")


def cosim_command(name: str = "cosim") -> None:
    """The same under the name `cosim`."""
    _command(name, "cosim.cli")


def build_command(name: str = "build-fmus") -> None:
    """The command `build-fmus`, which is `suspension-fmus build`."""
    _command(name, "fmu_sources.cli")


def _command(name: str, module: str) -> None:
    from build_fmus.base.extras import MissingExtraError
    from build_fmus.base.one_thread import one_thread

    one_thread()
    gc.disable()  # modules stay: searching them for garbage takes an eighth of the time of the imports
    try:
        run: Callable[[str], None] = importlib.import_module(module).main
    except MissingExtraError as error:
        sys.exit(f"{name}: {error}")
    gc.freeze()
    gc.enable()
    run(name)
