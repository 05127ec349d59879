"""The FMU reference says what the FMUs say."""

from __future__ import annotations

import runpy

from built import FMUS, BuiltFmus
from pages import ROOT


def test_the_reference_is_up_to_date(built_fmus: BuiltFmus) -> None:  # noqa: ARG001
    written = (ROOT / "docs" / "fmus.md").read_text(encoding="utf-8")
    page = runpy.run_path(str(ROOT / "docs" / "write_fmus.py"))["reference"](FMUS)
    assert written == page, "run `build-fmus && python docs/write_fmus.py` and commit docs/fmus.md"


def test_vehicles_have_degrees_of_freedom() -> None:
    """A car is no "seven-degree car": whoever reads that thinks of angles."""
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    assert [p.name for p in pages if "-degree car" in p.read_text(encoding="utf-8")] == []
