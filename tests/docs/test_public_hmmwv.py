"""What the page of the public HMMWV says of natural frequencies is what its models have."""

import runpy

import numpy as np
import pytest
from pages import ROOT

WRITER = runpy.run_path(str(ROOT / "docs" / "write_public_hmmwv.py"))


def test_natural_frequencies_are_those_of_the_models() -> None:
    text = (ROOT / "docs" / "public-hmmwv.md").read_text(encoding="utf-8")
    hint = "run `python docs/write_public_hmmwv.py --only modes` and commit docs/public-hmmwv.md"
    assert WRITER["put"](text, "modes", WRITER["modes_table"]()) == text, hint


def test_modes_are_named_after_how_they_look() -> None:
    """The car of paper 001 by hand: equal axles, so that heave and pitch, and wheels together and opposed, are single masses on springs."""
    found = WRITER["modes"](WRITER["ride_car"](WRITER["load_ride_car"]("ride_car_hmmwv")).linearize())
    assert set(found) == set(WRITER["SHAPES"])
    body, wheel, spring, damper, tire, damping = 2800.0, 4 * 135.0, 4 * 120e3, 4 * 6e3, 4 * 500e3, 4 * 100.0
    a = np.array([
        [0, 0, 1, 0], [0, 0, 0, 1],
        [-spring / body, spring / body, -damper / body, damper / body],
        [spring / wheel, -(spring + tire) / wheel, damper / wheel, -(damper + damping) / wheel],
    ])  # fmt: skip
    slow, fast = sorted((v for v in np.linalg.eigvals(a) if v.imag > 0), key=abs)
    for name, expected in (("heave", slow), ("pitch", slow), ("front wheels, together", fast), ("rear wheels, together", fast)):
        assert found[name] == pytest.approx(expected, rel=2e-3), name  # the pitch inertia of the file is rounded
