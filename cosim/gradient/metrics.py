"""Numbers that a run is judged by, and their derivatives by every sample of it.

A metric reads columns of a recording and gives a number and, for each column, how the number moves with each sample;
the chain rule is applied in one place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cosim.core.errors import CosimError
from cosim.core.signals import Array


class Metric(Protocol):
    """A number of a run that can be differentiated."""

    @property
    def names(self) -> Sequence[str]:
        """Full names of the variables that it reads."""

    def of(self, columns: Sequence[Array]) -> tuple[float, Sequence[Array]]:
        """Its value, and its derivatives by the samples of each column (samples,).

        `columns`: samples of `names`, each (samples,).
        """


@dataclass(frozen=True)
class _OfOne:
    name: str

    @property
    def names(self) -> Sequence[str]:
        """The variable."""
        return (self.name,)


@dataclass(frozen=True)
class Mean(_OfOne):
    """Mean of the samples: sum(y) / n."""

    def of(self, columns: Sequence[Array]) -> tuple[float, Sequence[Array]]:
        """See `Metric.of`."""
        y = columns[0]
        return float(np.mean(y)), [np.full(len(y), 1.0 / len(y))]


@dataclass(frozen=True)
class Rms(_OfOne):
    """Root of the mean square of the samples: sqrt(sum(y^2) / n)."""

    def of(self, columns: Sequence[Array]) -> tuple[float, Sequence[Array]]:
        """See `Metric.of`."""
        y = columns[0]
        value = float(np.sqrt(np.mean(y**2)))
        return value, [y / (len(y) * value) if value else np.full(len(y), np.nan)]


@dataclass(frozen=True)
class Peak(_OfOne):
    """Largest magnitude, as a smooth maximum: (sum(abs(y)^power))^(1/power).

    It lies above the largest magnitude, by a factor of n^(1/power) at most for n samples: 1.04 for 1000 and the
    default.
    """

    power: float = 200.0

    def __post_init__(self) -> None:
        if not 2.0 <= self.power <= 1e6:
            raise CosimError(f"power is {self.power}; give a number from 2 to 1e6")

    def of(self, columns: Sequence[Array]) -> tuple[float, Sequence[Array]]:
        """See `Metric.of`."""
        y = columns[0]
        largest = float(np.max(np.abs(y), initial=0.0))
        if not largest:
            return 0.0, [np.full(len(y), np.nan)]
        part = np.abs(y) / largest
        total = float(np.sum(part**self.power))
        return largest * total ** (1.0 / self.power), [
            np.sign(y) * part ** (self.power - 1.0) * total ** (1.0 / self.power - 1.0)
        ]


@dataclass(frozen=True)
class Final(_OfOne):
    """The last sample: what a component has summed up over the run, as RideComfort does absorbed power."""

    def of(self, columns: Sequence[Array]) -> tuple[float, Sequence[Array]]:
        """See `Metric.of`."""
        y = columns[0]
        slopes = np.zeros(len(y))
        slopes[-1] = 1.0
        return float(y[-1]), [slopes]


@dataclass(frozen=True)
class QuadraticCost:
    """The cost of optimal control: mean over the samples of sum(weight * y^2), by variable."""

    weights: Mapping[str, float]

    @property
    def names(self) -> Sequence[str]:
        """The weighted variables."""
        return tuple(self.weights)

    def of(self, columns: Sequence[Array]) -> tuple[float, Sequence[Array]]:
        """See `Metric.of`."""
        pairs = list(zip(self.weights.values(), columns, strict=True))
        value = sum(w * float(np.mean(y**2)) for w, y in pairs)
        return value, [2.0 * w * y / len(y) for w, y in pairs]
