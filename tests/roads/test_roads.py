"""Roads: heights at and between nodes, previews, ends, and what a user's file may look like."""

from functools import partial

import numpy as np
import pytest
from crg_files import crg
from looks import check_preview, look

from build_fmus.reference import simulate
from fmu_sources.roads import (
    HeightTable,
    RoadError,
    RoadLayout,
    WheelPosition,
    perryman3_table,
    road_curb,
    road_from_file,
    road_from_table,
    road_perryman3,
    road_sine,
)
from fmu_sources.roads.opencrg import read_opencrg
from fmu_sources.vehicles import load_full_car

CORNERS = ("fl", "fr", "rl", "rr")
FRONT, REAR = 0.6 * 3.302, -0.4 * 3.302


@pytest.fixture(scope="module")
def layout():
    return RoadLayout.of(load_full_car("hmmwv_modified"))


def one_wheel(count=2, step=0.01):
    """A single wheel below the CG, so that x is the wheel's position."""
    return RoadLayout((WheelPosition("fl", 0.0, 0.9),), count, step)


# ---------------------------------------------------------------------------------------------------- sine and curb


def test_layout_of_the_vehicle(layout, raises):
    assert [w.corner for w in layout.wheels] == list(CORNERS)
    assert [w.x for w in layout.wheels] == pytest.approx([FRONT, FRONT, REAR, REAR])
    assert [w.side for w in layout.wheels] == ["left", "right", "left", "right"]
    with raises(ValueError):
        RoadLayout(layout.wheels, preview_count=1)


def test_sine_is_exact_at_nodes_and_linear_between():
    road = road_sine(one_wheel())
    for node in range(0, 2000, 7):
        x = node * 0.1
        exact = 0.1 * np.sin(2 * np.pi * (x - 30) / 10) if x > 30 else 0.0
        assert look(road, x)["road.fl.height"] == pytest.approx(exact, abs=1e-14)
    a, b = (0.1 * np.sin(2 * np.pi * (x - 30) / 10) for x in (31.3, 31.4))
    y = look(road, 31.34, speed=10.0)
    assert y["road.fl.height"] == pytest.approx(0.6 * a + 0.4 * b, abs=1e-14)
    assert y["road.fl.slope"] == pytest.approx((b - a) / 0.1)
    assert y["road.fl.rate"] == pytest.approx(10 * (b - a) / 0.1)


def test_sine_parameters(layout):
    road = road_sine(layout)
    y = look(road, 14.5 - FRONT, amplitude=0.2, wavelength=2.0, flat=10.0)
    assert y["road.fl.height"] == pytest.approx(0.2 * np.sin(2 * np.pi * 4.5 / 2), abs=1e-14)
    y = look(road, 32.5, wheel__rl__x=0.0)
    assert y["road.rl.height"] == pytest.approx(0.1)


def test_curb_steps_within_one_node():
    road = road_curb(one_wheel())
    heights = {x: look(road, x)["road.fl.height"] for x in (29.9, 30.0, 30.05, 30.1, 35.0, 40.0, 40.05, 40.1)}
    assert list(heights.values()) == pytest.approx([0, 0, 0.05, 0.1, 0.1, 0.1, 0.05, 0], abs=1e-12)
    assert look(road, 30.05)["road.fl.slope"] == pytest.approx(1.0)
    assert look(road, 35.0)["road.fl.slope"] == 0.0
    assert look(road, 17.05, flat=12.0, level=5.0, height=-0.2)["road.fl.height"] == pytest.approx(-0.1)


@pytest.mark.parametrize("maker", [road_sine, road_curb, road_perryman3])
def test_preview_is_what_the_wheels_meet_later(layout, maker):
    check_preview(maker(layout), 33.0, 12.0, range(8), step=0.01, within=1e-12)


@pytest.mark.parametrize("maker", [road_sine, road_curb, road_perryman3])
def test_outside_the_road_and_at_speed_0(layout, maker):
    road = maker(layout)
    for x in (-1e9, -5.0):
        y = look(road, x, speed=20.0)
        assert all(y[f"road.{k}.slope"] == 0.0 for k in CORNERS)
        assert all(abs(y[f"road.{k}.height"]) < 1e-12 for k in CORNERS)
        assert not y["end_of_road"]
    last = look(road, 1e9, speed=20.0)
    assert last["end_of_road"]
    for x in (500.0, 1e300):
        y = look(road, x)
        assert y["end_of_road"]
        assert all(y[f"road.{k}.slope"] == 0.0 for k in CORNERS)
        assert [y[f"preview.{k}[8]"] for k in CORNERS] == [last[f"road.{k}.height"] for k in CORNERS]
    still = look(road, 33.0)
    assert all(still[f"preview.{k}[8]"] == still[f"road.{k}.height"] for k in CORNERS)
    assert all(still[f"road.{k}.rate"] == 0.0 for k in CORNERS)
    assert not still["end_of_road"]


@pytest.mark.parametrize("maker", [road_sine, road_curb, road_perryman3])
def test_roads_have_no_memory(layout, maker):
    road = maker(layout).model()
    assert road.size("state") == 0
    assert np.isfinite(simulate(road).outputs).all()
    assert set(road.dependencies["road.fl.height"]) == {"x"}
    assert set(road.dependencies["preview.fl[1]"]) == {"x"}
    assert set(road.dependencies["preview.fl[8]"]) == {"x", "speed"}


# ------------------------------------------------------------------------------------------------------- Perryman 3


def test_perryman_follows_its_recipe():
    table = perryman3_table()
    assert table.step * (len(table.left) - 1) >= 200
    assert np.all(table.left[:101] == 0)
    assert np.all(table.right[:101] == 0)
    rough = np.array([table.left[200:], table.right[200:]])
    assert np.sqrt(np.mean(rough**2)) == pytest.approx(0.038, rel=1e-4)
    assert np.array_equal(table.left, np.round(table.left, 6))
    # Long waves are common to both tracks, short ones are not.
    smooth = np.array([np.convolve(track, np.ones(50) / 50, "valid") for track in rough])
    residue = rough - np.array([np.convolve(track, np.ones(5) / 5, "same") for track in rough])
    assert np.corrcoef(smooth)[0, 1] > 0.6
    assert abs(np.corrcoef(residue)[0, 1]) < 0.2


def test_perryman_is_the_same_everywhere():
    table = perryman3_table()
    micrometers = np.rint(1e6 * np.concatenate([table.left[1000:1004], table.right[1000:1004]])).astype(int)
    assert micrometers.tolist() == [49729, 46437, 32436, 28396, -28157, -16398, -22380, -31704]


def test_perryman_says_that_it_is_synthetic(layout):
    assert "Synthetic" in road_perryman3(layout).description


# --------------------------------------------------------------------------------------------------------- tables


def test_table_is_exact_at_nodes_and_linear_between():
    rng = np.random.default_rng(0)
    left, right = rng.standard_normal((2, 301))
    road = road_from_table(HeightTable(-3.0, 0.1, left, right), one_wheel(), "RoadTable", description="", source="none")
    for k in range(301):
        assert look(road, -3.0 + k * 0.1)["road.fl.height"] == pytest.approx(left[k], abs=1e-12)
    x = rng.uniform(-3, 27, 50)
    found = [look(road, xi)["road.fl.height"] for xi in x]
    assert found == pytest.approx(np.interp(x, -3 + 0.1 * np.arange(301), left), abs=1e-11)


def write(tmp_path, text, name="road.csv"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


HEADER = "distance [m],left [m],right [m]\n"


def test_csv_road(tmp_path, layout):
    rows = "".join(f"{0.1 * i:.1f},{0.01 * (i % 7)},{-0.02 * (i % 5)}\n" for i in range(200))
    road = road_from_file(write(tmp_path, HEADER + rows), layout, "RoadMine")
    y = look(road, 10.0 - FRONT)
    assert y["road.fl.height"] == pytest.approx(0.01 * (100 % 7))
    assert y["road.fr.height"] == pytest.approx(-0.02 * (100 % 5), abs=1e-12)
    assert look(road, 18.0)["end_of_road"]
    assert not look(road, 17.9)["end_of_road"]


@pytest.mark.parametrize(
    "text",
    [
        "Distance [m];Left [m];Right [m]\n0;0,5;0,5\n1;0,6;0,4\n2;0,7;0,3\n",
        "\ufeffright [mm],x [m],left [mm]\r\n500,0,500\r\n400,1,600\r\n300,2,700\r\n\r\n\n",
        '"distance (m)",left_height [m],right_height [m]\n0,.5,.5\n1,6e-1,4e-1\n2,.7,.3\n',
    ],
)
def test_csv_variants(tmp_path, text):
    road = road_from_file(write(tmp_path, text), one_wheel())
    assert look(road, 1.5)["road.fl.height"] == pytest.approx(0.15)  # road starts at 0
    assert "-0.5 m" in road.notes[0]
    assert "excites frequencies up to 0.5 Hz for each m/s" in road.notes[0]


def test_irregular_points_are_resampled(tmp_path):
    text = HEADER + "0,0,0\n30,0,0\n30.1,0.1,0.1\n40,0.1,0.1\n40.1,0,0\n60,0,0\n"
    road, curb = road_from_file(write(tmp_path, text), one_wheel()), road_curb(one_wheel())
    for x in (12.0, 30.0, 30.05, 30.1, 33.3, 40.03, 55.0):
        assert look(road, x)["road.fl.height"] == pytest.approx(look(curb, x)["road.fl.height"], abs=1e-9)


CSV_MISTAKES = (
    "",
    HEADER + "0,0,0\n",
    HEADER + "0,0,0\n1,,0\n2,0,0\n",
    HEADER + "0,0,0\n1,0\n2,0,0\n",
    HEADER + "0,0,0\n\n2,0,0\n",
    HEADER + "0,0,0\n1,bump,0\n",
    HEADER + "0,0,0\n1,nan,0\n",
    HEADER + "0,0,0\n1,inf,0\n",
    HEADER + "0,0,0\n2,0,0\n1,0,0\n",
    HEADER + "0,0,0\n1,0,0\n1,0.1,0.1\n",
    "distance [m],left [m]\n0,0\n1,0\n",
    "distance [m],lefft [m],right [m]\n0,0,0\n1,0,0\n",
    "distance [s],left [m],right [m]\n0,0,0\n1,0,0\n",
    "0,0,0\n1,0,0\n",
    "distance [m],left,right [m]\n0,0,0\n1,0,0\n",
    "distance,left [m],right [m]\n0,0,0\n1,0,0\n",
    HEADER + "0,0,0\n20,1,1\n40,0,0\n",
    HEADER + "0,0,0\n1.1,0,0\n40,0,0\n",
    "distance [m],left [m],right [m]\n0,0,0\n1,1e308,0\n",
    "distance [m],left [mm],right [m]\n0,0,0\n1e308,0,0\n",
    "distance [m],left [m],right [m]\n0,0,0\n1e309,0,0\n",
    "distance [m],left [m],right [m]\n0,0,0\n1e-300,0,0\n",
)


def test_csv_mistakes_are_named(tmp_path, layout, refused):
    paths = [tmp_path / f"road{i}.csv" for i in range(len(CSV_MISTAKES))]
    for path, text in zip(paths, CSV_MISTAKES, strict=True):
        write(tmp_path, text, path.name)
    refused(RoadError, *(partial(road_from_file, path, layout) for path in paths))


def test_files_that_cannot_be_read(tmp_path, layout, raises, refused):
    refused(
        RoadError,
        lambda: road_from_file(tmp_path / "nowhere.csv", layout),
        lambda: road_from_file(tmp_path / "nowhere.crg", layout),
    )
    for suffix in (".csv", ".crg"):
        with raises(RoadError):
            road_from_file(tmp_path / ("a" * 300 + suffix), layout)
    binary = tmp_path / "road.csv"
    binary.write_bytes(b"\x80\x81\xff")
    with raises(RoadError):
        road_from_file(binary, layout)


# -------------------------------------------------------------------------------------------------------- OpenCRG


@pytest.mark.parametrize("form", ["LRFI", "LDFI", "KRBI", "KDBI"])
def test_opencrg_samples_the_wheel_tracks(tmp_path, layout, form):
    """Heights z = 0.02 u + 0.1 v on eleven long sections: a cross-section takes two or three lines."""
    sections = [f"long section at v = {v:.2f},m" for v in np.linspace(-1.25, 1.25, 11)]
    rows = [[0.0, *(0.02 * 0.5 * i + 0.1 * v for v in np.linspace(-1.25, 1.25, 11))] for i in range(41)]
    text = crg(rows, sections, form=form, channels=("reference line phi,rad",))
    road = road_from_file(write(tmp_path, text, "plane.crg"), layout)
    y = look(road, 10.0)
    for k, x, side in (("fl", FRONT, 1), ("fr", FRONT, -1), ("rl", REAR, 1), ("rr", REAR, -1)):
        assert y[f"road.{k}.height"] == pytest.approx(0.02 * (10 + x) + side * 0.091, abs=1e-6)
        assert y[f"road.{k}.slope"] == pytest.approx(0.02, abs=1e-5)


SEVEN = [f"long section at v = {v:.2f},m" for v in np.linspace(-1.5, 1.5, 7)]


def random_grid():
    """Heights (21, 7), multiples of 2^-10 m: every format holds them to the last bit."""
    return np.random.default_rng(3).integers(-64, 65, (21, 7)) / 1024


@pytest.mark.parametrize("form", ["LDFI", "KRBI", "KDBI"])
def test_opencrg_heights_are_those_of_the_grid(tmp_path, form):
    """Between long sections heights are linear, in every format the same to rounding; ASCII has six decimals here."""
    grid = random_grid()
    path = write(tmp_path, crg(grid, SEVEN, form=form), "grid.crg")
    distance, left, right = read_opencrg(path, left=0.7, right=-1.5)
    exact = 1e-6 if form == "LDFI" else 1e-15
    np.testing.assert_array_equal(distance, 0.5 * np.arange(21))
    np.testing.assert_allclose(left, 0.6 * grid[:, 4] + 0.4 * grid[:, 5], rtol=0, atol=exact)
    np.testing.assert_allclose(right, grid[:, 0], rtol=0, atol=exact)


def test_opencrg_reference_line_channels(tmp_path):
    """Slope belongs to the piece before a cross-section, the first value is not used; banking rises to the left.

    Heading and curvature move the road on the map, not its heights over the distance along it.
    """
    grid, slope = random_grid(), np.linspace(0, 0.1, 21)
    banking, heading = np.linspace(-0.02, 0.05, 21), np.linspace(0, 0.4, 21)
    rows = [[None if i == 0 else heading[i], None if i == 0 else slope[i], banking[i], *grid[i]] for i in range(21)]
    channels = ("reference line phi,rad", "reference line slope,m/m", "reference line banking,m/m")
    path = write(tmp_path, crg(rows, SEVEN, form="KDBI", channels=channels), "curved.crg")
    _, left, right = read_opencrg(path, left=1.0, right=-0.5)
    line = np.concatenate([[0.0], np.cumsum(0.5 * slope[1:])])
    np.testing.assert_allclose(left, grid[:, 5] + line + banking, rtol=0, atol=1e-14)
    np.testing.assert_allclose(right, grid[:, 2] + line - 0.5 * banking, rtol=0, atol=1e-14)


def test_opencrg_modifiers(tmp_path):
    """Scales of grid, slope, banking, length and width; the offset of the whole line; what fills missing heights."""
    grid, slope, banking = random_grid(), np.linspace(0, 0.1, 21), np.linspace(-0.02, 0.05, 21)
    rows = [[slope[i], banking[i], *grid[i]] for i in range(21)]
    rows[4][2] = None  # at v = -1.5, times 2
    mods = "SCALE_Z_GRID = 3\nSCALE_SLOPE = 2\nSCALE_BANKING = 0.5\nSCALE_LENGTH = 4\nSCALE_WIDTH = 2\n"
    mods += "REFLINE_OFFSET_Z = 7\nREFLINE_OFFSET_PHI = 0.3\nGRID_NAN_MODE = 2\nGRID_NAN_OFFSET = -0.25\n"
    channels = ("reference line slope,m/m", "reference line banking,m/m")
    text = crg(rows, SEVEN, form="KDBI", channels=channels, more=f"$ROAD_CRG_MODS\n{mods}$\n")
    distance, left, right = read_opencrg(write(tmp_path, text, "changed.crg"), left=2.0, right=-3.0)
    line = 4 * 2 * np.concatenate([[0.0], np.cumsum(0.5 * slope[1:])]) + 7
    outer = 3 * grid[:, 0]
    outer[4] = 3 * grid[4, 1] - 0.25  # the last height there is, and the offset
    np.testing.assert_allclose(distance, 2.0 * np.arange(21), rtol=0, atol=1e-13)
    np.testing.assert_allclose(left, 3 * grid[:, 5] + line + 0.5 * banking * 2.0, rtol=0, atol=1e-13)
    np.testing.assert_allclose(right, outer + line - 0.5 * banking * 3.0, rtol=0, atol=1e-13)


def test_opencrg_modifiers_in_a_file_of_their_own(tmp_path):
    grid = random_grid()
    write(tmp_path, crg(grid, SEVEN, form="KRBI"), "grid.crg")
    text = "$ROAD_CRG_MODS\nSCALE_Z_GRID = 2\n$\n$ROAD_CRG_FILE\ngrid\n.crg ! in pieces\n$\n" + "$" * 80 + "\n"
    _, left, _ = read_opencrg(write(tmp_path, text, "twice.crg"), left=1.5, right=-1.5)
    np.testing.assert_array_equal(left, 2 * grid[:, 6])


def test_opencrg_slope_banking_and_numbered_sections(tmp_path, layout):
    head = "LONG_SECTION_V_RIGHT = -2.0\nLONG_SECTION_V_LEFT = 2.0\n"
    head += "REFERENCE_LINE_START_S = 0.05\nREFERENCE_LINE_START_B = 0.1\n"
    rows = [[0.0, 0.0, 0.0] for _ in range(41)]
    text = crg(rows, ["long section 1,m", "long section 2,m", "long section 3,m"], head=head)
    y = look(road_from_file(write(tmp_path, text, "sloped.crg"), layout), 10.0)
    assert y["road.fl.height"] == pytest.approx(0.05 * (10 + FRONT) + 0.091)
    assert y["road.rr.height"] == pytest.approx(0.05 * (10 + REAR) - 0.091)


TWO = ["long section at v = -1.0,m", "long section at v = 1.0,m"]
THREE = [TWO[0], "long section at v = 0.0,m", TWO[1]]
NUMBERED = ["long section 1,m", "long section 2,m"]
SIDES = "LONG_SECTION_V_RIGHT = {}\nLONG_SECTION_V_LEFT = {}\nLONG_SECTION_V_INCREMENT = {}\n"


OPENCRG_MISTAKES = (
    "hello\n",
    crg([[0, 0]] * 3, TWO).replace("LRFI", "KRBI"),
    crg([[0, 0]] * 3, TWO).replace("LRFI", "XRBI"),
    crg([[0, 0]] * 90, TWO, form="KRBI", head="REFERENCE_LINE_END_U = 44.5\n")[:-80],
    crg([[0, 0]] * 90, TWO, form="KRBI", head="REFERENCE_LINE_END_U = 2.0\n"),
    crg([[0, 0]] * 30, TWO, form="KDBI", head="REFERENCE_LINE_END_U = 1e7\n"),
    crg([[0, 0, 0]] * 30, THREE, form="KRBI")[:-80],
    crg([[0, 0]] * 30, TWO, form="KRBI")[:-3],
    crg([[0, 0]] * 9 + [[0, None]] + [[0, 0]] * 9, TWO, form="KRBI"),
    crg([[0, 0]] * 9 + [[0, np.inf]] + [[0, 0]] * 9, TWO, form="KDBI"),
    crg([[None, None]] * 3, TWO, form="KDBI"),
    crg([[0, 0]] * 3, [TWO[1], TWO[1]]),
    crg([[0, 0]] * 3, TWO, more="$ROAD_CRG_MODS\nSCALE_LENGTH = -1\n$\n"),
    crg([[0, 0]] * 3, TWO, more="$ROAD_CRG_MODS\nSCALE_Z_GRID = big\n$\n"),
    crg([[0, 0], [0, None], [0, 0]], TWO),
    crg([[0, 0]] * 3, TWO[:1]),
    crg([[0, 0]], TWO),
    crg([[0, 0]] * 3, TWO, increment=-1),
    crg([[0, 0]] * 3, ["long section at v = -0.3,m", "long section at v = 0.3,m"]),
    crg([[0, 0]] * 3, ["long section 1,m", "long section 2,m"]),
    crg([[0, 0]] * 3, NUMBERED, head=SIDES.format(2, -2, 4)),
    crg([[0, 0]] * 3, NUMBERED, head=SIDES.format(-2, 2, -4)),
    crg([[0, 0]] * 3, NUMBERED, head=SIDES.format(-2, 2, 3)),
    crg([[0, 0]] * 3, TWO, head="LONG_SECTION_V_RIGHT = -3\n"),
    crg([[0, 0]] * 3, TWO).replace("  0.000000", "  0.0zz000", 1),
    crg([[0.0] * 9] * 3, [f"long section at v = {v},m" for v in range(-4, 5)]).rsplit("\n", 2)[0],
    "$ROAD_CRG_FILE\nother.crg\n$\n$$$$\n",
    crg([[0, 0]] * 3, TWO, increment="1.e"),
    crg([[0, 0]] * 3, TWO, increment="1e999"),
    crg([[0, 0]] * 3, TWO, increment="half a meter"),
    crg([[0, 0]] * 3, TWO, increment=1e-300),
    crg([[0, 0]] * 3, TWO, head="REFERENCE_LINE_START_S = 1e308\n"),
    crg([[0, 0]] * 3, TWO, head="REFERENCE_LINE_START_U = --1\n"),
    crg([[0, 0]] * 3, ["long section at v = 1.e,m", TWO[1]]),
    crg([[0, 0]] * 3, TWO).replace("  0.000000", "   1.7E308", 1),
    crg([[0, 0]] * 3, TWO).replace("  0.000000", "      -1.e", 1),
    crg([[9e6, 9e6]] * 3, TWO, form="LDFI", head="REFERENCE_LINE_START_B = 9e6\n"),
)


def test_opencrg_mistakes_are_named(tmp_path, layout, refused):
    paths = [tmp_path / f"road{i}.crg" for i in range(len(OPENCRG_MISTAKES))]
    for path, text in zip(paths, OPENCRG_MISTAKES, strict=True):
        write(tmp_path, text, path.name)
    refused(RoadError, *(partial(road_from_file, path, layout) for path in paths))
