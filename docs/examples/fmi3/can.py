"""Three ECUs on a CAN bus, by FMI-LS-BUS: the frame with the lowest identifier is sent first.

    python docs/examples/fmi3/can.py

All of them want to send at 1 ms. A frame with 8 bytes has 108 bits, which take 216 us at 500 kbit/s.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from small_fmu import Variable, build, number

from cosim import Recording, System

CAN = 'application/org.fmi-standard.fmi-ls-bus.can; version="1.0.0"'


def channel(name: str, reference: int, rx: int, tx: int) -> list[Variable]:
    """The four variables of a connection to a bus, from two value references of data and two of clocks on."""
    data = {"variability": "discrete", "mimeType": CAN, "maxSize": "2048"}
    triggered = {"intervalVariability": "triggered", "variability": "discrete"}
    return [
        (f"{name}.Rx_Data", "Binary", reference, {"causality": "input", "start": "", "clocks": str(rx), **data}),
        (f"{name}.Tx_Data", "Binary", reference + 1, {"causality": "output", "clocks": str(tx), **data}),
        (f"{name}.Rx_Clock", "Clock", rx, {"causality": "input", **triggered}),
        (f"{name}.Tx_Clock", "Clock", tx, {"causality": "output", **triggered}),
    ]


NODE = [
    number("value", "Float64", 0, "input", "0"),
    number("period", "Float64", 1, "parameter", "0"),
    number("first", "Float64", 2, "parameter", "0.001"),
    number("id", "UInt32", 3, "parameter", "0"),
    *channel("CanChannel", 4, 6, 7),
    number("received.id", "UInt32", 8, "output"),
    number("received.value", "Float64", 9, "output"),
    number("received.time", "Float64", 10, "output"),
    number("received.count", "UInt32", 11, "output"),
    number("confirmed.time", "Float64", 12, "output"),
    number("confirmed.count", "UInt32", 13, "output"),
]
BUS = [
    number("baud_rate", "UInt32", 0, "parameter", "500000"),
    number("frames", "UInt32", 1, "output"),
    number("lost", "UInt32", 2, "output"),
    *(v for k in range(3) for v in channel(f"Node{k + 1}", 10 + 4 * k, 12 + 4 * k, 13 + 4 * k)),
]


def network(folder: Path, identifiers: dict[str, int], step: str = "0.1 ms") -> System:
    """Up to three nodes, each sending 10 times its identifier every 10 ms, and their bus."""
    node = build("can_node", NODE, folder, ["CanChannel"])
    bus = build("can_bus", BUS, folder, ["Node1", "Node2", "Node3"])
    system = System(allow_unconnected=True)
    system.add("bus", bus, step=step)
    for k, (name, identifier) in enumerate(identifiers.items(), start=1):
        start = {"value": 10.0 * identifier}
        system.add(name, node, step=step, start=start, parameters={"id": identifier, "period": 0.01})
        system.connect_terminals(f"{name}.CanChannel", f"bus.Node{k}")
    return system


def frames(recording: Recording, name: str) -> list[tuple[int, float, float]]:
    """Frames that a node received: identifier, value and time [s]."""
    columns = [recording[f"{name}.received.{what}"].tolist() for what in ("count", "id", "value", "time")]
    found = {int(count): (int(i), value, time) for count, i, value, time in zip(*columns, strict=True) if count}
    return list(found.values())


def main() -> None:
    """Print what each ECU receives in 5 ms."""
    with tempfile.TemporaryDirectory() as folder:
        system = network(Path(folder), {"brake": 0x20, "engine": 0x10, "body": 0x30})
        with system:
            recording = system.run(0.005)
    for name in ("brake", "engine", "body"):
        for identifier, value, time in frames(recording, name):
            print(f"{name} received {value:g} from {identifier:#x} at {1e6 * time:.0f} us")


if __name__ == "__main__":
    main()
