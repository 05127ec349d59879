"""Synthetic courses with the roughness of a proving ground's RMS courses.

Absorbed power and the 6 W speed are judged on them.

Three courses of a proving ground in Michigan, detrended, of nominally 1, 2 and 4 inches rms and 1000 ft long, were
measured; they are data of others. Here are Gaussian profiles of the same detrended rms and spectrum: sums of waves with
random amplitudes and phases, whose mean squares follow the fitted spectrum, brought to exactly the rms. The spectrum
was fitted to each course by maximum likelihood (Whittle) of its periodogram from 0.015 to 9 cycles/m, straight between
`KNOTS` on logarithmic scales; band averages of the measured course are within 20 % of it.

The measured courses of 2 and 4 inches are nearly Gaussian too (kurtosis 3.5 and 2.9); that of 1 inch is not (5.1): it
has single bumps of five times its rms, which these profiles lack.

The measured courses are the same left and right (`alike`). How the sides of such ground differ was not measured
there: the other choice has the correlation that the random road of `fmu_sources.roads.iso8608` assumes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from build_fmus.base.checks import whole_number
from fmu_sources.roads.enveloping import rolled
from fmu_sources.roads.iso8608 import sum_of_waves, track_correlation

INCH = 0.0254  # m
LENGTH, STEP = 304.8, 0.05  # m: 1000 ft, and the distance of the measured heights
RAMP = 10.0  # m before and behind the course, over which heights grow and fade
SEEDS = 5  # profiles of each course in the FMUs
LOWEST, HIGHEST = 0.015, 9.0  # cycles/m, of the fit
KNOTS = (0.02, 0.04, 0.07, 0.11, 0.16, 0.22, 0.32, 0.5, 0.8, 1.3, 2.2, 4.5, 9.0)  # cycles/m


@dataclass(frozen=True)
class RmsCourse:
    """`rms` [m] of the detrended heights, and `density` [m] at `KNOTS`.

    The density is that of the spectrum over the square of the rms.
    """

    rms: float
    density: tuple[float, ...]


COURSES = {
    "1in": RmsCourse(
        0.96944 * INCH, (0.0305, 0.405, 1.75, 3.07, 6.46, 2.58, 1.14, 0.354, 0.0631, 0.0281, 0.00987, 0.00553, 0.000361)
    ),
    "2in": RmsCourse(
        1.7441 * INCH,
        (0.0412, 0.0928, 0.671, 1.74, 5.93, 4.7, 1.46, 0.361, 0.0306, 0.00408, 0.00135, 0.000214, 1.51e-5),
    ),
    "4in": RmsCourse(
        3.3005 * INCH,
        (0.0118, 0.661, 1.57, 3.29, 9.41, 2.68, 1.09, 0.115, 0.0107, 0.00211, 0.000713, 0.000307, 1.91e-5),
    ),
}
"""By their names: rms as their headers say, spectrum as fitted."""


def course_spectrum(course: str, n: np.ndarray) -> np.ndarray:
    """One-sided displacement spectrum [m3] of a course at wave numbers `n` [cycles/m]; 0 outside of the fit."""
    c = COURSES[course]
    fitted = np.exp(np.interp(np.log(n), np.log(KNOTS), np.log(c.density)))
    return np.asarray(c.rms**2 * np.where((n >= LOWEST) & (n <= HIGHEST), fitted, 0.0))


def course_heights(course: str, seed: int, track: float, *, alike: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Heights [m] of the left and the right track every `STEP` from 0 to `LENGTH`.

    Both are periodic and of exactly the rms. `track` [m] is the distance of the sides, which counts where they are
    not `alike`. The left one is the same in either.
    """
    whole_number("seed of a course", seed, least=0)
    count = round(LENGTH / STEP)
    n = np.arange(1, count // 2) / LENGTH
    drawn = np.random.default_rng(seed).standard_normal((2, 2, len(n)))
    # mean square 2 G dn, of both parts
    first, second = np.sqrt(course_spectrum(course, n) / LENGTH) * (drawn[0] + 1j * drawn[1])
    shared = np.ones(len(n)) if alike else track_correlation(n, track)
    sides = (sum_of_waves(first), sum_of_waves(shared * first + np.sqrt(1 - shared**2) * second))
    left, right = (COURSES[course].rms / np.sqrt(np.mean(z**2)) * np.append(z, z[0]) for z in sides)
    return left, right


def driven(heights: np.ndarray, radius: float) -> np.ndarray:
    """Heights [m] of a wheel of `radius` [m] that rolls over a course (n,), rounded to 1e-6 m.

    `RAMP` is added before and behind the course.
    """
    ramp = round(RAMP / STEP)
    grown = 0.5 - 0.5 * np.cos(np.pi * np.arange(ramp) / ramp)
    before, behind = heights[-ramp - 1 : -1] * grown, heights[1 : ramp + 1] * grown[::-1]  # it is periodic
    return np.round(rolled(np.concatenate([before, heights, behind]), STEP, radius), 6)
