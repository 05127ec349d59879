"""What all tests share.

The FMUs of the catalog and of the tests, built once and only when something changed, and the snapshots of sentences.
"""

from __future__ import annotations

import atexit
import gc
import os
import re
import signal
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from build_fmus.base.one_thread import VARIABLES, one_thread

limited = all(
    name in os.environ for name in VARIABLES
)  # in a process that loaded numpy after that, as of `make mutants`
assert limited or "numpy" not in sys.modules, "a plugin of pytest loads numpy before its threads are limited"
one_thread()  # as the commands; before numpy is loaded below
if (
    signal.getsignal(signal.SIGINT) is signal.SIG_IGN
):  # as in the background of a shell; the programs that tests interrupt inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)

gc.disable()  # until all tests are collected (pytest_collection_finish)

from hypothesis import settings  # noqa: E402

settings.register_profile("fixed", derandomize=True)  # the same examples everywhere and every time
settings.load_profile("fixed")

import awkward  # noqa: E402
from built import FMUS, BuiltFmus, build_all  # noqa: E402
from foreign import followers  # noqa: E402

from cosim.check import Workers  # noqa: E402


@pytest.fixture(scope="session")
def built_fmus() -> BuiltFmus:
    """All FMUs under test, for this machine, up to date."""
    return build_all()


@pytest.fixture
def workplace(built_fmus: BuiltFmus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:  # noqa: ARG001
    """The current folder while the code of a page runs, with the FMUs in `fmus/`."""
    (tmp_path / "fmus").symlink_to(FMUS, target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        yield tmp_path


@pytest.fixture(scope="session")
def follower(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """`foreign/follower.c` as FMU by FMI version: small, of somebody else's making, with states that it serializes."""
    folder = tmp_path_factory.mktemp("followers")
    return {version: followers.build(version, folder) for version in (2, 3)}


@pytest.fixture(scope="session")
def awkward_fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """`awkward.c` as FMU by FMI version."""
    folder = tmp_path_factory.mktemp("awkward")
    return {
        v: awkward.archive(folder / f"awkward{v}.fmu", awkward.description(v), binary=awkward.library(v, folder))
        for v in (2, 3)
    }


@pytest.fixture(scope="session")
def workers() -> Iterator[Workers]:
    """The process that checks FMUs."""
    with Workers() as found:
        yield found


VARIES = (
    (r"<tests>/[^ '\"]*?\d(?=/)", "<folder>"),
    (r"(not well-formed) \(.*?\)\)", r"\1 (<reason>)"),
    (r"(not a TOML file): .*", r"\1: <reason>"),
    (r"^Usage: .* Error:", "<usage>"),
    (r"(127\.0\.0\.1):\d+", r"\1:<port>"),
    (r"suspension-fmus-\d+", "suspension-fmus-<user>"),
    (r"\b\d{20}-\d+\b", "<time and process>"),
    (r"\b[0-9a-f]{32}\b", "<hash>"),
    (r"0x[0-9a-fA-F]{6,}", "<address>"),
)
"""What differs between machines and runs, besides the folders, and what a snapshot holds instead."""


@pytest.fixture
def sentence(snapshot, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], None]:
    """Compares a text with the snapshot of the test, which `make snapshots` renews."""
    places = {
        tmp_path: "<folder>",
        tmp_path_factory.getbasetemp(): "<tests>",
        Path(__file__).parents[1]: "<project>",
        Path(tempfile.gettempdir()): "<temporary>",
        Path.home(): "<home>",
    }

    def compare(text: str) -> None:
        for place in sorted(places, key=lambda p: -len(p.parts)):
            if len(place.parts) > 1:  # not `/`, a home of users without one
                text = text.replace(str(place), places[place])
        for pattern, name in VARIES:
            text = re.sub(pattern, name, text)
        assert text == snapshot

    return compare


@pytest.fixture
def raises(sentence):
    """As `pytest.raises`; the whole message is compared with the snapshot of the test."""

    @contextmanager
    def expect(kind, match: str | None = None) -> Iterator[pytest.ExceptionInfo]:
        with pytest.raises(kind, match=match) as caught:
            yield caught
        sentence(str(caught.value))

    return expect


@pytest.fixture
def refused(sentence):
    """As `raises` for several calls: their messages, a line each, are compared with one snapshot of the test."""

    def expect(kind, *calls: Callable[[], object]) -> list[str]:
        messages = []
        for call in calls:
            with pytest.raises(kind) as caught:
                call()
            messages.append(str(caught.value))
        sentence("\n".join(messages))
        return messages

    return expect


@pytest.fixture
def warns(sentence):
    """As `pytest.warns`; the warnings of this kind are compared with the snapshot of the test."""

    @contextmanager
    def expect(kind, match: str | None = None) -> Iterator[pytest.WarningsRecorder]:
        with pytest.warns(kind, match=match) as caught:
            yield caught
        sentence("\n".join(str(w.message) for w in caught if issubclass(w.category, kind)))

    return expect


FIRST = (
    "conformance/test_compliance",
    "target/test_embedded",
    "docs/test_pages",
    "conformance/test_reference",
    "check/test_faults",
    "install/test_release",
    "conformance/test_sanitizers",
    "kernels/test_kernels",
    "engine/test_experiments",
    "cli/test_own_vehicles",
    "install/test_installed",
    "export/test_system_fmu",
    "cli/test_cosim",
    "conformance/test_package",
    "cli/test_own_experiments",
    "study/test_driver",
)
"""Files whose tests take longest, begun first, so that at the end no worker is left alone with one of them."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int | None:
    """One worker more than the processors that this process may use, since tests that wait leave theirs idle.

    None, for the number of xdist, where its variable says how many.
    """
    if os.environ.get("PYTEST_XDIST_AUTO_NUM_WORKERS"):
        return None
    return 1 + (len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order of the test files; within a file as they are written."""
    here = Path(__file__).parent
    rank = {here / f"{name}.py": i for i, name in enumerate(FIRST)}
    missing = [path for path in rank if not path.is_file()]
    assert not missing, f"conftest.py: no such test file: {', '.join(map(str, missing))}"
    items.sort(key=lambda item: rank.get(item.path, len(rank)))


def pytest_collection_finish() -> None:
    """The garbage collector leaves out the 20,000 collected tests, which exist until the end."""
    gc.freeze()
    atexit.register(gc.unfreeze)  # libraries report what is left at the end as leaks
    gc.enable()
