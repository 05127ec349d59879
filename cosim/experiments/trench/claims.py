"""What the claims of paper 003 in `claims.toml` name: crossings and their quantities; the judge of their verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from cosim.experiments.metrics.crossing import LABELS, LIMITS, normalized, reduction_percent, scores
from cosim.experiments.trench import published
from cosim.experiments.trench.published import GRID, SYSTEMS, Key, between, matrix, refined
from cosim.experiments.trench.runs import Case
from cosim.study import Band, ClaimList, Finding, Results
from cosim.study.judges import Quantities, View, compare


def verdict(study: Results, key: Key, controller: str) -> bool | None:
    """Whether a published crossing passes; None where halving the step changes the answer."""
    case = Case(*key, controller)
    passed = bool(study[case]["passed"])
    return passed if study[refined(case)]["passed"] == passed else None


def costs(study: Results) -> list[float]:
    """Of all published runs."""
    return [study[c]["cost"] for s in SYSTEMS for c in matrix(s)]


def normalized_costs(study: Results, controller: str) -> dict[Key, float]:
    """Table 5.11."""
    every = costs(study)
    return {k: normalized(study[Case(*k, controller)]["cost"], every) for k in GRID}


def score(study: Results) -> dict[Key, float]:
    """Of the controlled runs (Table 5.9)."""
    return dict(zip(GRID, scores(study[c]["cost"] for c in matrix("mpc")), strict=True))


def improvements(study: Results) -> dict[Key, float]:
    """By how many per cent control lowers the normalized cost (Table 5.11), where the passive one is above 0."""
    controlled, base = (normalized_costs(study, s) for s in ("mpc", "passive"))
    return {k: reduction_percent(controlled[k], base[k]) for k in GRID if base[k] > 0}


def _undecided(study: Results, keys: Sequence[Key], good: Sequence[Key], controller: str, enough: float) -> str:
    """Why these verdicts do not decide a claim that needs `enough` good ones; empty if they do."""
    loose = [k for k in keys if verdict(study, k, controller) is None]
    firm = [k for k in good if k not in loose]
    if len(firm) >= enough or len(firm) + len(loose) < enough:
        return ""
    where = ", ".join(f"{a:g} m at {v:g} km/h" for a, v in loose)
    return f"halving the step changes the verdict of {where}: {_both(study, loose, controller)}"


def _both(study: Results, keys: Sequence[Key], controller: str) -> str:
    """The quantities that decide, at the step of the study and at half of it."""
    parts = []
    for k in keys:
        case = Case(*k, controller)
        coarse, fine = study[case], study[refined(case)]
        for name in dict.fromkeys((*coarse["failures"], *fine["failures"])):
            if name in LABELS and name not in set(coarse["failures"]) & set(fine["failures"]):
                limit = getattr(LIMITS, name)
                parts.append(f"{LABELS[name]} {coarse[name]:.4g} and {fine[name]:.4g} (limit {limit:g})")
            elif name not in LABELS:
                parts.append(name)
    return "; ".join(parts)


def _where(every: Sequence[Key], good: Sequence[Key]) -> str:
    """Text for the cases that are missing from the good ones, "; not 1.3 m at 1, 3 km/h"; empty if none is missing."""
    missing = [k for k in every if k not in good]
    if not missing or len(missing) > len(every) / 2:
        return ""
    lengths = dict.fromkeys(length for length, _ in missing)
    parts = [f"{a:g} m at {', '.join(f'{v:g}' for x, v in missing if x == a)} km/h" for a in lengths]
    return "; not " + ", ".join(parts)


class TrenchView(View):
    """Lengths and speeds of trenches, or single runs."""

    made, named = Case, "{:g} m, {:g} km/h"
    quantities: ClassVar[Quantities] = {
        "improvement": lambda view, _, key: view.improvements.get(key),
        "mean score": lambda view, subject, _: view.mean_score(subject == "6 and 9 km/h"),
    }
    left_out = "these crossings were left out: the study ran the published ones only"

    @cached_property
    def improvements(self) -> dict[Key, float]:
        """`improvements` of the study."""
        return improvements(self.study)

    def mean_score(self, fast: bool) -> float:
        """Mean score of the controlled runs at upper or lower speeds."""
        found = [v for (_, speed), v in score(self.study).items() if (speed >= 6) == fast]
        return sum(found) / len(found)

    def places(self, at: str, road: str) -> list[Any]:  # noqa: ARG002
        """Those of the published crossings, or of the others if the study ran them."""
        if at == "everywhere":
            return list(GRID)
        found: dict[str, list[Any]] = {
            "the grid": ["the grid"],
            "1.2 and 1.3 m": [k for k in GRID if k[0] <= 1.3],
            "longer than 1.3 m": [k for k in GRID if k[0] > 1.3],
            "1.9 and 2.0 m": [k for k in GRID if k[0] >= 1.9],
            "3 to 9 km/h": [k for k in GRID if k[1] >= 3],
            "in between": [c for c in between() if c in self.study],
            "1.6 and 2.0 m, of some": [k for k in published.SOME if k[0] >= 1.6 and Case(*k, "lqr") in self.study],
            "every crossing under control": [c for c in (*matrix("mpc"), *between()) if c in self.study],
        }
        return found[at]

    def missing(self, places: Sequence[Any], every: Sequence[Any]) -> str:
        """Text for the published crossings at which a line does not hold."""
        return _where(every, [k for k in every if k not in places]) if set(every) <= set(GRID) else ""


def verdicts(
    view: TrenchView,
    *,
    controller: str,
    passing: bool | str,
    at: str = "everywhere",
    least: int | None = None,
    without: str = "",
    band: Band | None = None,
) -> Finding:
    """Whether crossings pass, fail, or do so "as printed", at a step whose halving changes no verdict: all, or `least`.

    None of them fails by what they are `without`. The value is their number.
    """
    keys: list[Key] = view.places(at, "")
    good = [
        k
        for k in keys
        if verdict(view.study, k, controller) == (published.passed(*k) if passing == "as printed" else passing)
    ]
    met = sum(without in view.study[Case(*k, controller)]["failures"] for k in keys) if without else 0
    return Finding(
        holds=len(good) >= (least or len(keys)) and not met,
        value=None if band is None else len(good),
        undecided=_undecided(view.study, keys, good, controller, len(keys) if band is None else band.low),
        words={"good": len(good), "others": len(keys) - len(good), "met": met, "missing": _where(keys, good)},
    )


CLAIMS = ClaimList.read(Path(__file__).with_name("claims.toml"), {"compare": compare, "verdicts": verdicts}, TrenchView)
