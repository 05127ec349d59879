"""Terminals of FMUs of others, changed by elements and attributes and by bytes.

A case is a terminalsAndIcons.xml beside a description that is whole. What can be read is connected to itself.
"""

from __future__ import annotations

import random
from contextlib import suppress
from pathlib import Path

from cosim import CosimError, FmuError, System
from cosim.fmu.file import FmuFile
from cosim.fmu.terminals_file import FILE
from cosim.system import terminal_wires

from . import mutate, xml

ALLOWED = (CosimError,)
SEED = b"""<fmiTerminalsAndIcons fmiVersion="3.0"><Terminals>
<Terminal name="road" matchingRule="bus">
<TerminalMemberVariable variableName="u" memberName="height" variableKind="signal"/>
<Terminal name="fl" matchingRule="plug" terminalKind="wheel">
<TerminalMemberVariable variableName="y" memberName="a" variableKind="inflow"/>
<TerminalStreamMemberVariable inStreamMemberName="i" outStreamMemberName="o" inStreamVariableName="count_in"
  outStreamVariableName="count"/></Terminal></Terminal>
<Terminal name="array" matchingRule="sequence"><TerminalMemberVariable variableName="w" variableKind="signal"/>
<TerminalMemberVariable variableName="total" variableKind="outflow"/></Terminal></Terminals></fmiTerminalsAndIcons>"""


def make(rng: random.Random) -> bytes:
    way = rng.random()
    if way < 0.8:
        return xml.structure(rng, SEED)
    return mutate.several(rng, SEED, mutate.TEXTS) if way < 0.95 else xml.head(rng, SEED)


def run(case: bytes, folder: Path) -> None:
    from foreign import followers

    followers.unpacked(3, folder, followers.description(3, "Follower"))
    (folder / FILE).parent.mkdir()
    (folder / FILE).write_bytes(case)
    fmu = FmuFile(folder)
    with System() as system:
        for name in "ab":
            system.add(name, fmu, step="1 ms")
        with suppress(CosimError):  # what does not fit
            system.connect_matching("a", "b")
        try:
            paths = list(terminal_wires.of(system["a"]))
        except FmuError as error:
            if str(folder) not in str(error):
                raise AssertionError(f"the message does not name the file: {error}") from error
            raise
        for path in paths[:20]:
            with suppress(CosimError):
                system.connect_terminals(f"a.{path}", f"b.{path}")
        str(system.schedule())
