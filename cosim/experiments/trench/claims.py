"""What paper 003 says of trench crossings, judged by the runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from cosim.experiments.metrics.crossing import LABELS, LIMITS, improvement_percent, normalized, scores
from cosim.experiments.trench import published
from cosim.experiments.trench.published import GRID, SYSTEMS, Key, between, matrix, refined, some
from cosim.experiments.trench.runs import Case
from cosim.study import Band, ClaimList, Finding, Results, Row

CHANCE = 24  # of 36 verdicts: as many agree by chance in less than 5 % of all cases, if each were a toss
FITTED_PASSIVE = "vehicle values that the thesis does not disclose, chosen with Table 5.4 in view"
FITTED_CONTROLLED = (
    "windows of the cases, pitch reference and weight of the height, which the thesis does not print, and the sign of"
    " the forced ranges, chosen with these 36 verdicts in view"
)
_ASSUMED = "the thesis keeps its vehicle to itself, ours is assumed; so are bumpers and belly"
_SEE_TABLE = "see the failures in the table of controlled runs"
_FELT = "retracting an axle is felt where the passive vehicle hardly notices the trench"
_LEFT_OUT = "these crossings were left out: the study ran the published ones only"

PRINT = published.rows()
CLAIMS = ClaimList()


# ------------------------------------------------------------------------------------------------- what runs come to


def ran(study: Results, cases: Iterable[Case]) -> list[Row]:
    """Metrics of the cases that belong to a study, which may have left some out."""
    return [study[c] for c in cases if c in study]


def passes(rows: Iterable[Row]) -> int:
    """How many met Table 5.3 without belly contact."""
    return sum(r["passed"] for r in rows)


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
    return {k: improvement_percent(controlled[k], base[k]) for k in GRID if base[k] > 0}


def lower(study: Results, quantity: str) -> list[Key]:
    """Where a quantity is lower under control than without."""
    return [k for k in GRID if study[Case(*k, "mpc")][quantity] < study[Case(*k, "passive")][quantity]]


# --------------------------------------------------------------------------------------------------------- verdicts


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


@CLAIMS.claim(
    "passive-verdicts",
    "The passive vehicle passes and fails where Table 5.4 says so",
    published="36 verdicts",
    source="Table 5.4",
)
def _passive_verdicts(study: Results) -> Finding:
    agree = [k for k in GRID if verdict(study, k, "passive") == published.passed(*k)]
    return Finding(
        f"{len(agree)} of 36 agree{_where(GRID, agree)}",
        len(agree) >= CHANCE,
        _ASSUMED,
        len(agree),
        "of 36",
        Band(0.9 * len(GRID), len(GRID), "at least nine of ten"),
        fitted=FITTED_PASSIVE,
        calibrated=True,
        criterion=(
            f"more agree than by chance (at least {CHANCE} of 36, sign test at 5 %), at a step whose halving changes no"
            " verdict"
        ),
        undecided=_undecided(study, GRID, agree, "passive", 0.9 * len(GRID)),
    )


@CLAIMS.claim(
    "passive-short",
    "Trenches of 1.2 and 1.3 m, close to the wheel diameter, are crossed passively at every speed",
    published="8 of 8",
    source="Table 5.4",
)
def _passive_short(study: Results) -> Finding:
    short = [k for k in GRID if k[0] <= 1.3]
    good = [k for k in short if verdict(study, k, "passive")]
    return Finding(
        f"{len(good)} of 8{_where(short, good)}",
        len(good) == len(short),
        _ASSUMED,
        criterion="all eight pass",
        fitted=FITTED_PASSIVE,
        calibrated=True,
        undecided=_undecided(study, short, good, "passive", len(short)),
    )


@CLAIMS.claim("passive-long", "No trench of 1.9 or 2.0 m is crossed passively", published="0 of 8", source="Table 5.4")
def _passive_long(study: Results) -> Finding:
    long = [k for k in GRID if k[0] >= 1.9]
    bad = [k for k in long if verdict(study, k, "passive") is False]
    return Finding(
        f"{len(long) - len(bad)} of 8",
        len(bad) == len(long),
        _ASSUMED,
        criterion="all eight fail",
        fitted=FITTED_PASSIVE,
        calibrated=True,
        undecided=_undecided(study, long, bad, "passive", len(long)),
    )


@CLAIMS.claim(
    "controlled-pass",
    "Under control every crossing meets Table 5.3 without belly contact",
    published="36 of 36 (by its own Table 5.7 pitch is above 15 deg in three)",
    source="sections 5.6 and 6.1, Table 5.3",
)
def _controlled_pass(study: Results) -> Finding:
    good = [k for k in GRID if verdict(study, k, "mpc")]
    belly = sum("belly contact" in study[c]["failures"] for c in matrix("mpc"))
    return Finding(
        f"{len(good)} of 36, belly contact in {belly}{_where(GRID, good)}",
        len(good) == len(GRID) and not belly,
        _SEE_TABLE,
        criterion="all 36, none with belly contact",
        fitted=FITTED_CONTROLLED,
        calibrated=True,
        undecided=_undecided(study, GRID, good, "mpc", len(GRID)),
    )


@CLAIMS.claim(
    "controlled-faster",
    "Under control all crossings at 3 to 9 km/h succeed",
    published="27 of 27",
    source="section 5.6",
)
def _controlled_faster(study: Results) -> Finding:
    faster = [k for k in GRID if k[1] >= 3]
    good = [k for k in faster if verdict(study, k, "mpc")]
    return Finding(
        f"{len(good)} of 27{_where(faster, good)}",
        len(good) == len(faster),
        _SEE_TABLE,
        criterion="all 27",
        fitted=FITTED_CONTROLLED,
        calibrated=True,
        undecided=_undecided(study, faster, good, "mpc", len(faster)),
    )


# --------------------------------------------------------------------------------------------------- costs and peaks


@CLAIMS.claim(
    "cost-below-passive",
    "Control lowers the cost in every crossing",
    published="36 of 36, by 63.5 to 100 % (normalized)",
    source="Table 5.11",
)
def _cost_below_passive(study: Results) -> Finding:
    cheaper, taken = lower(study, "cost"), improvements(study)
    least = min(taken, key=lambda k: taken[k])
    return Finding(
        f"{len(cheaper)} of 36, by {taken[least]:.0f} to {max(taken.values()):.0f} % (least at {least[0]:g} m,"
        f" {least[1]:g} km/h){_where(GRID, cheaper)}",
        len(cheaper) == len(GRID),
        "a short trench at low speed costs the passive vehicle little, and retracting the axles costs something",
        taken[least],
        "%",
        Band(0.9 * 63.5, 100.0, "the least improvement within 10 % of the printed one, or more"),
        criterion="lower in all 36",
        fitted=FITTED_CONTROLLED,
    )


_CALMER = [k for k in GRID if float(PRINT[k]["controlled az [m/s2]"]) < float(PRINT[k]["passive az [m/s2]"])]


@CLAIMS.claim(
    "peak-az",
    "Control lowers the peak of the vertical acceleration, but in the shortest trenches",
    published=f"{len(_CALMER)} of 36, not at 1.2 and 1.3 m with 9 km/h",
    source="Table 5.6",
)
def _peak_az(study: Results) -> Finding:
    calmer = lower(study, "az")
    return Finding(
        f"{len(calmer)} of 36{_where(GRID, calmer)}",
        all(k in calmer for k in GRID if k[0] > 1.3),
        _FELT,
        len(calmer),
        "of 36",
        Band(0.9 * len(_CALMER), len(GRID), "within 10 % of the printed count, or more"),
        criterion="lower in every trench longer than 1.3 m",
        fitted=f"{FITTED_PASSIVE}; {FITTED_CONTROLLED}",
    )


@CLAIMS.claim(
    "peak-ax",
    "Control lowers the peak of the longitudinal acceleration everywhere",
    published="36 of 36",
    source="Table 5.6",
)
def _peak_ax(study: Results) -> Finding:
    gentler = lower(study, "ax")
    return Finding(
        f"{len(gentler)} of 36{_where(GRID, gentler)}",
        len(gentler) == len(GRID),
        _FELT,
        criterion="lower in all 36",
        fitted=f"{FITTED_PASSIVE}; {FITTED_CONTROLLED}",
    )


@CLAIMS.claim(
    "scores",
    "Crossings at middle and upper speed score higher",
    published="4.5 compared with 2.9 on average over the printed cells at 6, 9 and 1, 3 km/h",
    source="Table 5.9",
)
def _scores(study: Results) -> Finding:
    found = score(study)
    fast, slow = ([v for (_, speed), v in found.items() if (speed >= 6) == upper] for upper in (True, False))
    return Finding(
        f"{sum(fast) / len(fast):.1f} compared with {sum(slow) / len(slow):.1f}",
        sum(fast) / len(fast) > sum(slow) / len(slow),
        "our controller holds pitch at walking pace, so slow crossings cost little: peaks, hub forces and rms grow with"
        " speed",
        criterion="mean score at 6 and 9 km/h above that at 1 and 3 km/h",
        fitted=FITTED_CONTROLLED,
    )


# ----------------------------------------------------------------------------------------- beyond the published runs


@CLAIMS.claim(
    "between",
    "The controller is not tuned to the grid: it crosses at lengths and speeds in between",
    published="any trench from 1.2 to 2.0 m and 1 to 9 km/h (section 6.1)",
    source="section 6.1",
)
def _between(study: Results) -> Finding:
    rows = ran(study, between())
    return Finding(
        f"{passes(rows)} of {len(rows)} without a change",
        passes(rows) == len(rows),
        "see the table",
        criterion="all of them, none of which the controller was fitted on",
        fitted=FITTED_CONTROLLED,
        undecided="" if rows else _LEFT_OUT,
    )


def _alone(id_: str, controller: str, text: str) -> None:
    @CLAIMS.claim(id_, text, published="said without numbers", source="section 6.1")
    def judge(study: Results) -> Finding:
        rows = ran(study, (c for c in some(controller) if c.length >= 1.6))
        return Finding(
            f"{passes(rows)} of {len(rows)} crossings of 1.6 and 2.0 m meet Table 5.3",
            passes(rows) == 0,
            "here it also gets cases, pitch reference and forced ranges where it takes them, which helps it over",
            criterion="none of the crossings meets Table 5.3",
            fitted=FITTED_CONTROLLED,
            undecided="" if rows else _LEFT_OUT,
        )


_alone("lqr-alone", "lqr", "LQR alone does not get the vehicle over deep trenches")
_alone("no-preview-alone", "mpc-offsets", "Neither does MPC without preview")


@CLAIMS.check(
    "solver", "The quadratic program is solved at every step, to 1e-6", expected="no failure, residual of 1e-6 at most"
)
def _solver(study: Results) -> Finding:
    rows = ran(study, [*matrix("mpc"), *between()])
    residual, missed = max(r["solver_residual"] for r in rows), sum(r["solver_failures"] for r in rows)
    return Finding(
        f"{missed} failures in {len(rows)} crossings, largest residual {residual:.1e}",
        not missed and residual <= 1e-6,
        "a step was not solved",
        criterion="every step of every crossing under control",
    )
