"""Statistics of a sweep: quantiles with confidence, sensitivity by Sobol's indices, Morris' effects and ranks."""

from __future__ import annotations

import math

import numpy as np

from build_fmus.base import extras
from build_fmus.base.checks import Array
from cosim.study.experiment import Metric
from cosim.study.sweep import SweepTable

CONFIDENCE = 0.95


def values_of(table: SweepTable, key: str, metric: Metric) -> Array:
    """The metric `key` of all runs, in the unit in which it is shown."""
    return table.metrics[key] * metric.factor


def quantile_interval(values: Array, q: float, confidence: float = CONFIDENCE) -> tuple[float, float, float]:
    """A quantile of the distribution of values (n,), and the order statistics that enclose it with this confidence.

    They hold for any distribution, and are infinite if n is too small.

    Source:
        David and Nagaraja, Order Statistics, 7.1.
    """
    ordered = np.sort(values)
    n = len(ordered)
    tail = (1 - confidence) / 2
    low, high = binomial_quantile(tail, n, q) - 1, binomial_quantile(1 - tail, n, q)
    return (
        float(np.quantile(ordered, q)),
        float(ordered[low]) if low >= 0 else -math.inf,
        float(ordered[high]) if high < n else math.inf,
    )


def binomial_quantile(p: float, n: int, q: float) -> int:
    """Least number of successes, each of chance q, that n trials do not exceed with a chance of p or more."""
    from scipy import special  # not scipy.stats, which takes 40 MB

    k = math.ceil(special.bdtrik(p, n, q))
    return k - 1 if k > 0 and special.bdtr(k - 1, n, q) >= p else k


def numeric(table: SweepTable) -> dict[str, Array]:
    """Axes of numbers; of texts the number of the value in its list."""
    found = {}
    for a in table.sweep.design.axes:
        column = table.axes[a.name]
        if any(isinstance(v, str) for v in column):
            order = list(dict.fromkeys(a.values))
            column = [order.index(v) for v in column]
        found[a.name] = np.asarray(column, dtype=float)
    return found


def sobol_indices(table: SweepTable, key: str) -> list[tuple[str, float, float, float, float]]:
    """Sobol indices of a metric of a sweep by the method "saltelli".

    Each is (parameter, first-order index, its half width of 95 % confidence, total index, its half width).

    Source:
        Saltelli et al., Computer Physics Communications 181, 2010.
    """
    with extras.needed("sensitivity", "Sobol indices"):
        from SALib.analyze import sobol

    found = sobol.analyze(
        table.sweep.design.problem, table.metrics[key], calc_second_order=False, seed=table.sweep.design.seed
    )
    columns = [np.asarray(found[c], dtype=float).tolist() for c in ("S1", "S1_conf", "ST", "ST_conf")]
    return list(zip([a.name for a in table.sweep.design.axes], *columns, strict=True))


def morris_effects(table: SweepTable, key: str) -> list[tuple[str, float, float]]:
    """Elementary effects of a metric of a sweep by the method "morris", over the whole range of each parameter.

    Each is (parameter, mean of the magnitudes of elementary effects, their standard deviation).

    Source:
        Campolongo et al., Environmental Modelling and Software 22, 2007.
    """
    with extras.needed("sensitivity", "elementary effects (Morris)"):
        from SALib.analyze import morris

    design = table.sweep.design
    found = morris.analyze(design.problem, design.cube(), table.metrics[key], num_levels=8, seed=design.seed)
    return [(a.name, float(found["mu_star"][i]), float(found["sigma"][i])) for i, a in enumerate(design.axes)]


def rank_correlations(table: SweepTable, key: str) -> list[tuple[str, float]]:
    """(parameter, Spearman's rank correlation with a metric); NaN where one of them does not vary."""
    values = table.metrics[key]
    fine = np.isfinite(values)
    found = []
    for name, x in numeric(table).items():
        a, b = ranks(x[fine]), ranks(values[fine])
        varies = len(a) > 1 and np.ptp(a) > 0 and np.ptp(b) > 0
        found.append((name, float(np.corrcoef(a, b)[0, 1]) if varies else math.nan))
    return found


def ranks(values: Array) -> Array:
    """Ranks (n,) from 1; values that are alike have the mean of theirs."""
    _, which, counts = np.unique(values, return_inverse=True, return_counts=True)
    mean: Array = np.cumsum(counts) - (counts - 1) / 2
    return mean[which]
