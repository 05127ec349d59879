"""What inputs may be: 0 or never set, beyond their limits, a constant that is not that of the source."""

from __future__ import annotations

import numpy as np
import pytest
from api import ERROR, OK, WARNING, Instance, Library, Model
from applies import applies_to, continuous

STEPS = 8


def limited(fmu: Model) -> list[str]:
    """Real inputs with a limit."""
    variables = (fmu.variables[n] for n in fmu.inputs)
    return [v.name for v in variables if v.kind == "real" and (v.low is not None or v.high is not None)]


def beyond(fmu: Library, name: str) -> list[tuple[float, float]]:
    """(value beyond a limit, the limit) of an input, close by and far away."""
    v = fmu.variables[name]
    pairs = []
    for limit, outward in ((v.low, -1.0), (v.high, 1.0)):
        if limit is not None:
            pairs += [(limit + outward * max(abs(limit), 1.0) * by, limit) for by in (1e-5, 1e3)]
    return pairs


def constants(fmu: Model) -> dict[str, float]:
    """Inputs that take a constant of their source, with that constant, from the annotation."""
    return {e.get("name"): float(e.get("mustEqual")) for e in fmu.xml.iterfind(".//Component/Input[@mustEqual]")}


def whole(fmu: Model) -> list[tuple[str, float]]:
    """Integer inputs, with a value beyond each of their limits."""
    variables = [v for v in (fmu.variables[n] for n in fmu.inputs) if v.kind == "integer"]
    return [(v.name, limit + d) for v in variables for limit, d in ((v.low, -1), (v.high, 1)) if limit is not None]


def problems(a: Instance) -> list[str]:
    """Texts of warnings and worse."""
    return [text for status, _, text in a.messages if status >= WARNING]


@pytest.mark.parametrize("grounded", [True, False], ids=["zeros", "never set"])
def test_one_second_without_a_source(fmu: Library, grounded: bool) -> None:
    """Tools start and ground inputs at 0, or leave them alone."""
    zeros = dict.fromkeys(fmu.inputs, 0.0)
    with fmu.instance() as a:
        assert a.try_set(zeros if grounded else {}) == OK
        a.initialize()
        while a.time < 1.0 - 1e-9:
            if grounded:
                assert a.try_set(zeros) == OK
            a.step(fmu.step)
        assert np.isfinite(a.get(fmu.outputs)).all()
        assert problems(a) == []


@applies_to(constants)
def test_a_constant_that_is_not_that_of_the_source_is_told_once(fmu: Library) -> None:
    """It is no error, changes nothing, and 0 and the constant itself are silent."""
    for name, value in constants(fmu).items():
        v = fmu.variables[name]
        assert (v.causality, v.start_value, v.low, v.high) == ("input", 0.0, None, None)
        row = fmu.stimulus.row(0)
        assert row[name] == value, "the reference shows it connected"
        with fmu.instance() as a, fmu.instance() as b:
            a.initialize(row)
            expected = a.run(STEPS)
            assert a.try_set({name: value * (1 + 1e-9)}) == OK
            assert a.try_set({name: 0.0}) == OK
            assert problems(a) == []
            b.initialize(row)
            for wrong in (2 * value, -value, 3 * value):
                assert b.try_set({name: wrong}) == OK
                assert b.get([name])[0] == wrong
            (said,) = problems(b)
            assert name in said
            assert f"{2 * value:.9g}" in said
            assert f"{value:.9g}" in said
            for k in range(STEPS):
                b.set({**fmu.stimulus.row(k), name: 2 * value})
                b.step(fmu.step)
            assert b.get(fmu.outputs).tobytes() == expected[-1].tobytes()
            assert len(problems(b)) == 1
            for one in (a, b):
                one.set({name: value})
            assert b.serialize() == a.serialize(), "that it warned is no part of the state"
            b.reset()
            b.set({name: 2 * value})
            assert len(problems(b)) == 2, "a reset instance is a new one"


@applies_to(limited)
def test_values_beyond_a_limit_act_like_the_limit(fmu: Library) -> None:
    """The call succeeds with one warning, reading gives what was set, and everything computed is that of the limit."""
    for name in limited(fmu):
        for value, limit in beyond(fmu, name):
            with fmu.instance() as a, fmu.instance() as b:
                for one, given in ((a, limit), (b, value)):
                    one.initialize({**fmu.stimulus.row(0), name: given})
                    for k in range(STEPS):
                        one.set({**fmu.stimulus.row(k), name: given})
                        one.step(fmu.step)
                np.testing.assert_array_equal(b.get(fmu.outputs), a.get(fmu.outputs), err_msg=f"{name} = {value}")
                assert b.get([name])[0] == value
                (said,) = problems(b)
                assert name in said
                assert problems(a) == []


@applies_to(limited)
def test_that_it_warned_is_no_part_of_the_state(fmu: Library) -> None:
    for name in limited(fmu):
        row = fmu.stimulus.row(0)
        with fmu.instance() as a, fmu.instance() as b:
            a.initialize(row)
            b.initialize(row)
            b.set({name: beyond(fmu, name)[0][0]})
            assert problems(b)
            for one in (a, b):
                one.set(row)
            assert b.serialize() == a.serialize()
            a.run(2)
            b.run(2)
            assert b.serialize() == a.serialize()


@applies_to(continuous, limited)
def test_derivatives_beyond_a_limit(fmu: Library) -> None:
    """0 with respect to the input, elsewhere those at the limit; at the limit itself those of the inside."""
    outputs = [n for n in fmu.outputs if fmu.variables[n].kind == "real"]
    unknowns = fmu.derivatives + outputs
    for name in limited(fmu):
        for value, limit in beyond(fmu, name):
            inside = limit - np.copysign(1e-9 * max(abs(limit), 1.0), value - limit)
            with fmu.instance("me") as a, fmu.instance("me") as b, fmu.instance("me") as c:
                for one, given in ((a, limit), (b, value), (c, inside)):
                    one.initialize(fmu.stimulus.row(0)).continuous_time()
                    one.set({name: given})
                np.testing.assert_array_equal(b.get_derivatives(), a.get_derivatives())
                assert not b.column(unknowns, name).any(), (name, value)
                np.testing.assert_allclose(a.column(unknowns, name), c.column(unknowns, name), rtol=1e-3, atol=1e-6)
                for state in fmu.states:
                    np.testing.assert_array_equal(b.column(unknowns, state), a.column(unknowns, state))


@applies_to(limited)
def test_several_inputs_beyond_their_limits_are_told_once(fmu: Library) -> None:
    names = limited(fmu)
    with fmu.instance() as a:
        a.initialize()
        assert a.try_set({n: beyond(fmu, n)[0][0] for n in names}) == OK
        assert len(problems(a)) == 1


@applies_to(whole)
def test_integers_stay_strict(fmu: Library) -> None:
    with fmu.instance() as a:
        a.initialize()
        for name, value in whole(fmu):
            assert a.try_set({name: value}) == ERROR
            assert name in a.last_message
