"""The claims of paper 000, each judged from the study's own numbers."""

from __future__ import annotations

import math
import statistics

from cosim.experiments import gpc_study as gs
from cosim.experiments.gpc import SPEEDS_KMH
from cosim.experiments.gpc_study import LAWS, Study, one, select
from cosim.report import Claims

NAN = float("nan")


def claims(study: Study) -> Claims:
    """Every published claim with the published figure, ours and a verdict."""
    m = gs.seed_medians(study)
    gain = gs.improvement_at
    result = Claims()
    claim = result.judge

    peak = m["open_loop_peak_kmh"]
    claim(
        "open-loop-peak",
        "The passive car's response on the sine road peaks at its pitch resonance",
        "50 km/h",
        f"{peak:g} km/h",
        abs(peak - 50) <= 5,
        "the pitch mode of the stand-in vehicle lies elsewhere",
        "Figure 7a",
        peak,
        "km/h",
    )
    for law in ("explicit", "preview"):
        x = m[f"sine_improvement_{law}"]
        claim(
            f"sine-{law}",
            f"GPC {law} reduces the response peak on the sine road at 50 km/h (R = 1e-7, median of 8 seeds)",
            "60 %",
            f"{100 * x:.0f} %",
            abs(x - 0.57) <= 0.06,
            "expected 57 ± 6 % with the stand-in vehicle; the identified law differs",
            "Figure 7",
            x,
        )
    ratio = m["sine_force_ratio"]
    claim(
        "sine-same-force",
        "Explicit and preview need the same force on the sine road",
        "nearly equal",
        f"ratio {ratio:.3f}",
        abs(ratio - 1) <= 0.12,
        "forces differ by more than 12 %",
        "Figure 7c",
        ratio,
    )
    p60 = m["power_ratio_implicit_60"]
    claim(
        "implicit-power-60",
        "Implicit needs more power than explicit for the same response (60 km/h on sine)",
        "more; almost twice at 80 km/h",
        f"{p60:.2f} times ({m['power_seeds_matched']:.0f} of 8 seeds matched)",
        p60 >= 1.5,
        "no weight brings the implicit law to the explicit law's response",
        "Figure 7d",
        p60,
    )
    row80 = one(study.comparison, road="sine", controller="implicit", speed_kmh=80)
    explicit80 = one(study.comparison, road="sine", controller="explicit", speed_kmh=80)
    p80 = row80["power"] / explicit80["power"] if row80["matched"] else NAN
    gain80 = gain(study, "sine", "explicit", 80)
    claim(
        "implicit-power-80",
        "Implicit needs almost twice the power of explicit at 80 km/h for the same response",
        "almost 2 times",
        f"{p80:.2f} times" if row80["matched"] else "no weight matches the response",
        1.6 <= p80 <= 2.4,
        f"at 80 km/h explicit with R = 1e-7 changes the response by {-100 * gain80:+.0f} %, so matching it says little about "
        "effort: with the published horizon of 8 samples the laws stop helping above about 70 km/h",
        "Figure 7d",
        p80,
    )
    at50 = {c: _ratio(study, "sine", 50, "implicit", c, "force") for c in ("explicit", "preview")}
    claim(
        "implicit-force-50",
        "Implicit needs much higher forces than the other two on the sine road at 50 km/h",
        "much higher",
        f"{at50['explicit']:.2f} times explicit's, {at50['preview']:.2f} times preview's",
        min(at50.values()) > 1.2,
        "matched to explicit's response at this speed, implicit needs about the same force here; the level of excitation, on which "
        "the implicit law depends, is not published, and 2 kN per actuator is assumed",
        "Figure 8",
        at50["explicit"],
    )
    changes = {c: [_change(study, "sine", 50, k, c) for k in ("rms_az", "rms_pitch")] for c in LAWS}
    rolled = [one(study.comparison, road="sine", speed_kmh=50, controller=c)["rms_roll"] for c in LAWS]
    claim(
        "sine-signals",
        "All three laws lower vertical acceleration and pitch on the sine road at 50 km/h, and roll rises",
        "as stated",
        "; ".join(f"{c} acceleration {100 * z:+.0f} %, pitch {100 * q:+.0f} %" for c, (z, q) in changes.items()),
        all(max(x) < 0 for x in changes.values()) and min(rolled) > 1e-6,
        "one of them rises, or roll stays zero",
        "Figure 8",
    )
    for law, bound in (("explicit", 0.25), ("preview", 0.28)):
        x = m[f"perryman_improvement_{law}"]
        claim(
            f"perryman-{law}",
            f"GPC {law} reduces the highest open-loop response on Perryman 3 (median of 8 seeds)",
            "more than 25 %",
            f"{100 * x:.0f} % at {m['perryman_speed_kmh']:g} km/h",
            x >= bound,
            f"below {100 * bound:.0f} % on the synthetic road",
            "Figure 9",
            x,
        )
    matched = all(
        one(study.comparison, road="perryman3", controller="preview", speed_kmh=v)["matched"] for v in SPEEDS_KMH
    )
    forces = [_ratio(study, "perryman3", v, "preview", "explicit", "force") for v in SPEEDS_KMH]
    claim(
        "perryman-same",
        "Explicit and preview have almost the same response and force on Perryman 3",
        "almost identical",
        f"preview's force {min(forces):.2f} to {max(forces):.2f} times explicit's at equal response",
        matched and all(abs(f - 1) <= 0.2 for f in forces),
        "preview needs less force than explicit for the same response, because explicit takes the road ahead to be at height 0 "
        "and this synthetic road is never there for long",
        "Figure 9",
    )
    rough = {v: _ratio(study, "perryman3", v, "implicit", "explicit", "force") for v in SPEEDS_KMH}
    higher = [v for v in SPEEDS_KMH if rough[v] > 1.1]
    claim(
        "perryman-implicit",
        "Implicit needs much higher forces for the same response on Perryman 3",
        "significantly higher",
        f"{min(rough.values()):.2f} to {max(rough.values()):.2f} times explicit's; clearly higher at "
        f"{', '.join(map(str, higher)) or 'no'} km/h",
        len(higher) == len(SPEEDS_KMH),
        "at the other speeds implicit needs about as much or less: explicit pays for its assumption of height 0 ahead, and where "
        "no law helps (80 km/h) weak control matches the response",
        "Figure 9c",
    )
    curb_best = {law: gain(study, "curb", law, 80) for law in LAWS}
    claim(
        "curb-gain",
        "All three laws reduce the response on the curb at the highest speed",
        "up to 14 %",
        ", ".join(f"{law} {100 * x:.0f} %" for law, x in curb_best.items()),
        all(x > 0 for x in curb_best.values()),
        "at least one law is worse than the passive car at 80 km/h: explicit assumes that the road ahead is at height 0, so a "
        "step up is fought for as long as it lasts",
        "Figure 11a",
    )
    highest = [
        v
        for v in SPEEDS_KMH
        if _force(study, "curb", "explicit", v) >= max(_force(study, "curb", c, v) for c in LAWS) - 1e-9
    ]
    claim(
        "curb-explicit-force",
        "Explicit needs the highest mean force on the curb",
        "highest, twice the implicit law's",
        f"highest at {len(highest)} of {len(SPEEDS_KMH)} speeds",
        len(highest) == len(SPEEDS_KMH),
        "at some speeds the matched implicit law needs more",
        "Figure 11c",
    )
    preview_power = {
        v: one(study.comparison, road="curb", controller="preview", speed_kmh=v)["power"] for v in SPEEDS_KMH
    }
    above = max(w for v, w in preview_power.items() if v > 50)
    claim(
        "curb-preview-200",
        "Preview needs less than 200 W on the curb above 50 km/h",
        "below 200 W",
        f"at most {above:.0f} W",
        above < 200,
        "the stand-in vehicle asks for more",
        "Figure 11d",
        above,
        "W",
    )
    least = [
        v
        for v in SPEEDS_KMH
        if preview_power[v]
        <= min(one(study.comparison, road="curb", controller=c, speed_kmh=v)["power"] for c in LAWS) + 1e-9
    ]
    claim(
        "curb-preview-power",
        "Preview needs the least power of the three on the curb",
        "least at all speeds",
        f"least at {len(least)} of {len(SPEEDS_KMH)} speeds, far below explicit at all",
        len(least) == len(SPEEDS_KMH),
        "at the other speeds implicit matches the same response with slightly less mean power, though with a higher peak force",
        "Figure 11d",
    )
    count = m["curb_seeds_preview_lower_peak"]
    claim(
        "curb-peak",
        "At 72 km/h on the curb preview's peak force is below explicit's (R = 1e-7)",
        "lowest of the three",
        f"in {count:.0f} of 8 seeds; medians: preview {m['curb_peak_preview'] / 1e3:.1f} kN, explicit "
        f"{m['curb_peak_explicit'] / 1e3:.1f} kN, implicit {m['curb_peak_implicit'] / 1e3:.1f} kN",
        count >= 7,
        "preview's peak is not lower in at least 7 of 8 seeds",
        "Figure 12",
        count,
        "seeds",
    )
    falls = _falls_with_weight(study)
    rest = [v for v in SPEEDS_KMH if v not in falls]
    claim(
        "weight-power",
        "Effectiveness per power falls as the control weight falls",
        "falls",
        f"falls at {', '.join(map(str, falls))} km/h",
        len(falls) >= len(SPEEDS_KMH) - 1,
        f"at {', '.join(map(str, rest))} km/h the lowest weight is not the least effective per power: there improvement is small or "
        "negative, or all weights are about equally effective",
        "Figure 6f",
    )
    spread = _spread(study, "per_force")
    claim(
        "weight-force",
        "Effectiveness per force hardly depends on the control weight",
        "the curves coalesce",
        f"largest over smallest weight, median over speeds: {spread:.2f}",
        spread <= 1.5,
        "effectiveness per force differs between weights by more than half",
        "Figure 6e",
        spread,
    )
    share = m["largest_force_share"]
    claim(
        "force-limit",
        "At R = 1e-7 the forces reach the actuator limit",
        "limit of 150 kN reached",
        f"at most {100 * share:.0f} % of the limit",
        share >= 0.99,
        "150 kN per corner is three times the weight of the whole car; no law here asks for a tenth of that once commands are "
        "trimmed and histories start filled",
        "Figure 6",
        share,
    )
    rolls = _change(study, "perryman3", worst := gs.worst_speed(study, "perryman3"), "rms_roll")
    heaves = _change(study, "perryman3", worst, "rms_az")
    claim(
        "perryman-roll",
        "Roll and vertical acceleration rise slightly on Perryman 3 while pitch falls",
        "slight increases",
        f"at {worst:g} km/h roll {100 * rolls:+.0f} %, vertical acceleration {100 * heaves:+.0f} % (preview)",
        rolls > 0 and heaves > 0,
        "on the synthetic road the laws lower at least one of them too",
        "Figure 10",
    )
    diverged = m["diverged_runs"]
    claim(
        "no-divergence",
        "Every run with R of at least 1e-7 stays stable",
        "all shown runs",
        f"{diverged:.0f} diverged runs",
        diverged == 0,
        "some runs diverge",
        "Table 2",
        diverged,
        "runs",
    )
    return result


def _ratio(study: Study, road: str, speed: float, a: str, b: str, key: str) -> float:
    rows = select(study.comparison, road=road, speed_kmh=speed)
    top, bottom = one(rows, controller=a), one(rows, controller=b)
    return NAN if top["diverged"] or bottom["diverged"] else float(top[key] / bottom[key])


def _force(study: Study, road: str, controller: str, speed: float) -> float:
    row = one(study.comparison, road=road, controller=controller, speed_kmh=speed)
    return math.inf if row["diverged"] else float(row["force"])


def _change(study: Study, road: str, speed: float, key: str, controller: str = "preview") -> float:
    """Relative change of a quantity against the passive car."""
    rows = select(study.comparison, road=road, speed_kmh=speed)
    return float(one(rows, controller=controller)[key] / one(rows, controller="passive")[key] - 1)


def _over_weights(study: Study, key: str, speed: float) -> list[float]:
    return [
        gs.figure_metrics(study, r)[key] for r in sorted(select(study.sweep, speed_kmh=speed), key=lambda r: r["R"])
    ]


def _falls_with_weight(study: Study) -> list[int]:
    """Speeds [km/h] at which the power-normalised effectiveness (24b) is lowest for the lowest weight."""
    return [v for v in SPEEDS_KMH if (curve := _over_weights(study, "per_power", v))[0] == min(curve)]


def _spread(study: Study, key: str) -> float:
    """Largest over smallest value of a quantity over the weights, median over the speeds where all are positive."""
    curves = [_over_weights(study, key, v) for v in SPEEDS_KMH]
    return statistics.median(max(c) / min(c) for c in curves if min(c) > 0)
