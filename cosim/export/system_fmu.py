"""A whole system as one FMU: the engine, the plan of the exchange and all components in one archive."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from pathlib import Path

from build_fmus import description_xml as base
from build_fmus import licenses, related
from build_fmus.base import safe_files
from build_fmus.base.archives import zipped
from build_fmus.compile import CompileError, ObjectCache, Platform, find_toolchain, resolve_platforms
from build_fmus.icon import icon_png
from cosim.core.errors import CosimError
from cosim.engine.loops import RepeatedStep
from cosim.export import description_xml
from cosim.export.code import SystemCode, template
from cosim.export.parts import shown
from cosim.export.variables import choose
from cosim.system.components import SystemComponent
from cosim.system.schedule import Schedule

_DEFAULT_STOP = 10.0


def export_fmu(
    schedule: Schedule,
    path: str | Path,
    *,
    inputs: str | Iterable[str] | None = None,
    outputs: str | Iterable[str] | None = None,
    parameters: str | Iterable[str] | None = "*",
    fmi: int = 3,
    platforms: str = "host",
    text: str = "",
    repeated: Mapping[SystemComponent, RepeatedStep] | None = None,
) -> Path:
    """Write the system of a schedule as one FMU; see `System.export_fmu`.

    `repeated`: components of its algebraic loops whose steps are repeated.

    Raises CosimError and WiringError for systems that cannot be exported, CompileError without a compiler.
    """
    path = Path(path)
    name = path.stem
    if path.suffix != ".fmu" or not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
        raise CosimError(
            f"{path}: name the file IDENTIFIER.fmu, with letters, digits and _ only; it is the model's name too"
        )
    if fmi not in (2, 3):
        raise CosimError(f"there is no FMI {fmi}: choose 2 or 3")
    try:
        chosen = resolve_platforms(platforms)
    except CompileError as error:
        raise CosimError(str(error)) from None
    variables = choose(schedule, inputs, outputs, parameters)
    exporter = _Exporter(SystemCode(name, schedule, variables, fmi, repeated=repeated), text)
    with safe_files.named(path):
        return safe_files.write(path, exporter.archive(chosen))


class _Exporter:
    """One export; the archive is made of what it derives from the schedule."""

    def __init__(self, code: SystemCode, text: str):
        self.code, self.name, self.schedule, self.variables, self.fmi = (
            code,
            code.name,
            code.schedule,
            code.variables,
            code.fmi,
        )
        self.parts, self.distinct = code.parts, code.distinct
        self.facts = self._facts(text)

    def _facts(self, text: str) -> description_xml.Facts:
        components = self.schedule.components
        about = [m.description for m in components]
        stops = [float(a.default_stop) for a in about if a.default_stop is not None]
        listed = ", ".join(f"{m.name} ({m.description.name})" for m in components)
        discrete = not self.schedule.continuous
        return description_xml.Facts(
            name=self.name,
            text=text or f"A system of {len(components)} FMUs: {listed}",
            kind="discrete" if discrete else "continuous",
            step=self.schedule.tick if discrete else min(m.step for m in components),
            stop_time=max(stops, default=_DEFAULT_STOP),
            can_save=self.code.can_save,
            can_serialize=all(a.can_save and a.can_serialize for a in about),
            only_once=any(a.only_once for a in about),
            needs_tool=any(a.needs_tool for a in about),
        )

    # The archive.

    def archive(self, platforms: Sequence[Platform]) -> bytes:
        self._check_platforms(platforms)
        carried = [p for p in self.distinct if not p.linked]
        files = self.code.files(platforms[0].name if platforms else "")
        c_files = self.code.c_files(files)
        token = self._token(files)
        files["plan.c"] = self.code.plan_c(token).encode()
        content = {f"sources/{name}": data for name, data in files.items()}
        content["modelDescription.xml"] = self._description(token, c_files)
        with safe_files.scratch_files(files) as folder:
            paths, cache = [folder / n for n in c_files], ObjectCache.of_user()
            compilers = {}
            for p in platforms:
                path = f"binaries/{p.fmi2_name if self.fmi == 2 else p.name}/{self.name}{p.suffix}"
                compilers[path] = find_toolchain(p.name)
                library = cache.library(compilers[path], paths, [folder], self.name, loads=bool(carried))
                content[path] = library.read_bytes()
        for part in self.distinct:
            content |= {f"resources/{n}": d for n, d in part.resource_files().items()}
            content |= {f"{licenses.FOLDER}/{n}": d for n, d in part.licenses().items()}
        content["resources/components.json"] = shown(self.distinct).encode()
        content["documentation/schedule.txt"] = f"{self.schedule}\n".encode()
        content["documentation/index.html"] = self._page().encode()
        parts = self._licensed(files, content)
        content |= self._licenses(parts, content)
        icon = icon_png(self.facts.kind)
        if self.fmi == 2:
            content["model.png"] = icon
        else:
            content["sources/buildDescription.xml"] = base.build_description(self.name, c_files)
            content["terminalsAndIcons/icon.png"] = icon
        components = [related.component(p.name, p.files) for p in self.distinct]
        content |= related.files(self.name, content, parts, compilers, components=components)
        return zipped(content)

    def _check_platforms(self, platforms: Sequence[Platform]) -> None:
        """Third-party FMUs have libraries for some platforms only."""
        for m, part in self.parts.items():
            there = set(part.platforms())
            missing = [p.name for p in platforms if (p.fmi2_name if part.version == 2 else p.name) not in there]
            if missing and not part.linked:
                raise CosimError(
                    f"'{m.name}' ({part.fmu.path}) has no library for {', '.join(missing)}, only for"
                    f" {', '.join(sorted(there))}"
                )

    def _token(self, files: dict[str, bytes]) -> str:
        """A hash of all that determines behavior and interface."""
        digest = hashlib.sha256()
        carried = [p.resource_files() for p in self.distinct if not p.linked]
        for content in (files, *carried):
            for name, data in sorted(content.items()):
                digest.update(name.encode() + b"\0" + data + b"\0")
        digest.update(self.code.plan_c("").encode() + self._description("", []))
        h = digest.hexdigest()
        return f"{{{h[:8]}-{h[8:12]}-{h[12:16]}-{h[16:20]}-{h[20:32]}}}"

    def _description(self, token: str, c_files: Sequence[str]) -> bytes:
        return description_xml.model_description(
            self.fmi, self.facts, self.schedule, self.variables, token=token, sources=c_files
        )

    @staticmethod
    def _licensed(files: dict[str, bytes], content: dict[str, bytes]) -> list[licenses.Part]:
        """Work of others in the system's own files."""
        own = {n: d for n, d in files.items() if "/" not in n or n.startswith("musl/")}
        parts = licenses.of_sources(own, [], uses_casadi=False)
        return parts + licenses.of_windows(n for n in content if n.endswith(".dll") and n.startswith("binaries/"))

    def _licenses(self, parts: list[licenses.Part], content: dict[str, bytes]) -> dict[str, bytes]:
        """License files: the entry point and the texts for the system's own files; components have own folders."""
        texts = licenses.texts(self.name, parts)
        folders = sorted(
            {
                n.removeprefix(f"{licenses.FOLDER}/").split("/")[0]
                for p in self.distinct
                for n in content
                if n.startswith(f"{licenses.FOLDER}/{p.name}/")
            }
        )
        if folders:
            more = (
                "\nThe components of the system have theirs in the folders beside this file: "
                + ", ".join(folders)
                + "\n"
            )
            texts[licenses.ENTRY] += more.encode()
        return texts

    def _page(self) -> str:
        return template("system.html").render(
            facts=self.facts,
            fmi=f"{self.fmi}.0",
            schedule=str(self.schedule),
            components=self.schedule.components,
            parts=self.parts,
            variables=self.variables,
            tick=self.schedule.tick,
            inf=math.inf,
            version=metadata.version(base.TOOL),
        )
