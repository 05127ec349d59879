"""Connections of texts, bytes and 64-bit integers between FMUs: when they arrive, and what is refused."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from foreign import messages
from foreign.making import redescribed
from pages import ROOT

from cosim import ComponentError, CosimError, Execution, System, SystemState, WiringError
from cosim.batch import Batch
from cosim.fmu.model_description import parse

EXAMPLES = str(ROOT / "docs" / "examples" / "fmi3")

pytestmark = pytest.mark.filterwarnings("ignore::cosim.FmuWarning")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("messages")


@pytest.fixture(scope="module")
def fmus(folder: Path) -> dict[int, Path]:
    return {version: messages.build(folder, version) for version in (2, 3)}


def mirror(folder: Path) -> Path:
    """An FMU of the examples."""
    sys.path.insert(0, EXAMPLES)
    try:
        from binary import MIRROR
        from small_fmu import build
    finally:
        sys.path.remove(EXAMPLES)
    return build("mirror", MIRROR, folder)


VARIABLES = {2: ("text",), 3: ("text", "data", "whole", "unsigned")}
START = {"text_in": "", "data_in": b"", "whole_in": 0, "unsigned_in": 0}


def chain(path: Path, version: int, *, kind: str = "continuous", delay: bool = False, **options: Any) -> System:
    """A source `a`, which writes every 10 ms, and `b`, which passes on what it reads."""
    system = System(allow_unconnected=True)
    own = {"length": 5, **({"first": 2**53} if version == 3 else {})}
    unconnected = {f"{v}_in": START[f"{v}_in"] for v in VARIABLES[version]}
    system.add("a", path, step="10 ms", kind=kind, parameters={"source": 1, **own}, start=unconnected, **options)
    system.add("b", path, step="10 ms", kind=kind, start=unconnected, **options)
    for variable in VARIABLES[version]:
        system.connect(f"a.{variable}", f"b.{variable}_in", delay=delay)
    return system


def shown(system: System, name: str, times: int = 4) -> list[Any]:
    """What a component shows after 0, 1, ... steps."""
    found: list[Any] = []
    owner, variable = name.split(".")
    component = system[owner]
    with system, system.initialize(record=[]) as simulation:
        for k in range(times):
            simulation.advance(k * 0.01, final=True)
            if variable in ("text", "data"):
                found.append(simulation.text(name))
            else:
                found += component.implementation.get([component.description.variables[variable]])
    return found


@pytest.mark.parametrize("isolated", [False, True])
@pytest.mark.parametrize("version", [2, 3])
def test_texts_arrive_at_the_next_communication_point(fmus: dict[int, Path], version: int, isolated: bool) -> None:
    assert shown(chain(fmus[version], version, isolated=isolated), "a.text") == ["aaaaa0", "aaaaa1", "aaaaa2", "aaaaa3"]
    found = shown(chain(fmus[version], version, isolated=isolated), "b.text")
    assert found == ["aaaaa0", "aaaaa0", "aaaaa1", "aaaaa2"]


@pytest.mark.parametrize("isolated", [False, True])
def test_bytes_arrive_with_their_zeros_and_lengths(fmus: dict[int, Path], isolated: bool) -> None:
    found = shown(chain(fmus[3], 3, isolated=isolated), "b.data", 6)
    assert found == [b"", b"", b"\0", b"\0\1", b"\0\1\2", b"\0\1\2\3"]


@pytest.mark.parametrize("isolated", [False, True])
def test_whole_numbers_that_doubles_do_not_hold_arrive_exactly(fmus: dict[int, Path], isolated: bool) -> None:
    assert shown(chain(fmus[3], 3, isolated=isolated), "b.whole") == [2**53, 2**53, 2**53 + 1, 2**53 + 2]
    found = shown(chain(fmus[3], 3, isolated=isolated), "b.unsigned")
    assert found == [2**54 + 1, 2**54 + 1, 2**54 + 2, 2**54 + 3]


@pytest.mark.parametrize("first", [-(2**63), -(2**53) - 1, -1, 2**62 - 3])
def test_negative_and_largest_numbers_arrive_exactly(fmus: dict[int, Path], first: int) -> None:
    with chain(fmus[3], 3) as system:
        system["a"].set(first=first)
        assert shown(system, "b.whole", 3) == [first, first, first + 1]


def test_discrete_components_read_at_once_and_delays_take_a_step(fmus: dict[int, Path]) -> None:
    assert shown(chain(fmus[3], 3, kind="discrete"), "b.data", 3) == [b"\0", b"\0\1", b"\0\1\2"]
    assert shown(chain(fmus[3], 3, kind="discrete", delay=True), "b.data", 3) == [b"", b"\0", b"\0\1"]
    assert shown(chain(fmus[3], 3, delay=True), "b.text", 4) == ["aaaaa0", "aaaaa0", "aaaaa0", "aaaaa1"]


def test_what_is_recorded_of_exact_numbers_is_rounded_and_says_so(fmus: dict[int, Path]) -> None:
    with chain(fmus[3], 3) as system, pytest.warns(UserWarning, match=r"^b\.whole: integers from 2\^53 on"):
        found = system.run(0.02, record=["b.whole"])
    assert found["b.whole"].tolist() == [2.0**53, 2.0**53, float(2**53 + 1)]


def test_states_hold_texts_and_bytes(fmus: dict[int, Path]) -> None:
    with chain(fmus[3], 3) as system:
        with system.initialize(record=["b.hash"]) as simulation:
            simulation.advance(0.05)
            state = simulation.save()
            simulation.advance(0.09)
            once = simulation.recording["b.hash"].tolist()
            simulation.restore(state)
            simulation.advance(0.09)
            assert simulation.recording["b.hash"].tolist() == once
            packed = state.to_bytes()
        assert len(set(once)) > 5
        with system.initialize(record=["b.hash"], state=SystemState.from_bytes(packed)) as simulation:
            simulation.advance(0.09)
            assert simulation.recording["b.hash"].tolist() == once[-5:]


@pytest.mark.parametrize("isolated", [False, True])
def test_longer_texts_than_declared_end_the_run(folder: Path, isolated: bool, refused: Callable[..., None]) -> None:
    path = messages.build(folder, max_size=3)
    with chain(path, 3, isolated=isolated) as system:
        refused(ComponentError, lambda: system.run(0.1, record=[]))
    with chain(path, 3, isolated=isolated) as system:
        system["a"].set(length=1100)
        with pytest.raises(ComponentError, match=r"text has at least 1025 bytes, and its connection holds 1024"):
            system.run(0.02, record=[])


def test_a_connection_may_hold_more(folder: Path) -> None:
    path = messages.build(folder, max_size=3)
    with chain(path, 3) as system:
        system.disconnect("b.*")
        system.connect("a.data", "b.data_in", max_size=100)
        assert shown(system, "b.data", 7)[-1] == b"\0\1\2\3\4"


def test_what_does_not_fit_is_refused(folder: Path, fmus: dict[int, Path], refused: Callable[..., None]) -> None:
    with chain(fmus[3], 3) as system:
        system.add("can", messages.build(folder, mime_type="application/x-frames"), step="10 ms")
        system.add("two", fmus[2], step="10 ms")
        refused(
            WiringError,
            lambda: system.connect("a.data", "can.data_in"),
            lambda: system.connect("a.text", "can.data_in"),
            lambda: system.connect("a.data", "two.hash"),
            lambda: system.connect("a.text", "two.text_in", extrapolate=True),
            lambda: system.connect("a.text", "two.text_in", linear=(2.0, 0.0)),
            lambda: system.connect("a.text", "two.text_in", max_size=0),
            lambda: system.connect("a.whole", "can.whole_in", max_size=4),
            lambda: system["a"].set(data_in="text"),
        )
        system.connect("a.text", "two.text_in")


def test_who_exchanges_numbers_only_says_so(fmus: dict[int, Path], refused: Callable[..., None]) -> None:
    with chain(fmus[3], 3) as system:
        refused(
            WiringError,
            lambda: Batch(system, 2),
            lambda: system.run(0.1, record=[], execution=Execution(tolerance=1e-3)),
        )


def exported(system: System, path: Path, **options: Any) -> System:
    """The FMU of a system, as the only component of another one."""
    outer = System(allow_unconnected=True)
    outer.add("s", system.export_fmu(path, outputs=["b.hash"], **options), step="10 ms")
    return outer


@pytest.mark.parametrize("delay", [False, True])
@pytest.mark.parametrize(("version", "event_mode"), [(2, False), (3, False), (3, True)])
def test_exported_systems_exchange_texts(
    folder: Path, tmp_path: Path, version: int, event_mode: bool, delay: bool
) -> None:
    """What `b` computes of all that it has read is the same, also after a saved state is restored.

    An FMU with event mode gets texts, bytes and 64-bit integers in event mode only, and in as many events.
    """
    fmu = messages.build(folder, version, event_mode=event_mode)
    with chain(fmu, version, delay=delay) as system:
        outside = system.run(0.1, record=["b.hash"])["b.hash"].tolist()
        outer = exported(system, tmp_path / "Texts.fmu")
    with outer, outer.initialize(record=["s.b.hash"]) as simulation:
        simulation.advance(0.04)
        state = simulation.save()
        simulation.advance(0.07)
        simulation.restore(state)
        simulation.advance(0.1)
        inside = simulation.recording["s.b.hash"].tolist()
    assert inside == outside
    assert len(set(outside)) > 5
    assert (outside[-1] % 1.0 > 0) is event_mode


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.filterwarnings("ignore:.*integers from 2.53 on")
@pytest.mark.parametrize("first", [3 * 10**9, -5 * 10**9, -(2**63) + 5])
def test_exported_systems_show_whole_numbers_beyond_32_bits(
    fmus: dict[int, Path], tmp_path: Path, first: int, fmi: int
) -> None:
    """As Float64, whose description names the type. Starts are exact: a double of the last one gives 1, not 11."""
    names = ["a.whole", "a.unsigned"]
    with System(allow_unconnected=True) as system:
        system.add("a", fmus[3], step="10 ms", parameters={"source": 1, "first": first})
        inside = system.run(0.02, record=names)
        path = system.export_fmu(tmp_path / "Whole.fmu", outputs=names, fmi=fmi)
    with System(allow_unconnected=True) as outer:
        outer.add("s", path, step="10 ms")
        outside = outer.run(0.02, record=["s.*"])
        said = [outer["s"].description.outputs[n].description for n in names]
    exact = [[float(first + k), float((2 * first + 1 + k) % 2**64)] for k in range(3)]
    assert outside.data.tolist() == inside.data.tolist() == exact
    assert said == ["Int64 as Float64, exact up to 2^53", "UInt64 as Float64, exact up to 2^53"]


def test_an_exported_system_names_a_text_that_is_too_long(
    fmus: dict[int, Path], tmp_path: Path, refused: Callable[..., None]
) -> None:
    with chain(fmus[2], 2) as system:
        system.disconnect("b.text_in")
        system.connect("a.text", "b.text_in", max_size=3)
        with exported(system, tmp_path / "Long.fmu") as outer:
            refused(ComponentError, lambda: outer.run(0.1, record=[]))


def test_arrays_of_which_some_elements_are_connected_are_not_exported(
    fmus: dict[int, Path], tmp_path: Path, refused: Callable[..., None]
) -> None:
    with chain(fmus[3], 3) as system:
        system.connect("a.list[1]", "b.list_in[1]")
        refused(WiringError, lambda: system.export_fmu(tmp_path / "Some.fmu"))


def test_texts_in_both_directions_are_no_algebraic_loop(fmus: dict[int, Path]) -> None:
    with chain(fmus[3], 3) as system:
        system.connect("b.text", "a.text_in")
        assert not system.schedule().loops
        assert not system.schedule().possible_loops


@pytest.mark.parametrize("isolated", [False, True])
def test_bytes_are_set_in_event_mode_where_the_fmu_has_it(folder: Path, isolated: bool) -> None:
    """Each puts its letter before what it was given, in reverse order."""
    with System() as system:
        for letter in "ab":
            system.add(letter, mirror(folder), step=1, parameters={"letter": ord(letter)}, isolated=isolated)
        system.connect("a.out", "b.in")
        system.connect("b.out", "a.in")
        with system.initialize(record=[]) as simulation:
            found = []
            for t in range(1, 6):
                simulation.advance(t)
                found.append((simulation.text("a.out"), simulation.text("b.out")))
            state = simulation.save()
            simulation.advance(7)
            once = simulation.text("a.out")
            simulation.restore(state)
            simulation.advance(7)
            assert simulation.text("a.out") == once
    assert found == [(b"a", b"b"), (b"ab", b"ba"), (b"aab", b"bba"), (b"aabb", b"bbaa"), (b"aaabb", b"bbbaa")]


def test_other_elements_of_arrays_of_texts_keep_their_start_values(fmus: dict[int, Path], tmp_path: Path) -> None:
    """Each has an element `Start` of its own; an exported system does not set such arrays."""
    starts = b'causality="input"><Dimension start="3"/><Start value="a b"/><Start value="c"/><Start value="d"/>'
    name = b'name="words_in" valueReference="22" '
    before = name + b'causality="input"><Dimension start="3"/>'
    with System(allow_unconnected=True) as system:
        system.add("a", redescribed(fmus[3], tmp_path / "Words.fmu", (before, name + starts)), step="10 ms")
        system["a"].set(**{"words_in[3]": "e f"})
        with system.initialize(record=[]) as simulation:
            assert [simulation.text(f"a.words[{i}]") for i in (1, 2, 3)] == ["a b", "c", "e f"]
        with pytest.raises(WiringError, match="'a': words_in is an array of texts"):
            system.export_fmu(tmp_path / "Whole.fmu")


def test_other_elements_of_arrays_of_bytes_keep_their_start_values() -> None:
    """Hexadecimal digits."""
    text = """<fmiModelDescription fmiVersion="3.0" modelName="B"><CoSimulation modelIdentifier="B"/><ModelVariables>
        <Binary name="b" valueReference="0" causality="parameter" variability="fixed"><Dimension start="2"/>
        <Start value="AB"/><Start value="cdef"/></Binary></ModelVariables><ModelStructure/></fmiModelDescription>"""
    starts = [v.start_as_set for v in parse(text.encode(), "B").variables.values()]
    assert starts == [b"\xab", b"\xcd\xef"]


@pytest.mark.parametrize("isolated", [False, True])
def test_arrays_of_texts_and_whole_numbers(fmus: dict[int, Path], isolated: bool, refused: Callable[..., None]) -> None:
    numbers, words = [2**53 + 1, -5, 2**62 + 1], ["one", "", "three"]
    with System(allow_unconnected=True) as system:
        system.add("a", fmus[3], step="10 ms", start={"list_in": numbers, "words_in": words}, isolated=isolated)
        for name in "bc":
            system.add(name, fmus[3], step="10 ms", start={"list_in": [7, 8, 9]}, isolated=isolated)
        system.connect("a.list", "b.list_in")
        system.connect("a.words", "b.words_in")
        system.connect("a.list[3]", "c.list_in[2]")
        with system.initialize(record=[]) as simulation:
            simulation.advance(0.03)
            assert [simulation.text(f"b.words[{i}]") for i in (1, 2, 3)] == words
            found = {m: system[m].implementation for m in "bc"}
            shown = {m: c.get([c.description.variables[f"list[{i}]"] for i in (1, 2, 3)]) for m, c in found.items()}
        assert shown == {"b": numbers, "c": [7, 2**62 + 1, 9]}
        system.connect("a.words[1]", "c.words_in[2]")
        refused(CosimError, lambda: system.run(0.01))
