"""Random roads with the spectrum of ISO 8608, classes A to H.

The standard gives the displacement spectrum of one track, `Gd(n) = Gd(n0) (n / n0)^-2` with `n0` = 0.1 cycles/m,
and the geometric mean of `Gd(n0)` per class: 16e-6 m3 for A, four times as much for each next class. It does not say
how the tracks of the two sides go together. Here their phases agree, and the part of the spectrum that both share falls
with wave number: cross spectrum / `Gd` = `exp(-decay track n)`, which is 1 for waves that tilt no axle and 0 for
short ones. `decay` = 2 (assumed) is what the other synthetic road uses for its track of 1.82 m.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from build_fmus.component import Component
from fmu_sources.registration import component
from fmu_sources.roads.height_table import HeightTable, node_heights
from fmu_sources.roads.layout import RoadLayout
from fmu_sources.roads.road import Profile, road

CLASSES = "ABCDEFGH"
REFERENCE_WAVE_NUMBER = 0.1  # cycles/m, ISO 8608
CLASS_A = 16e-6  # m3, geometric mean of Gd(n0) of class A, ISO 8608
LOWEST, HIGHEST = 0.011, 2.83  # cycles/m, range of wave numbers of ISO 8608
LENGTH, STEP = 1400.0, 0.05  # m; 60 s at 80 km/h, and 7 nodes in the shortest wave
DECAY = 2.0
OFFROAD_CLASS = 4  # E: Gd(0.1) = 4096e-6 m3
OFFROAD_CONTACT = 0.25  # m, as on the test track of the same vehicle


def displacement_spectrum(n: Any, roughness: int) -> Any:
    """`Gd(n)` [m3] of class number `roughness` (0 for A) at wave numbers `n` [cycles/m]."""
    return CLASS_A * 4.0**roughness * (n / REFERENCE_WAVE_NUMBER) ** -2.0


def track_correlation(n: Any, track: float, decay: float = DECAY) -> Any:
    """Cross spectrum of left and right over `Gd` (square root of the coherence) at wave numbers `n` [cycles/m]."""
    return np.exp(-decay * track * n)


def sum_of_waves(waves: np.ndarray) -> np.ndarray:
    """Heights at 2 (m + 1) points over one period, from waves (m,): complex amplitudes.

    The k-th has k + 1 waves in the period.
    """
    count = 2 * (len(waves) + 1)
    return np.asarray(np.fft.irfft(np.concatenate([[0], count / 2 * waves, [0]]), count))


def declare_class(c: Component, roughness: int) -> Any:
    """Declare the parameter that chooses the class, by default number `roughness`, 0 for A."""
    text = "class of ISO 8608: 0 A, 1 B, 2 C ... 7 H"
    return c.parameter("class", roughness, None, text, min=0, max=len(CLASSES) - 1, source="ISO 8608")


def iso8608_table(track: float, seed: int = 1, decay: float = DECAY, contact: float = 0.0) -> HeightTable:
    """Heights of both tracks of a class A road, periodic over its length, rounded to 1e-7 m.

    With `contact` [m] the heights are means over that length, as a tire's contact takes them.

    Two waves with fixed amplitude and random phase at each multiple of 1 / `LENGTH`: one lifts both sides, the other
    lifts one side and lowers the other.
    """
    if track < 0 or decay < 0 or contact < 0:
        raise ValueError(f"track {track:g} m, decay {decay:g} and contact {contact:g} m must not be negative")
    count = round(LENGTH / STEP)
    n = np.arange(1, count // 2) / LENGTH
    inside = (n >= LOWEST) & (n <= HIGHEST)
    amplitude = np.where(inside, np.sqrt(2 * displacement_spectrum(n, 0) / LENGTH), 0) * np.sinc(n * contact)
    phases = 2 * np.pi * np.random.default_rng(seed).random((2, len(n)))
    shared = track_correlation(n, track, decay)
    both, opposite = (
        sum_of_waves(amplitude * np.sqrt((1 + sign * shared) / 2) * np.exp(1j * phase))
        for sign, phase in zip((1, -1), phases, strict=True)
    )
    tracks = np.round([both + opposite, both - opposite], 7)
    left, right = np.column_stack([tracks, tracks[:, :1]])
    return HeightTable(0.0, STEP, left, right)


@component("RoadOffroad{v}", "off-road terrain under the HMMWV (paper 001)", of="ride_car_hmmwv", scanned=True)
@component("RoadOffroad{v}", "off-road terrain as these sensors see it", of="own_sensors", scanned=True)
def road_offroad(layout: RoadLayout, name: str = "RoadOffroad") -> Component:
    """The off-road terrain of the HMMWV of paper 001 as read here: class E, smoothed by the tires' contact."""
    return road_iso8608(layout, name, roughness=OFFROAD_CLASS, contact=OFFROAD_CONTACT)


@component("RoadIso8608{s}", "random road, ISO 8608 class A to H", of="sedan")
def road_iso8608(
    layout: RoadLayout,
    name: str = "RoadIso8608",
    *,
    seed: int = 1,
    decay: float = DECAY,
    roughness: int = 2,
    contact: float = 0.0,
) -> Component:
    """Random road, ISO 8608 class A to H as a parameter that starts at number `roughness` (0 for A).

    `seed`, `decay` and the `contact` length [m] over which the tires average are build options.
    """
    track = layout.track
    table = iso8608_table(track, seed, decay, contact)
    nodes = len(table.left) - 1
    smoothed = (f"Heights are means over {contact:g} m of contact (assumed), which removes waves {contact:g} m long.",)

    def profile(c: Component) -> Profile:
        number = declare_class(c, roughness)
        flat = c.parameter("flat", 10.0, "m", "flat stretch at the start", min=0.0, max=LENGTH, source="assumed")
        ramp = c.parameter(
            "ramp",
            20.0,
            "m",
            "stretch behind it over which the heights grow to full size",
            min=0.0,
            max=LENGTH,
            source="assumed",
        )
        offset = c.parameter(
            "offset",
            0.0,
            "m",
            "position on the profile where this road starts",
            min=0.0,
            max=LENGTH - 10.0,
            source="own",
        )
        tabled = node_heights(c, table)
        step = c.constant("node.step", STEP, "m", "distance between nodes", source="own")
        least = c.constant("least.ramp", 1e-6, "m", "by which at least the way on the ramp is divided", source="own")
        skipped = ca.floor(offset / step + 1e-6)

        def height(node: Any, side: str) -> Any:
            grown = ca.fmax(0, ca.fmin(1, (node * step - flat) / ca.fmax(ramp, least)))
            return ca.power(2, number) * grown * tabled(node + skipped, side)

        return Profile(height, nodes - skipped, step)

    return road(
        name,
        layout,
        profile,
        description=f"Random road, ISO 8608 class A to H, {LENGTH:g} m long, seed {seed}",
        source="ISO 8608: spectrum and geometric means of the classes; what left and right share is assumed",
        symbols=ca.MX,
        notes=(
            (
                f"Heights are sums of waves {1 / HIGHEST:.2f} to {1 / LOWEST:.0f} m long with random phases and the"
                f" spectrum Gd(n) = Gd(0.1) (n / 0.1)^-2 (n in cycles/m), Gd(0.1) = {CLASS_A * 1e6:g}e-6 m3 times 4 to"
                " the power class, held at nodes 0.05 m apart. Linear interpolation between them takes 7 % of the"
                " height of the very shortest waves, less than 1 % of those above 1 m."
            ),
            (
                f"Left and right: cross spectrum / Gd = exp(-{decay:g} track n), here with a track of {track:g} m; long"
                " waves lift both sides, short ones each side by itself. ISO 8608 gives no such number: it is assumed."
            ),
            (
                "Another class is the same profile at another scale. Another seed is another FMU"
                f" (road_iso8608(seed=...)); without building, offset starts the run elsewhere on these {LENGTH:g} m:"
                " stretches that do not overlap are as good as independent."
            ),
            *(smoothed if contact else ()),
            "The road is flat for the first flat meters, then grows over ramp meters, so that a run starts at rest.",
        ),
        reference_start=40.0,
    )
