"""What the pages show is true: their code runs, their commands print what they say, their links lead somewhere."""

from __future__ import annotations

import csv
import json
import math
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pages import PAGES, ROOT, blocks, headings, help_of, links, same, transcripts, words
from pyarrow import parquet as pq

from cosim import Recording
from cosim.experiments import EXPERIMENTS
from cosim.study import FmuSet, Results

BIN = Path(sys.executable).parent
LINES_OF_A_STUDY = 50


def run_blocks(page: Path) -> dict[str, object]:
    """All Python blocks of a page, one after the other in one namespace; errors name the block."""
    namespace: dict[str, object] = {"__name__": "page"}
    for number, code in enumerate(blocks(page, "python"), start=1):
        exec(compile(code, f"{page.name}, block {number}", "exec"), namespace)
    return namespace


TUTORIAL = ROOT / "docs" / "tutorials" / "first-component.md"


def test_tutorial(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = run_blocks(TUTORIAL)
    printed = capsys.readouterr().out
    assert "modes [Hz]" in printed
    ends = {k: float(r["body.z"][-1]) for k, r in names["ends"].items()}  # type: ignore[attr-defined]
    assert math.isclose(ends["CoSimulation"], ends["ModelExchange"], rel_tol=5e-3)
    recording = names["recording"]
    assert set(recording) == {"with_inerter.body.az", "without.body.az"}  # type: ignore[call-overload]
    assert (workplace / "inerter.html").is_file()


def test_a_system_as_one_fmu_runs_in_fmpy(workplace: Path) -> None:
    names = run_blocks(ROOT / "docs" / "how-to" / "other-tools.md")
    result = names["result"]
    assert {"car.body.z", "car.body.az"} <= set(result.dtype.names)
    assert result["time"][-1] == 2.0
    assert abs(result["car.body.z"]).max() > 0.01
    assert (workplace / "Bumps.fmu").is_file()


def test_systems_as_ssp(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Written in both versions and read again; the page itself compares the numbers."""
    run_blocks(ROOT / "docs" / "how-to" / "ssp.md")
    assert capsys.readouterr().out.count("car (RideCarHmmwv) every 0.001 s") == 2
    assert (workplace / "Bumps2.ssp").is_file()


def test_a_system_that_runs_in_a_browser(workplace: Path) -> None:
    run_blocks(ROOT / "docs" / "how-to" / "live.md")
    assert "WebAssembly.compile" in (workplace / "bumps.html").read_text()


def test_many_copies(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:  # noqa: ARG001
    names = run_blocks(ROOT / "docs" / "how-to" / "batch.md")
    assert "in lanes:\n     road (RoadSine)" in capsys.readouterr().out
    assert names["seen"].shape == (100, 2)  # type: ignore[attr-defined]
    assert len(set(names["rms"].tolist())) == 100  # type: ignore[attr-defined]


def test_a_gradient(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:  # noqa: ARG001
    names = run_blocks(ROOT / "docs" / "how-to" / "gradients.md")
    found, trust = names["found"], names["trust"]
    assert len(found.parameters) == 5  # type: ignore[attr-defined]
    assert abs(trust.deviation).max() < 1e-6  # type: ignore[attr-defined]
    printed = capsys.readouterr().out
    assert "car.suspension.front.damper" in printed
    (table,) = (t for t in blocks(ROOT / "docs" / "how-to" / "gradients.md", "text") if t.startswith("  0.90"))
    assert printed.endswith(table)
    slopes, differences = (np.array(names[n]) for n in ("slopes", "differences"))  # they contradict each other
    assert (slopes > 8.0).all()
    assert (differences < 0.0).all()
    wide = names["there"].trust(0.02)  # type: ignore[attr-defined]
    assert abs(wide.deviation).max() > 0.3


@pytest.mark.filterwarnings("error::cosim.UnconnectedInputsWarning")
def test_a_third_party_fmu_runs_connected_and_isolated(
    seat: Path, workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The connected one feels the road; the isolated one gives the same numbers, as the page itself compares."""
    assert seat == workplace / "path" / "to" / "Seat.fmu"
    names = run_blocks(ROOT / "docs" / "how-to" / "third-party-fmus.md")
    printed = capsys.readouterr().out
    assert "seat (Seat) every 0.005 s" in printed
    assert "peak at the driver" in printed
    assert (workplace / "ride.csv").is_file()
    assert abs(names["recording"]["seat.acceleration"]).max() > 1.0  # type: ignore[index]
    assert len(names["isolated"]) == 1001  # type: ignore[arg-type]


def test_check_an_fmu(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:  # noqa: ARG001
    run_blocks(ROOT / "docs" / "how-to" / "check-an-fmu.md")
    assert capsys.readouterr().out.startswith("no finding; ")


def test_the_reference_lists_every_check() -> None:
    from cosim.check import CHECKS

    page = (ROOT / "docs" / "reference" / "checks.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| ((?:`\w+` ?)+)\|", page, re.MULTILINE)
    assert {f"{group}.{name}" for group, names in rows for name in re.findall(r"\w+", names)} == set(CHECKS)


def test_the_example_of_the_tutorial_is_the_file(workplace: Path) -> None:
    source = (ROOT / "docs" / "examples" / "quarter_car_inerter.py").read_text(encoding="utf-8")
    (shown,) = (b for b in blocks(TUTORIAL, "python") if "def quarter_car_inerter" in b)
    assert shown[shown.index("def ") :].rstrip() in source
    runpy.run_path(str(ROOT / "docs" / "examples" / "quarter_car_inerter.py"), run_name="__main__")
    assert (workplace / "QuarterCarInerter.fmu").is_file()


STUDIES = ROOT / "docs" / "how-to" / "studies.md"


def test_the_study_of_the_page_is_the_example(workplace: Path) -> None:  # noqa: ARG001
    example = (ROOT / "docs" / "examples" / "damping.py").read_text(encoding="utf-8")
    assert files_shown(STUDIES)["damping.py"] == example
    assert len([line for line in example.splitlines() if line.strip()]) <= LINES_OF_A_STUDY


def test_a_study_of_ones_own_runs_resumes_and_reports(workplace: Path) -> None:
    """What the page says of its study: every run, the best of them, what is stored, the claim that does not hold."""
    for name, text in files_shown(STUDIES).items():
        (workplace / name).write_text(text)
    code = "".join(blocks(STUDIES, "python")[-2:])  # here, and on an executor
    (workplace / "script.py").write_text(code + "    print(best.label)\n")
    for _ in range(2):
        done = subprocess.run([sys.executable, "script.py"], capture_output=True, text=True, check=True)
        assert done.stdout == "damping-6000-duration-0.1\n"
        stored = {p: p.stat().st_mtime_ns for p in (workplace / "results" / "runs").iterdir()}
    assert (
        sum(pq.read_metadata(p).num_rows for p in stored)
        == len(list(csv.reader((workplace / "results" / "tables" / "runs.csv").open()))) - 1
        == 8
    )
    summary = json.loads((workplace / "results" / "summary.json").read_text())
    assert [(c["id"], c["verdict"]) for c in summary["claims"]] == [("soft", "not reproduced")]


def test_a_report_of_ones_own(workplace: Path) -> None:
    """The report of the page, declared below its study: the softest damper has the lowest of these numbers."""
    (shown,) = (b for b in blocks(STUDIES, "python") if "StudyReport" in b)
    named = files_shown(STUDIES)["damping.py"].replace("claims=CLAIMS)", "claims=CLAIMS, report=lambda *s: report(*s))")
    (workplace / "reported.py").write_text(named + shown)
    experiment = runpy.run_path(str(workplace / "reported.py"))["EXPERIMENT"]
    tasks = experiment.tasks()
    results = Results(tasks, [{"metrics": {"comfort": t.case.damping, "grip": 0.03}} for t in tasks])
    page = experiment.study.report(results, FmuSet(workplace / "fmus"))
    assert page.lead == "A damping of 3000 N.s/m is the most comfortable one over a short bump."
    assert page.tables[0].rows[0] == (3e3, 0.1, 30.0)
    assert [(s.name, s.color, s.dash) for s in page.drawn[0].panels[0].series] == [
        ("short", "blue", None),
        ("long", "orange", "dash"),
    ]


SWEEPS = ROOT / "docs" / "how-to" / "sweeps.md"


def test_a_sweep_from_python(workplace: Path) -> None:
    """The table that a command has written, and a sweep in a script."""
    for name, text in files_shown(SWEEPS).items():
        (workplace / name).write_text(text)
    command = [BIN / "cosim", "sweep", "ride.py", "--design", "loads.toml", "--processes", "1", "--histories"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    printed = []
    for code in blocks(SWEEPS, "python"):
        if not code.startswith("# "):
            (workplace / "script.py").write_text(code)
            printed += subprocess.run(
                [sys.executable, "script.py"], capture_output=True, text=True, check=True
            ).stdout.split()
    rows, worst, end, lowest, mean = map(float, printed)
    assert rows == 64
    assert (end, lowest) == (2.0, pytest.approx(-4.823, abs=1e-3))  # as of the run that the page makes again
    assert 2.0 < worst < 8.0
    assert 1.0 < mean < 2.5


def test_signals_go_in_and_results_come_out(workplace: Path) -> None:
    """The road of the file moves the car, and every format gives the recording back (asserted on the page, too)."""
    names = run_blocks(ROOT / "docs" / "how-to" / "data.md")
    recording, shown = names["recording"], names["shown"]
    assert abs(recording["car.body.z"]).max() > 0.02  # type: ignore[index]
    written = Recording.read(workplace / "ride.parquet")
    assert (written.units, written.names) == (recording.units, recording.names)  # type: ignore[attr-defined]
    assert (written.data == recording.data).all()  # type: ignore[attr-defined]
    assert abs(shown["car.tire.deflection"] - 1000 * recording["car.tire.deflection"]).max() < 1e-12  # type: ignore[index]
    assert Recording.read(workplace / "displayed.nc").units["car.tire.deflection"] == "mm"
    assert len(names["figure"].data) == 3  # type: ignore[attr-defined]


STATES = ROOT / "docs" / "how-to" / "states-and-real-time.md"


def test_states_and_real_time(workplace: Path) -> None:
    """Its code, block by block; the blocks that are files are those of the examples."""
    shown = files_shown(STATES)
    assert {name: (ROOT / "docs" / "examples" / name).read_text(encoding="utf-8") for name in shown} == shown
    namespace: dict[str, object] = {}
    for code in blocks(STATES, "python"):
        if not code.startswith("# "):
            exec(compile(code, STATES.name, "exec"), namespace)
    assert (workplace / "before-the-bump.state").is_file()
    by_hand = namespace["simulation"].recording  # type: ignore[attr-defined]
    assert (len(by_hand), by_hand.real_time.instants) == (101, 100)


def test_a_system_as_a_learning_environment(workplace: Path) -> None:  # noqa: ARG001
    names = run_blocks(ROOT / "docs" / "how-to" / "learning.md")
    assert names["other"].time == pytest.approx(names["env"].time + 0.01)  # type: ignore[attr-defined]
    assert set(names["worth"]) == {-1.0, 0.0, 1.0}  # type: ignore[call-overload]
    for env in ("env", "other"):
        names[env].close()  # type: ignore[attr-defined]


def test_optimisation_and_calibration(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What the page says of its fit, and that its search is a search."""
    names = run_blocks(ROOT / "docs" / "how-to" / "optimisation.md")
    assert (workplace / "ride.log").is_file()
    found, fit = names["found"], names["fit"]
    assert len(found.trials) == 24  # type: ignore[attr-defined]
    assert 1 < len(found.front) < 24  # type: ignore[attr-defined]
    assert not fit.underfits  # type: ignore[attr-defined]
    tuned = names["tuned"]
    assert tuned.best.row["acceleration"] < 0.4 * tuned.trials[0].row["acceleration"]  # type: ignore[attr-defined]
    assert tuned.best.row["tire"] < 1.9002e-3  # type: ignore[attr-defined]
    pairs = {frozenset(pair[:2]) for pair in fit.correlated}  # type: ignore[attr-defined]
    assert frozenset({"car.body.mass", "car.suspension.stiffness"}) in pairs
    assert "Identifiable only in combination" in capsys.readouterr().out
    names["system"].close()  # type: ignore[attr-defined]


def test_the_assumed_values_that_a_drive_tells_are_those_of_the_page(
    workplace: Path,  # noqa: ARG001
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Values, intervals and numbers of runs. The intervals are those of exact derivatives at the true values."""
    example = runpy.run_path(str(ROOT / "docs" / "examples" / "calibrate_hmmwv.py"))
    fits = []
    calibrate = example["calibrate"]
    monkeypatch.setitem(
        example["main"].__globals__, "calibrate", lambda *a, **b: fits.append(calibrate(*a, **b)) or fits[-1]
    )
    monkeypatch.setattr("sys.argv", ["calibrate_hmmwv.py"])
    example["main"]()
    expected = next(t for t in blocks(ROOT / "docs" / "how-to" / "optimisation.md", "text") if "of Perryman 3" in t)
    shown, printed = words(expected), words(capsys.readouterr().out)
    assert len(shown) == len(printed)
    for a, b in zip(shown, printed, strict=True):
        assert same(a, b), f"the page shows {a!r}, the example prints {b!r}"
    with example["vehicle"](example["SPEEDS_KMH"]["fast"]) as system:
        _, _, truth = example["drive"](system)
        _, slopes = example["response"](system).with_slopes(truth)
    columns = (slopes * list(truth.values()) / np.array(list(example["SENSORS"].values()))[:, None]).reshape(-1, 10)
    told = np.isfinite(fits[0].deviations)
    exact = np.sqrt(np.diag(np.linalg.inv(columns[:, told].T @ columns[:, told])))
    np.testing.assert_allclose(fits[0].deviations[told], exact, rtol=0.02)


def test_the_examples_of_laws_build_what_they_try(workplace: Path) -> None:  # noqa: ARG001
    """More weight on the tires gives better road holding than the published control law, and less comfort."""
    front = runpy.run_path(str(ROOT / "docs" / "examples" / "preview_lq_front.py"))
    firm = front["with_weights"]({"suspension": 1e3, "tire": 1e6, "force": 1e-6})
    published, other = (front["drive"](w) for w in (front["PUBLISHED"]["comfort"], firm))
    assert other["grip"] < published["grip"]
    assert other["comfort"] > published["comfort"]


def test_weights_of_the_mpc_on_the_page_do_what_it_says(workplace: Path) -> None:  # noqa: ARG001
    """What the search has found lies within its bounds, and no direction within them lowers the power much further."""
    example = runpy.run_path(str(ROOT / "docs" / "examples" / "mpc_hmmwv_weights.py"))
    page = (ROOT / "docs" / "how-to" / "optimisation.md").read_text(encoding="utf-8")
    bounds, names = example["BOUNDS"], list(example["SPACE"])
    lines = [re.search(rf"^{name} +\d.*$", page, re.MULTILINE)[0] for name in bounds]  # type: ignore[index]
    rows = [[float(x) for x in line.removeprefix(name).split()] for name, line in zip(bounds, lines, strict=True)]
    with example["course"](example["SEEN"], 10.0) as seen:
        found = [seen(dict(zip(names, row[:3], strict=True))) for row in (rows[0], rows[2])]
    for slopes, row in zip(found, (rows[0], rows[2]), strict=True):
        power, travel, force = (slopes.row[n] for n in ("absorbed_power", "travel_rms", "force_rms"))
        assert [power, 1e3 * travel, force] == pytest.approx(row[3:6], rel=2e-3)
    published, best = found
    assert best.row["force_rms"] < bounds["more"]["force_rms"] * published.row["force_rms"] * 1.001
    at = np.array(rows[2][:3])
    power, force = (best.slopes[n] * at / best.row[n] for n in ("absorbed_power", "force_rms"))
    along = power - force * (power @ force) / (force @ force)  # the bound of the travel is not reached
    assert np.linalg.norm(along) < 0.1 * np.linalg.norm(power)


def test_a_surface_of_weights_is_that_of_runs(workplace: Path) -> None:  # noqa: ARG001
    """With a coarser lattice than the example's: at its own places the values and slopes are those of runs."""
    example = runpy.run_path(str(ROOT / "docs" / "examples" / "preview_lq_surface.py"))
    places = np.array([[0.3, 0.4], [0.6, 0.4]])
    with example["wired"]() as system:
        found = [example["slopes"](system, p) for p in places]
        of = example["interpolated"](places, np.array([f for f, _ in found]), np.array([s for _, s in found]))
        for place, (_, slopes) in zip(places, found, strict=True):
            np.testing.assert_allclose(of(place[None])[0], example["run"](system, place), atol=1e-9)
            for k in range(2):
                h = 1e-4 * np.eye(2)[k]
                up, down = (example["run"](system, place + s * h) for s in (1, -1))
                np.testing.assert_allclose(slopes[:, k], (up - down) / 2e-4, atol=1e-5)
                up, down = (of((place + s * h)[None])[0] for s in (1, -1))
                np.testing.assert_allclose(slopes[:, k], (up - down) / 2e-4, atol=1e-6)


def test_the_learning_example_learns_and_compares(
    workplace: Path,  # noqa: ARG001
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With a budget of seconds: no worse than at its beginning, and the published controllers where they always are."""
    example = runpy.run_path(str(ROOT / "docs" / "examples" / "learn_bench.py"))
    unseen = example["UNSEEN"]
    monkeypatch.setitem(example["learned"].__globals__, "UNSEEN", unseen[:1])
    monkeypatch.setitem(example["learned"].__globals__, "SECONDS", 5.0)
    assert min(unseen) >= max(example["OFFSETS"])  # nothing of what is compared was trained on
    lqr, passive = (example["published"](c)[0] for c in ("lqr-clipped", "passive"))
    before, after = (example["learned"](example["train"](generations))[0] for generations in (0, 3))
    assert lqr < 0.4 * passive
    assert before == pytest.approx(passive, rel=1e-3)  # it begins at no force
    assert after < 0.9 * passive
    assert capsys.readouterr().out == ""


def test_a_controller_in_python(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = run_blocks(ROOT / "docs" / "how-to" / "controller-in-python.md")
    printed = capsys.readouterr().out
    assert "component 'controller': begin returned Error at t = 0 s" in printed
    assert 1000 < max(names["forces"].values()) < 5000  # type: ignore[attr-defined]
    assert (workplace / "FilteredSkyhook.fmu").is_file()


def test_a_law_designed_on_an_fmu_does_what_was_designed(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every number that the page shows is printed by its code, and the loop has the damping of the design."""
    page = ROOT / "docs" / "how-to" / "control-design.md"
    names = run_blocks(page)
    shown, printed = words(" ".join(blocks(page, "text"))), words(capsys.readouterr().out)
    assert len(shown) == len(printed)
    for a, b in zip(shown, printed, strict=True):
        assert same(a.strip("[],"), b.strip("[],")), f"{page.name} shows {a!r}, its code prints {b!r}"
    assert names["measured"] == pytest.approx(names["designed_modes"][0][1], rel=0.01)  # type: ignore[index]
    assert (workplace / "QuarterCarLqr.fmu").is_file()


def test_the_glossary_is_in_order_and_complete() -> None:
    """Each term has a definition in one or two sentences, and a source."""
    text = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \*\*(.+?)\*\* \| (.+?) \| (.+?) \|$", text, re.MULTILINE)
    assert len(rows) == len(re.findall(r"^\|", text, re.MULTILINE)) - 2 >= 60
    assert [term.lower() for term, *_ in rows] == sorted(term.lower() for term, *_ in rows)
    assert [term for term, definition, _ in rows if not definition.endswith(".") or definition.count(". ") > 1] == []


COMMANDS = [(page, *t) for page in PAGES for t in transcripts(page)]


@pytest.mark.parametrize(
    ("page", "command", "expected"), COMMANDS, ids=[f"{p.stem}-{' '.join(c[:2])}" for p, c, _ in COMMANDS]
)
def test_commands_print_what_the_page_shows(page: Path, command: list[str], expected: str, workplace: Path) -> None:
    """Words must be equal, numbers close (platforms differ in the last digits).

    Times and speeds of the machine are left out.
    """
    for name, text in files_shown(page).items():
        (workplace / name).write_text(text)
    program, *arguments = command
    path = os.pathsep.join(filter(None, [str(ROOT / "docs" / "examples"), os.environ.get("PYTHONPATH")]))
    environment = {**os.environ, "COLUMNS": "120", "PYTHONPATH": path}  # examples may import each other
    done = subprocess.run([BIN / program, *arguments], capture_output=True, text=True, check=False, env=environment)
    shown, printed = words(expected), words(done.stdout + done.stderr)
    if shown and shown[-1] == "...":
        shown, printed = shown[:-1], printed[: len(shown) - 1]
    assert len(shown) == len(printed), f"{page.name} shows\n{expected}\nthe command prints\n{done.stdout}{done.stderr}"
    for a, b in zip(shown, printed, strict=True):
        assert same(a, b), f"{page.name} shows {a!r}, the command prints {b!r}\n{done.stdout}{done.stderr}"


def files_shown(page: Path) -> dict[str, str]:
    """Files that a page shows: a block whose first line is a comment with nothing but the file's name."""
    found = {}
    for language in ("toml", "csv", "python"):
        for text in blocks(page, language):
            if match := re.match(r"# (\S+\.\w+)\n", text):
                found[match[1]] = text if language == "toml" else text[match.end() :]
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_links_lead_somewhere(page: Path) -> None:
    for target in links(page):
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), f"{page.name}: {target}"
        assert file.is_relative_to(ROOT)
        if anchor and file.suffix == ".md":
            assert anchor in headings(file), f"{page.name}: {target}"


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_commands_named_in_a_page_exist(page: Path) -> None:
    """Options of our programs in running text are options that they have; those of a user's file are the file's own."""
    text = page.read_text(encoding="utf-8")
    for program, called, options in re.findall(
        r"(?<![\w/.-])(cosim|build-fmus)((?: +(?!--)[\w./-]+)*)([^`\n|]*)", text
    ):
        command = ["build"] if program == "build-fmus" else called.split()[:2]
        if not command or (len(command) == 2 and command[1] not in EXPERIMENTS):
            continue
        for option in re.findall(r"(?<![\w-])--[a-z][\w-]*", options):
            assert option in help_of(*command), f"{page.name}: cosim {' '.join(command)} has no {option}"


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_what_a_page_says_to_run_exists(page: Path) -> None:
    """Targets of make, modules and scripts of the repository."""
    text = page.read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    assert set(re.findall(r"(?:`|^ {4}|&& )make ([a-z-]+)", text, re.MULTILINE)) <= targets
    for module in re.findall(r"python -m ((?:benchmarks|tests)[\w.]*)", text):
        path = ROOT / module.replace(".", "/")
        assert path.with_suffix(".py").is_file() or (path / "__main__.py").is_file(), f"{page.name}: {module}"
    for file in re.findall(r"python ((?:benchmarks|docs|tests|\.ci)/[\w/]+\.py)", text):
        assert (ROOT / file).is_file(), f"{page.name}: {file}"
        imports = re.search(r"^from (?:tests|benchmarks)", (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE)
        assert not imports, f"{page.name}: {file} imports from the repository, so it is a module: python -m"
