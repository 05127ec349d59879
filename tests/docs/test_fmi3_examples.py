"""The examples of FMI 3.0: each is executed as it is, and the CAN bus is compared with the times of its bits."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from exported import run_exported
from pages import ROOT

from cosim import WiringError

EXAMPLES = ROOT / "docs" / "examples" / "fmi3"
PRINTED = {
    "binary": """\
after 1 s: b'a' b'b'
after 2 s: b'ab' b'ba'
after 3 s: b'aab' b'bba'
after 4 s: b'aabb' b'bbaa'
after 5 s: b'aaabb' b'bbbaa'
""",
    "can": """\
brake received 160 from 0x10 at 1216 us
brake received 480 from 0x30 at 1660 us
engine received 320 from 0x20 at 1438 us
engine received 480 from 0x30 at 1660 us
body received 160 from 0x10 at 1216 us
body received 320 from 0x20 at 1438 us
""",
    "clocks": """\
at 1 s: tick 2, taken at 0.8 s
at 2 s: tick 4, taken at 1.6 s
at 3 s: tick 7, taken at 2.8 s
""",
    "early_return": """\
steps of 5 s: switches at 41.396 121.515 201.633 281.752 361.871 441.99 522.109 s
steps of 20 s: switches at 41.396 121.515 201.633 281.752 361.871 441.99 522.109 s
""",
    "event_mode": """\
day: 41.396 121.515 201.633 281.752 361.871 441.99 522.109
night from 130 s, steps of 20 s: 41.396 121.515 403.517 466.733 576.126
night from 130 s, steps of 5 s: 41.396 121.515 403.517 466.733 576.126
""",
    "intermediate_update": """\
steps of 40 ms: held 0.0954, follows 0.0161
steps of 20 ms: held 0.0462, follows 0.0039
steps of 10 ms: held 0.0227, follows 0.0010
""",
    "structural_parameters": """\
first 1 3 6 10 15
second 1 4 10 20 35
""",
}


@pytest.mark.parametrize("name", sorted(PRINTED))
def test_an_example_prints_what_it_says(name: str) -> None:
    done = subprocess.run([sys.executable, EXAMPLES / f"{name}.py"], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == (PRINTED[name], "")


def test_every_example_is_executed() -> None:
    programs = {p.stem for p in EXAMPLES.glob("*.py") if "__main__" in p.read_text(encoding="utf-8")}
    assert programs == PRINTED.keys()


@pytest.fixture
def can(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(EXAMPLES))
    import can

    return can


BITS, PAUSE = 108, 3  # of a frame with 8 bytes


@pytest.mark.parametrize("step", ["0.1 ms", "0.2 ms", "0.05 ms"])
def test_frames_arrive_when_their_last_bit_is_sent(can: ModuleType, tmp_path: Path, step: str) -> None:
    """Whatever the communication step is: every 10 ms three frames, the lowest identifier first."""
    with can.network(tmp_path, {"a": 3, "b": 1, "c": 2}, step) as system:
        found = system.run(0.025)
    sent = [(k, 0.001 + 0.01 * cycle) for cycle in range(3) for k in (1, 2, 3)]
    expected = [(k, 10.0 * k, begin + (k * BITS + (k - 1) * PAUSE) / 500e3) for k, begin in sent]
    for name, own in (("a", 3), ("b", 1), ("c", 2)):
        frames = can.frames(found, name)
        assert [(i, x) for i, x, _ in frames] == [(i, x) for i, x, _ in expected if i != own]
        assert [t for *_, t in frames] == pytest.approx([t for i, _, t in expected if i != own], abs=1e-12)
        confirmed = [t for i, _, t in expected if i == own]
        assert found[f"{name}.confirmed.time"][-1] == pytest.approx(confirmed[-1], abs=1e-12)
        assert found[f"{name}.confirmed.count"][-1] == 3
    assert found["bus.frames"][-1] == 9
    assert found["bus.lost"][-1] == 0


def test_a_bus_is_exported_with_its_nodes(can: ModuleType, tmp_path: Path) -> None:
    """Bit-identical to the run, also after a saved state is restored within the transmission of a frame."""
    with can.network(tmp_path, {"a": 3, "b": 1, "c": 2}) as system:
        found = system.run(0.025)
        exported = system.export_fmu(tmp_path / "Network.fmu")
    inside = run_exported(exported, "0.1 ms", 0.0111, 0.02, 0.025)
    assert found["bus.frames"][-1] == 9
    numbers = [n for n in found.names if n in inside]
    assert {"a.received.time", "b.received.value", "c.confirmed.time", "bus.frames"} <= {*numbers}
    for name in numbers:
        np.testing.assert_array_equal(inside[name], found[name], err_msg=name)


def test_a_slow_bus_sends_what_waits_later(can: ModuleType, tmp_path: Path) -> None:
    """At 10 kbit/s a frame takes 10.8 ms, and two nodes with 10 ms each send more than that."""
    with can.network(tmp_path, {"a": 2, "b": 1}) as system:
        system["bus"].set(baud_rate=10000)
        found = system.run(0.06)
    duration, pause = BITS / 10e3, PAUSE / 10e3
    frames = can.frames(found, "a")
    assert [i for i, *_ in frames] == [1] * 5, "the other identifier always waits"
    expected = [0.001 + k * (duration + pause) + duration for k in range(5)]
    assert [t for *_, t in frames] == pytest.approx(expected, abs=1e-12)
    assert can.frames(found, "b") == []


def test_terminals_of_nodes_need_their_four_variables(
    can: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import small_fmu

    whole = small_fmu.terminals
    clock = '<TerminalMemberVariable variableKind="signal" variableName="Node2.Rx_Clock" memberName="Rx_Clock"/>'
    monkeypatch.setattr(small_fmu, "terminals", lambda names: whole(names).replace(clock, ""))
    with pytest.raises(WiringError, match=r"b\.CanChannel and bus\.Node2: bus\.Node2 lacks 'Rx_Clock'"):
        can.network(tmp_path, {"a": 1, "b": 2})
