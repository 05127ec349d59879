"""Papers 001 and 003 under other readings: what a reading changes, and that the first one is the main study."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import hmmwv_made_up
import made_up
import pytest
from hmmwv_made_up import PARTS
from kept_results import kept_claims, kept_readings, readings_of

from cosim.experiments import hmmwv, hmmwv_readings, three_axle, trench, trench_readings
from cosim.experiments.hmmwv.runs import Case as Car
from cosim.experiments.hmmwv.tracking.runs import Case as Corner
from cosim.experiments.trench.runs import Case as Crossing
from cosim.experiments.trench.web import live
from cosim.study import CaseError, FmuSet, Row, Runner, Task, run_study
from cosim.study.experiment import resolved
from cosim.study.readings import AS_READ, read_as
from cosim.study.readings_report import judge
from fmu_sources.models.corners import CORNERS

MODULES = (hmmwv_readings, trench_readings)
MAIN = {hmmwv_readings: [hmmwv.EXPERIMENT], trench_readings: [trench.EXPERIMENT, three_axle.EXPERIMENT]}


@pytest.mark.parametrize("module", MODULES)
def test_as_read_it_is_the_main_study(module: Any) -> None:
    """The same cases, which are run by the same functions: the same runs bit for bit."""
    planned = {t.case for e in MAIN[module] for t in e.tasks() if isinstance(t, Task)}
    needed = set(module.needs())
    assert needed <= planned
    assert {c for c in module.STUDY.cases(full=True) if c in planned} >= needed
    functions = {e.case: e.functions for main in MAIN[module] for e in main.every}
    for e in module.EXPERIMENT.every:
        assert e.functions == functions[e.case]


@pytest.mark.parametrize("module", MODULES)
def test_every_reading_changes_runs_and_every_run_belongs_to_one(module: Any) -> None:
    main = set(module.needs())
    for name, reading in module.STUDY.chosen(full=True).items():
        read = {read_as(reading, case) for case in main}
        assert (read != main) == (name != AS_READ), name
    labels = [t.label for t in module.EXPERIMENT.tasks(full=True)]
    assert len(set(labels)) == len(labels)


def test_numbers_of_runs() -> None:
    """Each below five minutes on two idle cores, but for the full ones."""
    counts = {m: (len(m.STUDY.cases(full=False)), len(m.STUDY.cases(full=True))) for m in MODULES}
    assert counts == {hmmwv_readings: (571, 1446), trench_readings: (420, 1908)}


# ------------------------------------------------------------------------------------------------------------- judging


def car(case: Any) -> Row:
    """As published, but that the pump's limit spoils MPC off road, and friction the test track."""
    row = PARTS[type(case)](case)[0]
    if isinstance(case, Car):
        if case.flow_limit and case.controller == "mpc" and case.road == "off-road":
            row["absorbed_power"] = 7.0
        if case.friction and case.road == "track" and case.controller != "passive":
            row["absorbed_power"] *= 2.0
    return row


def test_readings_of_paper_001() -> None:
    judged = judge(hmmwv_readings.STUDY, made_up.study(hmmwv_readings.EXPERIMENT, car))
    found = {name: {c.id: c.verdict for c in claims} for name, claims in judged.items()}
    assert list(found) == list(hmmwv_readings.READINGS)
    assert found[AS_READ]["off-road-driver"] == "open"
    assert found["accumulator that never empties"]["off-road-driver"] == "reproduced"
    assert found["no accumulator, one pump for all"]["off-road-driver"] == "not reproduced"
    assert found[AS_READ]["track-twofold"] == "reproduced"
    assert found["dry friction in the car, none at the corner"]["track-twofold"] == (
        "trend reproduced, magnitude differs"
    )


def test_the_main_study_gives_the_same_verdicts() -> None:
    main = hmmwv_made_up.made_up_study(hmmwv_made_up.watts(7.0, road="off-road", controller="mpc", flow_limit=True))
    expected = {c.id: c.verdict for c in resolved(hmmwv.EXPERIMENT.study.claims).judge(main)}
    judged = judge(hmmwv_readings.STUDY, made_up.study(hmmwv_readings.EXPERIMENT, car))[AS_READ]
    assert {c.id: c.verdict for c in judged} == {c.id: expected[c.id] for c in judged}
    assert len(judged) == sum(not s.own for s in resolved(hmmwv.EXPERIMENT.study.claims))


@pytest.mark.full
@pytest.mark.parametrize("module", MODULES)
def test_as_read_a_study_gives_what_is_told_of_the_main_one(module: Any, fmus: FmuSet, tmp_path: Path) -> None:
    results = run_study(module.EXPERIMENT, fmus, tmp_path / "runs")
    assert readings_of(module.EXPERIMENT, results, fmus) == kept_readings(module.EXPERIMENT.name)
    judged = judge(module.STUDY, results)[AS_READ]
    told = [c for e in MAIN[module] for c in kept_claims(e.name) if not c["own"]]
    assert [(c.id, c.verdict, c.result) for c in judged] == [(c["id"], c["verdict"], c["result"]) for c in told]


# ------------------------------------------------------------------------------------------ what options do to FMUs


@pytest.mark.parametrize("density", [None, 850.0])
def test_density_is_that_of_actuators_and_force_tracking(fmus: FmuSet, density: float | None) -> None:
    with Runner(hmmwv.EXPERIMENT, fmus) as runner:
        runner.system(Car("bump", "mpc", density=900.0))  # another case of the same system
        system = runner.system(Car("bump", "mpc", density=density))
        for k in CORNERS:
            for name in (f"actuator_{k}", f"tracking_{k}"):
                assert system[name].values["fluid.density"] == (3500.0 if density is None else density)


def test_the_class_of_the_terrain(fmus: FmuSet) -> None:
    with Runner(hmmwv.EXPERIMENT, fmus) as runner:
        for terrain, number in (("D", 3), ("E", 4)):
            system = runner.system(Car("off-road", "passive", terrain=terrain))
            assert system["road"].values["class"] == number
        assert system["road"].description.parameters["class"].start == 4
    assert hmmwv.runs.passive(Car("off-road", "mpc", terrain="D", density=850.0)) == Car(
        "off-road", "passive", terrain="D", density=850.0
    )
    assert hmmwv.runs.without_actuators(Car("bump", "mpc", density=850.0)).density is None


def test_options_of_the_vehicle_over_the_trench(fmus: FmuSet) -> None:
    changed = Crossing(1.4, controller="mpc-offsets", spin="road", travel_factor=1.5, cg_height=0.5, guided=False)
    with Runner(trench.EXPERIMENT, fmus) as runner:
        for case, spin, extension, compression, height, pitch, retraction in (
            (changed, True, 1.5 * 0.15, 1.5 * 0.2, 0.5, 0.0, 0),
            (Crossing(1.4, controller="mpc-offsets"), False, 0.15, 0.2, 0.65, None, 1),
        ):
            system = runner.system(case)
            car, crossing = system["car"].values, system["crossing"]
            assert car["wheels.spin_on_road"] == spin
            assert (car["strut.extension"], car["strut.compression"]) == (extension, compression)
            assert car["body.cg_height"] == height
            for name in ("pitch.entry", "pitch.exit"):
                own = crossing.description.parameters[name].start
                assert crossing.values[name] == (own if pitch is None else pitch)
            assert system["controller"].values["retraction"] == retraction
    passive = replace(changed, controller="passive", guided=True)
    assert changed.passive() == passive
    assert next(c.case for c in live(changed).cases) == passive


@pytest.mark.parametrize(
    ("case", "choice"),
    [
        (Car, {"density": 50.0}),
        (Car, {"density": 850.0, "controller": "zero", "actuators": "ideal"}),
        (Car, {"terrain": "D"}),
        (Car, {"road": "off-road", "terrain": "DE"}),
        (Crossing, {"spin": "air"}),
        (Crossing, {"travel_factor": 0.0}),
        (Crossing, {"cg_height": 3.0}),
        (Crossing, {"guided": False}),
        (Crossing, {"guided": False, "controller": "passive"}),
    ],
)
def test_values_that_cannot_be(case: type, choice: dict[str, Any], raises: Any) -> None:
    with raises(CaseError):
        case(**choice)


def test_a_corner_of_the_physical_actuator_is_another_fmu() -> None:
    reading = hmmwv_readings.READINGS["density of real oil"]
    assert read_as(reading, Corner("sweep", average=True)) == Corner("sweep", average=True, actuator="physical")
    assert read_as(reading, Corner("filter")) == Corner("filter")
