"""Pairs of random profiles that a component computes from its parameters: declaration, C code, and the same in numpy.

A road whose seed is a parameter is one. Left and right have one spectrum; how much of it they share depends on wave
number. What is declared are the power spectral densities of both parts, as expressions of wave number and parameters;
the C code is in `runtime/random_profiles.c`. The profiles lie beside the state of an instance: they follow from the
parameters, which a saved state has.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

SOURCES, HEADERS = ("random_profiles.c",), ("random_profiles.h",)
FUNCTIONS = {"profile_settings": "seed and length", "spectra": "spectra at wave number t"}
"""Functions of a component, in C and in Python, from which its profiles come, and what they give."""
_GOLDEN = 0x9E3779B97F4A7C15


@dataclass(frozen=True, eq=False)
class RandomProfiles:
    """Declaration of a pair.

    Attributes:
        name: begins the names of both in the C code.
        least, most: nodes, powers of two: the smallest number that covers the length is taken.
        step: distance between nodes [m].
        lowest, highest: wave numbers [cycles/m] that there are.
        wave_number: symbol in `spectra`.
        settings: seed and length [m], a column of expressions of parameters.
        spectra: one-sided power spectral densities [m3] of half the sum and half the difference of left and right, a
            column.
        symbol: the left profile at `most` nodes, then the right one [m]. Nodes beyond the length mean nothing.
    """

    name: str
    least: int
    most: int
    step: float
    lowest: float
    highest: float
    wave_number: Any
    settings: Any
    spectra: Any
    symbol: Any

    def nodes(self, length: float) -> int:
        """How many nodes a profile of a length [m] has, in its period."""
        n = self.least
        while n < self.most and (n - 1) * self.step < length:
            n *= 2
        return n

    def waves(self, length: float) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the waves of a profile of a length [m], and their wave numbers [cycles/m]."""
        n = self.nodes(length)
        m = np.arange(1, n // 2)
        k = m / (n * self.step)
        inside = (k >= self.lowest) & (k <= self.highest)
        return m[inside], k[inside]

    def evaluate(self, settings: np.ndarray, spectra: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """What `symbol` stands for, by numpy: a path of its own to the numbers of the C code, up to rounding.

        Args:
            settings: seed and length [m].
            spectra: of wave numbers (k,), an array (2, k).
        """
        seed, length = float(settings[0]), float(settings[1])
        n = self.nodes(length)
        m, k = self.waves(length)
        amplitude = np.sqrt(2 * spectra(k) / (n * self.step))
        first = phases(int(seed), 2 * m), phases(int(seed), 2 * m + 1)
        both, opposite = (a * np.exp(1j * p) for a, p in zip(amplitude, first, strict=True))
        result = np.zeros((2, self.most))
        for side, lines in enumerate((both + opposite, both - opposite)):
            spectrum = np.zeros(n // 2 + 1, dtype=complex)
            spectrum[m] = lines * (n / 2)
            result[side, :n] = np.fft.irfft(spectrum, n)
        return result.ravel()


def phases(seed: int, k: np.ndarray) -> np.ndarray:
    """Phases [rad] of waves `k` (any shape) of a seed: numbers of SplitMix64 (Steele, Lea, Flood 2014)."""
    sequence = _mixed(np.array([seed], np.uint64) + np.uint64(_GOLDEN))
    number = _mixed(sequence + (np.asarray(k, np.uint64) + np.uint64(1)) * np.uint64(_GOLDEN))
    return 2 * np.pi * (number >> np.uint64(11)).astype(float) / 2.0**53


def _mixed(z: np.ndarray) -> np.ndarray:
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def code(of: RandomProfiles, n_parameters: int, place: int) -> str:
    """C code of `profiles(at)`, which gives the values of the symbol.

    They are stored at `place` of the work memory of the functions.
    """
    settings, spectra = FUNCTIONS
    return f"""static const real *profiles(const FmuArguments *at) {{
    static const FmuProfiles of = {{
        .least = {of.least}, .most = {of.most}, .step = {of.step!r}, .lowest = {of.lowest!r}, .highest = {of.highest!r},
        .n_parameters = {n_parameters}, .settings = {settings}, .spectra = {spectra},
    }};
    return fmu_profiles(&of, at, at->w + {place});
}}
"""


def memory(of: RandomProfiles, n_parameters: int) -> int:
    """Numbers of memory of an instance."""
    return 1 + n_parameters + 2 * of.most
