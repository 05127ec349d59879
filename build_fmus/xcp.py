"""Measurement and calibration of an FMU (FMI-LS-XCP 1.0): A2L files and the manifest below `extra/`.

The first instance of a process has its values in the binary of the FMU, so they have addresses relative to it, and an
importer reads and writes them by an XCP service of its own ("external XCP service", `supportsDirectMemoryAccess`). The
FMU has no XCP service, no port and no thread. The standard wants such an FMU to be instantiated once only.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath

from build_fmus import related
from build_fmus.component import Model
from build_fmus.generate import FIRST_INSTANCE, MARK
from build_fmus.target.a2l import Place, a2l

NAME = "org.fmi-standard.fmi-ls-xcp"
FOLDER = f"extra/{NAME}"
VERSION = "1.0.0"
_DESCRIPTION = (  # prescribed
    "Layered standard based on FMI 2.0 and FMI 3.0 for describing and implementing XCP support for FMUs, which can"
    " either provide an XCP service or allow direct memory access via A2L files."
)
_PREPARED = 20  # bytes before this field of FmuFirstInstance (fmu_model.h)
_VALUES = 24 + 7 * 8  # bytes before the parameters: FmuFirstInstance and the head of the state
# Commands take at most 8 bytes, answers 8: the importer replaces this by what its service has.
_INTERFACE = """/begin IF_DATA XCP
  /begin PROTOCOL_LAYER
    0x0100 1000 200 0 0 0 0 0 8 8 BYTE_ORDER_MSB_LAST ADDRESS_GRANULARITY_BYTE
  /end PROTOCOL_LAYER
  /begin XCP_ON_UDP_IP
    0x0100 5555 ADDRESS "127.0.0.1"
  /end XCP_ON_UDP_IP
/end IF_DATA"""
_HELP = """Measurement and calibration of {name} (FMI-LS-XCP 1.0)

{folder} has an A2L file for each binary of this FMU. Addresses are
relative to the base address of the binary, and are those of the first instance of a process: instantiate the FMU once.
The FMU has no XCP service. The importer brings one, replaces IF_DATA XCP by that of its service, and serves requests
between communication steps. After a change of parameters in memory, write 0 to "prepared"; the next sample takes them.
Limits are then checked by the tool only. Booleans and integers are numbers in double precision, too.
{name}.a2l beside the manifest is for binaries that are built from the sources: it has symbol links, but no addresses.
"""


def files(component: Model, content: Mapping[str, bytes]) -> dict[str, bytes]:
    """The files of a sampled component's FMU by their path in the archive; none for a continuous component.

    Args:
        component: of the FMU.
        content: the other files of the archive, among them its binaries.
    """
    if component.kind == "continuous":
        return {}
    name = f"{component.name}.a2l"
    made = {f"{FOLDER}/{name}": _a2l(component, 0)}
    for path in filter(lambda p: p.startswith("binaries/"), content):
        platform = PurePosixPath(path).parent.name
        made[f"{FOLDER}/{platform}/{name}"] = _a2l(component, address_in(content[path], MARK))
    row = {"definition": name, "supportsDirectMemoryAccess": "true"}
    made[f"{FOLDER}/fmi-ls-manifest.xml"] = related.manifest(
        "fmiLayeredStandardManifest", NAME, VERSION, _DESCRIPTION, "Interface", [row]
    )
    made["documentation/fmi-ls-xcp.txt"] = _HELP.format(name=component.name, folder=FOLDER).encode()
    return made


def _a2l(component: Model, address: int) -> bytes:
    first, sizes = Place(FIRST_INSTANCE, address), {r: 8 * component.size(r) for r in ("parameter", "input", "state")}
    values = first.plus(_VALUES)
    inputs = values.plus(sizes["parameter"])
    places = {
        "parameter": values,
        "input": inputs,
        "output": inputs.plus(sizes["input"] + 2 * sizes["state"]),  # states, derivatives
        "prepared": first.plus(_PREPARED),
    }
    return a2l(component, places, interface=_INTERFACE).encode("ascii")


def address_in(binary: bytes, mark: bytes) -> int:
    """Address of `mark`, relative to the base address of a shared library (ELF, PE or Mach-O of 64 bits).

    Raises:
        ValueError: it is not there exactly once, or not in what is loaded.
    """
    at = binary.find(mark)
    if at < 0 or binary.find(mark, at + 1) >= 0:
        raise ValueError(f"the binary has {mark!r} {binary.count(mark)} times, not once")
    for offset, size, address in _segments(binary):
        if offset <= at < offset + size:
            return address + at - offset
    raise ValueError(f"{mark!r} is in no segment of the binary")


def _segments(binary: bytes) -> Iterator[tuple[int, int, int]]:
    """Offset in the file, size in it and address of what is loaded."""
    if binary[:4] == b"\x7fELF":
        start, entry, count = *struct.unpack_from("<Q", binary, 32), *struct.unpack_from("<HH", binary, 54)
        for k in range(count):
            kind, _, offset, address, _, size = struct.unpack_from("<IIQQQQ", binary, start + k * entry)
            if kind == 1:  # PT_LOAD
                yield offset, size, address
    elif binary[:2] == b"MZ":
        (head,) = struct.unpack_from("<I", binary, 0x3C)
        count, optional = *struct.unpack_from("<H", binary, head + 6), *struct.unpack_from("<H", binary, head + 20)
        for k in range(count):
            address, size, offset = struct.unpack_from("<III", binary, head + 24 + optional + 40 * k + 12)
            yield offset, size, address
    elif binary[:4] == b"\xcf\xfa\xed\xfe":
        (count,), at = struct.unpack_from("<I", binary, 16), 32
        for _ in range(count):
            command, length = struct.unpack_from("<II", binary, at)
            if command == 0x19:  # LC_SEGMENT_64; a library's first one has address 0
                address, _, offset, size = struct.unpack_from("<QQQQ", binary, at + 24)
                yield offset, size, address
            at += length
