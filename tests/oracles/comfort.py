"""Weighting filters of ride comfort in the frequency domain."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fmu_sources.models.comfort import Section


def analog_response(sections: tuple[Section, ...], frequency_hz: npt.ArrayLike) -> npt.NDArray[np.complex128]:
    """Complex gain of the analog sections in series at frequencies [Hz]."""
    s = 2j * np.pi * np.asarray(frequency_hz, dtype=float)
    gain = np.ones_like(s)
    for section in sections:
        gain = gain * np.polyval(section.b[::-1], s) / np.polyval(section.a[::-1], s)
    return gain
