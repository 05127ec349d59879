"""Searches along derivatives: answers that are known, a car, the command, and what users do wrong."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from built import BuiltFmus
from click.testing import CliRunner
from scipy import optimize

from cosim.cli import app
from cosim.core.errors import CosimError
from cosim.study import FmuSet
from cosim.study.descent import descend
from cosim.study.design import Design, axis
from cosim.study.loading import load
from cosim.study.optimise import OptimisationError
from cosim.study.slopes import PointSlopes, Slopes, local_slopes, through
from cosim.study.sweep import prepare, run_sweep
from cosim.study.sweep_report import sweep_report

SPACE = {"x": (-2.0, 2.0), "y": (1.0, 100.0, "log")}


def bowls(values: Mapping[str, Any]) -> Slopes:
    """Squares of distances from (1, 10) and from (-1, 10), where y counts by its logarithm; `x` and its slope."""
    x, y = values["x"], values["y"]
    if x > 1.9:
        raise CosimError("over the edge")
    log = np.log(y / 10.0)
    return Slopes(
        {"right": (x - 1.0) ** 2 + log**2, "left": (x + 1.0) ** 2 + log**2, "at": x},
        {
            "right": np.array([2.0 * (x - 1.0), 2.0 * log / y]),
            "left": np.array([2.0 * (x + 1.0), 2.0 * log / y]),
            "at": np.array([1.0, 0.0]),
        },
    )


def test_one_objective_finds_its_minimum() -> None:
    found = descend(bowls, SPACE, {"right": "min"}, trials=20, first={"x": -1.5, "y": 80.0})
    assert found.best.values["x"] == pytest.approx(1.0, abs=1e-3)
    assert found.best.values["y"] == pytest.approx(10.0, rel=1e-3)
    assert len(found.trials) < 12
    assert found.trials[0].values == pytest.approx({"x": -1.5, "y": 80.0})


def test_a_trial_that_fails_does_not_end_the_search() -> None:
    """The maximum lies at the limits, beyond the edge."""
    found = descend(bowls, SPACE, {"left": "max"}, trials=30, first={"x": 0.5, "y": 20.0})
    assert {t.failed for t in found.trials} == {"", "over the edge"}
    assert found.best.row["left"] > 1.2**2 + np.log(2.0) ** 2 + 8.0


def walled(values: Mapping[str, Any], kind: str = "value") -> Slopes:
    """A square of the distance from (1, 10) that there is none of beyond x = 1.05."""
    x, y = values["x"], values["y"]
    log = np.log(y / 10.0)
    value, slope = 8.0 * (x - 1.0) ** 2 + log**2, 16.0 * (x - 1.0)
    if x > 1.05:
        value, slope = {"value": (np.nan, slope), "slope": (value, np.inf), "both": (-np.inf, np.nan)}[kind]
    return Slopes({"f": value, "at": x}, {"f": np.array([slope, 2.0 * log / y]), "at": np.array([1.0, 0.0])})


@pytest.mark.parametrize("kind", ["value", "slope", "both"])
@pytest.mark.parametrize("bounds", [{}, {"at_most": {"at": 1.9}}], ids=["L-BFGS-B", "SLSQP"])
def test_the_step_is_halved_where_a_number_is_not_finite(kind: str, bounds: dict[str, dict[str, float]]) -> None:
    found = descend(lambda v: walled(v, kind), SPACE, {"f": "min"}, trials=40, first={"x": -1.9, "y": 70.0}, **bounds)
    failed = [t for t in found.trials if t.failed]
    assert failed
    assert all(t.failed.endswith("and has no derivative") and t.failed.startswith("f is ") for t in failed)
    assert found.best.values["x"] == pytest.approx(1.0, abs=1e-3)
    assert found.best.values["y"] == pytest.approx(10.0, rel=1e-2)
    assert len(found.trials) < 25
    first = failed[0].number
    x = [t.values["x"] for t in found.trials]
    halved = [abs((x[first + 1] - begin) / (x[first] - begin) - 0.5) for begin in x[:first]]
    assert min(halved) < 1e-3  # of L-BFGS-B up to the decrease that its line search demands


def test_failed_trials_are_told_by_the_last_one_that_did_not_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    """All but the first fail. It misses the bound, so SLSQP makes failed ones its iterates, and steps on from these."""
    slopes = []
    minimize = optimize.minimize

    def told(total: Any, *arguments: Any, **options: Any) -> Any:
        def and_kept(u: np.ndarray) -> tuple[float, np.ndarray]:
            value, slope = total(u)
            slopes.append(slope)
            return value, slope

        return minimize(and_kept, *arguments, **options)

    def edge(values: Mapping[str, Any]) -> Slopes:
        if values["x"] > -1.9:
            raise CosimError("over the edge")
        return walled(values)

    monkeypatch.setattr(optimize, "minimize", told)
    found = descend(edge, SPACE, {"f": "min"}, trials=60, first={"x": -1.9, "y": 70.0}, at_least={"at": -1.0})
    assert [t.failed for t in found.trials[1:]] == ["over the edge"] * 59
    np.testing.assert_array_equal(slopes[1:], [-slopes[0]] * (len(slopes) - 1))


def test_a_search_does_not_begin_where_a_number_is_not_finite(raises) -> None:
    with raises(OptimisationError):
        descend(walled, SPACE, {"f": "min"}, trials=5, first={"x": 1.5, "y": 10.0})


@pytest.mark.parametrize(
    ("bounds", "x", "missed"),
    [({"at_most": {"at": 0.5}}, 0.5, "at is 0.6, above 0.5"), ({"at_least": {"left": 6.25}}, 1.5, "2.56, below 6.25")],
    ids=["at_most", "at_least"],
)
def test_bounds_are_met(bounds: dict[str, dict[str, float]], x: float, missed: str) -> None:
    found = descend(bowls, SPACE, {"right": "min"}, trials=30, first={"x": 0.6, "y": 10.0}, **bounds)
    assert found.best.values["x"] == pytest.approx(x, abs=1e-3)
    assert missed in found.trials[0].failed


def test_a_front_lies_between_its_ends() -> None:
    """Of squares of distances from two points, the front is the line between these."""
    found = descend(bowls, SPACE, {"right": "min", "left": "min"}, trials=60, first={"x": 0.3, "y": 60.0})
    x = np.array([t.values["x"] for t in found.front])
    assert x.min() < -0.98
    assert x.max() > 0.98
    assert np.diff(np.sort(x)).max() < 0.5
    assert [t.values["y"] for t in found.front] == pytest.approx([10.0] * len(found.front), rel=0.05)


def test_slopes_lead_through_a_design() -> None:
    def design(values: Mapping[str, Any]) -> dict[str, float]:
        return {"x": values["a"] * values["b"], "y": np.exp(values["b"])}

    at = {"a": 0.3, "b": 2.0}
    found, inner = through(bowls, design)(at), bowls(design(at))
    chain = np.array([[at["b"], at["a"]], [0.0, np.exp(at["b"])]])
    assert found.row == inner.row
    for name, slopes in inner.slopes.items():
        np.testing.assert_allclose(found.slopes[name], slopes @ chain, rtol=1e-8)


def test_trials_are_counted() -> None:
    assert len(descend(bowls, SPACE, {"right": "min", "left": "min"}, trials=5).trials) <= 11  # one for each weight


@pytest.mark.parametrize(
    "options",
    [
        {"space": {"x": (-2, 2)}},
        {"space": {"x": ["a", "b"]}},
        {"objectives": {"depth": "min"}},
        {"first": {"x": 3.0, "y": 10.0}},
        {"trials": 0},
        {"at_most": {"depth": 1.0}},
        {"at_most": {"at": 0.001}, "at_least": {"at": 0.02}},
    ],
    ids=str,
)
def test_searches_that_cannot_be_made(options: dict[str, Any], raises) -> None:
    given = {"space": SPACE, "objectives": {"right": "min"}, "trials": 5, **options}
    with raises(OptimisationError):
        descend(bowls, given.pop("space"), given.pop("objectives"), **given)


# ------------------------------------------------------------------------------------------------------------- a car

RIDE = """
from cosim import StopWhen, System

STOP_TIME = 1.0
RECORD = ["car.body.az", "car.tire.deflection"]


def system(height: float = 0.02):
    made = System()
    made.add("road", "{road}", start={{"bump.start": 0.1, "bump.height": height}})
    made.add("car", "{car}", start={{"force": 0.0}})
    made.connect_matching("road", "car")
    return made
"""
DAMPING, STIFFNESS = "car.suspension.damping", "car.suspension.stiffness"
VARY = ("--vary", f"{DAMPING}=3e3:4e4", "--log", DAMPING, "--vary", f"{STIFFNESS}=1e5:4e5")


@pytest.fixture
def ride(tmp_path: Path, built_fmus: BuiltFmus, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "ride.py"
    file.write_text(RIDE.format(road=built_fmus.path("RoadBenchBump", 3), car=built_fmus.path("QuarterCarHmmwv", 3)))
    return file


def test_slopes_of_metrics_are_those_of_differences(ride: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = SimpleNamespace(process_time=count().__next__)  # each call takes 1 s
    monkeypatch.setattr("cosim.study.slopes.time", ticks)
    sweep = prepare(load(str(ride)), FmuSet(), Design((axis(f"{DAMPING}=3e3:4e4"), axis(f"{STIFFNESS}=1e5:4e5"))))
    at = {DAMPING: 9e3, STIFFNESS: 2.2e5}
    with PointSlopes(sweep, FmuSet()) as evaluate:
        found = evaluate(at)
        for k, name in enumerate(at):
            h = 1e-4 * at[name]
            up, down = (evaluate({**at, name: at[name] + s * h}).row for s in (1.0, -1.0))
            for metric in ("car.body.az rms", "car.tire.deflection max", "car.body.az last"):
                assert found.slopes[metric][k] == pytest.approx((up[metric] - down[metric]) / (2.0 * h), rel=1e-4)
        assert (evaluate.points, evaluate.run_time, evaluate.run_equivalents) == (5, 1.0, 5.0)


def test_deviations_by_tolerance_are_those_of_a_sweep(ride: Path) -> None:
    axes = tuple(
        axis(t) for t in (f"{DAMPING}=normal(12e3,120)", f"{STIFFNESS}=2.38e5:2.42e5", "car.body.mass=normal(2800,40)")
    )
    sweep = prepare(load(str(ride)), FmuSet(), Design(axes, samples=256))
    local = local_slopes(sweep, FmuSet())
    table = run_sweep(sweep, FmuSet(), ride.parent / "runs")
    names = ["car.body.az rms", "car.tire.deflection rms", "car.body.az max"]
    found = np.cov([table.metrics[n] for n in names])
    np.testing.assert_allclose(np.diag(local.covariance(names)), np.diag(found), rtol=0.06)
    np.testing.assert_allclose(local.covariance(names), found, rtol=0.06, atol=0.06 * np.abs(found).max())
    section = next(s for s in sweep_report(table, FmuSet(), local=local).sections if s.title == "Sensitivity")
    rows = [r for r in section.tables[0].rows if r[0] == "car.body.az rms"]
    assert [r[1] for r in rows] == [DAMPING, STIFFNESS, "car.body.mass", "all"]
    assert np.sqrt(sum(r[-1] ** 2 for r in rows[:3])) == pytest.approx(rows[3][-1])
    with PointSlopes(sweep, FmuSet(), names=["car.body.mass"]) as evaluate:
        first, last = (evaluate({**local.at, "car.body.mass": m}).row["car.body.az rms"] for m in (2772.0, 2828.0))
    assert rows[2][-2] == pytest.approx((last - first) / (0.02 * first), rel=0.02)


def test_a_sweep_of_options_has_no_derivatives(ride: Path, sentence) -> None:  # noqa: ARG001
    done = CliRunner().invoke(app, ["sweep", "ride.py", "--vary", "height=0.01,0.02", "--samples", "2", "--gradient"])
    sentence(str(done.exception))


def run(*arguments: str, good: bool = True) -> str:
    done = CliRunner().invoke(app, ["optimise", "ride.py", "--processes", "1", *arguments])
    failed = done.exception is not None and not isinstance(done.exception, SystemExit)
    text = " ".join((str(done.exception) if failed else done.output).split())
    assert (done.exit_code == 0) == good, text
    return text


def test_the_command_follows_derivatives(ride: Path) -> None:  # noqa: ARG001
    text = run(*VARY, "--minimise", "car.body.az rms", "--gradient", "--trials", "20")
    assert "runs with derivatives took the processor time of" in text
    best = float(text.split("best: car.body.az rms ")[1].split(",")[0])
    without = run(*VARY, "--minimise", "car.body.az rms", "--trials", "20")
    assert best < float(without.split("best: car.body.az rms ")[1].split(",")[0])


def test_the_command_keeps_bounds(ride: Path) -> None:  # noqa: ARG001
    text = run(*VARY, "--minimise", "car.body.az rms", "--gradient", "--at-least", "car.body.az rms=0.5")
    assert float(text.split("best: car.body.az rms ")[1].split(",")[0]) == pytest.approx(0.5, rel=1e-3)


@pytest.mark.parametrize(
    "arguments",
    [
        ("--vary", "height=0.01:0.03", "--gradient"),
        ("--vary", "car.solver.step=1e-4:1e-3", "--gradient"),
        (*VARY, "--at-most", "car.body.az max=3"),
        (*VARY, "--gradient", "--at-most", "car.body.az max", "--at-most", "car.body.az rms"),
        (*VARY, "--gradient", "--at-most", "car.body.ay max=3"),
        (*VARY, "--gradient", "--at-most", "car.body.az max=0.5", "--at-most", "car.body.az max=9"),
        (*VARY, "--gradient", "--at-least", "car.body.az max=0.5", "--at-least", "car.body.az max=9"),
    ],
    ids=" ".join,
)
def test_what_users_do_wrong(arguments: tuple[str, ...], ride: Path, sentence) -> None:  # noqa: ARG001
    sentence(run("--minimise", "car.body.az rms", *arguments, good=False))
