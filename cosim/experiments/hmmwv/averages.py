"""What the vehicle's runs come to over the places of a bump, or over the stretches off road."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.experiments.hmmwv.published import VARIANTS, finer, places
from cosim.experiments.hmmwv.runs import Case
from cosim.study import Distribution, Results, Row

OF_MEDIANS = (
    "Ratios here are those of the medians; claims take the median of the ratios place by place, or stretch by stretch."
)


@dataclass(frozen=True)
class Averages:
    """A view of the results of a study by cases that stand for several runs.

    `refined`: with half the steps of exchange and solvers, where the study ran a case so too.
    """

    results: Results
    refined: bool = False

    @property
    def finer(self) -> Averages:
        """These results with half the steps."""
        return Averages(self.results, refined=True)

    def runs(self, case: Case) -> list[Row]:
        """Metrics at every place of a case.

        Raises:
            KeyError: it was not run.
            RunFailed: one of them failed.
        """
        fine = {run: finer(run) for run in places(case) if self.refined and finer(run) in self.results}
        return [self.results[fine.get(run, run)] for run in places(case)]

    def mean(self, key: str, case: Case) -> float:
        """Mean of a metric over the places of a case."""
        return float(np.mean([r[key] for r in self.runs(case)]))

    def distribution(self, key: str, case: Case) -> Distribution:
        """A metric over the places of a case."""
        return Distribution((r[key] for r in self.runs(case)), of=VARIANTS[case.road])

    def ratio(self, above: Case, below: Case, key: str = "absorbed_power") -> Distribution:
        """A metric of one case over that of another, place by place. 0 over 0 is NaN.

        A metric without places stands for all places.

        Raises:
            ValueError: the cases were not run over the same places.
        """
        tops, bottoms = ([r[key] for r in self.runs(c)] for c in (above, below))
        count = max(len(tops), len(bottoms))
        if {len(tops), len(bottoms)} - {1, count}:
            raise ValueError(f"{above.label} has {len(tops)} variants, {below.label} {len(bottoms)}")
        pairs = zip(tops * (count // len(tops)), bottoms * (count // len(bottoms)), strict=True)
        return Distribution((a / b if b else math.inf if a else math.nan for a, b in pairs), of=VARIANTS[above.road])

    def gain(self, case: Case, others: Iterable[Case], key: str = "absorbed_power") -> Distribution:
        """Reduction [%] of a metric from the lowest of other cases, place by place. 0 over 0 is NaN."""
        each = [self.ratio(case, other, key).values for other in others]
        return Distribution((100 * (1 - max(r)) for r in zip(*each, strict=True)), of=VARIANTS[case.road])

    def power(self, case: Case) -> float:
        """Absorbed power [W], the published figure: median over the places of a case."""
        return self.distribution("absorbed_power", case).median

    def largest(self, key: str, case: Case) -> float:
        """Largest of a metric over the places of a case."""
        return self.distribution(key, case).high

    def signals(self, case: Case) -> Mapping[str, np.ndarray]:
        """Signals at the first place of a case over time."""
        return {name: np.asarray(values) for name, values in self.results.signals(places(case)[0]).items()}

    @property
    def pump_l_min(self) -> float:
        """Flow [l/min] of the pump in the actuator's FMU; nan where no run says it."""
        return self._published("flow_limit", lambda c: c.pump_l_min is None and not c.shared_pump)

    @property
    def null_opening_mm(self) -> float:
        """Opening [mm] of an unpowered valve in the actuator's FMU; nan where no run says it."""
        return 1e3 * self._published("null_opening", lambda c: c.null_opening_mm is None)

    def _published(self, key: str, unset: Any) -> float:
        runs = (c for c in self.results.ran if isinstance(c, Case) and c.actuators == "hydraulic" and unset(c))
        return next((self.results[c][key] for c in runs), math.nan)
