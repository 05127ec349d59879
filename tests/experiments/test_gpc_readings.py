"""Paper 000 under other readings: what each changes, and how the claims are judged in each."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import gpc_studies
import made_up
import numpy as np
import pytest
from kept_results import kept_readings, kept_verdicts, readings_of

from cosim.experiments import gpc, gpc_readings
from cosim.experiments.gpc.assumed import MeasuredRoad
from cosim.experiments.gpc.published import MATCHED, Comparison
from cosim.experiments.gpc.runs import Case, assume, control_law
from cosim.experiments.gpc_readings import COMBINATIONS, PRINTED, READINGS, plan
from cosim.experiments.gpc_readings.report import CURB, SMOOTH, Judged, report
from cosim.experiments.gpc_readings.static_gain import StaticGain
from cosim.study import FmuSet, Results, Row, Runner, Task, run_study
from cosim.study.case import CaseError, values
from cosim.study.readings_report import in_full
from fmu_sources.controllers.gpc.arx import ArxModel, identify_arx
from fmu_sources.controllers.gpc.component import FORCE_LIMIT
from fmu_sources.controllers.gpc.identification import IdentificationSettings, disturbance_of
from fmu_sources.roads import perryman3_table


def test_the_printed_reading_is_the_main_study() -> None:
    """The same cases and searches, so the same runs bit for bit, but for refinements and drawn histories."""
    main = gpc.EXPERIMENT.study.plan(seeds=gpc_readings.SHORT_SEEDS)
    searches = [t for t in main if isinstance(t, Comparison)]
    assert [t for t in plan() if isinstance(t, Comparison) and not t.assumed] == searches
    at_refinements = {(*h, 1e-7) for h in gpc.published.HISTORIES}
    cases = {t.case for t in main if isinstance(t, Task)}
    left_out = cases - {t.case for t in plan() if isinstance(t, Task)}
    assert {(c.road, c.speed_kmh, c.R) for c in left_out} == at_refinements


def test_the_printed_reading_gives_the_numbers_of_the_main_study(fmus: FmuSet) -> None:
    """Matched weights and all metrics, bit for bit, under the same keys; a static gain beside them changes nothing."""
    found = []
    for experiment in (gpc.EXPERIMENT, gpc_readings.EXPERIMENT):
        with Runner(experiment, fmus) as runner:
            if experiment is gpc_readings.EXPERIMENT:
                StaticGain(1, READINGS["limit 15 kN"])(runner)
            found.append(Comparison("curb", 80.0, 1)(runner))
    assert json.dumps(found[0]) == json.dumps(found[1])
    assert {row["controller"] for row in found[0]["compared"]} == {"implicit", "explicit", "preview"}


@pytest.mark.full
def test_the_whole_study_judges_the_printed_reading_as_the_main_study(fmus: FmuSet) -> None:
    """It continues where an earlier one was interrupted: its runs stay in the folder of results."""
    store = Path(__file__).parents[2] / "results" / "gpc-readings" / ".runs"
    judged = Judged.of(run_study(gpc_readings.EXPERIMENT, fmus, store, options={"full": True}))
    told = kept_verdicts("gpc")
    assert {c.id: c.verdict for c in judged.claims[PRINTED] if not c.own} == {
        c.id: told[c.id] for c in judged.claims[PRINTED] if not c.own
    }
    assert set(judged.claims) == {*READINGS, *COMBINATIONS}
    assert set(judged.held_out) == {*list(READINGS)[:4], "road rate", "last height held", *COMBINATIONS}
    assert not [n for n in judged.claims if len(judged.holding(n, (*CURB, *SMOOTH))) == len(CURB) + len(SMOOTH)]


@pytest.mark.full
def test_the_short_study_gives_what_is_kept(fmus: FmuSet, tmp_path: Path) -> None:
    results = run_study(gpc_readings.EXPERIMENT, fmus, tmp_path / "runs")
    assert readings_of(gpc_readings.EXPERIMENT, results, fmus) == kept_readings(gpc_readings.EXPERIMENT.name)


def test_literal_corrections_come_first_and_the_number_of_comparisons_is_stated() -> None:
    assert list(READINGS)[1:4] == ["identified from rest", "one track", "identified from rest, one track"]
    assert READINGS["identified from rest, one track"] == (("from_rest", True), ("one_track", True))
    for full in (False, True):
        searched = [t for t in plan(full) if isinstance(t, Comparison)]
        assert len(searched) == gpc_readings.comparisons(full)


def test_the_plan_has_every_reading_and_the_full_one_holds_seeds_out() -> None:
    short, full = ([t for t in plan(full) if isinstance(t, StaticGain)] for full in (False, True))
    assert {t.assumed for t in short} == set(READINGS.values())
    assert len(short) == 2 * len(READINGS)
    assert {t.assumed for t in full} == {*READINGS.values(), *COMBINATIONS.values()}
    assert len({t.assumed for t in full}) == len(READINGS) + 2**4 - 5 - 1  # one combination is among the first
    assert {t.seed for t in full if not t.assumed or t.assumed in COMBINATIONS.values()} == set(range(16))
    assert {t.seed for t in full if t.assumed == READINGS["road slope"]} == {0, 1}
    assert len(full) == 16 * 2**4 + 2 * 12
    labels = [t.label for t in plan(True) if not isinstance(t, Task)]
    assert len(set(labels)) == len(labels)


def test_a_field_is_set_where_it_means_something() -> None:
    everything = tuple(dict(pair for reading in READINGS.values() for pair in reading).items())
    of_the_car = {"one_track": True, "start_height": 0.02}
    assert assume(everything, Case("sine", 50.0, "passive")) == Case("sine", 50.0, "passive", **of_the_car)
    implicit = assume(everything, Case("sine", 50.0, "implicit"))
    assert (implicit.hold, implicit.disturbance, implicit.horizon, implicit.from_rest) == (False, "height", 16, True)
    explicit = assume(everything, Case("sine", 50.0, "explicit"))
    assert (explicit.hold, explicit.disturbance, explicit.roll_off) == (True, "slope", 20.0)
    assert assume(everything, Case("sine", 50.0, "preview")).horizon == 16
    assert replace(explicit, solver_parts=2).passive() == Case("sine", 50.0, "passive", solver_parts=2, **of_the_car)


def test_one_profile_lies_under_both_sides(fmus: FmuSet) -> None:
    for controller in ("passive", "preview"):
        with Runner(gpc.EXPERIMENT, fmus) as runner:
            system = runner.system(Case("perryman3", 50.0, controller, one_track=True))
            sources = {target: str(c) for target, c in system.connections.items() if target.startswith("c")}
        right = {t: s for t, s in sources.items() if (".fr" in t or ".rr" in t) and "road" in s}
        assert right
        assert all(".fl" in s or ".rl" in s for s in right.values())


def test_rate_and_slope_of_the_road() -> None:
    """Of a road that rises by 0.1 m from sample to sample at 20 m/s, 10 m/s and 1/2."""
    heights = 0.1 * np.arange(5)[:, None] * np.ones(2)
    np.testing.assert_allclose(disturbance_of(heights, "rate", 20.0)[1:], 10.0)
    np.testing.assert_allclose(disturbance_of(heights, "slope", 20.0)[1:], 0.5)
    assert disturbance_of(heights, "rate", 20.0)[0].tolist() == [0.0, 0.0]
    assert disturbance_of(heights, "height", 20.0) is heights


@pytest.mark.parametrize(("kind", "every"), [("rate", 0.01), ("rate-1kHz", 0.001)])
def test_what_a_controller_is_given_in_place_of_heights(kind: str, every: float) -> None:
    """At each sample the difference to the height before, of the heights ahead too, counted from the datum."""
    measured = MeasuredRoad(kind, 0.5)
    measured.begin()
    count, step = measured.preview
    assert step == every
    assert step * (count - 1) == pytest.approx(0.07)
    y, road = np.zeros(len(measured.outputs)), lambda t: 0.02 * t**2
    for k in range(4):
        ahead = [road(0.01 * k - 0.001), road(0.01 * k), *(road(0.01 * k + every * i) for i in range(count))]
        measured.step(0.01 * k, 0.01, np.array([*np.tile(ahead, 4), 20.0]), y)
    under, *preview = y[:9] - 0.5
    rates = [(road(0.03 + 0.01 * i) - road(0.03 + 0.01 * i - every)) / every for i in range(8)]
    assert under == pytest.approx(rates[0])
    assert preview == pytest.approx(rates)


def reading_of(fmus: FmuSet, controller: str, **assumed: object) -> Row:
    with Runner(gpc.EXPERIMENT, fmus) as runner:
        return runner.metrics(Case("curb", 80.0, controller, **assumed))


def test_a_longer_preview_and_one_of_1_ms_are_of_the_same_road(fmus: FmuSet) -> None:
    """Both come from roads that are built for them, and the car meets the same curb on these."""
    passive, *others = (
        reading_of(fmus, "preview", R=1e6, **assumed) for assumed in ({}, {"horizon": 16}, {"disturbance": "rate-1kHz"})
    )
    assert passive["force"] < 1.0  # at that weight no controller does anything
    assert [row["response"] for row in others] == pytest.approx([passive["response"]] * 2, rel=1e-5)


def test_longer_preview_sees_further(fmus: FmuSet) -> None:
    """With 16 samples the force begins 80 ms earlier than with 8."""
    begin = []
    for horizon in (8, 16):
        with Runner(gpc.EXPERIMENT, fmus) as runner:
            found = runner.record(Case("curb", 50.0, "preview", horizon=horizon))
        begin.append(found.time[np.flatnonzero(np.abs(found["controller.force.fl"]) > 1.0)[0]])
    assert begin[0] - begin[1] == pytest.approx(0.08, abs=0.011)


def test_an_actuator_at_the_spring_moves_the_wheel_by_the_motion_ratio(fmus: FmuSet) -> None:
    with Runner(gpc.EXPERIMENT, fmus) as runner:
        system = runner.system(Case("sine", 50.0, "preview", actuator="spring"))
        recording = runner.record(Case("sine", 50.0, "preview", actuator="spring"))
        law, other = (control_law(fmus, Case("sine", 50.0, "preview", actuator=a)) for a in ("spring", "wheel"))
    assert "0.4925" in str(system.connections["car.force.fl"])
    assert law.provenance["identification"]["lever"] == pytest.approx(0.4925)
    assert "lever" not in other.provenance["identification"]
    assert np.abs(recording["controller.force.fl"]).max() > 100.0


def test_responses_are_sampled_before_a_command_or_after_it(fmus: FmuSet) -> None:
    """After it they contain its direct effect: 1 N on each wheel accelerates 5 t by 0.2 mm/s2."""
    files = (fmus.path(gpc.runs.PLANT), fmus.path("RoadPerryman3"), fmus.path(gpc.runs.SPEED))
    for sampled_after, direct in ((1, 1 / (9.81 * 5000.0)), (0, 0.0)):
        beta = gpc.runs.models(*files, IdentificationSettings(sampled_after=sampled_after)).implicit.model.beta[0][0]
        assert np.mean(beta) == pytest.approx(direct, abs=2e-6)


def test_a_car_drops_and_a_datum_kicks(fmus: FmuSet) -> None:
    with Runner(gpc.EXPERIMENT, fmus) as runner:
        dropped = runner.record(Case("curb", 50.0, "passive", start_height=0.02))
        trimmed, kicked = (runner.record(Case("curb", 50.0, "explicit", datum=d)) for d in (0.0, 0.1))
    assert dropped["car.body.z"][0] == pytest.approx(0.02, abs=1e-3)
    assert abs(dropped["car.body.z"][dropped.time > 1.5][0]) < 2e-3
    before = trimmed.time < 1.0  # on the flat
    assert np.abs(trimmed["controller.force.fl"][before]).max() < 1.0
    assert np.abs(kicked["controller.force.fl"][before]).max() > 100.0


def test_the_printed_law_is_stiff_and_the_others_are_not(fmus: FmuSet) -> None:
    """The page on what the papers do not say: more than ten times the static gain of preview, or about the same."""
    with Runner(gpc.EXPERIMENT, fmus) as runner:
        printed, held, rate = (
            StaticGain(0, READINGS[name])(runner) for name in (PRINTED, "last height held", "road rate")
        )
    assert printed["explicit"] > 10 * printed["preview"]
    assert held["explicit"] == pytest.approx(held["preview"], rel=0.01)
    assert rate["explicit"] == pytest.approx(rate["preview"], rel=0.5)


def test_the_curve_of_the_smallest_weight_departs_without_any_limit(fmus: FmuSet) -> None:
    """Figure 6e at 40 km/h: less effective per force by a fifth at least, with a tenth of the limit."""
    with Runner(gpc.EXPERIMENT, fmus) as runner:
        base = runner.metrics(Case("sine", 40.0, "passive"))["response"]
        rows = [runner.metrics(Case("sine", 40.0, "preview", R=R)) for R in (1e-7, 5e-7, 5e-6)]
    per_force = [(1 - row["response"] / base) / row["force"] for row in rows]
    assert per_force[0] < 0.8 * per_force[1]
    assert per_force[1] == pytest.approx(per_force[2], rel=0.1)
    assert rows[0]["peak_force"] < 0.1 * FORCE_LIMIT


def test_a_force_limit_limits(fmus: FmuSet) -> None:
    assert reading_of(fmus, "explicit", limit=2e3)["peak_force"] == 2e3


def test_a_smoother_course_has_the_same_size(fmus: FmuSet) -> None:
    rough, smooth = (perryman3_table(roll_off).left[200:] for roll_off in (0.0, 0.1))
    assert np.std(np.diff(smooth)) < 0.6 * np.std(np.diff(rough))
    assert np.std(smooth) == pytest.approx(np.std(rough), rel=0.1)
    with Runner(gpc.EXPERIMENT, fmus) as runner:
        rows = [runner.metrics(Case("perryman3", 50.0, "passive", road_roll_off=r)) for r in (0.0, 0.1)]
    assert rows[1]["rms_az"] < 0.9 * rows[0]["rms_az"]


def test_other_preview_needs_a_road_of_the_study(fmus: FmuSet) -> None:
    with Runner(gpc.EXPERIMENT, fmus) as runner, pytest.raises(CaseError, match="road with other preview"):
        runner.system(Case(str(fmus.path("RoadBumps")), 50.0, "preview", horizon=16))


def test_a_run_from_rest_has_the_leading_zeros_of_equation_4() -> None:
    """Its first samples determine a model of order 2 that a run in the middle would not, being too short."""
    rng = np.random.default_rng(1)
    model = ArxModel(np.array([[[0.5]], [[-0.2]]]), np.array([[[1.0]], [[0.3]], [[0.1]]]))
    u = rng.normal(size=(6, 1))
    found = identify_arx(u, model.simulate(u), order=2, from_rest=True)
    assert (found.samples, found.equations) == (6, 6)
    np.testing.assert_allclose(found.model.alpha, model.alpha, atol=1e-9)
    np.testing.assert_allclose(found.model.beta, model.beta, atol=1e-9)
    assert IdentificationSettings(from_rest=True).unexcited_samples == 0


def test_an_excitation_that_rolls_off_is_as_strong() -> None:
    white, low = (IdentificationSettings(seed=1, roll_off=f).excite() for f in (0.0, 10.0))
    assert np.std(low) == pytest.approx(2000.0)
    power = [np.abs(np.fft.rfft(x, axis=0)[100:]) ** 2 for x in (white, low)]  # above 25 Hz
    assert power[1].sum() < 1e-2 * power[0].sum()


def test_identification_of_a_case(fmus: FmuSet) -> None:
    case = Case("sine", 50.0, "explicit", seed=3, excitation=1e3, disturbance="rate", one_track=True)
    found = gpc.runs.identification(fmus, case)
    assert found == IdentificationSettings(seed=3, excitation=1e3, disturbance="rate", one_track=True)
    models = gpc.runs.models(
        fmus.path(gpc.runs.PLANT),
        gpc.runs.road_file(fmus, "perryman3"),
        fmus.path(gpc.runs.SPEED),
        IdentificationSettings(samples=120, order=2),
    )
    assert models.explicit.samples == 120


# ------------------------------------------------------------------------------------------------------- judging


def as_published(case: Case) -> Row:
    """As the paper has it, but that explicit costs what preview does on no curb unless the last height is held."""
    row = gpc_studies._run(case) if case.R == 1e-7 else gpc_studies._swept(case)
    if case.controller == "explicit" and case.road == "curb" and case.hold:
        row["force"], row["power"] = 100.0, 50.0
    if case.controller == "explicit" and case.road != "curb" and not case.hold:
        row["force"], row["power"] = 5e4, 2e4
    return row


class Run:
    metrics = staticmethod(as_published)


def found(search: object) -> object:
    if isinstance(search, StaticGain):
        return {"explicit": 100.0 if dict(search.assumed).get("hold") else 3e4 + 1e3 * search.seed, "preview": 200.0}
    assert isinstance(search, Comparison)
    explicit, *others = (search.case(c) for c in ("explicit", *MATCHED))
    rows = [{**values(c), **as_published(c), "matched": True, "runs": 1} for c in (explicit, *others)]
    return {"compared": rows, "unmatched": rows[1:]}


@pytest.fixture(scope="module")
def results() -> Results:
    return made_up.study(gpc_readings.EXPERIMENT, as_published, found=found)


def test_the_blocks_exclude_each_other(results: Results) -> None:
    judged = Judged.of(results)
    assert list(judged.claims) == list(READINGS)
    assert judged.holding(PRINTED, CURB) == list(CURB)
    assert judged.holding(PRINTED, SMOOTH) == []
    assert judged.holding("last height held", SMOOTH) == list(SMOOTH)
    assert judged.holding("last height held", CURB) == ["curb-preview-200"]
    assert in_full(judged.claims[PRINTED]) == 12  # two seeds decide no strict claim, one alone does
    assert judged.seeds == (0, 1)


def test_tables_and_sentences(results: Results, fmus: FmuSet) -> None:
    page = report(results, fmus)
    tables = {t.id: {row[0]: list(row[1:]) for row in t.rows} for t in page.tables}
    assert tables["blocks"][PRINTED] == [3, 0, "none"]
    assert tables["blocks"]["last height held"] == [1, 4, ", ".join(SMOOTH)]
    assert tables["static-gain"][PRINTED] == [30.0, 31.0, 0.2, 0.2]
    assert tables["static-gain"]["last height held"] == [0.1, 0.1, 0.2, 0.2]
    assert tables["counts"][PRINTED] == [12, 13, 13, None]
    assert tables["map"]["sine-same-force"][:1] == ["no 0/2"]
    shares = next(f for f in page.figures if f.id == "shares")
    assert list(shares.x_names) == list(READINGS)
    row = list(shares.y_names).index("sine-same-force")
    held = list(READINGS).index("last height held")
    assert shares.layers[0].values[row][[0, held]].tolist() == [0.0, 1.0]
    assert "With 2 identification seeds 12 of 20 claims hold in full as printed" in page.lead
    assert page.lead.endswith(
        "No reading holds both the claims about the costs of explicit on the curb and those about smooth roads."
    )
    words = {s.title: " ".join(s.paragraphs) for s in page.sections}
    blocks = words["Two blocks of claims that exclude each other"]
    assert "No reading holds both." in blocks
    assert f"of {', '.join(SMOOTH)} is 4 of 4 (last height held), with at most 1 of 3 of the other block." in blocks
    assert "As printed it is 13 to 13 with one of 2 seeds" in words["How many claims hold"]
    assert page.figure is not None
    assert page.figure.panels[0].series[0].y[0] == 12
