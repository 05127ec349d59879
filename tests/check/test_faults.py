"""Each deliberate fault is found by the check that is there for it, and no other check says anything; without a fault nothing is found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from foreign.faulty import BOTH, FAULTS

from cosim.check import CHECKS, Options, Report, Workers, check

OF_FILES = ("archive", "description", "binary", "states.life")
LIMITS = Options(seconds=3.0, memory=500_000_000)
CASES = [(name, version) for name, fault in FAULTS.items() for version in fault.versions]
QUICK = {(name, fault.versions[i % len(fault.versions)]) for i, (name, fault) in enumerate(FAULTS.items())}
"""Each fault in one of its versions."""


def found(report: Report) -> dict[str, list[str]]:
    """Texts of findings by check."""
    texts: dict[str, list[str]] = {}
    for result, finding in report.findings():
        texts.setdefault(result.check.id, []).append(f"{finding.severity}: {finding}")
    return texts


@pytest.mark.parametrize("version", BOTH)
def test_without_a_fault_nothing_is_found(version: int, faulty: Callable[..., Path], workers: Workers) -> None:
    report = check(faulty(version), LIMITS, workers=workers)
    assert found(report) == {}
    assert report.exit_code(strict=True) == 0
    inapplicable = {r.name for r in report.results if r.inapplicable}
    assert inapplicable <= {"archive.sources", "archive.terminals", "archive.layered", "description.clocks"}, "a check that this FMU is no case for is tried by none"
    assert {r.check.id for r in report.results} == {c.id for c in CHECKS.values() if str(version) in c.versions and c.id != "archive.readable"}


@pytest.mark.parametrize(("name", "version"), sorted(QUICK))
def test_the_fault_and_no_other(name: str, version: int, faulty: Callable[..., Path], workers: Workers) -> None:
    """A fault of the file with the checks of files, for the sake of time; `make test-full` tries all with all."""
    fault = FAULTS[name]
    of_file = fault.spoil is not None and all(not CHECKS[c].kinds for c in fault.found)
    fits(name, check(faulty(version, name), replace(LIMITS, only=OF_FILES if of_file else ()), workers=workers))


@pytest.mark.full
@pytest.mark.parametrize(("name", "version"), CASES)
def test_the_fault_and_no_other_by_all_checks(name: str, version: int, faulty: Callable[..., Path], workers: Workers) -> None:
    fits(name, check(faulty(version, name), LIMITS, workers=workers))


def fits(name: str, report: Report) -> None:
    fault, texts = FAULTS[name], found(report)
    assert set(fault.found) <= set(texts)
    assert set(texts) <= {*fault.found, *fault.also}, texts


def test_every_check_has_a_fault_that_it_finds() -> None:
    tried = {c for fault in FAULTS.values() for c in fault.found}
    untried = {c.id for c in CHECKS.values()} - tried
    assert untried == {"archive.readable", "archive.zip", "binary.libraries", "states.arguments", "states.statuses", "exchange.together"}
