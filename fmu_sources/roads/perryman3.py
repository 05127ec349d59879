"""Synthetic stand-in for the Perryman 3 course.

The course is not public. What is: its excitation is broadband up to 50 Hz with large peaks from 0.5 to 3 Hz at 40 km/h
(paper 000), and it is neither linear, Gaussian nor stationary (Chaika, Gorsich, Sun 2004). The recipe below is assumed
to fit that; results on this road are results on a road of that kind, not on the course.
"""

from __future__ import annotations

import numpy as np

from build_fmus.component import Component
from fmu_sources.registration import component
from fmu_sources.roads.height_table import HeightTable, road_from_table
from fmu_sources.roads.layout import RoadLayout
from fmu_sources.roads.road import NODE_STEP

LENGTH = 220.0  # m, covers runs of 150 m with margin
FLAT, RAMP = 10.0, 10.0  # m, flat start and the stretch over which the heights grow to their full size
RMS = 0.038  # m, of both tracks behind the ramp
LINES = 400
SEED = 3


def perryman3_table(roll_off: float = 0.0) -> HeightTable:
    """Heights of both tracks, rounded to 1e-6 m so that they are the same numbers on every machine.

    Above `roll_off` [cycles/m] the spectrum falls two orders steeper; 0: nowhere.
    """
    x = np.arange(round(LENGTH / NODE_STEP) + 1) * NODE_STEP
    n = np.geomspace(0.03, 4.0, LINES)  # cycles/m
    psd = (1 + 3 * np.exp(-((np.log(n / 0.12) / 0.35) ** 2))) / (1 + (n / 0.1) ** 2)  # displacement, any scale
    if roll_off:
        psd /= 1 + (n / roll_off) ** 2
    amplitude = np.sqrt(2 * psd * np.gradient(n))
    common, own = 2 * np.pi * np.random.default_rng(SEED).random((2, LINES))
    coherence = np.exp(-3.64 * n)  # of right to left

    left, other = (np.cos(2 * np.pi * np.outer(x, n) + phase) for phase in (common, own))
    envelope = 1 + 0.3 * np.sin(2 * np.pi * x / 70 + 1)
    tracks = np.stack(
        [left @ amplitude, left @ (coherence * amplitude) + other @ (np.sqrt(1 - coherence**2) * amplitude)]
    )
    tracks *= envelope
    full = x >= FLAT + RAMP
    tracks *= RMS / np.sqrt(np.mean(tracks[:, full] ** 2))
    tracks *= np.clip((x - FLAT) / RAMP, 0, 1)
    left, right = np.round(tracks, 6)
    return HeightTable(0.0, NODE_STEP, left, right)


@component("RoadPerryman3{s}", "synthetic stand-in for the Perryman 3 test course", of="hmmwv_modified")
def road_perryman3(layout: RoadLayout, name: str = "RoadPerryman3", roll_off: float = 0.0) -> Component:
    """Rough cross-country road, 220 m, synthetic; `roll_off` as in `perryman3_table`."""
    return road_from_table(
        perryman3_table(roll_off),
        layout,
        name,
        description="Synthetic stand-in for the Perryman 3 course (the measured profile is not public)",
        source="spectrum, coherence and size assumed after 000 and Chaika, Gorsich, Sun (2004)",
        notes=(
            "This road is synthetic. The measured Perryman 3 profile is not public; published are only its rough "
            "spectrum and that it is neither Gaussian nor stationary. The heights are a sum of 400 waves 0.25 to 33 m "
            "long with fixed random phases, partly common to both tracks, with an amplitude that swells along the "
            "road, 38 mm rms. The first 10 m are flat, the next 10 m a transition.",
        ),
    )
