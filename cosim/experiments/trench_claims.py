"""What paper 003 says of trench crossings, judged from runs of the FMUs."""

from __future__ import annotations

from cosim.experiments import trench_published as published
from cosim.experiments.trench_published import LENGTHS, SPEEDS
from cosim.experiments.trench_study import Study, passes
from cosim.report import Claims

GRID = [(length, speed) for length in LENGTHS for speed in SPEEDS]
AGREE_AT_LEAST, PASS_AT_LEAST = 31, 34  # of 36


def claims(study: Study) -> Claims:
    """Every claim with its criterion; those on what was not run are left out."""
    found = Claims()
    claim = found.judge

    passive = {k: study.published[*k, "passive"] for k in GRID}
    controlled = {k: study.published[*k, "mpc"] for k in GRID}
    assumed = "the thesis keeps its vehicle to itself, ours is assumed; so are bumpers and belly"

    agree = [k for k in GRID if passive[k]["passed"] == published.passed(*k)]
    claim(
        "passive-verdicts",
        "The passive vehicle passes and fails where Table 5.4 says so",
        "36 verdicts",
        f"{len(agree)} of 36 agree (wanted: {AGREE_AT_LEAST}){_where(GRID, agree)}",
        len(agree) >= AGREE_AT_LEAST,
        assumed,
        "Table 5.4",
    )
    short = [k for k in GRID if k[0] <= 1.3]
    good = [k for k in short if passive[k]["passed"]]
    claim(
        "passive-short",
        "Trenches of 1.2 and 1.3 m, close to the wheel diameter, are crossed passively at every speed",
        "8 of 8",
        f"{len(good)} of 8{_where(short, good)}",
        len(good) == len(short),
        assumed,
        "Table 5.4",
    )
    long = [k for k in GRID if k[0] >= 1.9]
    bad = [k for k in long if not passive[k]["passed"]]
    claim(
        "passive-long",
        "No trench of 1.9 or 2.0 m is crossed passively",
        "0 of 8",
        f"{8 - len(bad)} of 8",
        len(bad) == 8,
        assumed,
        "Table 5.4",
    )

    good = [k for k in GRID if controlled[k]["passed"]]
    belly = sum("belly contact" in controlled[k]["failures"] for k in GRID)
    claim(
        "controlled-pass",
        "Under control every crossing meets Table 5.3 without belly contact",
        "36 of 36 (by its own Table 5.7 pitch is above 15 deg in three)",
        f"{len(good)} of 36 (wanted: {PASS_AT_LEAST}), belly contact in {belly}{_where(GRID, good)}",
        len(good) >= PASS_AT_LEAST and not belly,
        "see the failures in the table of controlled runs",
        "sections 5.6 and 6.1, Table 5.3",
    )
    faster = [k for k in GRID if k[1] >= 3]
    good = [k for k in faster if controlled[k]["passed"]]
    claim(
        "controlled-faster",
        "Under control all crossings at 3 to 9 km/h succeed",
        "27 of 27",
        f"{len(good)} of 27{_where(faster, good)}",
        len(good) == 27,
        "see the failures in the table of controlled runs",
        "section 5.6",
    )
    lower = [k for k in GRID if controlled[k]["cost"] < passive[k]["cost"]]
    claim(
        "cost-below-passive",
        "Control lowers the cost in every crossing",
        "36 of 36, by 63.5 to 100 %",
        f"{len(lower)} of 36{_where(GRID, lower)}",
        len(lower) == 36,
        "a short trench at low speed costs the passive vehicle little",
        "Table 5.11",
    )
    calmer = [k for k in GRID if controlled[k]["az"] < passive[k]["az"]]
    printed = sum(_printed(k, "controlled az [m/s2]") < _printed(k, "passive az [m/s2]") for k in GRID)
    claim(
        "peak-az",
        "Control lowers the peak of the vertical acceleration, but in the shortest trenches",
        f"{printed} of 36, not at 1.2 and 1.3 m with 9 km/h",
        f"{len(calmer)} of 36{_where(GRID, calmer)}",
        len(calmer) >= printed - 2,
        "retracting an axle is felt where the passive vehicle hardly notices the trench",
        "Table 5.6",
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
                crossed < len(rows) / 2,
                "here it also gets cases, pitch reference and forced ranges where it takes them, which helps it over",
                "section 6.1",
            )
    return found


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


__all__ = ["AGREE_AT_LEAST", "GRID", "PASS_AT_LEAST", "claims"]
