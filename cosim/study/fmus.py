"""Which FMU files a study uses: those of a folder by name, or a user's own in their place."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from build_fmus.base import escape
from build_fmus.base.layout import FMUS, fmu_path
from cosim.fmu.prebuilt import packed


def designed_with(file: Path) -> Mapping[str, Any]:
    """Design data of the controller in an FMU, from `resources/provenance.json`."""
    with zipfile.ZipFile(file) as z:
        return dict(json.loads(z.read("resources/provenance.json")))


@dataclass(frozen=True)
class FmuSet:
    """FMU files by name.

    `vehicles`: what the user's vehicles are called, by their files. `own`: FMUs of a user's files that stand in for
    published ones or beside them: published name -> name, and the options of `build-fmus` that make it. `at`: where
    files lie on this machine that are elsewhere, by their path.
    """

    directory: Path = FMUS
    fmi: int = 3
    own: Mapping[str, tuple[str, str]] = field(default_factory=dict, hash=False)
    at: Mapping[str, str] = field(default_factory=dict, hash=False)
    vehicles: tuple[str, ...] = ()

    def results(self, out: Path, experiment: str) -> Path:
        """The folder of an experiment's results in `out`, `gpc` or with a user's vehicle `gpc-my_truck`.

        Results of different vehicles do not replace each other.
        """
        return out / "-".join((experiment, *self.vehicles))

    def name(self, published: str) -> str:
        """Name of the FMU that stands for a published one."""
        return self.own.get(published, (published, ""))[0]

    def path(self, name: str) -> Path:
        """An FMU file, by the published name, or by its path where the name ends in `.fmu`.

        Raises:
            FileNotFoundError: it is not there; the message says how to build it.
        """
        if name.endswith(".fmu"):
            if not (found := self._placed(Path(name))).is_file():
                raise FileNotFoundError(f"{name} does not exist")
            return found
        used, options = self.own.get(name, (name, ""))
        path = self._placed(fmu_path(self.directory, self.fmi, used))
        if not path.is_file() and (used, self.directory) == (name, FMUS):
            path = packed(self.fmi, name) or path
        if not path.is_file():
            raise FileNotFoundError(f"{path} does not exist: run `{self.build_command(options)}` first")
        return path

    def _placed(self, path: Path) -> Path:
        return Path(self.at.get(str(path), path))

    def paths(self, names: Iterable[str]) -> list[Path]:
        """Several FMU files: all are there, or FileNotFoundError names the first that is not."""
        return [self.path(n) for n in names]

    @property
    def own_paths(self) -> list[Path]:
        """Those files of a user's own that are there."""
        paths = {fmu_path(self.directory, self.fmi, name) for name, _ in self.own.values()}
        return sorted(p for p in paths if p.is_file())

    def build_command(self, options: str = "") -> str:
        """The command that makes the files, those of a user's files or the published ones."""
        return " ".join(["build-fmus", *([options] if options else []), "--out", escape.shell(str(self.directory))])
