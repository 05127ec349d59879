"""Model predictive control as a discrete component.

Here are the declarations of a control law, and the whole controller of a plant. The package
(`fmu_sources.controllers.mpc`) has an overview and an example.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from build_fmus.component import Component
from build_fmus.qp import Backend
from fmu_sources.controllers.mpc.model import MpcError, position
from fmu_sources.controllers.mpc.observer import Observer
from fmu_sources.controllers.mpc.qp import Bounds, CondensedQp
from fmu_sources.controllers.mpc.settings import INFINITE, Input, Mpc, Output

LEAST_INPUT_WEIGHT = 1e-4
"""Part of its start that a weight of inputs that is a parameter must have, so that the moves stay determined."""


@dataclass(frozen=True)
class Preview:
    """Inputs that give disturbances ahead of time.

    `inputs`: name of a disturbance of the model -> name of the input vector, index 1 = now, `step` seconds apart,
    `count` of them. While `use_preview` is false, 0 is assumed.
    """

    inputs: Mapping[str, str]
    count: int
    step: float

    def grid(self, where: str, period: float, instants: int) -> np.ndarray:
        """Matrix (instants, count) from preview points to the controller's periods; the last point holds.

        Raises:
            MpcError: neither step nor period is a multiple of the other; the horizon reaches beyond the preview.
        """
        ratio = max(self.step, period) / min(self.step, period)
        if not math.isclose(ratio, round(ratio), rel_tol=1e-9):
            raise MpcError(
                f"{where}: preview step {self.step:g} s and sample time {period:g} s do not divide; make one a multiple"
                " of the other"
            )
        reach = (self.count - 1) * self.step
        need = (instants - 2) * period  # the last height may hold for one interval
        if reach + max(self.step, period) * (1 + 1e-9) < need:
            raise MpcError(
                f"{where}: the horizon of {need:g} s is longer than the preview of {self.count} points {self.step:g} s "
                f"apart ({reach:g} s); shorten the horizon or lengthen the preview"
            )
        place = np.clip(np.arange(instants) * period / self.step, 0, self.count - 1)
        return np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(self.count)[None, :]))


@dataclass(frozen=True)
class MpcSolution:
    """Symbols of a control law and of its prediction.

    `command` (nu,) after clipping, `held` whether the last one was kept, `slack` eps; `planned` (nu,
    prediction), inputs from now on, one period apart; `predicted` (ny, prediction), outputs from the next period on,
    in the order of `mpc.outputs`. When the last command is kept, both are those of keeping it.
    """

    command: Any
    previous: Any
    held: Any
    slack: Any
    planned: Any
    predicted: Any


def add_mpc(
    c: Component,
    mpc: Mpc,
    *,
    state: Any,
    previous: Any,
    disturbance: Any = None,
    reference: Any = None,
    case: Any = 0,
    backend: Backend | Sequence[Backend] | None = None,
    bounds: Bounds | None = None,
    weights: Sequence[tuple[Any, Sequence[str]]] = (),
) -> MpcSolution:
    """Add the control law to a component: its quadratic program, and the command that follows from it.

    The command obeys the rate bounds, and the input bounds as far as these let it. When the program has no solution or
    the solver did not end, the last command is kept, clipped to the bounds of now.

    Args:
        c: discrete component with `symbols=ca.MX` and the sample time of the model.
        mpc: the control law.
        state: (n,) state of `mpc.model` now.
        previous: (nu,) command of the step before, as `previous_command` declares it. The caller updates it.
        disturbance: (nw, last + 2) from now on; None for 0.
        reference: (ny, prediction), rows in the order of `mpc.outputs`; None for 0.
        case: number of the case.
        backend: solver, or several of which the first is used; the default of the build when None.
        bounds: bounds of the inputs that change from step to step, instead of their `min` and `max`.
        weights: weights that are expressions, as `weight_parameters` declares them; the solver is then DAQP.

    Raises:
        MpcError: the component's sample time is not the model's, or it is not made of MX symbols; see `CondensedQp`.
    """
    if c.sample_time is None or not math.isclose(c.sample_time, mpc.model.period):
        raise MpcError(f"{c.name}: sample time {c.sample_time} s is not the model's period of {mpc.model.period:g} s")
    if not isinstance(c.time, ca.MX):
        raise MpcError(f"{c.name}: make the component with symbols=ca.MX; the program's data are matrix products")
    qp = CondensedQp(mpc, weights)
    data = qp.expressions(state, previous, disturbance, reference, case, c.value, bounds)
    solution = c.quadratic_program(
        "solver",
        hessians=qp.hessians,
        constraints=[qp.constraint],
        linear=data.linear,
        lower=data.lower,
        upper=data.upper,
        case=case,
        terms=qp.terms,
        backend=backend,
    )
    held = solution.status > 0.5
    moves = ca.if_else(held, 0, qp.all_moves(solution.z))
    requested = previous + moves[: len(mpc.inputs)]
    now = None if bounds is None else tuple(side[:, 0] for side in bounds(data.free))
    command = clipped(mpc, requested, previous, case, now)
    slack = solution.z[-1] * float(qp.columns[-1]) if mpc.soft else ca.MX(0)
    planned = ca.horzcat(command, qp.planned(previous, moves)[:, 1:])
    return MpcSolution(command, previous, held, slack, planned, qp.predicted(data.free, moves))


def clipped(mpc: Mpc, requested: Any, previous: Any, case: Any, bounds: tuple[Any, Any] | None = None) -> Any:
    """Commands (nu,) within rate bounds, and within input bounds as far as the rate bounds let them.

    `bounds`: those of now, instead of `min` and `max`.
    """

    def limit(name: str) -> Any:
        values = np.array([[getattr(i, name) for i in inputs] for inputs in mpc.case_inputs], dtype=float).T
        table = ca.MX(ca.DM(np.clip(values, -INFINITE, INFINITE)))
        return table if len(mpc.cases) == 1 else table @ (ca.DM(np.arange(len(mpc.cases), dtype=float)) == case)

    low, high = previous + limit("rate_min"), previous + limit("rate_max")
    requested = ca.fmin(ca.fmax(requested, low), high)
    least, most = bounds or (limit("min"), limit("max"))
    return ca.fmin(ca.fmax(requested, ca.fmin(least, high)), ca.fmax(most, low))


def weight_parameters(c: Component, mpc: Mpc, weighted: Mapping[str, Sequence[str]]) -> list[tuple[Any, Sequence[str]]]:
    """Declare weights of squares as parameters `weight.NAME`, for `add_mpc`.

    `weighted`: name -> the outputs and inputs with this weight. The parameters start at the weights of the settings.

    Raises:
        MpcError: signals whose weights are not the same, or a signal that the `mpc` does not have.
    """
    every: tuple[Input | Output, ...] = (*mpc.outputs, *mpc.inputs)
    signals = {s.name: s for s in every}
    found = []
    for name, names in weighted.items():
        given = [signals[list(signals)[position("output or input with a weight", n, list(signals))]] for n in names]
        starts = {float(f"{(s.weight / s.scale) ** 2:.12g}") for s in given}
        if len(starts) != 1:
            raise MpcError(
                f"weight.{name}: {', '.join(names)} have different weights; give each a parameter of its own"
            )
        (start,) = starts
        least = start * LEAST_INPUT_WEIGHT if any(isinstance(s, Input) for s in given) else 0.0
        text = f"weight of the square of {', '.join(names)}, per unit"
        weight = c.parameter(f"weight.{name}", start, None, text, min=least, tunable=True, source=c.source)
        found.append((weight, names))
    return found


def previous_command(c: Component, mpc: Mpc, unit: str | None = None) -> Any:
    """Declare the state (nu,) that holds the command of the step before; 0 at the start."""
    return c.state("command.previous", unit, "command of the step before", shape=(len(mpc.inputs),))


def preview_inputs(c: Component, mpc: Mpc, preview: Preview, unit: str = "m") -> Any:
    """Declare the preview inputs, `preview.step`, `preview.used` and `use_preview`.

    Returns:
        Disturbances (nw, last + 2) of the model.

    Raises:
        MpcError: see `Preview.grid`; a disturbance without an input, or an input for one that is not there.
    """
    model = mpc.model
    for name in preview.inputs:
        position("disturbance of the model", name, model.disturbances)
    missing = [d for d in model.disturbances if d not in preview.inputs]
    if missing:
        raise MpcError(f"{c.name}: no preview input for disturbance(s) {', '.join(missing)}")
    grid = ca.DM(preview.grid(c.name, model.period, mpc.horizon.prediction + 2).T)
    rows = []
    for d in model.disturbances:
        ahead = c.input(
            preview.inputs[d],
            unit,
            f"{d} now (index 1) and later, {1e3 * preview.step:g} ms apart",
            shape=(preview.count,),
        )
        rows.append(ahead.T)
    used = c.parameter(
        "preview.used",
        preview.count - 1,
        None,
        "preview points beyond the first that are used; the last of them holds from there on",
        min=0,
        max=preview.count - 1,
        tunable=True,
        source="option",
    )
    heights = ca.vertcat(*rows)
    columns = [heights[:, 0]]
    for i in range(1, preview.count):
        columns.append(ca.if_else(used > i - 0.5, heights[:, i], columns[-1]))
    known = ca.mtimes(ca.horzcat(*columns), grid)
    c.constant_input(
        "preview.step", "s", "time between preview points: what this controller was built for", must_equal=preview.step
    )
    use = c.input("use_preview", None, "whether the control law uses the preview", type=bool, start=True)
    return ca.if_else(use, known, ca.MX(*known.shape))


def reference_inputs(c: Component, mpc: Mpc, plant: Component, count: int | None = None) -> Any:
    """Declare the reference inputs that outputs name; references (ny, prediction), or None when there are none."""
    h = mpc.horizon
    count = count or h.prediction
    if not any(o.reference for o in mpc.outputs):
        return None
    if count < h.prediction:
        raise MpcError(f"{c.name}: the horizon of {h.prediction} steps is longer than the reference of {count} values")
    places = [min(1 + i, count - 1) for i in range(h.prediction)]
    declared: dict[str, Any] = {}
    rows = []
    for o in mpc.outputs:
        if o.reference is None:
            rows.append(ca.MX(1, h.prediction))
            continue
        if o.reference not in declared:
            v = plant.variable(o.name)
            declared[o.reference] = c.input(
                o.reference,
                v.unit,
                f"requested {o.name} now (index 1) and later, one sample time apart",
                shape=(count,),
                display_unit=v.display_unit,
            )
        rows.append(declared[o.reference][places].T)
    return ca.vertcat(*rows)


def case_input(c: Component, mpc: Mpc) -> Any:
    """Declare the input `case` where there is a choice; otherwise 0."""
    if len(mpc.cases) == 1:
        return 0
    text = ", ".join(f"{i} {case.name}" for i, case in enumerate(mpc.cases))
    return c.input("case", None, f"set of weights and bounds: {text}", type=int, start=0, min=0, max=len(mpc.cases) - 1)


def command_outputs(c: Component, mpc: Mpc, plant: Component, solution: MpcSolution) -> None:
    """Declare the commands under the plant's names, `command.held` and, where there are soft bounds, `slack`."""
    for i, name in enumerate(mpc.model.inputs):
        v = plant.variable(name)
        c.output(name, solution.command[i], v.unit, v.description, display_unit=v.display_unit)
    c.output(
        "command.held",
        solution.held,
        None,
        "the solver found no solution: the last command is kept, clipped",
        type=bool,
    )
    if mpc.soft:
        c.output("slack", solution.slack, "1", "by how much soft bounds give way, in parts of ecr times scale")


def mpc_component(
    mpc: Mpc,
    plant: Component,
    *,
    name: str,
    description: str,
    source: str,
    preview: Preview | None = None,
    observer: Observer | None = None,
    backend: Backend | Sequence[Backend] | None = None,
    weighted: Mapping[str, Sequence[str]] | None = None,
    notes: Iterable[str] = (),
) -> Component:
    """The FMU of an MPC whose inputs carry the names of the plant's outputs.

    Inputs: the states of the model (without `observer`) or the measured outputs (with it), preview and
    `use_preview` (with `preview`), references that outputs name, `case` (with more than one). Outputs: the
    commands under the names of the plant's inputs, `command.held`, `slack` (with soft bounds) and those of the
    solver. `weighted`: weights that are parameters, see `weight_parameters`.

    Raises:
        MpcError: a state that is no output of the plant; an observer of another model; preview that does not fit.
    """
    model = mpc.model
    if observer is not None and observer.model is not model:
        raise MpcError(f"{name}: make the Mpc with observer.model, so that both agree on the states")
    c = Component(
        name,
        kind="discrete",
        sample_time=model.period,
        description=description,
        source=source,
        symbols=ca.MX,
        notes=(*notes, *_NOTES),
    )
    known = [v.name for v in plant.model().variables]
    read = model.states if observer is None else observer.measured
    measured = []
    for n in read:
        position(f"variable of {plant.name} for the {'state' if observer is None else 'measured output'}", n, known)
        v = plant.variable(n)
        measured.append(c.input(n, v.unit, v.description, nominal=v.nominal, display_unit=v.display_unit))
    y = ca.vertcat(*measured)
    previous = previous_command(c, mpc, plant.variable(model.inputs[0]).unit)
    disturbance = preview_inputs(c, mpc, preview) if preview is not None else None
    reference = reference_inputs(c, mpc, plant)
    case = case_input(c, mpc)
    nw = len(model.disturbances)
    now, then = (disturbance[:, 0], disturbance[:, 1]) if disturbance is not None else (ca.MX(nw, 1), ca.MX(nw, 1))
    x = y
    if observer is not None:
        predicted = c.state("estimate", None, "state predicted for this sample", shape=(len(model.states),))
        x = observer.correct(predicted, y, previous, now, then)
    solution = add_mpc(
        c,
        mpc,
        state=x,
        previous=previous,
        disturbance=disturbance,
        reference=reference,
        case=case,
        backend=backend,
        weights=weight_parameters(c, mpc, weighted or {}),
    )
    c.update(previous, solution.command)
    if observer is not None:
        c.update(predicted, observer.predict(x, solution.command, now, then))
    command_outputs(c, mpc, plant, solution)
    c.provenance = {
        "plant": plant.name,
        "mpc": mpc.as_dict(),
        **({"observer": dict(observer.noise)} if observer else {}),
    }
    return c


COMMAND_NOTE = (
    "The command is clipped to its bounds after the solution. The iterations of a sample are limited, so that its time"
    " is, whatever the inputs. OSQP hands a program that it has not solved by then to DAQP, which is inside too and"
    " whose solution counts like its own: solver.status is 0, and solver.iterations counts both. solver.status other"
    " than 0 means that the solvers reached their limits (1), found that there is no solution (2), or that the inputs"
    " make numbers without a meaning (3): command.held is then true and the last command is kept, within the bounds of"
    " now."
)
TUNABLE_NOTE = (
    "Weights are parameters, which may change during a run: the quadratic program is factored at each sample. With the"
    " weights at first it is that of the MPC whose weights are constants, solved by DAQP."
)
_NOTES = (
    (
        "At each sample a quadratic program finds the moves over the control horizon that minimise the weighted squares"
        " of predicted outputs (as they will be measured at each sample, before its command acts), inputs and moves;"
        " the first move is applied. Unknowns are moves, not inputs (an integrator in the model). Bounds on inputs and"
        " their rates are hard; bounds on outputs are soft, with one slack for all."
    ),
    COMMAND_NOTE,
)
