"""What the page of the public HMMWV says of natural frequencies is what its models have."""

import itertools
import re
import runpy
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from pages import ROOT

WRITER = runpy.run_path(str(ROOT / "docs" / "write_public_hmmwv.py"))


@pytest.mark.parametrize("name", ["modes", "ring", pytest.param("blend", marks=pytest.mark.full)])
def test_tables_are_those_of_the_models(name: str) -> None:
    """Natural frequencies, directions of tire forces, and peaks by the blend of the dampers."""
    text = (ROOT / "docs" / "reference" / "public-hmmwv.md").read_text(encoding="utf-8")
    hint = f"run `python docs/write_public_hmmwv.py --only {name}` and commit docs/reference/public-hmmwv.md"
    assert WRITER["put"](text, name, WRITER[f"{name}_table"]()) == text, hint


CAR = WRITER["ride_car"](WRITER["load_ride_car"]("ride_car_hmmwv")).linearize()


def test_modes_are_named_after_how_they_look() -> None:
    """The car of paper 001 by hand.

    Equal axles, so that heave and pitch, and wheels together and opposed, are single masses on springs.
    """
    found = WRITER["modes"](CAR)
    assert set(found) == set(WRITER["SHAPES"])
    body, wheel, spring, damper, tire, damping = 2800.0, 4 * 135.0, 4 * 120e3, 4 * 6e3, 4 * 500e3, 4 * 100.0
    a = np.array(
        [
            [0, 0, 1, 0],
            [0, 0, 0, 1],
            [-spring / body, spring / body, -damper / body, damper / body],
            [spring / wheel, -(spring + tire) / wheel, damper / wheel, -(damper + damping) / wheel],
        ]
    )
    slow, fast = sorted((v for v in np.linalg.eigvals(a) if v.imag > 0), key=abs)
    for name, expected in (
        ("heave", slow),
        ("pitch", slow),
        ("front wheels, together", fast),
        ("rear wheels, together", fast),
    ):
        assert found[name] == pytest.approx([expected] * len(found[name]), rel=2e-3), (
            name
        )  # the pitch inertia of the file is rounded


def test_axles_that_a_mode_does_not_tell_apart_have_all_of_its_frequencies() -> None:
    found = WRITER["modes"](CAR)
    front, rear = found["front wheels, opposed"], found["rear wheels, opposed"]
    assert len(front) == 2
    assert front == rear
    assert len(found["roll"]) == 1


@pytest.mark.parametrize("seed", range(4))
def test_names_of_modes_do_not_depend_on_the_order_of_eigenvectors(seed: int) -> None:
    """LAPACK's order differs with the processor; here the states exchange their places and lengths instead."""
    rng = np.random.default_rng(seed)
    n = len(CAR.A)
    turn = np.linalg.qr(rng.standard_normal((n, n)))[0]
    turned = replace(CAR, A=turn @ CAR.A @ turn.T, B=turn @ CAR.B, C=CAR.C @ turn.T)
    expected, found = WRITER["modes"](CAR), WRITER["modes"](turned)
    assert set(found) == set(expected)
    for name, values in expected.items():
        assert found[name] == pytest.approx(values, rel=1e-6), name


def test_the_script_runs_as_the_page_says() -> None:
    script = str(ROOT / "docs" / "write_public_hmmwv.py")
    subprocess.run([sys.executable, script, "--help"], check=True, capture_output=True)


def test_the_page_says_whose_responses_stand_beside_ours() -> None:
    """Nobody published them: they were computed with the code of Project Chrono."""
    page = (ROOT / "docs" / "reference" / "public-hmmwv.md").read_text(encoding="utf-8")
    assert "were published" not in page
    assert ", published |" not in page
    assert len(re.findall(r", Chrono \|", page)) == len(WRITER["CHRONO"]) + len(WRITER["JUDGED"])


def test_cases_that_test_a_change_of_the_tire_alternate_with_those_that_guide_it() -> None:
    """On each course the speeds alternate, and the slowest case tests where the gap of power is largest."""
    for course in {c for c, _ in WRITER["CHRONO"]}:
        halves = [WRITER["is_test_case"](mph) for c, mph in sorted(WRITER["CHRONO"], key=lambda k: k[1]) if c == course]
        assert all(a != b for a, b in itertools.pairwise(halves)), course
    assert WRITER["is_test_case"](min(mph for _, mph in WRITER["CHRONO"]))
    assert not any(WRITER["is_test_case"](mph) for _, mph in WRITER["JUDGED"])
