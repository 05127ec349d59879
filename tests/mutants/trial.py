"""Runs tests on a copy of the project in which one mistake was made."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from build_fmus.base.one_thread import one_thread

LIMIT = (10.0, 5.0)  # s, and times what the tests take without a mistake: a test that takes longer has noticed
COPIED = ("build_fmus", "cosim", "fmu_sources", "tests", "docs", "pyproject.toml", "README.md")
ENDED = 100  # exit code of tests that passed
LIBRARIES = [
    "casadi",
    "cffi",
    "fmpy",
    "jinja2",
    "lxml.etree",
    "numpy",
    "plotly.graph_objects",
    "pydantic",
    "pytest",
    "scipy.linalg",
    "scipy.signal",
    "scipy.stats",
    "click",
]
"""What most tests load and no mistake is made in: loaded once."""


@contextmanager
def copied_tree(root: Path) -> Iterator[Path]:
    """A copy of the project, beside a link to its FMUs."""
    folder = Path(tempfile.mkdtemp(prefix="mutants-")).resolve()
    try:
        for name in COPIED:
            if (root / name).is_dir():
                shutil.copytree(root / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy2(root / name, folder / name)
        (folder / "fmus").symlink_to((root / "fmus").resolve(), target_is_directory=True)
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


def passes(tree: Path, tests: Sequence[str], limit: float | None = None, first: Sequence[str] = ()) -> bool:
    """Whether tests pass in a tree, within `limit` seconds, in a process of their own.

    `first`: names of the tests that run before the others, since they are likely to fail; the first that does ends
        the trial.
    """
    process = _started(tree, tests, None, first)
    process.join(limit)
    if process.is_alive():
        process.kill()
        process.join()
        return False
    return _passed(process)


@dataclass(frozen=True)
class Baseline:
    """What tests do without a mistake.

    Attributes:
        passed: whether they pass.
        seconds: that they take.
        callers: names of the tests that call a function, the quickest first, by "FILE | FUNCTION".
    """

    passed: bool
    seconds: float
    callers: Mapping[str, Sequence[str]]


def baseline(tree: Path, tests: Sequence[str]) -> Baseline:
    """Run tests in a tree, and note which functions of it they call; what pytest prints is shown."""
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        notes = Path(folder, "calls.json")
        process = _started(tree, tests, notes)
        process.join()
        passed = _passed(process)
        return Baseline(passed, time.monotonic() - begin, json.loads(notes.read_text()) if passed else {})


def imported(tree: Path, files: Sequence[str]) -> list[Path]:
    """What files of a tree import of it, with their data.

    See `build_fmus.base.sources.imported`: it looks in the project that it lies in, so the function of the tree is
    called.
    """
    code = "import sys; from build_fmus.base.sources import imported; print(*imported(sys.argv[1:]), sep='\\n')"
    command = [sys.executable, "-c", code, *files]
    found = subprocess.run(command, cwd=tree, check=True, stdout=subprocess.PIPE, text=True, encoding="utf-8")
    return [Path(line) for line in found.stdout.splitlines()]


def copy_bytecode(tree: Path, others: Sequence[Path]) -> None:
    """Give other copies what `baseline` has compiled in a tree; their files have the same times."""
    for folder in tree.rglob("__pycache__"):
        for other in others:
            shutil.copytree(folder, other / folder.relative_to(tree), dirs_exist_ok=True)


def content_key(texts: Sequence[str], files: Sequence[Path]) -> str:
    """Hash of texts and of the contents of files."""
    digest = hashlib.sha256()
    for text in (*texts, *(hashlib.sha256(p.read_bytes()).hexdigest() for p in files)):
        digest.update(text.encode() + b"\0")
    return digest.hexdigest()[:32]


def _started(tree: Path, tests: Sequence[str], notes: Path | None, first: Sequence[str] = ()) -> BaseProcess:
    one_thread()  # of the process that loads the libraries, and so of those made of it
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(LIBRARIES)
    process = context.Process(target=_run, args=(str(tree), list(tests), notes, list(first)))
    process.start()
    return process


def _passed(process: BaseProcess) -> bool:
    code = process.exitcode
    assert code is not None
    if 0 <= code < ENDED:  # no test has said anything
        raise RuntimeError(f"the process of the tests ended with {code}")
    return code == ENDED


def _run(tree: str, tests: list[str], notes: Path | None, first: list[str]) -> None:
    """Run tests in a process that has loaded nothing of the project; ends it with `ENDED` and pytest's code."""
    os.chdir(tree)
    sys.path[:] = [tree, f"{tree}/tests", *(p for p in sys.path if not (Path(p or ".") / "fmu_sources").is_dir())]
    for name in [n for n in sys.modules if n.partition(".")[0] in ("cosim", "build_fmus", "fmu_sources", "tests")]:
        del sys.modules[name]
    if notes is None:
        sink = os.open(os.devnull, os.O_WRONLY)
        os.dup2(sink, 1)
        os.dup2(sink, 2)
    # Bytecode of the tree as it is saves a third of the time of each trial. That of a mistake is not kept: the next one
    # may be of the same length, and would be taken for it.
    sys.dont_write_bytecode = notes is None
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1" if notes is None else ""  # of processes that tests start
    import built  # the FMUs as they are: a mistake is none of theirs
    import pytest

    built.build_all = built.BuiltFmus
    plugin = _First(first) if notes is None else _Calls(tree, notes)
    sys.exit(
        ENDED + int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-p", "no:randomly", *tests], plugins=[plugin]))
    )


class _First:
    """Lets some tests run before the others."""

    def __init__(self, names: Sequence[str]) -> None:
        self._rank = {name: i for i, name in enumerate(names)}

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        items.sort(key=lambda item: self._rank.get(item.nodeid, len(self._rank)))


class _Calls:
    """Notes which functions of the project each test calls, and how long it takes."""

    def __init__(self, tree: str, notes: Path) -> None:
        self._prefix, self._notes = f"{tree}{os.sep}", notes
        self._callers: dict[str, set[str]] = {}
        self._seconds: dict[str, float] = {}

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        begin = time.monotonic()

        def note(frame: Any, event: str, _: object) -> None:
            code = frame.f_code
            if event == "call" and code.co_filename.startswith(self._prefix):
                file = code.co_filename.removeprefix(self._prefix).replace(os.sep, "/")
                where = re.sub(r"\.<(?!locals).*|\.<locals>", "", code.co_qualname)  # a lambda is its function's
                self._callers.setdefault(f"{file} | {where}", set()).add(nodeid)
                self._seconds[nodeid] = time.monotonic() - begin

        sys.setprofile(note)

    def pytest_runtest_logfinish(self) -> None:
        sys.setprofile(None)

    def pytest_sessionfinish(self) -> None:
        found = {where: sorted(names, key=self._seconds.__getitem__) for where, names in self._callers.items()}
        self._notes.write_text(json.dumps(found))
