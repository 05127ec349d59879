"""Pictures of systems: what is in them, that nothing overlaps, that the README's is up to date."""

from __future__ import annotations

import itertools
import subprocess
import sys
from pathlib import Path

import pytest
from built import FMUS, ROOT, BuiltFmus
from lxml import etree
from systems import EVERY, experiment_system

from cosim import PythonComponent, System
from cosim.picture.layout import Box, arrange

SVG = "{http://www.w3.org/2000/svg}"


def crosses(box: Box, a: tuple[float, float], b: tuple[float, float]) -> bool:
    """Whether a horizontal or vertical line leads through the inside of a box."""
    (x1, x2), (y1, y2) = sorted((a[0], b[0])), sorted((a[1], b[1]))
    return x1 < box.right - 1 and x2 > box.x + 1 and y1 < box.bottom - 1 and y2 > box.y + 1


@pytest.mark.parametrize("name", EVERY)
def test_every_system_can_be_read(built_fmus: BuiltFmus, name: str) -> None:  # noqa: ARG001
    """Boxes lie beside each other, lines lead around them, and everything is within the picture.

    One line for each bundle.
    """
    with experiment_system(name) as system:
        schedule = system.schedule()
        picture = arrange(schedule)
        assert set(picture.boxes) == set(system.components.values())
        pairs = {(c.source, c.target) for c in schedule.connections}
        assert {(line.bundle.source, line.bundle.target) for line in picture.lines} == pairs
        assert len(picture.lines) == len(pairs)
        for a, b in itertools.combinations(picture.boxes.values(), 2):
            assert a.right < b.x or b.right < a.x or a.bottom < b.y or b.bottom < a.y
        for line in picture.lines:
            assert line.points[0][0] == picture.boxes[line.bundle.source].right
            assert line.points[-1][0] == picture.boxes[line.bundle.target].x
            for a, b in itertools.pairwise(line.points):
                assert a[0] == b[0] or a[1] == b[1]
                assert not any(crosses(box, a, b) for box in picture.boxes.values()), (name, line.bundle.label)
                assert 0 <= b[0] <= picture.width
                assert 0 <= b[1] <= picture.height
        for line, other in itertools.combinations(picture.lines, 2):
            assert line.label_at != other.label_at
        assert system.draw("x") == system.draw("x")


def test_the_picture_of_the_readme_is_up_to_date(built_fmus: BuiltFmus) -> None:  # noqa: ARG001
    with experiment_system("gpc") as system:
        assert system.draw("The system of cosim run gpc") == (ROOT / "docs" / "images" / "system.svg").read_bytes()


class Wave(PythonComponent):
    outputs = ("y",)
    default_step = "1/60"


class Sink(PythonComponent):
    inputs = ("a", "b")
    kind = "discrete"
    default_step = "20 ms"


def test_rates_delays_and_names_are_told() -> None:
    """Also of components in Python; signs that XML knows are escaped."""
    with System() as system:
        system.add("<wave>", Wave())
        system.add("sink", Sink(), offset="5 ms")
        system.connect("<wave>.y", "sink.a", delay=True)
        root = etree.fromstring(system.draw("One & other"))
    texts = [e.text for e in root.iter(f"{SVG}text")]
    for expected in ("One & other", "<wave>", "Wave", "continuous, 1/60 s", "discrete, 20 ms, from 5 ms", "y, delayed"):
        assert expected in texts
    (line,) = (e for e in root.iter(f"{SVG}path") if e.get("marker-end"))
    assert line.find(f"{SVG}title").text == "<wave>.y -> sink.a (one step of delay)"


def test_the_commands(built_fmus: BuiltFmus, tmp_path: Path) -> None:  # noqa: ARG001
    """Export, draw and run by the command line; what is wrong is a sentence."""

    def cosim(*arguments: str) -> subprocess.CompletedProcess[str]:
        program = [sys.executable, "-c", "from cosim.cli import main; main()"]
        return subprocess.run([*program, *arguments], capture_output=True, text=True, cwd=tmp_path, check=False)

    made = cosim("export", "bench", "--ssp", "Bench.ssp", "--ssp-version", "2.0", "--fmus", str(FMUS))
    assert made.returncode == 0, made.stderr
    assert "Bench.ssp, SSP 2.0" in made.stderr
    drawn = cosim("wiring", "Bench.ssp", "--title", "")
    assert drawn.returncode == 0, drawn.stderr
    assert etree.fromstring((tmp_path / "Bench.svg").read_bytes()).tag == f"{SVG}svg"
    ran = cosim(
        "run", "Bench.ssp", "--record", "plant.body.az", "--stop-time", "0.5", "--set", "plant.solver.step=0.0005"
    )
    assert ran.returncode == 0, ran.stderr
    assert "plant.body.az rms" in ran.stdout
    assert len(list((tmp_path / "results" / "Bench").glob("*.csv"))) == 1
    for arguments, said in (
        (("run", "Nowhere.ssp"), "no such SSP: Nowhere.ssp"),
        (("run", "Bench.ssp", "--set", "plant.mass=1"), "has no variable 'mass'"),
        (("run", "Bench.ssp", "--set", "plant.solver.step"), "'plant.solver.step' is not NAME=VALUE"),
        (("run", "Bench.ssp", "--variant", "Other"), "no variant 'Other'"),
        (("export", "bench"), "give one target"),
        (
            ("export", "bench", "--ssp", "B.ssp", "--without", "road", "--fmus", str(FMUS)),
            "--without applies to --fmu only",
        ),
        (("export", "bench", "--ssp", "B.ssp", "--ssp-version", "3", "--fmus", str(FMUS)), "no version of SSP '3'"),
    ):
        failed = cosim(*arguments)
        assert failed.returncode != 0, arguments
        assert said in failed.stderr
        assert "Traceback" not in failed.stderr
