"""Random roads of ISO 8608 whose class, seed and length are parameters: each instance computes its own profile.

The spectrum, and what left and right share, are those of `fmu_sources.roads.iso8608`, whose roads are tables made
when they are built. So a sweep over roads (`--vary road.seed=1:1000`) needs one FMU.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from build_fmus.component import Component
from fmu_sources.registration import component
from fmu_sources.roads.iso8608 import CLASS_A, DECAY, HIGHEST, LOWEST, REFERENCE_WAVE_NUMBER, STEP, declare_class
from fmu_sources.roads.layout import RoadLayout
from fmu_sources.roads.road import Profile, road

NODES = (4096, 32768)  # periods from 205 to 1638 m
LENGTH, SHORTEST, LONGEST = 200.0, 1.0, 1600.0  # m


@component("RoadRandom{s}", "random road, ISO 8608: class, seed and length are parameters", of="hmmwv_modified")
def road_random(
    layout: RoadLayout,
    name: str = "RoadRandom",
    *,
    roughness: int = 2,
    nodes: tuple[int, int] = NODES,
    decay: float = DECAY,
) -> Component:
    """Random road of ISO 8608 with class, seed, length and more as parameters.

    The class starts at number `roughness`, 0 for A. `nodes` bounds the memory of an instance, 16 bytes for each of
    the larger number, and with it the length. `decay`: start value of how fast what both tracks share falls with wave
    number.
    """
    longest = min(LONGEST, (nodes[1] - 1) * STEP)

    def profile(c: Component) -> Profile:
        number = declare_class(c, roughness)
        seed = c.parameter("seed", 1, None, "which road", min=0, max=2**31 - 1, source="option")

        def stretch(name: str, start: float, text: str, *, least: float = 0.0) -> Any:
            return c.parameter(name, start, "m", text, min=least, max=longest, source="assumed")

        length = stretch("length", min(LENGTH, longest), "length of the road", least=SHORTEST)
        flat = stretch("flat", 10.0, "flat stretch at the start")
        ramp = stretch("ramp", 20.0, "stretch behind it over which the heights grow to full size")
        fall = c.parameter(
            "decay",
            decay,
            "1",
            "how fast what left and right share falls with wave number: exp(-decay track n)",
            min=0.0,
            max=1e3,
            source="assumed",
        )
        track = c.parameter(
            "track", layout.track, "m", "distance between left and right", min=0.0, max=50.0, source="vehicle file"
        )
        contact = c.parameter(
            "contact",
            0.0,
            "m",
            "length over which tires average the heights, 0 for none",
            min=0.0,
            max=10.0,
            source="assumed",
        )
        level = c.constant("level", CLASS_A, "m3", "Gd(n0) of class A", source="ISO 8608")
        reference = c.constant("reference", REFERENCE_WAVE_NUMBER, "1/m", "wave number n0", source="ISO 8608")
        step = c.constant("node.step", STEP, "m", "distance between nodes", source="own")
        least = c.constant("least.ramp", 1e-6, "m", "by which at least the way on the ramp is divided", source="own")

        def spectra(n: Any) -> tuple[Any, Any]:
            half_turn = ca.pi * n * contact
            mean = ca.if_else(half_turn > 1e-9, ca.sin(half_turn) / ca.fmax(half_turn, 1e-9), 1.0)
            spectrum = level * ca.power(4, number) * (reference / n) ** 2 * mean**2
            shared = ca.exp(-fall * track * n)
            return spectrum * (1 + shared) / 2, spectrum * (1 - shared) / 2

        left, right = c.random_profiles(
            "road", seed=seed, length=length, spectra=spectra, step=STEP, nodes=nodes, wave_numbers=(LOWEST, HIGHEST)
        )
        tracks = {"left": left, "right": right}

        def height(node: Any, side: str) -> Any:
            return ca.fmax(0, ca.fmin(1, (node * step - flat) / ca.fmax(ramp, least))) * tracks[side][node]

        return Profile(height, ca.fmax(1, ca.floor(length / step + 1e-6)), step)

    return road(
        name,
        layout,
        profile,
        description="Random road, ISO 8608 class A to H, with seed and length as parameters",
        source="ISO 8608: spectrum and geometric means of the classes; what left and right share is assumed",
        symbols=ca.MX,
        notes=(
            (
                f"Heights are sums of waves {1 / HIGHEST:.2f} to {1 / LOWEST:.0f} m long with random phases and the"
                f" spectrum Gd(n) = Gd(0.1) (n / 0.1)^-2 (n in cycles/m), Gd(0.1) = {CLASS_A * 1e6:g}e-6 m3 times 4 to"
                f" the power class, held at nodes {STEP:g} m apart; waves are multiples of 1 / period apart, and the"
                " period is the first of 205, 410, 819, 1638 m that covers the length. So another length can be"
                " another road of the same seed."
            ),
            (
                "Each instance computes its profile when it is initialized, and again when a parameter was changed"
                " before the start: half a millisecond for 200 m, six for 1600 m. Whole numbers make the phases"
                " (SplitMix64), and the FMU's own mathematics the rest, so a seed is the same road on every platform. A"
                " saved state has the parameters, not the profile, which follows from them."
            ),
            (
                f"Left and right: cross spectrum / Gd = exp(-decay track n), here with a track of {layout.track:g} m;"
                " long waves lift both sides, short ones each side by itself. ISO 8608 gives no such number: it is"
                " assumed. contact takes means over that length."
            ),
            "The road is flat for the first flat meters, then grows over ramp meters, so that a run starts at rest.",
        ),
        reference_start=40.0,
    )
