"""The showpieces in Chromium: no error, accessible, and bit-identical to the native run.

`make test-pages` runs these; see `browsers`. Frames and pace are measured by `benchmarks.web_pages`.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browsers import looked_at
from built import FMUS, BuiltFmus
from same import bits

from cosim.experiments.handling.metrics import rollover_index
from cosim.experiments.live_pages import shown as shown_experiments
from cosim.export.web.page import SHOWN_EVERY
from cosim.study import FmuSet, Runner
from cosim.study.experiment import resolved
from cosim.study.web import write_web

pytestmark = [pytest.mark.pages, pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")]
SCRIPT = Path(__file__).with_name("live.mjs")
SECONDS = 60
LARGEST = 3e6  # bytes of a page


def drives(experiment: Any) -> list[Any]:
    """The controls of its page that a person holds."""
    return [c for c in resolved(experiment.web)(experiment.case()).page.controls if c.drive]


driven_pages = pytest.mark.parametrize("shown", [n for n, e in shown_experiments().items() if drives(e)], indirect=True)


@pytest.fixture(scope="module", params=sorted(shown_experiments()))
def shown(request: pytest.FixtureRequest, built_fmus: BuiltFmus, tmp_path_factory: pytest.TempPathFactory) -> Any:  # noqa: ARG001
    """Experiment, page, and what was found of it."""
    experiment = shown_experiments()[request.param]
    folder = tmp_path_factory.mktemp(request.param)
    path = write_web(experiment, FmuSet(FMUS), folder / "page.html", experiment.case())
    return experiment, path, looked_at(SCRIPT, path, folder, str(SECONDS))


def test_the_page_is_small(shown) -> None:
    _, path, _ = shown
    assert path.stat().st_size < LARGEST


def test_what_is_no_longer_shown_takes_no_memory(shown) -> None:
    """A course that is chosen again and again; the size of systems may differ from course to course."""
    _, _, found = shown
    assert found["memory"] < 1.5


def test_it_says_and_asks_nothing(shown) -> None:
    _, _, found = shown
    assert found["errors"] == []
    assert found["asked"] == []


def test_it_runs_and_can_be_read_by_everyone(shown) -> None:
    _, _, found = shown
    assert found["waits"]  # where reduced motion is asked for
    for view in found["views"]:
        assert view["state"] == "ready"
        assert view["overflow"] <= 0
        assert view["pace"] > 0  # with all systems and their pictures
        assert view["frames"] > 0
        assert [
            (v["id"], v["help"], v["nodes"]) for v in view["violations"] if v["impact"] in ("serious", "critical")
        ] == []
        assert all(label and "NaN" not in label for label in view["labels"])


def test_a_system_that_stands_is_seen_from_all_sides(shown) -> None:
    """Pressed, dragged, zoomed, from behind.

    Each is another picture of the same moment, except a press that is no drag.
    """
    _, _, found = shown
    looks = found["looks"]
    assert {(v["time"], v["running"]) for v in looks.values()} == {(0, False)}
    assert looks["pressed"] == looks["first"]
    first = looks["first"]["view"]
    assert [v["view"] for v in looks.values()] == [first, first, "three-quarter", "three-quarter", "rear"]
    assert len({v["picture"] for v in looks.values()}) == 4
    assert looks["dragged"]["azimuth"] < looks["first"]["azimuth"]
    assert looks["zoomed"]["zoom"] > looks["dragged"]["zoom"] == 1
    assert looks["rear"]["azimuth"] == pytest.approx(math.pi) or looks["rear"]["azimuth"] == pytest.approx(-math.pi)


@driven_pages
def test_held_keys_and_a_gamepad_drive_and_what_is_released_returns(shown) -> None:
    experiment, _, found = shown
    controls = drives(experiment)
    driven, rest = found["driven"], [c.drive.rest for c in controls]
    assert driven["inputs"] == [n for c in controls for n in c.names]
    assert sorted(k["key"] for k in driven["keys"]) == sorted(k for c in controls for k in c.drive.keys)
    for k in driven["keys"]:
        for control, value in zip(controls, k["held"], strict=True):
            mine = control.names[0] == k["name"]
            way = mine * (1 if k["key"] in control.drive.raised_by else -1)
            assert value == pytest.approx(control.drive.rest + way * 0.3 * control.drive.rate), k["key"]
        assert k["released"] == rest
    assert driven["scrolled"] == 0  # by arrow keys
    pad = driven["pad"]
    assert "drives" in pad["there"]
    assert "lost" in pad["lost"]
    assert all(held != at for held, at in zip(pad["held"], rest, strict=True))
    assert pad["released"] == rest


@driven_pages
def test_a_driven_run_is_that_of_the_engine_with_the_same_inputs(shown) -> None:
    experiment, _, found = shown
    driven, live = found["driven"], resolved(experiment.web)(experiment.case())
    with Runner(experiment, FmuSet(FMUS)) as runner:
        system = runner.system(live.cases[0].case)
        names, rows = driven["names"], driven["rows"]
        system.allow_unconnected = True
        with system.initialize(record=names) as simulation:
            for k in range(1, len(rows[names[0]])):
                for name in driven["inputs"]:
                    simulation.set(name, rows[name][k])
                simulation.advance(k * (live.page.interval or SHOWN_EVERY))
            native = [float(simulation[n]) for n in names]
    assert list(map(int, driven["bits"])) == bits(native).tolist()


@pytest.mark.parametrize("shown", ["handling"], indirect=True)
def test_the_car_turns_to_the_side_of_the_key(shown) -> None:
    """Yaw rate and lateral acceleration are positive to the left; what the page says is the last row."""
    _, _, found = shown
    driven = found["driven"]
    rows = driven["rows"]
    rate = {k["key"]: rows["car.body.yaw_rate"][k["to"]] for k in driven["keys"]}
    assert min(rate["ArrowLeft"], rate["a"]) > 0.02
    assert max(rate["ArrowRight"], rate["d"]) < -0.02
    speed = {k["key"]: rows["car.speed"][k["to"]] - rows["car.speed"][k["from"]] for k in driven["keys"]}
    assert min(speed["ArrowUp"], speed["w"]) > 0 > max(speed["ArrowDown"], speed["s"])
    told = {r["label"]: r["text"] for r in driven["readings"]}
    assert told["lateral acceleration"] == f"{rows['car.body.ay'][-1]:.2f}"
    assert told["speed"] == f"{3.6 * rows['car.speed'][-1]:.1f}"
    left, right = (np.array([rows[f"car.tire.{axle}{side}.force"] for axle in "fr"]).sum(axis=0) for side in "lr")
    index = rollover_index(left, right)
    assert told["rollover index"] == f"{index[-1]:.2f}"
    assert told["largest rollover index"] == f"{np.abs(index).max():.2f}"


def test_its_numbers_are_those_of_the_native_run(shown) -> None:
    experiment, _, found = shown
    live = resolved(experiment.web)(experiment.case())
    seen = [s for group in found["groups"] for s in group["systems"]]
    assert len(seen) == len(live.cases)
    for case, page in zip(live.cases, seen, strict=True):
        assert page["title"] == case.title
        assert page["failure"] is None
        with Runner(experiment, FmuSet(FMUS)) as runner:
            system = runner.system(case.case)
            for name, value in case.values.items():
                component, variable = system.components.parts(name)
                system[component].set({variable: value})
            names = page["names"]
            system.allow_unconnected = True
            with system.initialize(record=names) as simulation:
                simulation.advance(page["steps"] * (live.page.interval or SHOWN_EVERY))
                native = [float(simulation[n]) for n in names]
        assert list(map(int, page["bits"])) == bits(native).tolist(), (case.title, page["steps"])
        if live.page.finish is not None:
            assert page["verdict"] in (("passed", "failed", "stuck") if live.page.finish.when else ("over",))
