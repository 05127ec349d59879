"""What of an FMU's sources becomes lanes, and what is refused with its reason: nothing is guessed."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from built import FMUS

from cosim import System
from cosim.batch import Batch
from cosim.batch.lanes import translated
from cosim.batch.source import NoLanes, lane_source
from cosim.batch.statements import NotRead, read_function
from cosim.fmu.file import FmuFile

pytestmark = pytest.mark.usefixtures("built_fmus")
PLANT = FMUS / "fmi3" / "QuarterCarBench.fmu"

STRUCTS = (
    "typedef struct {\n    double k;\n    double n[2];\n} Parameters;\n\ntypedef struct {\n    double v;\n}"
    " Inputs;\n\ntypedef struct {\n    double a;\n    double b;\n} Outputs;\n"
)


def sample(*lines: str) -> str:
    """A component's code with these statements."""
    body = "\n".join(f"    {line}" for line in ("Outputs *const y = (Outputs *)result;", "(void)second;", *lines))
    return f"{STRUCTS}\nstatic void sample(const FmuArguments *at, double *result, double *second) {{\n{body}\n}}\n"


def body(code: str, outputs: tuple[int, ...] = (0, 1)) -> list[str]:
    """Statements over lanes, without those that name the arguments."""
    text, names = translated(code, outputs)
    assert names == ["sample"]
    lines = text[text.index("static void sample") :].splitlines()
    return [line.strip() for line in lines if re.match(r" +(y->|const lanes v|const mask|lanes v|if|v\d|\})", line)]


def test_what_nothing_reads_is_left_out() -> None:
    code = sample("const double v1 = sin(u->v);", "y->a = v1;", "const double v2 = u->v + 1.0;", "y->b = v2 * 2.0;")
    assert body(code, (1,)) == ["const lanes v2 = (u->v + 1.0);", "y->b = (v2 * 2.0);"]
    assert body(code, (0,)) == ["const lanes v1 = lanes_sin(u->v);", "y->a = v1;"]


def test_what_depends_on_parameters_alone_is_computed_once() -> None:
    code = sample("const double v1 = p->k * 2.0;", "y->a = v1 + u->v;", "y->b = u->v / (p->k * 2.0);")
    assert body(code) == ["y->a = (f->v0 + u->v);", "y->b = (u->v / f->v0);"]
    text, _ = translated(code, (0, 1))
    assert "f->v0 = (p->k * 2.0);" in text


def test_conditions_hold_in_each_lane() -> None:
    code = sample(
        "const int v1 = 0.0 < u->v && !(u->v < p->k);",
        "double v2 = 0.0;",
        "if (v1) {",
        "v2 = sqrt(u->v);",
        "}",
        "y->a = when(v1, v2);",
        "y->b = (double)v1;",
    )
    assert body(code) == [
        "const mask v1 = (((mask)(0.0 < u->v)) & (~((mask)(u->v < p->k))));",
        "lanes v2 = lanes_all(0.0);",
        "if (lanes_any(v1)) {",
        "v2 = lanes_sqrt(u->v);",
        "}",
        "y->a = lanes_when(v1, v2);",
        "y->b = lanes_number(v1);",
    ]


def test_the_smaller_and_larger_number_are_one_instruction_where_that_is_the_same() -> None:
    code = sample("y->a = fmax(0.0, fmin(u->v, 1.0));", "y->b = fmin(0.0, fmax(u->v, p->k));")
    assert body(code) == [
        "y->a = lanes_fmax_of_known(lanes_fmin_of_known(u->v, lanes_all(1.0)), lanes_all(0.0));",
        "y->b = lanes_fmin(lanes_all(0.0), lanes_fmax(u->v, p->k));",  # fmin(0.0, -0.0) is -0.0
    ]


@pytest.mark.parametrize(
    "line",
    [
        "y->a = foreign(u->v);",
        "y->a = u->v ? 1.0 : 2.0;",
        "while (1) {",
        "y->a = u->v; }",
        "y->a = s->solver_z[0];",
        "y->a = v9;",
        "if (u->v < 1.0) { y->a = u->v; }",
        "if (u->v < 1.0) { y->a = u->v; } else { y->a = 1.0; }",
        "for (int i = 0; i < n; i++) y->a = u->v;",
        "y->a = look_up(u->v, 3, u->v);",
    ],
)
def test_other_code_than_the_generator_writes_is_refused(line: str, raises) -> None:
    with raises(NotRead):
        translated(sample(line, "y->b = u->v;"), (0, 1))


def test_a_function_that_is_not_there() -> None:
    assert read_function(sample("y->a = u->v;"), "outputs") is None


def changed(tmp_path: Path, change: Callable[[str, bytes], bytes | None]) -> Path:
    """The quarter car with other files; None leaves one out."""
    path = tmp_path / "Changed.fmu"
    with zipfile.ZipFile(PLANT) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            data = change(name, old.read(name))
            if data is not None:
                new.writestr(name, data)
    return path


@pytest.mark.parametrize(
    "change",
    [
        lambda n, d: None if n.startswith("sources/") else d,
        lambda n, d: None if n == "sources/model.c" else d,
        lambda n, d: re.sub(rb'\.token = "[^"]*"', b'.token = "{other}"', d) if n == "sources/model.c" else d,
        lambda n, d: d + b"\n/* */\n" if n == "sources/integrators.c" else d,
        lambda n, d: d.replace(b"static void outputs", b"static int outputs") if n == "sources/model.c" else d,
    ],
)
def test_sources_that_are_not_those_of_the_binary_are_not_used(
    tmp_path: Path, change: Callable[[str, bytes], bytes | None], raises
) -> None:
    path = changed(tmp_path, change)
    with raises(NoLanes):
        lane_source(FmuFile(path, quiet=True)).code((0,), 2, 0)
    with System() as system:
        system.add("plant", path, step="1 ms")
        system.allow_unconnected = True
        with Batch(system, 2, threads=1, outputs="plant.body.z") as batch:
            batch.advance(0.01)
            assert list(batch.scalar) == ["plant"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("MpcBench", "quadratic programs"),
        ("HydraulicActuator", "ros2"),
        ("RoadRandom", ""),
        ("LqrBench", ""),
        ("ThreeAxleTrench", ""),
    ],
)
def test_which_of_our_fmus_have_lanes(name: str, said: str) -> None:
    fmu = FmuFile(FMUS / "fmi3" / f"{name}.fmu")
    if said:
        with pytest.raises(NoLanes, match=said):
            lane_source(fmu)
    else:
        assert lane_source(fmu).code((0,), 4, 2).startswith("/* An FMU in lanes.")
