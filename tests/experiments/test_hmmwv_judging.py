"""How paper 001 is judged, on studies in which nothing was run.

Verdicts, their reasons, and cases that do not exist.
"""

from __future__ import annotations

import numpy as np
import pytest
from altered import altered, failed
from hmmwv_made_up import is_finer, made_up_study, metric, watts

from cosim.experiments.hmmwv.averages import Averages
from cosim.experiments.hmmwv.claims import CLAIMS, SENTENCES, unsettled
from cosim.experiments.hmmwv.preview import runs as chains
from cosim.experiments.hmmwv.preview.claims import CLAIMS as PREVIEW
from cosim.experiments.hmmwv.preview.published import (
    COMPENSATED,
    FED,
    HEIGHTS_MM,
    PRINTED,
    PRINTED_FED,
    SPEEDOMETER_ERRORS,
    generated,
    long,
    over,
    words,
)
from cosim.experiments.hmmwv.preview.report import chain_section, generated_section
from cosim.experiments.hmmwv.published import finer
from cosim.experiments.hmmwv.pump import section as pump_section
from cosim.experiments.hmmwv.report import report
from cosim.experiments.hmmwv.runs import CONTROLLERS, ROADS, Case, over_variants
from cosim.experiments.hmmwv.statements import NAMES, ROAD_NAMES, need
from cosim.experiments.hmmwv.tracking import runs as corners
from cosim.experiments.hmmwv.tracking.claims import CLAIMS as TRACKING
from cosim.experiments.hmmwv.tracking.published import VARIANTS
from cosim.experiments.hmmwv.tracking.runs import SIGNALS, square, sweep
from cosim.report import Claim, Report, Table, write_report
from cosim.report.claims import Condition
from cosim.study import CaseError, Results
from cosim.study.study_report import section_of


def pump_tables(study: Averages) -> list[Table]:
    """Tables of the section on the pump."""
    return [item for item in pump_section(study) if isinstance(item, Table)]


def test_places_of_the_bump_cover_one_control_period():
    cases = over_variants(Case("track", "lqr"))
    assert [c.variant for c in cases] == list(range(6))
    assert [c.variant for c in over_variants(Case("track", "lqr"), 2)] == [0, 3]
    assert len(over_variants(Case("track", "passive"))) == 1  # nothing is sampled
    assert len(over_variants(Case("off-road", "passive"))) == 5


PARTS = {s.id for s in (*TRACKING, *PREVIEW)}


def claims(study: Results) -> dict[str, Claim]:
    """Claims on the vehicle; those on its parts have files of their own."""
    return {c.id: c for c in CLAIMS.judge(study) if c.id not in PARTS}


def judged(*changes) -> dict[str, Claim]:
    return claims(made_up_study(*changes))


WITHOUT_LIMIT, PUMP = "pump without limit", "45 l/min at each actuator"


def verdicts(*changes, pump: str = WITHOUT_LIMIT) -> dict[str, str]:
    """By claim; of those that are judged under conditions of the pump, that under one of them."""
    return {name: part(claim, pump).verdict for name, claim in judged(*changes).items()}


def part(claim: Claim, pump: str = WITHOUT_LIMIT) -> Claim | Condition:
    return next((c for c in claim.conditions if c.name == pump), claim)


def test_the_paper_as_it_stands_is_reproduced():
    found = judged()
    assert {c.verdict for c in found.values() if not c.own} == {"reproduced"}
    assert {c.verdict for c in found.values() if c.own} == {"holds"}


def test_every_claim_says_how_it_is_judged():
    assert [c.id for c in CLAIMS.judge(made_up_study()) if not c.criterion] == []


def test_comparable_means_to_mpc():
    """Skyhook and LQR alike among themselves, but far from MPC, are not what the paper says."""
    assert verdicts(watts(4.0, road="track", controller="mpc"))["track-alike"] == "not reproduced"
    assert verdicts(watts(5.4, road="track", controller="skyhook"))["track-alike"] == "reproduced"


@pytest.mark.parametrize(
    ("name", "change", "verdict"),
    [
        ("track-mpc-best", watts(3.5, road="track", controller="mpc"), "trend reproduced, magnitude differs"),
        ("track-mpc-best", watts(5.2, road="track", controller="mpc"), "not reproduced"),
        ("track-twofold", watts(7.0, road="track", controller="lqr"), "trend reproduced, magnitude differs"),
        ("track-twofold", watts(12.5, road="track", controller="lqr"), "not reproduced"),
        ("bump-preview", watts(2.0, road="bump", controller="mpc-preview"), "trend reproduced, magnitude differs"),
        ("bump-preview", watts(4.9, road="bump", controller="mpc-preview"), "not reproduced"),
        ("bump-threefold", watts(2.0, road="bump", controller="mpc-preview"), "trend reproduced, magnitude differs"),
        ("bump-threefold", watts(13.0, road="bump", controller="mpc-preview"), "not reproduced"),
        ("off-road-mpc-best", watts(7.5, road="off-road", controller="mpc"), "trend reproduced, magnitude differs"),
        ("track-twofold", watts(6.1, road="track", controller="lqr", variant=1), "trend reproduced, magnitude differs"),
    ],
)
def test_sizes_are_judged_within_bands(name, change, verdict):
    assert verdicts(change)[name] == verdict


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("track-mpc-best", watts(5.3, road="track", controller="mpc", variant=4)),
        ("off-road-driver", watts(6.1, road="off-road", controller="mpc", variant=2)),
        ("off-road-mpc-best", watts(8.2, road="off-road", controller="mpc", variant=2)),
        ("off-road-travel", metric("travel_rms", 0.0121, road="off-road", controller="mpc", variant=2)),
        ("bump-preview", watts(4.8, road="bump", controller="mpc-preview", variant=1)),
        ("bump-saturation", metric("saturation", 0.031, road="bump", controller="mpc-preview", variant=1)),
    ],
)
def test_one_stretch_or_place_on_the_other_side_is_enough(name, change):
    """Means would still say so."""
    found = part(judged(change)[name])
    assert found.verdict == "not reproduced"
    assert "on the claimed side in" in found.reason


def test_travel_is_compared_with_skyhook_too():
    assert verdicts(metric("travel_rms", 0.009, controller="skyhook"))["off-road-travel"] == "not reproduced"


def test_a_sentence_is_one_claim_under_both_conditions_of_the_pump():
    found = judged(watts(9.0, road="track", flow_limit=True), watts(31.7, road="off-road", flow_limit=True))
    assert set(SENTENCES) <= set(found)
    assert all([c.name for c in found[id].conditions] == [WITHOUT_LIMIT, PUMP] for id in SENTENCES)
    twofold, driver = found["track-twofold"], found["off-road-driver"]
    assert [c.verdict for c in twofold.conditions] == ["reproduced", "trend reproduced, magnitude differs"]
    assert twofold.verdict == "trend reproduced, magnitude differs"
    assert [c.verdict for c in driver.conditions] == ["reproduced", "not reproduced"]
    assert (driver.verdict, driver.result) == ("open", "holds in full under 1 of 2 conditions")
    assert driver.reason.startswith(f"{PUMP}: ")


@pytest.mark.parametrize("controller", ["passive", "skyhook", "lqr", "mpc"])
def test_only_mpc_is_a_claim_about_four_controllers(controller):
    change = watts(6.1 if controller == "mpc" else 5.9, road="off-road", controller=controller)
    assert verdicts(change)["off-road-driver"] == "not reproduced"


def test_the_pump_with_which_a_figure_holds_is_found():
    weak = [watts(9.0, road="track", pump_l_min=x, flow_limit=True, shared_pump=False) for x in (None, 60.0, 75.0)]
    study = made_up_study(*weak)
    needed = needs(study)
    odd = made_up_study(watts(6.1, road="track", controller="mpc", pump_l_min=None, flow_limit=True, variant=1))
    assert needs(odd)["track-twofold-mpc"].smallest.pump_l_min == 60.0
    assert needed["track-twofold-mpc"].smallest.pump_l_min == 90.0
    words = needed["track-twofold-mpc"].words(Averages(study))
    assert words == "90 l/min at each actuator, not with 75 l/min"
    assert needed["bump-threefold"].smallest.l_min(Averages(study)) == 45.0
    never = made_up_study(watts(9.0, road="track", controller="mpc"))
    assert needs(never)["track-twofold-mpc"].words(Averages(never)) == "no pump that was tried"
    (table,) = (t for t in pump_tables(Averages(study)) if t.id == "pump-needed")
    assert [row[4] for row in table.rows if "MPC at least halves" in row[0]] == [words]
    assert words in claims(study)["track-twofold"].reason


def test_a_pump_whose_run_failed_counts_as_not_tried():
    case = next(c for c in made_up_study() if isinstance(c, Case) and c.pump_l_min == 75.0 and c.controller == "mpc")
    study = failed(
        made_up_study(
            watts(9.0, road="track", pump_l_min=60.0), watts(9.0, road="track", pump_l_min=None, flow_limit=True)
        ),
        case,
    )
    needed = needs(study)["track-twofold-mpc"]
    assert needed.words(Averages(study)) == "90 l/min at each actuator, not with 60 l/min"
    assert part(claims(study)["track-twofold"], PUMP).verdict == "trend reproduced, magnitude differs"


def needs(study: Results) -> dict[str, object]:
    """What pump each statement takes."""
    parts = {f"{id}-{s.of}" if len(each) > 1 else id: s for id, each in SENTENCES.items() for s in each}
    return {id: found for id, s in parts.items() if (found := need(Averages(study), s)) is not None}


def test_the_pump_of_a_file_of_ones_own_is_named():
    """Its flow, a quarter of it where four share it, and its place among the others."""
    study = made_up_study(metric("flow_limit", 100.0))
    found = claims(study)
    assert found["track-alike"].conditions[1].name == "100 l/min at each actuator"
    tried = [c.l_min(Averages(study)) for c in needs(study)["track-twofold-mpc"].holds]
    assert tried == [60, 75, 90, 100, 120, float("inf")]
    (table,) = (t for t in pump_tables(Averages(study)) if t.id == "pump")
    assert table.columns[-1] == "25 l/min each, passive over it [-]"
    assert "null opening of the unpowered spool, which damps the passive car: 7 mm" in (
        judged(metric("null_opening", 0.007))["track-twofold"].fitted
    )


def test_nothing_over_nothing_is_open():
    """No valve saturates under either law: less is neither right nor wrong, and no page shows what is no number."""
    idle = metric("saturation", 0.0, road="bump", flow_limit=True, pump_l_min=None)
    found = part(judged(idle)["bump-saturation"], PUMP)
    assert found.verdict == "open"
    nothing = "neither with preview nor without does a valve saturate at 6 of 6 places of the bump"
    assert found.result == f"{nothing}; absorbed power passive 12.00, MPC 4.71, MPC with preview 4.01 W"
    assert (
        found.reason
        == f"{nothing}, so there is nothing to compare; holds with: 60 l/min at each actuator, not with 45 l/min"
    )
    assert found.value is None
    (table,) = (t for t in pump_tables(Averages(made_up_study(idle))) if t.id == "pump-needed")
    assert [row[2:4] for row in table.rows if "saturate less" in row[0]] == [(nothing, "33 %")]


def test_nothing_over_nothing_somewhere_hides_no_place_that_is_against():
    idle = metric("saturation", 0.0, road="bump", flow_limit=True, variant=2)
    assert verdicts(idle, pump=PUMP)["bump-saturation"] == "open"
    against = metric("saturation", 0.04, road="bump", flow_limit=True, controller="mpc-preview", variant=1)
    found = part(judged(idle, against)["bump-saturation"], PUMP)
    assert found.verdict == "not reproduced"
    assert "on the claimed side in 4 of 5" in found.reason
    assert "nan" not in found.result


def test_a_verdict_that_changes_with_the_steps_is_open():
    """2.02 times as run, 1.98 times with half the steps."""

    def change(run, row):
        if run.road == "track" and run.controller == "lqr" and not run.flow_limit:
            row["absorbed_power"] = 6.06 if is_finer(run) else 5.94

    found = judged(change)
    without, limited = found["track-twofold"].conditions
    assert (without.verdict, limited.verdict, found["track-twofold"].verdict) == ("open", "reproduced", "open")
    assert "LQR: as run median 2.02 times" in without.reason
    assert "1.98 times" in without.reason
    assert found["converged"].verdict == "does not hold"
    assert unsettled(Averages(made_up_study(change))) == ["track-twofold (LQR, pump without limit)"]


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("off-road-kilonewton", watts(4.9, road="off-road", controller="lqr-kilonewton")),
        ("off-road-travel-limit", metric("travel_peak", 0.064, road="off-road", controller="mpc", variant=3)),
        ("estimates-mpc", watts(5.6, road="track", controller="mpc", states="estimated")),
        ("sensed-preview", watts(4.4, road="bump", preview="sensed")),
        ("solver", metric("solver_failures", 1, road="bump", controller="mpc", variant=3)),
        ("solver", metric("solver_residual", 1e-3, road="bump", controller="mpc", variant=3)),
    ],
)
def test_checks_follow_the_numbers(name, change):
    assert verdicts(change)[name] == "does not hold"


def test_checks_count_and_say_what_is_amiss():
    over = judged(metric("travel_peak", 0.064, road="off-road", controller="mpc", variant=3))["off-road-travel-limit"]
    assert "holds in 4 of 5" in over.result
    unsolved = judged(metric("solver_failures", 1, road="bump", controller="mpc", variant=3))["solver"]
    assert unsolved.reason == "a sample was not solved"
    rough = judged(metric("solver_residual", 1e-3, road="bump", controller="mpc", variant=3))["solver"]
    assert rough.reason == "all are solved, but not all to that residual"


def test_steps_that_lower_a_number_count_as_those_that_raise_it():
    def change(run, row):
        if is_finer(run) and run.road == "track" and run.controller == "lqr":
            row["absorbed_power"] *= 0.95

    found = judged(change)["converged"]
    assert (found.verdict, found.result, found.value) == (
        "does not hold",
        "at most 5.00 % off, test track, LQR",
        pytest.approx(5.0, rel=1e-4),
    )


def test_pump_and_valve_as_published_are_those_of_runs_that_do_not_say_otherwise():
    """Each run has the numbers of its own actuator; the others' were chosen."""

    def change(run, row):
        chosen = run.pump_l_min is not None or run.shared_pump
        row["flow_limit"] = 99.0 if chosen else 45.0
        row["null_opening"] = 0.005 if run.null_opening_mm is None else 0.009

    study = Averages(made_up_study(change))
    assert (study.pump_l_min, study.null_opening_mm) == (45.0, pytest.approx(5.0))


def test_what_was_chosen_stands_beside_the_verdict():
    found = judged(
        watts(11.0, road="track", controller="passive", null_opening_mm=6.75),
        watts(9.0, road="track", controller="passive", null_opening_mm=4.0),
    )
    fitted = found["track-twofold"].fitted
    assert "null opening" in fitted
    assert "give 1.73 to 2.30 times, in and out of the band" in fitted
    assert "class E of ISO 8608 is assumed" in found["off-road-driver"].fitted
    assert "0.75 to 1.20 times" in found["off-road-driver"].fitted
    assert all("null opening" in found[i].fitted for i in ("track-twofold", "bump-threefold", "off-road-driver"))


def test_ratios_need_the_same_variants(raises):
    study = Averages(made_up_study())
    with raises(ValueError):
        study.ratio(Case("track", "lqr"), Case("off-road", "lqr"))


def test_a_failed_run_leaves_open_what_needs_it_and_nothing_else(fmus, tmp_path):
    study = made_up_study()
    broken = failed(study, Case("track", "lqr", variant=3))
    changed = {k: v.verdict for k, v in claims(broken).items() if v.verdict != claims(study)[k].verdict}
    lost = dict.fromkeys(("track-twofold", "track-alike", "track-mpc-best"), "open")
    assert changed == {**lost, "converged": "does not hold"}
    made = report(broken, fmus)
    message = ("Left out: the run track-lqr-variant3 failed: ComponentError: it broke",)
    assert [s.title for s in made.sections if s.paragraphs == message] == [
        "Absorbed power",
        "Test track",
        "Estimated states and sensed preview",
        "Effect of the hydraulics, and the pump that is needed",
        "Influence of the assumptions",
        "Refinement of the steps",
    ]
    assert message[0] in write_report(made, tmp_path).read_text(encoding="utf-8")


def test_a_failed_run_with_finer_steps_leaves_its_claims_open():
    study = failed(made_up_study(), finer(Case("track", "zero")))
    changed = {k: v.verdict for k, v in claims(study).items() if v.verdict not in ("reproduced", "holds")}
    assert changed == {"track-mpc-best": "open", "converged": "does not hold"}


def test_the_report_has_no_number_that_no_run_gives(fmus, tmp_path):
    """Every power in its tables is one that the made-up runs have: nothing is typed in beside them."""
    study = made_up_study(*[watts(8.25, road=road) for road in ROADS])
    made = report(study, fmus)
    tables = {t.id: t for t in made.tables}
    assert not any("expected" in column for t in tables.values() for column in t.columns)
    for name in ("absorbed-power", "pump", "refinement"):
        powers = [i for i, c in enumerate(tables[name].columns) if c.endswith("[W]")]
        assert {row[i] for row in tables[name].rows for i in powers} - {None} == {8.25}
    assert write_report(made, tmp_path).is_file()
    assert (tmp_path / "tables" / "refinement.csv").is_file()


def test_the_report_shows_what_refinement_changes(fmus):
    study = made_up_study(
        lambda run, row: row.update(absorbed_power=1.004 * row["absorbed_power"]) if is_finer(run) else None
    )
    (section,) = (s for s in report(study, fmus).sections if s.title == "Refinement of the steps")
    (table,) = section.tables
    assert {row[-1] for row in table.rows} == {0.4}
    assert {(row[0], row[1]) for row in table.rows} == {(ROAD_NAMES[r], NAMES[c]) for r in ROADS for c in CONTROLLERS}
    assert "No verdict changes" in section.paragraphs[0]
    assert "exchange values every 0.5 ms" in section.paragraphs[0]
    assert "an exchange every 0.25 ms" in section.paragraphs[0]


# ------------------------------------------------------------------------------------------------------------ the parts


def test_signals():
    assert [square(t) for t in (0.0, 0.4999, 0.5, 0.9999, 1.0)] == [2000, 2000, -2000, -2000, 2000]
    t = np.linspace(0, 10, 2_000_001)
    crossings = t[1:][np.diff(np.sign([sweep(x) for x in t[::20]])).nonzero()[0] * 20]
    assert 0.5 / np.diff(crossings[:3]).mean() == pytest.approx(1.4, abs=0.3)
    assert 0.5 / np.diff(crossings[-4:]).mean() == pytest.approx(10.0, abs=0.3)
    assert SIGNALS["discrete sweep"][1] == 0.030


@pytest.mark.parametrize(
    "choice",
    [
        {"signal": "sqare"},
        {"actuator": "oil"},
        {"order": "gauss"},
        {"density": -1.0},
        {"noise": -1.0},
        {"signal": "filter", "noise": 1.0},
    ],
)
def test_runs_of_a_corner_that_do_not_exist(choice, raises):
    with raises(CaseError):
        corners.Case(**choice)


def well(study: Results) -> dict[str, bool]:
    return {c.id: c.passed for c in TRACKING.judge(study)}


def test_claims_on_force_tracking_follow_the_numbers():
    assert well(made_up_study()) == {
        "tracking-filter": False,  # the made-up filter is at 1 after 23 ms
        "tracking-square": True,
        "tracking-sweep": True,
        "tracking-discrete-sweep": True,
        "tracking-difference": True,
        "tracking-average": False,
        "tracking-average-noise": False,
        "tracking-notches": True,
    }
    bad = well(made_up_study(worse=[next(iter(VARIANTS))]))
    assert [n for n in ("square", "sweep", "difference", "average", "notches") if bad[f"tracking-{n}"]] == ["average"]


def test_a_failed_run_of_a_corner_leaves_open_what_needs_it_and_nothing_else():
    judged = TRACKING.judge(failed(made_up_study(), corners.Case("sweep", average=True)))
    assert [c.id for c in judged if c.verdict == "open"] == ["tracking-average"]
    assert "force-tracking: sweep-average failed" in next(c.reason for c in judged if c.verdict == "open")


@pytest.mark.parametrize(
    "given",
    [
        {"filter": "relativ"},
        {"speedometer_error": 1.0},
        {"preview": "generated", "noise": 1.0},
        {"road": "track", "height_mm": 50.0},
    ],
)
def test_runs_of_the_chain_that_do_not_exist(given, raises):
    with raises(CaseError):
        chains.Case(**given)


def test_claims_and_sections_of_the_preview_chain():
    """Every part of the report can be made; a flat road has no dip."""
    study = made_up_study()
    made = Report(
        experiment="x",
        title="x",
        lead="x",
        claims=PREVIEW.judge(study),
        sections=[section_of("Generated", generated_section(study)), section_of("Sensed", chain_section(study))],
    )
    assert {c.id: c.verdict for c in made.claims} == {
        "preview-dip": "not reproduced",
        "preview-dip-compensated": "reproduced",
        "preview-unstable": "not reproduced",
        "preview-fed": "holds",
        "preview-rate": "not reproduced",
        "generated-loads": "reproduced",
        "generated-drift": "not reproduced",
    }
    assert {f.id for f in made.figures} == {"preview-generated", "preview-chain", "preview-dropout"}
    assert words(COMPENSATED) in [row[0] for t in made.tables for row in t.rows]
    assert "its resolution of 10 mm, " in next(f.caption for f in made.figures if f.id == "preview-chain")


def test_claims_on_the_preview_follow_the_numbers():
    """The preview as the paper has it."""
    small, big = HEIGHTS_MM
    as_published = {
        over(PRINTED, big): {"lowest": -0.04},
        over(PRINTED, small): {"lowest": -0.012},
        long(PRINTED_FED): {"spread": [0.01, 0.1, 1.0]},
        generated(SPEEDOMETER_ERRORS[-1]): {"offsets": [0.15, 0.3]},
    }
    found = {c.id: c for c in PREVIEW.judge(altered(made_up_study(), as_published))}
    assert [i for i, c in found.items() if not c.passed] == ["preview-rate"]
    assert found["preview-dip"].result == "-40 mm after a bump of 76 mm, -12 mm after 30 mm"
    assert found["preview-dip"].value == pytest.approx(40.0)  # its depth
    assert found["preview-unstable"].result.startswith(
        "the error of the buffered road grows from 10.0 mm to 1.0 m in 20 s"
    )
    back = PREVIEW.judge(altered(made_up_study(), {long(PRINTED_FED): {"spread": [0.01, 0.2, 0.19]}}))
    assert {c.id: c.verdict for c in back}["preview-unstable"] == "not reproduced"


@pytest.mark.parametrize(
    ("name", "changes", "verdict"),
    [
        ("preview-fed", {over(FED, HEIGHTS_MM[0]): {"lowest": -0.002}}, "does not hold"),  # a dip, though stable
        (
            "preview-fed",
            {long(FED): {"spread": [0.001, 0.05, 0.002]}},
            "does not hold",
        ),  # no dip, but for once too large an error
        ("preview-fed", {long(FED): {"spread": [0.001, 0.02, 0.002]}}, "holds"),
        (
            "generated-drift",
            {generated(SPEEDOMETER_ERRORS[-1]): {"offsets": [-0.6, 0.5]}},
            "not reproduced",
        ),  # more at the first
        ("generated-drift", {generated(SPEEDOMETER_ERRORS[-1]): {"offsets": [-0.6, 0.7]}}, "reproduced"),
    ],
)
def test_each_half_of_a_criterion_counts(name, changes, verdict):
    found = {c.id: c for c in PREVIEW.judge(altered(made_up_study(), changes))}
    assert found[name].verdict == verdict
    assert found["preview-dip-compensated"].unit == "mm"


def test_what_a_chain_records_is_of_its_kind():
    assert {"sensors.range.left", "preview_sensor.sensed.left.x"} < set(chains.recorded(chains.Case(preview="sensed")))
    generated_ = chains.recorded(chains.Case(preview="generated"))
    assert generated_ == ["speed.x", "map.road.fl.height", "road.road.fl.height", "sensors.loadcell.fl"]


def test_a_failed_run_of_the_chain_leaves_open_what_needs_it_and_nothing_else():
    judged = PREVIEW.judge(failed(made_up_study(), over(COMPENSATED, 76.0)))
    assert [c.id for c in judged if c.verdict == "open"] == ["preview-dip-compensated"]
