"""The engine follows the rule of exchange in the systems of every experiment.

Every choice of every option, a short while each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from built import FMUS, BuiltFmus
from oracles.exchange_rule import by_the_rule
from same import assert_same

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


@pytest.fixture(scope="module")
def runner(built_fmus: BuiltFmus) -> Iterator[Callable[[str], Runner]]:  # noqa: ARG001
    """The runner of an experiment; what it has wired is used again."""
    opened: dict[str, Runner] = {}

    def get(name: str) -> Runner:
        if name not in opened:
            opened[name] = Runner(ALL[name], FmuSet(FMUS))
        return opened[name]

    yield get
    for used in opened.values():
        used.close()


@pytest.mark.parametrize(
    ("name", "case"), [pytest.param(n, c, id=f"{n}-{c.label}") for n, e in ALL.items() for c in cases(e)]
)
def test_the_engine_follows_the_rule(runner: Callable[[str], Runner], name: str, case: Any) -> None:
    run = runner(name).run(case, stop_time=WHILE.get(name, ELSEWHERE))
    found = run.recording
    interval = Fraction(float(found.time[1])).limit_denominator(10**6)
    expected = by_the_rule(run.system, Fraction(str(WHILE.get(name, ELSEWHERE))), found.names, interval)
    assert_same(found, expected)
    moving = np.ptp(found.data, axis=0) > 0
    assert moving.mean() > 0.2, "hardly anything happens in this run"
