"""Generalized predictive control of the full car as a discrete component (Brown, Murugan, Mazza; equations 15, 19, 21).

Timing, in ticks of 1 ms: the command u changes at k x 10 ms, where the road height d(t) is sampled too; the response
y(t) is sampled one tick later, so that it contains the direct effect of u(t), as the ARX form (1) needs. A command is
computed from responses, commands and road heights of t-1 and older; preview adds road heights of t and later.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import casadi as ca
import numpy as np
from scipy.constants import degree, g

from build_fmus.component import Component
from fmu_sources.controllers.gpc.control_law import GpcLaw
from fmu_sources.models.corners import CORNERS

TICK = 1e-3  # s, communication step of the published co-simulation
TICKS_PER_SAMPLE = 10  # 100 Hz
SAMPLE_TIME = TICK * TICKS_PER_SAMPLE  # s
RESPONSE_TICK = 1  # tick after a sample instant at which y is sampled
FORCE_LIMIT = 1.5e5  # N, Table 2
RESPONSES = (
    ("body.az", "m/s2", "vertical acceleration of the body", g),
    ("body.pitch", "rad", "pitch angle", degree),
    ("body.roll", "rad", "roll angle", degree),
)
"""Measured responses: FMU variable, unit, description, size of the controller's unit (g, deg, deg) in SI."""

_TITLES = {
    "implicit": "GPC with implicit disturbances: knows responses and own commands",
    "explicit": "GPC with explicit disturbances: knows past road heights under the wheels, assumes road height 0 ahead",
    "preview": "GPC with preview: knows past road heights and those ahead of every wheel",
}
_EQUATIONS = {"implicit": "(15)", "explicit": "(19)", "preview": "(21)"}


def gpc_controller(law: GpcLaw, *, name: str) -> Component:
    """The controller FMU of a control law for four corners and the three responses of `RESPONSES`.

    The control law's gains are the start values of tunable parameters, so another control law (other weights, another
    identification) of the same order and horizon can be set at run time.
    """
    variant, p, h = law.variant, law.order, law.h_p
    rc = len(CORNERS)
    c = Component(
        name,
        kind="discrete",
        sample_time=TICK,
        description=_TITLES[variant],
        source=(
            f"Brown, Murugan, Mazza: Generalized Predictive Control on a HMMWV, equation {_EQUATIONS[variant]}; Table 2"
        ),
        notes=_notes(variant, p, h),
    )
    y = [c.input(n, unit, text) for n, unit, text, _ in RESPONSES]
    measured = ca.vertcat(*(s / scale for s, (_, _, _, scale) in zip(y, RESPONSES, strict=True)))
    gain_y = _gain(c, "gain.y", law.gain_y, "N", f"gains on the last {p} responses (g, deg, deg), newest first")
    gain_u = _gain(c, "gain.u", law.gain_u, "1", f"gains on the last {p} commands, newest first")
    limit = c.parameter(
        "limit", FORCE_LIMIT, "N", "force limit of each actuator", min=0.0, tunable=True, source="000 Table 2"
    )

    phase = c.state("tick", "1", "ticks since the last sample instant")
    y_static = c.initial_value("y_static", measured, None, "responses at the start (trim)")
    past_y = c.state("past.y", None, "sampled responses, newest first", shape=(len(y) * p,))
    past_u = c.state("past.u", "N", "applied commands, newest first", shape=(rc * p,))
    held = c.state("command", "N", "command being held", shape=(rc,))

    command = gain_y @ past_y + gain_u @ past_u
    sampling, sampling_responses = phase < 0.5, ca.fabs(phase - RESPONSE_TICK) < 0.5
    if variant != "implicit":
        d = ca.vertcat(*(c.input(f"road.{k}.height", "m", f"road height under wheel {k}") for k in CORNERS))
        gain_d = _gain(c, "gain.d", law.gain_d, "N/m", f"gains on the last {p} road heights, newest first")
        d_static = c.initial_value("d_static", d, "m", "road heights at the start (datum)")
        past_d = c.state("past.d", "m", "sampled road heights, newest first", shape=(rc * p,))
        command += gain_d @ past_d
        c.update(past_d, ca.if_else(sampling, _shift(past_d, d - d_static), past_d))
    if variant == "explicit":
        gain_hold = _gain(c, "gain.hold", law.gain_hold, "N/m", "gains on the last road height when it is held ahead")
        hold = c.parameter(
            "hold_height",
            law.hold,
            None,
            "assume that the last road height continues ahead, instead of height 0",
            tunable=True,
            source="option; the paper's method is off",
        )
        command += hold * (gain_hold @ past_d[:rc])
    if variant == "preview":
        # Index 1 of a preview is now. The control law wants d(t) of all corners, then d(t+1) of all corners, ...
        ahead = ca.horzcat(
            *(c.input(f"preview.{k}", "m", f"road heights ahead of wheel {k}", shape=(h,)) for k in CORNERS)
        )
        c.constant_input(
            "preview.step", "s", "time between preview points: the controller's sample time", must_equal=SAMPLE_TIME
        )
        gain_preview = _gain(c, "gain.preview", law.gain_preview, "N/m", f"gains on {h} road heights from now on")
        command += gain_preview @ ca.vec((ahead - ca.repmat(d_static.T, h, 1)).T)

    limited = ca.fmax(-limit, ca.fmin(limit, command))
    force = ca.if_else(sampling, limited, held)
    for i, k in enumerate(CORNERS):
        c.output(f"force.{k}", force[i], "N", f"commanded actuator force at corner {k}")

    c.update(phase, ca.fmod(phase + 1, TICKS_PER_SAMPLE))
    c.update(past_y, ca.if_else(sampling_responses, _shift(past_y, measured - y_static), past_y))
    c.update(past_u, ca.if_else(sampling, _shift(past_u, limited), past_u))
    c.update(held, force)
    c.provenance = law.to_dict()
    c.reference_input(_reference_inputs(variant, h))
    return c


def gain_parameters(law: GpcLaw) -> dict[str, np.ndarray]:
    """FMU parameters that give a GPC controller FMU the gains of this control law.

    The FMU has the control law's variant, order and horizon.
    """
    gains = {"gain.y": law.gain_y, "gain.u": law.gain_u}
    if law.variant != "implicit":
        gains["gain.d"] = law.gain_d
    if law.variant == "explicit":
        gains["gain.hold"] = law.gain_hold
    if law.variant == "preview":
        gains["gain.preview"] = law.gain_preview
    return gains


def _reference_inputs(variant: str, h: int) -> dict[str, Callable[[float], float]]:
    """Smooth responses and roads for the reference result."""

    def wave(amplitude: float, rate: float, phase: float) -> Callable[[float], float]:
        return lambda t: amplitude * math.sin(rate * t + phase)

    signals = {n: wave(a, w, 0.0) for (n, *_), a, w in zip(RESPONSES, (2.0, 0.05, 0.02), (9.0, 7.0, 5.0), strict=True)}
    for i, k in enumerate(CORNERS):
        if variant != "implicit":
            signals[f"road.{k}.height"] = wave(0.05, 8.0, i)
        if variant == "preview":
            signals.update({f"preview.{k}[{j + 1}]": wave(0.05, 8.0, i + 8.0 * SAMPLE_TIME * j) for j in range(h)})
    return signals


def _gain(c: Component, name: str, value: np.ndarray, unit: str, description: str) -> ca.SX:
    return c.parameter(name, value, unit, description, tunable=True, source="identified; see resources/provenance.json")


def _shift(history: ca.SX, newest: ca.SX) -> ca.SX:
    n = newest.numel()
    return ca.vertcat(newest, history[: history.numel() - n])


def _notes(variant: str, p: int, h: int) -> tuple[str, ...]:
    notes = [
        (
            f"ARX order {p}, prediction horizon {h}, sample time 10 ms in ticks of 1 ms: the command changes at k x 10"
            " ms, the responses are sampled 1 ms later. Responses are trimmed by their values at the start, road"
            " heights are measured from those at the start, and the histories start filled with these values."
        ),
        (
            "The gains were identified from a co-simulation of the vehicle FMU; how, and from which data, is in"
            " resources/provenance.json. They are tunable parameters: a control law with other weights can be set"
            " without a rebuild."
        ),
    ]
    if variant == "explicit":
        notes.append(
            "The published method leaves the future road out of the optimization, which amounts to height 0 ahead. The "
            "parameter hold_height lets the last measured height continue instead."
        )
    return tuple(notes)
