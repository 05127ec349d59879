"""Designs of sweeps: how parameters are written, what points methods give, what is refused."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from cosim.study.design import METHODS, Axis, Design, DesignError, axis, from_file
from cosim.study.sweep_command import _design

ONE, TWO = axis("a=10:20"), axis("b=0:1")


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("x=1:3", [1.0, 1.5, 2.0, 3.0]),
        ("x=a,b", ["a", "a", "b", "b"]),
        ("x=1,2.5", [1, 1, 2.5, 2.5]),
        ("x=true,false", [True, True, False, False]),
        ("x=uniform(0,4)", [0.0, 1.0, 2.0, 4.0]),
        ("x=triangular(0,1,2)", [0.0, 0.7071067811865476, 1.0, 2.0]),
        ("x=truncnormal(0,1,-1,1)", [-1.0, stats.truncnorm(-1, 1).ppf(0.25), 0.0, 1.0]),
    ],
)
def test_values_at_quantiles(text: str, values: list[object]) -> None:
    found = axis(text).at(np.array([0.0, 0.25, 0.5, 1.0]))
    assert found == [pytest.approx(v, abs=1e-12) if isinstance(v, float) else v for v in values]


@pytest.mark.parametrize(
    ("text", "law"),
    [
        ("x=normal(5,2)", stats.norm(5, 2)),
        ("x=lognormal(5,0.2)", stats.lognorm(0.2, scale=5)),
        ("x=triangular(1,2,5)", stats.triang(0.25, loc=1, scale=4)),
        ("x=truncnormal(5,2,4,9)", stats.truncnorm(-0.5, 2, loc=5, scale=2)),
    ],
)
def test_distributions(text: str, law) -> None:
    u = np.linspace(0.001, 0.999, 999)
    np.testing.assert_allclose(axis(text).at(u), law.ppf(u), rtol=1e-9)


def test_seeds_from_one_to_many(raises) -> None:
    """`1..N` is every whole number from 1 to N: once each in a grid, and in a Latin hypercube of N samples."""
    seeds = axis("road.seed=1..200")
    assert seeds.grid() == list(range(1, 201))
    (found,) = Design((seeds,), samples=200).columns()
    assert sorted(found) == list(range(1, 201))
    assert Design((seeds, axis("x=0:1:3")), "grid").runs == 600
    assert axis("n=-2..2").grid() == [-2, -1, 0, 1, 2]
    assert axis("n=3..3").grid() == [3]
    with raises(DesignError):
        axis("n=5..2")


def test_whole_numbers() -> None:
    """Each is as likely as the others, both ends included."""
    found = Axis("n", "uniform", (1, 3), whole=True).at(np.linspace(0, 1, 3001))
    assert np.abs(np.bincount(found)[1:] - 1000).max() <= 1
    assert Axis("n", "uniform", (1, 4), whole=True, count=9).grid() == [1, 2, 3, 4]
    assert all(isinstance(n, int) for n in Axis("n", "normal", (5, 2), whole=True).at(np.array([0.1, 0.5])))


@pytest.mark.parametrize("method", ["random", "lhs", "sobol", "halton", "saltelli"])
def test_negative_whole_numbers_are_as_likely_as_others(method: str) -> None:
    found = Design((axis("n=-3..3"), axis("x=0:1")), method, 1024).columns()[0]
    counts = np.bincount(np.array(found) + 3)
    assert len(counts) == 7
    assert np.abs(counts / len(found) - 1 / 7).max() < (0.04 if method == "random" else 0.005)


@pytest.mark.parametrize(("first", "last"), [(-3, 4), (-4, -1), (0, 1)])
def test_levels_of_morris_are_split_evenly_among_whole_numbers(first: int, last: int) -> None:
    levels = np.arange(8) / 7
    found = Axis("n", "uniform", (first, last), whole=True).at(levels)
    assert found == [first + k * (last - first + 1) // 8 for k in range(8)]
    assert Axis("n", "uniform", (-3, 3), whole=True).at(levels) == [-3, -2, -1, 0, 1, 2, 3, 3]


def test_whole_numbers_stay_within_their_limits(raises) -> None:
    u = np.linspace(0, 1, 1001)
    for kind, numbers in (
        ("uniform", (-1.5, 1.5)),
        ("triangular", (-1.4, 0.0, 1.4)),
        ("truncnormal", (0.0, 1.0, -1.4, 1.4)),
    ):
        parameter = Axis("n", kind, numbers, whole=True)
        assert (parameter.ends, set(parameter.at(u))) == ((-1, 1), {-1, 0, 1})
    assert Axis("n", "normal", (0.0, 1.0), whole=True).at(np.array([0.31, 0.5])) == [0, 0]
    assert Design((Axis("n", "uniform", (-1.5, 1.5), whole=True, count=9),), "grid").runs == 3
    with raises(DesignError):
        Axis("n", "uniform", (0.2, 0.8), whole=True)


@pytest.mark.parametrize(
    "text",
    [
        "x",
        "x=",
        "x=2:1",
        "x=1:1",
        "x=1:b",
        "x=1:2:3:4",
        "x=1:2:1",
        "x=nan:1",
        "x=normal(1)",
        "x=normal(1,0)",
        "x=lognormal(-1,1)",
        "x=triangular(0,5,1)",
        "x=truncnormal(0,1,3,2)",
        "x=nomal(1,2)",
    ],
)
def test_what_is_refused(text: str, raises) -> None:
    with raises(DesignError):
        axis(text)


@pytest.mark.parametrize("method", [m for m in METHODS if m != "grid"])
def test_points_fill_the_ranges_and_are_the_same_every_time(method: str) -> None:
    design = Design((ONE, TWO), method, 64, 3)
    first, second = design.columns()
    assert len(first) == len(second) == design.runs
    assert all(10 <= x <= 20 for x in first)
    assert all(0 <= x <= 1 for x in second)
    assert abs(np.mean(first) - 15) < 1
    assert Design((ONE, TWO), method, 64, 3).columns() == [first, second]
    assert Design((ONE, TWO), method, 64, 4).columns() != [first, second]


def test_one_point_in_each_of_many_slices() -> None:
    found, _ = Design((ONE, TWO), "lhs", 50).columns()
    assert sorted(int((x - 10) * 5) for x in found) == list(range(50))


def test_ends_of_normal_laws_are_finite() -> None:
    """Sequences have points at the ends of the unit cube, or nearer to them than numbers tell."""
    found = axis("a=normal(5,1)").at(np.array([0.0, 0.5, 1.0]))
    assert found == pytest.approx([5 - 7.94, 5.0, 5 + 7.94], abs=0.01)


@pytest.mark.parametrize(
    ("text", "told"),
    [("a=10:20", "10 to 20"), ("a=3..7", "3 to 7"), ("a=x,y", "x, y"), ("a=normal(5,0.5)", "normal(5, 0.5)")],
)
def test_what_pages_say_of_a_parameter(text: str, told: str) -> None:
    assert str(axis(text)) == told


def test_a_file_without_a_seed_gives_the_points_of_the_command(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("[vary]\na = '10:20'\n")
    by_command = _design({"design": None, "vary": ["a=10:20"], **dict.fromkeys(("method", "samples", "random_seed"))})
    assert from_file(tmp_path / "a.toml") == by_command


def test_options_of_the_command_count_beside_a_file(tmp_path: Path, raises) -> None:
    file = tmp_path / "a.toml"
    file.write_text("samples = 64\nseed = 3\n[vary]\na = '10:20'\n")
    given = {"design": file, "vary": (), "method": "sobol", "samples": 8, "random_seed": None}
    found = _design(given)
    assert (found.method, found.samples, found.seed) == ("sobol", 8, 3)
    file.write_text("[[cases]]\na = 10\n")
    with raises(DesignError):
        _design(given)


def test_latin_hypercubes_are_those_of_scipy() -> None:
    design = Design((ONE, TWO), "lhs", 77, 5)
    expected = stats.qmc.LatinHypercube(2, seed=np.random.default_rng(5)).random(77)
    assert design.cube().tolist() == expected.tolist()


def test_a_grid_has_all_combinations(raises) -> None:
    design = Design((axis("a=0:1:3"), axis("b=x,y")), "grid")
    assert design.columns() == [[0.0, 0.0, 0.5, 0.5, 1.0, 1.0], ["x", "y"] * 3]
    assert design.runs == 6
    with raises(DesignError):
        Design((axis("a=normal(0,1)"),), "grid").columns()


@pytest.mark.parametrize("method", ["sobol", "saltelli"])
def test_sobol_sequences_come_in_powers_of_two(method: str, raises) -> None:
    with raises(DesignError):
        Design((ONE,), method, 100).columns()


def test_designs_that_cannot_be(raises) -> None:
    for options in (
        {"axes": ()},
        {"axes": (ONE, ONE)},
        {"axes": (ONE,), "method": "lsh"},
        {"axes": (ONE,), "samples": 0},
    ):
        with raises(DesignError):
            Design(**options)  # type: ignore[arg-type]


FILE = """
method = "halton"
samples = 32
seed = 5
[vary]
"car.body.mass" = "4000:6000"
damping = [6e3, 12e3]
[set]
duration = 0.5
"""


def test_design_files(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(FILE)
    found = from_file(tmp_path / "a.toml")
    assert found == Design(
        (axis("car.body.mass=4000:6000"), Axis("damping", "values", values=(6e3, 12e3))),
        "halton",
        32,
        5,
        fixed={"duration": 0.5},
    )
    (tmp_path / "a.py").write_text("DESIGN = {'cases': [{'x': i, 'y': i**2} for i in range(3)], 'set': {'z': 1}}\n")
    found = from_file(tmp_path / "a.py")
    assert found.columns() == [[0, 1, 2], [0, 1, 4]]
    assert (found.method, found.runs, found.fixed) == ("list", 3, {"z": 1})


@pytest.mark.parametrize(
    "text",
    [
        "metod = 1",
        "samples = 'many'",
        "samples = true",
        "seed = 'one'",
        "[vary]",
        "[vary]\nx = 3",
        "[vary]\nx = '2:1'",
        "[vary]\nx = []",
        "seed = 1\n[[cases]]\nx = 1",
        "[[cases]]\nx = 1\n[[cases]]\ny = 1",
        "cases = []",
        "x = [",
    ],
)
def test_design_files_that_are_refused(text: str, tmp_path: Path, raises) -> None:
    (tmp_path / "a.toml").write_text(text)
    with raises(DesignError) as refused:
        from_file(tmp_path / "a.toml")
    assert str(refused.value).startswith(str(tmp_path / "a.toml"))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("no.toml", None),
        ("junk.toml", b"\xff\x00"),
        ("junk.py", b"def :"),
        ("raises.py", b"\nopen('nowhere')"),
        ("a.json", None),
        ("b.py", b"X = 1"),
    ],
)
def test_files_that_are_none(name: str, content: bytes | None, tmp_path: Path, raises) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with raises(DesignError):
        from_file(tmp_path / name)


@pytest.mark.skipif(os.name == "nt", reason="a folder is opened like a file")
def test_a_folder_is_no_design(tmp_path: Path, raises) -> None:
    (tmp_path / "folder.toml").mkdir()
    with raises(DesignError):
        from_file(tmp_path / "folder.toml")


@pytest.mark.parametrize(
    ("numbers", "shape"),
    [
        ((100.0, 10.0, 2000.0, 3000.0), "low"),
        ((100.0, 10.0, -3000.0, -2000.0), "high"),
        ((0.0, 1.0, 9.0, 9.5), "low"),
        ((0.0, 1.0, -9.5, -9.0), "high"),
    ],
)
def test_a_normal_distribution_cut_far_from_its_mean(numbers: tuple[float, ...], shape: str) -> None:
    """Its values differ, rise with the quantile, and crowd at the end next to the mean.

    A wide one has the closed form of its tail.
    """
    mean, deviation, low, high = numbers
    u = np.linspace(0.0, 1.0, 201)
    found = np.array(Axis("x", "truncnormal", numbers).at(u))
    assert found[0] == pytest.approx(low)
    assert found[-1] == pytest.approx(high)
    assert (np.diff(found) > 0).all()
    middle = found[100]
    near = low if shape == "low" else high
    expected = (
        math.log(2) / (abs(near - mean) / deviation) * deviation
    )  # the tail of a normal distribution falls as exp(-x z)
    assert abs(middle - near) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("text", ["x=truncnormal(0,1e-200,1,2)", "x=lognormal(1,1e4)", "x=-1.5e308:1.5e308"])
def test_values_that_are_no_numbers_are_refused(text: str, raises) -> None:
    with raises(DesignError), np.errstate(all="ignore"):
        axis(text).at(np.array([0.1, 0.5, 0.9]))


def test_where_both_ways_of_a_cut_distribution_meet() -> None:
    u = np.linspace(0.01, 0.99, 50)
    usual, far = (
        np.array(Axis("x", "truncnormal", (0.0, 1.0, low, low + 1)).at(u)) - low for low in (5.0 - 1e-9, 5.0 + 1e-9)
    )
    assert far == pytest.approx(usual, abs=1e-6)


@pytest.mark.parametrize("text", ["x=0.1:0.2:inf", "x=0.1:0.2:nan", "x=0.1:0.2:2.5"])
def test_ranges_without_a_number_of_values(text: str, raises) -> None:
    with raises(DesignError):
        axis(text)


def test_files_with_mistakes_of_their_own(tmp_path: Path, raises) -> None:
    bad = tmp_path / "bad.py"
    bad.write_text("x = 1\nDESIGN = {'vary': y}\n")
    with raises(DesignError):
        from_file(bad)
    file = tmp_path / "bad.toml"
    file.write_text('seed = -1\n[vary]\nx = "0:1"\n')
    with raises(DesignError):
        from_file(file)
    file.write_text('[set]\nx = 1.0\n[vary]\nx = "0:1"\n')
    with raises(DesignError):
        from_file(file)


def test_what_a_design_is_unless_said_otherwise() -> None:
    """A seed that changes changes every sweep that names none."""
    assert (Design((ONE,)).method, Design((ONE,)).samples, Design((ONE,)).seed) == ("lhs", 100, 1)
