"""What the claims of paper 001 on its force tracking in `claims.toml` name: signals, variants and quantities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from cosim.experiments.hmmwv.tracking.published import NOISE, PUBLISHED, VARIANTS, error
from cosim.experiments.hmmwv.tracking.runs import FILTER, Case
from cosim.study import ClaimList, Results
from cosim.study.judges import Quantities, View, compare

_NAMES = {
    "as published": "as published: difference (1.15), no average",
    "rate by (1.13)": "rate by the filter (1.13)",
    "noise, average (1.14) on": "load cell with noise, average (1.14) on",
    "notches on": "notches at heave/pitch and roll on",
}


def errors(study: Results, variant: str = "") -> dict[str, float]:
    """Relative rms error by published signal: of the published controller, or of one of `VARIANTS`."""
    case = VARIANTS[variant or next(iter(VARIANTS))]
    return {s: error(study, replace(case, signal=s)) for s in PUBLISHED}


class TrackingView(View):
    """Signals, under `VARIANTS` of the controller."""

    quantities: ClassVar[Quantities] = {
        "first at its final value": lambda view, *_: 1e3 * view.study[Case(FILTER)]["crossing"],  # ms
        "rise from 10 to 90 %": lambda view, *_: 1e3 * view.study[Case(FILTER)]["rise"],  # ms
        "jumps": lambda view, variant, signal: 1e3 * view.study[view.case(variant, signal)]["voltage_jumps"],  # mV
    }
    words: Mapping[str, float] = {"noise": NOISE}

    def places(self, at: str, road: str) -> list[str]:  # noqa: ARG002
        """One signal, or those of Figure 1.8."""
        return list(PUBLISHED) if at == "everywhere" else [at]

    def case(self, subject: str, place: str) -> Case:
        """The run of a variant."""
        return replace(VARIANTS[_NAMES.get(subject, subject)], signal=place)


CLAIMS = ClaimList.read(Path(__file__).with_name("claims.toml"), {"compare": compare}, TrackingView)
