"""What all experiments share: where their FMUs are, and the refusal of a run that does not exist."""

from __future__ import annotations

import difflib
import shlex
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path


class CaseError(ValueError):
    """A run that does not exist; the message says which choice is wrong and what there is."""


def check_choice(what: str, value: str, known: Collection[str]) -> None:
    """Refuse ``value`` unless it is one of ``known``.

    Raises:
        CaseError: names the nearest choice and all of them.
    """
    if value not in known:
        near = difflib.get_close_matches(value, known, n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise CaseError(f"no {what} {value!r}{hint} (there are: {', '.join(known)})")


@dataclass(frozen=True)
class FmuSet:
    """Which FMU files an experiment uses.

    ``own``: FMUs of a user's files that stand in for published ones or beside them: published name -> name, and the options of
    ``build-fmus`` that make it.
    """

    directory: Path = Path("fmus")
    fmi: int = 3
    own: Mapping[str, tuple[str, str]] = field(default_factory=dict, hash=False)

    def path(self, name: str) -> Path:
        """An FMU file; FileNotFoundError that says how to build it."""
        used, options = self.own.get(name, (name, ""))
        path = self.directory / f"fmi{self.fmi}" / f"{used}.fmu"
        if not path.is_file():
            raise FileNotFoundError(f"{path} does not exist: run `{self.build_command(options)}` first")
        return path

    def paths(self, names: Iterable[str]) -> list[Path]:
        """Several FMU files: all are there, or FileNotFoundError names the first that is not."""
        return [self.path(n) for n in names]

    def build_command(self, options: str = "") -> str:
        """The command that makes the files, those of a user's files or the published ones."""
        return " ".join(["build-fmus", *([options] if options else []), "--out", shlex.quote(str(self.directory))])
