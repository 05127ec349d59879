"""What halving the steps of exchange and solvers changes in the runs of the vehicle."""

from __future__ import annotations

from dataclasses import dataclass

from cosim.experiments.hmmwv.averages import Averages
from cosim.experiments.hmmwv.published import PUMP, finer, places, published_cases
from cosim.experiments.hmmwv.runs import SHIFTS, STRETCHES, Case
from cosim.experiments.hmmwv.statements import NAMES, ROAD_NAMES
from cosim.experiments.hmmwv.wiring import EXCHANGE
from cosim.experiments.steps import halved
from cosim.report import Table
from cosim.study import Content


@dataclass(frozen=True)
class Refinement:
    """Absorbed power [W] at the first place of a case: as in the study, with finer solvers, finer exchange, and both.

    `changes`: [%] when both are halved, at every place.
    """

    case: Case
    power: float
    solver: float | None
    exchange: float | None
    both: float
    changes: tuple[float, ...]

    @property
    def change(self) -> float:
        """The largest of the changes [%]."""
        return max(self.changes, key=abs)


def refinements(study: Averages) -> list[Refinement]:
    """Every case of the claims, and what finer steps make of it."""

    def power(run: Case) -> float | None:
        return float(study.results[run]["absorbed_power"]) if run in study.results else None

    found = []
    for case in published_cases():
        runs = places(case)
        pairs = [(power(run), power(finer(run))) for run in runs]
        whole = [(base, both) for base, both in pairs if base is not None and both is not None]
        if len(whole) == len(pairs):
            solver, exchange = (power(halved(runs[0])[what]) for what in ("solver step", "communication step"))
            changes = tuple(100 * (both / base - 1) for base, both in whole)
            found.append(Refinement(case, whole[0][0], solver, exchange, whole[0][1], changes))
    return found


def section(study: Averages, undecided: list[str]) -> Content:
    """Table and words of a report; `undecided`: ids of claims whose verdict changes."""
    every = refinements(study)
    worst = max(every, key=lambda r: abs(r.change))
    where = [ROAD_NAMES[worst.case.road], NAMES[worst.case.controller], *[PUMP.words(study)] * worst.case.flow_limit]
    verdicts = (
        f"The verdict on {', '.join(undecided)} changes with that, so it is given as open."
        if undecided
        else "No verdict changes."
    )
    yield f"""Car and actuators exchange values every {1e3 * EXCHANGE:g} ms and integrate with steps of their own, 0.5
    ms and 0.25 ms at most. Every case that a claim rests on was run again, at every place of the bump and on every
    stretch, with an exchange every {1e3 * EXCHANGE / 2:g} ms and solver steps divided by 2. The largest change is
    {worst.change:+.2f} % ({", ".join(where)}). All claims were judged once more by these runs. {verdicts}"""
    limited = PUMP.words(study)
    rows = [
        {
            "road": ROAD_NAMES[r.case.road],
            "controller": NAMES[r.case.controller],
            "pump": limited if r.case.flow_limit else "no limit" if r.case.controller != "passive" else "off",
            "steps of all other tables [W]": round(r.power, 4),
            "solver steps halved [W]": None if r.solver is None else round(r.solver, 4),
            "communication step halved [W]": None if r.exchange is None else round(r.exchange, 4),
            "both halved [W]": round(r.both, 4),
            "largest change by both [%]": round(r.change, 2),
        }
        for r in every
    ]
    yield Table.of(
        "refinement",
        "Absorbed power over steps of exchange and solvers",
        rows,
        f"Powers over bumps: the bump at the first of its {SHIFTS} places on the controllers' grid; off road: the first"
        f" of the {STRETCHES} stretches of the class E road, which figure 1.10 shows. The largest change is that over"
        " all places and all stretches. A solver's step is never longer than the exchange. A dash: not run.",
    )
