"""Results in memory, on disk and in other libraries: time and one column per variable."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from build_fmus.base import safe_files
from build_fmus.base.checks import did_you_mean, glob
from build_fmus.base.units import KNOWN, DisplayUnit, UnitMismatchError, conversion
from cosim.core.real_time import RealTime
from cosim.core.signals import Array
from cosim.recording import formats, frames

if TYPE_CHECKING:
    import pandas as pd
    import plotly.graph_objects as go
    import xarray as xr


@dataclass(frozen=True)
class LoopEffort:
    """What the solution of an algebraic loop has cost.

    Attributes:
        unknowns: the outputs for which it was solved.
        solutions: how often.
        evaluations: of its components, in all solutions.
        most_evaluations: for one solution.
        derivatives: directional derivatives that components computed.
    """

    unknowns: tuple[str, ...]
    solutions: int
    evaluations: int
    most_evaluations: int
    derivatives: int = 0

    def __add__(self, other: LoopEffort) -> LoopEffort:
        most = max(self.most_evaluations, other.most_evaluations)
        return LoopEffort(
            self.unknowns,
            self.solutions + other.solutions,
            self.evaluations + other.evaluations,
            most,
            self.derivatives + other.derivatives,
        )

    def __str__(self) -> str:
        mean = self.evaluations / max(1, self.solutions)
        return (
            f"loop through {', '.join(self.unknowns)}: solved {self.solutions} times with {mean:.3g} evaluations on"
            f" average, at most {self.most_evaluations}"
            + (f", and {self.derivatives} directional derivatives" if self.derivatives else "")
        )


@dataclass(frozen=True)
class StepEffort:
    """Steps of a run with a tolerance: how many were accepted and rejected, and lengths of the accepted ones [s].

    `beyond`: how many of the accepted ones have the smallest possible length, `least` [s], and an error beyond the
    tolerance, as at jumps. `limited_by`: why `least` is longer than the tolerance needs.
    """

    tolerance: float
    accepted: int
    rejected: int
    beyond: int
    smallest: float
    mean: float
    largest: float
    least: float
    limited_by: str = ""

    def __str__(self) -> str:
        text = (
            f"tolerance {self.tolerance:g}: {self.accepted} communication steps of {self.smallest:.3g} to"
            f" {self.largest:.3g} s, {self.mean:.3g} s on average, and {self.rejected} rejected ones; values between"
            " them are interpolated"
        )
        if self.beyond:
            text += (
                f"; {self.beyond} of the smallest possible length, {self.least:.3g} s, exceed the tolerance, as where a"
                " value jumps, which is late by up to this length"
            )
            if self.limited_by:
                text += f": {self.limited_by} allow no shorter one, so what follows may have an error beyond it"
        return text


@dataclass
class Recording:
    """What was recorded: `time` [s] of shape (samples,), `data` of shape (samples, variables).

    `recording["car.body.az"]` is one column; an FMU's aliases of a name give the same column. `stopped_by` says which
    stop condition, or which component that asked for it, ended the run (None: it reached its stop time); `wall_time`
    [s] is what the stepping took; `real_time` is how a paced run kept pace with the clock. `types` names
    what stands for "integer" or "boolean" values, `display` the units in which FMUs want their variables displayed.
    `loops` tells what the solution of each algebraic loop has cost. `steps` describes the communication steps of a run
    with a tolerance, whose rows between communication points are interpolated; None: the steps were fixed.
    """

    time: Array
    names: list[str]
    data: Array
    units: dict[str, str] = field(default_factory=dict)
    stopped_by: str | None = None
    wall_time: float = 0.0
    aliases: dict[str, str] = field(default_factory=dict)
    real_time: RealTime | None = None
    types: dict[str, str] = field(default_factory=dict)
    display: dict[str, DisplayUnit] = field(default_factory=dict)
    loops: tuple[LoopEffort, ...] = ()
    steps: StepEffort | None = None

    def __post_init__(self) -> None:
        self._column = {name: i for i, name in enumerate(self.names)}

    def __getitem__(self, name: str) -> Array:
        if name == "time":
            return self.time
        try:
            return self.data[:, self._column[self.aliases.get(name, name)]]
        except KeyError:
            raise KeyError(f"'{name}' was not recorded{did_you_mean(name, self.names)}") from None

    def __contains__(self, name: str) -> bool:
        return self.aliases.get(name, name) in self._column

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.time)

    @property
    def real_time_factor(self) -> float:
        """Simulated time / wall time."""
        span = float(self.time[-1] - self.time[0]) if len(self.time) else 0.0
        return span / self.wall_time if self.wall_time > 0 else float("inf")

    # As a file.

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write it in the format of the file's ending: .csv, .parquet, .nc, .h5, .hdf5 or .mf4.

        `read` restores bit-identical values, names, units, order and types; a CSV has no types. Makes the folder; an
        older file is replaced when the new one is complete. Raises FormatError (a ValueError) for other endings,
        MissingExtraError without the extra [data], OSError naming the path.
        """
        return formats.write(path, self)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Recording:
        """Read a file that `write` wrote.

        Raises FormatError (a ValueError) naming the file that cannot be read, for CSV also the line.
        """
        return cls._of(formats.read(path))

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write it as CSV with any file ending: `time [s]` and columns with a header `name [unit]`; see `write`."""
        with safe_files.opened(path, "wb") as file:
            formats.write_csv(file, self)
        return Path(path)

    @classmethod
    def _of(cls, content: formats.Content) -> Recording:
        return cls(content.time, content.names, content.data, content.units, types=content.types)

    # In other libraries.

    def to_pandas(self) -> pd.DataFrame:
        """A DataFrame over the time [s]; integers and Booleans have columns of their type.

        `attrs["units"]` has the units by name. Raises MissingExtraError without the extra [data].
        """
        return frames.to_pandas(self)

    def to_xarray(self) -> xr.Dataset:
        """A Dataset over the time [s], with units as attributes; arrays that were recorded whole are one variable each.

        Raises MissingExtraError without the extra [data].
        """
        return frames.to_xarray(self)

    def plot(self, *names: str, title: str = "") -> go.Figure:
        """A plotly figure of these names and patterns (`*`, `?`; none: everything), one diagram for each unit.

        A notebook shows it; elsewhere call `.show()`. Raises KeyError for a name that was not recorded,
        MissingExtraError without the extra [reports].
        """
        return frames.figure(self, self.select(*names), title)

    def select(self, *names: str) -> list[str]:
        """Recorded names that match these names and patterns (`*`, `?`); without any, all names.

        Raises KeyError for one that matches none.
        """
        chosen: dict[str, None] = {}
        for name in names or ("*",):
            own = self.aliases.get(name, name)
            found = [own] if own in self._column else [n for n in self.names if glob(name)(n)]
            if not found and self.names:
                raise KeyError(f"'{name}' was not recorded{did_you_mean(name, self.names)}")
            chosen.update(dict.fromkeys(found))
        return list(chosen)

    def in_units(self, units: Mapping[str, str] | None = None) -> Recording:
        """A copy in other units, by default the display units of the FMUs (rad in deg, m/s in km/h).

        Other units are given by name or pattern, `{"car.body.pitch*": "deg"}`. Numbers and units change together, so
        files and frames have matching units. Raises KeyError for names that were not recorded, units that are not known
        or measure something else.
        """
        changes = self.display
        if units is not None:
            changes = {n: _change(n, self.units.get(n, ""), unit) for p, unit in units.items() for n in self.select(p)}
        data, named = self.data.copy(order="F"), dict(self.units)
        for name, to in changes.items():
            if name in self._column and (to.factor, to.offset) != (1.0, 0.0):
                column = self._column[name]
                data[:, column] = data[:, column] * to.factor + to.offset
            named[name] = to.name
        types = {n: t for n, t in self.types.items() if n not in changes}
        left = {n: d for n, d in self.display.items() if n not in changes}
        return replace(self, data=data, units=named, types=types, display=left)

    def _repr_html_(self) -> str:
        span = f" from {self.time[0]:.9g} to {self.time[-1]:.9g} s" if len(self) else ""
        steps = f"; {self.steps}" if self.steps else ""
        return frames.page(self, f"{len(self)} samples of {len(self.names)} variables{span}{steps}")


def _change(name: str, given: str, to: str) -> DisplayUnit:
    """What turns values of one unit into those of another. Raises KeyError naming the variable."""
    for unit in (given, to):
        if unit not in KNOWN:
            what = f"it has the unit '{unit}'" if unit else "it has no unit"
            raise KeyError(
                f"'{name}' in {to}: "
                + (f"no unit '{to}'{did_you_mean(to, KNOWN)}" if unit == to else f"{what}, which is not known")
            )
    try:
        return DisplayUnit(to, *conversion(KNOWN[given], KNOWN[to]))
    except UnitMismatchError as error:
        raise KeyError(f"'{name}' has the unit {given}, not converted to {to}: {error}") from None
