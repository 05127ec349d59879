"""What paper 001 shows of its preview, and the runs behind it: filters, corrections, noise, a sensor that fails."""

from __future__ import annotations

from dataclasses import replace

from cosim.experiments.hmmwv.preview.runs import Case
from cosim.study.experiment import Task

CHAINS = (
    Case(filter="printed", use_road=False),
    Case(filter="printed", use_road=False, compensation=True),
    Case(filter="printed"),
    Case(use_road=False),
    Case(),
    Case(use_road=False, compensation=True),
    Case(compensation=True),
)
"""Filters and corrections that are compared."""
PRINTED, COMPENSATED, PRINTED_FED, RELATIVE, FED, TWICE = CHAINS[:6]
DRIFTING = (PRINTED, PRINTED_FED, RELATIVE, FED)  # with noise for long
SHOWN = (PRINTED, COMPENSATED, FED)  # on the track
HEIGHTS_MM = (30.0, 76.0)
LONG = 20.0  # s, of the runs that show drift
SPEEDOMETER_ERRORS = (0.0, 1.0, 2.0)  # %


def over(chain: Case, height_mm: float) -> Case:
    """A chain over one bump, without noise."""
    return replace(chain, height_mm=height_mm)


def long(chain: Case) -> Case:
    """A chain with noise, until its drift shows."""
    return replace(chain, noise=1.0, duration=LONG)


def on_track(chain: Case) -> Case:
    """A chain with noise on the test track."""
    return replace(chain, noise=1.0, road="track", duration=3.2)


DROPOUT = replace(on_track(FED), duration=3.6, dropout_start=0.7, dropout=0.2)


def generated(error: float) -> Case:
    """The known track with a speedometer that reads `error` [%] too high."""
    return Case("generated", road="track", duration=3.0, speedometer_error=error)


def words(chain: Case) -> str:
    """Name of a chain in tables and figures."""
    name = "flat road assumed" if chain.filter == "printed" else "relative states"
    return name + ", road fed back" * chain.use_road + ", quarter cars added" * chain.compensation


def plan() -> list[Task]:
    """Every run of the chain."""
    drawn = [*map(on_track, SHOWN), DROPOUT, *map(generated, SPEEDOMETER_ERRORS)]
    cases = [over(c, h) for c in CHAINS for h in HEIGHTS_MM] + [long(c) for c in DRIFTING]
    return [Task(c, cost=c.duration) for c in cases] + [Task(c, signals=True, cost=c.duration) for c in drawn]
