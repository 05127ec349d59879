"""What paper 001 says of its force tracking, judged by the runs of one corner."""

from __future__ import annotations

from dataclasses import replace

from cosim.experiments.hmmwv.tracking.published import NOISE, PUBLISHED, RISE_MS, VARIANTS, error
from cosim.experiments.hmmwv.tracking.runs import FILTER, Case
from cosim.study import Band, ClaimList, Finding, Results, Row

FOLLOWS = 0.10  # rms error over rms desired force; our criterion
NEEDLESS = 0.05  # larger rms error up to which the notches are not needed; our criterion

CLAIMS = ClaimList()


def errors(study: Results, variant: str = "") -> dict[str, float]:
    """Relative rms error by published signal: of the published controller, or of one of `VARIANTS`."""
    case = VARIANTS[variant or next(iter(VARIANTS))]
    return {s: error(study, replace(case, signal=s)) for s in PUBLISHED}


@CLAIMS.claim(
    "tracking-filter",
    "The filter of the desired force rises in about 27 ms",
    published="approximately 27 ms",
    source="Figure 1.4",
)
def _filter(study: Results) -> Finding:
    row = study[Case(FILTER)]
    crossing, band = 1e3 * row["crossing"], Band.around(RISE_MS)
    return Finding(
        f"first at its final value after {crossing:.1f} ms; 10 to 90 % in {1e3 * row['rise']:.1f} ms",
        crossing in band,
        "more than 10 % off",
        crossing,
        "ms",
        band,
        criterion="time until the step response is first at its final value",
        fitted=(
            "the paper does not define its rise time; the whole rise is taken, the only usual definition that comes"
            " near its figure"
        ),
    )


def _follows(signal: str) -> None:
    """A check of how well the force follows a signal."""
    words = "filtered square wave" if signal == "square" else f"{signal} from 1 to 10 Hz"

    @CLAIMS.check(
        f"tracking-{signal.replace(' ', '-')}",
        f"The force follows a {words}",
        source="Figure 1.8",
        expected="follows; the paper shows curves and gives no error",
    )
    def _judged(study: Results) -> Finding:
        found = error(study, Case(signal))
        return Finding(
            f"{100 * found:.1f} % rms of the smoothed desired force",
            found <= FOLLOWS,
            f"above {100 * FOLLOWS:g} % rms",
            100 * found,
            "%",
            criterion=(
                f"rms of force minus smoothed desired force at most {100 * FOLLOWS:g} % of the rms of the latter,"
                " without the first 0.5 s"
            ),
        )


for _signal in PUBLISHED:
    _follows(_signal)


@CLAIMS.claim(
    "tracking-difference",
    "The difference (1.15) works better than the filter (1.13)",
    published="better",
    source="section 1.3",
)
def _difference(study: Results) -> Finding:
    base, filtered = errors(study), errors(study, "rate by the filter (1.13)")
    return Finding(
        ", ".join(f"{s} {100 * base[s]:.1f} compared with {100 * filtered[s]:.1f} %" for s in PUBLISHED),
        all(base[s] < filtered[s] for s in PUBLISHED),
        "it does not for every signal",
        filtered["square"] / base["square"],
        "-",
        criterion="smaller rms error under every signal of Figure 1.8; the paper gives no size",
    )


def _noisy(study: Results) -> tuple[Row, Row]:
    """With a noisy load cell, without and with the averaging filter."""
    without, averaged = (study[VARIANTS["load cell with noise" + also]] for also in ("", ", average (1.14) on"))
    return without, averaged


@CLAIMS.claim(
    "tracking-average",
    "The averaging filter (1.14) improves the performance of the controller",
    published="improved",
    source="section 1.3",
)
def _average(study: Results) -> Finding:
    base, averaged = errors(study), errors(study, "average (1.14) on")
    return Finding(
        ", ".join(f"{s} {100 * averaged[s]:.0f} instead of {100 * base[s]:.1f} %" for s in PUBLISHED),
        all(averaged[s] <= base[s] for s in PUBLISHED),
        "it adds 1.5 ms of delay, too much for these gains; without it noise of the load cell costs little"
        f" ({100 * _noisy(study)[0]['error']:.1f} % on the square wave with {NOISE:g} N)",
        averaged["square"] / base["square"],
        "-",
        criterion="no larger rms error under any signal of Figure 1.8",
    )


@CLAIMS.claim(
    "tracking-average-noise",
    "The averaging filter (1.14) reduces the noise of the control",
    published="reduced",
    source="section 1.3",
)
def _average_noise(study: Results) -> Finding:
    without, averaged = (1e3 * row["voltage_jumps"] for row in _noisy(study))
    return Finding(
        f"jumps of the command {averaged:.0f} mV from sample to sample instead of {without:.0f} mV, with a load cell"
        f" whose noise is {NOISE:g} N",
        averaged < without,
        "the command jumps as much with it",
        averaged / without,
        "-",
        criterion="smaller rms change of the valve's voltage from sample to sample, under the noise of a load cell; the"
        " paper gives no size",
        fitted="noise of the load cell assumed",
    )


@CLAIMS.claim(
    "tracking-notches",
    "Filters at the modes of the body turn out to be unnecessary",
    published="not needed",
    source="section 1.3",
)
def _notches(study: Results) -> Finding:
    base, notched = errors(study), errors(study, "notches at heave/pitch and roll on")
    return Finding(
        ", ".join(f"{s} {100 * base[s]:.1f} without, {100 * notched[s]:.1f} % with" for s in PUBLISHED),
        all(base[s] <= (1 + NEEDLESS) * notched[s] for s in PUBLISHED),
        f"they improve the tracking by more than {100 * NEEDLESS:g} %",
        notched["square"] / base["square"],
        "-",
        criterion=(
            f"rms error without them at most {100 * NEEDLESS:g} % above that with them, under every signal of Figure"
            " 1.8: half of the 10 % that count as the same figure"
        ),
    )
