"""Fresh environments outside of the repository, with the wheel and its requirements and nothing else."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import venv
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

NAME = "suspension-fmus"
SCHEME = sysconfig.get_preferred_scheme("prefix") if os.name == "nt" else "posix_prefix"  # of a venv


@dataclass(frozen=True)
class Environment:
    """A virtual environment."""

    folder: Path

    def _path(self, kind: str) -> Path:
        return Path(sysconfig.get_path(kind, SCHEME, {"base": str(self.folder), "platbase": str(self.folder)}))

    @property
    def site(self) -> Path:
        """Its `site-packages`."""
        return self._path("purelib")

    @property
    def own(self) -> set[str]:
        """What was installed into it, leaving out what it shows of the environment of the tests."""
        return {p.name for p in self.site.iterdir() if not p.is_symlink()}

    def run(self, *command: str | Path, code: int = 0) -> str:
        """What a program of this environment prints, errors included, in the folder beside the environment."""
        program, *arguments = command
        return self._run([self._path("scripts") / program, *arguments], code)

    def execute(self, text: str, code: int = 0) -> str:
        """What some Python prints."""
        return self.run("python", "-c", text, code=code)

    def pip(self, *arguments: str | Path) -> str:
        """What the pip of the tests prints when it works on this environment."""
        pip = [sys.executable, "-m", "pip", "--python", self._path("scripts") / "python", "--disable-pip-version-check"]
        return self._run([*pip, *arguments], 0)

    def _run(self, command: list[str | Path], code: int) -> str:
        environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
        done = subprocess.run(
            command,
            cwd=self.folder.parent,
            env={**environment, "COLUMNS": "200"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
            timeout=300,
        )
        assert done.returncode == code, done.stdout
        return done.stdout


def make(folder: Path, wheel: Path, *extras: str) -> Environment:
    """An environment with the wheel in it, as `pip install 'suspension-fmus[EXTRAS]'` would make it.

    The packages that it depends on are links to those that the tests run with, because to download them takes minutes.
    Linked is what the wheel asks for by its own metadata and no more; pip then finds whether that is complete.
    """
    venv.create(folder)
    made = Environment(folder)
    made.pip("install", "--quiet", "--no-deps", "--no-index", wheel)
    (installed,) = metadata.distributions(name=NAME, path=[str(made.site)])
    for name in sorted(_needed(installed, set(extras))):
        distribution = metadata.distribution(name)
        for top in {f.parts[0] for f in distribution.files or () if f.parts[0] not in ("..", "__pycache__")}:
            if not (made.site / top).exists():
                (made.site / top).symlink_to(Path(str(distribution.locate_file(top))).resolve())
    assert "No broken requirements" in made.pip("check")
    return made


def _needed(installed: metadata.Distribution, extras: set[str]) -> set[str]:
    """Distributions that an installed one asks for with some extras, directly or not."""
    todo = [(NAME, frozenset(extras))]
    seen: set[tuple[str, frozenset[str]]] = set()
    while todo:
        name, with_extras = todo.pop()
        if (name, with_extras) in seen:
            continue
        seen.add((name, with_extras))
        one = installed if name == NAME else metadata.distribution(name)
        for requirement in map(Requirement, one.requires or ()):
            if requirement.marker is None or any(requirement.marker.evaluate({"extra": e}) for e in ("", *with_extras)):
                todo.append((canonicalize_name(requirement.name), frozenset(requirement.extras)))
    return {name for name, _ in seen} - {NAME}
