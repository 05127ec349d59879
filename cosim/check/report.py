"""What came out of the checks of an FMU, as data, as JUnit XML and as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lxml import etree

from build_fmus.base import escape
from cosim.check.rules import SEVERITIES, Check, Finding, Severity

CLEAN, ERRORS, UNCHECKED = 0, 1, 2  # exit codes


@dataclass(frozen=True)
class Result:
    """Result of a check of one interface ("cs", "me"), or of the file ("").

    `inapplicable` says why the check did not apply, or, without `judged`, why it has no verdict: it took too long, or a
    library is missing.
    """

    check: Check
    kind: str
    findings: tuple[Finding, ...] = ()
    inapplicable: str = ""
    seconds: float = 0.0
    more: int = 0  # findings that are not listed
    judged: bool = True

    @property
    def verdict(self) -> str:
        """The gravest severity of the findings, "not judged", "not applicable" or "passed"."""
        for severity in SEVERITIES:
            if any(f.severity == severity for f in self.findings):
                return severity
        return "not judged" if not self.judged else "not applicable" if self.inapplicable else "passed"

    @property
    def name(self) -> str:
        """Id of the check, with its interface if it has one."""
        return f"{self.check.id} [{self.kind}]" if self.kind else self.check.id


@dataclass
class Report:
    """Everything about one FMU."""

    path: Path
    name: str = ""
    fmi: str = ""
    tool: str = ""
    interfaces: tuple[str, ...] = ()
    layered: tuple[str, ...] = ()  # layered standards that it declares, each with its version
    results: list[Result] = field(default_factory=list)
    measures: dict[str, str] = field(default_factory=dict)
    not_run: str = ""  # why the FMU could not be run at all
    failures: list[str] = field(default_factory=list)  # checks that failed themselves, each with its traceback
    seconds: float = 0.0

    def findings(self, *severities: Severity) -> list[tuple[Result, Finding]]:
        """Findings of these severities (default: all), gravest first."""
        wanted = severities or SEVERITIES
        found = [(r, f) for r in self.results for f in r.findings if f.severity in wanted]
        return sorted(found, key=lambda pair: SEVERITIES.index(pair[1].severity))

    def count(self, verdict: str) -> int:
        """Results with a verdict."""
        return sum(r.verdict == verdict for r in self.results)

    def exit_code(self, strict: bool = False) -> int:
        """Exit code: 0 passed; 1 errors (with `strict` also warnings); 2 no errors, but some checks have no verdict.

        A check has no verdict when it could not be run, took too long, or failed itself.
        """
        if self.findings("error", *(("warning",) if strict else ())):
            return ERRORS
        return UNCHECKED if self.not_run or self.failures or self.count("not judged") else CLEAN

    def summary(self) -> str:
        """The counts in a line."""
        counts = [(len(self.findings(s)), s) for s in SEVERITIES]
        found = ", ".join(f"{n} {s}{'s' if n != 1 else ''}" for n, s in counts if n) or "no finding"
        late = f", {n} not judged" if (n := self.count("not judged")) else ""
        return f"{found}; {self.count('passed')} checks passed, {self.count('not applicable')} not applicable{late}"

    def data(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "fmu": str(self.path),
            "name": self.name,
            "fmi": self.fmi,
            "tool": self.tool,
            "interfaces": list(self.interfaces),
            "layered_standards": list(self.layered),
            "not_run": self.not_run,
            "failures": self.failures,
            "seconds": round(self.seconds, 3),
            "measures": self.measures,
            "results": [
                {
                    "check": r.check.id,
                    "interface": r.kind,
                    "title": r.check.title,
                    "verdict": r.verdict,
                    "section": section(r, self),
                    "advice": r.check.advice,
                    "reason": r.inapplicable,
                    "seconds": round(r.seconds, 4),
                    "more": r.more,
                    "findings": [{"severity": f.severity, "text": f.text, "line": f.line} for f in r.findings],
                }
                for r in self.results
            ],
        }


def section(result: Result, report: Report) -> str:
    """Where the standard says so: `FMI 2.0, 2.1.7 Getting and Setting Variable Values`."""
    version = report.fmi[:1]
    where = result.check.section.get(version, "")
    return f"FMI {version}.0, {where}" if where else ""


def to_json(reports: Sequence[Report]) -> str:
    """Reports as JSON text."""
    return json.dumps([r.data() for r in reports], indent=2, ensure_ascii=False) + "\n"


def to_junit(reports: Iterable[Report], strict: bool = False) -> bytes:
    """JUnit XML: a suite for each FMU, a case for each check; errors are failures, what does not apply is skipped."""
    root = etree.Element("testsuites")
    for report in reports:
        suite = etree.SubElement(root, "testsuite", name=escape.xml(report.path.name), time=f"{report.seconds:.3f}")
        failures = 0
        for r in report.results:
            group = f"{report.path.stem}.{r.check.group}"
            case = etree.SubElement(
                suite, "testcase", classname=escape.xml(group), name=escape.xml(r.name), time=f"{r.seconds:.3f}"
            )
            bad = [f for f in r.findings if f.severity == "error" or (strict and f.severity == "warning")]
            rest = [f for f in r.findings if f not in bad]
            if bad:
                failures += 1
                failure = etree.SubElement(case, "failure", type=bad[0].severity, message=escape.xml(str(bad[0])))
                failure.text = escape.xml("\n".join([*map(str, bad), section(r, report), r.check.advice]))
            elif r.inapplicable and not rest:
                etree.SubElement(case, "skipped", message=escape.xml(r.inapplicable))
            if rest:
                etree.SubElement(case, "system-out").text = escape.xml("\n".join(f"{f.severity}: {f}" for f in rest))
        skipped = report.count("not applicable") + report.count("not judged")
        suite.set("tests", str(len(report.results)))
        suite.set("failures", str(failures))
        suite.set("errors", "0")
        suite.set("skipped", str(skipped))
    return bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True, pretty_print=True))
