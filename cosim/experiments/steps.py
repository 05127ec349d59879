"""Whether results depend on the steps: runs with finer ones of solver and exchange, the same in all experiments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, TypeVar

from cosim import SystemComponent
from cosim.study import Case, Row, option

PARTS = (1, 16)


@dataclass(frozen=True, kw_only=True)
class Stepped(Case):
    """A case whose plant can be solved and exchanged in finer steps; controllers and road keep their sample times."""

    solver_parts: int = option(
        1, within=PARTS, help="number of parts that each solver step of the plant is divided into", label="solver-in-{}"
    )
    exchange_parts: int = option(
        1,
        within=PARTS,
        help="number of parts that each communication step of the plant is divided into",
        label="exchange-in-{}",
    )


S = TypeVar("S", bound=Stepped)

HALVED = {"solver step": {"solver_parts": 2}, "communication step": {"exchange_parts": 2}}
"""Refinements of a convergence check: name -> fields of a case."""


def halved(case: S) -> dict[str, S]:
    """The case with each of `HALVED`."""
    return {what: replace(case, **finer) for what, finer in HALVED.items()}


def with_finer_steps(study: Mapping[Any, Row], case: S) -> dict[str, Row]:
    """Metrics of a case as in the runs, and with each of `HALVED`, by name."""
    return {"as in the runs": study[case], **{f"{what} halved": study[c] for what, c in halved(case).items()}}


def exchange_step(coarse: Fraction, case: Stepped) -> Fraction:
    """Communication step [s] of a case, from that of an undivided one."""
    return coarse / case.exchange_parts


def set_solver_step(plant: SystemComponent, case: Stepped) -> None:
    """Divide the solver step that the plant's FMU declares."""
    declared = float(plant.description.parameters["solver.step"].start)  # type: ignore[arg-type]
    plant.set({"solver.step": declared / case.solver_parts})
