"""Animations: mistakes, numbers that survive packing, the page that holds them."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from packed import packed_texts

from cosim.report import (
    Animation,
    Body,
    Force,
    Phase,
    Reading,
    Report,
    Scene,
    Section,
    Strut,
    Take,
    Wheel,
    write_report,
)
from cosim.report.animation import animation_data

N = 26
T = 0.02 * np.arange(N)
BOX = [(-1.0, -0.2), (1.0, -0.2), (1.0, 0.5), (-1.0, 0.5)]


def body(**changes) -> Body:
    return Body(**{"name": "car", "outline": BOX, "x": 2 * T, "z": 0.8 + 0.1 * T, "angle": 0.05 * T} | changes)


def scene(title: str = "passive", **changes) -> Scene:
    parts = {
        "step": 0.02,
        "ground": [(-5, 0), (5, 0)],
        "bodies": [body()],
        "wheels": [Wheel("front", 0.5, 2 * T + 0.7, np.full(N, 0.5), 4 * T)],
        "struts": [Strut("car", (0.7, 0.3), "front")],
        "forces": [Force("front", 2 * T + 0.7, 0 * T, 100 * T, 30e3 + 0 * T)],
        "readings": [Reading("pitch [deg]", np.degrees(0.05 * T), 2)],
        "phase": Phase(["outside", "inside"], T > 0.3),
        "outcome": "passed",
    }
    return Scene(title=title, **parts | changes)


def animation(*scenes: Scene, **changes) -> Animation:
    parts = {"id": "crossing", "title": "Crossing", "caption": "", "takes": [Take("run", scenes or [scene()])]}
    return Animation(**parts | changes)


def unpacked(packed: dict) -> np.ndarray:
    """What the page's script makes of a series."""
    return np.cumsum(packed["steps"]) / 10.0 ** packed["decimals"]


def test_series_survive_packing():
    made = scene()
    data = animation_data(animation(made))["takes"][0]["scenes"][0]
    for ours, theirs, names in (
        (made.bodies[0], data["bodies"][0], {"x": 5e-4, "z": 5e-4, "angle": 5e-5}),
        (made.wheels[0], data["wheels"][0], {"x": 5e-4, "z": 5e-4, "turn": 5e-3}),
        (made.forces[0], data["forces"][0], {"x": 5e-3, "z": 5e-3, "fx": 50.0, "fz": 50.0}),
        (made.readings[0], data["readings"][0], {"values": 5e-3}),
    ):
        for name, error in names.items():
            np.testing.assert_allclose(unpacked(theirs[name]), getattr(ours, name), atol=error * 1.001)
    np.testing.assert_array_equal(unpacked(data["phase"]["index"]), T > 0.3)
    assert [data["forces"][0][n]["decimals"] for n in ("x", "z")] == [2, 2]  # a centimeter: a pixel of a page 900 wide
    assert data["wheels"][0]["turn"]["decimals"] == 2
    assert (data["readings"][0]["quantity"], data["readings"][0]["unit"]) == ("pitch", "deg")
    assert made.ground == data["ground"] == ((-5.0, 0.0), (5.0, 0.0))
    assert data["struts"] == [{"body": 0, "at": (0.7, 0.3), "wheel": 0}]
    assert (made.samples, made.duration) == (N, pytest.approx(0.5))


@pytest.mark.parametrize(
    "make",
    [
        lambda: body(outline=BOX[:2]),
        lambda: body(outline=[*BOX, (np.nan, 0.0)]),
        lambda: body(x=[0.0, np.nan]),
        lambda: Wheel("w", 0.0, T, T, T),
        lambda: Force("f", T, T, T, T, "wind"),
        lambda: Reading("pitch", T),
        lambda: Phase(["a"], [0, 1]),
        lambda: scene(step=0.0),
        lambda: scene(bodies=[]),
        lambda: scene(ground=[(0, 0)]),
        lambda: scene(struts=[Strut("car", (0, 0), "rear")]),
        lambda: scene(bodies=[body(), body()]),
        lambda: scene(readings=[Reading("pitch [deg]", T[:-1])]),
        lambda: Take("t", []),
        lambda: Take("t", [scene(), scene()]),
        lambda: animation(takes=[]),
        lambda: animation(id="Über"),
        lambda: animation(width=0.0),
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
    t = np.arange(3000) / 50
    wave = np.sin(t)
    made = scene(
        bodies=[body(x=t, z=0.8 + 0.1 * wave, angle=0.1 * wave)],
        wheels=[Wheel(str(i), 0.5, t + i, 0.5 + 0.1 * wave, 2 * t) for i in range(3)],
        struts=[],
        forces=[Force(str(i), t + i, 0 * t, 1e4 * wave, 5e4 + 1e4 * wave) for i in range(3)],
        readings=[Reading("pitch [deg]", 5 * wave)],
        phase=None,
    )
    assert len(json.dumps(animation_data(animation(made)), separators=(",", ":"))) < 250_000


def test_the_page_draws_forces_to_one_scale_at_their_full_length(tmp_path) -> None:
    """As many newtons to a meter as are said, 1e5 by default; nothing in the script shortens an arrow."""
    assert animation_data(animation())["forceScale"] == animation().force_scale == 1e5
    page = write_report(
        Report("e", "T", "", sections=[Section("S", animations=[replace(animation(), force_scale=3e4)])]), tmp_path
    )
    text = page.read_text(encoding="utf-8")
    assert json.loads(packed_texts(text)["motion-crossing"])["forceScale"] == 30000.0
    assert "const fx = (at(force.fx, place) / options.forceScale) * scale" in text
    assert "arrow(pen, x, y, fx, -fz" in text
