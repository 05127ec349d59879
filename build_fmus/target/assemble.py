"""One C file and one header of a sampled component, assembled from the sources of its FMU.

The files of an FMU are separate translation units. In one file their names meet: macros of a file end with it, names
that several files define for themselves get the name of the file in front, and what is visible to other files gets
the name of the component in front, so that several components go into one firmware.
"""

from __future__ import annotations

import posixpath
import re
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from build_fmus import generate
from build_fmus.base.escape import c_comment
from build_fmus.component import Model
from build_fmus.equations.names import identifier
from build_fmus.mathematics import copyright_notice
from build_fmus.qp_solve import CompiledPrograms
from build_fmus.qp_sources import license_file
from build_fmus.target.single import MATHEMATICS, exact_time, to_single

_INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*"([^"]+)"')
COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
RENAMED = re.compile(r"^#define (\w+) (\w+_\1)$", re.MULTILINE)
_STATIC = re.compile(r"^static\b([^;{(=]*)([;{(=\[])([^;{]*)", re.MULTILINE)
_TYPE = re.compile(r"^(?:typedef struct \{.*?^\} (\w+);|struct (\w+) \{)", re.MULTILINE | re.DOTALL)
_MACRO = re.compile(r"^[ \t]*#[ \t]*define[ \t]+(\w+)", re.MULTILINE)
_ROLES = (("parameters", "p", "parameter"), ("inputs", "u", "input"), ("outputs", "y", "output"))
_STATUS = {
    "OK": "the step or the change is done",
    "NOT_FINITE": "an input or a value is NaN or infinite; nothing has changed",
    "OUT_OF_RANGE": "a value is outside its range; nothing has changed",
    "NOT_TUNABLE": "this parameter can be set before the first step only",
    "UNKNOWN_PARAMETER": "there is no such parameter or element",
    "BAD_PARAMETERS": "the parameters contradict each other; the first step needs others",
    "FAILED": "a result was not finite; only init helps",
}


class TargetError(ValueError):
    """A component that cannot become a library, or a library that breaks a rule."""


@dataclass(frozen=True)
class Library:
    """Sources of a library.

    Attributes:
        header: text of the header.
        code: text of the C file, before `rename_externals`.
        precision: "double" or "single".
        notices: copyright notices by file name.
    """

    name: str
    header: str
    code: str
    notices: dict[str, bytes]
    precision: str = "double"


def assemble(component: Model, precision: str = "double") -> Library:
    """The C file and the header of a component.

    Raises:
        TargetError: a component that is not sampled, or one with random profiles.
    """
    if component.kind == "continuous":
        raise TargetError(f"{component.name} is continuous; --target builds sampled components (controllers, filters)")
    if component.profiles:
        raise TargetError(f"{component.name} has random road profiles, which --target does not build")
    name, functions = component.name, generate.written_functions(component)
    model = generate.generate_c(component, arrays=True, token="")
    for part, pointer, _ in _ROLES:
        if (struct := functions.structs.get(pointer)) is not None:
            model = model.replace(struct.definition(), f"typedef {name}_{part} {struct.name};")
    model = re.sub(r'\.(name|token) = "(?:[^"\\]|\\.)*",[ \n]?', "", model)  # firmware has no use for names
    model = re.sub(r"\A/\*.*?\*/\n", "", model, flags=re.DOTALL)
    target = (generate.RUNTIME_DIR / "target.c").read_text()
    own = {"model.c": model, "target.c": re.sub(r"\bComponent(?=_|\b)", name, target)}
    files = generate.solver_files(component) | {path: text.encode() for path, text in own.items()}
    files = generate.with_mathematics(files)
    files |= {n: (generate.RUNTIME_DIR / n).read_bytes() for n in ("equations.h", "fmu_model.h", "soft_double.h")}
    texts = {path: _changed(path, data.decode()) for path, data in files.items()}
    header = _header(component)
    if precision == "single":
        texts["target.c"] = exact_time(component) + texts["target.c"]
        stay = ("fmu_math.h", "soft_double.h", *(n for n in texts if n.startswith("musl/")))
        texts = {path: text if path in stay else to_single(text) for path, text in texts.items()}
        header = to_single(header).replace("All values are double", "All values are float")
        if component.programs:  # memory of solvers, aligned
            header = header.replace("float program_work[", "double program_work[")
        if "musl/__rem_pio2_large.c" not in texts:  # which alone calls them
            texts = {path: text for path, text in texts.items() if path not in ("musl/floor.c", "musl/ceil.c")}
    code = _one_file(component, texts, MATHEMATICS if precision == "single" else "")
    notices = {"LICENSE.txt": license_file("suspension-fmus"), "LICENSE-musl.txt": copyright_notice()}
    notices |= {f"LICENSE-{p.name}.txt": p.license for p in generate.third_party(component)}
    return Library(name, header, code, notices, precision)


@lru_cache
def third_party_changes() -> dict[str, list[tuple[str, str]]]:
    """Changes to third-party sources, by file: texts and what they become."""
    return tomllib.loads((Path(__file__).parent / "third_party.toml").read_text(encoding="utf-8"))


def _changed(path: str, text: str) -> str:
    changes = third_party_changes().get(path, [])
    for old, new in changes:
        text = text.replace(old, new)
    return f"/* Changed by suspension-fmus: explicit conversions. */\n{text}" if changes else text


def _header(component: Model) -> str:
    """The header: structs, status, functions."""
    name, structs = component.name, generate.written_functions(component).structs
    guard = f"{name.upper()}_H"
    parts = [
        f"/* {name}: {c_comment(component.description.split('. ')[0].rstrip('.'))}. Call {name}_step every"
        f" {component.sample_time:.9g} s.\n *\n"
        f" * All values are double; a Boolean is 0 or 1. An instance must not be moved after {name}_init. */",
        f"#ifndef {guard}\n#define {guard}\n\n{_EXTERN_C}",
    ]
    for part, pointer, role in _ROLES:
        struct = structs.get(pointer)
        if struct is None or not component.size(role):  # type: ignore[arg-type]
            parts.append(f"typedef struct {{\n    double none; /* there are no {part} */\n}} {name}_{part};\n")
            continue
        parts.append(struct.definition(f"{name}_{part}", "double") + "\n")
    rows = [r for r in enumerate(generate.references(component, arrays=True)) if r[1].variable.role == "parameter"]
    taken: list[str] = []
    for i, r in rows:
        taken.append(f"    {name}_PARAMETER_{identifier(r.name, taken, local=False)} = {i},")
    taken = taken or [f"    {name}_NO_PARAMETERS = -1,"]
    parts.append("\n".join(["typedef enum {", *taken, f"}} {name}_parameter;\n"]))
    status = [f"    {name}_{k}, /* {text} */" for k, text in _STATUS.items()]
    parts.append("\n".join(["typedef enum {", *status, f"}} {name}_status;\n"]))
    programs = CompiledPrograms(component).scratch_size if component.programs else 0
    numbers = {
        "states": component.size("state"),
        "next": component.size("state"),
        "checks": len(component.check_messages),
        "fixed": len(generate.written_functions(component).known),
        "work": generate.written_functions(component).n_work,
        "program_data": sum(q.n_data for q in component.programs),
        "program_solution": sum(q.n_solution for q in component.programs),
        "program_memory": sum(q.n_memory for q in component.programs),
        "program_work": -(-programs // 8),
    }
    fields = [f"    double {k}[{max(n, 1)}];" for k, n in numbers.items()]
    parts += [
        "/* An instance: read its fields, but change them by the functions only. */",
        "\n".join(
            [
                "typedef struct {",
                f"    {name}_parameters parameters;",
                f"    {name}_outputs results;",
                *fields,
                "    long long sample; /* number of samples taken */",
                "    int started, failed, prepared;",
                f"}} {name};\n",
            ]
        ),
        "/* Set all parameters and states to their start values. */",
        f"void {name}_init({name} *self);\n",
        "/* Set one element of a parameter; matrices count row by row from 0. */",
        f"{name}_status {name}_set_parameter({name} *self, {name}_parameter parameter, int element, double value);\n",
        "/* Take one sample: outputs from inputs. */",
        f"{name}_status {name}_step({name} *self, const {name}_inputs *inputs, {name}_outputs *outputs);\n",
        f"{_END_EXTERN_C}\n#endif\n",
    ]
    return "\n".join(parts)


_EXTERN_C = '#ifdef __cplusplus\nextern "C" {\n#endif\n'
_END_EXTERN_C = "#ifdef __cplusplus\n}\n#endif\n"
# C++ warns of fields that an initializer leaves at 0 by not naming them, which C does not.
_AS_C = f'#ifdef __cplusplus\n#pragma GCC diagnostic ignored "-Wmissing-field-initializers"\n#endif\n{_EXTERN_C}'


def rename_externals(library: Library, names: Iterable[str]) -> str:
    """The C file, with the component's name in front of all `names` that the linker would see."""
    own = [n for n in sorted(names) if not n.startswith((f"{library.name}_", "__aeabi_"))]
    lines = [f"#define {n} {library.name}_{n}" for n in own]
    return library.code.replace("/* RENAMED */\n", "\n".join([*lines, "", ""]) if lines else "")


def _one_file(component: Model, files: Mapping[str, str], after_musl: str) -> str:
    """All C files one after the other, headers where they are first included; `after_musl` before those not of musl."""
    sources = [n for n in files if n.endswith(".c")]
    sources.sort(key=lambda n: (n == "target.c", n == "model.c", not n.startswith("musl/"), n))
    last_of_musl = max((n for n in sources if n.startswith("musl/")), default="")
    own = {n: _own_names(files[n]) for n in sources}
    count = Counter(name for names in own.values() for name in names)
    seen: set[str] = set()
    papers = "".join(f" * {c_comment(f'{k}: {title}')}\n" for k, title in generate.cited(component).items())
    parts = [
        f"/* {component.name} for firmware. Generated from its declaration and the sources of its FMU; do not edit.\n"
        f" * Equations: {c_comment(component.source)}.\n{papers} */",
        f'#include "{component.name}.h"\n\n#include <float.h>\n#include <math.h>\n#include <stddef.h>\n'
        f"#include <stdint.h>\n#include <stdlib.h>\n#include <string.h>\n\n{_AS_C}",
        "/* RENAMED */\n"
        + _expand("fmu_math.h", files, seen)
        + _expand("soft_double.h", files, seen)
        + ("" if last_of_musl else after_musl),
    ]
    for name in sources:
        headers, body = _split(name, files, seen)
        stem = posixpath.splitext(name)[0].replace("/", "_").strip("_")
        if clashing := sorted(n for n in own[name] if count[n] > 1):  # but for fields of structs
            body = re.sub(rf"(?<![.>\w])({'|'.join(clashing)})\b", rf"{stem}_\1", body)
        after = [f"#undef {n}" for n in dict.fromkeys(_MACRO.findall(body))]
        parts.append("\n".join([f"/* {'-' * 60} {name} */", headers, body.rstrip(), *after, ""]))
        if name == last_of_musl:
            parts.append("\n".join(f"#undef {n}" for n in _MACRO.findall(files["musl/libm.h"])[1:]) + "\n")
            parts.append(after_musl)
    parts.append(_END_EXTERN_C)
    # OSQP's tables of messages are constants that it does not call so.
    return re.sub(r"const char \* ?(OSQP_\w+\[\])", r"const char *const \1", "\n".join(parts))


def _split(name: str, files: Mapping[str, str], seen: set[str]) -> tuple[str, str]:
    """The headers that a C file includes unconditionally and that are not there yet, and the rest of it."""
    headers: list[str] = []
    body: list[str] = []
    depth = 0
    for line in files[name].splitlines():
        found = _INCLUDE.match(line)
        depth += bool(re.match(r"\s*#\s*if", line)) - bool(re.match(r"\s*#\s*endif", line))
        if found and (path := _path(name, found[1], files)):
            (headers if depth == 0 else body).append(_expand(path, files, seen, keep=depth > 0))
        else:
            body.append(line)
    return "".join(headers), "\n".join(body)


def _expand(name: str, files: Mapping[str, str], seen: set[str], *, keep: bool = False) -> str:
    """A header with those that it includes; "" when it is there already, unless `keep`: its guard then empties it."""
    if name in seen:
        return ""
    if not keep:
        seen.add(name)
    guarded = _MACRO.search(files[name])
    base = 1 if guarded and re.match(r"\s*#\s*ifndef", COMMENT.sub("", files[name]).lstrip()) else 0
    lines, depth = [], 0
    for line in files[name].splitlines():
        found = _INCLUDE.match(line)
        depth += bool(re.match(r"\s*#\s*if", line)) - bool(re.match(r"\s*#\s*endif", line))
        if found and (path := _path(name, found[1], files)):
            lines.append(_expand(path, files, seen, keep=keep or depth > base))
        else:
            lines.append(line)
    return "\n".join(lines) + "\n"


def _path(name: str, included: str, files: Mapping[str, str]) -> str | None:
    beside = posixpath.normpath(posixpath.join(posixpath.dirname(name), included))
    return next((p for p in (beside, included) if p in files), None)


def _own_names(text: str) -> set[str]:
    """Names that a C file defines for itself: static functions, static data, types."""
    text = re.sub(r"=\s*\{[^{}]*\}", "= 0", COMMENT.sub(" ", text))
    names = {n for found in _TYPE.findall(text) for n in found if n}
    for head, mark, rest in _STATIC.findall(text):
        words = re.findall(r"\w+", head)
        if words:
            names.add(words[-1])
        if mark != "(":
            names |= set(re.findall(r"(?:^|,)\s*(\w+)\s*(?:\[[^\]]*\]\s*)*=", rest, re.MULTILINE))
    return names
