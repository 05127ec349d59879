"""Lists of value references.

In any order, twice the same, changed in place, wrong in the middle, before and after other calls.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from api import ERROR, OK, Instance, Library, Model
from applies import applies_to

STEPS = 3


def real(fmu: Model, names: list[str]) -> list[str]:
    """Those of real variables."""
    return [n for n in names if fmu.variables[n].kind == "real"]


def read(a: Instance, references: Any) -> list[float]:
    """Values behind an array of references to real numbers."""
    values = a.ffi.new("double[]", len(references))
    assert a.transfer(f"Get{kind(a)}", references, len(references), values, len(values)) == OK
    return list(values)


def kind(a: Instance) -> str:
    """What real variables are called."""
    return "Real" if a.fmi == 2 else "Float64"


def running(a: Instance, fmu: Library) -> None:
    """Some steps along the stimulus."""
    a.initialize(fmu.stimulus.row(0))
    a.run(STEPS)


@applies_to(lambda fmu: len(real(fmu, fmu.outputs)) > 1)
def test_a_list_that_is_changed_in_place_is_read_anew(fmu: Library) -> None:
    names = real(fmu, fmu.outputs)
    with fmu.instance() as a:
        running(a, fmu)
        expected = dict(zip(names, a.get(names), strict=True))
        references = a.numbers(fmu.variables[n].reference for n in names)
        assert read(a, references) == list(expected.values())
        middle = len(names) // 2
        references[middle] = fmu.variables[names[0]].reference  # first and last stay
        names[middle] = names[0]
        assert read(a, references) == [expected[n] for n in names]
        references[0], references[len(names) - 1] = references[len(names) - 1], references[0]
        names[0], names[-1] = names[-1], names[0]
        assert read(a, references) == [expected[n] for n in names]


@applies_to(lambda fmu: bool(real(fmu, fmu.outputs)))
def test_a_reference_may_be_read_several_times_and_in_any_order(fmu: Library) -> None:
    names = real(fmu, fmu.outputs)
    names = [*names[::-1], *names, names[0]]
    with fmu.instance() as a, fmu.instance() as b:
        running(a, fmu)
        running(b, fmu)
        alone = {n: read(b, b.numbers([fmu.variables[n].reference]))[0] for n in names}
        assert read(a, a.numbers(fmu.variables[n].reference for n in names)) == [alone[n] for n in names]


@applies_to(lambda fmu: bool(real(fmu, fmu.inputs)))
def test_of_an_input_that_is_set_twice_the_last_value_counts(fmu: Library) -> None:
    name = real(fmu, fmu.inputs)[0]
    reference = fmu.variables[name].reference
    with fmu.instance() as a, fmu.instance() as b:
        running(a, fmu)
        running(b, fmu)
        now = float(a.get([name])[0])
        assert a.access("Set", kind(a), [reference] * 3, a.array(kind(a), [now + 0.5, now + 0.25, now])) == OK
        b.set({name: now})
        for _ in range(STEPS):
            a.step(fmu.step)
            b.step(fmu.step)
            assert a.get(fmu.outputs).tobytes() == b.get(fmu.outputs).tobytes()


@applies_to(lambda fmu: bool(real(fmu, fmu.inputs)))
def test_one_wrong_reference_changes_nothing(fmu: Library) -> None:
    """Unknown, calculated, or of another type, after inputs that could be set."""
    names = real(fmu, fmu.inputs)
    good = [fmu.variables[n].reference for n in names]
    wrong = [1 << 30, 0xFFFFFFFF]
    wrong += [v.reference for v in fmu.variables.values() if v.kind != "real"][:1]
    wrong += [fmu.variables[n].reference for n in real(fmu, fmu.outputs)[:1]]
    with fmu.instance() as a:
        running(a, fmu)
        before = a.get([*names, *fmu.outputs])
        for reference in wrong:
            for references in ([*good, reference], [reference, *good]):
                values = a.array(kind(a), [0.125] * len(references))
                assert a.access("Set", kind(a), references, values) == ERROR
                np.testing.assert_array_equal(a.get([*names, *fmu.outputs]), before)


@applies_to(lambda fmu: bool(real(fmu, fmu.inputs)))
def test_one_value_that_is_not_finite_changes_nothing(fmu: Library) -> None:
    names = real(fmu, fmu.inputs)
    good = [fmu.variables[n].reference for n in names]
    with fmu.instance() as a:
        running(a, fmu)
        before = a.get([*names, *fmu.outputs])
        for value in (np.nan, np.inf, -np.inf):
            values = a.array(kind(a), [*[0.125] * (len(names) - 1), value])
            assert a.access("Set", kind(a), good, values) == ERROR
            assert "not finite" in a.last_message
            np.testing.assert_array_equal(a.get([*names, *fmu.outputs]), before)
