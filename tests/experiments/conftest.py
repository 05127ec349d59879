"""What the tests of all experiments share."""

from __future__ import annotations

from collections.abc import Iterator

import made_up
import pytest
from built import FMUS, BuiltFmus

from cosim.report import Report
from cosim.study import FmuSet, Results, Runner


@pytest.fixture(scope="session")
def fmus(built_fmus: BuiltFmus) -> FmuSet:  # noqa: ARG001
    """The built FMUs as an experiment takes them."""
    return FmuSet(FMUS)


@pytest.fixture(scope="module")
def runner(request: pytest.FixtureRequest, fmus: FmuSet) -> Iterator[Runner]:
    """Runs single cases of the module's `EXPERIMENT`."""
    with Runner(request.module.EXPERIMENT, fmus) as made:
        yield made


@pytest.fixture(scope="module")
def study(request: pytest.FixtureRequest) -> Results:
    """The plan of the module's `EXPERIMENT`, with the numbers that its `metrics`, `drawn` and `found` make up."""
    m = request.module
    return made_up.study(m.EXPERIMENT, m.metrics, m.drawn, getattr(m, "found", None))


@pytest.fixture(scope="module")
def page(request: pytest.FixtureRequest, study: Results, fmus: FmuSet) -> Report:
    """The report of the study; its captions carry no number beside the one that the page gives them."""
    made = request.module.report(study, fmus)
    titles = [x.title for s in made.sections for x in (*s.tables, *s.figures)]
    assert [t for t in titles if t.startswith(("Table", "Figure"))] == []
    return made
