"""The plant that a controller drives over a UDP socket, as the page shows it: two processes, real packets."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pages import ROOT
from same import bits

from cosim import Recording

EXAMPLES = ROOT / "docs" / "examples"
SECONDS = 1.5


@pytest.fixture
def examples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))


def test_a_controller_over_udp_drives_the_corner(workplace: Path, examples: None) -> None:  # noqa: ARG001
    """All answers are accounted for, and the run can be repeated from the forces that were in effect.

    How many answers were in time depends on the machine.
    """
    plant = subprocess.Popen(
        [sys.executable, EXAMPLES / "udp_plant.py", "--seconds", str(SECONDS), "--port", "0", "--csv", "udp.csv"],
        stdout=subprocess.PIPE,
        text=True,
    )
    with plant:
        assert plant.stdout is not None
        port = re.fullmatch(r"waiting for a controller at port (\d+)\n", plant.stdout.readline())
        assert port is not None
        controller = subprocess.run(
            [sys.executable, EXAMPLES / "udp_controller.py", "--port", port[1]],
            capture_output=True,
            text=True,
            check=True,
            timeout=300,
        )
        said = plant.stdout.read()
    assert plant.returncode == 0
    steps = round(SECONDS * 1000)
    counted = re.match(r"(\d+) states: (\d+) answered in time, (\d+) late, (\d+) lost; 0 odd packets\n", said)
    assert counted is not None, said
    total, in_time, late, lost = map(int, counted.groups())
    assert in_time + late + lost == total == steps
    assert re.search(rf"1 times real time: {2 * steps} instants, \d+ overruns", said)
    came = re.match(r"(\d+) states came, (\d+) were lost", controller.stdout)
    assert came is not None
    assert in_time + late <= int(came[1]) <= steps
    recording = Recording.read(workplace / "udp.csv")
    assert len(recording) == steps + 1
    if in_time > 100:
        assert np.ptp(recording["tracking.force.desired"]) > 0
    import udp_plant

    np.testing.assert_array_equal(bits(udp_plant.repeat(recording).data), bits(recording.data))


def test_answers_that_are_missing_old_odd_or_wrong(examples: None, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: ARG001
    import udp_plant

    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        server.bind(("127.0.0.1", 0))
        for one in (client, stranger):
            one.connect(server.getsockname())
        client.send(udp_plant.COMMAND.pack(0, 0.0))
        link = udp_plant.meet(server)

        def answer(*packets: bytes) -> None:
            for packet in packets:
                client.send(packet)

        def command(number: int, force: float) -> bytes:
            return bytes(udp_plant.COMMAND.pack(number, force))

        def exchange(number: int, wait: float) -> float:
            monkeypatch.setattr(udp_plant, "WAIT", wait)
            return float(link.exchange(number, [0.0] * 8))

        answer(command(1, 5.0))  # there before it is asked for
        assert exchange(1, 10.0) == 5.0
        assert exchange(2, 0.0) == 5.0  # held
        answer(command(2, 6.0))
        assert exchange(3, 0.2) == 6.0  # late is better than never
        answer(command(4, 8.0), command(3, 7.0))
        stranger.send(command(4, 9.0))
        assert exchange(4, 10.0) == 8.0
        answer(
            b"", b"x" * 16, command(5, float("nan")), command(10**9, 1.0), command(0, 1.0), b"y" * 60, command(5, 4.0)
        )
        assert exchange(5, 10.0) == 4.0
        held = [exchange(number, 0.0) for number in range(6, 60)]
        assert held == [4.0] * 50 + [0.0] * 4  # nothing for 50 ms
        assert (link.in_time, link.late, link.odd) == (3, 2, 7)
        assert link.text(59) == "59 states: 3 answered in time, 2 late, 54 lost; 7 odd packets"
        assert udp_plant.STATE.unpack(client.recv(200))[:2] == (1, 0.001)
