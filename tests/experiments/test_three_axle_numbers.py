"""What readers see of three-axle, from recordings and runs made by hand whose answers are known."""

from __future__ import annotations

import math
from typing import Any

import made_up
import numpy as np
import pytest
from altered import altered

from cosim.experiments.steps import halved
from cosim.experiments.three_axle import EXPERIMENT, published
from cosim.experiments.three_axle.claims import CLAIMS
from cosim.experiments.three_axle.report import report
from cosim.experiments.three_axle.runs import CONTROLLERS, METRICS, Case, measure, signals
from cosim.report import Report
from cosim.study import FmuSet, Results
from fmu_sources.controllers.mpc.three_axle import ESTIMATORS, PREDICTION
from fmu_sources.models.corners import SIX_CORNERS

# ------------------------------------------------------------------------------------- a run: errors and forces by hand

T = np.round(np.arange(0, 25.0001, 0.05), 6)
TARGET = np.interp(T, [15, 17, 22, 24], [0, 0.06, 0.06, 0])  # rad
STARTS = {
    "reference.ramp.start": 15.0,
    "reference.ramp.duration": 2.0,
    "reference.hold.duration": 5.0,
    "reference.return.duration": 2.0,
}


def between(start: float, end: float) -> np.ndarray:
    return (start - 1e-9 <= T) & (end - 1e-9 > T)


def recording(case: Case) -> made_up.MadeUpRun:
    error = np.zeros(len(T))  # rad
    for start, end, value in (
        (0, 5, 0.01),
        (5, 6, -0.02),
        (14.5, 15, 0.1),
        (15, 17, -0.003),
        (17, 21, 0.05),
        (21, 21.05, 0.004),
        (21.05, 21.7, 0.002),
        (21.7, 25, 0.07),
    ):
        error[between(start, end)] = value
    force = np.zeros((len(T), 6))  # N
    force[between(1.0, 1.5), 3] = -30e3  # before the edge, second axle, right
    force[between(1.5, 2.0), 3] = -40e3
    force[between(2.0, 2.5), 0] = 70e3
    force[between(3.0, 3.5), 4] = -150e3  # 10 samples at the limit, third axle, left
    force[between(14.7, 14.75), 1] = 90e3  # before the horizon
    force[between(14.75, 14.8), 1] = 12e3  # the first of the horizon
    force[between(14.8, 14.95), 1] = 10e3
    force[between(14.95, 15.0), 1] = 25e3
    force[between(15.0, 15.5), 1] = 100e3  # when the reference rises already
    road = np.where(between(1.5, 2.0), -0.0003, np.where(between(2.0, 4.0), -0.15, 0.0))  # begun: 0.25 % of 0.15 m
    return made_up.run(
        case,
        T,
        {
            "car.body.pitch": TARGET + error,
            "car.body.roll": 9.0,
            "reference.reference.pitch[1]": TARGET,
            "car.body.z": np.where(between(20, 20.5), -0.0712, 0.001),
            "car.body.az": np.where(between(14.5, 26), 50.0, -2.0),
            **{f"road.road.{k}.height": road if k == "a1l" else 0.01 * i for i, k in enumerate(SIX_CORNERS)},
            **{f"controller.force.{k}": force[:, i] for i, k in enumerate(SIX_CORNERS)},
            "controller.solver.status": np.where(between(7, 7.15), 2, 0),
            "controller.solver.residual": 1e-9 * T,
            "controller.solver.iterations": np.where(between(9, 9.1), 17, 3),
            "controller.slack": np.where(between(9, 9.1), 0.25, 0),
        },
        STARTS,
    )


def test_metrics_of_a_run() -> None:
    found = measure(recording(Case(depth=0.15)))
    rms = math.degrees(math.sqrt((100 * 0.01**2 + 20 * 0.02**2) / 290))
    assert found == pytest.approx(
        {
            "peak_error_deg": math.degrees(0.02),
            "rms_error_deg": rms,
            "peak_force_kN": 150.0,
            "at_limit": 10 / (501 * 6),
            "force_before_edge_kN": 40.0,
            "peak_heave_m": 0.0712,
            "rms_az": 2.0,
            "force_before_ramp_kN": 13.0,
            "ramp_error_deg": math.degrees(0.003),
            "steady_error_deg": math.degrees(0.004),
            "solver_failures": 3,
            "solver_residual": 25e-9,
            "solver_iterations": 17,
            "slack": 0.25,
        }
    )
    assert {m.heading: m.shown(found[k]) for k, m in METRICS.items()} == {
        "peak error at the trench [deg]": "1.1459",
        "rms error at the trench [deg]": f"{rms:.4f}",
        "rms error on the ramp [deg]": "0.1719",
        "steady error [deg]": "0.2292",
        "peak heave [mm]": "71.2",
        "rms vertical acceleration [m/s2]": "2.000",
        "peak force [kN]": "150.0",
        "force before the edge [kN]": "40.00",
        "largest slack [-]": "0.25",
    }


def test_a_deeper_trench_begins_where_it_is_as_much_deeper() -> None:
    deep, shallow = (measure(recording(Case(depth=d))) for d in (0.15, 0.1))
    assert {k for k in deep if deep[k] != shallow[k]} == {"force_before_edge_kN"}
    assert shallow["force_before_edge_kN"] == 30.0  # 0.3 mm are more than 0.25 % of 0.1 m


def test_a_short_run_has_no_figures_of_the_reference() -> None:
    whole = recording(Case())
    short = made_up.run(Case(), T[:400], {n: whole.recording[n][:400] for n in whole.recording}, STARTS)
    assert {"force_before_ramp_kN", "ramp_error_deg", "steady_error_deg"} == measure(whole).keys() - measure(
        short
    ).keys()


def test_signals_of_a_run() -> None:
    found = signals(recording(Case()))
    at = {"edge": 40, "limit": 60, "ramp": 320}  # 2, 3 and 16 s
    assert found.keys() == {"time", "pitch", "reference", "road", "force.a1l", "force.a2l", "force.a3l"}
    assert [found["time"][i] for i in at.values()] == [2.0, 3.0, 16.0]
    assert found["reference"][at["ramp"]] == float(f"{math.degrees(0.03):.6g}")
    assert found["pitch"][at["ramp"]] == float(f"{math.degrees(0.027):.6g}")
    assert [found["road"][i] for i in at.values()] == [-150.0, -150.0, 0.0]
    assert [found["force.a1l"][i] for i in at.values()] == [70.0, 0.0, 0.0]
    assert [found["force.a3l"][i] for i in at.values()] == [0.0, -150.0, 0.0]
    assert not any(found["force.a2l"])


# ---------------------------------------------------------------------------------------- a study: every cell by hand

BASE = {
    "peak_error_deg": 1.0,
    "rms_error_deg": 0.5,
    "ramp_error_deg": 0.2,
    "steady_error_deg": 0.01,
    "peak_heave_m": 0.05,
    "rms_az": 0.75,
    "peak_force_kN": 80.0,
    "force_before_edge_kN": 2.0,
    "slack": 0.5,
    "at_limit": 0.0,
    "force_before_ramp_kN": 1.5,
    "solver_failures": 0,
    "solver_residual": 1e-8,
    "solver_iterations": 9,
}
BY_CONTROLLER: dict[str, dict[str, float]] = {
    "passive": {"peak_error_deg": 3.0, "peak_force_kN": 0.0},
    "lqr": {"peak_error_deg": 1.2, "steady_error_deg": 1.0, "ramp_error_deg": 0.9, "at_limit": 0.002},
    "mpc": {"force_before_edge_kN": 0.1, "force_before_ramp_kN": 0.1},
    "mpc-preview": {"peak_error_deg": 0.05, "ramp_error_deg": 0.004},
}


def metrics(case: Case) -> dict[str, Any]:
    """Larger by speed and depth, with fine steps and for variants, so that no two cells are alike."""
    factor = 1 + 0.01 * case.speed_kmh + case.depth + 1e-3 * (case.solver_parts - 1) + 2e-3 * (case.exchange_parts - 1)
    factor += 0.1 * case.hold_height + 0.03 * ("offsets", "measured", "road").index(case.estimator)
    row = {
        k: v if k.startswith("solver_") else factor * v for k, v in {**BASE, **BY_CONTROLLER[case.controller]}.items()
    }
    return {k: v for k, v in row.items() if "mpc" in case.controller or not (k.startswith("solver") or k == "slack")}


def drawn(case: Case) -> dict[str, list[float]]:
    """Six seconds at a time: signals by case, no two alike."""
    time = np.arange(0.0, 26.0)
    number = 100 * (1 + list(CONTROLLERS).index(case.controller)) + case.speed_kmh + case.depth
    names = ("pitch", "reference", "force.a1l", "force.a2l", "force.a3l")
    found = {n: (number * (i + 1) + time**2).tolist() for i, n in enumerate(names)}
    return {
        "time": time.tolist(),
        **found,
        "road": (
            np.select(
                [time < 6, time < 7, time < 8], [0.0, -2 * case.depth, -3 * case.depth], -1e3 * case.depth
            ).tolist()
        ),
    }


def test_cells_of_the_tables(page: Report) -> None:
    rows = made_up.table(page, "table-5-1")
    assert len(rows) == 24
    assert rows[-2] == {  # of the MPC at 20 km/h and 0.25 m: 1.45 times BASE
        "speed [km/h]": 20.0,
        "depth [m]": 0.25,
        "system": "MPC",
        "peak error at the trench [deg]": 1.45,
        "rms error at the trench [deg]": 0.725,
        "rms error on the ramp [deg]": 0.29,
        "steady error [deg]": 0.0145,
        "peak heave [mm]": 72.5,
        "rms vertical acceleration [m/s2]": 1.087,
        "peak force [kN]": 116.0,
        "force before the edge [kN]": 0.14,
        "largest slack [-]": 0.72,
    }
    assert rows[0]["largest slack [-]"] is None  # passive
    assert [r["system"] for r in rows[:4]] == ["passive", "LQR", "MPC", "MPC with preview"]
    rows = made_up.table(page, "variants")
    assert len(rows) == 24
    assert [r["peak heave [mm]"] for r in rows[::6]] == [65.0, 65.0, 61.5, 63.0]  # at 5 km/h and 0.15 m
    assert rows[-1] | {"peak heave [mm]": 0} == rows[-1] | {
        "variant": "without preview, estimator with road heights",
        "speed [km/h]": 20.0,
        "depth [m]": 0.25,
        "peak heave [mm]": 0,
        "peak error at the trench [deg]": 1.51,
    }


def test_cells_of_finer_steps(page: Report) -> None:
    rows = made_up.table(page, "refinement")
    assert [(r["system"], r["steps"]) for r in rows[3:6]] == [
        ("LQR", "as in the runs"),
        ("LQR", "solver step halved"),
        ("LQR", "communication step halved"),
    ]
    assert [r["largest change [%]"] for r in rows[3:6]] == pytest.approx([0, 0.1 / 1.45, 0.2 / 1.45])
    assert list(rows[4].values())[2:6] == pytest.approx([1.451 * v for v in (1.2, 0.9, 0.75, 80.0)])
    assert rows[1]["largest change [%]"] == pytest.approx(0.1 / 1.45)  # passive: no force to compare


def test_figures_draw_what_they_say(page: Report) -> None:
    names = {"passive": "passive", "lqr": "LQR", "mpc": "MPC", "mpc-preview": "MPC with preview"}
    for controller, name in names.items():
        own = drawn(Case(10.0, 0.25, controller))
        curve = made_up.series(page, "figures-5-5-to-5-10", "10 km/h, 0.25 m", name)
        assert (list(curve.x), list(curve.y)) == (own["time"], own["pitch"])
        shown = drawn(Case(5.0, 0.15, controller))
        curve = made_up.series(page, "figure-5-11", "all systems", name)
        assert (list(curve.x), list(curve.y)) == (shown["time"][1:11], shown["pitch"][1:11])
        if controller != "passive":
            for axle, signal in (("first", "force.a1l"), ("second", "force.a2l"), ("third", "force.a3l")):
                curve = made_up.series(page, "figure-5-14", f"{axle} axle, left", name)
                assert (list(curve.x), list(curve.y)) == (shown["time"], shown[signal])
            curve = made_up.series(page, "figures-5-12-5-13", "whole demand", name)
            assert (list(curve.x), list(curve.y)) == (shown["time"][14:], shown["pitch"][14:])
            assert list(made_up.series(page, "figures-5-12-5-13", "start of the ramp", name).x) == [15.0, 16.0]
    passive = drawn(Case(5.0, 0.15, "passive"))
    target = made_up.series(page, "figures-5-12-5-13", "whole demand", "reference")
    assert list(target.y) == passive["reference"][14:]
    close = made_up.series(page, "figure-5-11", "with preview; the road begins to fall at 7.00 s", "MPC with preview")
    assert list(close.y) == drawn(Case(5.0, 0.15))["pitch"][1:11]
    assert list(made_up.series(page, "figure-5-4", "", "0.25 m deep").y) == drawn(Case(5.0, 0.25, "passive"))["road"]


def test_words(page: Report, sentence) -> None:
    sentence(made_up.words(page))


def test_the_vehicle_is_said_to_be_fitted_beside_every_published_verdict(study: Results) -> None:
    assert [c.id for c in CLAIMS.judge(study) if not c.own and "Table 5.4" not in c.fitted] == []


def test_a_range_that_prints_as_one_figure_is_one(study: Results) -> None:
    changed = altered(study, {c: {"force_before_ramp_kN": 2.17} for c in study if c.controller == "mpc-preview"})
    ours = {c.id: c.result for c in CLAIMS.judge(changed)}["before-the-reference"]
    assert ours.startswith("force 2.17 kN before, ")


@pytest.mark.parametrize(
    ("controller", "metric", "value", "lost"),
    [
        ("lqr", "peak_error_deg", 0.01, {"best-at-the-trench"}),
        ("passive", "peak_error_deg", 0.7, {"tenth-of-passive"}),
        ("mpc", "peak_error_deg", 0.7, {"tenth-of-blind"}),
        ("mpc-preview", "force_before_edge_kN", 1.3, {"before-the-edge"}),
        ("mpc-preview", "force_before_ramp_kN", 1.3, {"before-the-reference"}),
        ("mpc-preview", "ramp_error_deg", 0.5, {"ramp-preview"}),
        ("mpc", "steady_error_deg", 0.021, {"steady-mpc"}),
        ("mpc-preview", "steady_error_deg", 0.15, {"steady-mpc", "steady-lqr"}),
        ("mpc", "at_limit", 0.011, {"force-limits"}),
        ("mpc", "solver_failures", 1, {"solver"}),
        ("mpc-preview", "solver_residual", 2e-6, {"solver"}),
    ],
)
def test_one_place_decides(study: Results, controller: str, metric: str, value: float, lost: set[str]) -> None:
    """Every claim holds at all places or not at all."""
    changed = altered(study, {Case(20.0, 0.25, controller): {metric: value}})
    before, after = ({c.id: c.passed for c in CLAIMS.judge(s)} for s in (study, changed))
    assert {k for k in before if before[k] and not after[k]} == lost


def test_close_is_a_quarter(study: Results) -> None:
    for peak, verdict in (
        (1.24, "calibrated"),
        (1.26, "not reproduced"),
        (0.76, "calibrated"),
        (0.74, "not reproduced"),
    ):
        changed = altered(study, {Case(*published.SHOWN, "lqr"): {"peak_error_deg": 1.2 * peak}})
        assert {c.id: c.verdict for c in CLAIMS.judge(changed)}["lqr-near-mpc"] == verdict
    said = next(c for c in CLAIMS.judge(changed) if c.id == "lqr-near-mpc")
    assert (said.reason, said.criterion) == (
        "more than 25 % apart",
        "peaks of the pitch error within 25 % of each other in the run that is shown",
    )


def test_finer_steps_are_those_of_the_hardest_place() -> None:
    finer = {c for t in published.plan() for c in [t.case] if c.solver_parts * c.exchange_parts > 1}
    assert finer == {c for k in CONTROLLERS for c in halved(Case(20.0, 0.25, k)).values()}


def test_a_change_counts_in_either_direction(fmus: FmuSet) -> None:
    """Finer steps that lower everything by 1 %."""
    lower = lambda case: {k: v * (0.99 if case.solver_parts > 1 else 1.0) for k, v in BASE.items()}  # noqa: E731
    rows = made_up.table(report(made_up.study(EXPERIMENT, lower, drawn), fmus), "refinement")
    assert [r["largest change [%]"] for r in rows[:3]] == pytest.approx([0.0, 1.0, 0.0])


def test_the_largest_change_counts(fmus: FmuSet) -> None:
    """Finer steps that change one metric by 3 % and leave the others."""
    one = lambda case: {k: v * (1.03 if k == "rms_az" and case.solver_parts > 1 else 1.0) for k, v in BASE.items()}  # noqa: E731
    rows = made_up.table(report(made_up.study(EXPERIMENT, one, drawn), fmus), "refinement")
    assert [r["largest change [%]"] for r in rows[:3]] == pytest.approx([0.0, 3.0, 0.0])


def test_the_system_of_a_case(fmus: FmuSet) -> None:
    case = Case(18.0, 0.25, "passive")
    with EXPERIMENT.wiring.wire(fmus, case) as system:
        assert EXPERIMENT.wiring.configure is not None
        EXPERIMENT.wiring.configure(system, case)
        assert system["speed"].values["start.speed"] == pytest.approx(5.0)
        assert system["road"].values["trench.depth"] == 0.25
        assert float(system["car"].step) == 0.001


def test_labels_of_cases() -> None:
    assert Case(10.0, 0.25, "mpc").label == "10kmh-250mm-mpc"


@pytest.mark.parametrize("controller", [c for c in CONTROLLERS if c != "passive"])
def test_the_laws_of_a_case(fmus: FmuSet, controller: str) -> None:
    case = Case(18.0, 0.25, controller, **({} if controller == "lqr" else {"estimator": "road", "hold_height": True}))
    with EXPERIMENT.wiring.wire(fmus, case) as system:
        assert EXPERIMENT.wiring.configure is not None
        EXPERIMENT.wiring.configure(system, case)
        made = {c.target_name: c.source_name for c in system.connections.values()}
        for k in SIX_CORNERS:
            assert made[f"car.force.{k}"] == f"controller.force.{k}"
            assert (f"controller.preview.{k}[2]" in made) == (controller != "lqr")
        assert made["controller.body.pitch"] == "car.body.pitch"
        ahead = {n: s for n, s in made.items() if n.startswith("controller.reference.pitch")}
        if controller == "lqr":
            assert ahead == {"controller.reference.pitch": "reference.reference.pitch[1]"}
            return
        assert len(ahead) == PREDICTION
        seen = "reference.reference.pitch[3]" if controller == "mpc-preview" else "reference.reference.pitch[1]"
        assert ahead["controller.reference.pitch[3]"] == seen
        law = system["controller"].values
        assert (law["estimator"], law["hold_height"], law["use_preview"]) == (
            ESTIMATORS.index("road"),
            True,
            controller == "mpc-preview",
        )
