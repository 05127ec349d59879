"""What paper 003 says of trench crossings, judged from runs of the FMUs."""

from __future__ import annotations

from cosim.experiments import trench_published as published
from cosim.experiments import trench_study as ts
from cosim.experiments.trench_published import LENGTHS, SPEEDS
from cosim.experiments.trench_study import Study, passes
from cosim.metrics_crossing import LABELS, LIMITS, improvement_percent
from cosim.report import Band, Claims

GRID = [(length, speed) for length in LENGTHS for speed in SPEEDS]
CHANCE = 24  # of 36 verdicts: as many agree by chance in less than 5 % of all cases, if each were a toss
FITTED_PASSIVE = "vehicle values that the thesis keeps back, chosen with Table 5.4 in view"
FITTED_CONTROLLED = (
    "windows of the cases, pitch reference and weight of the height, which the thesis does not print, and the sign of the forced "
    "ranges, chosen with these 36 verdicts in view"
)
Key = tuple[float, float]  # length [m], speed [km/h]


def claims(study: Study) -> Claims:
    """Every claim with its criterion; those on what was not run are left out."""
    found = Claims()
    claim = found.judge

    passive = {k: study.published[*k, "passive"] for k in GRID}
    controlled = {k: study.published[*k, "mpc"] for k in GRID}
    unsettled = {s: [k for k in GRID if study.verdict(*k, s) is None] for s in ts.SYSTEMS}
    assumed = "the thesis keeps its vehicle to itself, ours is assumed; so are bumpers and belly"

    def settled(keys: list[Key], good: list[Key], system: str, enough: float) -> str:
        """Why these verdicts do not decide a claim that needs `enough` good ones; empty if they do."""
        loose = [k for k in keys if k in unsettled[system]]
        firm = [k for k in good if k not in loose]
        if len(firm) >= enough or len(firm) + len(loose) < enough:
            return ""
        return f"halving the step changes the verdict{_list(loose)}: {_both(study, loose, system)}"

    agree = [k for k in GRID if study.verdict(*k, "passive") == published.passed(*k)]
    claim(
        "passive-verdicts",
        "The passive vehicle passes and fails where Table 5.4 says so",
        "36 verdicts",
        f"{len(agree)} of 36 agree{_where(GRID, agree)}",
        len(agree) >= CHANCE,
        assumed,
        "Table 5.4",
        len(agree),
        "of 36",
        band=Band.around(len(GRID)),
        criterion=f"more agree than by chance (at least {CHANCE} of 36, sign test at 5 %), at a step whose halving changes no verdict",
        fitted=FITTED_PASSIVE,
        undecided=settled(GRID, agree, "passive", 0.9 * len(GRID)),
    )
    short = [k for k in GRID if k[0] <= 1.3]
    good = [k for k in short if study.verdict(*k, "passive")]
    claim(
        "passive-short",
        "Trenches of 1.2 and 1.3 m, close to the wheel diameter, are crossed passively at every speed",
        "8 of 8",
        f"{len(good)} of 8{_where(short, good)}",
        len(good) == len(short),
        assumed,
        "Table 5.4",
        criterion="all eight pass",
        fitted=FITTED_PASSIVE,
        undecided=settled(short, good, "passive", len(short)),
    )
    long = [k for k in GRID if k[0] >= 1.9]
    bad = [k for k in long if study.verdict(*k, "passive") is False]
    claim(
        "passive-long",
        "No trench of 1.9 or 2.0 m is crossed passively",
        "0 of 8",
        f"{8 - len(bad)} of 8",
        len(bad) == 8,
        assumed,
        "Table 5.4",
        criterion="all eight fail",
        fitted=FITTED_PASSIVE,
        undecided=settled(long, bad, "passive", len(long)),
    )

    good = [k for k in GRID if study.verdict(*k, "mpc")]
    belly = sum("belly contact" in controlled[k]["failures"] for k in GRID)
    claim(
        "controlled-pass",
        "Under control every crossing meets Table 5.3 without belly contact",
        "36 of 36 (by its own Table 5.7 pitch is above 15 deg in three)",
        f"{len(good)} of 36, belly contact in {belly}{_where(GRID, good)}",
        len(good) == len(GRID) and not belly,
        "see the failures in the table of controlled runs",
        "sections 5.6 and 6.1, Table 5.3",
        criterion="all 36, none with belly contact",
        fitted=FITTED_CONTROLLED,
        undecided=settled(GRID, good, "mpc", len(GRID)),
    )
    faster = [k for k in GRID if k[1] >= 3]
    good = [k for k in faster if study.verdict(*k, "mpc")]
    claim(
        "controlled-faster",
        "Under control all crossings at 3 to 9 km/h succeed",
        "27 of 27",
        f"{len(good)} of 27{_where(faster, good)}",
        len(good) == 27,
        "see the failures in the table of controlled runs",
        "section 5.6",
        criterion="all 27",
        fitted=FITTED_CONTROLLED,
        undecided=settled(faster, good, "mpc", len(faster)),
    )
    lower = [k for k in GRID if controlled[k]["cost"] < passive[k]["cost"]]
    taken = {k: improvement_percent(study.normalised(*k, "mpc"), study.normalised(*k, "passive")) for k in GRID}
    least = min(taken, key=lambda k: taken[k])
    claim(
        "cost-below-passive",
        "Control lowers the cost in every crossing",
        "36 of 36, by 63.5 to 100 % (normalised)",
        f"{len(lower)} of 36, by {taken[least]:.0f} to {max(taken.values()):.0f} % (least at {least[0]:g} m, {least[1]:g} km/h)"
        f"{_where(GRID, lower)}",
        len(lower) == 36,
        "a short trench at low speed costs the passive vehicle little, and retracting the axles costs something",
        "Table 5.11",
        taken[least],
        "%",
        band=Band(0.9 * 63.5, 100.0, "the least improvement within 10 % of the printed one, or more"),
        criterion="lower in all 36",
        fitted=FITTED_CONTROLLED,
    )
    printed = [k for k in GRID if _printed(k, "controlled az [m/s2]") < _printed(k, "passive az [m/s2]")]
    calmer = [k for k in GRID if controlled[k]["az"] < passive[k]["az"]]
    claim(
        "peak-az",
        "Control lowers the peak of the vertical acceleration, but in the shortest trenches",
        f"{len(printed)} of 36, not at 1.2 and 1.3 m with 9 km/h",
        f"{len(calmer)} of 36{_where(GRID, calmer)}",
        all(k in calmer for k in GRID if k[0] > 1.3),
        "retracting an axle is felt where the passive vehicle hardly notices the trench",
        "Table 5.6",
        len(calmer),
        "of 36",
        band=Band.around(len(printed)),
        criterion="lower in every trench longer than 1.3 m",
    )
    gentler = [k for k in GRID if controlled[k]["ax"] < passive[k]["ax"]]
    claim(
        "peak-ax",
        "Control lowers the peak of the longitudinal acceleration everywhere",
        "36 of 36",
        f"{len(gentler)} of 36{_where(GRID, gentler)}",
        len(gentler) == 36,
        "retracting an axle is felt where the passive vehicle hardly notices the trench",
        "Table 5.6",
        criterion="lower in all 36",
    )
    scores = study.scores()
    fast = [v for (_, speed), v in scores.items() if speed >= 6]
    slow = [v for (_, speed), v in scores.items() if speed < 6]
    claim(
        "scores",
        "Crossings at middle and upper speed score higher",
        "4.5 against 2.9 on average over the printed cells at 6, 9 and 1, 3 km/h",
        f"{sum(fast) / len(fast):.1f} against {sum(slow) / len(slow):.1f}",
        sum(fast) / len(fast) > sum(slow) / len(slow),
        "our controller holds pitch at walking pace, so slow crossings cost little: peaks, hub forces and rms grow with speed",
        "Table 5.9",
        criterion="mean score at 6 and 9 km/h above that at 1 and 3 km/h",
        fitted=FITTED_CONTROLLED,
    )
    if study.between:
        good_ones = passes(study.between)
        claim(
            "between",
            "The controller is not tuned to the grid: it crosses at lengths and speeds in between",
            "any trench from 1.2 to 2.0 m and 1 to 9 km/h (section 6.1)",
            f"{good_ones} of {len(study.between)} without a change",
            good_ones == len(study.between),
            "see the table",
            "section 6.1",
            criterion="all of them, none of which the controller was fitted on",
        )
    if study.without:
        for id_, control, text in (
            ("lqr-alone", "lqr", "LQR alone does not get the vehicle over deep trenches"),
            ("no-preview-alone", "mpc-offsets", "Neither does MPC without preview"),
        ):
            rows = [r for r in study.without[control] if r["length"] >= 1.6]
            crossed = passes(rows)
            claim(
                id_,
                text,
                "said without numbers",
                f"{crossed} of {len(rows)} crossings of 1.6 and 2.0 m meet Table 5.3",
                crossed == 0,
                "here it also gets cases, pitch reference and forced ranges where it takes them, which helps it over",
                "section 6.1",
                criterion="none of the crossings meets Table 5.3",
                fitted=FITTED_CONTROLLED,
            )
    solved = [r for r in (*controlled.values(), *study.between) if "solver_residual" in r]
    if solved:
        residual, missed = max(r["solver_residual"] for r in solved), sum(r["solver_failures"] for r in solved)
        found.check(
            "solver",
            "The quadratic program is solved at every step, to 1e-6",
            "no failure, residual of 1e-6 at most",
            f"{missed} failures in {len(solved)} crossings, largest residual {residual:.1e}",
            not missed and residual <= 1e-6,
            "a step was not solved",
            "own",
            criterion="every step of every crossing under control",
        )
    return found


def _list(keys: list[Key]) -> str:
    """ " of 1.7 m at 1 km/h, 1.8 m at 1 km/h"."""
    return " of " + ", ".join(f"{a:g} m at {v:g} km/h" for a, v in keys)


def _both(study: Study, keys: list[Key], system: str) -> str:
    """The quantities that decide, at the step of the study and at half of it."""
    parts = []
    for k in keys:
        coarse, fine = study.published[*k, system], study.refined[*k, system]
        for name in dict.fromkeys((*coarse["failures"], *fine["failures"])):
            if name in LABELS and name not in set(coarse["failures"]) & set(fine["failures"]):
                parts.append(
                    f"{LABELS[name]} {coarse[name]:.4g} and {fine[name]:.4g} (limit {getattr(LIMITS, name):g})"
                )
            elif name not in LABELS:
                parts.append(name)
    return "; ".join(parts)


def _printed(key: tuple[float, float], column: str) -> float:
    value = published.number(*key, column)
    if value is None:
        raise KeyError(f"{column} of {key} is not in print here")
    return value


def _where(all_: list[tuple[float, float]], good: list[tuple[float, float]]) -> str:
    """ "; not 1.3 m at 1, 3 km/h" for what is missing from the good ones, or nothing."""
    missing = [k for k in all_ if k not in good]
    if not missing or len(missing) > len(all_) / 2:
        return ""
    lengths = dict.fromkeys(length for length, _ in missing)
    parts = [f"{a:g} m at {', '.join(f'{v:g}' for x, v in missing if x == a)} km/h" for a in lengths]
    return "; not " + ", ".join(parts)


__all__ = ["CHANCE", "GRID", "claims"]
