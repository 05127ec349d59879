"""What halving the steps of exchange and solvers changes in the runs of paper 001 on the whole vehicle."""

from __future__ import annotations

from dataclasses import dataclass

from cosim.experiments.hmmwv import EXCHANGE, Case
from cosim.experiments.hmmwv_figures import NAMES, PUMP, ROAD_NAMES
from cosim.experiments.hmmwv_study import FINER_EXCHANGE, FINER_SOLVERS, Study, finer, published_cases
from cosim.report import Section, Table
from cosim.report.model import Scalar


@dataclass(frozen=True)
class Refinement:
    """Absorbed power [W] of the first variant of a case: as in the study, with finer solvers, finer exchange, and both."""

    case: Case
    power: float
    solver: float | None
    exchange: float | None
    both: float

    @property
    def change(self) -> float:
        """Change [%] when both are halved."""
        return 100 * (self.both / self.power - 1)


def refinements(study: Study) -> list[Refinement]:
    """Every case of the claims, and what finer steps make of it."""

    def power(case: Case) -> float | None:
        row = study.rows.get(study.plan.expand(case)[0])
        return None if row is None else float(row["absorbed_power"])

    found = []
    for case in published_cases():
        base, both = power(case), power(finer(case))
        if base is not None and both is not None:
            solver, exchange = power(finer(case, exchange=False)), power(finer(case, solver=False))
            found.append(Refinement(case, base, solver, exchange, both))
    return found


def section(study: Study, undecided: list[str]) -> Section:
    """Table and words of a report; ``undecided``: ids of claims whose verdict changes."""
    every = refinements(study)
    worst = max(every, key=lambda r: abs(r.change))
    rows: list[list[Scalar]] = [
        [
            ROAD_NAMES[r.case.road],
            NAMES[r.case.controller],
            PUMP.words if r.case.flow_limit else "no limit" if r.case.controller != "passive" else "off",
            *(None if p is None else round(p, 4) for p in (r.power, r.solver, r.exchange, r.both)),
            round(r.change, 2),
        ]
        for r in every
    ]
    verdicts = (
        f"The verdict on {', '.join(undecided)} changes with that, so it is given as open."
        if undecided
        else "No verdict changes."
    )
    return Section(
        "Refinement of the steps",
        [
            f"Car and actuators exchange values every {EXCHANGE} and integrate with steps of their own, 0.5 ms and 0.25 ms at most. Every case "
            f"that a claim rests on was run again over its first place of the bump or stretch with an exchange every {FINER_EXCHANGE} "
            f"and solver steps divided by {FINER_SOLVERS}. The largest change is {worst.change:+.2f} % ({ROAD_NAMES[worst.case.road]}, "
            f"{NAMES[worst.case.controller]}{', ' + PUMP.words if worst.case.flow_limit else ''}). All claims were judged once more with every "
            f"figure changed in that proportion. {verdicts}",
        ],
        tables=[
            Table(
                "refinement",
                "Absorbed power over steps of exchange and solvers",
                [
                    "road", "controller", "pump", "as in all other tables [W]", "solver steps halved [W]",
                    "exchange step halved [W]", "both halved [W]", "change by both [%]",
                ],
                rows,
                "A solver's step is never longer than the exchange. A dash: not run.",
            )
        ],
    )  # fmt: skip
