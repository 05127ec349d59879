"""A skyhook damper for udp_plant.py, over UDP. It needs nothing of this project, and could be written in any language.

python docs/examples/udp_controller.py
"""

from __future__ import annotations

import argparse
import socket
import struct

STATE, COMMAND = struct.Struct("<Q9d"), struct.Struct("<Qd")  # see udp_plant.py
SKY_DAMPING = 2000.0  # N.s/m, of paper 001's skyhook law
LIMIT = 8000.0  # N
SILENCE = 1.0  # s without a state: the plant is gone


def law(body_velocity: float) -> float:
    """Force [N] that damps the body as if it were tied to the sky."""
    return max(-LIMIT, min(LIMIT, -SKY_DAMPING * body_velocity))


def control(host: str, port: int) -> tuple[int, int]:
    """Answer every state until the plant ends; returns how many came, and how many were lost on the way."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.connect((host, port))
        link.settimeout(SILENCE)
        link.send(COMMAND.pack(0, 0.0))
        came, newest = 0, 0
        try:
            while True:
                data = link.recv(128)
                if len(data) != STATE.size:
                    continue
                number, _, _, body_velocity, *_ = STATE.unpack(data)
                if number == 0:
                    break
                came += 1
                if number > newest:  # an older one was overtaken
                    newest = number
                    link.send(COMMAND.pack(number, law(body_velocity)))
        except (TimeoutError, ConnectionError):
            pass
        return came, newest - came


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="a skyhook damper over UDP")
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=47000)
    options = parser.parse_args()
    came, lost = control(options.host, options.port)
    print(f"{came} states came, {lost} were lost")
