"""Outputs that nobody reads are left out of the code of outputs, with what only they need."""

from __future__ import annotations

import re
import zipfile

import pytest
from built import FMUS

from cosim.batch.unread_outputs import without_unread_outputs

CODE = """\
typedef struct {
    scalar speed;
    real height[2]; /* [m] */
    scalar force;   /* [N] */
} Outputs;

static void outputs(const FmuArguments *at, real *result) {
    const States *const x = (const States *)at->x;
    Outputs *const y = (Outputs *)result;

    const condition v1 = 0.0 < x->force;
    scalar v2 = {0};
    scalar v3 =
        {0};
    if (any(v1)) {
        const local v4 = 2.0 * x->speed;
        /* contact */
        v2 = v4 +
            1.0;
    }
    if (any(v1 == 0)) {
        v3 = 3.0;
    }
    const local v5 = v3 + x->v6;
    const scalar v6 = 6.0;
    y->speed = v6;
    y->height[0] = v5;
    y->height[1] = v5;
    y->force = v2;
}

static void derivatives(const FmuArguments *at, real *result) {
    const scalar v5 = 0.0;
}
"""
LEFT_OUT = {
    0: ["condition v1", "scalar v2", "any(v1)", "v4", "v2 =", "v3 = 3.0", "local v5 = v3", "y->height", "y->force"],
    1: ["any(v1))", "v4", "v2 = v4", "scalar v6", "y->speed", "y->force"],
    3: ["any(v1 == 0)", "v3 = 3.0", "local v5 = v3", "scalar v6", "y->speed", "y->height"],
}
LINES = [line for line in CODE.splitlines() if "/* contact" not in line and line]


@pytest.mark.parametrize("slot", LEFT_OUT)
def test_only_what_an_output_needs_is_left(slot: int) -> None:
    left = without_unread_outputs(CODE, [slot])
    assert [text for text in LEFT_OUT[slot] if text in left] == []
    names = set(re.findall(r"\bv\d\b", left))
    assert names == {0: {"v5", "v6"}, 1: {"v1", "v3", "v5", "v6"}, 3: {"v1", "v2", "v4", "v5"}}[slot]
    assert set(left.splitlines()) <= {*LINES, ""}


def test_all_that_is_read_stays() -> None:
    assert [line for line in without_unread_outputs(CODE, [0, 2, 3]).splitlines() if line] == LINES


def test_a_statement_of_another_form_keeps_all() -> None:
    code = CODE.replace("y->speed = v6;", "y->speed = v6; /* m/s */")
    assert without_unread_outputs(code, [3]) == code


@pytest.mark.usefixtures("built_fmus")
@pytest.mark.parametrize("name", ["FullCarHmmwv", "FullCarHmmwvTires", "SemiActiveDamper", "HydraulicActuator"])
def test_what_is_left_of_an_fmu_reads_nothing_that_was_left_out(name: str) -> None:
    with zipfile.ZipFile(FMUS / "fmi3" / f"{name}.fmu") as file:
        code = file.read("sources/model.c").decode()
    begin = "static void outputs("
    for slot in range(4):
        body = without_unread_outputs(code, [slot]).split(begin)[1].split("\n}\n")[0]
        written = set(re.findall(r"\b(v\d+|[a-z_0-9]+_[a-z_0-9]+) =", body)) | {"if_else"}
        read = set(re.findall(r"(?<!->)\b(?:v\d+|[a-z_0-9]+_[a-z_0-9]+)\b", body))
        assert read <= written
        assert len(body) < len(code.split(begin)[1].split("\n}\n")[0])
