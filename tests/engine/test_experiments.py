"""The engine follows the rule of exchange in the systems of every experiment.

Every choice of every option, a short while each, as far as it changes the wiring.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from built import FMUS, BuiltFmus
from oracles.exchange_rule import by_the_rule
from same import assert_same

from cosim import System
from cosim.experiments import EXPERIMENTS
from cosim.study import FmuSet, Runner
from cosim.study.case import CaseError, Field, fields
from cosim.study.experiment import Experiment, resolved
from cosim.study.loading import load

WHILE = {
    "hmmwv": 0.7,
    "preview-chain": 0.7,
    "semi-active": 0.7,
    "trench": 0.1,
}  # s; the first wheel has met what there is to meet
ELSEWHERE = 0.25  # s


def parts(experiment: Experiment) -> Iterator[Experiment]:
    """An experiment and its parts."""
    yield experiment
    for part in experiment.study.parts:
        yield from parts(resolved(part))


def values(field: Field) -> list[Any]:
    """Values of an option that are tried: all choices, both truths.

    Of the sub-steps of a step two, so that rates differ otherwise.
    """
    if field.option.choices is not None:
        return list(field.option.choices)
    return [not field.default] if field.type is bool else [2] * (field.attribute == "exchange_parts")


def cases(experiment: Experiment) -> list[Any]:
    """Every value of every option once.

    Beside the defaults, or else beside the first value of one or two others that it goes with.
    """
    of, known = experiment.case, fields(experiment.case)
    alone = [{f.attribute: v} for f in known for v in values(f)]
    bases = [{}, *alone, *(a | b for a, b in combinations(alone, 2))]
    found: dict[Any, None] = {}
    for field in known:
        for value in values(field):
            for base in bases:
                try:
                    found[replace(of(), **{**base, field.attribute: value})] = None
                except CaseError:
                    continue
                break
            else:
                raise AssertionError(f"{experiment.name}: nothing goes with {field.name} = {value}")
    return list(found)


ALL: dict[str, Experiment] = {}
for module in EXPERIMENTS.values():
    for part in parts(load(module)):  # studies of readings have the same systems as the studies that they read
        if all(part.functions != other.functions for other in ALL.values()):
            ALL[part.name] = part


def wiring(system: System) -> Any:
    """What the engine executes of a system: FMUs, steps, connections, groups; not values of parameters."""
    with system.initialize() as simulation:
        schedule = simulation.exchange.schedule
        name = {m: m.name for m in schedule.components}
        return (
            tuple(
                (m.name, m.description.name, m.description.token, m.step, m.offset, m.discrete)
                for m in schedule.components
            ),
            tuple(
                (name[c.source], c.output.name, name[c.target], c.input.name, c.scale, c.offset, c.delay, c.extrapolate)
                for c in schedule.connections
            ),
            tuple((g.method, tuple(name[m] for m in g.components)) for g in schedule.groups),
        )


@pytest.mark.parametrize("name", ALL)
def test_the_engine_follows_the_rule(built_fmus: BuiltFmus, name: str) -> None:  # noqa: ARG001
    """Cases that differ in values alone are the same to the engine: the first of them is run."""
    with Runner(ALL[name], FmuSet(FMUS)) as runner:
        duration, different = WHILE.get(name, ELSEWHERE), {}
        for case in cases(ALL[name]):
            different.setdefault(wiring(runner.system(case)), case)
        for case in different.values():
            run = runner.run(case, stop_time=duration)
            found = run.recording
            interval = Fraction(float(found.time[1])).limit_denominator(10**6)
            expected = by_the_rule(run.system, Fraction(str(duration)), found.names, interval)
            assert_same(found, expected, case.label)
            moving = np.ptp(found.data, axis=0) > 0
            assert moving.mean() > 0.2, f"hardly anything happens in {case.label}"
