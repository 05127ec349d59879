"""Linear models as control engineers take them: `control.StateSpace`, whose signals have names.

python-control allows no dots in names, and reads brackets as slices. So a name is changed by one rule (`control_name`):
what is no letter, digit or underscore becomes one underscore, none at the end: `body.az` -> `body_az`, `preview.fl[3]`
-> `preview_fl_3`. Two names that would become one are refused, and `LinearModel.names` leads back.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import control
import numpy as np

from cosim.core.errors import WiringError
from cosim.core.signals import Array

NOTHING = "nothing"


@dataclass(frozen=True)
class Matrices:
    """A linear model in the names of its FMUs.

    `units` and `point`: unit and value at the operating point, of the signals that have one. `dt` [s]: period of a
    sampled model, 0 for a continuous one.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: Sequence[str]
    inputs: Sequence[str]
    outputs: Sequence[str]
    dt: float = 0.0
    units: Mapping[str, str] = field(default_factory=dict)
    point: Mapping[str, float] = field(default_factory=dict)

    def within(self, component: str) -> Matrices:
        """The same in the component's own names."""

        def own(name: str) -> str:
            return name.removeprefix(f"{component}.")

        return replace(
            self,
            states=[own(n) for n in self.states],
            inputs=[own(n) for n in self.inputs],
            outputs=[own(n) for n in self.outputs],
            units={own(n): unit for n, unit in self.units.items()},
            point={own(n): value for n, value in self.point.items()},
        )


class LinearModel(control.StateSpace):  # type: ignore[misc]
    """A `control.StateSpace` of deviations from an operating point.

    Attributes: `names`, from names here to those of the FMUs, for states, inputs and outputs alike; `units` and
    `operating_point`, unit and value [unit] of each signal by its FMU name. A model without inputs has one that does
    nothing, `nothing`. What python-control makes of it (feedback, sampling, parts) is a plain `control.StateSpace`.
    """

    def __init__(self, matrices: Matrices):
        m = matrices
        if not m.outputs:
            raise WiringError("a linear model needs outputs: name one")
        self.names = _names([*m.states, *m.inputs, *m.outputs])
        self.units, self.operating_point = dict(m.units), dict(m.point)
        own = {name: short for short, name in self.names.items()}
        b, d, inputs = m.B, m.D, [own[n] for n in m.inputs]
        if not inputs:  # of no inputs python-control makes no model
            b, d, inputs = np.zeros((len(m.A), 1)), np.zeros((len(m.C), 1)), [NOTHING]
        super().__init__(
            m.A,
            b,
            m.C,
            d,
            m.dt,
            states=[own[n] for n in m.states],
            inputs=inputs,
            outputs=[own[n] for n in m.outputs],
            remove_useless_states=False,
        )


def control_name(name: str) -> str:
    """The name that a signal has in python-control, see the module."""
    return re.sub(r"\W+", "_", re.sub(r"\W+$", "", name))


def _names(names: Sequence[str]) -> dict[str, str]:
    found: dict[str, str] = {}
    for name in names:
        short = control_name(name)
        if found.setdefault(short, name) != name:
            raise WiringError(
                f"'{found[short]}' and '{name}' would both be '{short}' in python-control; choose signals without one"
                " of them"
            )
    return found
