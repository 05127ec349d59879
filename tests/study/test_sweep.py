"""Sweeps: what varies is set, every run has its row, the same table whoever makes it, and what the page says of it."""

from __future__ import annotations

import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from built import BuiltFmus
from click.testing import CliRunner
from pyarrow import parquet as pq
from rich.console import Console
from sine import OMEGA
from sweep_tables import FMUS, made, table_of

import cosim.cli
from cosim import WiringError
from cosim.core.errors import CosimError
from cosim.study import CaseError, MeasureError, Runner, dask, load
from cosim.study.design import Axis, Design, DesignError, axis
from cosim.study.dispatch import DIED
from cosim.study.sweep import RunningStats, history, prepare, run_sweep
from cosim.study.sweep_command import running_table
from cosim.study.sweep_report import sweep_report
from cosim.study.sweep_statistics import sobol_indices

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
FILE = HERE / "falling.py"


@pytest.fixture(scope="module")
def experiment() -> Any:
    return load(str(FILE))


def test_parameters_of_components_and_options_of_cases_vary(experiment: Any, tmp_path: Path) -> None:
    sweep = made(experiment, "mass.rate=1:3:3", "offset=0,5", "count=1,2", method="grid")
    seen: list[tuple[int, int, int]] = []
    table = run_sweep(sweep, FMUS, tmp_path / "runs", processes=1, progress=lambda *p: seen.append(p))
    rates, offsets = (np.array(table.axes[n]) for n in ("mass.rate", "offset"))
    np.testing.assert_allclose(table.metrics["fallen"], 0.1 * rates + offsets)
    assert table.metrics["count"].tolist() == table.axes["count"] == [1, 2] * 6
    assert seen == [(i, 12, 0) for i in range(13)]
    path = table.write(tmp_path / "t.parquet")
    read = pq.read_table(path)
    assert read.column_names == ["run", "mass.rate", "offset", "count", "fallen", "failed"]
    assert read["fallen"].to_pylist() == table.metrics["fallen"].tolist()


CHOOSING = """
from cosim import System

STOP_TIME = 0.2
RECORD = ["car.body.az"]
ALLOW_UNCONNECTED = True


def system(kind: str = "A", speed: float = 1.0):
    made = System()
    made.add("car", f"x/{kind}.fmu", step="1 ms", start={"road.height": 0.05, "force": 0.0})
    return made


def measure(run):
    return {"az": float(abs(run.recording["car.body.az"]).max())}
"""


def test_an_fmu_that_an_option_chooses_is_looked_at(
    built_fmus: BuiltFmus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not only that of the base case: where it changes, its runs are made again."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x").mkdir()
    first, second = (built_fmus.path(name, 3) for name in ("QuarterCarHmmwv", "QuarterCarBench"))
    for kind in "AB":
        shutil.copy(first, tmp_path / "x" / f"{kind}.fmu")
    (tmp_path / "choosing.py").write_text(CHOOSING)
    sweep = prepare(load("choosing.py"), FMUS, Design((axis("kind=A,B"),), "grid"))
    before = run_sweep(sweep, FMUS, tmp_path / "runs", processes=1).metrics["az"]
    assert before[0] == before[1]
    shutil.copy(second, tmp_path / "x" / "B.fmu")
    after = run_sweep(sweep, FMUS, tmp_path / "runs", processes=1).metrics["az"]
    assert after[0] == before[0] != after[1]


@pytest.mark.parametrize("name", ["run", "failed", "history", "mass.rate"])
def test_metrics_do_not_take_the_place_of_columns(name: str, tmp_path: Path, raises) -> None:
    text = FILE.read_text()
    assert '"fallen"' in text
    (tmp_path / "other.py").write_text(text.replace('"fallen"', f'"{name}"'))
    sweep = prepare(
        load(str(tmp_path / "other.py")), FMUS, Design((Axis("mass.rate", "values", values=(1, 2)),), "grid")
    )
    with raises(DesignError, match=f"'{name}'"):
        run_sweep(sweep, FMUS, tmp_path / "runs", processes=1)


def test_a_metric_may_tell_what_varies(tmp_path: Path) -> None:
    (tmp_path / "other.py").write_text(FILE.read_text().replace('"fallen": float', '"mass.rate": 10 * float'))
    sweep = prepare(
        load(str(tmp_path / "other.py")), FMUS, Design((Axis("mass.height", "values", values=(1.0, 2.0)),), "grid")
    )
    assert run_sweep(sweep, FMUS, tmp_path / "runs", processes=1).metrics["mass.rate"] == pytest.approx(1.0)
    same = FILE.read_text().replace('"count": case.count', '"count": case.count, "mass.rate": run.start("mass.rate")')
    (tmp_path / "same.py").write_text(same)
    sweep = prepare(
        load(str(tmp_path / "same.py")), FMUS, Design((Axis("mass.rate", "values", values=(1.0, 2.0)),), "grid")
    )
    assert run_sweep(sweep, FMUS, tmp_path / "same", processes=1).metrics["mass.rate"].tolist() == [1.0, 2.0]


def test_numbers_of_numpy_are_numbers(tmp_path: Path) -> None:
    text = FILE.read_text()
    returned = "{'whole': np.int64(3), 'single': np.float32(0.5), 'true': np.bool_(True)}"
    (tmp_path / "other.py").write_text(
        f"{text[: text.index('def measure')]}import numpy as np\n\n\ndef measure(_):\n    return {returned}\n"
    )
    with Runner(load(str(tmp_path / "other.py")), FMUS) as runner:
        assert json.dumps(runner.metrics(runner.experiment.case())) == '{"whole": 3, "single": 0.5, "true": true}'


@pytest.mark.parametrize(
    ("returned", "said"),
    [("None", "None"), ("3.5", r"3\.5"), ("{1: 2.0}", r"\{1: 2\.0\}"), ("{'b': {1, 2}}", "as 'b'")],
)
def test_measure_returns_numbers_by_name(returned: str, said: str, tmp_path: Path, raises) -> None:
    text = FILE.read_text()
    (tmp_path / "other.py").write_text(text[: text.index("def measure")] + f"def measure(_):\n    return {returned}\n")
    experiment = load(str(tmp_path / "other.py"))
    with Runner(experiment, FMUS) as runner, raises(MeasureError, match=f"{said}"):
        runner.metrics(experiment.case())
    sweep = prepare(experiment, FMUS, Design((Axis("mass.height", "values", values=(1.0, 2.0)),), "grid"))
    assert all(
        "measure() returned" in why for why in run_sweep(sweep, FMUS, tmp_path / "runs", processes=1).failures.values()
    )


def test_a_sweep_ends_at_once_where_the_first_run_lacks_what_is_to_be_ranked(
    experiment: Any, tmp_path: Path, raises
) -> None:
    sweep = made(experiment, "mass.rate=1:5", samples=200)
    seen: list[int] = []
    with raises(DesignError):
        run_sweep(sweep, FMUS, tmp_path, processes=1, needed="fell", progress=lambda done, *_: seen.append(done))
    assert max(seen) == 0
    assert len(run_sweep(sweep, FMUS, tmp_path, processes=1, needed="fallen").metrics["fallen"]) == 200


FAILING = (
    FILE.read_text()
    .replace("offset: float = 0.0, count: int = 1", "rate: float = 1.0")
    .replace('"10 ms")', '"10 ms", start={"rate": rate})')
)
FAILING = FAILING[: FAILING.index("def measure")]


@pytest.mark.parametrize(
    "command", ["study failing.py --rate {0} --rate {1}", "sweep failing.py --method grid --vary rate={0},{1}"]
)
def test_a_command_fails_where_every_run_did(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The page is written all the same; a single run that came to its end is enough for success."""
    monkeypatch.chdir(tmp_path)
    Path("failing.py").write_text(FAILING)
    refused = CliRunner().invoke(cosim.cli.app, command.format(810, 820).split())
    assert isinstance(refused.exception, CosimError)
    assert re.match("all 2 runs failed; the first: .*too fast", str(refused.exception), re.DOTALL)
    assert len(list(tmp_path.rglob("report.html"))) == 1
    assert CliRunner().invoke(cosim.cli.app, command.format(810, 2).split()).exit_code == 0


@pytest.mark.parametrize(
    ("command", "option"),
    [("sweep --method grid --run 1", "run"), ("optimise --minimise fallen --trials 2", "trials")],
)
def test_a_case_may_have_an_option_that_is_called_like_one_of_the_command(
    command: str, option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The option is the command's then, and the case has its default."""
    monkeypatch.chdir(tmp_path)
    text = (
        FILE.read_text()
        .replace("offset: float = 0.0", f"{option}: float = 40.0")
        .replace("case.offset", f"case.{option}")
    )
    Path(f"with_{option}.py").write_text(text)
    name, *options = command.split()
    done = CliRunner().invoke(cosim.cli.app, [name, f"with_{option}.py", "--vary", "mass.rate=1:2", *options])
    assert done.exit_code == 0, done.output
    (fallen,) = re.findall(r"fallen +([0-9.]+)", done.output)
    assert 40.1 <= float(fallen) <= 40.2


def test_failures_are_rows(experiment: Any, tmp_path: Path) -> None:
    """An error, and the end of a process: both are rows, and the others have their numbers."""
    sweep = prepare(experiment, FMUS, Design((Axis("mass.rate", "values", values=(1, 2, 850, 3, 950)),), "grid"))
    table = run_sweep(sweep, FMUS, tmp_path, processes=2)
    assert set(table.failures) == {2, 4}
    assert "too fast" in table.failures[2]
    assert table.failures[4] == DIED
    assert np.isnan(table.metrics["fallen"]).tolist() == [False, False, True, False, True]
    page = sweep_report(table, FMUS)
    assert [row[0] for row in page.sections[-2].tables[0].rows] == [2, 4]


def test_one_in_a_hundred_ends_its_process(experiment: Any, tmp_path: Path) -> None:
    """Of 300 runs 3 crash and 3 fail.

    These are listed with their reasons, all others have their numbers, and nothing is run again.
    """
    rates = [950.0 + i if i % 100 == 17 else 801.0 + i / 10 if i % 100 == 50 else 1 + i / 100 for i in range(300)]
    sweep = prepare(experiment, FMUS, Design((Axis("mass.rate", "values", values=tuple(rates)),), "grid"))
    table = run_sweep(sweep, FMUS, tmp_path, processes=2)
    assert {i for i, why in table.failures.items() if why == DIED} == {17, 117, 217}
    assert {i for i, why in table.failures.items() if "too fast" in why} == {50, 150, 250}
    good = np.array([i for i in range(300) if i not in table.failures])
    np.testing.assert_allclose(table.metrics["fallen"][good], 0.1 * np.array(rates)[good])
    counts = []
    run_sweep(sweep, FMUS, tmp_path, processes=2, progress=lambda *p: counts.append(p))
    assert counts == [(300, 300, 6)]


def test_histories_of_all_runs(experiment: Any, tmp_path: Path, raises) -> None:
    """Kept as files, found by the number of the run, made again where one is missing; not for runs that fail."""
    sweep = made(experiment, "mass.rate=1,2,850,3", "mass.height=0,1", method="grid")
    without = run_sweep(sweep, FMUS, tmp_path / "runs", processes=1)
    with raises(DesignError):
        history(without.write(tmp_path / "table.parquet"), 0)
    counts: list[int] = []
    table = run_sweep(
        sweep, FMUS, tmp_path / "runs", processes=1, histories=True, progress=lambda done, *_: counts.append(done)
    )
    assert counts[0] == 2  # those that failed
    table.write(tmp_path / "table.parquet")
    found = history(tmp_path, 3)
    assert (sweep.of(3).parameter_0, sweep.of(3).parameter_1) == (2, 1)
    np.testing.assert_allclose(found["mass.z"], 1 - 2 * np.asarray(found.time))
    kept = tmp_path / table.histories[3]
    for break_ in (kept.unlink, lambda: kept.write_bytes(b""), lambda: kept.write_bytes(kept.read_bytes()[:-100])):
        break_()
        counts.clear()
        again = run_sweep(
            sweep, FMUS, tmp_path / "runs", processes=1, histories=True, progress=lambda done, *_: counts.append(done)
        )
        assert counts == [7, 8]
        assert again.histories == table.histories
        assert history(tmp_path, 3)["mass.z"].tolist() == found["mass.z"].tolist()
    with raises(DesignError):
        history(tmp_path, 8)


def test_a_recording_that_cannot_be_kept_ends_the_sweep_and_is_no_fault_of_the_run(
    experiment: Any, tmp_path: Path, raises
) -> None:
    sweep = made(experiment, "mass.rate=1,2,3", method="grid")
    (tmp_path / "histories").write_text("a file where the folder belongs: as good as a full disk")
    with raises(OSError):
        run_sweep(sweep, FMUS, tmp_path / "runs", processes=1, histories=True)
    (tmp_path / "histories").unlink()
    table = run_sweep(sweep, FMUS, tmp_path / "runs", processes=1, histories=True)
    assert not table.failures
    assert all((tmp_path / name).is_file() for name in table.histories)


FULL = FILE.read_text().replace(
    '            raise ValueError("too fast")',
    "            if not os.path.exists({room!r}):\n"
    "                raise RuntimeError('no FMU') from OSError(28, 'No space left on device')\n            return",
)


def test_a_full_disk_of_a_worker_ends_the_sweep_and_is_no_fault_of_the_run(tmp_path: Path) -> None:
    """Those before are kept; the others are made when there is room."""
    (tmp_path / "full.py").write_text(FULL.replace("{room!r}", repr(str(tmp_path / "room"))))
    sweep = prepare(
        load(str(tmp_path / "full.py")), FMUS, Design((Axis("mass.rate", "values", values=(1, 850, 2)),), "grid")
    )
    with pytest.raises(OSError, match=r"worker on \S+ "):
        run_sweep(sweep, FMUS, tmp_path / "runs", processes=1)
    (tmp_path / "room").touch()
    seen: list[int] = []
    table = run_sweep(sweep, FMUS, tmp_path / "runs", processes=1, progress=lambda done, *_: seen.append(done))
    assert (seen[0], len(table.failures)) == (1, 0)


def test_statistics_as_runs_arrive(experiment: Any, tmp_path: Path) -> None:
    sweep = made(experiment, "mass.rate=1:3", samples=20, seed=3)
    running_stats = RunningStats()
    table = run_sweep(sweep, FMUS, tmp_path, processes=1, running_stats=running_stats)
    resumed = RunningStats()
    run_sweep(sweep, FMUS, tmp_path, processes=1, running_stats=resumed)
    x = table.metrics["fallen"]
    for found in (running_stats, resumed):
        rows = {name: numbers for name, *numbers in found.rows()}
        assert rows["fallen"] == pytest.approx([20, x.mean(), x.std(ddof=1), x.min(), x.max()], rel=1e-12)
        assert rows["count"][:3] == [20, 1.0, 0.0]
    running_stats.add('{"failed": "no"}')
    running_stats.add('{"metrics": {"fallen": NaN, "text": "a"}}')
    assert running_stats.failed == 1
    assert {n: k for n, k, *_ in running_stats.rows()} == {"fallen": 20, "count": 20}
    shown = Console(width=100, record=True, file=io.StringIO())
    shown.print(running_table(running_stats))
    assert f"{x.mean():.4g}" in shown.export_text()


def test_what_is_there_is_not_run_again(experiment: Any, tmp_path: Path) -> None:
    """A larger design shares what points it has with a smaller one, and every executor finds the same."""
    small = made(experiment, "mass.rate=1,2", method="grid")
    run_sweep(small, FMUS, tmp_path, processes=1)
    seen = []
    large = made(experiment, "mass.rate=1,2,3", method="grid")
    with ThreadPoolExecutor(1) as here:
        table = run_sweep(large, FMUS, tmp_path, executor=here, progress=lambda *p: seen.append(p))
    assert seen == [(2, 3, 0), (3, 3, 0)]
    np.testing.assert_allclose(table.metrics["fallen"], [0.1, 0.2, 0.3])


def test_points_that_are_alike_are_run_once(experiment: Any, tmp_path: Path) -> None:
    design = Design((axis("mass.rate=1,2"),), "list", 3, listed=((1.0,), (2.0,), (1.0,)))
    seen = []
    table = run_sweep(
        prepare(experiment, FMUS, design), FMUS, tmp_path, processes=1, progress=lambda *p: seen.append(p)
    )
    assert table.metrics["fallen"][0] == table.metrics["fallen"][2]
    assert seen[-1] == (3, 3, 0)
    assert len(seen) == 3


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("mass.rat=1:2", WiringError),
        ("mess.rate=1:2", DesignError),
        ("ofset=1:2", DesignError),
        ("offset=a,b", CaseError),
        ("mass.rate=a,b", WiringError),
        ("mass.z=1:2", WiringError),
    ],
)
def test_what_cannot_vary(experiment: Any, text: str, error: type[Exception], raises) -> None:
    with raises(error):
        made(experiment, text)


def test_whole_numbers_are_found_out(experiment: Any, raises) -> None:
    sweep = made(experiment, "count=1:3", samples=30, base={"offset": 2.0})
    assert {p for i in range(30) for p in sweep.point(i)} == {1, 2, 3}
    assert sweep.of(0).offset == 2.0
    with raises(DesignError):
        prepare(experiment, FMUS, Design((axis("count=1:3"),), fixed={"ofset": 1}))


def run(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    program = "import sys; from cosim.cli import main; sys.exit(main())"
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "150"}
    return subprocess.Popen(
        [sys.executable, "-c", program, "sweep", str(FILE), *arguments],
        cwd=folder,
        env=environment,
        text=True,
        stdout=-1,
        stderr=-2,
    )


DESIGN = ("--vary", "mass.rate=1:3", "--vary", "mass.height=0:1", "--samples", "300", "--processes", "1")


def test_a_killed_sweep_continues_to_the_same_table_and_page(tmp_path: Path) -> None:
    for name in ("whole", "broken"):
        (tmp_path / name).mkdir()
    process = run(tmp_path / "whole", *DESIGN)
    text, _ = process.communicate()
    assert process.returncode == 0, text
    assert "300/300" in text
    assert "0 failed" in text
    process = run(tmp_path / "broken", *DESIGN)
    runs = tmp_path / "broken" / "results" / "falling" / "sweep" / ".runs"
    end = time.monotonic() + 300
    while sum(p.read_bytes().count(b"\n") for p in runs.glob("*.lines")) < 3:
        assert time.monotonic() < end
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    process = run(tmp_path / "broken", *DESIGN)
    process.communicate()
    found = [
        {
            p.relative_to(folder).as_posix(): p.read_bytes()
            for p in folder.rglob("*")
            if p.is_file() and ".runs" not in p.parts
        }
        for folder in (tmp_path / "whole", tmp_path / "broken")
    ]
    assert found[0] == found[1]
    assert "results/falling/sweep/table.parquet" in found[0]


def test_one_run_of_a_sweep_again(tmp_path: Path) -> None:
    process = run(tmp_path, *DESIGN, "--run", "7")
    text, _ = process.communicate()
    assert process.returncode == 0, text
    assert (tmp_path / "results" / "falling" / "sweep" / "run-7.csv").read_text().startswith("time [s],mass.z [m]")
    process = run(tmp_path, *DESIGN, "--run", "300")
    assert "the design has runs 0 to 299" in process.communicate()[0]


def test_a_design_of_a_thousand_million_runs_is_not_begun(tmp_path: Path) -> None:
    process = run(tmp_path, "--vary", "mass.rate=1:3", "--samples", "1000000000")
    text, _ = process.communicate()
    assert process.returncode == 1
    assert (
        "1e+09 runs: at 0.1 s each about 3 years on one core; nothing was run. Take fewer --samples, or give --yes"
        in " ".join(text.split())
    )
    assert not (tmp_path / "results").exists()


# ----------------------------------------------------------------------------------- a quarter car on a sine road, full

RANGES = {
    "car.body.mass": (2000.0, 3600.0),
    "car.suspension.stiffness": (120e3, 360e3),
    "car.suspension.damping": (6e3, 24e3),
}
WHEEL, TIRE, TIRE_DAMPING = 270.0, 1e6, 200.0


def amplitude(mass: Any, stiffness: Any, damping: Any) -> Any:
    """Of the body's acceleration in closed form: |s^2 z / r| times 1 cm, at s = j OMEGA."""
    s = 1j * OMEGA
    strut, tire = stiffness + damping * s, TIRE + TIRE_DAMPING * s
    body = strut * tire / ((mass * s**2 + strut) * (WHEEL * s**2 + strut + tire) - strut**2)
    return np.abs(s**2 * body) * 0.01


def quadrature_indices() -> tuple[list[float], list[float]]:
    """First-order and total Sobol indices by Gauss-Legendre quadrature with 24 points for each parameter."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    points = [low + (nodes + 1) / 2 * (high - low) for low, high in RANGES.values()]
    w = weights / 2
    y = amplitude(*np.meshgrid(*points, indexing="ij"))

    def mean(values: Any, over: tuple[int, ...]) -> Any:
        for k in sorted(over, reverse=True):
            values = np.tensordot(values, w, axes=(k, 0))
        return values

    total = mean(y**2, (0, 1, 2)) - mean(y, (0, 1, 2)) ** 2
    first, whole = [], []
    for k in range(3):
        others = tuple(i for i in range(3) if i != k)
        first.append(float((w @ mean(y, others) ** 2 - mean(y, (0, 1, 2)) ** 2) / total))
        without = mean(y, (k,))
        whole.append(float(1 - (mean(without**2, (0, 1)) - mean(y, (0, 1, 2)) ** 2) / total))
    return first, whole


def test_the_closed_form_is_that_of_the_fmu() -> None:
    """At the nominal values, so that the indices below are of the same function."""
    found = load(str(HERE / "sine.py"))
    table = run_one(found)
    assert table == pytest.approx(amplitude(2800.0, 240e3, 12e3), rel=2e-3)


def run_one(experiment: Any) -> float:
    from cosim.study import Runner

    with Runner(experiment, FMUS) as runner:
        return float(runner.metrics(experiment.case())["amplitude"])


@pytest.mark.full
def test_sobol_indices_of_a_quarter_car(tmp_path: Path) -> None:
    """Within 0.05 of a Gauss quadrature of its closed-form response."""
    texts = [f"{name}={low}:{high}" for name, (low, high) in RANGES.items()]
    sweep = prepare(load(str(HERE / "sine.py")), FMUS, Design(tuple(map(axis, texts)), "saltelli", 1024))
    table = run_sweep(sweep, FMUS, tmp_path, processes=2)
    assert not table.failures
    first, whole = quadrature_indices()
    for found, s1, st in zip(sobol_indices(table, "amplitude"), first, whole, strict=True):
        assert found[1] == pytest.approx(s1, abs=0.05)
        assert found[3] == pytest.approx(st, abs=0.05)


def test_sobol_indices_of_the_closed_form(experiment: Any) -> None:
    """The same design on the closed form itself: the sampling error alone is far below 0.05."""
    texts = [
        f"{name}={low}:{high}" for name, low, high in (("mass.rate", 0, 1), ("mass.height", 0, 1), ("offset", 0, 1))
    ]
    ranges = list(RANGES.values())

    def response(*u: Any) -> Any:
        return amplitude(*(low + x * (high - low) for x, (low, high) in zip(u, ranges, strict=True)))

    table = table_of(experiment, response, *texts, method="saltelli", samples=2048)
    first, whole = quadrature_indices()
    for found, s1, st in zip(sobol_indices(table, "y"), first, whole, strict=True):
        assert found[1] == pytest.approx(s1, abs=0.03)
        assert found[3] == pytest.approx(st, abs=0.03)


@pytest.mark.full
def test_full_cars_on_random_roads_give_one_table_everywhere(tmp_path: Path) -> None:
    """On two processes, and begun there, ended in the middle and continued on a Dask cluster: the same bytes."""
    texts = ("road.class=1,2,3,4,5", "road.seed=1..400", "car.body.mass=2000:3200", "speed.start.speed=5:20")
    sweep = prepare(
        load(str(ROOT / "benchmarks" / "random_roads.py")), FMUS, Design(tuple(map(axis, texts)), "lhs", 400)
    )
    whole = run_sweep(sweep, FMUS, tmp_path / "whole", processes=2).write(tmp_path / "whole.parquet").read_bytes()

    class EndedError(Exception):
        pass

    def end(done: int, *_: int) -> None:
        if done == 200:
            raise EndedError

    with pytest.raises(EndedError):
        run_sweep(sweep, FMUS, tmp_path / "parts", processes=2, progress=end)
    first: list[int] = []
    with dask("local", 2) as executor:
        parts = run_sweep(
            sweep, FMUS, tmp_path / "parts", executor=executor, progress=lambda done, *_: first.append(done)
        )
    assert first[0] == 200
    assert parts.write(tmp_path / "parts.parquet").read_bytes() == whole
    assert not parts.failures
