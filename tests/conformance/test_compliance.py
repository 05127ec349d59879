"""What `cosim check` asks of every FMU it asks of ours: no error, no warning, no note.

The other files of this folder go further than the standard: exact bits, messages, refusals that leave no trace.
"""

from __future__ import annotations

from api import Library

from cosim.check import Workers, check


def test_nothing_is_found(fmu: Library, workers: Workers) -> None:
    report = check(fmu.path, workers=workers)
    assert [f"{f.severity} {r.name}: {f}" for r, f in report.findings()] == []
    assert not report.not_run
    assert {r.kind for r in report.results} == {"", "cs", *(["me"] if fmu.is_continuous else [])}
