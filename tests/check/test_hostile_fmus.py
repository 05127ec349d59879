"""Hostile FMUs under `cosim check`.

What they write, claim and leave behind reaches neither the judge nor the machine.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from foreign import hostile
from processes import gone

from cosim.check import Options, Workers, check
from cosim.check.rules import CHECKS
from cosim.check.worker import Answer

LIMITS = Options(only=("states.life", "runs.repeat"), seconds=5.0, memory=500_000_000)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("hostile")


@pytest.fixture(scope="module")
def proof(folder: Path) -> Path:
    """A file that a deed makes, if it reaches anybody."""
    return folder / "proof"


@pytest.fixture(scope="module")
def workers(proof: Path) -> Iterator[Workers]:
    with pytest.MonkeyPatch.context() as context, Workers() as found:
        context.setenv("HOSTILE_PROOF", str(proof))
        yield found


@pytest.mark.parametrize(
    ("deed", "words"),
    [
        ("pickle", "channel of the check"),
        ("message", "channel of the check"),
        ("claim", "channel of the check"),
        ("flood", "1048576 bytes"),
    ],
)
@pytest.mark.parametrize("version", [2, 3])
def test_what_an_fmu_writes_into_descriptors_is_not_executed(
    folder: Path, proof: Path, workers: Workers, deed: str, words: str, version: int
) -> None:
    """It ends its process afterwards, as if nothing had happened: a finding, and the worker lives."""
    proof.unlink(missing_ok=True)
    worker = workers._start()
    report = check(hostile.build(version, folder, "exit", deed), LIMITS, workers=workers)
    assert workers._start() is worker
    assert not proof.exists()
    (found,) = (f for r, f in report.findings("error") if r.check.id == "states.life")
    assert words in found.text
    assert "ExitInitializationMode" in found.text


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux gives detached processes to the one that watches")
def test_detached_processes_are_ended_after_the_check(folder: Path, proof: Path, workers: Workers) -> None:
    report = check(hostile.build(3, folder, "exit", "detach"), LIMITS, workers=workers)
    assert report.findings() == []
    assert gone(int(proof.read_text()))


def test_a_state_beyond_all_memory_is_a_finding_among_the_others(folder: Path, workers: Workers) -> None:
    options = Options(only=("states.life", "saved"), seconds=5.0)
    report = check(hostile.build(3, folder, "size", "huge"), options, workers=workers)
    texts = [f.text for r, f in report.findings("error") if r.check.id == "saved.serialize"]
    assert len(texts) == 1
    assert "says that a state has 1152921504606846976 bytes" in texts[0]
    assert report.failures == []
    assert {r.check.id for r in report.results} == {
        c.id for c in CHECKS.values() if c.group == "saved" or c.id == "states.life"
    }


def test_a_mistake_of_a_check_loses_no_other_result(
    folder: Path, workers: Workers, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An FMU might bring a check to one; the report says so and ends with "not checked"."""
    broken = Answer(broken="Traceback: ZeroDivisionError")
    run = Workers.run
    monkeypatch.setattr(Workers, "run", lambda self, job: broken if job.check == "runs.repeat" else run(self, job))
    report = check(hostile.build(3, folder, "step", "nothing"), LIMITS, workers=workers)
    assert [r.verdict for r in report.results] == ["passed", "not applicable"]
    assert report.exit_code() == 2
    assert "ZeroDivisionError" in report.failures[0]


@pytest.mark.parametrize(
    "change",
    [
        {"findings": [["text", "fatal", 0]]},
        {"findings": [["text", "error"]]},
        {"findings": [[{}, "error", 0]]},
        {"findings": {}},
        {"measures": []},
        {"measures": {"time": 1}},
        {"seconds": "now"},
        {"lost": None},
        {"more": 1},
    ],
)
def test_answers_are_validated_field_by_field(change: dict[str, object], raises) -> None:
    right = json.loads(Answer(measures={"a": "b"}, seconds=1.0).pack())
    assert Answer.unpack(json.dumps(right).encode()).measures == {"a": "b"}
    with raises(ValueError):
        Answer.unpack(json.dumps({**right, **change}).encode())


@pytest.mark.parametrize("text", [b"", b"[" * 100_000, b"null", b"\x80\x04.", b"9" * 10_000, b'{"findings": []}'])
def test_what_is_no_answer_is_refused(text: bytes) -> None:
    with pytest.raises(ValueError, match="answer of a check"):
        Answer.unpack(text)


def test_texts_of_an_answer_do_not_steer_the_terminal() -> None:
    right = json.loads(Answer(seconds=1.0).pack())
    found = Answer.unpack(json.dumps({**right, "words": "\x1b[2J" + "x" * 10**6}).encode())
    assert "\x1b" not in found.words
    assert len(found.words) < 5000
