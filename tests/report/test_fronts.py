"""Fronts of several objectives: which points are on one, and what a page shows of it."""

from __future__ import annotations

import numpy as np

from cosim.report.fronts import front_section, non_dominated


def test_what_is_on_a_front(raises) -> None:
    points = [[0, 3], [1, 1], [3, 0], [1, 2], [3, 3], [1, 1]]
    assert non_dominated(points).tolist() == [True, True, True, False, False, True]
    assert non_dominated([[2.0], [1.0], [1.0]]).tolist() == [False, True, True]
    for bad in ([1.0, 2.0], [[float("nan"), 1.0]]):
        with raises(ValueError):
            non_dominated(bad)


def test_a_front_on_a_page(raises) -> None:
    tried = [{"a": a, "b": b} for a, b in ([0.0, 3.0], [1.0, 1.0], [1.0, 2.0])]
    found = front_section(
        "Front",
        {"a": "a [m]", "b": "b [N]"},
        {"a": "min", "b": "max"},
        tried,
        [{"x": float(i)} for i in range(3)],
        {"published": {"a": 2.0, "b": 2.5}},
    )
    (table,), (figure,) = found.tables, found.figures
    assert (table.id, figure.id) == ("front", "front")  # names of their files
    assert table.columns == ("a [m]", "b [N]", "x")
    assert table.rows == ((0.0, 3.0, 0.0),)
    assert "1 of 3 trials" in found.paragraphs[0]
    series = {s.name: (np.asarray(s.x).tolist(), np.asarray(s.y).tolist()) for s in figure.panels[0].series}  # type: ignore[union-attr]
    assert series == {"front": ([0.0], [3.0]), "tried": ([1.0, 1.0], [1.0, 2.0]), "published": ([2.0], [2.5])}
    assert (
        len(
            front_section(
                "F", {k: f"{k} [-]" for k in "abc"}, dict.fromkeys("abc", "min"), [dict.fromkeys("abc", 1.0)], [{}]
            )
            .figures[0]
            .panels
        )
        == 3
    )  # type: ignore[union-attr]
    with raises(ValueError):
        front_section("F", {"a": "a [m]"}, {"a": "min"}, tried, [{}] * 3)


def test_panels_and_rows_of_a_front() -> None:
    """Three objectives have three panels, two side by side.

    Rows go from the smallest of the first, with what was tried.
    """
    tried = [{"a": a, "b": b, "c": 0.0} for a, b in ([3.0, 0.0], [0.0, 3.0], [1.0, 1.0], [1.0, 2.0])]
    labels = {"a": "a [m]", "b": "b [N]", "c": "c [-]"}
    found = front_section("Front", labels, dict.fromkeys("abc", "min"), tried, [{"x": 10.0 + i} for i in range(4)])
    (table,), (figure,) = found.tables, found.figures
    assert [(row[0], row[1], row[3]) for row in table.rows] == [(0.0, 3.0, 11.0), (1.0, 1.0, 12.0), (3.0, 0.0, 10.0)]
    assert [(p.x_label, p.y_label) for p in figure.panels] == [
        ("a [m]", "b [N]"),
        ("a [m]", "c [-]"),
        ("b [N]", "c [-]"),
    ]
    assert figure.columns == 2
    assert {s.name: (s.color, s.mode) for s in figure.panels[0].series} == {
        "tried": ("gray", "markers"),
        "front": ("blue", "markers"),
    }
    assert found.paragraphs[0].startswith("3 of 4 trials are Pareto-optimal")
