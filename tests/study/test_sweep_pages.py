"""What the page of a sweep shows, of tables whose answers are known."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats
from sweep_tables import FMUS, made, table_of

from cosim import Execution
from cosim.recording.recording import Recording
from cosim.report import Figure, Report, Section, write_report
from cosim.study import load
from cosim.study.design import DesignError
from cosim.study.experiment import Metric
from cosim.study.runner import Runner
from cosim.study.slopes import LocalSlopes, Slopes
from cosim.study.sweep import run_sweep
from cosim.study.sweep_report import Worst, sweep_report
from cosim.study.sweep_statistics import (
    binomial_quantile,
    morris_effects,
    quantile_interval,
    rank_correlations,
    ranks,
    sobol_indices,
)

NAN = math.nan


@pytest.fixture(scope="module")
def experiment() -> Any:
    return load(str(Path(__file__).parent / "falling.py"))


# ----------------------------------------------------------------------------------------------------------- statistics


def test_quantiles_and_their_bounds() -> None:
    """Of 1 to 100: the median's bounds are the 40th and the 61st, those of tables of order statistics."""
    values = np.arange(1.0, 101.0)[::-1]
    assert quantile_interval(values, 0.5) == (50.5, 40.0, 61.0)
    assert quantile_interval(values[:5], 0.95)[2] == math.inf
    random = np.random.default_rng(1)
    inside = [
        low <= 0.0 <= high for _ in range(2000) for _, low, high in [quantile_interval(random.normal(size=50), 0.5)]
    ]
    assert 0.94 < np.mean(inside) < 0.99


@pytest.mark.parametrize("q", [0.05, 0.25, 0.5, 0.75, 0.95])
def test_quantiles_of_binomial_laws_are_those_of_scipy(q: float) -> None:
    for n in (*range(1, 120), 1000, 10**5):
        for p in (0.025, 0.975):
            assert binomial_quantile(p, n, q) == stats.binom.ppf(p, n, q)


def test_ranks_are_those_of_scipy() -> None:
    values = np.random.default_rng(2).integers(0, 9, 50).astype(float)
    assert ranks(values).tolist() == stats.rankdata(values).tolist()
    assert ranks(np.array([3.0, 1.0, 3.0])).tolist() == [2.5, 1.0, 2.5]


def test_sobol_indices_of_a_product(experiment: Any) -> None:
    """The function is y = a b with a, b uniform in 0 to 1.

    First-order indices 3/7 each, total ones 4/7 (7/144 of variance, 3/144 for each alone).
    """
    table = table_of(
        experiment, lambda a, b: a * b, "mass.rate=0:1", "mass.height=0:1", method="saltelli", samples=1024
    )
    for (name, first, _, total, _), expected in zip(
        sobol_indices(table, "y"), ("mass.rate", "mass.height"), strict=True
    ):
        assert name == expected
        assert first == pytest.approx(3 / 7, abs=0.02)
        assert total == pytest.approx(4 / 7, abs=0.02)


def test_effects_of_morris(experiment: Any) -> None:
    """Of a sum with weights: the weights times the ranges, without deviation."""
    table = table_of(
        experiment, lambda a, b: 2 * a + 3 * b, "mass.rate=0:10", "mass.height=0:1", method="morris", samples=10
    )
    assert [(n, pytest.approx(m), pytest.approx(s, abs=1e-9)) for n, m, s in morris_effects(table, "y")] == [
        ("mass.rate", 20.0, 0.0),
        ("mass.height", 3.0, 0.0),
    ]


def test_rank_correlations(experiment: Any) -> None:
    table = table_of(experiment, lambda a, b: np.exp(-a) + 0 * b, "mass.rate=0:1", "mass.height=0:1", samples=200)
    (_, one), (_, other) = rank_correlations(table, "y")
    assert one == pytest.approx(-1)
    assert abs(other) < 0.2
    failed = replace(table, metrics={"y": np.where(np.arange(200) < 150, NAN, table.metrics["y"])})
    assert dict(rank_correlations(failed, "y"))["mass.rate"] == pytest.approx(-1)
    assert all(math.isnan(r) for _, r in rank_correlations(replace(table, metrics={"y": np.ones(200)}), "y"))
    ordered = replace(
        table, axes={"mass.rate": [3, 1, 2], "mass.height": [0, 0, 0]}, metrics={"y": np.array([1.0, 2.0, 4.0])}
    )
    (_, one), (_, other) = rank_correlations(ordered, "y")
    assert one == pytest.approx(-0.5)  # ranks 3 1 2 beside 1 2 3: 1 - 6 (4 + 1 + 1) / (3 8)
    assert math.isnan(other)


def test_the_page_of_a_sweep(experiment: Any, tmp_path: Path, raises) -> None:
    """Its worst runs are those with the largest values, and their time histories are of these runs."""
    sweep = made(experiment, "mass.rate=1:3", "mass.height=0:1", samples=30)
    table = run_sweep(sweep, FMUS, tmp_path / "runs", processes=1)
    worst = Worst("fallen").ranked(table)
    assert worst == sorted(range(30), key=lambda i: -table.axes["mass.rate"][i])
    page = sweep_report(table, FMUS, worst=Worst("fallen"))
    (figure,) = [f for f in page.drawn if f.id == "worst-runs"]
    series, *_ = figure.panels[0].series
    assert series.name == f"run {worst[0]}"
    assert series.y[0] - series.y[-1] == pytest.approx(table.metrics["fallen"][worst[0]])  # type: ignore[index]
    assert [f.id for f in page.drawn] == ["distributions", "scatter", "parallel", "worst-runs"]
    assert [t.id for t in page.tables] == ["quantiles", "sensitivity", "worst", "design"]
    assert write_report(page, tmp_path).is_file()
    with raises(DesignError):
        sweep_report(table, FMUS, worst=Worst("fell"))


# --------------------------------------------------------------------------------------------- a page, number by number


@pytest.fixture
def page(experiment: Any) -> Report:
    """Five rates by two counts; y = rate + 10 count, shown times 1000 in mm; the run with the largest has no z."""
    metrics = {"y": Metric("height", "mm", 1e3), "z": Metric("other"), "never": Metric("n")}
    said = replace(experiment, title="Falling mass", measures=replace(experiment.measures, metrics=metrics))
    table = table_of(
        said,
        lambda rate, count: {"z": np.where(rate + count < 7, -rate, NAN), "y": rate + 10 * count},
        "mass.rate=1:5:5",
        "count=1,2",
        method="grid",
    )
    return sweep_report(table, FMUS)


def _section(page: Report, title: str) -> Section:
    (found,) = [s for s in page.sections if s.title == title]
    return found


def _figure(page: Report, name: str) -> Figure:
    (found,) = [f for f in page.drawn if f.id == name]
    return found


def test_head_and_design(page: Report) -> None:
    assert page.title == "Falling mass: sweep"
    assert page.experiment == "falling sweep"
    assert page.lead == "10 runs over mass.rate, count; 0 failed."
    design = _section(page, "Design")
    assert [row[:2] for row in design.tables[0].rows] == [("mass.rate", "-"), ("count", "-")]
    assert design.tables[0].columns == ("parameter", "unit", "values")
    assert [s.title for s in page.sections] == ["Distributions", "Scatter", "Sensitivity", "Worst cases", "Design"]


def test_distributions_are_in_the_units_that_are_shown(page: Report) -> None:
    section = _section(page, "Distributions")
    rows = {(row[0], row[1]): row[2:] for row in section.tables[0].rows}
    heights = [1000 * x for x in (11, 12, 13, 14, 15, 21, 22, 23, 24, 25)]
    assert rows["height [mm]", 0.5] == (18e3, 10)
    assert rows["height [mm]", 0.05] == (pytest.approx(11.45e3), 10)
    assert rows["other", 0.5] == (-3.0, 9)
    assert [q for name, q in rows if name == "other"] == [0.05, 0.25, 0.5, 0.75, 0.95]
    assert len(rows) == 10
    height, other = _figure(page, "distributions").panels
    assert (height.title, height.x_label, height.y_label) == ("height", "height [mm]", "share of the runs below [-]")
    assert height.series[0].x_values.tolist() == heights
    assert np.asarray(height.series[0].y).tolist() == pytest.approx([0.05 + 0.1 * i for i in range(10)])
    assert other.x_label == "other [?]"
    assert len(other.series[0].x_values) == 9


@pytest.mark.parametrize("method", ["lhs", "grid", "list", "morris", "saltelli"])
def test_only_random_samples_have_bounds_of_quantiles(experiment: Any, method: str) -> None:
    """Paths of Morris cover the median with 73 %, where order statistics of a random sample would with 95 %."""
    table = table_of(experiment, lambda rate: 1000 * rate, "mass.rate=1:10:10", method="grid")
    failed = {0: "it fell"}  # without it the page wants the indices of the method
    other = replace(
        table, sweep=replace(table.sweep, design=replace(table.sweep.design, method=method)), failures=failed
    )
    section = _section(sweep_report(other, FMUS), "Distributions")
    rows = {row[1]: row[2:] for row in section.tables[0].rows}
    if method == "lhs":
        assert "usually too wide for a design that fills space evenly" in section.paragraphs[0]
        assert rows[0.5] == (5500.0, 2000.0, 9000.0, 10)  # second and ninth of ten
        assert rows[0.05] == (pytest.approx(1450.0), None, 3000.0, 10)
    else:
        assert "no random sample" in section.paragraphs[0]
        assert section.tables[0].columns == ("metric", "quantile", "value", "runs")
        assert rows[0.5] == (5500.0, 10)


def test_bounds_of_independent_points_are_not_called_too_wide(experiment: Any) -> None:
    table = table_of(experiment, lambda rate: rate, "mass.rate=1:5", method="random", samples=8)
    assert _section(sweep_report(table, FMUS), "Distributions").paragraphs == (
        "Bounds are order statistics that hold for any distribution.",
    )


def test_scatter_has_every_metric_over_every_parameter(page: Report) -> None:
    panels = {(p.x_label, p.y_label): p.series[0] for p in _figure(page, "scatter").panels}
    assert list(panels) == [(x, y) for y in ("height [mm]", "other [?]") for x in ("mass.rate [?]", "count [?]")]
    assert _figure(page, "scatter").columns == 2  # a column for each parameter
    found = panels["count [?]", "height [mm]"]
    assert found.mode == "markers"
    assert sorted(zip(found.x_values.tolist(), np.asarray(found.y).tolist(), strict=True)) == [
        (c, 1000.0 * (r + 10 * c)) for c in (1, 2) for r in range(1, 6)
    ]


def test_parallel_coordinates_are_scaled_and_the_worst_stand_out(page: Report) -> None:
    figure = _figure(page, "parallel")
    assert figure.panels[0].x_names == ("mass.rate", "count", "height", "other")
    others, worst = figure.panels[0].series
    assert (others.name, worst.name) == ("other runs", "worst tenth")
    np.testing.assert_array_equal(worst.x_values, [0, 1, 2, 3, NAN])
    np.testing.assert_array_equal(worst.y, [1, 1, 1, NAN, NAN])  # rate 5, count 2, the highest; no other
    lines = np.asarray(others.y).reshape(-1, 5)
    assert len(lines) == 9
    np.testing.assert_allclose(lines[-1], [0, 0, 0, 1, NAN])  # the lowest of height, the highest of -rate
    np.testing.assert_allclose(lines[0], [0.75, 1, 13 / 14, 0.25, NAN])


def test_sensitivity_by_ranks(page: Report) -> None:
    section = _section(page, "Sensitivity")
    assert section.tables[0].title == "Sensitivity"
    assert section.tables[0].columns == ("metric", "parameter", "rank correlation")
    rows = {(row[0], row[1]): row[2] for row in section.tables[0].rows}
    assert rows["other", "mass.rate"] == pytest.approx(-1)
    assert rows["height", "count"] == pytest.approx(math.sqrt(62.5 / 82.5))  # ranks 3 and 8 beside 1 to 10
    assert rows["height", "mass.rate"] == pytest.approx(40 / math.sqrt(80 * 82.5))
    assert section.paragraphs[0].startswith("Spearman's rank correlation.")


def test_worst_cases_are_rows_with_what_was_measured(page: Report) -> None:
    (table,) = _section(page, "Worst cases").tables
    assert table.title == "Runs whose height is furthest from 0"
    assert list(table.columns) == ["run", "mass.rate", "count", "height [mm]", "other"]
    assert [row[1:] for row in table.rows] == [(5, 2, 25e3, None), (4, 2, 24e3, -4.0), (3, 2, 23e3, -3.0)]
    assert [p.title for p in _figure(page, "worst-runs").panels] == ["mass.z"]
    assert _section(page, "Worst cases").paragraphs == (
        f"To repeat a run and save its time histories, add --run {table.rows[0][0]} to the sweep command.",
    )


def test_worst_runs_are_made_as_the_others_were(experiment: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Isolated, where FMUs are not to run in this process."""
    given = []

    class Noting(Runner):
        def __init__(self, *arguments: Any, execution: Any = None, **options: Any) -> None:
            given.append(execution)
            super().__init__(*arguments, **options)

    monkeypatch.setattr("cosim.study.sweep_report.Runner", Noting)
    table = table_of(experiment, lambda rate: rate, "mass.rate=1:2:2", method="grid")
    sweep_report(table, FMUS, execution=Execution(isolate=("*",)))
    assert given == [Execution(isolate=("*",))]


def test_failed_runs_are_listed_with_their_points(experiment: Any) -> None:
    table = table_of(experiment, lambda rate: np.where(rate > 4, NAN, rate), "mass.rate=1:5:5", method="grid")
    page = sweep_report(replace(table, failures={4: "too fast"}), FMUS)
    (found,) = _section(page, "Failed runs").tables
    assert found.rows == ((4, 5.0, "too fast"),)
    assert list(found.columns) == ["run", "mass.rate", "message"]
    assert _section(page, "Failed runs").paragraphs == ("1 of 5 runs failed; --retry-failed runs them again.",)
    many = sweep_report(
        replace(table, failures=dict.fromkeys(range(101), "no"), sweep=made(experiment, "mass.rate=1:5", samples=200)),
        FMUS,
    )
    (found,) = _section(many, "Failed runs").tables
    assert len(found.rows) == 100
    assert _section(many, "Failed runs").paragraphs[0].endswith("again. The first hundred:")


@pytest.mark.parametrize(
    ("method", "samples", "columns", "expected"),
    [
        (
            "saltelli",
            256,
            ["metric", "parameter", "first-order index", "±", "total index", "± of the total index"],
            (1.0, 1.0),
        ),
        (
            "morris",
            8,
            ["metric", "parameter", "mean magnitude of the effect", "standard deviation of the effect"],
            (8000.0, 0.0),
        ),
    ],
)
def test_indices_on_the_page(
    experiment: Any, method: str, samples: int, columns: list[str], expected: tuple[float, float]
) -> None:
    """Output y = 2 rate, shown in mm: all variance is the rate's, its effect over 1 to 5 is 8 m."""
    said = replace(experiment, measures=replace(experiment.measures, metrics={"y": Metric("height", "mm", 1e3)}))
    table = table_of(said, lambda rate, _: 2 * rate, "mass.rate=1:5", "mass.height=0:1", method=method, samples=samples)
    section = _section(sweep_report(table, FMUS), "Sensitivity")
    (found,) = section.tables
    assert list(found.columns) == columns
    (name, parameter, first, *more), other = found.rows
    assert (name, parameter) == ("height", "mass.rate")
    assert first == pytest.approx(expected[0], rel=0.05)
    assert more[1 if method == "saltelli" else 0] == pytest.approx(expected[1], rel=0.05, abs=1e-6)
    assert other[2] == pytest.approx(0.0, abs=0.02)
    broken = replace(table, failures={0: "no"})
    section = _section(sweep_report(broken, FMUS), "Sensitivity")
    assert (
        section.paragraphs[0]
        == "Indices need every run of the design, and some have failed: rank correlations instead."
    )
    assert section.tables[0].columns[-1] == "rank correlation"
    holes = replace(table, metrics={"y": np.where(np.arange(len(table.sweep)) == 3, NAN, table.metrics["y"])})
    assert _section(sweep_report(holes, FMUS), "Sensitivity").tables[0].columns[-1] == "rank correlation"


def test_six_metrics_are_drawn_and_all_are_in_the_table(experiment: Any) -> None:
    table = table_of(experiment, lambda rate: {f"m{k}": k * rate for k in range(8)}, "mass.rate=1:5:5", method="grid")
    page = sweep_report(table, FMUS)
    assert [p.title for p in _figure(page, "distributions").panels] == [f"m{k}" for k in range(6)]
    assert {row[0] for row in _section(page, "Distributions").tables[0].rows} == {f"m{k}" for k in range(8)}
    assert "Figures show the first 6 of 8 metrics" in _section(page, "Distributions").paragraphs[1]
    worst = _section(page, "Worst cases")
    assert worst.tables[0].columns[2:] == tuple(f"m{k}" for k in range(6))
    assert worst.paragraphs[0].endswith("The table has 6 of 8 metrics; table.parquet has all.")
    last = _section(sweep_report(table, FMUS, worst=Worst("m7")), "Worst cases").tables[0]
    assert last.columns[2:] == (*(f"m{k}" for k in range(6)), "m7")


def test_a_name_with_a_unit_is_a_metric_with_a_unit(experiment: Any) -> None:
    table = table_of(experiment, lambda rate: {"peak force [N]": rate}, "mass.rate=1:5:5", method="grid")
    (panel,) = _figure(sweep_report(table, FMUS), "distributions").panels
    assert (panel.title, panel.x_label) == ("peak force", "peak force [N]")


def test_large_sweeps_are_thinned_out(experiment: Any) -> None:
    table = table_of(experiment, lambda rate: rate, "mass.rate=1:5", samples=6000)
    page = sweep_report(table, FMUS)
    points = _figure(page, "scatter").panels[0].series[0]
    assert len(points.x_values) <= 2002
    assert (np.min(points.y), np.max(points.y)) == (table.metrics["y"].min(), table.metrics["y"].max())
    lines = {s.name: len(s.x_values) // 3 for s in _figure(page, "parallel").panels[0].series}
    assert lines == {"other runs": 90, "worst tenth": 10}


def test_texts_are_numbered_by_their_place_in_the_list(experiment: Any) -> None:
    """As an axis of a figure has no other place for them."""
    table = table_of(experiment, lambda rate: rate, "mass.rate=1:4:4", method="grid")
    texts = replace(table.sweep.design.axes[0], kind="values", values=("soft", "hard"))
    sweep = replace(table.sweep, design=replace(table.sweep.design, axes=(texts,)))
    found = dict(
        rank_correlations(replace(table, sweep=sweep, axes={"mass.rate": ["hard", "soft", "hard", "soft"]}), "y")
    )
    assert found["mass.rate"] == pytest.approx(-1 / math.sqrt(5))


@pytest.mark.parametrize("worst", [None, Worst("peak")])
def test_a_metric_without_a_finite_value_is_named_and_the_others_are_shown(
    experiment: Any, worst: Worst | None, tmp_path: Path
) -> None:
    """Also where derivatives are finite of none, at the medians."""
    table = table_of(experiment, lambda x: {"peak": NAN * x, "good": x}, "mass.rate=1:2", method="lhs", samples=4)
    at = Slopes({"peak": NAN, "good": NAN}, {"peak": np.array([NAN]), "good": np.array([NAN])})
    for local in (None, LocalSlopes({"mass.rate": 1.5}, {"mass.rate": 0.1}, at)):
        page = sweep_report(table, FMUS, worst=worst, local=local)
        assert page.lead.endswith("0 failed. No run has a finite value of peak.")
        tables = [t for name in ("Distributions", "Sensitivity") for t in _section(page, name).tables]
        assert {row[0] for t in tables if t.id != "correlations" for row in t.rows} == {"good"}
        assert write_report(page, tmp_path).is_file()


def test_worst_runs_leave_out_those_without_the_metric(experiment: Any) -> None:
    table = table_of(experiment, lambda rate: np.where(rate < 3, rate, NAN), "mass.rate=1:5:5", method="grid")
    assert Worst("y").ranked(table) == [1, 0]


@pytest.mark.parametrize(
    ("text", "first", "title"),
    [
        ("y", 3, "largest"),
        ("y:min", 0, "smallest"),
        ("", 0, "furthest from 0"),
        ("z:min", 3, "smallest"),
        ("z:max", 1, "largest"),
    ],
)
def test_which_runs_are_the_worst(experiment: Any, text: str, first: int, title: str) -> None:
    """In the table of the page and among its parallel coordinates."""
    table = table_of(
        experiment,
        lambda rate: {"y": rate - 4.0, "z:max": 1.0 + (rate == 2), "z": -rate},
        "mass.rate=1:6:6",
        method="grid",
    )
    values = {
        **table.metrics,
        "y": np.array([-5.0, 1.0, 2.0, 4.0, 3.0, 0.0]),
        "z": np.array([1.0, 2.0, 3.0, -9.0, 4.0, 5.0]),
    }
    page = sweep_report(replace(table, metrics=values), FMUS, worst=Worst.of(text) if text else None)
    (worst,) = _section(page, "Worst cases").tables
    assert worst.rows[0][0] == first
    assert worst.title == f"Runs whose {text.removesuffix(':min') or 'y'} is {title}"
    line = _figure(page, "parallel").panels[0].series[1]
    assert line.name == "worst tenth"
    assert line.y[0] == pytest.approx(first / 5)  # type: ignore[index]


# ---------------------------------------------------------------------------------------------- histories that are kept


def test_histories_that_were_kept_are_not_made_again(
    experiment: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the page shows of the worst runs is what their files hold.

    One whose file is gone is made again, and named.
    """
    sweep = made(experiment, "mass.rate=1,2,3,4", method="grid")
    table = run_sweep(sweep, FMUS, tmp_path / "runs", processes=1, histories=True)
    again: list[Any] = []
    record = Runner.record
    monkeypatch.setattr(Runner, "record", lambda self, case: again.append(case) or record(self, case))
    without = _figure(sweep_report(table, FMUS), "worst-runs")
    assert (len(again), without.caption) == (3, "Repeated for this page.")
    again.clear()
    kept = _figure(sweep_report(table, FMUS, folder=tmp_path), "worst-runs")
    assert (len(again), kept.caption) == (0, "As stored with the table.")
    for a, b in zip(kept.panels[0].series, without.panels[0].series, strict=True):
        assert a.name == b.name
        assert (a.x_values.tolist(), np.asarray(a.y).tolist()) == (b.x_values.tolist(), np.asarray(b.y).tolist())
    Recording(np.array([0.0, 1.0]), ["mass.z"], np.array([[7.0], [8.0]]), {"mass.z": "m"}).write(
        tmp_path / table.histories[3]
    )
    series, *_ = _figure(sweep_report(table, FMUS, folder=tmp_path), "worst-runs").panels[0].series
    assert (series.name, np.asarray(series.y).tolist()) == ("run 3", [7.0, 8.0])
    long = np.arange(6000.0)
    Recording(long, ["mass.z"], long[:, None], {"mass.z": "m"}).write(tmp_path / table.histories[3])
    series, *_ = _figure(sweep_report(table, FMUS, folder=tmp_path), "worst-runs").panels[0].series
    assert len(series.x_values) <= 2000
    assert (series.x_values[0], series.x_values[-1]) == (0.0, 5999.0)
    impact = np.where(long == 4321, 9.0, np.where(long == 1234, -9.0, 0.0))  # of one sample each
    Recording(long, ["mass.z"], impact[:, None], {"mass.z": "m"}).write(tmp_path / table.histories[3])
    series, *_ = _figure(sweep_report(table, FMUS, folder=tmp_path), "worst-runs").panels[0].series
    assert (np.min(series.y), np.max(series.y)) == (-9.0, 9.0)
    gone = replace(table, histories=[*table.histories[:2], "", table.histories[3]])
    figure = _figure(sweep_report(gone, FMUS, folder=tmp_path), "worst-runs")
    assert figure.caption == "As stored with the table; repeated for this page: 2."
    assert [case.parameter_0 for case in again] == [3]
    assert [p.y_label for p in figure.panels] == ["mass.z [m]"]
