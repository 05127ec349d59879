"""Results in memory and on disk: time and one column per variable."""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from build_fmus import safe_files
from build_fmus.checks import did_you_mean, plain
from cosim.real_time import RealTime
from cosim.signals import Array

_HEADER = re.compile(r"(.*?)(?: \[(.*)\])?", re.DOTALL)


@dataclass
class Recording:
    """What was recorded: `time` [s] of shape (samples,), `data` of shape (samples, variables).

    `recording["car.body.az"]` is one column; an FMU's aliases of a name give the same column. `stopped_by` says which stop condition, or which component that asked for
    it, ended the run (None: it reached its stop time); `wall_time` [s] is what the stepping took; `real_time` is how a run with
    `real_time=...` kept pace with the clock.
    """

    time: Array
    names: list[str]
    data: Array
    units: dict[str, str] = field(default_factory=dict)
    stopped_by: str | None = None
    wall_time: float = 0.0
    aliases: dict[str, str] = field(default_factory=dict)
    real_time: RealTime | None = None

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

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write `time [s]` and every column with a header `name [unit]`; floats are written so that reading them
        back gives the same bits. Makes the folder; an older file is replaced when the new one is whole. Raises OSError
        naming the path."""
        path = Path(path)
        units = [self.units.get(name, "") for name in self.names]
        header = ["time [s]", *(f"{n} [{u}]" if u else n for n, u in zip(self.names, units, strict=True))]
        with safe_files.opened(path, newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(header)
            for t, row in zip(self.time.tolist(), self.data.tolist(), strict=True):
                writer.writerow([t, *row])
        return path

    @classmethod
    def from_csv(cls, path: str | os.PathLike[str]) -> Recording:
        """Read what `to_csv` wrote. Raises ValueError naming the file and line that cannot be read."""
        with Path(path).open(newline="", encoding="utf-8") as file:
            reader = csv.reader(file)
            rows: list[list[float]] = []
            try:
                header = next(reader, [""])
                if not header or _HEADER.fullmatch(header[0])[1] != "time":  # type: ignore[index]
                    raise ValueError("the first column must be 'time [s]'")
                for row in filter(None, reader):
                    if len(row) != len(header):
                        raise ValueError(f"{len(row)} numbers for {len(header)} columns")
                    rows.append([float(x) for x in row])
            except (ValueError, csv.Error) as error:
                raise ValueError(plain(f"{path}, near line {reader.line_num}: {error}")) from None
        table = np.array(rows, dtype=float).reshape(len(rows), len(header))
        pairs = [_HEADER.fullmatch(text).groups() for text in header[1:]]  # type: ignore[union-attr]
        names = [str(name) for name, _ in pairs]
        return cls(table[:, 0], names, table[:, 1:], {str(name): unit or "" for name, unit in pairs})
