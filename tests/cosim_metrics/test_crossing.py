"""Crossing metrics: analytic values, and every printed cell of paper 003 from the printed inputs.

A printed input is rounded, so a result is compared with the interval that the inputs can mean.
"""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest

from cosim.experiments.metrics import crossing as mc
from cosim.experiments.trench import published

GRID = list(product(published.LENGTHS, published.SPEEDS))
ROWS = published.rows()


def half_unit(cell: str) -> float:
    """Half of the last printed digit."""
    return 0.5 * 10.0 ** -len(cell.partition(".")[2])


def span(cell: str) -> tuple[float, float]:
    return float(cell) - half_unit(cell), float(cell) + half_unit(cell)


def possible(function, *cells: str) -> tuple[float, float]:
    """Lowest and highest result over the corners of what the printed inputs can mean (functions monotone in each)."""
    values = [function(*v) for v in product(*map(span, cells))]
    return min(values), max(values)


def overlaps(a: tuple[float, float], b: tuple[float, float]) -> bool:
    return a[0] <= b[1] + 1e-9 and b[0] <= a[1] + 1e-9


def printed(*columns: str) -> list[tuple[float, float]]:
    """Rows where all these cells are in print."""
    return [k for k in GRID if all(ROWS[k][c] for c in columns)]


def test_the_table_has_every_row_and_what_is_missing_is_missing_on_purpose():
    assert list(ROWS) == GRID
    blank = [k for k, r in ROWS.items() if not all(r.values())]
    assert blank == [(length, speed) for length, speed in GRID if 1.5 <= length <= 1.8]
    missing = {c for k in blank for c, cell in ROWS[k].items() if not cell}
    assert missing == {
        "score",
        "passive cost",
        "controlled cost",
        "passive normalized cost",
        "controlled normalized cost",
        "improvement [%]",
    }


@pytest.mark.parametrize("key", GRID)
def test_limits_give_the_printed_verdict(key):
    assert (not mc.exceeded(published.passive(*key))) == published.passed(*key)


@pytest.mark.parametrize("quantity", ["az [m/s2]", "ax [m/s2]", "pitch [deg]", "az rms [m/s2]", "ax rms [m/s2]"])
def test_tables_5_6_to_5_8(quantity):
    column = quantity.partition(" [")[0] + " reduction [%]"
    for key in GRID:
        row = ROWS[key]
        found = possible(mc.reduction_percent, row[f"controlled {quantity}"], row[f"passive {quantity}"])
        assert overlaps(found, span(row[column])), (key, found, row[column])


def test_one_and_two_decimals_of_the_root_mean_square_agree():
    for key, axis in product(GRID, ("az", "ax")):
        row = ROWS[key]
        assert overlaps(span(row[f"passive {axis} rms [m/s2]"]), span(row[f"passive {axis} rms (one decimal) [m/s2]"]))


COST_KEYS = printed("passive cost")


@pytest.mark.parametrize("key", COST_KEYS)
def test_passive_cost(key):
    """Kale's cost from the printed quantities; only the passive one, since controlled hub forces are not in print."""
    row = ROWS[key]
    slack = sum(w * half_unit(row[f"passive {published.COLUMNS[n]}"]) for n, w in mc.WEIGHTS.items())
    assert abs(mc.cost(published.passive(*key)) - float(row["passive cost"])) <= slack + 0.05


@pytest.mark.parametrize("key", COST_KEYS)
def test_normalized_cost_improvement_and_score(key):
    row = ROWS[key]
    costs = [float(ROWS[k][f"{s} cost"]) for k in COST_KEYS for s in ("passive", "controlled")]
    for system in ("passive", "controlled"):
        found = possible(lambda c: mc.normalized(c, costs), row[f"{system} cost"])
        assert overlaps(found, span(row[f"{system} normalized cost"]))
    low, high = min(costs), max(costs)
    share = possible(
        lambda c, p: mc.reduction_percent((c - low) / (high - low), (p - low) / (high - low)),
        row["controlled cost"],
        row["passive cost"],
    )
    assert overlaps(share, span(row["improvement [%]"]))
    controlled = [float(ROWS[k]["controlled cost"]) for k in COST_KEYS]
    found = mc.scores(controlled)[COST_KEYS.index(key)]
    assert overlaps((found - 1e-3, found + 1e-3), span(row["score"]))


def test_cost_of_the_limits():
    assert mc.cost(mc.LIMITS) == pytest.approx(12.5 * 150 + 17.5 * 100 + 27.5 * 5 + 17.5 * 15 + 25 * 225)
    assert sum(mc.WEIGHTS.values()) == 100.0


class TestSpectrum:
    def test_of_a_sine_with_a_mean(self):
        t = np.arange(4000) / 1000
        x = 0.7 + 3.0 * np.sin(2 * np.pi * 5.0 * t)
        frequency, density = mc.psd(x)
        assert frequency[np.argmax(density)] == pytest.approx(5.0)
        assert density[0] * frequency[1] == pytest.approx(0.49)
        assert mc.psd_rms(x) == pytest.approx(math.sqrt(0.49 + 4.5))

    @pytest.mark.parametrize("n", [2, 999, 1000])
    def test_parseval(self, n):
        x = np.random.default_rng(n).standard_normal(n)
        assert mc.psd_rms(x) == pytest.approx(np.sqrt(np.mean(x**2)), rel=1e-12)

    def test_refuses(self, refused):
        with pytest.raises(ValueError, match="acceleration is nan at sample 1"):
            mc.psd([0.0, math.nan])
        refused(ValueError, lambda: mc.psd_rms([1.0]), lambda: mc.psd_rms([1.0, 2.0], 0.0))


class TestCrossing:
    def test_quantities_of_a_run(self):
        n = 1000
        t = np.arange(n) / 1000
        hubs = np.zeros((n, 6))
        hubs[10, 1], hubs[20, 2], hubs[30, 5] = -30e3, 12e3, 41e3
        run = mc.crossing(2.0 * np.sin(2 * np.pi * t), np.full(n, -1.5), np.radians(-7.0 * t / t[-1]), hubs)
        assert run.az == pytest.approx(2.0, abs=1e-4)
        assert run.az_rms == pytest.approx(math.sqrt(2.0))
        assert (run.ax, run.ax_rms) == pytest.approx((1.5, 1.5))
        assert run.pitch == pytest.approx(7.0)
        assert (run.hub_front, run.hub_middle, run.hub_rear) == (30.0, 12.0, 41.0)

    @pytest.mark.parametrize(("rate", "every"), [(4000.0, 4), (2600.0, 3), (400.0, 1), (1000.0, 1)])
    def test_root_mean_squares_are_those_at_one_kilohertz(self, rate, every):
        """Of every n-th sample where they come faster; peaks are those of all."""
        az = np.where(np.arange(1200) % every == 0, 2.0, 50.0)
        run = mc.crossing(az, -az, np.zeros(1200), np.zeros((1200, 6)), rate)
        assert (run.az_rms, run.ax_rms) == pytest.approx((2.0, 2.0))
        assert (run.az, run.ax) == ((50.0, 50.0) if every > 1 else (2.0, 2.0))

    def test_labels(self):
        assert mc.LABELS == {
            "az": "peak vertical acceleration [m/s2]",
            "ax": "peak longitudinal acceleration [m/s2]",
            "az_rms": "vertical acceleration rms [m/s2]",
            "ax_rms": "longitudinal acceleration rms [m/s2]",
            "pitch": "peak pitch [deg]",
            "hub_front": "peak front hub force [kN]",
            "hub_middle": "peak middle hub force [kN]",
            "hub_rear": "peak rear hub force [kN]",
        }
        assert list(mc.LABELS) == list(mc.WEIGHTS) == list(mc.LIMITS.as_dict())

    def test_failures(self):
        quiet = mc.Crossing(*(0.5 * v for v in mc.LIMITS.as_dict().values()))
        assert mc.failures(quiet, arrived=True, belly_contact=False) == ()
        assert mc.failures(mc.LIMITS, arrived=True, belly_contact=False) == ()
        assert mc.failures(quiet, arrived=False, belly_contact=True) == ("stuck", "belly contact")
        steep = mc.Crossing(**{**quiet.as_dict(), "pitch": 15.01})
        assert mc.failures(steep, arrived=True, belly_contact=False) == ("pitch",)
        assert mc.exceeded(mc.Crossing(**{**quiet.as_dict(), "az": math.nan})) == ("az",)

    def test_refuses_shapes(self, refused):
        x = np.zeros(5)
        refused(
            ValueError,
            lambda: mc.crossing(x, x, x, np.zeros((5, 4))),
            lambda: mc.crossing(x, x[:4], x, np.zeros((5, 6))),
        )
        for i, name in enumerate(("vertical acceleration", "longitudinal acceleration", "pitch")):
            given = [np.full(5, math.nan) if i == j else x for j in range(3)]
            with pytest.raises(ValueError, match=f"^{name} is nan at sample 0"):
                mc.crossing(*given, np.zeros((5, 6)))
        with pytest.raises(ValueError, match=r"^cost is nan at sample 1"):
            mc.scores([1.0, math.nan])
        with pytest.raises(ValueError, match="hub force 2 is inf at sample 3"):
            mc.crossing(x, x, x, np.where(np.arange(30).reshape(5, 6) == 19, math.inf, 0.0))

    def test_equal_costs_cannot_be_normalized(self, raises):
        with raises(ValueError):
            mc.scores([3.0, 3.0])
        assert math.isnan(mc.reduction_percent(1.0, 0.0))
