"""The page on errors and cost of the exchange shows what the benchmark measures, and its claims hold."""

from __future__ import annotations

import importlib.util
import re
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pages import ROOT
from scipy.linalg import expm

from benchmarks import masters
from cosim import Record
from cosim.engine.adaptive import FLOOR, SHARE

_SPEC = importlib.util.spec_from_file_location("write_masters", ROOT / "docs" / "write_masters.py")
assert _SPEC is not None
assert _SPEC.loader is not None
writer = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(writer)
NUMBER = r"\d[\d,]*\.?\d*(?:e-?\d+)?"
TEXT = writer.PAGE.read_text(encoding="utf-8")
BY_NAME = {s.name: s for s in masters.SUBJECTS}


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory, built_fmus: Any) -> Any:  # noqa: ARG001
    folder = tmp_path_factory.mktemp("masters")
    return lru_cache(lambda name: masters.measured(BY_NAME[name], folder))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", BY_NAME)
def test_the_page_shows_what_is_measured(name: str, results: Any) -> None:
    subject, result = BY_NAME[name], results(name)
    new = {"estimates": writer.estimates(subject, result), "costs": writer.costs(subject, result, "")}
    for table, cells in new.items():
        shown = writer.rows_of(TEXT, table)[name]
        assert len(shown) == len(writer.HEADS[table])
        for old, cell in zip(shown, cells, strict=True):
            if not cell:  # CoFmuPy is no part of the tests
                continue
            assert re.sub(NUMBER, "#", old) == re.sub(NUMBER, "#", cell)
            numbers = [[float(x.replace(",", "")) for x in re.findall(NUMBER, text)] for text in (old, cell)]
            assert numbers[0] == pytest.approx(numbers[1], rel=0.06, abs=0.011 if table == "estimates" else 0.0)


@pytest.mark.filterwarnings("ignore")
def test_the_claims_of_the_page(results: Any) -> None:
    found = {name: results(name) for name in BY_NAME}
    ratios = [ratio for result in found.values() for of in result.ratios.values() for ratio in of]
    assert all(0.5 <= ratio <= 2.0 for ratio in ratios)
    assert all(result.costs[f"tolerance {t:g}"].error < t for t in masters.TOLERANCES for result in found.values())
    rule = " ".join((ROOT / "docs" / "explanation" / "architecture.md").read_text(encoding="utf-8").split())
    assert f"to {FLOOR:g} of its nominal value if that is larger. It may be {100 * SHARE:g} % of the tolerance" in rule
    with BY_NAME["car with hydraulic actuators"].wired(Path("unused")) as system:
        assert system.coupled_spectral_radius().radius > 1.0


@pytest.mark.parametrize(
    ("name", "motion", "begin", "load"),
    [
        (
            "two-mass oscillator",
            {"a.x": [0, 1, 0, 0], "a.v": [-100, -0.2, 50, 0], "b.x": [0, 0, 0, 1], "b.v": [50, 0, -100, -0.2]},
            [1, 0, 0, 0],
            [0, 0, 0, 0],
        ),
        (
            "quarter truck",
            {
                "body.z": [0, 1, 0, 0],
                "body.vz": [-75, -5, 75, 5],
                "wheel.z": [0, 0, 0, 1],
                "wheel.vz": [750, 50, -4500, -52.5],
            },
            [0, 0, 0, 0],
            [0, 0, 0, 187.5],
        ),
    ],
)
def test_the_reference_is_the_exact_solution(name: str, motion: Any, begin: Any, load: Any, tmp_path: Path) -> None:
    """Of the linear systems, whose motion is known: the reference of the others is made in the same way."""
    subject = BY_NAME[name]
    subject.build(tmp_path)
    with subject.wired(tmp_path) as system:
        run = system.run(subject.stop, record=Record(list(motion), subject.step), tolerance=masters.REFERENCE)
    a = np.array(list(motion.values()))
    rest = np.linalg.solve(a, -np.array(load))
    exact = np.array([rest + expm(a * t) @ (begin - rest) for t in run.time])
    for column, signal in enumerate(motion):
        assert np.abs(run[signal] - exact[:, column]).max() < 1e-6 * np.abs(exact[:, column]).max()
