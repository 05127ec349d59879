"""What halving the steps of exchange and solvers changes in the runs of the vehicle."""

from __future__ import annotations

from collections.abc import Mapping

from cosim.experiments.hmmwv.averages import Averages
from cosim.experiments.hmmwv.published import PUMP, finer, places, published_cases
from cosim.experiments.hmmwv.runs import SHIFTS, STRETCHES, Case
from cosim.experiments.hmmwv.statements import NAMES, ROAD_NAMES
from cosim.experiments.hmmwv.wiring import EXCHANGE
from cosim.experiments.steps import halved
from cosim.report import Table
from cosim.study import Content


def refinements(study: Averages) -> dict[Case, float]:
    """The largest change [%] of the absorbed power with half of all steps, over all places of each case of the claims.

    Cases are left out whose runs the study does not have.
    """
    found = {}
    for case in published_cases():
        if all(run in study.results for place in places(case) for run in (place, finer(place))):
            powers = zip(*([row["absorbed_power"] for row in s.runs(case)] for s in (study, study.finer)), strict=True)
            found[case] = max((100 * (fine / coarse - 1) for coarse, fine in powers), key=abs)
    return found


def largest_change(changes: Mapping[Case, float]) -> tuple[Case, float]:
    """The case of the largest change, and that."""
    return max(changes.items(), key=lambda change: abs(change[1]))


def section(study: Averages, undecided: list[str]) -> Content:
    """Table and words of a report; `undecided`: ids of claims whose verdict changes."""

    def power(run: Case) -> float | None:
        """Absorbed power [W]; None for a run that the study leaves out."""
        return round(study.results[run]["absorbed_power"], 4) if run in study.results else None

    changes = refinements(study)
    worst, largest = largest_change(changes)
    where = [ROAD_NAMES[worst.road], NAMES[worst.controller], *[PUMP.words(study)] * worst.flow_limit]
    verdicts = (
        f"The verdict on {', '.join(undecided)} changes with that, so it is given as open."
        if undecided
        else "No verdict changes."
    )
    yield f"""Car and actuators exchange values every {1e3 * EXCHANGE:g} ms and integrate with steps of their own, 0.5
    ms and 0.25 ms at most. Every case that a claim rests on was run again, at every place of the bump and on every
    stretch, with an exchange every {1e3 * EXCHANGE / 2:g} ms and solver steps divided by 2. The largest change is
    {largest:+.2f} % ({", ".join(where)}). All claims were judged once more by these runs. {verdicts}"""
    limited = PUMP.words(study)
    rows = [
        {
            "road": ROAD_NAMES[case.road],
            "controller": NAMES[case.controller],
            "pump": limited if case.flow_limit else "no limit" if case.controller != "passive" else "off",
            "steps of all other tables [W]": power(first),
            **{f"{what}{'s' * (what == 'solver step')} halved [W]": power(c) for what, c in halved(first).items()},
            "both halved [W]": power(finer(first)),
            "largest change by both [%]": round(change, 2),
        }
        for case, change in changes.items()
        for first in places(case)[:1]
    ]
    yield Table.of(
        "refinement",
        "Absorbed power over steps of exchange and solvers",
        rows,
        f"Powers over bumps: the bump at the first of its {SHIFTS} places on the controllers' grid; off road: the first"
        f" of the {STRETCHES} stretches of the class E road, which figure 1.10 shows. The largest change is that over"
        " all places and all stretches. A solver's step is never longer than the exchange. A dash: not run.",
    )
