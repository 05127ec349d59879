"""Ride comfort during a run: absorbed power by both definitions, and ISO 2631-1.

Source: Donahue and Hedrick, equation (1.19), and ride-quality literature.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from build_fmus.component import Component
from fmu_sources.models.comfort import (
    ABSORBED_POWER_LIMIT,
    FEET_PER_METRE,
    HUMAN_RESPONSE,
    HUMAN_RESPONSE_NRMM,
    WEIGHTING_WK,
    Section,
    digital_sections,
)
from fmu_sources.registration import component

SAMPLE_TIME = 1e-3  # s
WINDOW = 1.0  # s, paper 001: peaks over single bumps
LONGEST_WINDOW = 3.0  # s, what the FMU has memory for


@component("RideComfort", "absorbed power and ISO 2631-1 (paper 001)")
def ride_comfort(name: str = "RideComfort", *, period: float = SAMPLE_TIME) -> Component:
    """Comfort figures of a vertical acceleration.

    The same numbers come from `fmu_sources.models.comfort` for a finished recording.

    `period`: sample time [s].
    """
    c = Component(
        name,
        kind="discrete",
        sample_time=period,
        description="Ride comfort: absorbed power, ISO 2631-1 weighted r.m.s. and vibration dose value",
        source="001 equation (1.19); ISO 2631-1:1997, 6.1, 6.3.2 and annex A (weighting Wk)",
        symbols=ca.MX,
        notes=_NOTES,
    )
    length = c.parameter(
        "window.length",
        WINDOW,
        "s",
        "length of the moving window of absorbed power",
        min=period,
        max=LONGEST_WINDOW,
        source="001: assumed for peaks over bumps",
    )
    limit = c.parameter(
        "absorbed_power.limit",
        ABSORBED_POWER_LIMIT,
        "W",
        "absorbed power that a driver bears for long",
        min=0.0,
        tunable=True,
        source="001 section 1.6",
    )
    az = c.input("body.az", "m/s2", "vertical acceleration of the body, or wherever comfort is assessed")

    felt = _filtered(c, "human_response", HUMAN_RESPONSE, FEET_PER_METRE * az, period)
    weighted = _filtered(c, "weighting", WEIGHTING_WK, az, period)
    felt_nrmm = _filtered(c, "human_response.nrmm", HUMAN_RESPONSE_NRMM, FEET_PER_METRE * az, period)
    power, power_nrmm = felt * felt, felt_nrmm * felt_nrmm
    window = _moving_mean(c, power, length, period)

    count = c.state("count", "1", "samples so far")
    energy = c.state("sum.power", None, "sum of the absorbed power")
    energy_nrmm = c.state("sum.power.nrmm", None, "sum of the absorbed power of the filter of third order")
    squares = c.state("sum.squares", None, "sum of the squares of the weighted acceleration")
    fourths = c.state("sum.fourths", None, "sum of its fourth powers")
    peak = c.state("peak", "W", "largest mean over the window before this sample")
    sums = {count: 1, energy: power, energy_nrmm: power_nrmm, squares: weighted**2, fourths: weighted**4}
    for state, term in sums.items():
        c.update(state, state + term)
    highest = ca.fmax(peak, window)
    c.update(peak, highest)

    c.output("absorbed_power", power, "W", "absorbed power: square of the human response")
    c.output("absorbed_power.window", window, "W", "mean absorbed power over the last window.length")
    c.output("absorbed_power.mean", (energy + power) / (count + 1), "W", "mean absorbed power since the start")
    c.output("absorbed_power.peak", highest, "W", "largest absorbed_power.window so far")
    c.output(
        "absorbed_power.above_limit",
        window > limit,
        None,
        "absorbed_power.window is above absorbed_power.limit",
        type=bool,
    )
    c.output(
        "absorbed_power.nrmm",
        power_nrmm,
        "W",
        "absorbed power by the filter of third order of the ride-quality literature",
    )
    c.output(
        "absorbed_power.nrmm.mean",
        (energy_nrmm + power_nrmm) / (count + 1),
        "W",
        "mean of absorbed_power.nrmm since the start",
    )
    c.output("iso2631.acceleration", weighted, "m/s2", "acceleration weighted with Wk of ISO 2631-1")
    c.output(
        "iso2631.rms",
        ca.sqrt((squares + weighted**2) / (count + 1)),
        "m/s2",
        "r.m.s. of iso2631.acceleration since the start",
    )
    dose = ca.sqrt(ca.sqrt((fourths + weighted**4) * period))
    c.output("vdv", dose, None, "fourth-power vibration dose value since the start [m/s1.75]")
    c.reference_input({"body.az": lambda t: 3.0 * math.sin(2 * math.pi * 4.0 * t) + math.sin(2 * math.pi * 17.0 * t)})
    return c


def _filtered(c: Component, name: str, sections: tuple[Section, ...], signal: Any, period: float) -> Any:
    """Digital sections in series, transposed direct form II, from rest."""
    for i, (b0, b1, b2, _, a1, a2) in enumerate(digital_sections(sections, 1 / period).tolist(), start=1):
        memory = c.state(f"{name}.section{i}", None, f"memory of section {i}", shape=(2,))
        out = b0 * signal + memory[0]
        c.update(memory, ca.vertcat(b1 * signal - a1 * out + memory[1], b2 * signal - a2 * out))
        signal = out
    return signal


def _moving_mean(c: Component, value: Any, length: Any, period: float) -> Any:
    """Mean of the last `length` [s], by a ring of as many samples; before the first one all were 0.

    The sum is carried along, and replaced by one taken afresh each time round, so that rounding does not pile up and a
    silent window has a mean of exactly 0.
    """
    most = round(LONGEST_WINDOW / period)
    n = ca.fmax(1, ca.fmin(most, ca.floor(length / c.period + 0.5)))
    ring = c.state("window.ring", None, "last values of the absorbed power", shape=(most,))
    place = c.state("window.place", "1", "place of the oldest value in the ring")
    carried = c.state("window.sum", None, "sum over the window")
    fresh = c.state("window.fresh", None, "sum of the values of this round")
    oldest = ring.get_nz(False, place)
    renewed = ca.MX(ring)
    renewed.set_nz(value, False, place)
    last = place + 1.5 > n
    total = ca.if_else(last, fresh + value, ca.fmax(0, carried + value - oldest))
    c.update(ring, renewed)
    c.update(place, ca.if_else(last, 0, place + 1))
    c.update(carried, total)
    c.update(fresh, ca.if_else(last, 0, fresh + value))
    return total / n


_NOTES = (
    (
        "Absorbed power is the square of the acceleration after the human response filter 12 s / (s2 + 30.02 s +"
        " 901.3). The filter takes ft/s2 (the paper prints m/s2): so its gain is 3 to 15 % below that of the"
        " established filter of absorbed power over 1 to 10 Hz, its power 6 to 28 %, while on m/s2 it would be a tenth."
        " Input and outputs of this FMU are SI."
    ),
    (
        "absorbed_power.nrmm is by that established filter, 14.5 s (s + 44) / ((s + 63) (s2 + 24 s + 750)) on ft/s2,"
        " which mobility models such as NRMM use. 6 W by one is not 6 W by the other: compare like with like."
    ),
    (
        "absorbed_power.window divides by the whole window from the start on, as if the vehicle had been at rest"
        " before; a window longer than the run therefore shows less than absorbed_power.mean. Judge single bumps by"
        " absorbed_power.peak, rough terrain by absorbed_power.mean."
    ),
    (
        "iso2631.rms and vdv use weighting Wk (vertical, seated or standing) with a multiplying factor of 1, for the"
        " one input. The standard judges the acceleration at the seat; that of the body differs from it by the seat."
        " Run the vehicle for as long as the judgment is meant to hold: both run from the start, the transient of the"
        " filters included."
    ),
    (
        "Digital filters: bilinear, each second-order section exact at its own frequency. Wk is within 0.2 dB of the"
        " analog weighting from 0.5 to 80 Hz (the standard allows 1 dB), the human response within 0.3 % in power up to"
        " 20 Hz."
    ),
    (
        "Wiring: body.az of any vehicle of this project. Every figure includes the sample at t; functions of the same"
        " name in fmu_sources.models.comfort give the same numbers for a recording."
    ),
)
