"""The claims of paper 001 on the whole vehicle, each judged from the study's own numbers."""

from __future__ import annotations

from dataclasses import replace

from cosim.comfort import ABSORBED_POWER_LIMIT
from cosim.experiments import hmmwv_preview, hmmwv_tracking
from cosim.experiments.hmmwv import ROADS, Case
from cosim.experiments.hmmwv_study import WITHOUT_PREVIEW, Study, estimated
from cosim.report import Claims

TWOFOLD = 2.0  # passive over controlled
THREEFOLD = 2.7  # "near threefold", passive over MPC with preview
MPC_BEST = 0.9  # of the best of the others
PREVIEW_HELPS = 0.85  # of MPC without preview: the published 15 %
SATURATION = 0.7  # of MPC without preview
ESTIMATES_COST = 1.1  # of the same on true states
NAMES = {
    "passive": "passive",
    "zero": "zero force",
    "skyhook": "skyhook",
    "lqr": "LQR",
    "lqr-kilonewton": "LQR, force in kN",
    "mpc": "MPC",
    "mpc-preview": "MPC with preview",
}
ROAD_NAMES = {"track": "test track", "bump": "one 76 mm bump", "off-road": "off road"}


def claims(study: Study) -> Claims:
    """Every published claim with the published figure, ours and a verdict; those on parts if the parts were run."""
    result = Claims()
    if study.tracking is not None:
        result += hmmwv_tracking.tracking_claims(study.tracking)

    claim = result.judge

    power = {(r, c): study.power(Case(r, c)) for r in ROADS for c in NAMES}

    # ------------------------------------------------------------------------------------------------ test track

    passive = power["track", "passive"]
    for controller in (*WITHOUT_PREVIEW, "mpc"):
        ours = power["track", controller]
        claim(
            f"track-{controller}",
            f"Test track: {NAMES[controller]} at least halves the absorbed power of the passive car",
            "better than twofold",
            f"{passive:.1f} over {ours:.1f} W: {passive / ours:.1f} times",
            passive / ours >= TWOFOLD,
            "less than twofold",
            "Figure 1.9",
            passive / ours,
            "-",
        )
    alike = [power["track", c] for c in WITHOUT_PREVIEW]
    claim(
        "track-alike",
        "Test track: skyhook and LQR are comparable",
        "comparable",
        f"with zero force {min(alike):.1f} to {max(alike):.1f} W, within {100 * (max(alike) / min(alike) - 1):.0f} %",
        max(alike) / min(alike) <= 1.2,
        "more than 20 % apart",
        "Figure 1.9",
        max(alike) / min(alike),
        "-",
    )
    share = power["track", "mpc"] / min(alike)
    claim(
        "track-mpc-best",
        "Test track: MPC without preview is the best of those without preview",
        "slightly better",
        f"{100 * (1 - share):.0f} % below the best other one ({power['track', 'mpc']:.1f} against {min(alike):.1f} W)",
        share <= MPC_BEST,
        "less than 10 % below the best other one",
        "Figure 1.9",
        share,
        "-",
    )

    # -------------------------------------------------------------------------------------------------- off road

    for controller in ("passive", "skyhook", "lqr", "mpc"):
        case = Case("off-road", controller)
        (low, high), count, below = study.spread("absorbed_power", case), len(study.runs(case)), controller == "mpc"
        side = "below" if below else "above"
        claim(
            f"off-road-{controller}",
            f"Off road at 20 mph: {NAMES[controller]} is {side} the {ABSORBED_POWER_LIMIT:g} W that a driver bears",
            f"{side} {ABSORBED_POWER_LIMIT:g} W",
            f"{power['off-road', controller]:.1f} W, {low:.1f} to {high:.1f} W over {count} stretches",
            high < ABSORBED_POWER_LIMIT if below else low > ABSORBED_POWER_LIMIT,
            f"not on every stretch; the mean is {side if below == (power['off-road', controller] < 6) else 'on the other side'}",
            "Figure 1.10",
            power["off-road", controller],
            "W",
        )
    travel = {c: study.mean("travel_rms", Case("off-road", c)) for c in ("lqr", "mpc")}
    claim(
        "off-road-travel",
        "Off road: MPC moves the suspension less",
        "reduced travel",
        f"{1e3 * travel['mpc']:.1f} mm rms, LQR {1e3 * travel['lqr']:.1f} mm",
        travel["mpc"] <= travel["lqr"],
        "it moves it more",
        "Figure 1.10",
        travel["mpc"] / travel["lqr"],
        "-",
    )

    # --------------------------------------------------------------------------------------------------- preview

    mpc, preview = power["bump", "mpc"], power["bump", "mpc-preview"]
    claim(
        "bump-preview",
        "One 76 mm bump: preview improves MPC",
        "15 %",
        f"{100 * (1 - preview / mpc):.0f} % ({preview:.2f} against {mpc:.2f} W)",
        preview / mpc <= PREVIEW_HELPS,
        "less than 15 %",
        "Figure 1.11",
        preview / mpc,
        "-",
    )
    ratio = power["bump", "passive"] / preview
    claim(
        "bump-threefold",
        "One 76 mm bump: MPC with preview against the passive car",
        "near threefold",
        f"{power['bump', 'passive']:.1f} over {preview:.2f} W: {ratio:.1f} times",
        ratio >= THREEFOLD,
        "less than 2.7 times",
        "Figures 1.9, 1.11",
        ratio,
        "-",
    )
    saturation = {c: study.mean("saturation", Case("bump", c)) for c in ("mpc", "mpc-preview")}
    share = saturation["mpc-preview"] / max(saturation["mpc"], 1e-9)
    claim(
        "bump-saturation",
        "One 76 mm bump: with preview the valves saturate less",
        "reduced, in theory",
        f"{100 * saturation['mpc-preview']:.2f} against {100 * saturation['mpc']:.2f} % of the time",
        share <= SATURATION,
        "more than 70 % of the time without preview",
        "section 1.6",
        share,
        "-",
    )

    # ------------------------------------------------------------------------------------------------- estimates

    for controller in ("mpc", "mpc-preview"):
        costs = {r: study.power(estimated(controller, r)) / power[r, controller] for r in ROADS}
        worst = max(costs, key=lambda r: costs[r])
        pulling = Case("bump", controller, lift_off=False)
        linear = study.power(replace(pulling, states="estimated")) / study.power(pulling)
        claim(
            f"estimates-{controller}",
            f"{NAMES[controller]} on the states of the Kalman filter is at most 10 % worse than on true states",
            "works on estimates",
            ", ".join(f"{ROAD_NAMES[r]} {100 * (c - 1):+.0f} %" for r, c in costs.items()),
            costs[worst] <= ESTIMATES_COST,
            f"more than 10 % on {ROAD_NAMES[worst]}; over the bump with tyres that pull, as the filter's linear model has them, "
            f"{100 * (linear - 1):+.0f} %",
            "section 1.4",
            costs[worst],
            "-",
        )
    sensed = {r: study.power(estimated("mpc-preview", r, sensed=True)) / power[r, "mpc"] for r in ROADS}
    worst = max(sensed, key=lambda r: sensed[r])
    claim(
        "sensed-preview",
        "Preview from the range sensors, behind filter, correction and buffer, improves MPC as well",
        "expected, not measured",
        ", ".join(f"{ROAD_NAMES[r]} {100 * (1 - s):.0f} %" for r, s in sensed.items()),
        sensed[worst] <= PREVIEW_HELPS,
        f"less than 15 % on {ROAD_NAMES[worst]}",
        "section 1.5",
        sensed[worst],
        "-",
    )
    if study.preview is not None:
        result += hmmwv_preview.claims(study.preview)
    return result
