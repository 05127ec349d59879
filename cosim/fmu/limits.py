"""How big an FMU may be before anything of it is unpacked, parsed or made."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace

from build_fmus.base import surface
from build_fmus.base.checks import unknown
from cosim.core.errors import FmuError


@dataclass(frozen=True)
class Limits:
    """Limits of an FMU; one that exceeds a limit is rejected with an error that names it.

    The defaults keep opening any file below 300 MB of memory and 5 s. Raise the limit that a large FMU needs:
    `Fmu("large.fmu", limits=Limits(variables=1_000_000))`.
    """

    xml_bytes: int = 24 * 2**20
    """bytes of modelDescription.xml"""
    xml_nodes: int = 600_000
    """elements and attributes in modelDescription.xml, counted by their signs < and ="""
    variables: int = 200_000
    """scalar variables and elements of arrays"""
    dimensions: int = 16
    """dimensions of one array"""
    dependencies: int = 1_000_000
    """names in all lists of dependencies together"""
    files: int = 65_536
    """files in the archive"""
    unpacked_bytes: int = 2**28
    """bytes of all files, unpacked; an archive that is large itself may have a hundred times its own size"""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not isinstance(value, int) or isinstance(value, bool) or value < 1:
                raise FmuError(f"Limits: {field.name} is {value!r}; a limit is a whole number of at least 1")

    @classmethod
    def of(cls, given: Iterable[str]) -> Limits:
        """Limits from texts `NAME=NUMBER`. Raises FmuError."""
        chosen: dict[str, int] = {}
        known = [field.name for field in fields(cls)]
        for text in given:
            name, _, number = text.partition("=")
            if name not in known:
                raise FmuError(unknown("limit", name, known))
            try:
                chosen[name] = int(number)
            except ValueError:
                raise FmuError(f"limit {name} is {number[:40]!r}, which is not a whole number") from None
        return replace(cls(), **chosen)

    def check(self, name: str, value: int, what: str) -> None:
        """Raise FmuError when `value`, which `what` tells of, is beyond the limit of that name."""
        limit = getattr(self, name)
        if value > limit:
            raise FmuError(f"{what}; {self.remedy(name, value)}")

    def remedy(self, name: str, value: int) -> str:
        """What to do about a value beyond the limit of that name."""
        more = surface.hint(shell=f"--limit {name}={value}") or f"Limits({name}={value})"
        return f"at most {getattr(self, name)} are allowed; {more} raises the limit"
