"""The FMU reference says what the FMUs say."""

from __future__ import annotations

import runpy
from typing import Any

import pytest
from built import FMUS, BuiltFmus
from pages import PAGES, ROOT

from cosim import Fmu
from cosim.fmu.find import PUBLISHED, published_names
from fmu_sources.catalog import default_catalog


def test_the_reference_is_up_to_date(built_fmus: BuiltFmus) -> None:  # noqa: ARG001
    written = (ROOT / "docs" / "reference" / "fmus.md").read_text(encoding="utf-8")
    page = runpy.run_path(str(ROOT / "docs" / "write_fmus.py"))["index"](FMUS)
    assert written == page, "run `build-fmus && python docs/write_fmus.py` and commit docs/reference/fmus.md"


def test_the_names_of_the_catalog_are_up_to_date() -> None:
    """The master finds built FMUs by them."""
    text = runpy.run_path(str(ROOT / "docs" / "write_fmus.py"))["published"]()
    assert PUBLISHED.read_text(encoding="utf-8") == text, "run `python docs/write_fmus.py`; commit published.toml"
    assert set(published_names()) == set(default_catalog())


@pytest.fixture(scope="module")
def written(built_fmus: BuiltFmus) -> dict[str, Any]:  # noqa: ARG001
    return runpy.run_path(str(ROOT / "docs" / "write_fmus.py"))


def test_variables_as_the_pages_have_them(written: dict[str, Any]) -> None:
    """Inputs with what they take, arrays in one row, parameters with start and source.

    Compared with the FMU by hand.
    """
    (text,) = written["sections"](FMUS, ["PreviewBuffer"]).values()
    blocks = text.split("\n\n")
    assert (
        blocks[1]
        == "Discrete, sample time 0.005 s. Catalog: road ahead by distance, read under each wheel (paper 001)."
    )
    inputs, outputs, parameters = (block.splitlines() for block in blocks[2:])
    assert (inputs[0], outputs[0], parameters[0]) == (
        "| inputs | unit | description |",
        "| outputs | unit | description |",
        "| parameters | unit | start | description | source |",
    )
    assert "| `sensed.left.x` | m | distance along the road at which the left sensor sees it |" in inputs
    preview = "height under the fl wheel now, preview.step later, ...; beyond what is sensed the last height"
    assert f"| `preview.fl[1..16]` | m | {preview} |" in outputs
    assert (
        "| `leak.time` | s | 10 | time in which the mean of the sensed heights is forgotten | assumed |" in parameters
    )
    about = Fmu(FMUS / "fmi3" / "PreviewBuffer.fmu").description
    arrays = 4 * (len([n for n in about.outputs if n.startswith("preview.fl")]) - 1)
    assert [len(t) - 2 for t in (inputs, outputs, parameters)] == [
        len(about.inputs),
        len(about.outputs) - arrays,
        len(about.parameters),
    ]


def test_what_an_input_takes_stands_beside_it(written: dict[str, Any]) -> None:
    text = "".join(written["sections"](FMUS, ["MpcHmmwv", "FullCarHmmwv"]).values())
    limited = {
        v.name: v
        for n in ("MpcHmmwv", "FullCarHmmwv")
        for v in Fmu(FMUS / "fmi3" / f"{n}.fmu").description.inputs.values()
        if v.type == "real" and v.minimum is not None and v.maximum is not None and "[" not in v.name
    }
    assert limited
    for v in limited.values():
        assert (
            f"| `{v.name}` | {v.unit_name} | {v.description}; clipped to [{v.minimum:.6g}, {v.maximum:.6g}] |" in text
        )


def test_the_whole_reference_has_every_fmu_that_is_asked_for(written: dict[str, Any]) -> None:
    page = written["reference"](FMUS, ["Skyhook", "RoadBumps"])
    assert [line for line in page.splitlines() if line.startswith("## ")] == ["## Skyhook", "## RoadBumps"]
    assert len(page) > 2000


def test_vehicles_have_degrees_of_freedom() -> None:
    """A car is no "seven-degree car": whoever reads that thinks of angles."""
    assert [p.name for p in PAGES if "-degree car" in p.read_text(encoding="utf-8")] == []
