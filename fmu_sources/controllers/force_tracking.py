"""Hydraulic force tracking by dynamic surface control (paper 001, equations (1.7) to (1.16)).

With load pressure P = F / A_p, its desired value P_d and the errors e = P - P_d and s_1 = e + lambda_1 integral(e),

    u_des = { A_p v + C_tm P + (dP_d/dt - lambda_1 e - eta_1 s_1) / alpha } / { C_d w sqrt((P_s - sgn P) / rho) }
    (1.10) V     = k { u + tau du_des/dt - eta_2 tau (u - u_des) }
    (1.12)

Unlike the print: the divisor of (1.10) is the flow per spool stroke, so it has no spool position in it; k is in volts
per meter of spool, so it multiplies; v = dx_s/dt - dx_u/dt; sgn is the direction of the requested flow.

The desired force is smoothed by (1.16). That filter is strictly proper, so its rate is one of its states, and dP_d/dt
needs no difference.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
from scipy.linalg import expm

from build_fmus.component import Component
from fmu_sources.registration import component
from fmu_sources.vehicles import Actuator, declare

SAMPLE_TIME = 1e-3  # s
NATURAL = 80000.0  # 1/s2, (1.16) is the square of NATURAL / (s2 + DECAY s + NATURAL)
DECAY = 475.0  # 1/s

_UNUSED = {"supply.flow_limit", "valve.null_opening", "valve.smoothing", "bypass"}  # what the control law does not know


def smoothing_filter(period: float) -> tuple[np.ndarray, np.ndarray]:
    """The filter (1.16) sampled exactly for an input that is held over `period` [s].

    Returns the matrices (4, 4) and (4,) of `x+ = A x + B F`; the states are the output of the first section [N], its
    rate [N/s], the filtered force [N], and its rate [N/s].
    """
    A = np.array(
        [[0.0, 1.0, 0.0, 0.0], [-NATURAL, -DECAY, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], [NATURAL, 0.0, -NATURAL, -DECAY]]
    )
    held = np.zeros((5, 5))
    held[:4, :4] = A
    held[1, 4] = NATURAL
    sampled = expm(held * period)
    return sampled[:4, :4], sampled[:4, 4]


@component("ForceTracking{v}", "hydraulic force tracking (paper 001)", of="actuator_hmmwv actuator_hmmwv_physical")
def force_tracking(vehicle: Actuator, name: str = "ForceTracking", *, period: float = SAMPLE_TIME) -> Component:
    """Force controller of one wheel's actuator; its parameters are the assumed properties of the actuator.

    `period`: sample time [s].
    """
    c = Component(
        name,
        kind="discrete",
        sample_time=period,
        description=f"Hydraulic force tracking, dynamic surface control: {vehicle.name}",
        source="001 equations (1.7) to (1.16)",
        stop_time=1.0,
        notes=_NOTES,
    )
    p = declare(c, vehicle, leave_out=_UNUSED)

    # -------------------------------------------------------------------------------- parameters of the control law

    def option(name: str, start: bool, text: str, source: str) -> Any:
        return c.parameter(name, start, None, text, tunable=True, source=source)

    def number(name: str, start: float, unit: str, text: str, source: str, **limits: Any) -> Any:
        return c.parameter(name, start, unit, text, tunable=True, source=source, **limits)

    eta_1 = number(
        "eta_1", 300.0, "1/s", "gain of the pressure surface", "assumed, 001 does not give it", min=0.0, max=1e4
    )
    eta_2 = number(
        "eta_2", 800.0, "1/s", "gain of the spool surface", "assumed, 001 does not give it", min=0.0, max=1e4
    )
    lambda_1 = number(
        "lambda_1",
        0.5,
        "1/s",
        "weight of the integral of the pressure error; 0: none",
        "001 (1.8): between 0 and 1",
        min=0.0,
        max=100.0,
    )
    smooth = option("smoothing.enabled", True, "whether force.desired passes the filter (1.16)", "001 (1.16)")
    numerical = option(
        "rate.numerical",
        True,
        "rate of the desired spool position: difference (1.15); off: filter (1.13)",
        "001 (1.15)",
    )
    rate_time = number(
        "rate.time_constant",
        vehicle.valve.time_constant.value,
        "s",
        "time constant of the filter (1.13)",
        "001 (1.13), tau of the spool",
        min=period / 1.9,
        max=1.0,
        display_unit="ms",
    )
    average = option(
        "average.enabled", False, "whether the desired spool position is the mean of the last two (1.14)", "001 (1.14)"
    )
    floor = number(
        "supply.least_drop",
        0.02,
        "1",
        "pressure drop that the valve is taken to have at least, as a part of the supply",
        "assumed",
        min=1e-4,
        max=1.0,
        display_unit="%",
    )
    notches = {
        mode: (
            option(
                f"notch.{mode}.enabled", False, f"whether the desired spool position is attenuated at {mode}", "001 1.3"
            ),
            number(
                f"notch.{mode}.frequency",
                frequency,
                "Hz",
                f"frequency of {mode}",
                "001 section 1.3",
                min=0.1,
                max=100.0,
            ),
        )
        for mode, frequency in (("heave_pitch", 2.0), ("roll", 4.0))
    }
    width = number(
        "notch.width", 0.5, "1", "width of the notches, as a part of their frequency", "assumed", min=0.01, max=5.0
    )
    left = number("notch.residual", 0.5, "1", "gain at the center of a notch", "assumed", min=0.0, max=1.0)

    # -------------------------------------------------------------------------------------------------------- inputs

    kilo: dict[str, Any] = {"nominal": 1e3, "display_unit": "kN"}
    requested = c.input(
        "force.desired", "N", "desired force, positive lifts the body and pushes the wheel down", **kilo
    )
    measured = c.input("force.measured", "N", "force of the actuator, by its load cell", **kilo)
    spool = c.input("spool.position", "m", "measured spool position", nominal=1e-3, display_unit="mm")
    v = c.input("piston.velocity", "m/s", "body velocity minus wheel velocity, positive extends the strut")

    # -------------------------------------------------------------------------------------- desired force, its rate

    period, sections = c.period, ["N", "N/s"] * 2
    filtered = c.state(
        "smoothing.filter", None, "sections of (1.16): force and rate of each", shape=(4,), rows=sections
    )
    sampled, held = smoothing_filter(float(c.sample_time or 0))
    A = c.constant("smoothing.A", sampled, None, "of (1.16)", rows=sections, columns=sections, source="001 (1.16)")
    B = c.constant("smoothing.B", held, None, "of (1.16)", rows=["1", "1/s"] * 2, source="001 (1.16)")
    c.update(filtered, A @ filtered + B * requested, source="001 (1.16), sampled for a held input")
    before = c.state("force.before", "N", "desired force one sample before", start=requested)
    c.update(before, requested)
    desired = ca.if_else(smooth, filtered[2], requested)
    desired_rate = ca.if_else(smooth, filtered[3], (requested - before) / period)

    # ------------------------------------------------------------------------------- first surface: pressure (1.10)

    area = p.cylinder.area
    alpha = 4.0 * p.fluid.bulk_modulus / p.cylinder.volume
    load = measured / area
    error = load - desired / area
    integral = c.state("error.integral", "Pa.s", "integral of the pressure error")
    surface = error + lambda_1 * integral
    flow = area * v + p.cylinder.leakage * load + (desired_rate / area - lambda_1 * error - eta_1 * surface) / alpha
    available = p.supply.pressure - ca.sign(flow) * load
    drop = ca.fmax(available, floor * p.supply.pressure)
    c.value("alpha", alpha, source="4 beta / V_t")
    c.value("load_pressure", load, source="P, 001 (1.7)")
    c.value("pressure_error", error, source="e")
    c.value("pressure_surface", surface, source="s_1, 001 (1.8)")
    c.value("desired_flow", flow, source="001 (1.10): flow that makes the surface decay")
    c.value("valve_drop", drop, source="P_s - sgn P of 001 (1.10), at least supply.least_drop of P_s")
    desired_spool = flow / (p.valve.discharge * p.valve.width * ca.sqrt(drop / p.fluid.density))

    # ---------------------------------------------------------------------- what section 1.3 does to the spool command

    for mode, (enabled, frequency) in notches.items():
        desired_spool = _notch(c, f"notch.{mode}.memory", desired_spool, enabled, frequency, width, left, period)
    earlier = c.state("average.earlier", "m", "desired spool positions, newest first", shape=(2,), start=desired_spool)
    c.update(earlier, ca.vertcat(desired_spool, earlier[0]))
    desired_spool = ca.if_else(average, ca.sum1(earlier) / 2.0, desired_spool)
    stroke = p.valve.max_voltage / p.valve.gain
    target = ca.fmin(ca.fmax(desired_spool, -stroke), stroke)

    # ----------------------------------------------------------------------------------- second surface: spool (1.12)

    last = c.state("spool.last", "m", "desired spool position one sample before", start=target)
    c.update(last, target)
    followed = c.state("rate.filter", "m", "state of the filter (1.13)", start=target)
    filter_rate = (target - followed) / rate_time
    c.update(followed, followed + period * filter_rate)
    target_rate = ca.if_else(numerical, (target - last) / period, filter_rate)
    tau = p.valve.time_constant
    voltage = p.valve.gain * (spool + tau * target_rate - eta_2 * tau * (spool - target))
    c.value("desired_spool", desired_spool, source="u_des of 001 (1.10), behind the notches and the mean (1.14)")
    c.value("desired_spool_rate", target_rate, source="001 (1.13) or (1.15)")
    c.value("voltage", voltage, source="001 (1.12)")
    limit = p.valve.max_voltage
    applied = ca.fmin(ca.fmax(voltage, -limit), limit)

    # The integral waits while a limit is active and it would push further into it: its rise lowers the command.
    upper = ca.logic_or(desired_spool > stroke, voltage > limit)
    lower = ca.logic_or(desired_spool < -stroke, voltage < -limit)
    waits = ca.logic_or(ca.logic_and(upper, error < 0), ca.logic_and(lower, error > 0))
    c.update(integral, integral + ca.if_else(waits, 0.0, period * error))

    # ------------------------------------------------------------------------------------------------------- outputs

    spool_limited = ca.fabs(desired_spool) > stroke
    voltage_limited = ca.fabs(voltage) > limit
    starved = available < drop
    c.output("valve.voltage", applied, "V", "command to the spool valve")
    c.output("force.smoothed", desired, "N", "desired force after the filter (1.16)", **kilo)
    c.output("force.error", measured - desired, "N", "measured minus smoothed desired force", nominal=100.0)
    c.output("spool.desired", target, "m", "desired spool position", nominal=1e-3, display_unit="mm")
    c.output(
        "spool.error", spool - target, "m", "measured minus desired spool position", nominal=1e-4, display_unit="mm"
    )
    c.output(
        "flow.desired", flow, "m3/s", "flow that the pressure surface requests", nominal=1e-4, display_unit="l/min"
    )
    saturated = ca.logic_or(ca.logic_or(spool_limited, voltage_limited), starved)
    c.output("saturated", saturated, None, "whether a limit of spool, voltage or supply is active", type=bool)
    c.output("valve.saturated", voltage_limited, None, "whether valve.voltage is at valve.max_voltage", type=bool)
    c.output("spool.saturated", spool_limited, None, "whether spool.desired is at the end of the stroke", type=bool)
    c.output(
        "supply.saturated",
        starved,
        None,
        "whether the load leaves less than supply.least_drop of the supply pressure",
        type=bool,
    )
    c.reference_input(
        {
            "force.desired": lambda t: 2000.0 if math.sin(2 * math.pi * 12.0 * t) >= 0 else -2000.0,
            "force.measured": lambda t: 1800.0 * math.sin(2 * math.pi * 12.0 * t - 0.9),
            "spool.position": lambda t: 5e-4 * math.cos(2 * math.pi * 12.0 * t - 0.9),
            "piston.velocity": lambda t: 0.05 * math.cos(2 * math.pi * 12.0 * t) if t < 0.15 else 1.2,
        }
    )
    return c


def _notch(
    c: Component, name: str, signal: Any, enabled: Any, frequency: Any, width: Any, left: Any, period: Any
) -> Any:
    """Second-order notch, bilinear and exact at its center; transposed direct form II."""
    g = ca.tan(math.pi * frequency * period)
    wide, narrow = width * g, width * left * g
    a0 = 1 + wide + g * g
    b0, b2 = (1 + narrow + g * g) / a0, (1 - narrow + g * g) / a0
    a1, a2 = 2 * (g * g - 1) / a0, (1 - wide + g * g) / a0
    # Starts as if the signal had always had its first value.
    memory = c.state(
        name, "m", "memory of the notch", shape=(2,), start=ca.vertcat((1 - b0) * signal, (b2 - a2) * signal)
    )
    out = b0 * signal + memory[0]
    c.update(memory, ca.vertcat(a1 * (signal - out) + memory[1], b2 * signal - a2 * out))
    return ca.if_else(enabled, out, signal)


_NOTES = (
    (
        "Wiring: force.measured and spool.position are outputs force and spool.position of a HydraulicActuator,"
        " piston.velocity is the suspension velocity of the car, the same that drives the actuator; valve.voltage goes"
        " to the actuator. force.desired comes from a controller at any slower rate, held in between."
    ),
    (
        "The controller's model of the actuator is in its parameters, from the same vehicle file as the actuator's."
        " Give other values to study its robustness. Too high a density or too small a valve makes the loop gain too"
        " high."
    ),
    (
        "force.desired passes the filter (1.16), sampled exactly for a held input. smoothing.enabled false bypasses it:"
        " then the force must be smooth already, since its rate is taken by difference."
    ),
    (
        "Variants of section 1.3: rate.numerical off replaces the difference (1.15) by the filter (1.13);"
        " average.enabled adds (1.14), 1.5 ms of delay, which quietens the command of a noisy load cell and costs most"
        " of the tracking at these gains; notch.heave_pitch and notch.roll attenuate the desired spool position about"
        " the modes of the body, and with it the flow that the moving piston needs: the force then follows far worse."
    ),
    (
        "Limits: the desired spool position ends at the stroke that valve.max_voltage gives, the voltage at"
        " valve.max_voltage, and the root in (1.10) at supply.least_drop of the supply pressure. Each has its flag; the"
        " integral waits at a limit."
    ),
    (
        "Road, friction and the car's own dynamics are disturbances to this controller. Left out: output redefinition,"
        " which the paper cites and does not specify."
    ),
)
