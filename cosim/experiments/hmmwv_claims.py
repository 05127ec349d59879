"""The claims of paper 001 on the whole vehicle, each judged from the study's own numbers."""

from __future__ import annotations

from cosim.comfort import ABSORBED_POWER_LIMIT
from cosim.experiments.hmmwv import Case
from cosim.experiments.hmmwv_study import Study
from cosim.report import Claim
from cosim.report.model import Verdict

LESS_THAN_HALF = 2.0  # passive over controlled, "a better than twofold improvement"
NAMES = {
    "passive": "passive",
    "zero": "zero force",
    "skyhook": "skyhook",
    "lqr": "LQR",
    "lqr-kilonewton": "LQR, force in kN",
}


def claims(study: Study) -> list[Claim]:
    """Every published claim with the published figure, ours and a verdict."""
    result: list[Claim] = []

    def claim(
        id_: str, text: str, published: str, ours: str, holds: bool, reason: str, source: str, value: float, unit: str
    ) -> None:
        verdict: Verdict = "reproduced" if holds else "not reproduced"
        result.append(
            Claim(id_, text, published, ours, verdict, "" if holds else reason, source, round(value, 3), unit)
        )

    passive = study.power(Case("track", "passive"))
    for controller in ("zero", "skyhook", "lqr"):
        ratio = passive / study.power(Case("track", controller))
        claim(
            f"track-{controller}",
            f"Test track at 20 mph: {NAMES[controller]} at least halves the absorbed power of the passive car",
            "better than twofold",
            f"{passive:.1f} over {passive / ratio:.1f} W: {ratio:.2f} times",
            ratio >= LESS_THAN_HALF,
            "less than twofold",
            "Figure 1.9",
            ratio,
            "-",
        )
    alike = [study.power(Case("track", c)) for c in ("zero", "skyhook", "lqr")]
    spread = max(alike) / min(alike) - 1
    claim(
        "track-alike",
        "Test track: the controllers without preview perform alike",
        "comparable",
        f"zero force, skyhook and LQR {min(alike):.1f} to {max(alike):.1f} W, within {100 * spread:.0f} %",
        spread <= 0.2,
        "more than 20 % apart",
        "Figure 1.9",
        spread,
        "-",
    )
    for controller in ("passive", "skyhook", "lqr"):
        case = Case("off-road", controller)
        power, (low, high) = study.power(case), study.spread("absorbed_power", case)
        claim(
            f"off-road-{controller}",
            f"Off road at 20 mph: {NAMES[controller]} is above the {ABSORBED_POWER_LIMIT:g} W that a driver bears",
            f"above {ABSORBED_POWER_LIMIT:g} W",
            f"{power:.1f} W, {low:.1f} to {high:.1f} W over {len(study.runs(case))} stretches",
            low > ABSORBED_POWER_LIMIT,
            "within the limit on at least one stretch",
            "Figure 1.10",
            power,
            "W",
        )
    return result
