"""What an MPC is to do: weights, bounds, horizon, cases. Every mistake is refused by name when the objects are made."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

from build_fmus.base.checks import number, whole_number
from fmu_sources.controllers.mpc.model import MpcError, MpcModel, position

INFINITE = 1e30
"""Stands for a bound that is not there, in the quadratic program."""
CATCH_UP = 1e-6
"""Part of the rate's range by which an input that comes back to its bounds may lag its fastest way: margin for
rounding.
"""


def _number(where: str, name: str, value: float, *, least: float | None = None, finite: bool = True) -> None:
    if isinstance(value, Sequence | Mapping) or hasattr(value, "__len__"):
        raise MpcError(f"{where}: {name} has {len(value)} values; give one number, and one entry per signal")
    if finite or math.isnan(value):
        number(f"{where}: {name}", value, least=least, error=MpcError)


def _order(where: str, low: float, high: float, what: str) -> None:
    if low > high:
        raise MpcError(f"{where}: {what} contradict each other: {low:g} is above {high:g}")


@dataclass(frozen=True)
class Input:
    """A controlled input.

    `weight` and `rate_weight` enter the cost as (weight / scale)^2 per (input - target)^2 and per (change per
    period)^2. Bounds are hard: `min`, `max` on the input, `rate_min`, `rate_max` on its change per period.
    """

    name: str
    scale: float = 1.0
    weight: float = 0.0
    rate_weight: float = 0.0
    min: float = -math.inf
    max: float = math.inf
    rate_min: float = -math.inf
    rate_max: float = math.inf
    target: float = 0.0

    def __post_init__(self) -> None:
        where = f"input {self.name}"
        _number(where, "scale", self.scale, least=1e-12)
        for name in ("weight", "rate_weight"):
            _number(where, name, getattr(self, name), least=0.0)
        for name in ("min", "max", "rate_min", "rate_max"):
            _number(where, name, getattr(self, name), finite=False)
        _number(where, "target", self.target)
        _order(where, self.min, self.max, "min and max")
        _order(where, self.rate_min, self.rate_max, "rate_min and rate_max")
        if self.rate_min > 0 or self.rate_max < 0:
            raise MpcError(
                f"{where}: rate_min {self.rate_min:g} to rate_max {self.rate_max:g} must include 0, so that the"
                " input can be held"
            )


@dataclass(frozen=True)
class Output:
    """A predicted output.

    `weight` enters the cost as (weight / scale)^2 per (output - reference)^2 at every predicted step. `min` and
    `max` are soft: min - ecr scale eps <= output <= max + ecr scale eps, with one slack eps >= 0 for the whole
    problem. `ecr=0` makes them hard, at the price of problems without a solution. `reference` names the input
    that gives the reference over the horizon (`"reference.pitch"`); None keeps it at 0.
    """

    name: str
    scale: float = 1.0
    weight: float = 0.0
    min: float = -math.inf
    max: float = math.inf
    ecr: float = 1.0
    reference: str | None = None

    def __post_init__(self) -> None:
        where = f"output {self.name}"
        _number(where, "scale", self.scale, least=1e-12)
        _number(where, "weight", self.weight, least=0.0)
        _number(where, "ecr", self.ecr, least=0.0)
        for name in ("min", "max"):
            _number(where, name, getattr(self, name), finite=False)
        _order(where, self.min, self.max, "min and max")


@dataclass(frozen=True)
class Horizon:
    """Steps that are predicted, and how often the inputs may move in them.

    `prediction` steps count in the cost, from the next sample on; outputs are those that will be measured there,
    before that sample's command acts. `blocks` are the lengths of the intervals between moves; without it there are
    `control` moves one step apart. The last move holds to the end.
    """

    prediction: int
    control: int = 0
    blocks: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for name, least in (("prediction", 1), ("control", 0)):
            given = whole_number(f"horizon: {name}", getattr(self, name), least=least, error=MpcError)
            object.__setattr__(self, name, given)
        blocks = tuple(self.blocks) or (1,) * self.control
        if not blocks or min(blocks) < 1:
            raise MpcError(f"horizon: moves {blocks}: give control >= 1, or blocks of at least one step each")
        if self.control and len(blocks) != self.control:
            raise MpcError(f"horizon: {len(blocks)} blocks for a control horizon of {self.control}")
        object.__setattr__(self, "blocks", blocks)
        object.__setattr__(self, "control", len(blocks))
        if self.moves[-1] >= self.prediction:
            raise MpcError(
                f"horizon: the last move at step {self.moves[-1]} comes too late for {self.prediction} predicted steps;"
                " the control horizon is longer than the prediction"
            )

    @property
    def moves(self) -> tuple[int, ...]:
        """Steps at which the inputs move."""
        return tuple(sum(self.blocks[:j]) for j in range(len(self.blocks)))


_CHANGEABLE = {
    Input: ("weight", "rate_weight", "min", "max", "rate_min", "rate_max", "target"),
    Output: ("weight", "min", "max"),
}


@dataclass(frozen=True)
class Case:
    """What differs in one case: `{"force.a1l": {"min": -70e3, "max": -50e3}, "body.pitch": {"weight": 30}}`."""

    name: str
    changes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Mpc:
    """An MPC: model, weights, bounds, horizon. Cases are numbered from 0 in the given order.

    Raises:
        MpcError: a signal that the model does not have, one that is missing or given twice, contradictory bounds,
            a horizon that does not fit, nothing weighted.
    """

    model: MpcModel
    inputs: tuple[Input, ...]
    outputs: tuple[Output, ...]
    horizon: Horizon
    cases: tuple[Case, ...] = (Case("nominal"),)
    slack_weight: float = 1e3

    def __post_init__(self) -> None:
        given = {
            "input": ([i.name for i in self.inputs], self.model.inputs),
            "output": ([o.name for o in self.outputs], self.model.outputs),
        }
        for what, (names, known) in given.items():
            for name in names:
                position(f"{what} of the model", name, known)
                if names.count(name) > 1:
                    raise MpcError(f"{what} {name} is given twice")
        missing = [n for n in self.model.inputs if n not in [i.name for i in self.inputs]]
        if missing:
            raise MpcError(f"no weights and bounds for input(s) {', '.join(missing)} of the model")
        _number("mpc", "slack_weight", self.slack_weight, least=1e-12)
        if not self.cases:
            raise MpcError("an MPC needs at least one case")
        for case in self.cases:
            for name, change in case.changes.items():
                where = f"case {case.name!r}"
                signals: tuple[Input | Output, ...] = (*self.inputs, *self.outputs)
                old = {s.name: s for s in signals}
                if name not in old:
                    position(f"input or output (in {where})", name, list(old))
                for key in change:
                    position(
                        f"setting of {name} that a case may change (in {where})", key, _CHANGEABLE[type(old[name])]
                    )
        for case, inputs, outputs in zip(self.cases, self.case_inputs, self.case_outputs, strict=True):
            if not any(s.weight for s in outputs):
                raise MpcError(f"case {case.name!r}: no output has a weight")
            for i in inputs:
                if not i.weight and not i.rate_weight:
                    raise MpcError(
                        f"case {case.name!r}, input {i.name}: weight or rate_weight must be positive, or the moves at "
                        "the end of the horizon are not determined"
                    )

    def _changed(self, case: Case, signal: Input | Output) -> Input | Output:
        try:
            return replace(signal, **case.changes.get(signal.name, {}))  # type: ignore[arg-type]
        except MpcError as error:
            raise MpcError(f"case {case.name!r}, {error}") from None

    @cached_property
    def case_inputs(self) -> tuple[tuple[Input, ...], ...]:
        """Inputs of each case in the order of the model."""
        by_name = {i.name: i for i in self.inputs}
        return tuple(tuple(self._changed(c, by_name[n]) for n in self.model.inputs) for c in self.cases)  # type: ignore[misc]

    @cached_property
    def case_outputs(self) -> tuple[tuple[Output, ...], ...]:
        """Outputs of each case in the order in which they were given."""
        return tuple(tuple(self._changed(c, o) for o in self.outputs) for c in self.cases)  # type: ignore[misc]

    @property
    def bounded(self) -> tuple[int, ...]:
        """Indices of outputs that have a bound in some case."""
        return tuple(
            i
            for i in range(len(self.outputs))
            if any(math.isfinite(o[i].min) or math.isfinite(o[i].max) for o in self.case_outputs)
        )

    @property
    def soft(self) -> bool:
        """Whether there is a slack."""
        return any(self.outputs[i].ecr > 0 for i in self.bounded)

    def as_dict(self) -> dict[str, object]:
        """The settings as plain values, for provenance."""

        def plain(signal: Input | Output) -> dict[str, object]:
            items = {f.name: getattr(signal, f.name) for f in fields(signal)}
            return {k: v for k, v in items.items() if v is not None and not (isinstance(v, float) and math.isinf(v))}

        return {
            "period": self.model.period,
            "prediction": self.horizon.prediction,
            "moves": list(self.horizon.moves),
            "slack_weight": self.slack_weight,
            "cases": {
                c.name: {"inputs": [plain(s) for s in i], "outputs": [plain(s) for s in o]}
                for c, i, o in zip(self.cases, self.case_inputs, self.case_outputs, strict=True)
            },
        }
