"""What readers see of the bench, from recordings and runs made by hand whose answers are known."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import made_up
import numpy as np
import pytest
from altered import altered

from cosim.experiments.bench import EXPERIMENT, published
from cosim.experiments.bench.claims import CLAIMS
from cosim.experiments.bench.published import LONG, RANDOM, SHORT, at, over_height, over_stretches
from cosim.experiments.bench.report import report
from cosim.experiments.bench.runs import METRICS, Case, force, measure, recorded, signals, stop_time, wire
from cosim.export.web.page import WebPage
from cosim.report import Report
from cosim.study import FmuSet, Results, Runner, web

# ------------------------------------------------------------------------------------------------------ a run by hand

T = np.linspace(0.0, 3.0, 3001)
SOLVED = {
    "controller.solver.status": 0.0,
    "controller.solver.iterations": 3.0,
    "controller.solver.residual": 1e-9,
    "controller.command.held": 0.0,
}


def recording(case: Case, **others: Any) -> made_up.MadeUpRun:
    found: dict[str, Any] = {
        "road.road.height": np.where(T < 0.5, 0.02, -0.01),
        "plant.body.z": np.where(T < 1.0, 0.023, -0.015),
        "plant.body.vz": 4.0 + T,
        "plant.body.az": np.where(T < 1.5, 3.0, -3.0),
        "plant.wheel.z": 0.001 + T,
        "plant.wheel.vz": 5.0 + T,
        "plant.suspension.deflection": 0.004,
        "plant.tire.deflection": -0.002,
    }
    if case.controller != "passive":
        found["controller.force"] = np.where(T < 1.5, 6.0, -8.0) - 0.5 * (T == 0.0)
    if case.controller.startswith("mpc"):
        found |= SOLVED
    return made_up.run(case, T, {**found, **others}, {})


def test_metrics_of_a_run() -> None:
    found = measure(recording(Case("lqr")))
    assert found == pytest.approx(
        {
            "acceleration": 3.0,
            "overshoot": 0.005,
            "travel": 0.004,
            "tire": 0.002,
            "force.max": 6.0,
            "force.min": -8.0,
            "force": math.sqrt((5.5**2 + 1499 * 36 + 1501 * 64) / 3001),
        }
    )
    assert {m.heading: m.shown(found[k]) for k, m in METRICS.items()} == {
        "rms acceleration of the body [m/s2]": "3",
        "body beyond the road's extremes [mm]": "5",
        "rms suspension deflection [mm]": "4",
        "rms tire deflection [mm]": "2",
        "rms force [N]": "7.071",
        "largest force [N]": "6",
        "smallest force [N]": "-8",
    }


def test_overshoot_is_beyond_the_road_on_the_side_where_it_is_more() -> None:
    for body, expected in (((0.029, -0.012), 0.009), ((0.019, -0.009), 0.0), ((0.01, -0.017), 0.007)):
        run = recording(Case("lqr"), **{"plant.body.z": np.where(T < 1.0, *body)})
        assert measure(run)["overshoot"] == pytest.approx(expected)


def test_forces_of_a_passive_bench() -> None:
    found = measure(recording(Case("passive")))
    assert [found[k] for k in ("force", "force.max", "force.min")] == [0.0] * 3
    assert not force(recording(Case("passive")).recording).any()


def test_the_worst_of_the_solver() -> None:
    once = np.where(np.abs(T - 1) < 1e-4, 1.0, 0.0)
    found = measure(
        recording(
            Case("mpc"),
            **{
                "controller.solver.status": 2 * once,
                "controller.solver.iterations": 3 + 4 * once,
                "controller.solver.residual": 1e-3 * once,
            },
        )
    )
    assert {k: v for k, v in found.items() if k.startswith("solver")} == pytest.approx(
        {"solver.status": 2.0, "solver.iterations": 7.0, "solver.residual": 1e-3}
    )
    assert not [k for k in measure(recording(Case("lqr"))) if k.startswith("solver")]


def test_remarks() -> None:
    said = ["command.held: the solver found no solution at some samples; the last force was kept"]
    assert (
        EXPERIMENT.measures.remarks(recording(Case("mpc"), **{"controller.command.held": np.where(T > 2.99, 1.0, 0.0)}))
        == said
    )
    assert (
        EXPERIMENT.measures.remarks(recording(Case("mpc"))) == EXPERIMENT.measures.remarks(recording(Case("lqr"))) == []
    )


def test_signals_of_a_run() -> None:
    found = signals(recording(Case("mpc")))
    assert {len(s) for s in found.values()} == {3001}
    for i, expected in (
        (0, {"time": 0.0, "road": 0.02, "wheel": 0.001, "body": 0.023, "force": 5.5}),
        (700, {"time": 0.7, "road": -0.01, "wheel": 0.701, "body": 0.023, "force": 6.0}),
        (2000, {"time": 2.0, "road": -0.01, "wheel": 2.001, "body": -0.015, "force": -8.0}),
    ):
        assert {n: s[i] for n, s in found.items()} == pytest.approx(expected)
    assert set(signals(recording(Case("passive")))["force"]) == {0.0}


def test_what_is_recorded_for_how_long() -> None:
    assert recorded(Case("passive")) == ["road.road.height", "plant.*"]
    assert recorded(Case("lqr-clipped")) == ["road.road.height", "plant.*", "controller.*"]
    assert recorded(Case("mpc", encoders=True)) == ["road.road.height", "plant.*", "controller.*", "encoders.*"]
    assert [stop_time(None, Case(road=r)) for r in ("bump", "random")] == [3.0, 10.0]  # type: ignore[arg-type]


def test_labels() -> None:
    case = Case("mpc-moves", "bump", 0.2, 30.0, encoders=True)
    assert case.label == "mpc-moves-bump-200ms-30mm-encoders"
    assert Case("lqr", "random", offset=20.0).label == "lqr-random-from-20s"
    assert case.passive() == Case("passive", "bump", 0.2, 30.0)


def test_what_is_set_for_a_case(fmus: FmuSet) -> None:
    with Runner(EXPERIMENT, fmus) as runner:
        clipped = runner.system(Case("lqr-clipped", "bump", 0.2, -40.0, solver_parts=4))
        assert clipped["road"].values == {"bump.start": 0.1, "bump.duration": 0.2, "bump.height": -0.04}
        assert clipped["controller"].values == {"limit": 8.0}
        assert clipped["plant"].values == {"solver.step": 1.25e-4}
        free = runner.system(Case("lqr", "bump"))
        assert free is clipped
        assert free["road"].values == {"bump.start": 0.1, "bump.duration": 0.5, "bump.height": 0.02}
        assert free["controller"].values == {"limit": 38.0}
        assert free["plant"].values == {"solver.step": 5e-4}
        finer = runner.system(Case("mpc", "random", offset=30.0, exchange_parts=2))
        assert finer["road"].values == {"offset": 30.0}
        assert 2 * finer["plant"].step == free["plant"].step
        assert "controller" not in runner.system(Case("passive")).components


def test_wires(fmus: FmuSet) -> None:
    states = ("suspension.deflection", "body.vz", "tire.deflection", "wheel.vz")
    common = {
        "plant.road.height": "road.road.height",
        "plant.road.rate": "road.road.rate",
        "plant.force": "controller.force",
    }
    measured = {"suspension": "plant.suspension.deflection", "body": "plant.body.z", "road": "road.road.height"}
    for case, expected in (
        (Case("passive"), {k: v for k, v in common.items() if k != "plant.force"}),
        (Case("lqr"), {**common, **{f"controller.{x}": f"plant.{x}" for x in states}}),
        (
            Case("lqr", encoders=True),
            {
                **common,
                **{f"controller.{x}": f"encoders.{x}" for x in states},
                **{f"encoders.encoder.{k}": v for k, v in measured.items()},
            },
        ),
    ):
        with wire(fmus, case) as system:
            assert {t: c.source_name for t, c in system.connections.items()} == expected


def test_charts_of_the_live_page_show_what_is_recorded(
    fmus: FmuSet, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The outputs among it, in its order, of all systems side by side."""
    pages: list[WebPage] = []
    monkeypatch.setattr(web, "export_web", lambda path, _, page: pages.append(page) or path)
    web.write_web(EXPERIMENT, fmus, tmp_path / "page.html", Case("passive"))
    record = ["controller.force", "plant.body.a*", "plant.force", "plant.wheel.z"]
    own = replace(EXPERIMENT, run=replace(EXPERIMENT.run, record=record))
    web.write_web(own, fmus, tmp_path / "page.html", Case("lqr"))
    every, some = (list(page.plots) for page in pages)
    assert every[0] == "road.road.height"
    assert [n.partition(".")[0] for n in every[1:]] == ["plant"] * 5
    assert some == ["controller.force", "plant.body.az", "plant.wheel.z"]  # plant.force is an input


# ---------------------------------------------------------------------------------------- a study: every cell by hand

NAMES = {
    "passive": "passive",
    "lqr": "LQR",
    "lqr-clipped": "LQR, clipped to 8 N",
    "mpc": "MPC, weight on the force",
    "mpc-moves": "MPC, weight on the moves",
}
BASE = {"acceleration": 2.0, "overshoot": 0.004, "travel": 0.003, "tire": 0.002}
SHARES = {  # of the passive bench
    "passive": (1.0, 1.0, 1.0, 1.0), "lqr": (0.40, 0.30, 0.90, 0.70), "lqr-clipped": (0.42, 0.31, 0.91, 0.71),
    "mpc": (0.425, 0.32, 0.92, 0.72), "mpc-moves": (0.30, 0.20, 0.95, 0.73),
}  # fmt: skip
FORCES = {
    "passive": (0.0, 0.0, 0.0),
    "lqr": (3.0, 8.4, -8.6),
    "lqr-clipped": (2.9, 8.0, -8.0),
    "mpc": (2.7, 7.9, -7.95),
    "mpc-moves": (3.6, 7.5, -7.0),
}


def metrics(case: Case) -> dict[str, Any]:
    """No two roads, bumps, stretches or controllers are alike."""
    size = (
        0.25 + 0.001 * case.offset
        if case.road == "random"
        else case.height_mm / 20 * {0.5: 1.0, 0.2: 1.5}[case.duration]
    )
    size *= 1 + 1e-4 * (case.solver_parts - 1) - 2e-4 * (case.exchange_parts - 1)
    more = (0.02 if case.encoders else 0.0) + (0.001 * case.offset if case.controller == "mpc" else 0.0)
    if (case.road, case.duration) == ("bump", 0.2):
        more += {"lqr": 0.01, "lqr-clipped": 0.005, "mpc": 0.018}.get(case.controller, 0.0)
    row = {n: b * size * (share + more) for (n, b), share in zip(BASE.items(), SHARES[case.controller], strict=True)}
    rms, high, low = FORCES[case.controller]
    short = 1.01 if case.duration == 0.2 and case.controller == "lqr" else 1.0
    row |= {
        "force": rms * size,
        "force.max": high * short * (1 + 0.002 * case.encoders),
        "force.min": low * short + 5 * (case.offset > 0),
    }
    if case.controller.startswith("mpc"):
        row |= {
            "solver.status": 0.0,
            "solver.iterations": 4.0 + (case.road == "random"),
            "solver.residual": 1e-9 * size,
        }
    return row


def drawn(case: Case) -> dict[str, list[float]]:
    """Signals of which no two are alike."""
    number = 1 + list(NAMES).index(case.controller) + 10 * (case.road == "random") + 100 * (case.duration == 0.2)
    time = np.arange(2000) * 1e-3
    return {
        "time": time.tolist(),
        **{n: (number + i + time).tolist() for i, n in enumerate(("road", "wheel", "body", "force"))},
    }


def test_plan() -> None:
    tasks = published.plan()
    cases = [t.case for t in tasks]
    assert len(set(cases)) == len(cases) == 15 + 12 + 2 * 3 * 4 + 2 * 7 + 2 * 5
    assert [t.case for t in tasks if t.signals] == [at(s, c) for s in (LONG, SHORT, RANDOM) for c in NAMES]
    assert {
        "bump 0.5 s": Case("passive", "bump", 0.5),
        "bump 0.2 s": Case("passive", "bump", 0.2),
        "random": Case("passive", "random"),
    } == published.SCENARIOS
    assert over_height(0.2, "mpc") == [Case("mpc", "bump", 0.2, h) for h in (10.0, 20.0, 30.0, 40.0, 50.0)]
    assert [c.offset for c in over_stretches("mpc")] == [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0]
    assert {c.controller for c in cases if c.encoders} == {c for c in NAMES if c != "passive"}
    assert {(c.controller, c.duration) for c in cases if c.solver_parts * c.exchange_parts > 1} == {
        (c, 0.2) for c in NAMES
    }


def test_comparison(page: Report) -> None:
    rows = made_up.table(page, "comparison")
    assert [(r["road"], r["system"]) for r in rows] == [
        (s, n) for s in ("bump 0.5 s", "bump 0.2 s", "random") for n in NAMES.values()
    ]
    assert list(rows[6].items()) == list(
        {
            "road": "bump 0.2 s",
            "system": "LQR",
            "rms acceleration of the body [m/s2]": 1.23,
            "body beyond the road's extremes [mm]": 1.86,
            "rms suspension deflection [mm]": 4.095,
            "rms tire deflection [mm]": 2.13,
            "rms force [N]": 4.5,
            "largest force [N]": 8.484,
            "smallest force [N]": -8.686,
        }.items()
    )
    assert rows[13]["rms acceleration of the body [m/s2]"] == 0.212  # 0.2125


def test_random_stretches(page: Report) -> None:
    rows = made_up.table(page, "random-stretches")
    assert [list(r.values()) for r in rows] == [
        [w, pytest.approx(v + 0.035), pytest.approx(v), pytest.approx(v + 0.07)]
        for w, v in (
            ("rms acceleration of the body", 0.425),
            ("body beyond the road's extremes", 0.32),
            ("rms suspension deflection", 0.92),
            ("rms tire deflection", 0.72),
        )
    ]


def test_encoders_and_solver(page: Report) -> None:
    rows = made_up.table(page, "encoders")
    assert [(r["road"], r["system"]) for r in rows] == [
        (s, NAMES[c]) for s in ("bump 0.5 s", "bump 0.2 s", "random") for c in NAMES if c != "passive"
    ]
    assert list(rows[0].items()) == list(
        {
            "road": "bump 0.5 s",
            "system": "LQR",
            "exact states [m/s2]": 0.8,
            "encoders [m/s2]": 0.84,
            "change [%]": 5.0,
            "largest force [N]": 8.417,
            "smallest force [N]": -8.6,
        }.items()
    )
    assert [list(r.values()) for r in made_up.table(page, "solver")] == [
        [s, NAMES[c], 0, n, f"{1e-9 * size:.1e}"]
        for s, n, size in (("bump 0.5 s", 4, 1.0), ("bump 0.2 s", 4, 1.5), ("random", 5, 0.25))
        for c in ("mpc", "mpc-moves")
    ]


def test_finer_steps(page: Report) -> None:
    rows = made_up.table(page, "refinement")
    assert [(r["steps"], r["system"]) for r in rows] == [
        (w, n) for w in ("as in the runs", "solver step halved", "communication step halved") for n in NAMES.values()
    ]
    assert list(rows[6].values())[2:] == pytest.approx([1.230123, 8.686, 0.01])
    assert list(rows[13].values())[2:] == pytest.approx([3 * 0.443 * 0.9998, 7.95, -0.02])
    assert list(rows[9].values())[2:] == pytest.approx([0.9 * 1.0001, 7.5, 0.01])
    assert [r["change of the acceleration [%]"] for r in rows[:5]] == [0.0] * 5


def test_plates_over_bumps_and_the_random_road(page: Report) -> None:
    for number, controller in ((6, "passive"), (7, "lqr"), (8, "mpc")):
        id_ = f"figure-{number}"
        for s in (LONG, SHORT):
            for name in ("road", "wheel", "body"):
                curve, own = made_up.series(page, id_, s, name), drawn(at(s, controller))
                assert (list(curve.x), list(curve.y)) == (own["time"], [1e3 * z for z in own[name]])
    for controller in ("passive", "mpc"):
        curve = made_up.series(page, "figure-10", NAMES[controller], "body")
        assert list(curve.y) == [1e3 * z for z in drawn(at(RANDOM, controller))["body"]]


def test_forces_over_bumps(page: Report) -> None:
    for s in (LONG, SHORT):
        for controller in ("lqr", "mpc", "mpc-moves"):
            curve, own = made_up.series(page, "figure-9", s, NAMES[controller]), drawn(at(s, controller))
            assert (list(curve.x), list(curve.y)) == (own["time"][:1501], own["force"][:1501])
    words = next(s for s in page.sections if s.title == "Actuator force").paragraphs[0]
    assert "a little more than 8 N" in words
    assert (
        "The rms of the MPC's force is 90 % of the LQR's over the longer bump, with the weight on the moves 120 %."
        in words
    )


def test_accelerations_over_height(page: Report) -> None:
    for s, size, clipped, mpc in (("bump 0.5 s", 1.0, 0.42, 0.425), ("bump 0.2 s", 1.5, 0.425, 0.443)):
        for controller, share in (("lqr-clipped", clipped), ("mpc", mpc), ("mpc-moves", 0.30)):
            curve = made_up.series(page, "limit", s, NAMES[controller])
            assert list(curve.x) == [10.0, 20.0, 30.0, 40.0, 50.0]
            assert list(curve.y) == pytest.approx([h / 10 * size * share for h in curve.x])


def test_words(page: Report, sentence) -> None:
    sentence(made_up.words(page))


def test_main_result(page: Report) -> None:
    assert made_up.bars(page) == {
        NAMES[c]: {LONG: pytest.approx(long), SHORT: pytest.approx(short), RANDOM: pytest.approx(random)}
        for c, long, short, random in (
            ("passive", 2.0, 3.0, 0.5),
            ("lqr", 0.8, 1.23, 0.2),
            ("lqr-clipped", 0.84, 1.275, 0.21),
            ("mpc", 0.85, 1.329, 0.2125),
            ("mpc-moves", 0.6, 0.9, 0.15),
        )
    }


def test_main_result_where_the_force_raises_the_acceleration(study: Results, fmus: FmuSet) -> None:
    worse = altered(study, {at(LONG, "mpc"): {"acceleration": 2.5, "force.max": 9.0}})
    assert "2.5 m/s2 with the MPC (up to 9 N): 60 % lower and 25 % higher than" in report(worse, fmus).lead


def better(study: Results, factor: float) -> dict[Case, dict[str, float]]:
    """Runs of the MPC that are so much of the LQR's in every respect on every road."""
    return {at(s, "mpc"): {k: factor * study[at(s, "lqr")][k] for k in BASE} for s in (LONG, SHORT, RANDOM)}


def verdict(study: Results, id_: str) -> str:
    return {c.id: c.verdict for c in CLAIMS.judge(study)}[id_]


@pytest.mark.parametrize(
    ("id_", "change", "found"),
    [
        ("force-limit", {at(RANDOM, "mpc-moves", encoders=True): {"force.min": -8.01}}, "not reproduced"),
        ("force-limit", {over_height(0.2, "mpc")[4]: {"force.max": 8.01}}, "not reproduced"),
        ("force-limit", {over_height(0.5, "lqr-clipped")[4]: {"force.max": 8.01}}, "reproduced"),
        ("lqr-force", {at(LONG, "lqr"): {"force.max": 7.9, "force.min": -7.9}}, "not reproduced"),
        ("lqr-force", {at(LONG, "lqr"): {"force.max": 9.21}}, "trend reproduced, magnitude differs"),
        ("lqr-force", {at(LONG, "lqr"): {"force.min": -9.19}}, "reproduced"),
        (
            "lqr-force",
            {at(s, "lqr"): {"force.max": 8.1, "force.min": -8.1} for s in (LONG, SHORT)},
            "trend reproduced, magnitude differs",
        ),
        ("bump-lqr", {at(SHORT, "lqr"): {"acceleration": 1.51}}, "not reproduced"),
        ("bump-lqr", {at(LONG, "lqr"): {"overshoot": 0.0021}}, "not reproduced"),
        ("bump-mpc", {at(LONG, "mpc"): {"acceleration": 1.01}}, "not reproduced"),
        ("bump-mpc", {at(LONG, "mpc"): {"acceleration": 0.99}}, "reproduced"),
        (
            "active-constraint",
            {at(s, "mpc"): {"acceleration": 0.98 * a} for s, a in ((LONG, 0.84), (SHORT, 1.275))},
            "reproduced",
        ),
        (
            "active-constraint",
            {at(s, "mpc"): {"acceleration": 0.995 * a} for s, a in ((LONG, 0.84), (SHORT, 1.275))},
            "not reproduced",
        ),
        ("active-constraint", {at(SHORT, "mpc"): {"acceleration": 0.9}}, "not reproduced"),
        ("random-body", {c: {"overshoot": 0.0011} for c in over_stretches("mpc")[1:3]}, "not reproduced"),
        ("random-body", {over_stretches("mpc")[1]: {"acceleration": 0.6}}, "reproduced"),
        ("random-wheel", {c: {"tire": 0.002 * 0.91 * 0.25} for c in over_stretches("mpc")[1:3]}, "reproduced"),
        ("random-wheel", {c: {"tire": 0.00054} for c in over_stretches("mpc")[3:5]}, "not reproduced"),
        ("solver", {at(RANDOM, "mpc-moves"): {"solver.residual": 1.1e-6}}, "does not hold"),
        ("solver", {at(LONG, "mpc"): {"solver.status": 1.0}}, "does not hold"),
    ],
)
def test_where_a_claim_turns(study: Results, id_: str, change: dict[Case, dict[str, float]], found: str) -> None:
    assert verdict(altered(study, change), id_) == found


def test_far_superior_is_a_tenth_in_every_respect(study: Results) -> None:
    for factor, found in ((0.89, "reproduced"), (0.91, "not reproduced")):
        assert verdict(altered(study, better(study, factor)), "far-superior") == found
    changes = better(study, 0.89)
    changes[at(RANDOM, "mpc")]["tire"] = 0.91 * study[at(RANDOM, "lqr")]["tire"]
    assert verdict(altered(study, changes), "far-superior") == "not reproduced"


def test_what_is_nothing_under_the_lqr_is_no_aspect(study: Results) -> None:
    changes = {**better(study, 0.89), at(LONG, "lqr"): {"overshoot": 0.0}}
    assert verdict(altered(study, changes), "far-superior") == "reproduced"
