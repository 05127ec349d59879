"""Each deliberate fault is found by the check that is there for it, and no other check says anything.

Without a fault nothing is found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from foreign import clocked
from foreign.faulty import BOTH, FAULTS, ODDITIES
from foreign.making import redescribed

from cosim.check import CHECKS, Options, Report, Workers, check
from cosim.check.calls import Instance

OF_FILES = ("archive", "description", "binary", "states.life")
LIMITS = Options(seconds=60.0, memory=500_000_000)  # a busy machine takes its time
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
    assert inapplicable <= {"archive.sources", "archive.terminals", "archive.layered", "description.clocks"}, (
        "a check that this FMU is no case for is tried by none"
    )
    assert {r.check.id for r in report.results} == {
        c.id for c in CHECKS.values() if str(version) in c.versions and c.id != "archive.readable"
    }


@pytest.mark.parametrize(("name", "version"), sorted(QUICK))
def test_the_fault_and_no_other(name: str, version: int, faulty: Callable[..., Path], workers: Workers) -> None:
    """In Co-Simulation, and in Model Exchange where it is not seen there; a fault of the file with checks of files.

    That is for the sake of time; `make test-full` tries all with all.
    """
    fault = FAULTS[name]
    of_file = fault.spoil is not None and all(not CHECKS[c].kinds for c in fault.found)
    texts: dict[str, list[str]] = {}
    for kind in ("cs", "me"):
        options = replace(limits(name), only=OF_FILES if of_file else (), kinds=(kind,))
        texts |= found(check(faulty(version, name), options, workers=workers))
        if set(fault.found) <= set(texts):
            break
    fits(name, texts)


@pytest.mark.full
@pytest.mark.parametrize(("name", "version"), CASES)
def test_the_fault_and_no_other_by_all_checks(
    name: str, version: int, faulty: Callable[..., Path], workers: Workers
) -> None:
    fits(name, found(check(faulty(version, name), limits(name), workers=workers)))


def limits(name: str) -> Options:
    """What hangs is not waited for."""
    return replace(LIMITS, seconds=2.0) if name.startswith("hang") else LIMITS


def fits(name: str, texts: dict[str, list[str]]) -> None:
    fault = FAULTS[name]
    assert set(fault.found) <= set(texts)
    assert set(texts) <= {*fault.found, *fault.also}, texts


ALLOWED = [
    (n, v)
    for n in ("fixed-step", "no-early-inputs", "no-early-derivatives", "adaptive", "empty-token")
    for v in ODDITIES[n].versions
]


@pytest.mark.parametrize(("name", "version"), ALLOWED)
def test_what_the_standard_allows_is_no_error(
    name: str, version: int, faulty: Callable[..., Path], workers: Workers
) -> None:
    report = check(faulty(version, name), LIMITS, workers=workers)
    assert report.exit_code() == 0
    assert set(found(report)) <= set(ODDITIES[name].also), found(report)


@pytest.mark.parametrize(("version", "kind"), [(2, "cs"), (3, "me")])
def test_one_instance_in_each_process(version: int, kind: str, faulty: Callable[..., Path], workers: Workers) -> None:
    """The FMU refuses a second one. Only what needs two at a time is not tried."""
    report = check(faulty(version, "once"), replace(LIMITS, kinds=(kind,)), workers=workers)
    assert found(report) == {}
    without = {r.check.id for r in report.results if "only once per process" in r.inapplicable}
    assert without == {"runs.instances", "runs.threads", "runs.memory", *(["exchange.pure"] if kind == "me" else [])}


@pytest.mark.parametrize("version", BOTH)
def test_what_takes_too_long_is_not_judged(version: int, faulty: Callable[..., Path], workers: Workers) -> None:
    """Whether it hangs or is slow cannot be told."""
    report = check(
        faulty(version, "step-hang"),
        Options(only=("states.life", "runs.reset"), kinds=("cs",), seconds=1.0),
        workers=workers,
    )
    assert found(report) == {}
    assert [(r.check.id, r.verdict) for r in report.results] == [
        ("states.life", "not judged"),
        ("runs.reset", "not applicable"),
    ]
    assert "DoStep (Co-Simulation, step mode)" in report.not_run
    assert "--timeout gives it more time" in report.not_run
    assert report.exit_code(strict=True) == 2


def test_a_life_of_slow_steps_is_short(faulty: Callable[..., Path], workers: Workers) -> None:
    """The second step would take an hour."""
    report = check(faulty(3, "slow"), Options(only=("states.life",), kinds=("cs",), seconds=60.0), workers=workers)
    assert [r.verdict for r in report.results] == ["passed"]


def test_messages_have_their_arguments(faulty: Callable[..., Path], workers: Workers) -> None:
    """FMI 2.0 loggers are variadic."""
    report = check(faulty(2, "step-fails"), Options(only=("states.life",), kinds=("cs",)), workers=workers)
    ((_, finding),) = report.findings()
    assert finding.text.endswith("returned Error: model cannot step: -3 of 4.2, 0.001 %")


def test_parameters_that_fmi2setupexperiment_loses(faulty: Callable[..., Path], workers: Workers) -> None:
    report = check(faulty(2, "setup-loses-parameters"), Options(only=("values.set",), kinds=("cs",)), workers=workers)
    texts = found(report)["values.set"]
    assert len(texts) == 2
    assert all(t.endswith("(set before fmi2SetupExperiment; set after it, the value is kept)") for t in texts)


def test_nothing_is_called_after_fatal(faulty: Callable[..., Path], workers: Workers) -> None:
    """The FMU would abort."""
    report = check(faulty(3, "fatal"), Options(only=("states", "values.set"), kinds=("cs",)), workers=workers)
    assert found(report) == {"states.allowed": ["error: Set of inputs (Co-Simulation, step mode) returns Fatal"]}


_CLOCK, _END = 'name="clock" valueReference="{}"', "</ModelVariables>"
_DIMENSION = f'<Dimension start="{2**63 - 1}"/>'
_HUGE = f'<Float64 name="e" valueReference="90" causality="local">{_DIMENSION * 2}</Float64>'
BEYOND = {  # interface, what the description says, and numbers instead that a C type cannot hold
    "clock": ("cs", _CLOCK.format(8), _CLOCK.format(8 + 2**32)),
    "negative clock": ("cs", _CLOCK.format(8), _CLOCK.format(8 - 2**32)),
    "indicators": ("me", 'numberOfEventIndicators="1"', 'numberOfEventIndicators="-3"'),
    "array": ("cs", _END, _HUGE + _END),
}


@pytest.mark.parametrize("name", BEYOND)
def test_numbers_beyond_their_c_type_break_no_check(
    name: str, faulty: Callable[..., Path], tmp_path: Path, workers: Workers
) -> None:
    kind, before, after = BEYOND[name]
    source = clocked.build("fixed", tmp_path) if "clock" in name else faulty(2 if name == "indicators" else 3)
    path = redescribed(source, tmp_path / "Beyond.fmu", (before.encode(), after.encode()))
    only = ("description.schema", "states.life", "values.start", "runs.repeat")
    report = check(path, replace(LIMITS, only=only, kinds=(kind,)), workers=workers)
    assert report.failures == []
    assert ("description.schema" in found(report)) == (name != "array")


def test_a_missing_derivative_is_named(faulty: Callable[..., Path]) -> None:
    for version, name, severity in (
        (2, "no-derivative-unknown", "warning"),
        (3, "no-derivative-unknown", "warning"),
        (2, "alias-for-derivative", "error"),
    ):
        texts = found(check(faulty(version, name), Options(only=("description.structure",))))["description.structure"]
        assert texts[0].startswith(
            f"{severity}: 'der(x)' is calculated in initialization, but not among the InitialUnknown"
        )


def test_every_check_has_a_fault_that_it_finds() -> None:
    tried = {c for fault in FAULTS.values() for c in fault.found}
    untried = {c.id for c in CHECKS.values()} - tried
    assert untried == {
        "archive.readable",
        "binary.libraries",
        "states.arguments",
        "states.statuses",
        "exchange.together",
    }


def test_nothing_is_asked_of_an_fmu_without_states() -> None:
    """Some answer with Error to a vector of 0 elements, which no importer asks for."""
    assert object.__new__(Instance)._vector("GetContinuousStates", 0) == []
