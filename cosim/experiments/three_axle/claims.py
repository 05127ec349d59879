"""What the thesis says of its Figures 5.5 to 5.14, judged by the runs. It prints no numbers for them."""

from __future__ import annotations

from cosim.experiments.three_axle.published import CONTROLLED, SHOWN, Place, places
from cosim.experiments.three_axle.runs import CONTROLLERS, HORIZON, LIMIT, Case
from cosim.study import ClaimList, Finding, Results

RATIO = 0.1  # peak pitch error with preview over that of another system
CLOSE = 0.25  # relative difference that still counts as "close to each other"
STEADY_DEG = 0.02
BEFORE = 10.0  # times the force of the blind controller before the edge
WORSE = 10.0  # times the steady error of MPC
SELDOM = 0.01  # of the commands of a run
FITTED = "vehicle values that the thesis does not disclose, chosen with its Table 5.4 (trench crossings) in view"
FITTED_LQR = (
    "the LQR's units: forces in kN and the wheel states' weights times 1e-4, without which the printed weights do"
    " nothing"
)

CLAIMS = ClaimList()


def place_text(place: Place) -> str:
    """Speed and depth."""
    return f"{place[0]:g} km/h, {place[1]:g} m"


def values(study: Results, metric: str, controller: str) -> list[float]:
    """A metric of a controller at each place."""
    return [study[Case(*p, controller)][metric] for p in places(study)]


@CLAIMS.claim(
    "best-at-the-trench",
    "MPC with preview rejects the disturbance best",
    published="best of the four in all six cases",
    source="Figures 5.5 to 5.11",
)
def _best_at_the_trench(study: Results) -> Finding:
    peaks = zip(*(values(study, "peak_error_deg", c) for c in ("mpc-preview", "passive", "lqr", "mpc")), strict=True)
    best = [own < min(others) for own, *others in peaks]
    return Finding(
        f"smallest peak pitch error in {sum(best)} of {len(best)}",
        all(best),
        "another system has a smaller peak",
        criterion="smallest peak pitch error at every speed and depth",
        fitted=FITTED,
    )


def _tenth(other: str, id_: str, text: str) -> None:
    @CLAIMS.claim(id_, text, published="clearly smaller in every figure; no number", source="Figures 5.5 to 5.10")
    def judge(study: Results) -> Finding:
        preview, others = (values(study, "peak_error_deg", c) for c in ("mpc-preview", other))
        ratios = [a / b for a, b in zip(preview, others, strict=True)]
        within, largest = sum(r <= RATIO for r in ratios), max(ratios)
        worst = place_text(places(study)[ratios.index(largest)])
        return Finding(
            f"within a tenth in {within} of {len(ratios)}; largest {largest:.4f} at {worst}",
            within == len(ratios),
            f"at {worst} the soft bound of 2 m/s2 on the acceleration of the body and the limit of the actuators cost "
            "accuracy: the controller gives up pitch to meet the bound",
            criterion=f"clearly: at most {RATIO:g} of the other's peak at every speed and depth",
            fitted=FITTED,
        )


_tenth("passive", "tenth-of-passive", "With preview the pitch error is clearly smaller than the passive vehicle's")
_tenth("mpc", "tenth-of-blind", "With preview the pitch error is clearly smaller than that of MPC without preview")


@CLAIMS.claim(
    "lqr-near-mpc",
    f"LQR and MPC without preview are close to each other at the trench ({place_text(SHOWN)})",
    published="close to each other",
    source="Figure 5.11",
)
def _lqr_near_mpc(study: Results) -> Finding:
    lqr, mpc = (study[Case(*SHOWN, c)]["peak_error_deg"] for c in ("lqr", "mpc"))
    return Finding(
        f"LQR's peak is {100 * (lqr / mpc - 1):+.0f} % of MPC's",
        abs(lqr / mpc - 1) <= CLOSE,
        f"more than {100 * CLOSE:.0f} % apart",
        criterion=f"peaks of the pitch error within {100 * CLOSE:g} % of each other in the run that is shown",
        fitted=f"{FITTED}; {FITTED_LQR}",
        calibrated=True,  # these units were chosen so that the LQR is comparable to MPC
    )


def _span(values: list[float]) -> str:
    """Range of values in words, "0.563 to 150", or one value if both ends print alike."""
    return " to ".join(dict.fromkeys(f"{v:.3g}" for v in (min(values), max(values))))


def _acts_before(id_: str, metric: str, event: str, figure: str) -> None:
    @CLAIMS.claim(id_, f"MPC with preview acts before {event}", published="acts before", source=figure)
    def judge(study: Results) -> Finding:
        seeing, blind = (values(study, metric, c) for c in ("mpc-preview", "mpc"))
        early = min(a / b for a, b in zip(seeing, blind, strict=True))
        return Finding(
            f"force {_span(seeing)} kN before, {early:.0f} times that without preview or more",
            early >= BEFORE,
            f"less than {BEFORE:g} times the force of the controller that knows nothing of it",
            criterion=(
                f"largest force before (change within the {HORIZON:g} s of the horizon, for the reference) at least "
                f"{BEFORE:g} times that without preview, at every speed and depth"
            ),
            fitted=FITTED,
        )


_acts_before("before-the-edge", "force_before_edge_kN", "the obstacle is met", "Figure 5.11")
_acts_before("before-the-reference", "force_before_ramp_kN", "the reference rises", "Figure 5.12")


@CLAIMS.claim(
    "ramp-preview", "MPC with preview follows the ramp best", published="the most successful", source="Figure 5.12"
)
def _ramp_preview(study: Results) -> Finding:
    seeing, lqr, blind = (values(study, "ramp_error_deg", c) for c in ("mpc-preview", "lqr", "mpc"))
    return Finding(
        f"rms error {max(seeing):.4f} deg; LQR {max(lqr):.3f}, MPC without preview {max(blind):.3f} deg",
        all(a < min(b, c) for a, b, c in zip(seeing, blind, lqr, strict=True)),
        "another controller follows it closer",
        criterion="smallest rms pitch error on the ramp in every run",
        fitted=f"{FITTED}; {FITTED_LQR}",
    )


@CLAIMS.claim(
    "ramp-lqr",
    "LQR follows the ramp slightly better than MPC without preview",
    published="a little better",
    source="Figure 5.12",
)
def _ramp_lqr(study: Results) -> Finding:
    lqr, blind = (values(study, "ramp_error_deg", c) for c in ("lqr", "mpc"))
    return Finding(
        f"rms error {min(lqr):.3f} deg compared with {max(blind):.3f} deg",
        all(a < b for a, b in zip(lqr, blind, strict=True)),
        "the regulator has neither integral action nor feed-forward: a third of every demand is missing, on the"
        " ramp too",
        criterion="smaller rms pitch error on the ramp in every run",
        fitted=f"{FITTED}; {FITTED_LQR}",
    )


def _steady_mpc_error(study: Results) -> float:
    """Largest steady error [deg] of both predictive controllers."""
    return max(v for c in ("mpc", "mpc-preview") for v in values(study, "steady_error_deg", c))


@CLAIMS.claim(
    "steady-mpc", "Both MPC controllers settle without visible error", published="sufficient", source="Figure 5.13"
)
def _steady_mpc(study: Results) -> Finding:
    largest = _steady_mpc_error(study)
    return Finding(
        f"{largest:.4f} deg at most",
        largest <= STEADY_DEG,
        f"more than {STEADY_DEG:g} deg",
        criterion=f"visible: more than {STEADY_DEG:g} deg of the 3 deg, less than the width of a line",
        fitted=FITTED,
    )


@CLAIMS.claim(
    "steady-lqr", "LQR is less successful in the steady state", published="a visible steady error", source="Figure 5.13"
)
def _steady_lqr(study: Results) -> Finding:
    least, largest = min(values(study, "steady_error_deg", "lqr")), _steady_mpc_error(study)
    return Finding(
        f"{least:.2f} deg of 3, {least / largest:.0f} times MPC's or more",
        least >= WORSE * largest,
        "less than ten times the error of MPC",
        criterion="at least ten times the error of either MPC",
        fitted=f"{FITTED}; {FITTED_LQR}",
    )


@CLAIMS.claim(
    "force-limits",
    "Almost all commands are within the limits of the actuators",
    published="almost all; instant peaks beyond",
    source="Figure 5.14",
)
def _force_limits(study: Results) -> Finding:
    most = max(v for c in CONTROLLED for v in values(study, "at_limit", c))
    return Finding(
        f"never beyond {LIMIT:g} kN (the bound is hard here), at it in {100 * most:.2f} % of the commands of a run at"
        " most",
        most < SELDOM,
        "at the limit in more than 1 % of a run",
        criterion="almost all: at the limit in less than 1 % of the commands of every run",
        fitted=f"{FITTED}; {FITTED_LQR}",
    )


@CLAIMS.check(
    "solver", "The quadratic program is solved at every step, to 1e-6", expected="no failure, residual of 1e-6 at most"
)
def _solver(study: Results) -> Finding:
    runs = [
        study[c]
        for c in study
        if CONTROLLERS[c.controller] == "MpcThreeAxle" and c.solver_parts == c.exchange_parts == 1
    ]
    failures, residual = sum(r["solver_failures"] for r in runs), max(r["solver_residual"] for r in runs)
    return Finding(
        f"{failures} failures in {len(runs)} runs, largest residual {residual:.1e},"
        f" {max(r['solver_iterations'] for r in runs)} iterations at most",
        residual <= 1e-6 and not failures,
        "a step was not solved",
        criterion="every step of every run",
    )
