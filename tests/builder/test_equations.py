"""The C that a component becomes: the bits of CasADi's own code, and what a reader finds in it."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from built import FMUS
from same_bits import differences

from build_fmus import generate
from build_fmus.base.elementwise import FUNCTIONS
from build_fmus.component import Component, Model
from build_fmus.equations.casadi_code import _safe
from build_fmus.equations.names import identifier
from build_fmus.equations.operators import constant
from fmu_sources.catalog import Context, default_catalog

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
_TWO = ("atan2", "fmod", "remainder", "fmin", "fmax", "copysign", "hypot")
ONE = tuple(f for f in FUNCTIONS if f not in (*_TWO, "pow"))  # functions of one number
TWO = (*_TWO, "plus", "minus", "times", "rdivide", "power")


def discrete(name: str, symbols: Any = ca.SX) -> Component:
    return Component(name, kind="discrete", sample_time=0.1, description="a test", source="no paper", symbols=symbols)


def all_operations() -> Component:
    """Each alone, and in nests that parentheses decide on."""
    c = discrete("Operations")
    x, y, z = (c.input(n, "1", n) for n in ("x", "y", "z"))
    c.output("one", ca.vertcat(*(getattr(ca, f)(x) for f in ONE)), "1", "of one number")
    c.output("two", ca.vertcat(*(getattr(ca, f)(x, y) for f in TWO)), "1", "of two")
    nested = [
        x - (y - z),
        x - y - z,
        x / (y / z),
        x / y / z,
        x * (y / z),
        x * y / z,
        x - (y + z),
        -(x + y) * z,
        1 / (1 / x),
        2 * (2 * x),
        (x + y) ** 2,
        x**2 / y**2,
        -2 * x - -3,
        x - (-y),
        (x * -1) * y,
    ]
    logic = [
        (x < y) + (y < z),
        (x < y) * z,
        (x < y) / (1 + (y < z)),
        -(x < y),
        ca.logic_and(x < y, ca.logic_or(y <= z, x == z)),
        ca.logic_or(ca.logic_and(x < y, y < z), ca.logic_not(z)),
        ca.logic_not(ca.logic_not(x)),
        (x < y) < (y < z),
        x != y,
        ca.fmax(x < y, z),
        ca.if_else(x < y, x, y),
        ca.if_else(x < y, -x * 0, 1),
        ca.if_else(x, y < z, z),
        ca.if_else(ca.logic_not(x < y), x, z),
        ca.if_else(x < y, ca.if_else(y < z, x, y), z),
        ca.if_else(x < y, x, 0),
    ]
    c.output("nested", ca.vertcat(*nested), "1", "parentheses")
    c.output("logic", ca.vertcat(*logic), "1", "conditions and numbers")
    numbers = [0.0, -0.0, 1e300, -1e-300, 1 / 3, 1e6, 123456789.0, np.inf, -np.inf]
    c.output("numbers", ca.vertcat(*(x * k for k in numbers)), "1", "constants")
    long = sum((x * k + y) * (z - k) for k in range(60))
    c.output("long", long * long + ca.sin(long), "1", "more than a line")
    return c


def all_matrix_operations() -> Component:
    c = discrete("Matrices", ca.MX)
    rng = np.random.default_rng(3)
    gain = c.parameter("gain", rng.standard_normal((2, 3)), "1", "gain", source="none")
    v, at, k = c.input("v", "1", "v", shape=(6,)), c.input("at", "1", "at", shape=(3,)), c.input("k", "1", "k")
    ring = c.state("ring", "1", "ring", shape=(8,))
    A, B = ca.MX(ca.DM(rng.standard_normal((6, 6)))), ca.reshape(v, 2, 3)
    forward = A @ v
    for _ in range(3):
        forward = A @ forward + ca.sin(v) * k
    c.output("forward", forward, "1", "products")
    c.output("square", gain @ B.T + ca.MX(2, 2), "1", "transposed")
    c.output("gathered", ca.vertcat(v[::2], v[[5, 0, 0, 1]], forward[::-1]), "1", "elements")
    c.output("looked_up", ring[at], "1", "elements at numbers")
    c.output("least", ca.vertcat(ca.mmin(forward), ca.mmax(v * k)), "1", "extremes")
    c.output("repeated", ca.sum2(ca.repmat(v, 1, 3) * ca.repmat(k, 6, 3)), "1", "repetition")
    c.output("sparse", ca.densify(ca.vertcat(k, ca.MX(2, 1), v[:2])) + 1, "1", "zeros that are not there")
    c.output("wide", ca.densify(ca.horzcat(ca.MX(3, 1), v[:3]).T), "1", "transposed with such zeros")
    written = ca.MX(ring)
    written[2:4] = v[1:3]
    between = written * 1.0
    written.set_nz(at[:1], False, at[1:2])
    written[ca.DM([7, 5])] = ca.vertcat(k, k)
    c.output("between", between[1:5], "1", "before the last changes")
    c.output("choice", ca.if_else(k > 0, v, v[::-1]) + (v < 0.5) + ca.if_else(v > 0, v, -k), "1", "choices")
    c.update(ring, written)
    return c


def with_programs() -> Component:
    c = discrete("Program", ca.MX)
    r, last = c.input("r", "1", "reference", shape=(3,)), c.state("last", "1", "last", shape=(3,))
    s = c.quadratic_program(
        "qp",
        hessians=[np.diag([1.0, 2.0, 3.0])],
        constraints=[np.eye(3)],
        linear=-r,
        lower=last - 1,
        upper=ca.fmin(last + 1, 5),
    )
    c.update(last, s.z)
    c.output("z", s.z * 2, "1", "solution")
    c.output("first", s.multipliers[0], "1", "one of them")
    return c


MAKERS = {f.__name__: f for f in (all_operations, all_matrix_operations, with_programs)}
# The kinds of components there are: linear and not, one corner and four, filters, tables, programs, hidden memory
CATALOG = (
    "QuarterCarHmmwv",
    "HydraulicActuator",
    "RideCarHmmwv",
    pytest.param("FullCarHmmwv", marks=pytest.mark.full),  # gcc takes ten seconds for both codes
    "KalmanHmmwv",
    "RoadPerryman3",
    "MpcBench",
    "RideComfort",
)


def model(name: str) -> Model:
    made = MAKERS[name]() if name in MAKERS else default_catalog()[name].make(Context(FMUS, FMUS / ".cache"))
    return made.model()


@needs_gcc
@pytest.mark.parametrize("name", [*MAKERS, *CATALOG])
def test_the_bits_are_those_of_casadis_code(name: str, tmp_path: Path) -> None:
    c = model(name)
    assert not generate.written_functions(c).uses_casadi
    assert differences(c, tmp_path) == []


@needs_gcc
def test_a_comparison_that_compares_nothing_would_be_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    c = model("QuarterCarHmmwv")
    written = generate.generate_c

    def wrong(*arguments: Any, **options: Any) -> str:
        code = written(*arguments, **options)
        assert "x->body_z - x->wheel_z" in code
        return code.replace("x->body_z - x->wheel_z", "x->wheel_z - x->body_z", 1)

    monkeypatch.setattr(generate, "generate_c", wrong)
    assert differences(c, tmp_path, points=3)


def uncommon() -> Component:
    """Operations that are left to CasADi's generator: linear equations of a triangular matrix, a lookup table."""
    c = Component("Uncommon", kind="continuous", description="a test", source="no paper", symbols=ca.MX)
    u, x = c.input("u", "1", "u", shape=(2,)), c.state("x", "1", "x", shape=(2,), output=True)
    table = ca.interpolant("table", "linear", [[0.0, 1.0, 2.0], [0.0, 1.0, 4.0]], list(range(9)))
    c.derivative(x, ca.solve(ca.triu(ca.diag(ca.vertcat(2.0, 3.0)) + u @ u.T), u - x))
    c.output("read", table(u), "1", "from a table")
    c.reference_input({"u[1]": np.sin, "u[2]": lambda t: 1.0 + t})
    return c


@needs_gcc
def test_what_only_casadi_can_write_is_its_code(tmp_path: Path) -> None:
    c = uncommon().model()
    code = generate.generate_c(c, arrays=False, token="t")
    assert generate.written_functions(c).uses_casadi
    assert "casadi_interpn" in code
    assert not re.search(r"checkout|incref|sparsity_in|casadi_real|\bcasadi_int\b|SYMBOL_EXPORT", code)
    assert differences(c, tmp_path) == []


@pytest.mark.parametrize(
    ("code", "safe"), [("i=(int) *cr++;", "i=index_of(*cr++);"), ("(int) (x-g)*2", "index_of(x-g)*2")]
)
def test_numbers_become_indices_through_a_function(code: str, safe: str) -> None:
    """C leaves the conversion of NaN and of large numbers undefined."""
    assert _safe(code).replace("index_of (", "index_of(") == safe


def test_conversions_of_another_form_are_refused(raises) -> None:
    with raises(RuntimeError):
        _safe("i = (int) w[3];")


@pytest.mark.parametrize(
    "x", [0.0, -0.0, 1.0, -2.5, 1e6, 1e-6, 1e22, 123456.7, 1 / 3, 5e-324, 1.7976931348623157e308, -1e-7]
)
def test_numbers_keep_all_their_digits(x: float) -> None:
    assert float(constant(x).code).hex() == x.hex()


@pytest.mark.parametrize(
    ("name", "identifiers"),
    [("suspension.stiffness", "suspension_stiffness"), ("case", "case_"), ("x", "x_"), ("sqrt", "sqrt_"), ("v", "v")],
)
def test_identifiers(name: str, identifiers: str) -> None:
    assert identifier(name) == identifiers
    assert identifier(name, {identifiers}) == f"{identifiers}_"


@needs_gcc
def test_names_that_c_has_for_something_else(tmp_path: Path) -> None:
    c = discrete("Names")
    names = ("case", "x", "y", "a.b", "a_b", "sin", "when", "int", "linux", "I", "at", "result", "next", "v1", "start")
    inputs = {n: c.input(n, "1", "input") for n in names}
    total = sum(k * v for k, v in enumerate(inputs.values()))
    for n in names:
        c.output(f"twice.{n}", 2 * (total + inputs[n]), "1", "output")
    for n in ("u", "s", "w", "t", "data", "i"):
        state = c.state(n, "1", "state")
        c.update(state, c.value(f"v_{n}", state + total) * 2)
    c.value("v2", total)
    assert differences(c.model(), tmp_path) == []


# ---------------------------------------------------------------------- what a reader finds


def section(code: str, title: str) -> str:
    """Text of the section whose title begins so."""
    found = re.search(rf"^/\* -+ {re.escape(title)}.*?(?=^/\* ---|\Z)", code, re.MULTILINE | re.DOTALL)
    assert found, f"no section {title}"
    return found[0]


def quarter_car() -> str:
    return generate.generate_c(model("QuarterCarHmmwv"), arrays=False, token="t")


def test_sections_of_a_continuous_component_and_their_sources() -> None:
    c = model("QuarterCarHmmwv")
    code = quarter_car()
    assert len(code.splitlines()) <= 360
    titles = re.findall(r"^/\* -+ (\w+)", code, re.MULTILINE)
    assert titles == ["values", "outputs", "derivatives", "directional", "Jacobian", "what"]
    for title in titles[:-1]:
        assert c.source in section(code, title).split("static void")[0]
    assert "p->suspension_stiffness * suspension_deflection" in section(code, "derivatives")
    assert "der->body_z = x->body_vz;" in section(code, "derivatives")
    assert "y->tire_deflection = x->wheel_z - u->road_height;" in section(code, "outputs")
    assert "result[14] = all(1.0); /* der(wheel.z) by wheel.vz */" in section(code, "Jacobian")
    assert "scalar suspension_stiffness;      /* [N/m] suspension stiffness */" in code
    assert ".body_mass = 2800.0," in code


def test_what_is_called_once_is_not_optimized() -> None:
    code = generate.generate_c(model("FullCarHmmwv"), arrays=False, token="t")
    assert re.findall(r"^CALLED_ONCE\nstatic void (\w+)", code, re.MULTILINE) == ["start_states", "directional_start"]
    assert code.count("CALLED_ONCE") == 2


def test_what_is_not_there_is_not_written() -> None:
    """No functions that copy, no tables without entries, no field that is 0."""
    code = quarter_car()
    assert not re.search(r"start_states|checks|velocity_of|hidden|program|\b0,$", code)
    c = discrete("Held")
    c.output("held", c.input("u", "1", "u"), "1", "u")
    assert re.findall(r"^static \w+.*", generate.generate_c(c.model(), arrays=False, token="t"), re.MULTILINE) == [
        "static void sample(const FmuArguments *at, real *result, real *second) {",
        "static const FmuVariable variables[] = {",
        "static const struct {",
    ]


def test_intermediate_values_have_their_names_and_sources() -> None:
    c = Component("Mass", kind="continuous", description="a mass", source="a paper")
    f, x = c.input("f", "N", "force"), c.state("x", "m", "position", output=True)
    v = c.state("v", "m/s", "velocity")
    pull = c.value("pull", f - 2 * x, source="a paper, equation (3)")
    c.derivative(x, v)
    c.derivative(v, pull / 2, source="a paper, equation (4)")
    c.output("a", pull / 2, "m/s2", "acceleration")
    code = generate.generate_c(c.model(), arrays=False, token="t")
    assert (
        "    /* a paper, equation (3) */\n    const local pull = u->f - 2.0 * x->x;\n"
        "    /* a paper, equation (4) */\n    der->v = pull / 2.0;\n" in section(code, "derivatives")
    )
    assert "const local pull = u->f - 2.0 * x->x;\n    y->a = pull / 2.0;" in section(code, "outputs").replace(
        "    /* a paper, equation (3) */\n", ""
    )


def test_matrices_have_their_names() -> None:
    c = discrete("Filter", ca.MX)
    u, x = c.input("u", "1", "u", shape=(2,)), c.state("x", "1", "x", shape=(2,))
    A = c.value("A", ca.MX(ca.DM([[0.5, 0.25], [0.0, 0.5]])))
    innovation = c.value("innovation", u - x)
    c.update(x, A @ x + innovation, source="a filter")
    code = generate.generate_c(c.model(), arrays=False, token="t")
    assert "static const double A[4] = {\n    0.5, 0.0, 0.25, 0.5};" in code
    assert "product(v1, A, x->x, 2, 2, 1);" in code
    assert "for (int i = 0; i < 2; i++) innovation[i] = u->u[i] - x->x[i];" in code
    assert "/* a filter */\n    for (int i = 0; i < 2; i++) next->x[i] = v1[i] + innovation[i];" in code


@pytest.mark.parametrize(
    ("name", "title", "lines"),
    [
        (
            "QuarterCarHmmwv",
            "derivatives",
            "/* 001 (1.1), forces on m_s */\n    der->body_vz = strut_force / p->body_mass;",
        ),
        ("QuarterCarBench", "derivatives", "/* 002 equation (1) */\n    der->body_vz = strut_force / p->body_mass;"),
        (
            "HydraulicActuator",
            "derivatives",
            "/* 001 (1.4) */\n    der->spool_position = (spool_target - x->spool_position) /",
        ),
        ("ThreeAxleRide", "derivatives", "/* 003 (3.13) */\n    der->body_vz = "),
        ("ForceTracking", "sample", "/* 001 (1.12) */\n    const scalar voltage = "),
        (
            "MpcHmmwv",
            "sample",
            (
                "/* 001 (1.16), four times, sampled for held commands */\n    for (int i = 0; i < 16; i++)"
                " next->smoothing_filters[i]"
            ),
        ),
        ("FullCarHmmwv", "derivatives", " = body_force_1 / f->total_mass;"),
    ],
)
def test_equations_of_the_papers_are_found_by_their_numbers(name: str, title: str, lines: str) -> None:
    assert lines in section(generate.generate_c(model(name), arrays=False, token="t"), title)


def test_the_prediction_of_an_mpc_reads_like_its_model() -> None:
    text = section(generate.generate_c(model("MpcHmmwv"), arrays=False, token="t"), "data of the quadratic programs")
    assert "state_now[12] = u->body_vz;" in text  # a vector that is put together has its name too
    step = r"product\((v\d+), A, state_4, 33, 33, 1\);\n.*\n.*state_5\[i\] = \1\[i\] \+ B_u\[i\] \+ E_w\[i \+ 132\];"
    assert re.search(step, text)
    assert text.count("x(k + 1) = A x(k) + B u + E w") == 1
