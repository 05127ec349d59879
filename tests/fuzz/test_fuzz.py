"""Each target for a second or two, the cases that have failed once, and what the fuzzers themselves notice."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("resource")  # what measures the memory of a process; Windows has none

from built import BuiltFmus

from fuzz import bench, campaign, mutate, targets
from fuzz.targets import TARGETS

CORPUS = sorted(p.name for p in campaign.CORPUS.iterdir())


@pytest.mark.parametrize("name", TARGETS)
def test_some_cases_of_each_target(name: str, built_fmus: BuiltFmus, tmp_path: Path) -> None:  # noqa: ARG001
    failures, tried = campaign.campaign(name, 0, 0, 100, corpus=tmp_path, longest=bench.HANGS)
    assert not failures, "\n".join(map(str, failures))
    assert tried == 100


@pytest.mark.parametrize("name", CORPUS)
def test_cases_that_have_failed_once(name: str) -> None:
    assert name in TARGETS
    files = sorted((campaign.CORPUS / name).iterdir())
    assert files
    assert campaign.replay(name, files, bench.HANGS) is None


@pytest.mark.parametrize("name", TARGETS)
def test_the_same_seed_gives_the_same_cases(name: str, built_fmus: BuiltFmus) -> None:  # noqa: ARG001
    module = targets.target(name)
    made = [[module.make(bench.seeded(name, 3, i)) for i in range(20)] for _ in range(2)]
    assert made[0] == made[1]
    assert len(set(made[0])) > 10


# ------------------------------------------------------------------------------------- what is noticed of one case


@pytest.fixture
def large(monkeypatch: pytest.MonkeyPatch) -> None:
    """This process is larger than a user's."""
    monkeypatch.setattr(bench, "MOST", float("inf"))


def judged(run: object, longest: float = bench.HANGS) -> str | None:
    return bench.failure(SimpleNamespace(run=run, ALLOWED=(LookupError,)), b"", longest)  # type: ignore[arg-type]


def raises(error: Exception) -> object:
    def run(_case: bytes, _folder: Path) -> None:
        raise error

    return run


@pytest.mark.usefixtures("large")
def test_what_may_come_of_a_case(monkeypatch: pytest.MonkeyPatch) -> None:
    assert judged(lambda case, folder: None) is None
    assert judged(raises(LookupError("no such thing: 'a'"))) is None
    assert "ValueError: wrong" in str(judged(raises(ValueError("wrong"))))
    assert "without words" in str(judged(raises(LookupError())))
    assert "steer a terminal" in str(judged(raises(LookupError("a\x1b[31m"))))
    assert "characters" in str(judged(raises(LookupError("x" * 10_000))))
    assert "more than 0.1 s" in str(judged(_busy, 0.1))
    monkeypatch.setattr(bench, "MOST", 1.0)
    assert "MB of memory" in str(judged(lambda case, folder: None))


def _busy(_case: bytes, _folder: Path) -> None:
    end = time.process_time() + 2
    while time.process_time() < end:
        pass


# -------------------------------------------------------------------------------------------- and of many, in a process

TARGET = """
import os
ALLOWED = ()
def make(rng):
    return b"%d" % rng.randrange(10)
def run(case, folder):
    if case == b"7":
        {how}
"""


@pytest.fixture
def made_up(tmp_path: Path) -> Iterator[SimpleNamespace]:
    """A target of the test's own, below the folder of the others while the test runs."""
    path = Path(campaign.__file__).with_name("made_up_by_a_test.py")

    def write(how: str) -> str:
        path.write_text(TARGET.format(how=how))
        return path.stem

    yield SimpleNamespace(write=write, corpus=tmp_path)
    path.unlink()
    sys.modules.pop(f"{campaign.__package__}.{path.stem}", None)


@pytest.mark.parametrize(
    ("how", "words"), [("raise ValueError('seven')", "ValueError: seven"), ("os.abort()", "the process ended with -6")]
)
def test_failures_and_ends_are_found_and_kept(made_up: SimpleNamespace, how: str, words: str) -> None:
    name = made_up.write(how)
    numbers = [i for i in range(30) if bench.seeded(name, 0, i).randrange(10) == 7]
    failures, tried = campaign.campaign(name, 0, 0, 30, corpus=made_up.corpus)
    assert [f.number for f in failures] == numbers
    assert tried == 30
    for failure in failures:
        assert words in failure.what
        assert campaign.kept(failure.file) == b"7"
        assert f"--seed 0 --first {failure.number} --cases 1" in str(failure)
    assert words.rsplit(maxsplit=1)[-1] in str(campaign.replay(name, [failures[0].file]))
    failures, tried = campaign.campaign(name, 0, 0, 1000, corpus=made_up.corpus, most=1)
    assert (len(failures), tried) == (1, numbers[0] + 1)


def test_mutations_change_something() -> None:
    text = b"distance [m],left [m]\n0,1.5\n1,2.5\n"
    for change in {*mutate.TEXTS}:
        changed = {change(bench.seeded(change.__name__, 0, i), text) for i in range(50)}
        assert len(changed) > 3, change.__name__
