"""The judge that compares quantities over places, on a study of two roads and three controllers."""

from __future__ import annotations

from typing import Any, ClassVar

import pytest

from cosim.report.claims import Claim
from cosim.study import Band, ClaimList, Distribution
from cosim.study.judges import Comparison, Quantities, View, compare

STUDY = {
    ("smooth", "passive"): {"rms": 2.0, "peak": 4.0, "force": 0.0},
    ("smooth", "lqr"): {"rms": 1.0, "peak": 4.0, "force": 2.0},
    ("smooth", "mpc"): {"rms": 0.8, "peak": 4.1, "force": 3.0},
    ("rough", "passive"): {"rms": 4.0, "peak": 8.0, "force": 0.0},
    ("rough", "lqr"): {"rms": 3.0, "peak": 6.0, "force": 5.0},
    ("rough", "mpc"): {"rms": 1.0, "peak": 3.0, "force": 4.0},
}


class RoadView(View):
    quantities: ClassVar[Quantities] = {"force, if any": lambda view, c, road: view.study[road, c]["force"] or None}
    left_out = "no such road was driven"

    def places(self, at: Any, road: str) -> list[str]:  # noqa: ARG002
        return {"everywhere": ["smooth", "rough"], "nowhere": []}.get(at, [at])

    def case(self, subject: str, place: str) -> tuple[str, str]:
        return place, subject


class Sampled(RoadView):
    """Eight samples of each comparison, of which the last is on the other side of 1."""

    def values(self, c: Comparison, place: str) -> Distribution | None:
        found = super().values(c, place)
        return found and Distribution([found.median] * 7 + [2.0], "drives")


def judged(*lines: dict[str, Any], view: type[View] = RoadView, **entry: Any):
    return compare(view(STUDY), compare=lines, **entry)


@pytest.mark.parametrize(
    ("line", "holds"),
    [
        ({"value": "rms", "of": "lqr", "most": 3}, True),
        ({"value": "rms", "of": "lqr", "below": 3}, False),
        ({"value": "rms", "of": "lqr", "least": 1}, True),
        ({"value": "rms", "of": "lqr", "above": 1}, False),
        ({"value": "rms/peak", "of": "lqr", "within": [0.25, 0.5]}, True),
        ({"value": "rms/peak", "of": "lqr", "within": [0.25, 0.45]}, False),
        ({"ratio": "rms", "of": "lqr", "to": "passive", "most": 0.75}, True),
        ({"ratio": "rms", "of": ["lqr", "mpc"], "to": "passive", "below": 0.5}, False),  # 0.5 of the LQR is not below
        ({"percent": "rms", "of": "lqr", "to": "passive", "most": 75}, True),
        ({"percent": "rms", "of": "lqr", "most": 300}, True),
        ({"reduction": "rms", "of": "lqr", "to": "passive", "least": 25}, True),
        ({"reduction": "rms", "of": "lqr", "to": "passive", "above": 25}, False),
        ({"rise": "peak", "of": "mpc", "to": 2, "least": 50}, True),  # to a number
        ({"same": ["rms", "peak"], "of": "lqr", "to": "passive", "most": 50}, True),
        ({"same": "peak", "of": "mpc", "to": "passive", "most": 60}, False),  # 62.5 % lower is not the same either
        ({"ratio": "rms", "of": "mpc", "to": ["lqr", "passive"], "below": 1}, True),  # the order of three
        ({"ratio": "peak", "of": "mpc", "to": ["lqr", "passive"], "below": 1}, False),
        ({"ratio": "force", "of": "lqr", "to": "passive", "above": 1}, True),  # infinitely more than nothing
        ({"ratio": "force", "of": "passive", "to": "passive", "most": 9}, False),  # 0 over 0 is on no side
        ({"value": "force, if any", "of": ["passive", "lqr"], "least": 2}, True),  # where there is one
        ({"value": "force, if any", "of": "passive", "least": 2}, False),
        ({"value": "rms/force", "of": "passive", "above": 9}, True),  # per nothing
        ({"value": "force/force", "of": "passive", "most": 9}, False),
    ],
)
def test_forms_and_sides(line: dict[str, Any], holds: bool) -> None:
    assert judged(line).holds == holds


def test_every_judged_line_has_to_hold_and_no_shown_one() -> None:
    good, bad = {"value": "rms", "of": "mpc", "most": 1}, {"name": "peak", "value": "peak", "of": "mpc", "most": 4}
    assert judged(good).holds
    assert not judged(good, bad).holds
    assert judged(good, {**bad, "shown": True}).holds
    assert judged(good, {**bad, "at": "rough"}).holds  # at its own place
    assert judged({**bad, "at": "rough"}, good).holds


def test_lines_take_subjects_and_places_of_their_entry() -> None:
    line = {"ratio": "rms", "most": 0.5}
    assert judged(line, of="mpc", to="passive").holds
    assert not judged(line, of="lqr", to="passive").holds
    assert judged(line, of="lqr", to="passive", at="smooth").holds


@pytest.mark.parametrize(
    ("sized", "value", "unit"), [("low", 25.0, "%"), ("high", 50.0, "%"), ("median", 37.5, "%"), ("held", 1.0, "%")]
)
def test_sizes(sized: str, value: float, unit: str) -> None:
    found = judged({"reduction": "rms", "of": "lqr", "to": "passive", "above": 30, "sized": sized})
    assert (found.value, found.unit) == (value, unit)


def test_of_several_sizes_the_one_that_lies_worst_in_the_band_counts() -> None:
    line = {"reduction": "rms", "of": ["lqr", "mpc"], "to": "passive", "above": 0, "sized": "low"}  # 25 and 60
    assert judged(line, band=Band(20, 30)).value == 60.0
    assert judged(line, band=Band(50, 70)).value == 25.0
    assert judged(line, band=Band(20, 30), size_at="smooth").value == 60.0
    assert judged(line, band=Band(50, 70), size_at="smooth").value == 50.0


def test_samples_of_a_place() -> None:
    line = {"name": "rms", "ratio": "rms", "of": "mpc", "to": "passive", "below": 1}
    assert not judged(line, view=Sampled).holds  # not with all of them
    assert judged(line, view=Sampled, strict=True).holds  # 7 of 8 are significant
    spread = judged(line, view=Sampled, strict=True).words["rms"].spread
    assert f"{spread:.2f}" == "median 0.40 (0.40 to 2.00 over 8 drives; holds in 7 of 8)"


def test_a_claim_on_places_that_were_left_out_is_open() -> None:
    found = judged({"value": "rms", "of": "mpc", "most": 1}, at="nowhere")
    assert (found.verdict, found.undecided) == ("open", "no such road was driven")


FILE = """
[[claim]]
id = "first"
claim = "The drive under {of} is smoother"
published = "lower"
judge = "compare"
of = "mpc"
to = "passive"
compare = [
  { name = "rms", ratio = "rms", most = 0.3, sized = "low" },
  { name = "own", value = "rms" },
]
band = { low = 0.1, high = 0.3, reason = "so small" }
result = "{rms:.2f}: {rms.high:.1f} {rms.at_high}, {rms.low:.2f} {rms.at_low}; {own[0]:.1f}, {own[1]:.1f}, {own.sum:g}"
criterion = "held at {rms.held} of {rms.places}, not {rms.missing}"
reason = "it is not"

[[claim]]
id = "second"
like = "first"
claim = "The same under {of}"
source = "Figure 1"
of = "lqr"
band.high = 0.6
"""


def read(tmp_path, text: str = FILE) -> ClaimList:
    path = tmp_path / "claims.toml"
    path.write_text(text)
    return ClaimList.read(path, {"compare": compare}, RoadView)


def test_an_entry_has_what_another_has(tmp_path) -> None:
    first, second = read(tmp_path).judge(STUDY)
    assert first == Claim(
        "first",
        "The drive under mpc is smoother",
        "lower",
        "0.25 to 0.40: 0.4 smooth, 0.25 rough; 0.8, 1.0, 1.8",
        "not reproduced",
        "it is not",
        "own",
        value=0.25,
        unit="times",
        criterion="held at 1 of 2, not smooth; magnitude between 0.1 and 0.3 times (so small)",
    )
    assert (second.claim, second.source, second.value) == ("The same under lqr", "Figure 1", 0.5)
    assert "between 0.1 and 0.6 times (so small)" in second.criterion


def test_checks_and_claims_keep_the_order_of_the_file(tmp_path) -> None:
    check = FILE.split("[[claim]]")[1].replace('"first"', '"check"').replace("published", "expected")
    found = read(
        tmp_path, FILE + "[[check]]" + check + FILE.replace('"first"', '"third"').replace('"second"', '"last"')
    )
    assert [(s.id, s.own) for s in found] == [
        ("first", False),
        ("second", False),
        ("check", True),
        ("third", False),
        ("last", False),
    ]


@pytest.mark.parametrize(
    ("old", "new"),
    [('like = "first"', 'like = "fifth"'), ("most = 0.3", "most = 0.3, least = 0.1"), ("most = 0.3", "mst = 0.3")],
)
def test_mistakes_are_named(tmp_path, raises, old: str, new: str) -> None:
    with raises(ValueError):
        read(tmp_path, FILE.replace(old, new)).judge(STUDY)


def test_entries_in_another_notation_are_not_lost(tmp_path, raises) -> None:
    with raises(ValueError):
        read(tmp_path, 'claim = [{ id = "one" }]')
