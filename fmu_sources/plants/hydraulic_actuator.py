"""Electro-hydraulic actuator: cylinder behind a four-way spool valve, with bypass (paper 001, equations (1.3), (1.4)).

With load pressure P (the pressure difference across the piston) and spool position u,

    dP/dt   = alpha (Q - Q_bypass - C_tm P - A_p v),    F = A_p P,    alpha = 4 beta / V_t
    Q       = C_d1 w u root(P_s - sgn(u) P) / sqrt(rho)
    Q_bypass = C_d2 a root(2 P) / sqrt(rho)
    tau du/dt = V/k - u

`root` is the odd square root `root(p) = p / (p^2 + d^2)^(1/4)`: where the paper's root has no real value (a load
pressure above the supply's) the flow turns round, as it does in the orifice, and its slope is finite at zero.

Each flow times its pressure drop is a loss, so that with the energy of compression `E = P^2 / (2 alpha)`

    P_s Q_supply = F v + loss_valve + loss_bypass + loss_leakage + dE/dt
"""

from __future__ import annotations

from math import pi, sin
from typing import Any

import casadi as ca

from build_fmus.component import Component
from fmu_sources.registration import component
from fmu_sources.vehicles import Actuator, declare


@component(
    "HydraulicActuator{v}", "electro-hydraulic actuator (paper 001)", of="actuator_hmmwv actuator_hmmwv_physical"
)
def hydraulic_actuator(vehicle: Actuator, name: str = "HydraulicActuator") -> Component:
    """Actuator of one wheel. Force positive extends the strut; extension (`piston.velocity` > 0) lowers the force."""
    c = Component(
        name,
        kind="continuous",
        description=f"Electro-hydraulic actuator with spool and bypass valve: {vehicle.name}",
        source="001 equations (1.3), (1.4), appendix 1.C",
        solver="ros2",
        solver_step=2.5e-4,
        exchange_step=5e-4,
        notes=_NOTES,
    )
    p = declare(c, vehicle)
    running = c.parameter(
        "supply.running",
        True,
        None,
        "whether the pump runs; off: no supply pressure, the spool goes to valve.null_opening",
        tunable=True,
        source="build option",
    )
    limited = c.parameter(
        "supply.limited",
        False,
        None,
        "whether the pump delivers no more than supply.flow_limit",
        tunable=True,
        source="build option; the published runs are without the limit",
    )

    voltage = c.input("valve.voltage", "V", "command of the spool valve, positive extends the strut; saturates")
    opening = c.input("bypass.area", "m2", "opening of the bypass valve", min=0.0, nominal=1e-4)
    v = c.input("piston.velocity", "m/s", "body velocity minus wheel velocity, positive extends the strut")

    load = c.state(
        "load_pressure",
        "Pa",
        "pressure difference across the piston, positive extends the strut",
        output=True,
        nominal=1e7,
        display_unit="bar",
    )
    spool = c.state(
        "spool.position",
        "m",
        "spool position, positive extends the strut",
        output=True,
        nominal=1e-3,
        start=ca.if_else(running, 0.0, p.valve.null_opening),
        display_unit="mm",
    )

    # ---------------------------------------------------------------------------------------------------------- spool

    limit = p.valve.max_voltage
    target = ca.if_else(running, ca.fmin(ca.fmax(voltage, -limit), limit) / p.valve.gain, p.valve.null_opening)
    c.value("spool_target", target, source="k v of 001 (1.4), within the voltage limit")
    c.derivative(spool, (target - spool) / p.valve.time_constant, source="001 (1.4)")

    # ---------------------------------------------------------------------------------------------------------- flows

    def root(pressure: Any) -> Any:
        return pressure / ca.sqrt(ca.sqrt(pressure**2 + p.valve.smoothing**2))

    # Parts of the two spool halves, so that everything is continuous where the spool crosses its center.
    supply = ca.if_else(running, p.supply.pressure, 0.0)
    gradient = p.valve.discharge * p.valve.width / ca.sqrt(p.fluid.density)
    extending = gradient * ca.fmax(spool, 0.0) * root(supply - load)  # from the pump
    retracting = gradient * ca.fmax(-spool, 0.0) * root(supply + load)
    capped = limited * running  # an idle valve passes fluid from chamber to chamber, which no pump limits
    extending, retracting = (ca.if_else(capped, ca.fmin(q, p.supply.flow_limit), q) for q in (extending, retracting))
    valve = extending - retracting
    drawn = extending + retracting
    bypass = p.bypass.discharge * opening * ca.sqrt(2.0 / p.fluid.density) * root(load)
    leakage = p.cylinder.leakage * load

    stiffness = 4.0 * p.fluid.bulk_modulus / p.cylinder.volume  # alpha [N/m5]
    c.value("valve_gradient", gradient, source="C_d1 w / sqrt(rho) of 001 (1.3)")
    c.value("leakage", leakage, source="C_tm P_L of 001 (1.3)")
    c.value("oil_stiffness", stiffness, source="alpha of 001 (1.3), 4 beta / V_t")
    rate = stiffness * (valve - bypass - leakage - p.cylinder.area * v)
    c.derivative(load, rate, source="001 (1.3), divided by A_p; square roots smoothed")

    # -------------------------------------------------------------------------------------------------------- outputs

    force = p.cylinder.area * load
    flow: dict[str, Any] = {"unit": "m3/s", "nominal": 1e-4, "display_unit": "l/min"}
    power: dict[str, Any] = {"unit": "W", "nominal": 1e3, "display_unit": "kW"}
    c.output(
        "force", force, "N", "force, positive lifts the body and pushes the wheel down", nominal=1e3, display_unit="kN"
    )
    c.value("flow_out_of_pump_extending", extending, source="first term of 001 (1.3), spool u_1 > 0")
    c.value("flow_out_of_pump_retracting", retracting, source="first term of 001 (1.3), spool u_1 < 0")
    c.output("flow", drawn, description="flow drawn from the supply; negative: a load drives fluid back", **flow)
    c.output("power", supply * drawn, description="power drawn from the supply", **power)
    c.output(
        "valve.saturated", ca.fabs(voltage) > limit, None, "whether the command exceeds valve.max_voltage", type=bool
    )
    c.output("valve.flow", valve, description="flow through the spool valve into the extending chamber", **flow)
    c.output(
        "bypass.flow",
        bypass,
        description="flow through the bypass valve out of the extending chamber",
        source="second term of 001 (1.3)",
        **flow,
    )
    c.output("piston.power", force * v, description="power that the piston gives to the car", **power)
    c.output("loss.valve", supply * drawn - load * valve, description="power lost in the spool valve", **power)
    c.output("loss.bypass", load * bypass, description="power lost in the bypass valve", **power)
    c.output("loss.leakage", load * leakage, description="power lost by leakage", **power)
    c.output("stored_energy", load**2 / (2.0 * stiffness), "J", "energy of the compressed fluid")

    # --------------------------------------------------------------------------------- stiffest points, reference run

    c.operating_point("stall", {"load_pressure": vehicle.supply.pressure.value, "spool.position": _stroke(vehicle)})
    c.operating_point("bypass", {"bypass.area": 5e-4})
    c.reference_input(
        {
            "valve.voltage": lambda t: 12.0 if 0.06 < t < 0.075 else 2.0 * sin(2 * pi * 20.0 * t),
            "bypass.area": lambda t: 2e-5 if 0.04 < t < 0.055 else 0.0,
            "piston.velocity": lambda t: 0.1 * sin(2 * pi * 12.0 * t),
        }
    )
    return c


def _stroke(vehicle: Actuator) -> float:
    return vehicle.valve.max_voltage.value / vehicle.valve.gain.value


_NOTES = (
    (
        "Wiring: piston.velocity is the suspension velocity of the car (body minus wheel), force goes to the car's"
        " force input. The oil column is a spring of A_p^2 4 beta / V_t, 44 MN/m, between body and wheel: exchange at"
        " 0.5 ms or less, and let the car advance before the actuator (Gauss-Seidel). Advanced side by side (Jacobi)"
        " the pair diverges at 0.5 and 1 ms."
    ),
    (
        "The command saturates at valve.max_voltage; valve.saturated says so. A spool at its center closes the"
        " cylinder: only leakage lets the piston move, the strut is nearly locked."
    ),
    (
        "Pump off (supply.running false): supply pressure 0, and the spool rests at valve.null_opening, which makes the"
        " actuator a damper. This is the passive car of paper 001."
    ),
    (
        "Pump flow: without supply.limited the supply holds its pressure at any flow, as in the published runs. With it"
        " the pump delivers supply.flow_limit at most, so its pressure sags where the valve could pass more; power"
        " still counts the full supply pressure, and the difference appears in loss.valve."
    ),
    (
        "The square roots of the orifices are smoothed below valve.smoothing, so that all derivatives are finite. A"
        " load pressure above the supply pressure drives fluid back into the supply: flow and power are negative then."
    ),
    (
        "Fluid: the paper computes with a density of 3500 kg/m3. HydraulicActuatorPhysical has 850, and twice the flow"
        " for the same voltage."
    ),
    (
        "Model Exchange: all forces and flows are continuous, with kinks where the spool crosses its center and where"
        " command and pump saturate; CVode needs no events there. It does need the inputs read wherever derivatives are"
        " evaluated, or held with an event at each change: in a tool that does neither the force is off by some percent"
        " of its range at any tolerance."
    ),
    (
        "Left out: cavitation, end stops, friction of the piston, dynamics of pump and lines, output redefinition"
        " (cited, not specified, by the paper)."
    ),
)
