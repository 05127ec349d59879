"""What a single run shows on the screen."""

from __future__ import annotations

from rich.console import Console

from cosim.study import Metric
from cosim.study.commands import metric_table

METRICS = {
    "rms": Metric("rms heave", "mm", 1e3),
    "force": Metric("force", "N"),
    "roll": Metric("roll", "deg"),
    "end": Metric("end"),
}
MEASURED = {
    "passive": {"rms": 0.02, "force": 0.0, "roll": 1e-25, "end": "stuck"},
    "lqr": {"rms": 0.015, "force": 7.0, "end": "across"},
}


def shown(**options) -> list[list[str]]:
    """Cells of the table as they are printed, row by row."""
    console = Console(width=200)
    with console.capture() as capture:
        console.print(metric_table(MEASURED, METRICS, **options))
    return [[c for c in line.split("  ") if c] for line in capture.get().splitlines()]


def cells(rows: list[list[str]]) -> list[list[str]]:
    return [[c.strip() for c in row if c.strip()] for row in rows]


def test_metrics_stand_beside_the_baseline_in_their_units() -> None:
    assert cells(shown()) == [
        ["metric", "passive", "lqr"],
        ["rms heave [mm]", "20", "15"],
        ["force [N]", "0", "7"],
        ["roll [deg]", "1e-25", "-"],
        ["end", "stuck", "across"],
    ]


def test_shares_of_the_baseline() -> None:
    """Nothing is a share of nothing, of rounding, of a metric that the run does not have, or of a text."""
    rows = cells(shown(relative=True))
    assert [row[-1] for row in rows] == ["lqr, per cent of passive", "75.0", "-", "-", "-"]


def test_a_baseline_alone_has_no_shares() -> None:
    table = metric_table({"passive": MEASURED["passive"]}, METRICS, relative=True)
    assert [c.header for c in table.columns] == ["metric", "passive"]


def test_a_text_is_shown_as_it_is() -> None:
    assert Metric("outcome", factor=1e3).shown("failed: pitch") == "failed: pitch"
