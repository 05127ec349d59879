"""Cases: what their fields carry becomes options, checks, keys and labels."""

from __future__ import annotations

import dataclasses
import re
from dataclasses import dataclass
from typing import Any

import pytest

from cosim.study import Case, CaseError, check_choice, fields, grid, option
from cosim.study.case import case_of, differing, file_name, values


@dataclass(frozen=True, kw_only=True)
class Base(Case):
    parts: int = option(1, within=(1, 4), help="parts of a step", label="in-{}")


@dataclass(frozen=True)
class Ride(Base):
    road: str = option("sine", choices=("sine", "curb"), files=".fmu", help="road", always=True)
    speed_kmh: float = option(
        50.0, unit="km/h", within=(2, 200), name="speed", help="speed", label="{:g}kmh", always=True
    )
    law: str = option("preview", choices=("passive", "preview"), help="law")
    hold: bool = option(False, help="hold", only=(lambda c: c.law == "preview", "the law preview"))
    mass: float | None = option(None, unit="kg", within=(1, 1e4), help="mass")
    free: int = 3


@pytest.mark.parametrize(
    "given",
    [
        {"road": "sien"},
        {"road": 3},
        {"speed_kmh": 1.0},
        {"speed_kmh": 201},
        {"speed_kmh": 200.0000001},
        {"speed_kmh": float("nan")},
        {"speed_kmh": "fast"},
        {"speed_kmh": True},
        {"speed_kmh": None},
        {"law": "passive", "hold": True},
        {"hold": 1},
        {"mass": 0.0},
        {"parts": 2.5},
        {"parts": 5},
    ],
)
def test_what_cannot_be_run_cannot_be_made(given, raises) -> None:
    with raises(CaseError):
        Ride(**given)


def test_bounds_and_files_are_accepted() -> None:
    for given in ({"speed_kmh": 2}, {"speed_kmh": 200}, {"road": "my/road.fmu"}, {"mass": None}, {"mass": 1}):
        Ride(**given)


def test_fields_in_the_order_of_arguments() -> None:
    assert [(f.name, f.type, f.optional) for f in fields(Ride)] == [
        ("road", str, False),
        ("speed", float, False),
        ("law", str, False),
        ("hold", bool, False),
        ("mass", float, True),
        ("free", int, False),
        ("parts", int, False),
    ]
    assert [f.text for f in fields(Ride)][1] == "speed [km/h]"


@pytest.mark.parametrize(
    ("given", "label"),
    [
        ({}, "sine-50kmh"),
        ({"road": "mine.fmu", "speed_kmh": 72.5}, "mine-72.5kmh"),
        ({"law": "passive"}, "sine-50kmh-passive"),
        ({"hold": True}, "sine-50kmh-hold"),
        ({"mass": 100.0, "free": 4, "parts": 2}, "sine-50kmh-mass-100-free-4-in-2"),
        ({"mass": 1234.5678, "free": 1234567}, "sine-50kmh-mass-1234.5678-free-1234567"),
    ],
)
def test_labels_name_what_differs(given, label) -> None:
    assert Ride(**given).label == label


@dataclass(frozen=True)
class Awkward(Case):
    """Fields of every kind, with texts that are easily confused."""

    front: str = option("soft", help="a text")
    rear: str = option("soft", help="another one")
    law: str = option("a", choices=("a", "a-b", "b", "A"), help="choices that contain each other")
    other: str = option("a", choices=("a", "b"), help="the same choices")
    speed: float = option(50.0, help="six digits", label="{:g}kmh", always=True)
    height: float = option(0.1, help="by a function", label=lambda m: f"{1e3 * m:.3g}mm")
    stage: float = option(0.0, help="by a function that says little", label=lambda v: "high" if v > 5 else "low")
    seed: int = option(0, help="whole", label="in-{}")
    road: str = option("sine", choices=("sine", "curb"), files=".fmu", help="a file")
    mass: float | None = option(1.0, help="optional")
    hold: bool = option(True, help="yes or no")


ALIKE: dict[str, tuple[object, ...]] = {
    "speed": (50.00001, 50.00002, -50.0),
    "height": (0.2, 0.20001),
    "stage": (1.0, 2.0, 7.0, 8.0),
    "front": ("hard", "hard-hard", "Hard", "a/b", "a_b", "nul", "x" * 300, "x" * 299 + "y", "a-b", "", "in-5"),
    "rear": ("hard", ""),
    "law": ("a-b", "b", "A"),
    "other": ("b",),
    "seed": (5, 10**20, 10**20 + 1, -5),
    "road": ("curb", "curb.fmu", "a/curb.fmu", "b/curb.fmu", "x.fmu"),
    "mass": (None, 2.0, 1e-300),
    "hold": (False,),
}
NAMES = ("no-mass", "no-hold", "50kmh", "default")
"""Values of `front` that labels of other fields and of no field look like."""


def test_labels_of_different_cases_differ_and_are_names_of_files() -> None:
    given: list[dict[str, Any]] = [{}, {"front": "hard", "rear": "hard"}, *({"front": name} for name in NAMES)]
    given += [{field: value} for field, values in ALIKE.items() for value in values]
    names = [Awkward(**fields).label for fields in given]
    assert len({n.lower() for n in names}) == len(given) == 45
    for name in names:
        assert len(name) <= 120
        assert re.fullmatch(r"(?!nul$)[\w.+-]+", name, re.ASCII), name
    assert Awkward().label == "50kmh"
    assert re.fullmatch(r"50kmh-[0-9a-f]{8}", Awkward(speed=50.00001).label)


def test_names_of_files_where_a_class_has_its_own_labels() -> None:
    @dataclass(frozen=True)
    class Named(Case):
        speed: float = option(50.0, help="speed")

        @property
        def label(self) -> str:
            return "fast" if self.speed > 50 else "a:b/C"

    assert file_name(Named(60.0)) == "fast"
    assert re.fullmatch(r"a_b_C-[0-9a-f]{8}", file_name(Named()))
    assert file_name(Ride()) == Ride().label


def test_a_key_knows_no_difference_between_1_and_1_0() -> None:
    assert values(Ride(speed_kmh=50)) == values(Ride(speed_kmh=50.0))
    assert isinstance(values(Ride(speed_kmh=50))["speed_kmh"], float)
    assert list(values(Ride())) == [f.name for f in sorted(dataclasses.fields(Ride), key=lambda f: f.kw_only)]


def test_grids(raises) -> None:
    cases = grid(Ride, speed_kmh=(30, 50), law=("passive", "preview"))
    assert [(c.speed_kmh, c.law) for c in cases] == [(30, "passive"), (30, "preview"), (50, "passive"), (50, "preview")]
    assert [f.name for f in differing(cases)] == ["speed", "law"]
    with raises(CaseError):
        grid(Ride, sped=(1,))


def test_cases_of_a_function(raises) -> None:
    def system(speed: float = 30.0, name="car", laps: int = option(2, within=(1, 9), help="laps")):
        return speed, name, laps

    case = case_of(system)
    assert [(f.name, f.type, f.default) for f in fields(case)] == [
        ("speed", float, 30.0),
        ("name", str, "car"),
        ("laps", int, 2),
    ]
    with raises(CaseError):
        case(laps=10)


@pytest.mark.parametrize("function", [lambda speed: speed, lambda **more: more])
def test_functions_without_options(function, raises) -> None:
    with raises(CaseError):
        case_of(function)


def test_classes_that_are_no_cases(raises) -> None:
    @dataclass(frozen=True)
    class Odd:
        road: list = dataclasses.field(default_factory=list)

    @dataclass(frozen=True)
    class Bare:
        speed: float

    for made in (Odd, Bare, int):
        with raises(CaseError):
            fields(made)


def test_choices_that_are_numbers(raises) -> None:
    check_choice("side", 1, (0, 1))
    with raises(CaseError):
        check_choice("side", 2, (0, 1))
