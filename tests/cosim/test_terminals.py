"""Terminals: what of two FMUs is connected by them, of other tools' FMUs too, and what does not fit."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from built import BuiltFmus
from foreign import followers

from cosim import FmuError, FmuWarning, PythonComponent, System, WiringError
from cosim.fmu.describe import describe
from cosim.fmu.file import FmuFile
from cosim.fmu.terminals_file import FILE
from cosim.system.components import Connection

Terminals = Callable[[str, str], Path]


@pytest.fixture(scope="module")
def follower(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return followers.build(3, tmp_path_factory.mktemp("follower"))


@pytest.fixture
def with_terminals(follower: Path, tmp_path: Path) -> Terminals:
    """The FMU of another tool with these terminals."""

    def made(name: str, inner: str) -> Path:
        path = tmp_path / f"{name}.fmu"
        path.write_bytes(follower.read_bytes())
        with zipfile.ZipFile(path, "a") as archive:
            archive.writestr(
                FILE, f'<fmiTerminalsAndIcons fmiVersion="3.0"><Terminals>{inner}</Terminals></fmiTerminalsAndIcons>'
            )
        return path

    return made


def terminal(name: str, rule: str, *components: str, kind: str = "", inner: str = "") -> str:
    """A terminal; a member is written as `variable`, `variable name` or `variable name kind`."""
    listed = ""
    for component in components:
        given = component.split()
        variable, own, of = [*given, *["", "signal"][len(given) - 1 :]]
        listed += f'<TerminalMemberVariable variableName="{variable}" variableKind="{of}"' + (
            f' memberName="{own}"/>' if own else "/>"
        )
    return (
        f'<Terminal name="{name}" matchingRule="{rule}"'
        + (f' terminalKind="{kind}">' if kind else ">")
        + listed
        + inner
        + "</Terminal>"
    )


def stream(into: str, out: str) -> str:
    return (
        '<TerminalStreamMemberVariable inStreamMemberName="h_in" outStreamMemberName="h_out" '
        f'inStreamVariableName="{into}" outStreamVariableName="{out}"/>'
    )


def pair(a: Path, b: Path) -> System:
    system = System()
    system.add("a", a, step="1 ms")
    system.add("b", b, step="1 ms")
    return system


def shown(made: list[Connection]) -> set[str]:
    return {str(c) for c in made}


class Wheel(PythonComponent):
    inputs = ("road.fl.height [m]", "speed [m/s]", "preview.fl[1] [m]", "preview.fl[2] [m]")
    outputs = ("force.fl [N]",)

    def step(self, t, h, u, y):  # noqa: ARG002
        y[0] = u[0]


@pytest.mark.parametrize("version", [2, 3])
def test_a_road_is_wired_by_what_belongs_together(built_fmus: BuiltFmus, version: int) -> None:
    """FMI 2.0 has no terminals: names make them, as they do for components in Python."""
    with System() as system:
        system.add("road", built_fmus.path("RoadSine", version))
        system.add("car", built_fmus.path("FullCarHmmwv", 3))
        system.add("wheel", Wheel(), step="1 ms")
        fl = {f"road.road.fl.{q} -> car.road.fl.{q}" for q in ("height", "slope")}
        assert shown(system.connect_terminals("road.road.fl", "car.road.fl")) == fl
        system.disconnect("car.road.*")
        assert shown(system.connect_terminals("car.road", "road.road")) >= fl
        assert len([c for c in system.connections if c.startswith("car.road.")]) == 8
        assert shown(system.connect_terminals("wheel.preview.fl", "road.preview.fl")) == {
            f"road.preview.fl[{i}] -> wheel.preview.fl[{i}]" for i in (1, 2)
        }
        assert shown(system.connect_terminals("wheel.force", "car.force", delay=True)) == {
            "wheel.force.fl -> car.force.fl (one step of delay)"
        }
        assert shown(system.connect_terminals("car.speed", "road.speed")) == {"car.speed -> road.speed"}


def test_a_plug_is_connected_as_a_whole_in_both_directions(with_terminals: Terminals, raises) -> None:
    a = with_terminals("A", terminal("shaft", "plug", "u angle", "y torque", "rate stiffness"))
    b = with_terminals("B", terminal("flange", "plug", "y angle", "rate stiffness", "u torque"))
    bus = with_terminals("Bus", terminal("flange", "bus", "y angle", "u torque", "rate stiffness", "count n"))
    less = with_terminals("Less", terminal("flange", "plug", "y angle", "rate stiffness"))
    both = {"b.y -> a.u (rad to deg)", "a.y -> b.u (rad to deg)"}
    for other in (b, bus):
        with pair(a, other) as system:
            assert shown(system.connect_terminals("a.shaft", "b.flange")) == both
    with pair(a, less) as system:
        with raises(WiringError):
            system.connect_terminals("a.shaft", "b.flange")
        assert not system.connections


def test_two_outputs_do_not_make_a_plug_but_may_meet_on_a_bus(with_terminals: Terminals, raises) -> None:
    plug, bus = (with_terminals(r, terminal("p", r, "u angle", "y torque")) for r in ("plug", "bus"))
    with pair(plug, plug) as system, raises(WiringError):
        system.connect_terminals("a.p", "b.p")
    with pair(bus, bus) as system, raises(WiringError):
        system.connect_terminals("a.p", "b.p")


def test_a_sequence_matches_by_order_whatever_the_names(with_terminals: Terminals, raises) -> None:
    a = with_terminals("A", terminal("s", "sequence", "y", "count"))
    b = with_terminals("B", terminal("s", "sequence", "u somehow", "count_in else"))
    c = with_terminals("C", terminal("s", "sequence", "u"))
    d = with_terminals("D", terminal("s", "bus", "u x", "count_in y"))
    e = with_terminals("E", terminal("s", "sequence", "w", "count_in"))
    with pair(a, b) as system:
        assert shown(system.connect_terminals("a.s", "b.s")) == {"a.y -> b.u (rad to deg)", "a.count -> b.count_in"}
    for other in (c, d, e):
        with pair(a, other) as system, raises(WiringError):
            system.connect_terminals("a.s", "b.s")


def test_arrays_match_their_elements(with_terminals: Terminals) -> None:
    a = with_terminals("A", terminal("t", "bus", "w x", "total y"))
    b = with_terminals("B", terminal("t", "bus", "y x[2]"))
    with pair(b, a) as system, pytest.raises(WiringError, match=r"units differ: a\.y \[rad\] -> b\.w\[2\] \[degC\]"):
        system.connect_terminals("a.t", "b.t")


def test_flows_add_up_to_zero(with_terminals: Terminals, raises) -> None:
    """What flows out of one side flows into the other: the sign changes where both count alike, in numbers too."""
    out = with_terminals("Out", terminal("pin", "plug", "y i outflow"))
    alike = with_terminals("Alike", terminal("pin", "plug", "u i outflow"))
    opposite = with_terminals("Opposite", terminal("pin", "plug", "u i inflow"))
    signal = with_terminals("Signal", terminal("pin", "plug", "u i"))
    reached = []
    for other in (alike, opposite):
        with pair(out, other) as system:
            (made,) = system.connect_terminals("a.pin", "b.pin")
            assert made.flow
            system["a"].set(u=90.0)
            system.allow_unconnected = True
            reached.append(system.run(0.01, record=["b.u", "b.y"]))
    assert reached[0]["b.u"][-1] < 0 < reached[1]["b.u"][-1]
    assert reached[0]["b.y"].tolist() == (-reached[1]["b.y"]).tolist()
    with pair(out, signal) as system, raises(WiringError):
        system.connect_terminals("a.pin", "b.pin")
    with pair(out, alike) as system:
        system.add("c", opposite, step="1 ms")
        system.connect("a.y", "c.u")  # somebody who measures it
        system.disconnect("c.u")
        system.connect_terminals("a.pin", "b.pin")
        with raises(WiringError):
            system.connect_terminals("a.pin", "c.pin")


def test_what_a_stream_carries_out_of_one_side_enters_the_other(with_terminals: Terminals, raises) -> None:
    streaming = with_terminals("Streaming", terminal("port", "plug", inner=stream("count_in", "count")))
    without = with_terminals("Without", terminal("port", "plug"))
    with pair(streaming, streaming) as system:
        assert shown(system.connect_terminals("a.port", "b.port")) == {"a.count -> b.count_in", "b.count -> a.count_in"}
    with pair(streaming, without) as system, raises(WiringError):
        system.connect_terminals("a.port", "b.port")


def test_terminals_in_terminals_follow_their_own_rules(with_terminals: Terminals, raises) -> None:
    a = with_terminals(
        "A", terminal("car", "plug", inner=terminal("fl", "bus", "y z") + terminal("fr", "bus", "count n"))
    )
    b = with_terminals("B", terminal("car", "plug", inner=terminal("fl", "bus", "u z")))
    with pair(a, b) as system:
        assert shown(system.connect_terminals("a.car", "b.car")) == {"a.y -> b.u (rad to deg)"}
        with raises(WiringError):
            system.connect_terminals("a.car.xl", "b.car")


def test_kinds_and_unknown_rules_are_refused(with_terminals: Terminals, raises) -> None:
    a = with_terminals("A", terminal("t", "bus", "y x", kind="_tool.electric"))
    b = with_terminals("B", terminal("t", "bus", "u x", kind="_tool.fluid"))
    c = with_terminals("C", terminal("t", "org.example.rule", "u x"))
    d = with_terminals("D", terminal("t", "bus", "u x org.example.kind"))
    for other in (b, c, d):
        with pair(a, other) as system, raises(WiringError):
            system.connect_terminals("a.t", "b.t")
    with pair(a, a) as system, raises(WiringError):
        system.connect_terminals("a.t", "a.t")


def test_matching_follows_terminals_where_names_differ(with_terminals: Terminals, raises) -> None:
    """Another tool's names mean nothing to ours; its terminal says which of its variables is the height of the road."""
    theirs = with_terminals("Theirs", terminal("road", "bus", inner=terminal("fl", "bus", "y height", "count laps")))
    with System() as system:
        system.add("theirs", theirs, step="1 ms")
        system.add("wheel", Wheel(), step="1 ms")
        with pytest.raises(WiringError, match=r"units differ: theirs\.y \[rad\]"):
            system.connect_matching("theirs", "wheel", "road.*")
        with raises(WiringError):
            system.connect_matching("theirs", "wheel", "speed*")
    ours = with_terminals("Ours", terminal("road", "bus", inner=terminal("fl", "bus", "u height", "count_in laps")))
    with pair(theirs, ours) as system:
        both = {"a.y -> b.u (rad to deg)", "a.count -> b.count_in"}
        assert shown(system.connect_matching("a", "b", "road.*")) == both
        with raises(WiringError):
            system.connect_matching("a", "b", "road.*")
    with pair(theirs, ours) as system:
        system.connect("a.y", "b.u")
        assert shown(system.connect_matching("a", "b")) == both - {"a.y -> b.u (rad to deg)"}


def test_matching_refuses_plugs_that_do_not_fit_and_leaves_alone_what_it_does_not_know(
    with_terminals: Terminals, refused
) -> None:
    a = with_terminals("A", terminal("p", "plug", "y x", "count n") + terminal("q", "org.example.rule", "count n"))
    b = with_terminals("B", terminal("p", "plug", "u x") + terminal("q", "org.example.rule", "count_in n"))
    with pair(a, b) as system:
        refused(
            WiringError, lambda: system.connect_matching("a", "b"), lambda: system.connect_matching("a", "b", "q.*")
        )


def test_a_file_that_cannot_be_understood_hinders_nobody_who_does_not_need_it(
    with_terminals: Terminals, raises, warns
) -> None:
    broken = with_terminals("Broken", terminal("t", "bus", "nobody x"))
    whole = with_terminals("Whole", terminal("t", "bus", "u x"))
    with pair(broken, whole) as system:
        with raises(FmuError):
            system.connect_terminals("a.t", "b.t")
        with warns(FmuWarning), pytest.raises(WiringError):
            system.connect_matching("a", "b")


@pytest.mark.parametrize(
    "inner",
    [
        terminal("t", "bus", "u"),
        terminal("t", "bus", "u x", "y x"),
        terminal("t", "bus") * 2,
        '<Terminal matchingRule="bus"/>',
        terminal("t", "bus", inner=terminal("t", "bus", "lost x")),
        '<Terminal name="t" matchingRule="bus">' * 17 + "</Terminal>" * 17,
        "<Terminal",
    ],
)
def test_bad_files_are_refused_by_name(with_terminals: Terminals, inner: str, raises) -> None:
    opened = FmuFile(with_terminals("Bad", inner))
    with raises(FmuError):
        _ = opened.terminals


def test_terminals_are_shown(with_terminals: Terminals, capsys: pytest.CaptureFixture[str]) -> None:
    from rich.console import Console

    say = partial(Console(width=100).print)
    say(describe(with_terminals("A", terminal("shaft", "plug", "u angle", "y torque", kind="_tool.rotation"))))
    text = capsys.readouterr().out
    assert "terminals (1)" in text
    assert [line.split() for line in text.splitlines() if "shaft" in line] == [
        ["shaft", "plug,", "_tool.rotation", "angle", "torque"]
    ]
    say(describe(with_terminals("B", terminal("t", "bus", "nobody x"))))
    assert "there is no variable 'nobody'" in " ".join(capsys.readouterr().out.split())
