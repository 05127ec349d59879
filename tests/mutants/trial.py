"""Runs tests on a copy of the project in which one mistake was made."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from build_fmus.one_thread import one_thread

LIMIT = (10.0, 5.0)  # s, and times what the tests take without a mistake: a test that takes longer has noticed
COPIED = ("build_fmus", "cosim", "fmu_sources", "tests", "docs", "pyproject.toml", "README.md")
LIBRARIES = ["casadi", "cffi", "fmpy", "jinja2", "lxml.etree", "numpy", "plotly.graph_objects", "pydantic", "pytest", "scipy.linalg",
             "scipy.signal", "scipy.stats", "typer"]  # fmt: skip
"""What most tests load and no mistake is made in: loaded once."""


@contextmanager
def copied_tree(root: Path) -> Iterator[Path]:
    """A copy of the project, beside a link to its FMUs."""
    folder = Path(tempfile.mkdtemp(prefix="mutants-"))
    try:
        for name in COPIED:
            if (root / name).is_dir():
                shutil.copytree(root / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy2(root / name, folder / name)
        (folder / "fmus").symlink_to(root / "fmus", target_is_directory=True)
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def changed(file: Path, text: str) -> Iterator[None]:
    """A file with another content for a while. Its times differ too, so that nobody takes compiled code for it."""
    before, times = file.read_bytes(), file.stat()
    file.write_text(text, encoding="utf-8")
    os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns + 10**10))
    try:
        yield
    finally:
        file.write_bytes(before)
        os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))


def passes(tree: Path, tests: Sequence[str], limit: float | None = None, *, shown: bool = False) -> bool:
    """Whether tests pass in a tree, within ``limit`` seconds; in a process of their own. ``shown``: what pytest prints."""
    one_thread()  # of the process that loads the libraries, and so of those made of it
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(LIBRARIES)
    process = context.Process(target=_run, args=(str(tree), list(tests), shown))
    process.start()
    process.join(limit)
    if process.is_alive():
        process.kill()
        process.join()
        return False
    return process.exitcode == 0


def timed(tree: Path, tests: Sequence[str]) -> tuple[bool, float]:
    """Whether tests pass in a tree, and the seconds that they take."""
    begin = time.monotonic()
    return passes(tree, tests, shown=True), time.monotonic() - begin


def content_key(texts: Sequence[str], files: Sequence[Path]) -> str:
    """Hash of texts and of the contents of files."""
    digest = hashlib.sha256()
    for text in (*texts, *(hashlib.sha256(p.read_bytes()).hexdigest() for p in files)):
        digest.update(text.encode() + b"\0")
    return digest.hexdigest()[:32]


def _run(tree: str, tests: list[str], shown: bool) -> None:
    """Run tests in a process that has loaded nothing of the project; ends it with pytest's code."""
    os.chdir(tree)
    sys.path[:] = [tree, f"{tree}/tests", *(p for p in sys.path if not (Path(p or ".") / "fmu_sources").is_dir())]
    for name in [n for n in sys.modules if n.partition(".")[0] in ("cosim", "build_fmus", "fmu_sources", "tests")]:
        del sys.modules[name]
    if not shown:
        sink = os.open(os.devnull, os.O_WRONLY)
        os.dup2(sink, 1)
        os.dup2(sink, 2)
    import built  # the FMUs as they are: a mistake is none of theirs
    import pytest

    built.build_all = built.BuiltFmus
    sys.exit(int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-p", "no:randomly", *tests])))
