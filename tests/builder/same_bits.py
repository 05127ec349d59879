"""The generated C functions of a component, compared bit by bit with CasADi's own code of the same functions."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path

import numpy as np
from built import OBJECTS

from build_fmus import generate
from build_fmus.compile import CFLAGS, find_toolchain, host
from build_fmus.component import Model
from build_fmus.equations.casadi_code import casadi_code
from build_fmus.mathematics import math_files

# Field of FmuModel, function of the component, results of that one in the order of the field's
PAIRS = {
    "outputs": ("out", (0,)),
    "derivatives": ("rhs", (0,)),
    "directional": ("fwd", (0, 1)),
    "jacobian": ("jac", (0, 1)),
    "sample": ("tick", (1, 0)),
    "program_data": ("programs", (0,)),
    "checks": ("check", (0,)),
}
CALLS = """
void ours(int which, const FmuArguments *at, double *result, double *second) {
    switch (which) {
%s
    }
}

void theirs(int which, const FmuArguments *at, double *result, double *second) {
    static double w[%d];
    static int iw[%d];
    (void)second;
    switch (which) {
%s
    }
}
"""


_VECTORS = ("x", "u", "p", "f", "s", "dx", "du", "dp", "w")


class _Arguments(ctypes.Structure):
    _fields_ = (("t", ctypes.c_double), *((n, ctypes.POINTER(ctypes.c_double)) for n in _VECTORS))


def differences(component: Model, folder: Path, *, points: int = 40, seed: int = 1) -> list[str]:
    """Results that differ from those of CasADi's code in any bit (NaN equals NaN).

    At random points and at the start values.
    """
    library = ctypes.CDLL(str(_built(component, folder)))
    rng = np.random.default_rng(seed)
    n_solutions = sum(q.n_solution for q in component.programs)
    starts = {k: component.vector(r) for k, r in (("x", "state"), ("u", "input"), ("p", "parameter"))}
    starts |= {"s": np.zeros(n_solutions), **{f"d{k}": np.zeros_like(v) for k, v in starts.items()}}
    starts["f"] = np.zeros(max(1, len(generate.written_functions(component).known)))
    starts["w"] = np.zeros(max(1, generate.written_functions(component).n_work))
    fields = generate.written_functions(component).names
    assert {"sample"} <= set(fields) if component.kind == "discrete" else {"outputs", "derivatives"} <= set(fields)
    found = []
    for point in range(points):
        scale = 10.0 ** rng.integers(-2, 3) * (point > 0)
        at = {
            k: np.where(rng.random(len(v)) < 0.8, v + scale * rng.standard_normal(len(v)), v) for k, v in starts.items()
        }
        at["w"][:] = np.nan  # nobody reads what nobody wrote
        arguments = _Arguments(rng.random(), *(_pointer(at[k]) for k in _VECTORS))
        library.ours(-1, ctypes.byref(arguments), _pointer(at["f"]), None)
        for which, (field, (name, results)) in enumerate(PAIRS.items()):
            if field not in fields:
                continue
            sizes = [component.functions[name].numel_out(k) for k in results]
            ours, theirs = ([np.zeros(max(1, n)) for n in (*sizes, 1)[:2]] for _ in range(2))
            library.ours(which, ctypes.byref(arguments), *map(_pointer, ours))
            library.theirs(which, ctypes.byref(arguments), *map(_pointer, theirs))
            for k, (a, b) in enumerate(zip(ours, theirs, strict=True)):
                wrong = np.flatnonzero((a.view(np.int64) != b.view(np.int64)) & ~(np.isnan(a) & np.isnan(b)))
                found += [f"{field}[{k}][{i}] at point {point}: {a[i]!r}, not {b[i]!r}" for i in wrong]
    return found


def _pointer(values: np.ndarray) -> object:
    return values.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


def _built(component: Model, folder: Path) -> Path:
    """Library with both codes."""
    assert host().endswith("linux")
    code = generate.generate_c(component, arrays=False, token="t")
    functions = {n: component.functions[n] for n, _ in PAIRS.values() if n in component.functions}
    text, entries = casadi_code(list(functions.values()))
    text, entries = text.replace("casadi_", "theirs_"), {n: e.replace("casadi_", "theirs_") for n, e in entries.items()}
    fields = generate.written_functions(component).names
    ours, theirs = ["        case -1: prepare(at, result); break;"] * ("prepare" in fields), []
    for which, (field, (name, results)) in enumerate(PAIRS.items()):
        if field not in fields:
            continue
        f = functions[name]
        second = ", second" if len(results) > 1 else ""
        ours.append(f"        case {which}: {field}(at, result{second}); break;")
        vectors = ["x", "u", "p", *(["dx", "du", "dp"] if name == "fwd" else ["s"])]
        given = ", ".join(["&at->t", *(f"at->{v}" for v in vectors)])
        order = dict(zip(results, ("result", "second"), strict=False))
        taken = ", ".join([*(order[k] for k in range(f.n_out())), *["NULL"] * (f.sz_res() - f.n_out())])
        room = f"const double *arg[{f.sz_arg() + 1}] = {{{given}}}; double *res[] = {{{taken}}};"
        theirs.append(f"        case {which}: {{ {room} {entries[f.name()]}(arg, res, iw, w, 0); break; }}")
    work = max(f.sz_w() for f in functions.values()) + 1, max(f.sz_iw() for f in functions.values()) + 1
    both = CALLS % ("\n".join(ours), work[0], work[1], "\n".join(theirs))
    needs = "const FmuQpFunctions fmu_qp_functions = {0};\n" if component.programs else ""
    files = {"model.c": (code + needs + "/* theirs */\n" + text + both).encode()}
    files |= {n: (generate.RUNTIME_DIR / n).read_bytes() for n in generate.RUNTIME_HEADERS}
    files |= math_files(files.values())
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    flags = [f for f in CFLAGS if "visibility" not in f]
    mathematics = [folder / n for n in files if n.endswith(".c") and n != "model.c"]
    objects = [str(OBJECTS.object(find_toolchain(host()), source, [folder])) for source in mathematics]
    sources = [str(folder / "model.c"), *objects]
    command = ["gcc", *flags, "-w", "-fPIC", "-shared", f"-I{folder}", *sources, "-o", str(folder / "both.so")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder / "both.so"
