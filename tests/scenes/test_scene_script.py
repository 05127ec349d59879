"""What the page's script draws: where, in which order, of which length, and the sentence about it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from built import FMUS, BuiltFmus
from scenes.browser import COLORS, Browser
from ssp.systems import EVERY, experiment_system

from cosim import System
from cosim.scenes import infer_scene, shapes
from cosim.scenes.scene import (
    Arrow,
    Body,
    Cone,
    Face,
    Ground,
    Limit,
    Points,
    Reading,
    Relief,
    Scene,
    Strut,
    Trench,
    Value,
    Wheel,
)
from cosim.scenes.shapes import Axle, Outline
from cosim.study import FmuSet

VIEWS = ("side", "three-quarter", "rear")
SQUARE = Face([(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)])
WHEEL = Wheel(
    "w",
    0.5,
    0.2,
    x=Value({"car.x": 1.0}),
    y=-0.8,
    z=Value({"car.wheel": 1.0}, 0.45),
    squash=Value({"car.tire": -1.0}, 0.05),
)
BODY = Body(
    "body", [SQUARE], x="car.x", z=Value({"car.z": 1.0}, 1.0), roll="car.roll", pitch="car.pitch", yaw="car.yaw"
)
STILL = dict.fromkeys(("car.x", "car.z", "car.roll", "car.pitch", "car.yaw", "car.wheel", "car.tire", "car.force"), 0.0)
LEVEL = [Relief([(0.0, 0.0)])]


@pytest.fixture(scope="module")
def browser() -> Browser:
    return Browser()


def scene(**parts: object) -> Scene:
    return Scene(
        **{
            "title": "t",
            "bodies": [BODY],
            "follow": "body",
            "width": 10.0,
            "force_scale": 1e4,
            "wheels": [WHEEL],
            "reliefs": LEVEL,
        }
        | parts
    )  # type: ignore[arg-type]


def screen(browser: Browser, point: object) -> tuple[float, float]:
    x, y = browser.run(f"view.screen({json.dumps(point)})")
    return x, y


# -------------------------------------------------------------------------------------------- from a pose to the screen


def test_from_the_side_ahead_is_right_and_up_is_up(browser: Browser) -> None:
    browser.see(scene(), STILL)
    x0, y0 = screen(browser, [0, 0, 0])
    x1, y1 = screen(browser, [1, 0, 0])
    x2, y2 = screen(browser, [0, 0, 1])
    scale = browser.run("view.scale")
    assert (x1 - x0, y1 - y0) == pytest.approx((scale, 0), abs=1e-9)
    assert x2 == pytest.approx(x0)
    assert y0 - y2 == pytest.approx(scale * math.cos(browser.run("view.camera.elevation")))
    assert 0.9 * scale < y0 - y2
    assert screen(browser, [0, -1, 0])[1] > y0  # the right side is nearer, so lower


def test_from_behind_left_is_left(browser: Browser) -> None:
    browser.see(scene(), STILL, "rear")
    x0, _ = screen(browser, [0, 0, 0])
    assert x0 - screen(browser, [0, 1, 0])[0] == pytest.approx(browser.run("view.scale"))
    assert screen(browser, [3, 0, 0])[0] == pytest.approx(x0)


def test_from_ahead_and_the_right_both_are_nearer(browser: Browser) -> None:
    browser.see(scene(), STILL, "three-quarter")
    x0, y0 = screen(browser, [0, 0, 0])
    for nearer in ([1, 0, 0], [0, -1, 0]):
        assert screen(browser, nearer)[1] > y0
    assert screen(browser, [1, 0, 0])[0] > x0 > screen(browser, [0, -1, 0])[0]


@pytest.mark.parametrize("zoom", [1.0, 2.5])
def test_the_whole_vehicle_is_seen(browser: Browser, zoom: float) -> None:
    for view in VIEWS:
        browser.see(scene(), STILL | {"car.x": 900.0}, view)
        before = browser.run("view.scale")
        x, y = screen(browser, [900.0, 0, 1.0])
        assert 0 < x < 800
        assert 0 < y < 400
        browser.engine.eval(f"view.zoom({zoom})")
        browser.draw(0.1)
        assert browser.run("view.scale") == pytest.approx(zoom * before)


@pytest.mark.parametrize(
    ("moved", "point", "higher", "ahead", "left"),
    [
        ("car.pitch", [2, 0, 0], -1, None, 0),  # nose down
        ("car.roll", [0, 1, 0], 1, 0, None),  # left side up
        ("car.yaw", [2, 0, 0], 0, None, 1),  # to the left
    ],
)
def test_angles_are_those_of_iso_8855(
    browser: Browser, moved: str, point: list[float], higher: int, ahead: int | None, left: int | None
) -> None:
    browser.see(scene(), STILL)
    before = np.array(browser.run(f"SceneView.placed(view.poses[0], {point})"))
    browser.values(STILL | {moved: 0.1})
    browser.draw(0.1)
    change = np.array(browser.run(f"SceneView.placed(view.poses[0], {point})")) - before
    size = 0.1 * max(point)
    assert change[2] == pytest.approx(higher * size, rel=0.01, abs=1e-12)
    for k, sign in ((0, ahead), (1, left)):
        if sign is not None:
            assert change[k] == pytest.approx(sign * size, rel=0.01, abs=1e-12)


def test_all_angles_at_once(browser: Browser) -> None:
    """Against a product of three rotations, yaw outside and roll inside."""
    r, p, y = 0.3, -0.2, 0.5
    browser.see(scene(), STILL | {"car.roll": r, "car.pitch": p, "car.yaw": y, "car.x": 7.0, "car.z": 0.25})
    about_x = np.array([[1, 0, 0], [0, math.cos(r), -math.sin(r)], [0, math.sin(r), math.cos(r)]])
    about_y = np.array([[math.cos(p), 0, math.sin(p)], [0, 1, 0], [-math.sin(p), 0, math.cos(p)]])
    about_z = np.array([[math.cos(y), -math.sin(y), 0], [math.sin(y), math.cos(y), 0], [0, 0, 1]])
    expected = about_z @ about_y @ about_x @ [0.4, -0.7, 1.1] + [7.0, 0.0, 1.25]
    assert browser.run("SceneView.placed(view.poses[0], [0.4, -0.7, 1.1])") == pytest.approx(list(expected))
    turned = (about_z @ about_y @ about_x).T @ [0.1, 0.2, -0.3]
    assert browser.run("SceneView.turned(view.poses[0], [0.1, 0.2, -0.3])") == pytest.approx(list(turned))


def test_exaggeration_counts_from_rest(browser: Browser) -> None:
    lifted = Body("body", [SQUARE], z=Value({"car.z": 2.0}, 0.3, rest=1.0))
    browser.see(scene(bodies=[lifted]), STILL | {"car.z": 0.4})  # 1.1, 0.1 above rest
    assert browser.run("view.poses[0][11]") == pytest.approx(1.1)
    browser.engine.eval("view.exaggeration = 5")
    browser.draw(0.1)
    assert browser.run("view.poses[0][11]") == pytest.approx(1.5)
    assert "motion and heights × 5" in browser.run("texts")


# -------------------------------------------------------------------------------------------------- what hides what


def vehicle_bodies() -> Iterator[tuple[str, list[Face]]]:
    yield "off-road", shapes.off_road([Axle(1.98, 0.91, 0.47, 0.32), Axle(-1.32, 0.91, 0.47, 0.32)], 0.85)
    yield "sedan", shapes.sedan([Axle(1.01, 0.76, 0.33, 0.2), Axle(-1.8, 0.755, 0.33, 0.2)], 0.55)
    yield "carrier", shapes.carrier([Axle(x, 1.25, 0.62, 0.4) for x in (2.05, 0.0, -2.05)], Outline())
    yield "rig", shapes.rig_frame(0.5, 3.0) + shapes.rig_mass(0.5)


@pytest.mark.parametrize("faces", [pytest.param(f, id=n) for n, f in vehicle_bodies()])
@pytest.mark.parametrize("toward", [(-0.1, -0.99, 0.07), (0.53, -0.79, 0.3), (-0.99, 0.01, 0.13), (0.4, 0.6, 0.69)])
def test_the_nearest_face_is_drawn_last(
    browser: Browser, faces: list[Face], toward: tuple[float, float, float]
) -> None:
    """Rays through a body.

    What was drawn last at a place is the nearest face there, of all faces as they were declared.
    """
    d = np.array(toward) / np.linalg.norm(toward)
    right = np.cross([0, 0, 1.0], d)
    right /= np.linalg.norm(right)
    up = np.cross(d, right)
    declared = [{"points": f.points, "material": f.material, "id": i} for i, f in enumerate(faces)]
    drawn = browser.run(
        f"(() => {{ const list = []; const tree = SceneView.tree({json.dumps(declared)}.map((f) =>"
        f" ({{...SceneView.face(f), id: f.id}}))); SceneView.walk(tree, {json.dumps(d.tolist())}, [], (f) =>"
        " list.push([f.id, f.points]), () => 0); return list; })()"
    )
    plane = np.array([right, up])
    generator = np.random.default_rng(5)
    places = np.empty((400, 2))
    for place in places:
        corners = np.array(faces[generator.integers(len(faces))].points)
        place[:] = plane @ (generator.dirichlet(np.ones(len(corners))) @ corners)
    last, nearest, at_last = np.full(400, -1), np.full(400, -math.inf), np.full(400, -math.inf)
    for i, points in drawn:
        last[_hold(np.array(points) @ plane.T, places, margin=1e-6)] = i
    for i, face in enumerate(faces):
        points = np.array(face.points)
        normal = np.cross(points[1] - points[0], points[2] - points[0])
        if abs(normal @ d) > 1e-9:
            depths = (normal @ points[0] - places @ plane @ normal) / (normal @ d)
            depths[~_hold(points @ plane.T, places, margin=-1e-6)] = -math.inf
            nearest = np.maximum(nearest, depths)
            at_last[last == i] = depths[last == i]
    hit = nearest > -math.inf
    assert at_last[hit] == pytest.approx(nearest[hit], abs=2e-3)
    assert np.count_nonzero(hit) > 300


def _hold(polygon: np.ndarray, places: np.ndarray, margin: float) -> np.ndarray:
    """Which of `places` (n, 2) a convex polygon (m, 2) holds; `margin` [m]: how far outside of it they may lie."""
    sides = np.roll(polygon, -1, axis=0) - polygon
    lengths = np.maximum(np.hypot(*sides.T), 1e-12)
    x, y = np.moveaxis(places[:, None] - polygon, -1, 0)
    crosses = (sides[:, 0] * y - sides[:, 1] * x) / lengths
    return (crosses > -margin).all(axis=1) | (crosses < margin).all(axis=1)


def test_wheels_are_drawn_between_the_faces(browser: Browser) -> None:
    """A wheel beside the vehicle is in front of its near side, and one on the other side is behind the far side."""
    faces = [{"points": [[-1, y, 0], [1, y, 0], [1, y, 1], [-1, y, 1]], "material": "body"} for y in (-0.5, 0.5)]
    order = browser.run(
        f"(() => {{ const list = []; SceneView.walk(SceneView.tree({json.dumps(faces)}.map(SceneView.face)), [0, -1,"
        " 0.1], [{at: [0, 0.8, 0], n: 'left'}, {at: [0, -0.8, 0], n: 'right'}, {at: [0, 0, 0], n: 'middle'}],"
        " (f) => list.push(f.points[0][1]), (w) => list.push(w.n)); return list; })()"
    )
    assert order == ["left", 0.5, "middle", -0.5, "right"]


def test_wheels_are_beside_the_vehicle_and_behind_its_tail(browser: Browser) -> None:
    """In an arch, a near wheel is drawn over what is between the wheels and under the sheet at the side.

    From behind, a front wheel under the tail.
    """
    axles = [Axle(1.98, 0.91, 0.47, 0.32), Axle(-1.32, 0.91, 0.47, 0.32)]
    faces = [{"points": f.points, "material": f.material} for f in shapes.off_road(axles, 0.85)]
    wheels = [
        {"at": [a.x, y, a.radius - 0.85], "n": f"{n} {s}"}
        for a, n in zip(axles, ("front", "rear"), strict=True)
        for y, s in ((0.91, "left"), (-0.91, "right"))
    ]

    def order(toward: list[float]) -> list[Any]:
        """Names of wheels, and faces as (material, points), as they are drawn."""
        return browser.run(
            f"(() => {{ const list = []; SceneView.walk(SceneView.tree({json.dumps(faces)}.map(SceneView.face)),"
            f" {toward}, {json.dumps(wheels)}, (f) => list.push([f.material, f.points]), (w) => list.push(w.n));"
            " return list; })()"
        )

    def upright_at(drawn: list[Any], y: float) -> list[int]:
        return [
            i for i, one in enumerate(drawn) if not isinstance(one, str) and all(abs(p[1] - y) < 1e-6 for p in one[1])
        ]

    side, inner = axles[0].outside, 0.91 - 0.16 - 0.06
    for toward in ([0.0, -1.0, 0.07], [0.53, -0.79, 0.3]):
        drawn = order(toward)
        for wheel in ("front right", "rear right"):
            assert max(upright_at(drawn, -inner)) < drawn.index(wheel) < min(upright_at(drawn, -side))
        assert max(upright_at(drawn, side)) < drawn.index("front left") < min(upright_at(drawn, inner))
    for across in (-1e-3, 0.0, 1e-3):
        drawn = order([-0.99, across, 0.13])
        for wheel, center in (("front left", 0.91), ("front right", -0.91)):
            hidden_by = [
                i
                for i, one in enumerate(drawn)
                if not isinstance(one, str) and one[0] == "body" and _is_tail(one[1], center)
            ]
            assert hidden_by
            assert drawn.index(wheel) < min(hidden_by)


def _is_tail(points: list[list[float]], y: float) -> bool:
    """Whether a face is behind the rear axle and hides what is at y from behind."""
    x, across, _ = np.array(points).T
    return bool(x.max() < -2.0 and across.min() < y < across.max())


# --------------------------------------------------------------------------------------------------------- wheels, road


def test_tires_end_on_the_road(browser: Browser) -> None:
    """Pressed in by 5 cm at rest, and by what the deflection says."""
    for tire in (0.0, -0.03, 0.08):
        browser.see(scene(), STILL | {"car.tire": tire, "car.wheel": tire})
        ring = np.array(browser.run("view.ring(view.wheels[0], 1, 0, 400)"))
        assert ring[:, 2].min() == pytest.approx(max(0.0, tire - 0.05), abs=2e-4)
        assert ring[:, 2].max() == pytest.approx(0.95 + tire, abs=2e-4)


def test_an_edge_presses_a_tire_in_where_it_is(browser: Browser) -> None:
    at_edge = Wheel("w", 0.5, 0.2, x=0.0, y=0.0, z=0.45, squash=0.1, contact=(0.4, 0.45))
    browser.see(scene(wheels=[at_edge]), STILL)
    ring = np.array(browser.run("view.ring(view.wheels[0], 1, 0, 400)"))
    assert ring[:, 0].max() == pytest.approx(0.4, abs=1e-3)
    assert ring[:, 2].min() == pytest.approx(-0.05, abs=1e-3)


def test_spokes_turn_ahead(browser: Browser) -> None:
    rolling = Wheel("w", 0.5, 0.2, x=0.0, y=0.0, z=0.5, turn="car.x")
    browser.see(scene(wheels=[rolling]), STILL)
    angle = (
        "(() => { const p = view.ring(view.wheels[0], 0.55, 0, 1, -view.wheels[0].turn)[0]; return Math.atan2(p[2] -"
        " 0.5, p[0]); })()"
    )
    assert browser.run(angle) == pytest.approx(0.0)
    browser.values(STILL | {"car.x": 0.3})
    browser.draw(0.1)
    assert browser.run(angle) == pytest.approx(-0.3)  # the foremost point goes down


GROUNDS = [Ground("left", 0.8, "road", "road.x", "road.l", 1.0), Ground("right", -0.8, "road", "road.x", "road.r", 1.0)]


def on_road(**parts: object) -> Scene:
    return scene(grounds=GROUNDS, reliefs=(), **parts)


def test_the_road_is_what_the_probe_says(browser: Browser) -> None:
    browser.see(
        on_road(), STILL | {"car.x": 50.0}, road="(side, x) => 0.1 * Math.sin(x) + (side === 'left' ? 0.02 : 0)"
    )
    for x in (46.3, 50.0, 53.9):
        assert browser.run(f"view.heightAt({x}, 0.8)") == pytest.approx(0.1 * math.sin(x) + 0.02, abs=1e-3)
        assert browser.run(f"view.heightAt({x}, -0.8)") == pytest.approx(0.1 * math.sin(x), abs=1e-3)
        assert browser.run(f"view.heightAt({x}, 0)") == pytest.approx(0.1 * math.sin(x) + 0.01, abs=1e-3)


def test_places_are_asked_for_once(browser: Browser) -> None:
    browser.see(on_road(), STILL, road="() => 0.05")
    first = browser.run("asked.length")
    browser.draw(0.1)
    assert browser.run("asked.length") == first > 100
    browser.values(STILL | {"car.x": 1.0})
    browser.draw(0.2)
    more = browser.run("asked.length") - first
    assert 2 * (1.0 * 150 / 10 - 2) < more < 2 * (1.0 * 150 / 10 + 2)


def test_what_was_driven_stays_drawn(browser: Browser) -> None:
    """A road that changes ahead, by a parameter: behind the vehicle it stays."""
    browser.see(on_road(), STILL, road="() => 0.05")
    browser.engine.eval("road = () => 0.2; view.refresh()")
    browser.draw(0.1)
    assert browser.run("view.heightAt(-2, -0.8)") == pytest.approx(0.05)
    assert browser.run("view.heightAt(2, -0.8)") == pytest.approx(0.2)
    browser.draw(0.0)  # the run begins again
    assert browser.run("view.heightAt(-2, -0.8)") == pytest.approx(0.2)


def test_wheels_leave_the_road_that_nobody_knows(browser: Browser) -> None:
    browser.see(on_road(), STILL)
    for k in range(60):
        x = 0.05 * k
        height = 0.1 if x > 1.5 else 0.0
        browser.values(STILL | {"car.x": x, "car.wheel": height})
        browser.draw(0.1 * k)
    assert browser.run("view.heightAt(1, -0.8)") == pytest.approx(0.0, abs=1e-9)
    assert browser.run("view.heightAt(2.5, -0.8)") == pytest.approx(0.1, abs=1e-9)


def test_trenches_are_cut_where_they_are(browser: Browser) -> None:
    trench = Trench("car.start", 1.4, 2.0)
    browser.see(scene(reliefs=(), trenches=[trench]), STILL | {"car.start": 2.0})
    heights = {x: browser.run(f"view.heightAt({x}, 0)") for x in (1.99, 2.01, 3.39, 3.41)}
    assert heights == pytest.approx({1.99: 0.0, 2.01: -2.0, 3.39: -2.0, 3.41: 0.0})
    browser.values(STILL | {"car.start": 3.0})
    browser.draw(0.1)
    assert browser.run("view.heightAt(2.5, 0)") == pytest.approx(0.0)


def test_reliefs_go_from_point_to_point(browser: Browser) -> None:
    relief = Relief([(1.0, 0.0), (2.0, 0.5), (2.0, 0.2), (3.0, 0.4)], "right")
    browser.see(scene(reliefs=[relief]), STILL)
    at = [
        browser.run(f"SceneView.along(view.data.reliefs[0].points, {x}, {side})")
        for x, side in ((0, 0), (1.5, 0), (2, -1), (2, 1), (2.5, 0), (9, 0))
    ]
    assert at == pytest.approx([0.0, 0.25, 0.5, 0.2, 0.3, 0.4])


def test_marks_stand_along_the_road(browser: Browser) -> None:
    browser.see(scene(), STILL | {"car.x": 102.0})
    assert "100 m" in browser.run("texts")
    assert "105 m" in browser.run("texts")


# ----------------------------------------------------------------------------------------------- forces, points, limits


@pytest.mark.parametrize("view", VIEWS)
def test_the_legend_is_as_long_as_the_arrows(browser: Browser, view: str) -> None:
    force = Arrow("a", "actuator", "car.force", on="body", at=(0.0, 0.0, 0.3))
    browser.see(scene(arrows=[force]), STILL | {"car.force": 6000.0}, view)
    legend = browser.run("view.legend()")
    (arrow,) = browser.run("view.arrowsNow()")
    x0, y0 = screen(browser, arrow["from"])
    x1, y1 = screen(browser, [c + f / 1e4 for c, f in zip(arrow["from"], arrow["force"], strict=True)])
    assert x1 == pytest.approx(x0)
    assert (y0 - y1) / 6000.0 == pytest.approx(legend["pixels"] / legend["newtons"])
    tips = [
        p
        for note in browser.run("notes")
        if note["style"] == COLORS["actuator-force"].split()[0] and note["what"] == "fill"
        for p in note["path"][:1]
    ]
    assert [0, y1] in [[0, pytest.approx(p[2])] for p in tips]  # drawn to there
    assert f"{legend['newtons'] / 1e3:g} kN" in browser.run("texts")


def test_the_legend_has_a_backing(browser: Browser) -> None:
    """Behind all its words, in however many rows; drawn before them and after the picture."""
    force = Arrow("a", "actuator", "car.force", on="body", at=(0.0, 0.0, 0.3))
    points = [Points(r, r, 1.0, -0.8, 1.0, [0.1, 0.2]) for r in ("preview", "sensed", "predicted")]  # type: ignore[arg-type]
    for width, rows in ((800, 1), (300, 3)):
        browser.engine.eval(f"canvas.clientWidth = {width}")
        browser.see(scene(arrows=[force], points=points), STILL | {"car.force": 6000.0})
        notes = browser.run("notes")
        halo = COLORS["halo"].split()[0]
        (at,) = (i for i, n in enumerate(notes) if n["what"] == "rect" and n["style"] == halo)
        x, y, wide, high = notes[at]["path"]
        lines = [n["path"] for n in notes[at + 1 :] if n["what"] == "stroke"]  # of the scale and of each entry
        assert len({p[0][2] for p in lines[1:]}) == rows
        assert len(lines) == 5
        for _, left, top in (p for path in lines for p in path):
            assert x < left < x + wide
            assert y < top < y + high
        words = max(left + 26 + 6.5 * len(t) for (left, t) in _legend_words(browser, lines))
        assert words <= min(x + wide, width) + 0.5
    browser.engine.eval("canvas.clientWidth = 800")


def _legend_words(browser: Browser, lines: list[Any]) -> list[tuple[float, str]]:
    return [(p[0][1], e["words"]) for p, e in zip(lines[1:], browser.run("view.legend().entries"), strict=True)]


def test_an_arrow_that_is_cut_says_so(browser: Browser) -> None:
    force = Arrow("a", "actuator", "car.force", on="body")
    browser.see(scene(arrows=[force]), STILL | {"car.force": 1e6})
    assert "1000 kN, cut" in browser.run("texts")
    browser.see(scene(arrows=[force]), STILL | {"car.force": 6e3})
    assert not any("cut" in text for text in browser.run("texts"))


def test_arrows_start_where_they_act(browser: Browser) -> None:
    arrows = [
        Arrow("ground", "ground", 1e4, on="w", at=(0.0, 0.0, Value({"car.tire": -1.0}, -0.45))),
        Arrow("body", "body", 1e4, on="body", at=(2.0, 0.0, 0.0)),
        Arrow("anywhere", "ground", 1e4, at=("car.x", 0.5, 0.1)),
    ]
    browser.see(scene(arrows=arrows), STILL | {"car.x": 3.0, "car.pitch": 0.1})
    starts = [a["from"] for a in browser.run("view.arrowsNow()")]
    assert starts[0] == pytest.approx([3.0, -0.8, 0.0])
    assert starts[1] == pytest.approx([3.0 + 2 * math.cos(0.1), 0.0, 1.0 - 2 * math.sin(0.1)])
    assert starts[2] == pytest.approx([3.0, 0.5, 0.1])


def test_previews_stand_ahead_at_the_way_of_their_time(browser: Browser) -> None:
    ahead = Points("p", "preview", Value({"car.x": 1.0}, 1.5), -0.8, Value({"car.v": 0.05}), ["car.h1", "car.h2", 0.3])
    browser.see(scene(points=[ahead]), STILL | {"car.v": 20.0, "car.h1": 0.1, "car.h2": 0.2})
    color = COLORS["preview"].split()[0]
    (line,) = (n for n in browser.run("notes") if n["style"] == color and n["what"] == "stroke" and len(n["path"]) == 3)
    expected = [screen(browser, [1.5 + k, -0.8, h]) for k, h in enumerate((0.1, 0.2, 0.3))]
    assert [p[1:] for p in line["path"]] == [pytest.approx(list(p)) for p in expected]


def test_predictions_are_exaggerated_about_their_own_level(browser: Browser) -> None:
    expected = Points("p", "predicted", 0.0, -0.8, 1.0, [Value({"car.h": 1.0}, 1.2), Value({"car.h": 2.0}, 1.2)])
    browser.see(scene(points=[expected]), STILL | {"car.h": 0.1})
    browser.engine.eval("view.exaggeration = 3")
    browser.draw(0.1)
    color = COLORS["predicted"].split()[0]
    line, _legend = (
        n for n in browser.run("notes") if n["style"] == color and n["what"] == "stroke" and n["width"] == 2
    )
    assert [p[1:] for p in line["path"]] == [
        pytest.approx(list(screen(browser, [k, -0.8, h]))) for k, h in enumerate((1.5, 1.8))
    ]


def test_springs_are_as_long_as_struts(browser: Browser) -> None:
    strut = Strut("body", (0.0, -0.5, 0.4), "w", (0.0, 0.3, 0.0))
    color = COLORS["spring"].split()[0]
    lengths = []
    for z in (0.0, 0.2):
        browser.see(scene(struts=[strut]), STILL | {"car.z": z})
        ys = [p[2] for n in browser.run("notes") if n["style"] == color for p in n["path"]]
        lengths.append((max(ys) - min(ys)) / browser.run("view.scale"))
    assert lengths[1] - lengths[0] == pytest.approx(0.88 * 0.2, abs=0.02)  # coils fill 88 % of it


def test_limits_light_up_above_zero(browser: Browser) -> None:
    limit = Limit("wheel in the air", Value({"car.force": -1.0}, 5.0), at="w")
    browser.see(scene(limits=[limit]), STILL | {"car.force": 6.0})
    assert browser.run("view.active()") == []
    assert "wheel in the air" not in browser.run("texts")
    browser.values(STILL | {"car.force": 4.0})
    browser.draw(0.1)
    assert browser.run("view.active()") == ["wheel in the air"]
    assert "wheel in the air" in browser.run("texts")


def test_values_that_are_not_numbers_do_not_stop_the_picture(browser: Browser) -> None:
    browser.see(scene(), {"car.x": 2.0})  # all others are undefined
    assert browser.run("view.poses[0].slice(8)") == [0, 0, 1, 1]


# ------------------------------------------------------------------------------------------------------- words, colours


def test_the_sentence_about_what_is_seen(browser: Browser) -> None:
    parts: dict[str, object] = {
        "what": "off-road vehicle",
        "readings": [
            Reading("speed", "km/h", "car.x", 1, 3.6),
            Reading("pitch, nose down", "deg", "car.pitch", 2, 57.2957795),
        ],
        "arrows": [Arrow(n, "actuator", Value({"car.force": f}), on="body") for n, f in (("a", 1.0), ("b", -2.0))],
        "limits": [Limit("bump stop", "car.z")],
    }
    values = STILL | {"car.x": 10.0, "car.pitch": -0.0000001, "car.force": 1550.0, "car.z": 0.1}
    browser.see(scene(**parts), values)
    assert (
        browser.run("view.describe()")
        == "Off-road vehicle from the side: speed 36.0 km/h; pitch, nose down 0.00 deg; actuator force up to -3.1 kN;"
        " bump stop."
    )
    browser.see(scene(**parts), values | {"car.force": 0.0, "car.z": 0.0}, "rear")
    assert browser.run("view.describe()").endswith(
        "from behind: speed 36.0 km/h; pitch, nose down 0.00 deg; no actuator force."
    )
    assert browser.run("view.readings()")[0] == {"label": "speed", "unit": "km/h", "text": "36.0"}


@pytest.mark.parametrize(
    ("newtons", "text"), [(0.25, "0.3 N"), (12.4, "12 N"), (-999.0, "-999 N"), (1550.0, "1.6 kN"), (2.5e5, "250 kN")]
)
def test_forces_in_words(browser: Browser, newtons: float, text: str) -> None:
    assert browser.run(f"SceneView.force({newtons})") == text


def test_every_colour_has_a_light_and_a_dark_one(browser: Browser) -> None:
    assert set(browser.run("SceneView.COLORS")) == COLORS.keys()
    browser.see(scene(), STILL)
    assert browser.run("view.color.body") == COLORS["body"].split()[0]
    browser.engine.eval("scheme = 'dark'; view.restyle()")
    assert browser.run("view.color.body") == COLORS["body"].split()[1]
    browser.engine.eval("scheme = 'light'")


@pytest.mark.parametrize(
    "name", ["ink", "muted", "ground-force", "actuator-force", "body-force", "preview", "sensed", "predicted", "limit"]
)
def test_words_and_lines_stand_out(name: str) -> None:
    """Contrast of WCAG 2.2: 4.5 for words, 3 for lines that mean something; words on a limit's label, too."""
    for own, sky, halo in zip(*(COLORS[n].split() for n in (name, "sky", "halo")), strict=True):
        least = 4.5 if name in ("ink", "muted") else 3.0
        assert _contrast(own, sky) >= least
        if name == "limit":
            assert _contrast(own, halo) >= 4.5


def _contrast(first: str, second: str) -> float:
    def luminance(color: str) -> float:
        parts = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    high, low = sorted((luminance(first), luminance(second)), reverse=True)
    return (high + 0.05) / (low + 0.05)


# ------------------------------------------------------------------------------------------------ views and the pointer


def test_a_view_that_is_turned_is_free(browser: Browser) -> None:
    browser.see(scene(), STILL)
    side = browser.run("[view.camera.azimuth, view.camera.elevation]")
    assert "from the side" in browser.run("view.describe()")
    browser.engine.eval("view.orbit(50, 2000)")
    azimuth, elevation = browser.run("[view.camera.azimuth, view.camera.elevation]")
    assert azimuth == pytest.approx(side[0] - 0.4)
    assert elevation == pytest.approx(1.2)  # never from below
    assert browser.run("view.view") == "three-quarter"
    assert "from a view of your own" in browser.run("view.describe()")
    browser.engine.eval("view.view = 'three-quarter'")
    assert "from ahead and the right" in browser.run("view.describe()")
    browser.engine.eval("view.zoom(1e9)")
    assert browser.run("view.camera.zoom") == 6


def test_an_unknown_view_is_refused(browser: Browser) -> None:
    browser.see(scene(), STILL)
    message = browser.run("(() => { try { view.view = 'top'; } catch (e) { return e.message; } })()")
    assert message == "no view 'top'; there are side, three-quarter, rear"


def test_views_of_variants_share_a_camera(browser: Browser) -> None:
    browser.see(scene(), STILL, "three-quarter")
    browser.engine.eval(
        "var other = new SceneView(canvas, view.data, {value: (n) => values[n], reducedMotion: true, camera:"
        " view.camera}); view.orbit(30, 0)"
    )
    assert browser.run("other.camera.azimuth === view.camera.azimuth && other.view === 'three-quarter'")


def test_no_path_cuts_holes_into_itself(browser: Browser) -> None:
    """Polygons of one path turn one way: where two of opposite ways lie over each other, nothing would be filled."""
    faces = shapes.off_road([Axle(1.98, 0.91, 0.47, 0.32), Axle(-1.32, 0.91, 0.47, 0.32)], 0.85)
    for view in VIEWS:
        browser.see(scene(bodies=[Body("body", faces, z=0.85)]), STILL, view)
        several = 0
        for note in browser.run("notes"):
            if note["what"] != "fill":
                continue
            areas = [_area(p) for p in _polygons(note["path"])]
            turning = {area > 0 for area in areas if abs(area) > 0.5}  # px2; slivers are drawn by their edges
            assert len(turning) <= 1
            several += len(areas) > 1
        assert several > 10


ROUGH = (
    "(side, x) => 0.04 * Math.sin(3 * x) + (side === 'left' ? 0.03 : -0.02) * Math.cos(7 * x + 1) + (x > 1 ? 0.15 : 0)"
)


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("turned", [0.0, 400.0])
def test_the_road_has_no_holes(browser: Browser, view: str, turned: float) -> None:
    """Every piece of the road that is seen from above lies in a path that is filled as road.

    However rough it is and from wherever one looks.
    """
    grounds = [Ground(side, y, "road", "x", side, 0.0) for side, y in (("left", 0.8), ("right", -0.8))]
    rough = scene(reliefs=[], grounds=grounds, wheels=[WHEEL])
    for exaggeration in (1, 8):
        browser.see(rough, STILL, view, road=ROUGH)
        browser.engine.eval(f"view.exaggeration = {exaggeration}; view.camera.azimuth += 0.008 * {turned}")
        browser.draw(0.1)
        shades = set(
            browser.run("Array.from({length: 60}, (_, level) => view.shade('road', level / SceneView.LEVELS))")
        )
        fills = [
            np.array([p[1:] for p in n["path"]])
            for n in browser.run("notes")
            if n["what"] == "fill" and n["style"] in shades
        ]
        road = np.array(browser.run("view.road"))
        width, track, size = browser.run("[view.halfWidth, view.trackHalf, [view.width, view.height]]")
        lines = [(width, 1), (track, 1), (-track, 2), (-width, 2)]
        screen = np.array(
            browser.run(f"{json.dumps(lines)}.map(([y, c]) => view.road.map((p) => view.screen([p[0], y, p[c]])))")
        )
        seen = 0
        for one, other in ((0, 1), (1, 2), (2, 3)):
            for i in range(len(road) - 1):
                points = np.array([screen[one, i], screen[one, i + 1], screen[other, i + 1], screen[other, i]])
                edges = np.roll(points, -1, 0) - points
                turns = np.sign(edges[:, 0] * np.roll(edges[:, 1], -1) - edges[:, 1] * np.roll(edges[:, 0], -1))
                folded = abs(turns.sum()) < 4  # then the mean of its corners may lie beside it
                x, y = points.mean(axis=0)
                if (
                    folded
                    or abs(_area([tuple(p) for p in points.tolist()])) < 0.5
                    or not (0 < x < size[0] and 0 < y < size[1])
                ):
                    continue
                seen += 1
                assert any(_winding(fill, x, y) for fill in fills if fill[:, 0].min() < x < fill[:, 0].max()), (
                    road[i],
                    one,
                    exaggeration,
                )
        assert seen > 30
        assert len(fills) < 0.75 * 3 * len(road)  # what is lit alike is one path


def test_a_level_road_is_one_path(browser: Browser) -> None:
    browser.see(scene(reliefs=[], grounds=[Ground("left", 0.8, "road", "x", "left", 0.0)]), STILL, road="() => 0")
    shades = set(browser.run("Array.from({length: 60}, (_, level) => view.shade('road', level / SceneView.LEVELS))"))
    assert sum(n["what"] == "fill" and n["style"] in shades for n in browser.run("notes")) == 1


def _winding(points: np.ndarray, x: float, y: float) -> int:
    """How often a closed line of points goes round a place: what is not 0 is filled."""
    angles = np.unwrap(np.arctan2(*(np.vstack([points, points[:1]]) - (x, y)).T[::-1]))
    return round((angles[-1] - angles[0]) / (2 * np.pi))


def _polygons(path: list[list[Any]]) -> Iterator[list[tuple[float, float]]]:
    points: list[tuple[float, float]] = []
    for step in path:
        if step[0] == "close":
            yield points
        elif step[0] != "arc":
            points = [(step[1], step[2])] if step[0] == "move" else [*points, (step[1], step[2])]


def _area(points: list[tuple[float, float]]) -> float:
    x, y = np.array(points).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


# ----------------------------------------------------------------------------------------------------------- everything


@pytest.mark.parametrize("name", EVERY)
def test_all_systems_can_be_drawn(built_fmus: BuiltFmus, browser: Browser, name: str) -> None:  # noqa: ARG001
    """From all sides, with whatever values: nothing is drawn at places that are no numbers."""
    with experiment_system(name) as system:
        found = infer_scene(system)
    assert found is not None
    generator = np.random.default_rng(3)
    for view in VIEWS:
        browser.see(found, dict.fromkeys(found.variables, 0.0), view, road="(side, x) => 0.05 * Math.sin(x)")
        for k in range(3):
            browser.values(
                {
                    n: float(v)
                    for n, v in zip(found.variables, generator.normal(0, 0.1, len(found.variables)), strict=True)
                }
            )
            browser.draw(0.1 * k)
        assert browser.run("notes.length") > 50


def test_passed_systems_of_users_too(built_fmus: BuiltFmus, browser: Browser) -> None:  # noqa: ARG001
    with System() as system:
        system.add("car", str(FmuSet(FMUS, 3).path("RideCarSedan")))
        found = infer_scene(system)
    assert found is not None
    browser.see(found, dict.fromkeys(found.variables, 0.0), "three-quarter")
    assert len(browser.run("view.wheels")) == 4


# ------------------------------------------------------------------------------------------------------- open ground

CAR = Body(
    "body", [Face([(2, 1, 0.5), (2, -1, 0.5), (-1, -1, 0.5), (-1, 1, 0.5)])], x="car.x", y="car.y", yaw="car.yaw"
)
DRIVING = {"car.x": 0.0, "car.y": 0.0, "car.yaw": 0.0, "car.a": 0.0, "car.b": 1.0}


def plain(**parts: object) -> Scene:
    """A car where there is no road."""
    there = {"bodies": [CAR], "wheels": [], "reliefs": [], "views": ("chase", "top", "three-quarter")}
    return scene(**there | parts)


def drive(browser: Browser, *places: tuple[float, float, float]) -> None:
    """The car at places (x, y, yaw), each a sample, of which none is drawn."""
    for x, y, yaw in places:
        browser.values(DRIVING | {"car.x": x, "car.y": y, "car.yaw": yaw})
        browser.engine.eval("view.observe()")


def test_cones_fall_where_the_vehicle_touches_their_base(browser: Browser) -> None:
    """Between two pictures, too; a cone that is passed at a distance stands."""
    beside = [Cone(10.0, side * (1.0 + gap), radius=0.15) for side in (1, -1) for gap in (0.14, 0.16)]
    browser.see(plain(cones=[*beside, Cone(30.0, 0.0)]), DRIVING, "top")
    drive(browser, *((0.1 * k, 0.0, 0.0) for k in range(200)))
    assert browser.run("[...view.fallen.keys()]") == [0, 2]
    assert browser.run("view.readings()")[-1] == {"label": "cones hit", "unit": "", "text": "2 of 5"}
    drive(browser, (5.0, 0.0, 0.0), (10.0, 0.0, 0.0))
    assert browser.run("view.fallen.size") == 2  # each once
    browser.engine.eval("view.reset()")
    assert browser.run("view.readings()")[-1]["text"] == "0 of 5"


def test_cones_are_hit_by_the_vehicle_as_it_is_turned(browser: Browser) -> None:
    """Its front is 2 m ahead of its origin, its sides are 1 m beside it."""
    browser.see(plain(cones=[Cone(0.0, 1.9), Cone(0.0, -1.9), Cone(-1.2, 0.0)]), DRIVING, "top")
    drive(browser, (0.0, 0.0, 0.0))
    assert browser.run("[...view.fallen.keys()]") == []
    drive(browser, (0.0, 0.0, math.pi / 2))  # to the left
    assert browser.run("[...view.fallen.keys()]") == [0]
    drive(browser, (0.0, 0.0, math.pi))
    assert browser.run("[...view.fallen.keys()]") == [0, 2]


def test_a_cone_that_was_hit_is_drawn_lying(browser: Browser) -> None:
    for view in ("chase", "top", "three-quarter"):
        browser.see(plain(cones=[Cone(6.0, 0.0)]), DRIVING, view)
        standing = browser.run("notes.map((n) => n.style)")
        drive(browser, (5.0, 0.0, 0.0), (1.0, 0.0, 0.0))
        browser.draw(0.1)
        lying = browser.run("notes.map((n) => n.style)")
        limit, cone = (browser.run(f"view.color['{name}']") for name in ("limit", "cone"))
        assert (cone in standing, limit in standing) == (True, False)
        assert (cone in lying, limit in lying) == (False, True)


def test_what_is_driven_over_leaves_a_track(browser: Browser) -> None:
    wheel = Wheel("w", 0.5, 0.2, x=1.0, y=-0.8, z=0.5, on="body")
    browser.see(plain(wheels=[wheel]), DRIVING, "top")
    drive(browser, *((0.16 * k, 0.0, 0.0) for k in range(20)))  # every other one is far enough from the last
    track = browser.run("view.trail.map((p) => p.wheels[0])")
    assert [x for x, *_ in track] == pytest.approx([1.0 + 0.32 * k for k in range(10)])
    assert all(y == pytest.approx(-0.8) for _, y, _ in track)


def test_a_wheel_on_a_body_moves_and_turns_with_it(browser: Browser) -> None:
    wheel = Wheel("w", 0.5, 0.2, x=1.5, y=0.8, z=0.5, heading=0.1, on="body")
    browser.see(plain(wheels=[wheel]), DRIVING | {"car.x": 10.0, "car.y": 3.0, "car.yaw": math.pi / 2}, "top")
    x, y, heading = (browser.run(f"view.wheels[0].{n}") for n in ("x", "y", "heading"))
    assert (x, y, heading) == pytest.approx((10.0 - 0.8, 3.0 + 1.5, math.pi / 2 + 0.1))


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.5])
def test_the_chase_looks_where_the_vehicle_heads(browser: Browser, yaw: float) -> None:
    at, ahead = np.array([20.0, -7.0]), np.array([math.cos(yaw), math.sin(yaw)])
    browser.see(plain(), DRIVING | {"car.x": 20.0, "car.y": -7.0, "car.yaw": yaw}, "chase")
    x0, y0 = screen(browser, [*at, 0])
    x1, y1 = screen(browser, [*(at + 3 * ahead), 0])
    assert x1 == pytest.approx(x0, abs=1e-9)
    assert y1 < y0
    assert 0 < x0 < 800
    assert 200 < y0 < 400  # more is seen of what lies ahead
    assert "from behind and above" in browser.run("view.describe()")
    browser.engine.eval("view.orbit(0, 0)")
    browser.draw(0.1)  # who turns the picture begins where it was
    turned = [a - b for a, b in zip(screen(browser, [*(at + ahead), 0]), screen(browser, [*at, 0]), strict=True)]
    assert turned[0] == pytest.approx(0, abs=1e-6)
    assert turned[1] < 0


def test_from_above_left_is_up(browser: Browser) -> None:
    browser.see(plain(), DRIVING | {"car.x": 20.0, "car.y": -7.0, "car.yaw": 1.0}, "top")
    x0, y0 = screen(browser, [20, -7, 0])
    x1, y1 = screen(browser, [23, -7, 0])
    assert (x1 > x0, y1) == (True, pytest.approx(y0))
    assert screen(browser, [20, -4, 0])[1] < y0
    assert "from above" in browser.run("view.describe()")


def test_readings_that_are_divided_or_the_largest_so_far(browser: Browser) -> None:
    readings = [
        Reading("ratio", "", "car.a", 2, 10.0, per=Value({"car.b": 2.0}, 1.0)),
        Reading("largest", "", "car.a", 1, largest=True),
        Reading("of nothing", "", 1.0, per="car.yaw"),
    ]
    browser.see(plain(readings=readings), DRIVING, "top")
    for a in (0.5, -4.0, 3.0):
        browser.values(DRIVING | {"car.a": a})
        browser.engine.eval("view.observe()")
    assert [r["text"] for r in browser.run("view.readings()")] == ["10.00", "4.0", "0.0"]
