"""Predictive control of the 6x6 with preview of road and pitch reference (paper 003, chapter 4), every 5 ms.

Weights and bounds are those of Tables 4.3 to 4.10. The four cases of trench crossing are switched by an input; how far
the axle over the trench is pulled up, and whether the height of the body is held too, are parameters, so that one FMU
does what the thesis prints and what makes the crossing work. Three estimators are in it: none (all states measured),
offsets on the outputs, which know no road, and heights of the road.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product

import casadi as ca
import numpy as np

from build_fmus.component import Component
from build_fmus.qp import Daqp, Osqp
from fmu_sources.controllers.mpc.component import (
    COMMAND_NOTE,
    Preview,
    add_mpc,
    command_outputs,
    preview_inputs,
    previous_command,
    reference_inputs,
)
from fmu_sources.controllers.mpc.model import Disturbance, MpcModel
from fmu_sources.controllers.mpc.observer import Observer
from fmu_sources.controllers.mpc.settings import Case, Horizon, Input, Mpc, Output
from fmu_sources.models.corners import SIX_CORNERS
from fmu_sources.registration import component

SAMPLE_TIME, PREDICTION, CONTROL = 5e-3, 50, 3  # s, steps, moves: Table 4.4
FORCES = tuple(f"force.{k}" for k in SIX_CORNERS)
WHEELS = tuple(f"wheel.{k}.z" for k in SIX_CORNERS)
MEASURED = ("body.az", "body.roll", "body.pitch", *WHEELS, "body.z")
"""Outputs MO1 to MO9 of Table 4.2 and the height of the body."""

FORCE_SCALE = 3e5  # N, Table 4.3
FORCE_LIMIT = 150e3  # N, of an actuator, either way
SCALE = {"body.az": 4.0, "body.roll": 0.02, "body.pitch": 0.2, **dict.fromkeys(WHEELS, 1.0), "body.z": 0.2}
"""Table 4.3; the height's is assumed."""

CASES = ("nominal", "axle 1 over the trench", "axle 2 over the trench", "axle 3 over the trench")
RETRACTIONS = ("none", "forced", "as printed")
ESTIMATORS = ("measured", "offsets", "road")
BACKENDS = (
    Daqp(max_iterations=150),
    Osqp(rho=1.0, max_iterations=5, check_interval=5, fallback=Daqp(max_iterations=100)),
)
"""The first is the default. A sample at the limits of iterations ends within half the sample time, which leaves OSQP
few of them: benchmarks/README.md.
"""

_FORCE_WEIGHTS = ((0.1, 0.1, 0.1), (0.5, 2.0, 5.0), (2.0, 0.5, 2.0), (0.5, 0.1, 2.0))  # by case and axle: 4.7, 4.9
_PITCH_WEIGHT = 100.0  # in all cases; Table 4.10 prints 30 for cases 1 and 3
_HEIGHT_WEIGHT = 20.0
_RATE = 1.2e6  # N per sample as printed, Table 4.5; N/s for trenches
# by case: axle -> least and largest force [kN] as printed in Table 4.8; others +-150
_FORCED: tuple[Mapping[str, tuple[float, float]], ...] = (
    {},
    {"a1": (50.0, 70.0)},
    {"a2": (50.0, 70.0)},
    {"a2": (-100.0, 90.0), "a3": (60.0, 80.0)},
)


def ride_model(car: Component) -> MpcModel:
    """The ride car sampled at 5 ms, with the outputs of Table 4.2 and the height of the body."""
    return MpcModel.sampled(
        car.linearize(), SAMPLE_TIME, inputs=FORCES, outputs=MEASURED, disturbances=Disturbance.roads(SIX_CORNERS)
    )


def _case(number: int, *, hold_height: bool, retraction: str, printed_limits: bool = True) -> Case:
    """One case of Tables 4.7 to 4.10."""
    changes: dict[str, Mapping[str, float]] = {}
    for k, force in zip(SIX_CORNERS, FORCES, strict=True):
        weight = _FORCE_WEIGHTS[number][int(k[1]) - 1]
        low, high = (1e3 * f for f in _FORCED[number].get(k[:2], (-FORCE_LIMIT / 1e3, FORCE_LIMIT / 1e3)))
        if retraction == "none":
            low, high = -FORCE_LIMIT, FORCE_LIMIT
        elif retraction == "forced":  # the printed ranges pull the axle up: with extension positive their sign turns
            low, high = -high, -low
        changes[force] = {"weight": weight, "min": low, "max": high}
    changes["body.pitch"] = {"weight": _PITCH_WEIGHT}
    changes["body.z"] = {"weight": _HEIGHT_WEIGHT if hold_height else 0.0}
    if number:
        changes |= {name: {"weight": 0.0} for name in ("body.roll", *WHEELS)}
    if not printed_limits:
        rate = _RATE * SAMPLE_TIME
        for n in FORCES:
            changes[n] = {**changes[n], "rate_min": -rate, "rate_max": rate}
        for n in MEASURED:
            changes[n] = {**changes.get(n, {}), "min": -math.inf, "max": math.inf}
    name = f"{CASES[number]}, height {'held' if hold_height else 'free'}"
    name += "" if printed_limits else ", limits for trenches"
    return Case(name + (f", retraction {retraction}" if number else ""), changes)


@dataclass(frozen=True)
class Choice:
    """What the parameters ask for."""

    case: int
    hold_height: bool = True
    retraction: int = 1
    printed_limits: bool = True


def cases() -> dict[Choice, Case]:
    """Every combination of case, height and retraction; the order numbers the quadratic programs."""
    found = {}
    for printed, hold in product((True, False), repeat=2):
        found[Choice(0, hold, 0, printed)] = _case(0, hold_height=hold, retraction="none", printed_limits=printed)
        for number in (1, 2, 3):
            for i, retraction in enumerate(RETRACTIONS):
                found[Choice(number, hold, i, printed)] = _case(
                    number, hold_height=hold, retraction=retraction, printed_limits=printed
                )
    return found


def three_axle_mpc(model: MpcModel) -> Mpc:
    """Weights, bounds and horizon on a model with the names of `MEASURED`.

    Cases are as `cases` numbers them.
    """
    forces = tuple(
        Input(
            n,
            scale=FORCE_SCALE,
            weight=0.1,
            rate_weight=0.1,
            min=-FORCE_LIMIT,
            max=FORCE_LIMIT,
            rate_min=-_RATE,
            rate_max=_RATE,
        )
        for n in FORCES
    )
    outputs = (
        Output("body.az", SCALE["body.az"], 10.0, -2.0, 2.0, ecr=0.1),
        Output("body.roll", SCALE["body.roll"], 0.5, -0.01, 0.01, ecr=0.01),
        Output("body.pitch", SCALE["body.pitch"], 100.0, -0.1, 0.1, ecr=0.5, reference="reference.pitch"),
        *(Output(n, SCALE[n], 0.4, -0.3, 0.3, ecr=0.1) for n in WHEELS),
        Output("body.z", SCALE["body.z"], _HEIGHT_WEIGHT),
    )
    return Mpc(model, forces, outputs, Horizon(PREDICTION, CONTROL), tuple(cases().values()), slack_weight=1e3)


def observers(model: MpcModel) -> dict[str, Observer]:
    """The estimators: `offsets` as MPC tools have it by default, `road` with wandering road heights."""
    return {
        # Unit white noise on every input and measurement and a unit integrator (Ts / (z - 1)) on every output, scaled.
        "offsets": Observer.kalman(
            model, SCALE, input_noise=FORCE_SCALE, offsets={n: SAMPLE_TIME * s for n, s in SCALE.items()}
        ),
        "road": Observer.kalman(
            model,
            {"body.az": 0.1, "body.roll": 1e-3, "body.pitch": 1e-3, **dict.fromkeys(WHEELS, 2e-3), "body.z": 2e-3},
            input_noise=100.0,
            walks=2e-3,
        ),
    }


def combined_gains(model: MpcModel) -> tuple[MpcModel, dict[str, np.ndarray]]:
    """The model with offsets and road heights as states, and each estimator's gain (n, measured) on it.

    What an estimator does not estimate has rows of zeros and stays at 0.
    """
    both = model.with_disturbance_states(MEASURED, roads=True)
    gains = {}
    for name, observer in observers(model).items():
        gain = np.zeros((len(both.states), len(MEASURED)))
        columns = [observer.measured.index(n) for n in MEASURED]
        for row, state in enumerate(observer.model.states):
            gain[both.states.index(state)] = observer.gain[row, columns]
        gains[name] = gain
    return both, gains


@component("MpcThreeAxle{s}", "MPC with preview of road and pitch for the 6x6 (paper 003)", of="three_axle")
def mpc_three_axle(car: Component, name: str = "MpcThreeAxle") -> Component:
    """The controller FMU for the 6x6, designed on its linear ride model."""
    model, gains = combined_gains(ride_model(car))
    mpc = three_axle_mpc(model)
    c = Component(
        name,
        kind="discrete",
        sample_time=SAMPLE_TIME,
        description="Model predictive control of the 6x6 with preview of road and pitch reference",
        source="003 chapter 4, Tables 4.2 to 4.10; signs and settings for trenches see the notes",
        symbols=ca.MX,
        notes=_NOTES,
    )
    hold = c.parameter(
        "hold_height",
        True,
        None,
        "weigh the height of the body too; false is Tables 4.7 and 4.10",
        source="own: without it heave goes into a limit cycle over trenches",
    )
    retraction = c.parameter(
        "retraction",
        1,
        None,
        "forces of the axle over the trench in cases 1 to 3: 0 free, 1 pull the axle up, 2 with the printed sign, push"
        " it down",
        min=0,
        max=2,
        source="003 Table 4.8",
    )
    printed = c.parameter(
        "printed_limits",
        True,
        None,
        "limits of Tables 4.5 and 4.6; false, for trenches: outputs without limits, and forces change by 1.2e6 N/s at"
        " most",
        source="003 Tables 4.5, 4.6; with them a crossing costs about twice as much",
    )
    estimator = c.parameter(
        "estimator",
        1,
        None,
        "0 all states measured, 1 outputs with offsets (the default of MPC tools), 2 outputs with road heights",
        min=0,
        max=2,
        source="003 does not say; 1 is the default of its tool",
    )

    n = len(car.linearize().states)
    inputs = {}
    for s in (*model.states[:n], "body.az"):
        v = car.variable(s)
        inputs[s] = c.input(s, v.unit, v.description, nominal=v.nominal, display_unit=v.display_unit)
    y = ca.vertcat(*(inputs[s] for s in MEASURED))
    preview = Preview({f"road.{k}": f"preview.{k}" for k in SIX_CORNERS}, PREDICTION, SAMPLE_TIME)
    disturbance = preview_inputs(c, mpc, preview)
    reference = reference_inputs(c, mpc, car)
    case = c.input(
        "case", None, ", ".join(f"{i} {text}" for i, text in enumerate(CASES)), type=int, start=0, min=0, max=3
    )
    numbers = list(cases())
    program = sum(
        i
        * _is(case, w.case)
        * _is(hold, w.hold_height)
        * _is(printed, w.printed_limits)
        * (_is(retraction, w.retraction) if w.case else 1)
        for i, w in enumerate(numbers)
    )
    previous = previous_command(c, mpc, "N")
    now, then = disturbance[:, 0], disturbance[:, 1]
    known = ca.vertcat(*(inputs[s] for s in model.states[:n]), ca.MX(len(model.states) - n, 1))
    at_start = ca.vertcat(*(inputs[s] if s in SCALE else 0 for s in model.states[:n]), ca.MX(len(model.states) - n, 1))
    predicted = c.state(
        "estimate",
        None,
        "states, offsets and road heights predicted for this sample",
        shape=(len(model.states),),
        start=at_start,
    )
    expected = _times(model.C, predicted) + _times(model.D, previous) + _times(model.F0, now) + _times(model.F1, then)
    gain = ca.if_else(estimator > 1.5, ca.MX(ca.DM(gains["road"])), ca.MX(ca.DM(gains["offsets"])))
    # body.az follows from the very force that this sample computes, so at initialization it would close a loop: the
    # first sample takes the estimate from the other outputs.
    started = c.state("started", None, "1 after the first sample")
    c.update(started, 1)
    x = ca.if_else(estimator > 0.5, predicted + started * ca.mtimes(gain, y - expected), known)
    solution = add_mpc(
        c, mpc, state=x, previous=previous, disturbance=disturbance, reference=reference, case=program, backend=BACKENDS
    )
    u = solution.command
    c.update(previous, u)
    c.update(predicted, _times(model.A, x) + _times(model.B, u) + _times(model.E0, now) + _times(model.E1, then))
    command_outputs(c, mpc, car, solution)
    c.provenance = {"plant": car.name, "mpc": mpc.as_dict()}
    c.reference_input(_reference_inputs())
    return c


def _is(symbol: ca.MX, value: float) -> ca.MX:
    return ca.fabs(symbol - value) < 0.5


def _times(matrix: np.ndarray, vector: ca.MX) -> ca.MX:
    return ca.mtimes(ca.DM(matrix), vector)


def _reference_inputs() -> dict[str, Callable[[float], float]]:
    """A shallow hollow under one axle after the other, a nod of the body, and all cases in turn.

    Nothing answers to the forces, so the estimator and the control law drive each other to the bounds. Rounded numbers
    are the same in the table of inputs.
    """

    def hollow(depth: float, at: float) -> Callable[[float], float]:
        return lambda t: round(-depth * math.sin(math.pi * (t - at) / 0.4) ** 2 if at <= t <= at + 0.4 else 0.0, 9)

    signals: dict[str, Callable[[float], float]] = {
        "body.z": hollow(0.002, 0.1),
        "body.pitch": hollow(-0.002, 0.05),
        "body.az": hollow(0.05, 0.1),
        "case": lambda t: float(min(3, max(0, int(t / 0.25)))),
    }
    for i, k in enumerate(SIX_CORNERS):
        at = 0.1 + 0.15 * (i // 2)
        signals[f"wheel.{k}.z"] = hollow(0.005, at)
        signals |= {f"preview.{k}[{m + 1}]": hollow(0.005, at - SAMPLE_TIME * m) for m in range(PREDICTION)}
    signals |= {f"reference.pitch[{m + 1}]": hollow(0.004, 0.3 - SAMPLE_TIME * m) for m in range(PREDICTION)}
    return signals


_NOTES = (
    (
        "Wiring: states and body.az carry the names of the outputs of ThreeAxleRide and ThreeAxleTrench, force.* those"
        " of their inputs; preview.*, preview.step come from a road or from TrenchCrossing, reference.pitch from"
        " PitchReference or TrenchCrossing, case from TrenchCrossing. Rates of the road are differences of its heights."
    ),
    (
        "Cases 1 to 3 have the weights of Tables 4.9 and 4.10, with the weight of pitch kept at 100 in all of them"
        " (printed: 30 in cases 1 and 3), and the bounds of Table 4.8. Forces count positive when they push the body up"
        " and the wheel down. The printed ranges lift the wheel over the trench only with the other sign: case 1 has"
        " axle 1 in [-70, -50] kN, case 2 axle 2 likewise, case 3 axle 3 in [-80, -60] kN and axle 2 in [-90, 100] kN."
        " retraction gives the printed sign, or none."
    ),
    (
        "With hold_height false, case 0 is Tables 4.2 to 4.7. Bounds on outputs are soft as in Table 4.6, with one"
        " slack; those on forces and their rates are hard (Table 4.6 lets them give way by 0.1 % of their scale per"
        " unit of slack). The rate bounds of Table 4.5 are per sample and never bind."
    ),
    (
        "printed_limits false is for trenches. The soft bounds of Table 4.6 on acceleration and pitch make the"
        " controller let the vehicle tip rather than pull it back, and without a bound on rates the forced ranges of a"
        " case come as a blow. So outputs have no limits then, and the 1.2e6 of Table 4.5 counts as N/s, 6 kN per"
        " sample; a range that the rate cannot reach at once is approached as fast as the rate lets it."
    ),
    (
        "Without preview (use_preview false) the estimator's disturbance model decides: with offsets on the outputs,"
        " the usual default, the controller reacts only when the trench has tilted the body; with road heights it"
        " infers the road from the wheels and is nearly as good at low speed. With all states measured it knows no"
        " reason for what happens and leaves an error."
    ),
    (
        "The quadratic program has 19 unknowns and about 950 rows; DAQP solves it. OSQP can be chosen at build time;"
        " half the sample time is enough for few of its iterations, so DAQP takes over in nearly every sample."
    ),
    COMMAND_NOTE,
)
