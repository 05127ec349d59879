"""Animations: mistakes, numbers that survive packing, the page that holds them."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from packed import packed_texts

from cosim.report import Animation, Phase, Playback, Report, Section, Take, write_report
from cosim.report.animation import animation_data
from cosim.scenes.scene import Arrow, Body, Face, Ground, Reading, Scene, Wheel, scene_data

N = 26
T = 0.02 * np.arange(N)
SIDE = Face([(-1.0, 0.0, -0.2), (1.0, 0.0, -0.2), (1.0, 0.0, 0.5)])
LOOKS = Scene(
    "car",
    [Body("car", [SIDE], x="car.x", z="car.z", pitch="car.pitch")],
    "car",
    9.0,
    1e5,
    wheels=[Wheel("front", 0.5, 0.2, "car.front.x", 0.0, "car.radius")],
    arrows=[Arrow("front", "ground", "car.front.fz", on="front")],
    readings=[Reading("pitch", "deg", "car.pitch", 2, 57.3)],
)
SERIES = {
    "car.x": 2 * T,
    "car.z": 0.8 + 0.1 * T,
    "car.pitch": 0.05 * T,
    "car.front.x": 2 * T + 0.7,
    "car.front.fz": 30e3 + 100 * T,
    "car.radius": 0.5,
}


def scene(title: str = "passive", **changes) -> Playback:
    parts = {
        "step": 0.02,
        "scene": LOOKS,
        "series": SERIES,
        "phase": Phase(["outside", "inside"], T > 0.3),
        "outcome": "passed",
    }
    return Playback(title, **parts | changes)


def animation(*scenes: Playback, **changes) -> Animation:
    parts = {"id": "crossing", "title": "Crossing", "caption": "", "takes": [Take("run", scenes or [scene()])]}
    return Animation(**parts | changes)


def unpacked(packed: dict) -> np.ndarray:
    """What the page's script makes of a series."""
    return np.cumsum(packed["steps"]) / 10.0 ** packed["decimals"]


def test_series_survive_packing():
    data = animation_data(animation(scene()))["takes"][0]["scenes"][0]
    for name, values in SERIES.items():
        packed = data["values"][data["series"][name]]
        if np.ndim(values) == 0:
            assert packed == values
        else:
            np.testing.assert_allclose(unpacked(packed), values, atol=5e-4 * np.abs(values).max())
    np.testing.assert_array_equal(unpacked(data["phase"]["index"]), T > 0.3)
    assert data["scene"] == scene_data(LOOKS)
    assert (data["samples"], data["step"], data["outcome"], data["good"]) == (N, 0.02, "passed", True)


def test_what_variables_share_is_there_once_and_what_nothing_reads_is_left_out():
    values = 2 * T
    shared = SERIES | {"car.x": values, "car.front.x": values, "car.other": T}
    data = animation_data(animation(scene(series=shared)))["takes"][0]["scenes"][0]
    assert data["series"]["car.x"] == data["series"]["car.front.x"]
    assert set(data["series"]) == set(LOOKS.variables)
    assert len(data["values"]) == len(LOOKS.variables) - 1


@pytest.mark.parametrize(
    "make",
    [
        lambda: scene(series={n: v for n, v in SERIES.items() if n != "car.z"}),
        lambda: scene(series=SERIES | {"car.z": np.full(N, np.nan)}),
        lambda: scene(series=SERIES | {"car.radius": np.inf}),
        lambda: scene(series=SERIES | {"car.z": T[:-1]}),
        lambda: scene(series=SERIES | {"car.z": [T]}),
        lambda: scene(series={name: [0.0] for name in SERIES}, phase=None),
        lambda: scene(phase=Phase(["outside", "inside"], T[1:] > 0.3)),
        lambda: scene(scene=replace(LOOKS, grounds=[Ground("left", 0.5, "road", "x", "z", 0.0)])),
        lambda: Phase(["a"], [0, 1]),
        lambda: scene(step=0.0),
        lambda: scene(title=" "),
        lambda: Take("t", []),
        lambda: Take("t", [scene(), scene()]),
        lambda: animation(takes=[]),
        lambda: animation(id="Über"),
    ],
)
def test_refuses(make, raises):
    with raises(ValueError):
        make()


def report(*animations: Animation) -> Report:
    return Report("demo", "Demo", "Lead.", sections=[Section("Motion", animations=animations)])


def test_page_holds_the_data_and_its_script_and_fetches_nothing(tmp_path):
    text = write_report(report(animation(scene("a <b>"), scene("c"))), tmp_path).read_text(encoding="utf-8")
    data = json.loads(packed_texts(text)["motion-crossing"])
    assert [s["title"] for s in data["takes"][0]["scenes"]] == ["a <b>", "c"]
    assert 'data-animation="motion-crossing"' in text
    assert "requestAnimationFrame" in text
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", text)
    policy = re.search(r'Content-Security-Policy" content="(.*?)"', text)
    assert policy is not None
    assert policy[1].count("sha256-") == 3  # what unpacks, the page's script and the player
    assert json.loads((tmp_path / "summary.json").read_text())["animations"] == {
        "crossing": {"title": "Crossing", "takes": ["run"]}
    }


def test_page_without_animation_has_no_player(tmp_path):
    text = write_report(report(), tmp_path).read_text(encoding="utf-8")
    assert "requestAnimationFrame" not in text
    assert ".stage" not in text


def test_same_bytes_and_unique_ids(tmp_path, raises):
    one, two = (write_report(report(animation()), tmp_path / n).read_bytes() for n in ("one", "two"))
    assert one == two
    with raises(ValueError):
        report(animation(), replace(animation()))


def test_a_minute_at_50_hz_stays_small():
    """Of a vehicle with some 30 series, before the page compresses it."""
    t = np.arange(3000) / 50
    moves = {f"car.{i}": np.sin(t + i) for i in range(30)}
    looks = replace(LOOKS, bodies=[*LOOKS.bodies, *(Body(n, [SIDE], x=n) for n in moves)])
    made = scene(scene=looks, series=SERIES | dict.fromkeys(SERIES, t) | moves, phase=None)
    assert len(json.dumps(animation_data(animation(made)), separators=(",", ":"))) < 500_000
