"""What paper 002 says of the controllers, judged by the runs."""

from __future__ import annotations

from cosim.experiments.bench.published import (
    JUDGED,
    LONG,
    SCENARIOS,
    SHORT,
    at,
    over_stretches,
)
from cosim.experiments.bench.runs import BUMP_HEIGHT_MM
from cosim.study import Band, ClaimList, Distribution, Finding, Results, Row
from fmu_sources.controllers.mpc.bench import FORCE_LIMIT

NAMES = {
    "passive": "passive",
    "lqr": "LQR",
    "lqr-clipped": "LQR, clipped to 8 N",
    "mpc": "MPC, weight on the force",
    "mpc-moves": "MPC, weight on the moves",
}
SLIGHTLY = (2.0, 15.0)  # %, how far beyond the limit is "slightly"
CONSIDERABLY = 0.5  # of passive: what is left after a considerable reduction
FIRMLY = 0.1  # by which the tire is deflected less
SUPERIOR = 0.10  # "far superior" takes at least this much in each respect
SAME = 0.01  # equal within
COMPARED = ("acceleration", "overshoot", "travel", "tire")

CLAIMS = ClaimList()


def ratio(study: Results, scenario: str, metric: str, controller: str, base: str) -> float:
    """A metric of one controller over that of another."""
    return float(study[at(scenario, controller)][metric] / study[at(scenario, base)][metric])


def over_passive(study: Results, metric: str) -> Distribution:
    """A metric under the MPC over that of the passive bench, stretch by stretch of the random road."""
    passive, mpc = (over_stretches(c) for c in JUDGED)
    return Distribution(
        (study[a][metric] / study[b][metric] for a, b in zip(mpc, passive, strict=True)), of="stretches"
    )


def _predictive(study: Results) -> list[Row]:
    """Every run under an MPC: over all bumps and stretches, with exact and measured states, with finer steps."""
    return [study[c] for c in study if c.controller.startswith("mpc")]


def _halved(share: float) -> bool:
    return share <= CONSIDERABLY


def _firmer(share: float) -> bool:
    return share <= 1 - FIRMLY


@CLAIMS.claim(
    "force-limit",
    f"The MPC keeps the force within {FORCE_LIMIT:g} N",
    published=f"within {FORCE_LIMIT:g} N",
    source="Section V, Figure 9",
)
def _force_limit(study: Results) -> Finding:
    runs = _predictive(study)
    worst = max(max(abs(r["force.max"]), abs(r["force.min"])) for r in runs)
    return Finding(
        f"at most {worst:.6g} N in {len(runs)} runs",
        worst <= FORCE_LIMIT,
        "the force exceeds its bound",
        criterion="in every run",
    )


@CLAIMS.claim(
    "lqr-force",
    f"The LQR goes slightly beyond {FORCE_LIMIT:g} N over the bump",
    published=f"slightly beyond {FORCE_LIMIT:g} N",
    source="Section V, Figure 9",
)
def _lqr_force(study: Results) -> Finding:
    runs = {s: study[at(s, "lqr")] for s in (LONG, SHORT)}
    peak = {s: max(row["force.max"], -row["force.min"]) for s, row in runs.items()}
    return Finding(
        f"{peak[LONG]:.2f} N (0.5 s), {peak[SHORT]:.2f} N (0.2 s)",
        min(peak.values()) > FORCE_LIMIT,
        "over the shorter bump it goes further; how long the paper's bump lasts is not in print",
        100 * (max(peak.values()) / FORCE_LIMIT - 1),
        "%",
        Band(*SLIGHTLY, "slightly"),
        criterion="beyond the limit over both bumps; magnitude: the larger excess",
    )


def _calmer(study: Results, controller: str) -> Finding:
    bumps = (LONG, SHORT)
    shares = {k: [ratio(study, s, k, controller, "passive") for s in bumps] for k in ("acceleration", "overshoot")}
    before, after = ([study[at(s, c)]["acceleration"] for s in bumps] for c in ("passive", controller))
    over = shares["overshoot"]
    return Finding(
        f"rms acceleration {before[0]:.2f} to {after[0]:.2f} m/s2 (0.5 s), {before[1]:.2f} to {after[1]:.2f} m/s2 (0.2"
        f" s); overshoot to {100 * over[0]:.0f} % and {100 * over[1]:.0f} %",
        max(*shares["acceleration"], *over) <= CONSIDERABLY,
        "not halved",
        criterion="considerably: rms acceleration and overshoot at least halved over both bumps",
    )


_LESS = "vibration and overshoot considerably less than in open loop"


@CLAIMS.claim(
    "bump-lqr",
    "The LQR reduces vibration and overshoot over the bump considerably",
    published=_LESS,
    source="Figures 6, 7",
)
def _bump_lqr(study: Results) -> Finding:
    return _calmer(study, "lqr")


@CLAIMS.claim(
    "bump-mpc",
    "The MPC reduces vibration and overshoot over the bump considerably",
    published=_LESS,
    source="Figures 6, 8",
)
def _bump_mpc(study: Results) -> Finding:
    return _calmer(study, "mpc")


def _clipped(study: Results) -> list[float]:
    """Acceleration under the MPC over that under the clipped LQR, over both bumps."""
    return [ratio(study, s, "acceleration", "mpc", "lqr-clipped") for s in (LONG, SHORT)]


@CLAIMS.claim(
    "far-superior", "The MPC is far superior to the LQR in all aspects", published="far superior", source="Conclusion"
)
def _far_superior(study: Results) -> Finding:
    shares = {
        (s, k): ratio(study, s, k, "mpc", "lqr") for s in SCENARIOS for k in COMPARED if study[at(s, "lqr")][k] > 1e-6
    }
    moves = [ratio(study, s, "acceleration", "mpc-moves", "lqr") for s in SCENARIOS]
    accelerations = [v for (_, k), v in shares.items() if k == "acceleration"]
    return Finding(
        f"rms acceleration {100 * (min(accelerations) - 1):+.1f} to {100 * (max(accelerations) - 1):+.1f} % of the"
        " LQR's",
        all(v <= 1 - SUPERIOR for v in shares.values()),
        f"with the same index, the MPC does what an LQR clipped to {FORCE_LIMIT:g} N does: rms acceleration within"
        f" {100 * max(abs(e - 1) for e in _clipped(study)):.1f} % over the bumps. Weighting the moves instead of the"
        f" force, as equation (16) is written, gives {100 * (min(moves) - 1):+.0f} to {100 * (max(moves) - 1):+.0f} %"
        " of the LQR's acceleration, by another index",
        criterion=(
            f"acceleration, overshoot, travel and tire deflection all at least {100 * SUPERIOR:g} % lower on every road"
        ),
    )


@CLAIMS.claim(
    "active-constraint",
    "The MPC improves on the LQR where the constraint is active",
    published="an improvement where the constraint is active",
    source="Conclusion",
)
def _active_constraint(study: Results) -> Finding:
    equal = _clipped(study)
    return Finding(
        f"{100 * (equal[0] - 1):+.1f} % (0.5 s), {100 * (equal[1] - 1):+.1f} % (0.2 s) compared with the clipped LQR",
        max(equal) <= 1 - SAME,
        f"within {100 * SAME:.0f} % of an LQR that is simply clipped, for bumps of {BUMP_HEIGHT_MM:g} mm",
        criterion=f"rms acceleration more than {100 * SAME:g} % below the clipped LQR's over both bumps",
    )


@CLAIMS.claim(
    "random-body",
    "On a random road the MPC removes overshoot and oscillation of the body",
    published="no overshoot and oscillation",
    source="Figure 10",
)
def _random_body(study: Results) -> Finding:
    body, beyond = (over_passive(study, k) for k in ("acceleration", "overshoot"))
    return Finding(
        f"of passive: rms acceleration {body.text('{:.2f}', holds=_halved)}, overshoot"
        f" {beyond.text('{:.2f}', holds=_halved)}",
        body.is_significant(_halved) and beyond.is_significant(_halved),
        "not halved on most stretches",
        criterion="at least halved, as over the bumps; significantly so over the stretches of road (sign test at 5 %)",
    )


@CLAIMS.claim(
    "random-wheel",
    "On a random road the wheel follows the road firmly under the MPC",
    published="the wheel firmly follows the road",
    source="Figure 10",
)
def _random_wheel(study: Results) -> Finding:
    tire = over_passive(study, "tire")
    return Finding(
        f"rms tire deflection of passive: {tire.text('{:.2f}', holds=_firmer)}",
        tire.is_significant(_firmer),
        "the tire is deflected about as much as on the passive bench, or more",
        criterion=(
            f"tire deflection at least {100 * FIRMLY:g} % below passive; significantly so over the stretches of road"
        ),
    )


@CLAIMS.check(
    "solver", "The quadratic program is solved at every step, to 1e-6", expected="status 0, residual of 1e-6 at most"
)
def _solver(study: Results) -> Finding:
    runs = _predictive(study)
    failed, residual = sum(r["solver.status"] > 0 for r in runs), max(r["solver.residual"] for r in runs)
    return Finding(
        f"{failed} of {len(runs)} runs with an unsolved step, largest residual {residual:.1e}",
        not failed and residual <= 1e-6,
        "a step was not solved",
        criterion="every step of every run",
    )
