"""The moving plate of the quarter-car bench: bumps and random motion over time (paper 002, Figures 6 and 10)."""

from __future__ import annotations

from math import pi

import casadi as ca
import numpy as np

from build_fmus.component import Component
from fmu_sources.registration import component

HEIGHT, DURATION = 0.02, 0.5  # m, 002 section V; s, one of the two durations of the experiment, assumed
SEED = 1
LINES = 40
LOWEST, HIGHEST = 0.2, 8.0  # Hz, of the random motion, assumed
RMS = 0.004  # m, assumed: keeps the plate within its 20 mm


@component("RoadBenchBump", "bump of the quarter-car bench over time")
def road_bench_bump(name: str = "RoadBenchBump") -> Component:
    """A single bump, one period of (1 - cos)/2."""
    c = Component(
        name,
        kind="discrete",
        sample_time=1e-3,
        description="Bump of the quarter-car bench over time (paper 002)",
        source="002 section V: 20 mm, one period; shape (1 - cos)/2 and durations assumed",
        notes=(
            (
                "height/2 (1 - cos(2 pi (t - start)/duration)) once, 0 before and after; road.rate is its exact"
                " derivative. A function of time: the bench stands still and the plate moves."
            ),
            "Wiring: both outputs go to the inputs of the same name of QuarterCarBench.",
        ),
    )
    height = c.parameter(
        "bump.height", HEIGHT, "m", "height of the bump", min=-0.1, max=0.1, display_unit="mm", source="002 section V"
    )
    start = c.parameter("bump.start", 0.0, "s", "when the bump begins", min=0.0, max=1e6, source="assumed")
    duration = c.parameter("bump.duration", DURATION, "s", "duration of the bump", min=0.01, max=1e3, source="assumed")
    part = (c.time - start) / duration
    inside = ca.logic_and(part >= -1e-9, part < 1 - 1e-9)
    wave = ca.if_else(inside, part, 0)
    c.output("road.height", height * ca.sin(pi * wave) ** 2, "m", "height of the plate", display_unit="mm")
    c.output("road.rate", height * pi / duration * ca.sin(2 * pi * wave), "m/s", "rate of the plate's height")
    return c


@component("RoadBenchRandom", "random motion of the bench's plate over time")
def road_bench_random(name: str = "RoadBenchRandom", *, seed: int = SEED) -> Component:
    """Random motion: sines with phases from `seed` and the displacement spectrum f^-2 of a road passed at speed."""
    c = Component(
        name,
        kind="discrete",
        sample_time=1e-3,
        description=f"Random motion of the plate of the quarter-car bench, seed {seed} (paper 002)",
        source="002 section V: random road; spectrum, band and size assumed",
        notes=(
            (
                f"{LINES} sines from {LOWEST:g} to {HIGHEST:g} Hz, equally spaced on a logarithmic scale with a little"
                " jitter, with amplitudes of a displacement spectrum f^-2, and random phases; road.rate is the exact"
                " derivative of road.height. Over the first ramp seconds the motion grows from rest."
            ),
            "Another seed is another FMU (road_bench_random(seed=...)); offset starts elsewhere in the same motion.",
            "Wiring: both outputs go to the inputs of the same name of QuarterCarBench.",
        ),
    )
    rms = c.parameter("rms", RMS, "m", "rms of the height", min=0.0, max=0.1, display_unit="mm", source="assumed")
    ramp = c.parameter("ramp", 0.5, "s", "time over which the motion grows", min=1e-3, max=1e3, source="assumed")
    offset = c.parameter("offset", 0.0, "s", "where in the motion this one starts", min=0.0, max=1e5, source="own")
    random = np.random.default_rng(seed)
    edges = np.geomspace(LOWEST, HIGHEST, LINES + 1)
    f = edges[:-1] + random.random(LINES) * np.diff(edges)
    amplitude = np.sqrt(np.diff(edges)) / f  # a line stands for its band
    amplitude *= np.sqrt(2 / np.sum(amplitude**2))  # rms 1
    rate = c.constant("lines", 2 * pi * f, "1/s", "angular frequencies of the lines", source="002, assumed")
    rates = c.constant("rates", amplitude * 2 * pi * f, "1/s", "of their sizes", source="002, assumed")
    phase = rate * (c.time + offset) + ca.DM(2 * pi * random.random(LINES))
    wave, slope = ca.dot(ca.DM(amplitude), ca.sin(phase)), ca.dot(rates, ca.cos(phase))
    part = ca.fmax(0, ca.fmin(1, c.time / ramp))
    grown, growing = ca.sin(pi / 2 * part) ** 2, ca.if_else(part < 1, pi / 2 / ramp * ca.sin(pi * part), 0)
    c.output("road.height", rms * grown * wave, "m", "height of the plate", display_unit="mm")
    c.output("road.rate", rms * (grown * slope + growing * wave), "m/s", "rate of the plate's height")
    return c
