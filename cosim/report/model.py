"""What a report is made of.

Everything is checked when it is made, so a report that exists can be written. Sequences may be given as lists; they
are kept as tuples, curves as read-only arrays. Texts are plain text, never markup.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from cosim.core.content_checks import (
    Array,
    Scalar,
    assign,
    check_choice,
    check_id,
    check_text,
    check_unique,
    curve,
    items,
    plain_tree,
    plain_value,
    split_label,
)
from cosim.report.animation import Animation
from cosim.report.claims import Claim, Counts
from cosim.report.maps import Map

Color = Literal["blue", "vermilion", "green", "purple", "orange", "sky", "black", "gray"]
Dash = Literal["solid", "dash", "dot", "dashdot", "longdash"]
Mode = Literal["line", "line+markers", "markers", "bar"]
Scale = Literal["linear", "log"]
Look = tuple[Color, Dash] | Color
"""Color and dash of a series, or its color alone."""


@dataclass(frozen=True, eq=False)
class Series:
    """One curve, with an optional band from `low` to `high` (say, over seeds).

    A value that is not finite leaves a gap. Within a report a name has one look; `color` and `dash` need to be given
    once at most, and may not be given differently.
    """

    name: str
    x: npt.ArrayLike
    y: npt.ArrayLike
    low: npt.ArrayLike | None = None
    high: npt.ArrayLike | None = None
    color: Color | None = None
    dash: Dash | None = None
    mode: Mode = "line"

    def __post_init__(self) -> None:
        where = f"series '{self.name}'"
        check_text(where, name=self.name)
        if self.color is not None:
            check_choice(where, "color", self.color, Color)
        if self.dash is not None:
            check_choice(where, "dash", self.dash, Dash)
        check_choice(where, "mode", self.mode, Mode)
        if (self.low is None) != (self.high is None):
            raise ValueError(f"{where}: a band needs both 'low' and 'high'")
        for name in ("x", "y", "low", "high"):
            values = getattr(self, name)
            if values is not None:
                assign(self, name, curve(where, name, values))
        for name, values in self.columns():
            if len(values) != len(self.x_values):
                raise ValueError(f"{where}: {name} has {len(values)} points, x has {len(self.x_values)}")

    @property
    def x_values(self) -> Array:
        """Values of x as an array (n,)."""
        return np.asarray(self.x, dtype=np.float64)

    def columns(self) -> Iterator[tuple[str, Array]]:
        """("y", values), and ("low", ...), ("high", ...) where there is a band."""
        for name in ("y", "low", "high"):
            values = getattr(self, name)
            if values is not None:
                yield name, np.asarray(values, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Panel:
    """One pair of axes. Labels carry their unit: `"pitch [deg]"`, `"ratio [-]"`; `"peak [?]"` is drawn without one.

    `x_names`: names of the positions 0, 1, 2, ... on the x axis, for series of mode "bar".
    """

    title: str
    x_label: str
    y_label: str
    series: Sequence[Series]
    x_scale: Scale = "linear"
    y_scale: Scale = "linear"
    x_names: Sequence[str] = ()

    def __post_init__(self) -> None:
        where = f"panel '{self.title or self.y_label}'"
        for label in (self.x_label, self.y_label):
            split_label(label, where)
        for name in ("x_scale", "y_scale"):
            check_choice(where, name, getattr(self, name), Scale)
        assign(self, "series", items(where, "series", self.series, Series))
        if not self.series:
            raise ValueError(f"{where} has no series")
        check_unique(where, "series", (s.name for s in self.series))
        assign(self, "x_names", items(where, "x_names", self.x_names, str))
        check_unique(where, "x name", self.x_names)
        for s in self.series:
            if s.mode == "bar" and not set(s.x_values) <= set(range(len(self.x_names))):
                raise ValueError(f"{where}: series '{s.name}' has bars at positions without a name in 'x_names'")


@dataclass(frozen=True, eq=False)
class Figure:
    """Panels side by side in `columns` (one under the other on a narrow screen). `id` names its CSV file."""

    id: str
    title: str
    caption: str
    panels: Sequence[Panel]
    columns: int = 1

    def __post_init__(self) -> None:
        where = f"figure '{self.id}'"
        check_id(where, self.id)
        check_text(where, title=self.title)
        assign(self, "panels", items(where, "panels", self.panels, Panel))
        if not self.panels:
            raise ValueError(f"{where} has no panels")
        if not 1 <= self.columns <= 4:
            raise ValueError(f"{where}: {self.columns} columns; use 1 to 4")


@dataclass(frozen=True)
class Table:
    """Column names carry units where there are any: `"speed [km/h]"`. `id` names its CSV file."""

    id: str
    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Scalar]]
    caption: str = ""

    def __post_init__(self) -> None:
        where = f"table '{self.id}'"
        check_id(where, self.id)
        check_text(where, title=self.title)
        assign(self, "columns", items(where, "columns", self.columns, str))
        if not self.columns:
            raise ValueError(f"{where} has no columns")
        check_unique(where, "column", self.columns)
        rows = []
        for number, row in enumerate(self.rows, start=1):
            cells = tuple(plain_value(f"{where}, row {number}", cell) for cell in row)
            if isinstance(row, str) or len(cells) != len(self.columns):
                raise ValueError(f"{where}: row {number} has {len(cells)} cells for {len(self.columns)} columns")
            rows.append(cells)
        assign(self, "rows", tuple(rows))

    @classmethod
    def of(cls, id: str, title: str, rows: Iterable[Mapping[str, Any]], caption: str = "") -> Table:
        """A table of rows that name their columns: cells by heading, the same headings in each row."""
        cells = list(rows)
        columns = [*cells[0]] if cells else []
        if any([*row] != columns for row in cells):
            raise ValueError(f"table '{id}': a row has other columns than {columns}")
        return cls(id, title, columns, [[*row.values()] for row in cells], caption)


@dataclass(frozen=True, eq=False)
class Section:
    """A heading, its text, then its animations, figures and tables."""

    title: str
    paragraphs: Sequence[str] = ()
    figures: Sequence[Figure | Map] = ()
    tables: Sequence[Table] = ()
    animations: Sequence[Animation] = ()

    def __post_init__(self) -> None:
        where = f"section '{self.title}'"
        check_text(where, title=self.title)
        assign(self, "paragraphs", items(where, "paragraphs", self.paragraphs, str))
        assign(self, "figures", items(where, "figures", self.figures, (Figure, Map)))
        assign(self, "tables", items(where, "tables", self.tables, Table))
        assign(self, "animations", items(where, "animations", self.animations, Animation))


@dataclass(frozen=True)
class Parameter:
    """A value that went in, with its unit ("" or "-" if it has none) and where it comes from."""

    name: str
    value: Scalar
    unit: str
    source: str

    def __post_init__(self) -> None:
        where = f"parameter '{self.name}'"
        check_text(where, name=self.name, source=self.source)
        assign(self, "value", plain_value(where, self.value))


@dataclass(frozen=True)
class Result:
    """A single number worth showing at the top of the report."""

    name: str
    value: Scalar
    unit: str = ""

    def __post_init__(self) -> None:
        where = f"result '{self.name}'"
        check_text(where, name=self.name)
        assign(self, "value", plain_value(where, self.value))


@dataclass(frozen=True, eq=False)
class Report:
    """A report begins with its message: the sentence `lead`, and the `figure` and `animation` that show it.

    `looks`: of series by name, for those that bring none. `provenance` maps headings to values, lists, or mappings:
    `{"versions": {"casadi": "3.6.7"}, "seeds": [0, 1]}`. Keep time and machine out of it: the same results must give
    the same files.
    """

    experiment: str
    title: str
    lead: str
    claims: Sequence[Claim] = ()
    sections: Sequence[Section] = ()
    parameters: Sequence[Parameter] = ()
    provenance: Mapping[str, object] = field(default_factory=dict)
    results: Sequence[Result] = ()
    figure: Figure | Map | None = None
    animation: Animation | None = None
    looks: Mapping[str, Look] = field(default_factory=dict)

    def __post_init__(self) -> None:
        where = f"report '{self.experiment}'"
        check_text(where, experiment=self.experiment, title=self.title)
        assign(self, "claims", items(where, "claims", self.claims, Claim))
        drawn = [
            replace(s, figures=[_with_looks(f, self.looks) for f in s.figures])
            for s in items(where, "sections", self.sections, Section)
        ]
        assign(self, "figure", _with_looks(self.figure, self.looks))
        assign(self, "sections", tuple(drawn))
        assign(self, "parameters", items(where, "parameters", self.parameters, Parameter))
        assign(self, "results", items(where, "results", self.results, Result))
        assign(self, "provenance", plain_tree(f"{where}, provenance", self.provenance))
        check_unique(where, "claim", (c.id for c in self.claims))
        check_unique(where, "figure", (f.id for f in self.figures))
        check_unique(where, "table", (t.id for t in self.tables))
        check_unique(where, "animation", (a.id for a in self.animations))
        check_unique(where, "parameter", (p.name for p in self.parameters))
        check_unique(where, "result", (r.name for r in self.results))
        for look in ("color", "dash"):
            _check_one_look(self.drawn, look)

    @property
    def figures(self) -> list[Figure | Map]:
        """All figures of the report and its sections, in order."""
        first = [] if self.figure is None else [self.figure]
        return [*first, *(figure for section in self.sections for figure in section.figures)]

    @property
    def drawn(self) -> list[Figure]:
        """Figures made of curves."""
        return [figure for figure in self.figures if isinstance(figure, Figure)]

    @property
    def tables(self) -> list[Table]:
        """All tables of the sections, in order."""
        return [table for section in self.sections for table in section.tables]

    @property
    def animations(self) -> list[Animation]:
        """All animations of the report and its sections, in order."""
        first = [] if self.animation is None else [self.animation]
        return [*first, *(animation for section in self.sections for animation in section.animations)]

    @property
    def published(self) -> list[Claim]:
        """Claims of the paper with their verdicts."""
        return [claim for claim in self.claims if not claim.own]

    @property
    def own(self) -> list[Claim]:
        """Additional checks, counted separately."""
        return [claim for claim in self.claims if claim.own]

    @property
    def counts(self) -> Counts:
        """How often each verdict occurs."""
        return Counts.of(self.claims)


def _with_looks(figure: Any, looks: Mapping[str, Look]) -> Any:
    """A figure whose series have the looks of their names, where they bring none."""
    if not looks or not isinstance(figure, Figure):
        return figure
    panels = [replace(p, series=[_with_look(s, looks.get(s.name)) for s in p.series]) for p in figure.panels]
    return replace(figure, panels=panels)


def _with_look(series: Series, look: Look | None) -> Series:
    color, dash = (look, None) if look is None or isinstance(look, str) else look
    return replace(series, color=series.color or color, dash=series.dash or dash)


def _check_one_look(figures: Iterable[Figure], look: str) -> None:
    seen: dict[str, tuple[str, str]] = {}
    for figure in figures:
        for panel in figure.panels:
            for series in panel.series:
                hint = getattr(series, look)
                if hint is None:
                    continue
                first, first_figure = seen.setdefault(series.name, (hint, figure.id))
                if hint != first:
                    raise ValueError(
                        f"series '{series.name}' has {look} '{first}' in figure '{first_figure}' and '{hint}' in "
                        f"figure '{figure.id}'; a name has one look in a report"
                    )
