"""The corner of hmmwv_corner.py in real time, with its controller at the other end of a UDP socket.

    python docs/examples/udp_plant.py --seconds 5 &
    python docs/examples/udp_controller.py

1000 packets a second each way, little-endian. State: number of the step (uint64), then doubles: time [s], body.z,
body.vz, wheel.z, wheel.vz, suspension.deflection, suspension.velocity [m, m/s], body.az [m/s2], actuator.force [N].
Command: number of the state that it answers, desired force [N]. The controller speaks first (state 0); a state with the
number 0 ends the talk. An answer that is not there WAIT after its state comes too late: the last force is held, and
after HOLD without an answer it is zero.
"""

from __future__ import annotations

import argparse
import math
import select
import socket
import struct
import time
from dataclasses import dataclass
from pathlib import Path

from hmmwv_corner import corner

from cosim import Record, Recording, Simulation

STATE, COMMAND = struct.Struct("<Q9d"), struct.Struct("<Qd")
SENT = (
    "car.body.z",
    "car.body.vz",
    "car.wheel.z",
    "car.wheel.vz",
    "car.suspension.deflection",
    "car.suspension.velocity",
    "car.body.az",
    "actuator.force",
)
FORCE = "tracking.force.desired"
WAIT, HOLD, GREETING = 0.4e-3, 50e-3, 20.0  # s
RATE = 1000  # steps per second


@dataclass
class Link:
    """A socket to one controller, and what became of its answers."""

    socket: socket.socket
    peer: tuple[str, int]
    force: float = 0.0
    answered: int = 0  # number of the newest state that was answered
    in_time: int = 0
    late: int = 0
    odd: int = 0  # neither from the controller nor a command

    def exchange(self, step: int, values: list[float]) -> float:
        """Send a state and wait for its answer; returns the force that counts now."""
        self.socket.sendto(STATE.pack(step, step / RATE, *values), self.peer)
        until = time.perf_counter() + WAIT
        while self.answered < step and (left := until - time.perf_counter()) > 0:
            if select.select([self.socket], [], [], left)[0]:
                self._receive(step)
        if step - self.answered > HOLD * RATE:
            self.force = 0.0
        return self.force

    def _receive(self, step: int) -> None:
        try:
            data, sender = self.socket.recvfrom(64)
        except ConnectionError:  # Windows tells here that the controller has gone
            return
        number, force = COMMAND.unpack(data) if len(data) == COMMAND.size else (0, math.nan)
        if sender != self.peer or not 0 < number <= step or not math.isfinite(force):
            self.odd += 1
            return
        self.late += number < step
        self.in_time += number == step
        if number > self.answered:  # packets may overtake each other
            self.answered, self.force = number, force

    def text(self, steps: int) -> str:
        lost = steps - self.in_time - self.late
        return f"{steps} states: {self.in_time} answered in time, {self.late} late, {lost} lost; {self.odd} odd packets"


def meet(server: socket.socket) -> Link:
    """Wait for the controller's first packet."""
    server.settimeout(GREETING)
    data, peer = server.recvfrom(64)
    if len(data) != COMMAND.size:
        raise SystemExit(f"{peer} sent {len(data)} bytes; a command has {COMMAND.size}")
    server.setblocking(False)
    return Link(server, peer)


def drive(simulation: Simulation, link: Link, steps: int) -> None:
    """Real time: show where the plant is when the clock says so, then let it go on with the answer."""
    for step in range(1, steps + 1):
        simulation.advance(step / RATE, real_time=1.0)
        simulation.set(FORCE, link.exchange(step, [simulation[name] for name in SENT]))
    for _ in range(3):
        link.socket.sendto(STATE.pack(0, *[0.0] * 9), link.peer)


def repeat(recording: Recording, fmus: Path = Path("fmus/fmi3")) -> Recording:
    """The same run without clock and controller, from the forces that it recorded."""
    with corner(fmus) as system, system.initialize(record=Record([*SENT, FORCE], "1 ms")) as simulation:
        for step in range(1, len(recording)):
            simulation.advance(step / RATE)
            simulation.set(FORCE, recording[FORCE][step])
        return simulation.recording


def main() -> None:
    parser = argparse.ArgumentParser(description="a quarter car in real time, controlled over UDP")
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--host", default="127.0.0.1", help="address to listen at; 0.0.0.0 for other machines")
    parser.add_argument("--port", type=int, default=47000, help="0: any that is free; it is printed")
    parser.add_argument("--csv", type=Path, help="file of the recording")
    options = parser.parse_args()
    with corner() as system, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind((options.host, options.port))
        print(f"waiting for a controller at port {server.getsockname()[1]}", flush=True)
        with system.initialize(record=Record([*SENT, FORCE], "1 ms")) as simulation:
            link, steps = meet(server), round(options.seconds * RATE)
            drive(simulation, link, steps)
            recording = simulation.recording
    print(link.text(steps))
    print(recording.real_time)
    if options.csv:
        recording.to_csv(options.csv)


if __name__ == "__main__":
    main()
