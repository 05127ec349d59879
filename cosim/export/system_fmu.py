"""A whole system as one FMU: the engine, the plan of the exchange and all members in one archive."""

from __future__ import annotations

import hashlib
import json
import math
import re
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import fmpy

from build_fmus import description as base
from build_fmus import extras, generate, licences, package, related, safe_files
from build_fmus.compile import ObjectCache, Platform, find_toolchain, host, resolve_platforms
from build_fmus.icon import icon_png
from cosim.engine.plan import MemberPlan, Plan, make_plan
from cosim.errors import CosimError, WiringError
from cosim.export import description
from cosim.export.parts import Part, part_of, shown
from cosim.export.variables import Exported, choose
from cosim.fmu.component import FmuComponent
from cosim.fmu.environment import HEADER as ENVIRONMENT
from cosim.fmu.transfers import Arrangement, arrangements, by_reference
from cosim.master.exchange import Exchange
from cosim.system.members import Group, Member
from cosim.system.schedule import Schedule, make_schedule
from cosim.system.wiring import Wiring

with extras.needed("build", extras.BUILDING):
    import jinja2

_HERE = Path(__file__).parent
_RUNTIME = _HERE / "runtime"
_ENGINE = _HERE.parent / "engine"
_OWN = (
    *(_RUNTIME / n for n in ("container.c", "member.c", "member.h", "system.h")),
    *(_ENGINE / n for n in ("engine.c", "engine.h")),
    ENVIRONMENT,
    *(generate.RUNTIME_DIR / n for n in ("fmu_base.c", "fmu_base.h", "fmu_core.h", "fmu_model.h")),
)
_FOREIGN = _RUNTIME / "foreign.c"
_KINDS = {"Real": "FLOAT64", "Integer": "INT32"}
_ENUMERATION = {2: "INT32", 3: "INT64"}
_ROLES = {"parameter": "FMU_PARAMETER", "input": "FMU_INPUT", "output": "FMU_OUTPUT"}
_TYPES = {"Float64": "FMU_FLOAT64", "Int32": "FMU_INT32", "Boolean": "FMU_BOOLEAN"}
_BYTES = 8  # of one value in a buffer, whatever its type
_DEFAULT_STOP = 10.0


def export_fmu(
    wiring: Wiring,
    path: str | Path,
    *,
    inputs: str | Iterable[str] | None = None,
    outputs: str | Iterable[str] | None = None,
    parameters: str | Iterable[str] | None = "*",
    without: Iterable[str] = (),
    fmi: int = 3,
    platforms: str = "host",
    text: str = "",
) -> Path:
    """Write a system as one FMU; see `System.export_fmu`. Raises CosimError and WiringError for what cannot be in it, CompileError
    without a compiler."""
    path = Path(path)
    name = path.stem
    if path.suffix != ".fmu" or not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
        raise CosimError(
            f"{path}: name the file IDENTIFIER.fmu, with letters, digits and _ only; it is the model's name too"
        )
    if fmi not in (2, 3):
        raise CosimError(f"there is no FMI {fmi}: choose 2 or 3")
    schedule = _schedule(wiring, without)
    variables = choose(schedule, inputs, outputs, parameters)
    exporter = _Exporter(name, schedule, variables, fmi, text)
    with safe_files.named(path):
        return safe_files.write(path, exporter.archive(resolve_platforms(platforms)))


def _schedule(wiring: Wiring, without: Iterable[str]) -> Schedule:
    """The schedule of what is exported: without some members, and without the connections to and from them."""
    left_out = {wiring.members[name] for name in without}
    members = [m for m in wiring.members.values() if m not in left_out]
    for m in members:
        if not isinstance(m.component, FmuComponent):
            raise CosimError(
                f"'{m.name}' is written in Python, and an FMU holds FMUs only: leave it out (without=['{m.name}']), or declare it as "
                "a component that build-fmus makes an FMU of"
            )
        if m.component.in_event_mode and m.component.description.kind is None:
            raise CosimError(
                f"'{m.name}' has clocks, which a system's FMU does not tick: leave it out (without=['{m.name}'])"
            )
    connections = [c for c in wiring.connections.values() if not {c.source, c.target} & left_out]
    groups = [Group(g.name, tuple(m for m in g.members if m not in left_out), g.method) for g in wiring.groups.values()]
    return make_schedule(members, connections, [g for g in groups if g.members])


@dataclass(frozen=True)
class _Start:
    """What the system sets before initialization."""

    kind: str
    reference: int
    numbers: list[str]
    text: str | None = None


class _Exporter:
    """One export; the archive is made of what it derives from the schedule."""

    def __init__(self, name: str, schedule: Schedule, variables: Sequence[Exported], fmi: int, text: str):
        self.name, self.schedule, self.variables, self.fmi = name, schedule, variables, fmi
        outputs = [(e.member, e.variable) for e in variables if e.causality == "output"]
        self.exchange = Exchange(schedule, record=outputs)
        self.plan: Plan = make_plan(self.exchange)
        self.parts = self._parts()
        self.facts = self._facts(text)

    # Its parts.

    def _parts(self) -> dict[Member, Part]:
        """One part per FMU file, whatever number of members is made of it."""
        found: dict[tuple[str, str], Part] = {}
        parts: dict[Member, Part] = {}
        for m in self.schedule.members:
            fmu = m.component.fmu  # type: ignore[attr-defined]
            key = (str(fmu.path), fmu.description.token)
            if key not in found:
                found[key] = part_of(_identifier(fmu.description.identifier, [p.name for p in found.values()]), fmu)
            elif m.description.only_once:
                other = next(o.name for o, p in parts.items() if p is found[key])
                raise WiringError(f"'{other}' and '{m.name}' are instances of {fmu.path}, which allows one per process")
            parts[m] = found[key]
        return parts

    @property
    def distinct(self) -> list[Part]:
        return list(dict.fromkeys(self.parts.values()))

    def _facts(self, text: str) -> description.Facts:
        members = self.schedule.members
        about = [m.description for m in members]
        stops = [float(a.default_stop) for a in about if a.default_stop is not None]
        listed = ", ".join(f"{m.name} ({m.description.name})" for m in members)
        discrete = not self.schedule.continuous
        return description.Facts(
            name=self.name,
            text=text or f"A system of {len(members)} FMUs: {listed}",
            kind="discrete" if discrete else "continuous",
            step=self.schedule.tick if discrete else min(m.step for m in members),
            stop_time=max(stops, default=_DEFAULT_STOP),
            can_save=all(a.can_save for a in about),
            can_serialize=all(a.can_save and a.can_serialize for a in about),
            only_once=any(a.only_once for a in about),
            needs_tool=any(a.needs_tool for a in about),
        )

    # The archive.

    def archive(self, platforms: Sequence[Platform]) -> bytes:
        self._check_platforms(platforms)
        carried = [p for p in self.distinct if not p.linked]
        cache = ObjectCache.of_user("export")
        files = self._sources(cache, platforms)
        c_files = sorted(
            ["plan.c", *(n for n in files if n.endswith(".c") and ("/" not in n or n.startswith("musl/")))]
        )
        token = self._token(files)
        files["plan.c"] = self._plan_c(token).encode()
        content = {f"sources/{name}": data for name, data in files.items()}
        content["modelDescription.xml"] = self._description(token, c_files)
        with tempfile.TemporaryDirectory() as tmp, safe_files.named(tmp):
            _write(Path(tmp), files)
            paths = [Path(tmp) / n for n in c_files]
            compilers = {}
            for platform in platforms:
                folder = platform.fmi2_name if self.fmi == 2 else platform.name
                path = f"binaries/{folder}/{self.name}{platform.suffix}"
                compilers[path] = find_toolchain(platform.name)
                library = cache.library(compilers[path], paths, [Path(tmp)], self.name, loads=bool(carried))
                content[path] = library.read_bytes()
        for part in self.distinct:
            content |= {f"resources/{n}": d for n, d in part.resource_files().items()}
            content |= {f"{licences.FOLDER}/{n}": d for n, d in part.licences().items()}
        content["resources/members.json"] = shown(self.distinct).encode()
        content["documentation/schedule.txt"] = f"{self.schedule}\n".encode()
        content["documentation/index.html"] = self._page().encode()
        parts = self._licensed(files, content)
        content |= self._licences(parts, content)
        icon = icon_png(self.facts.kind)
        if self.fmi == 2:
            content["model.png"] = icon
        else:
            content["sources/buildDescription.xml"] = base.build_description(self.name, c_files)
            content["terminalsAndIcons/icon.png"] = icon
        members = [related.member(p.name, p.files) for p in self.distinct]
        content |= related.files(self.name, content, parts, compilers, members=members)
        return package.archive(content)

    def _check_platforms(self, platforms: Sequence[Platform]) -> None:
        """FMUs of others have libraries for some platforms only."""
        for m, part in self.parts.items():
            there = set(part.platforms())
            missing = [p.name for p in platforms if (p.fmi2_name if part.version == 2 else p.name) not in there]
            if missing and not part.linked:
                raise CosimError(
                    f"'{m.name}' ({part.fmu.path}) has no library for {', '.join(missing)}, only for {', '.join(sorted(there))}"
                )

    def _sources(self, cache: ObjectCache, platforms: Sequence[Platform]) -> dict[str, bytes]:
        """All C files and headers but plan.c, by path below `sources/`."""
        linked = [p for p in self.distinct if p.linked]
        files = {p.name: p.read_bytes() for p in _OWN}
        if len(linked) < len(self.distinct):
            files[_FOREIGN.name] = _FOREIGN.read_bytes()
        files[f"fmi{self.fmi}.c"] = (generate.RUNTIME_DIR / f"fmi{self.fmi}.c").read_bytes()
        headers = Path(fmpy.__file__).parent / "c-code"
        files |= {n: (headers / n).read_bytes() for version in (2, 3) for n in package.FMI_HEADERS[version]}
        files = generate.with_mathematics(files)
        toolchain = find_toolchain(platforms[0].name if platforms else host())
        for part in linked:
            own = part.sources()
            with tempfile.TemporaryDirectory() as tmp, safe_files.named(tmp):
                _write(Path(tmp), own)
                names = part.names(Path(tmp) / part.name, toolchain, cache)
            files |= own | part.wrappers(names)
        return dict(sorted(files.items()))

    def _token(self, files: dict[str, bytes]) -> str:
        """A hash of all that determines behaviour and interface."""
        digest = hashlib.sha256()
        carried = [p.resource_files() for p in self.distinct if not p.linked]
        for content in (files, *carried):
            for name, data in sorted(content.items()):
                digest.update(name.encode() + b"\0" + data + b"\0")
        digest.update(self._plan_c("").encode() + self._description("", []))
        h = digest.hexdigest()
        return f"{{{h[:8]}-{h[8:12]}-{h[12:16]}-{h[16:20]}-{h[20:32]}}}"

    def _description(self, token: str, c_files: Sequence[str]) -> bytes:
        return description.model_description(
            self.fmi, self.facts, self.schedule, self.variables, token=token, sources=c_files
        )

    @staticmethod
    def _licensed(files: dict[str, bytes], content: dict[str, bytes]) -> list[licences.Part]:
        """Work of others in the system's own files."""
        own = {n: d for n, d in files.items() if "/" not in n or n.startswith("musl/")}
        parts = licences.of_sources(own, [], uses_casadi=False)
        return parts + licences.of_windows(n for n in content if n.endswith(".dll") and n.startswith("binaries/"))

    def _licences(self, parts: list[licences.Part], content: dict[str, bytes]) -> dict[str, bytes]:
        """The entry point, and the texts of what the system's own files hold; those of members are in folders of their own."""
        texts = licences.texts(self.name, parts)
        folders = sorted(
            {
                n.removeprefix(f"{licences.FOLDER}/").split("/")[0]
                for p in self.distinct
                for n in content
                if n.startswith(f"{licences.FOLDER}/{p.name}/")
            }
        )
        if folders:
            more = (
                "\nThe members of the system have theirs in the folders beside this file: " + ", ".join(folders) + "\n"
            )
            texts[licences.ENTRY] += more.encode()
        return texts

    def _page(self) -> str:
        return _template("system.html").render(
            facts=self.facts, fmi=f"{self.fmi}.0", schedule=str(self.schedule), members=self.schedule.members, parts=self.parts,
            variables=self.variables, tick=self.schedule.tick, inf=math.inf, version=metadata.version(base.TOOL),
        )  # fmt: skip

    # plan.c.

    def _plan_c(self, token: str) -> str:
        a, _, d = self.plan.time
        buffers = _Room()
        room_u = _Room()
        members = [self._member(i, p, buffers, room_u) for i, p in enumerate(self.plan.members)]
        return _template("plan.c.j2").render(
            name=self.name, token=token, schedule=str(self.schedule), members=members, n_discrete=self.plan.n_discrete,
            linked=[p for p in self.distinct if p.linked], clocks=self.plan.clocks[:-1], owners=self._owners(),
            variables=[{"name": "time", "type": "FMU_FLOAT64", "role": "FMU_TIME", "slot": -1}, *map(self._variable, self.variables)],
            a=a, d=d, n_values=self.plan.size, n_u=room_u.used, n_buffer=buffers.used,
            n_shown=sum(len(p.show) for p in self.plan.members), can_save=self.facts.can_save,
            carried=any(not p.linked for p in self.distinct),
        )  # fmt: skip

    def _member(self, i: int, p: MemberPlan, buffers: _Room, room_u: _Room) -> dict[str, Any]:
        m, part = p.member, self.parts[p.member]
        place = self.exchange.layout.places[m]
        index = [int(k) for k in p.index]
        u = (index[0] if index else 0) if p.in_place else room_u.take(len(index))
        copies = [*p.remember, *p.show]
        return {
            "id": f"m{i}", "name": m.name, "model": m.description.name, "token": m.description.token, "version": part.version,
            "linked": part.linked, "prefix": part.prefix, "folder": part.name, "identifier": m.description.identifier,
            "resources": part.resources, "clock": p.clock, "step": _c_double(p.step), "look_before": p.look_before,
            "copies": [f"{{{c.to}, {c.source}, {c.n}}}" for c in copies], "n_remembered": len(p.remember),
            "stamp": -1 if p.stamp is None else p.stamp, "index": index, "in_place": p.in_place, "u": u,
            "scale": [] if p.scale is None else list(map(_c_double, p.scale.tolist())),
            "offset": [] if p.offset is None else list(map(_c_double, p.offset.tolist())),
            "lines": [f"{{{', '.join(map(str, line[:4]))}, {_c_double(line[4])}, {_c_double(line[5])}}}" for line in p.lines],
            "sets": [_transfer(part.version, how, buffers) for how in arrangements(part.version, place.inputs)],
            "gets": [_transfer(part.version, how, buffers) for how in arrangements(part.version, place.outputs)],
            "starts": _starts(m, part.version), "first": p.first, "n_outputs": p.n_outputs,
            "tolerance": None if m.description.tolerance is None else _c_double(m.description.tolerance),
        }  # fmt: skip

    def _variable(self, e: Exported) -> dict[str, Any]:
        layout, version = self.exchange.layout, self.parts[e.member].version
        found: dict[str, Any] = {"name": e.name, "type": _TYPES[e.type], "role": _ROLES[e.causality]}
        if e.causality == "output":
            slot, scale, offset = layout.readable[e.name]
            return {**found, "slot": slot, "scale": _c_double(scale), "shift": _c_double(offset)}
        low, high = e.limits
        return {
            **found, "slot": layout.constants.get((e.member, e.variable), -1), "kind": _kind(version, e.variable.fmi_type),
            "member": self.schedule.members.index(e.member), "reference": e.variable.reference, "tunable": e.tunable,
            "min": _c_double(low), "max": _c_double(high),
        }  # fmt: skip

    def _owners(self) -> list[str]:
        """What each of the values is."""
        names = [""] * self.plan.size
        layout = self.exchange.layout
        for slots in (layout.visible, layout.latest, layout.previous, layout.constants):
            for (member, variable), slot in slots.items():
                names[slot] = f"{member.name}.{variable.name}"
        for member, slot in layout.reached.items():
            names[slot] = f"time of {member.name}"
        return names


class _Room:
    """Places one after the other."""

    def __init__(self) -> None:
        self.used = 0

    def take(self, n: int) -> int:
        begin, self.used = self.used, self.used + n
        return begin


def _transfer(version: int, how: Arrangement, buffers: _Room) -> dict[str, Any]:
    return {
        "kind": _kind(version, how.fmi_type), "references": list(how.arrays), "n_data": how.total, "in_place": how.in_place,
        "at": int(how.place[0]), "element": how.element.tolist(), "place": how.place.tolist(), "keeps": how.keeps,
        "buffer": 0 if how.in_place else buffers.take(_BYTES * how.total),
    }  # fmt: skip


def _starts(member: Member, version: int) -> list[_Start]:
    """The values that a member starts with, whole arrays at a time."""
    variables = member.description.variables
    given = {variables[n]: v for n, v in member.values.items()}
    found = []
    for reference, elements in by_reference(given).items():
        one = elements[0]
        if one.fmi_type == "String":
            found.append(_Start("KIND_STRING", reference, [], str(given[one])))
            continue
        whole = [variables[n] for n in member.description.arrays.get(one.declared, [])] if one.size > 1 else [one]
        values = {v.index: given.get(v, v.start) for v in whole}
        missing = [v.name for v in whole if values[v.index] is None]
        if missing:
            raise WiringError(
                f"'{member.name}': set all of {one.declared}; the FMU tells no start value of {missing[0]}"
            )
        numbers = [_c_double(float(values[k])) for k in sorted(values)]
        found.append(_Start(_kind(version, one.fmi_type), reference, numbers))
    return found


def _kind(version: int, fmi_type: str) -> str:
    kind = _ENUMERATION[version] if fmi_type == "Enumeration" else _KINDS.get(fmi_type, fmi_type.upper())
    return f"KIND_{kind}"


def _c_double(x: float) -> str:
    """A number as C reads it back, to the last bit."""
    if x in (float("inf"), float("-inf")):
        return "INFINITY" if x > 0 else "-INFINITY"
    return repr(float(x))


def _c_text(text: str) -> str:
    """A C string."""
    return (
        json.dumps(text, ensure_ascii=True)
        if text.isascii()
        else '"' + "".join(_c_byte(b) for b in text.encode()) + '"'
    )


def _c_byte(b: int) -> str:
    return chr(b) if 32 <= b < 127 and chr(b) not in '"\\?' else f"\\{b:03o}"


def _identifier(name: str, taken: Sequence[str]) -> str:
    """A name for an FMU in the library of another one."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    return next(n for n in (plain, *(f"{plain}_{k}" for k in range(2, len(taken) + 3))) if n not in taken)


def _write(folder: Path, files: dict[str, bytes]) -> None:
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)


def _template(name: str) -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("cosim.export", "templates"), autoescape=name.endswith(".html"), trim_blocks=True,
        lstrip_blocks=True, undefined=jinja2.StrictUndefined,
    )  # fmt: skip
    environment.filters["c"] = _c_text
    return environment.get_template(name)
