"""What paper 001 says of its preview, and what this project requires of its own, judged by the runs of the chain."""

from __future__ import annotations

from itertools import pairwise

from cosim.experiments.hmmwv.preview.published import (
    COMPENSATED,
    FED,
    HEIGHTS_MM,
    LONG,
    PRINTED,
    PRINTED_FED,
    SPEEDOMETER_ERRORS,
    generated,
    long,
    on_track,
    over,
)
from cosim.experiments.hmmwv.preview.runs import WINDOW, Case
from cosim.study import ClaimList, Finding, Results
from fmu_sources.roads.bumps import BUMP_LENGTH

SMALL, BIG = HEIGHTS_MM
NOISE = "noise of the sensors assumed"

CLAIMS = ClaimList()


def extremes(study: Results, chain: Case, height_mm: float) -> tuple[float, float]:
    """Lowest and highest sensed height [mm] on the flat road after a bump."""
    row = study[over(chain, height_mm)]
    return 1e3 * row["lowest"], 1e3 * row["highest"]


def resolution(study: Results) -> float:
    """What the range sensor resolves [mm]."""
    return 1e3 * float(study[on_track(FED)]["resolution"])


@CLAIMS.claim(
    "preview-dip",
    "With a filter that knows nothing of the road, the corrected road has a negative bump after the actual one",
    published="a negative bump",
    source="Figure 1.7",
)
def _dip(study: Results) -> Finding:
    seen, (dip, _), (flat, _) = resolution(study), extremes(study, PRINTED, BIG), extremes(study, PRINTED, SMALL)
    return Finding(
        f"{dip:.0f} mm after a bump of {BIG:.0f} mm, {flat:.0f} mm after {SMALL:.0f} mm",
        dip < -seen,
        "the range sensor could not show so flat a dip",
        -dip,
        "mm",
        criterion=(
            f"a dip deeper than the {seen:g} mm that the range sensor resolves, after a bump of {BIG:.0f} mm without"
            " noise"
        ),
    )


@CLAIMS.claim(
    "preview-dip-compensated",
    "Quarter cars on the buffered road, outside the filter, remove it",
    published="removed",
    source="section 1.5, Figure 1.7",
)
def _dip_compensated(study: Results) -> Finding:
    seen, (dip, rise) = resolution(study), extremes(study, COMPENSATED, BIG)
    return Finding(
        f"{dip:.0f} mm are left, and a rise of {rise:.0f} mm comes with it",
        max(-dip, rise) <= seen,
        "accelerometers and gyros show part of the body's motion even to a filter that assumes a flat road, and the"
        " quarter cars add all of it; through the buffer they close a loop of their own that keeps swinging",
        max(-dip, rise),
        "mm",
        criterion=f"neither a dip nor a rise beyond the {seen:g} mm that the range sensor resolves is left",
    )


@CLAIMS.claim(
    "preview-unstable",
    "The road fed back into the filter makes the preview unstable",
    published="unstable dynamics",
    source="section 1.5",
)
def _unstable(study: Results) -> Finding:
    growth = study[long(PRINTED_FED)]["spread"]
    return Finding(
        f"the error of the buffered road grows from {1e3 * growth[0]:.1f} mm to {growth[-1]:.1f} m in {LONG:g} s of"
        " sensor noise",
        growth[-1] > 10 * growth[0] and all(b > a for a, b in pairwise(growth)),
        "the error does not grow without end",
        growth[-1] / growth[0],
        "-",
        criterion=f"the error's standard deviation grows from every {WINDOW:g} s to the next, tenfold over {LONG:g} s",
        fitted=f"{NOISE}; it sets when the growth shows, not whether",
    )


@CLAIMS.check(
    "preview-fed",
    "Feeding the road back into a filter of relative states, whose pose follows it slowly, removes the dip and stays"
    " stable",
    expected="requested as the more robust solution",
    source="section 1.5",
)
def _fed(study: Results) -> Finding:
    (small, _), (big, _), steady = (*(extremes(study, FED, h) for h in HEIGHTS_MM), study[long(FED)]["spread"])
    return Finding(
        f"{small:.2f} mm after a bump of {SMALL:.0f} mm ({big:.2f} mm after {BIG:.0f} mm); with noise the standard"
        f" deviation of the error is at most {1e3 * max(steady):.1f} mm in any {WINDOW:g} s of {LONG:g}",
        small >= -1.0 and 1e3 * max(steady) < SMALL,
        "the dip is deeper than 1 mm or the error grows",
        -small,
        "mm",
        criterion=(
            f"dip of at most 1 mm after {SMALL:.0f} mm without noise, and with noise an error below the bump's height"
            f" for {LONG:g} s"
        ),
        fitted="noise of the sensors and times of the slow corrections assumed",
    )


@CLAIMS.claim(
    "preview-rate",
    "The correction improves the rate of the road, which MPC weighs most",
    published="tremendously",
    source="Figure 1.7",
)
def _rate(study: Results) -> Finding:
    before, fed, compensated = (study[on_track(c)]["rate_error"] for c in (PRINTED, FED, COMPENSATED))
    return Finding(
        f"error of the rate {before:.3f} m/s before, {fed:.3f} m/s with the road fed back, {compensated:.3f} m/s with"
        " quarter cars",
        fed <= before / 2,
        "noise and resolution of the ranges make most of the error of the rate, and no correction touches them",
        100 * (1 - fed / before),
        "%",
        criterion="rms error of the rate at least halved with the road fed back; the paper gives no size",
        fitted=NOISE,
    )


@CLAIMS.claim(
    "generated-loads",
    "A known profile at the measured distance matches the peaks of the loads",
    published="matched",
    source="Figure 1.5",
)
def _generated_loads(study: Results) -> Finding:
    exact = study[generated(0.0)]["offsets"]
    return Finding(
        f"peaks {1e3 * exact[0]:+.0f} and {1e3 * exact[1]:+.0f} mm from the crests",
        max(map(abs, exact)) <= BUMP_LENGTH / 2,
        "the load does not peak over the bump",
        1e3 * max(map(abs, exact)),
        "mm",
        criterion=(
            "largest load while the wheel is on the bump, at most half its length from the crest, at both bumps of the"
            " track"
        ),
    )


@CLAIMS.claim(
    "generated-drift",
    "Generated preview accumulates errors of the distance",
    published="no longer accurate after 10 m",
    source="section 1.5",
)
def _generated_drift(study: Results) -> Finding:
    error = SPEEDOMETER_ERRORS[-1]
    first, second = (b - a for a, b in zip(*(study[generated(e)]["offsets"] for e in (0.0, error)), strict=True))
    return Finding(
        f"a speedometer that shows {error:g} % too much: off by {1e3 * first:.0f} mm at the first bump,"
        f" {1e3 * second:.0f} mm at the second",
        abs(second) > max(abs(first), BUMP_LENGTH / 2),
        "the error does not grow with the distance, or the prediction is still on the bump",
        1e3 * abs(second),
        "mm",
        criterion="further off at the second bump than at the first, and there by more than half the length of a bump",
        fitted=f"the speedometer's error of {error:g} % is assumed",
    )
