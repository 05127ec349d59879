"""What `cosim check` asks of every FMU it asks of ours: no error, no warning, no note.

The other files of this folder go further than the standard: exact bits, messages, refusals that leave no trace.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest
from api import Library
from built import CATALOG_NAMES, NAMES

from cosim.check import Workers, check

EVERY = [
    pytest.param((n, fmi), id=f"fmi{fmi}-{n}", marks=[pytest.mark.full] * (fmi == 2 and n in CATALOG_NAMES))
    for n in NAMES
    for fmi in (2, 3)
]
"""FMUs of the catalog in FMI 2.0 are left to `make test-full`: they are of the declarations of those in FMI 3.0, and
the test components have what there is in FMI 2.0.
"""


@pytest.fixture(params=EVERY)
def fmu(request: pytest.FixtureRequest, load: Callable[[str, int], Library]) -> Library:
    """An FMU in one FMI version."""
    return load(*request.param)


def test_nothing_is_found(fmu: Library, workers: Workers) -> None:
    report = check(fmu.path, workers=workers)
    assert [f"{f.severity} {r.name}: {f}" for r, f in report.findings()] == []
    assert not report.not_run
    assert {r.kind for r in report.results} == {"", "cs", *(["me"] if fmu.is_continuous else [])}
