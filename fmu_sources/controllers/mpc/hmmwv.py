"""MPC of the HMMWV with and without preview of the road (paper 001, Tables 1.2 and 1.3).

The prediction model is the ride car in its 15 relative states, with the smoothing filter (1.16) of the force tracking
upstream of each actuator and the human response filter (1.19) after the acceleration of the body: 33 states. The
relative states are inputs; the filters are followed inside, by the commands given and the acceleration measured.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy import linalg

from build_fmus.component import Component
from build_fmus.qp import Backend, Daqp, Osqp
from fmu_sources.controllers.force_tracking import DECAY, NATURAL
from fmu_sources.controllers.mpc.component import (
    COMMAND_NOTE,
    TUNABLE_NOTE,
    Preview,
    add_mpc,
    command_outputs,
    preview_inputs,
    previous_command,
    weight_parameters,
)
from fmu_sources.controllers.mpc.model import Disturbance, Filter, MpcModel, filter_inputs, filter_output
from fmu_sources.controllers.mpc.settings import Horizon, Input, Mpc, Output
from fmu_sources.models.comfort import FEET_PER_METRE, HUMAN_RESPONSE
from fmu_sources.models.corners import CORNERS
from fmu_sources.models.hmmwv_states import (
    FORCE_LIMIT,
    FORCES,
    RELATIVE_STATES,
    SAMPLE_TIME,
    SUSPENSION,
    TIRE,
    relative_inputs,
    relative_model,
)
from fmu_sources.registration import component

STEPS = 15  # of prediction and of moves, assumed
PREVIEW_POINTS = STEPS + 1
VELOCITY = tuple(f"suspension.{k}.velocity" for k in CORNERS)
RESPONSE = "human_response"
WEIGHTED = {"absorbed_power": (RESPONSE,), "travel": SUSPENSION, "velocity": VELOCITY, "tire": TIRE, "force": FORCES}
"""What each weight of Table 1.2 weighs."""
_DAQP = Daqp(max_iterations=250)
BACKENDS = (Osqp(rho=0.3, max_iterations=300, fallback=_DAQP), _DAQP)
"""The first is the default; its step size suits bumps higher than the published ones. A sample at the limits of
iterations ends within half the sample time. Both: benchmarks/README.md.
"""


@dataclass(frozen=True)
class MpcHmmwvWeights:
    """Weights of squares and bounds of paper 001; SI units, forces in N, per control period of 30 ms."""

    absorbed_power: float = 23.0  # per W, Table 1.2
    travel: float = 0.02  # 1/m2, Table 1.2
    velocity: float = 192.0  # 1/(m/s)2, Table 1.2
    tire: float = 0.08  # 1/m2, Table 1.2
    force: float = 1.1e-6  # 1/N2, Table 1.2
    max_force: float = FORCE_LIMIT
    max_force_step: float = 5000.0  # N, Table 1.3 prints N/s; read as per period
    max_travel: float = 0.06  # m, Table 1.3; soft
    travel_scale: float = 0.01  # m of travel beyond the bound that cost slack_weight together; assumed
    slack_weight: float = 1e3  # assumed


def smoothing_filter() -> Filter:
    """Paper 001 (1.16): what the force tracking makes of a desired force."""
    w = math.sqrt(NATURAL)
    half = Filter.second_order(w, DECAY / 2 / w)
    return half.then(half)


def human_response_filter() -> Filter:
    """Paper 001 (1.19) on m/s2: its output squared is the absorbed power [W]."""
    (section,) = HUMAN_RESPONSE
    (_, gain, _), (a0, a1, _) = section.b, section.a
    w = math.sqrt(a0)
    return Filter.second_order(w, a1 / 2 / w, gain=gain * FEET_PER_METRE, rate=True)


def prediction_model(car: Component) -> MpcModel:
    """The sampled model: inputs `force.{c}`, disturbances `road.{c}` (heights, of which only rates act)."""
    lin = relative_model(car).linearization(["body.az", *VELOCITY])
    lin = filter_output(filter_inputs(lin, FORCES, smoothing_filter()), "body.az", human_response_filter(), RESPONSE)
    roads = [Disturbance(f"road.{k}", rate=f"road.{k}.rate") for k in CORNERS]
    return MpcModel.sampled(
        lin, SAMPLE_TIME, inputs=FORCES, outputs=[RESPONSE, *SUSPENSION, *VELOCITY, *TIRE], disturbances=roads
    )


def hmmwv_mpc(car: Component, weights: MpcHmmwvWeights | None = None, steps: int = STEPS) -> Mpc:
    """Settings of the MPC. `steps`: prediction and control horizon, in periods."""
    w = weights or MpcHmmwvWeights()
    root = math.sqrt
    unit = 1e3  # N
    return Mpc(
        prediction_model(car),
        inputs=tuple(
            Input(
                f,
                scale=unit,
                weight=root(w.force) * unit,
                min=-w.max_force,
                max=w.max_force,
                rate_min=-w.max_force_step,
                rate_max=w.max_force_step,
            )
            for f in FORCES
        ),
        outputs=(
            Output(RESPONSE, weight=root(w.absorbed_power)),
            *(
                Output(
                    s, scale=w.travel_scale, weight=root(w.travel) * w.travel_scale, min=-w.max_travel, max=w.max_travel
                )
                for s in SUSPENSION
            ),
            *(Output(s, weight=root(w.velocity)) for s in VELOCITY),
            *(Output(s, weight=root(w.tire)) for s in TIRE),
        ),
        horizon=Horizon(steps, steps),
        slack_weight=w.slack_weight,
    )


@component("Mpc{v}", "MPC of the HMMWV with or without preview (paper 001)", of="ride_car_hmmwv")
@component("Mpc{v}Tunable", "MPC of the HMMWV (paper 001), its weights parameters", of="ride_car_hmmwv", tunable=True)
def mpc_hmmwv(
    car: Component,
    weights: MpcHmmwvWeights | None = None,
    name: str = "MpcHmmwv",
    *,
    steps: int = STEPS,
    preview_points: int = PREVIEW_POINTS,
    preview_step: float = SAMPLE_TIME,
    backend: Backend | Sequence[Backend] = BACKENDS,
    tunable: bool = False,
) -> Component:
    """The controller FMU. `tunable`: the weights of Table 1.2 are parameters, and the solver is DAQP.

    Raises:
        MpcError: horizon, preview and sample time do not fit together.
    """
    mpc = hmmwv_mpc(car, weights, steps)
    model = mpc.model
    c = Component(
        name,
        kind="discrete",
        sample_time=SAMPLE_TIME,
        description="MPC of the HMMWV with or without preview (paper 001)",
        source="001 section 1.4, Tables 1.2 and 1.3, equations (1.16), (1.19)",
        symbols=ca.MX,
        notes=(*_notes(weights or MpcHmmwvWeights(), steps), *([TUNABLE_NOTE] if tunable else [])),
    )
    relative = relative_inputs(c, car)
    az = c.input("body.az", "m/s2", car.variable("body.az").description)
    names = {f"road.{k}": f"preview.{k}" for k in CORNERS}
    road = preview_inputs(c, mpc, Preview(names, preview_points, preview_step))
    previous = previous_command(c, mpc, "N")

    n = len(RELATIVE_STATES)
    actuators = c.state(
        "smoothing.filters", None, "states of (1.16) upstream of the actuators", shape=(4 * len(FORCES),)
    )
    last = n + 4 * len(FORCES)
    response = c.state("human_response.filter", None, "states of (1.19) at the sample before", shape=(2,))
    az_before = c.state("human_response.az", "m/s2", "acceleration at the sample before")
    step, then, now = _human_response_step()
    step, then, now = (
        c.value(f"human_response_{n}", ca.MX(ca.DM(m))) for n, m in (("step", step), ("before", then), ("now", now))
    )
    felt = ca.mtimes(step, response) + then * az_before + now * az

    solution = add_mpc(
        c,
        mpc,
        state=ca.vertcat(relative, actuators, felt),
        previous=previous,
        disturbance=road,
        backend=_DAQP if tunable else backend,
        weights=weight_parameters(c, mpc, WEIGHTED if tunable else {}),
    )
    c.update(previous, solution.command)
    inside = slice(n, last)
    A, B = (c.value(f"smoothing_{n}", ca.MX(ca.DM(m[inside]))) for n, m in (("A", model.A[:, inside]), ("B", model.B)))
    smoothed = ca.mtimes(A, actuators) + ca.mtimes(B, solution.command)
    c.update(actuators, smoothed, source="001 (1.16), four times, sampled for held commands")
    c.update(response, felt, source="001 (1.19), sampled for an acceleration that is linear in between")
    c.update(az_before, az)
    command_outputs(c, mpc, car, solution)
    for i, force in enumerate(FORCES):
        c.output(
            f"planned.{force}",
            solution.planned[i, :].T,
            "N",
            f"{force} as planned: now (index 1) and later, a sample time apart",
        )
    for travel in SUSPENSION:
        row = next(k for k, o in enumerate(mpc.outputs) if o.name == travel)
        v = car.variable(travel)
        c.output(
            f"predicted.{travel}",
            solution.predicted[row, :].T,
            v.unit,
            f"{travel} as predicted: at the next sample (index 1) and later, a sample time apart",
            display_unit=v.display_unit,
        )
    c.provenance = {"car": car.name, "mpc": mpc.as_dict()}
    c.reference_input(_reference_inputs(preview_points, preview_step))
    return c


def _human_response_step() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Filter (1.19) over one period with the acceleration linear in between: of its state, of az before, of az now."""
    f = human_response_filter()
    big = np.zeros((4, 4))
    big[:2, :2], big[:2, 2], big[2, 3] = f.A, f.b, 1.0
    e = linalg.expm(big * SAMPLE_TIME)
    slope = e[:2, 3] / SAMPLE_TIME
    return e[:2, :2], e[:2, 2] - slope, slope


def _reference_inputs(points: int, step: float) -> dict[str, Callable[[float], float]]:
    """Waves that reach the bounds, the soft ones on travel too."""

    def wave(amplitude: float, rate: float, phase: float) -> Callable[[float], float]:
        return lambda t: amplitude * math.sin(rate * t + phase)

    sizes = dict(zip(RELATIVE_STATES, [0.07] * 4 + [0.005] * 4 + [0.5] * 4 + [0.3] * 3, strict=True))
    signals = {n: wave(a, 9.0, 0.7 * i) for i, (n, a) in enumerate(sizes.items())}
    signals["body.az"] = wave(3.0, 11.0, 0.0)
    for i, k in enumerate(CORNERS):
        signals |= {f"preview.{k}[{m + 1}]": wave(0.03, 6.0, 6.0 * m * step - i) for m in range(points)}
    signals["use_preview"] = lambda t: t < 4.0
    return signals


def _notes(w: MpcHmmwvWeights, steps: int) -> tuple[str, ...]:
    kinds = ("absorbed_power", "travel", "velocity", "tire", "force")
    weights = ", ".join(f"{k.replace('_', ' ')} {getattr(w, k):g}" for k in kinds)
    return (
        (
            f"Index: Table 1.2 (SI, human response on ft/s2): {weights} per square, summed over {steps} periods of 30"
            f" ms with a move in each. Bounds: |force| <= {w.max_force:g} N and {w.max_force_step:g} N per period hard"
            " (the paper prints N/s; that would be 150 N per period and hardly any force), |travel| <="
            f" {w.max_travel:g} m soft."
        ),
        (
            "body.az drives the human response filter inside, linear between samples; the smoothing filters (1.16) of"
            " the force tracking are followed from the commands. Both start at rest."
        ),
        (
            "preview.*: heights under each wheel now and later. Only their differences act, so any datum will do;"
            " without use_preview the road is taken to stay as it is."
        ),
        (
            "Wiring: the 15 relative states and body.az carry the names of RideCarHmmwv's outputs (and of the"
            " estimator's); preview.* and preview.step come from a road or a preview buffer of the same step; force.*"
            " go to ForceTracking as desired forces."
        ),
        COMMAND_NOTE,
    )
