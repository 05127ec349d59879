"""The error of the exchange, estimated from runs with smaller steps, against the exact solution."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign import following, making
from masses import COUPLING, Mass, exact

from cosim import CosimError, PythonComponent, Record, System
from cosim.linear.exchange_error import ExchangeError

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")


def oscillator(*, extrapolate: bool = False, back: float = COUPLING) -> System:
    """Two masses, each of which sees the other through a spring of COUPLING N/m (`back`: from b to a)."""
    system = System()
    system.add("a", Mass, step="2 ms")
    system.add("b", Mass, step="2 ms", parameters={"x0": 0.0})
    system.connect("a.x", "b.force", linear=(COUPLING, 0.0), extrapolate=extrapolate)
    system.connect("b.x", "a.force", linear=(back, 0.0), extrapolate=extrapolate)
    return system


@pytest.mark.parametrize(("extrapolate", "order"), [(False, 1), (True, 2)])
def test_the_estimate_is_the_true_error(extrapolate, order):
    system = oscillator(extrapolate=extrapolate)
    found = system.exchange_error(2.0)
    run = system.run(2.0)
    true = {n: np.abs(run[n] - x).max() for n, x in exact(run.time).items()}
    assert {s.name for s in found.signals} == set(true)
    for s in found.signals:
        assert s.exchange == pytest.approx(true[s.name], rel=0.05)
        assert s.order == pytest.approx(order, abs=0.1)
        assert s.size == np.abs(run[s.name]).max()
        assert s.solver == 0.0
    assert [s.relative for s in found.signals] == sorted((s.relative for s in found.signals), reverse=True)


def test_contributions_of_couplings_add_up_and_name_the_larger_one():
    found = oscillator(back=5.0).exchange_error(2.0)
    for s in found.signals:
        assert sum(s.contributions.values()) > 0.9 * s.exchange  # their signs may differ
    of = {s.name: s for s in found.signals}
    assert list(of["b.x"].contributions) == ["a -> b", "b -> a"]
    worst = next(iter(found.signals[0].contributions))
    assert f"most of it by {worst}" in found.advice(1e-9)


def test_the_advised_step_keeps_the_tolerance():
    system = oscillator()
    found = system.exchange_error(2.0, contributions=False)
    text = found.advice(1e-2)
    step = text.partition("communication steps of about ")[2].partition(" ms (a, b)")[0]
    for name in "ab":
        system[name].step = system[name].step * round(float(step) / 2 * 1000) / 1000
    finer = system.exchange_error(2.0, record=Record(interval="10 ms"), contributions=False)
    assert finer.signals[0].relative == pytest.approx(1e-2, rel=0.2)
    assert "within 0.02" in finer.advice(0.02)


def test_the_system_is_left_as_it_was():
    system = oscillator()
    before = str(system.schedule()), system.run(0.1).data
    system.exchange_error(0.1)
    assert str(system.schedule()) == before[0]
    np.testing.assert_array_equal(system.run(0.1).data, before[1])
    with pytest.raises(CosimError):
        system.exchange_error(0.1, record=["no.such"])
    assert str(system.schedule()) == before[0]


def test_solvers_have_errors_of_their_own(built_fmus):
    """With a coarse solver its error is told apart; both are those of the exact linear model."""
    with System() as system:
        for name in "ab":
            system.add(
                name,
                built_fmus.path("QuarterCarHmmwv", 3),
                step="4 ms",
                parameters={"solver.step": 0.004},
                start={"road.height": 0.05 if name == "a" else 0.0},
            )
        system.connect("a.suspension.deflection", "b.force", linear=(20e3, 0.0))
        system.connect("b.suspension.deflection", "a.force", linear=(20e3, 0.0))
        found = system.exchange_error(0.5, record=["*.body.z"], contributions=False)
        run = system.run(0.5, record=["*.body.z"])
        assert float(system["a"].values["solver.step"]) == 0.004
        model = system.linearize(["a.road.height"], ["a.body.z", "b.body.z"])
        import control

        true = control.forced_response(model, run.time, np.full((1, len(run.time)), 0.05)).outputs
    for s in found.signals:
        error = np.abs(run[s.name] - true["ab".index(s.name[0])]).max()
        assert abs(s.exchange - error) < s.solver + 0.02 * error
        assert 0 < s.solver < 0.2 * s.exchange


def test_without_coupling_there_is_no_error():
    system = System()
    system.add("a", Mass, step="2 ms")
    found = system.exchange_error(0.1)
    assert [s.exchange for s in found.signals] == [0.0, 0.0]
    assert found.advice() == "No continuous components are coupled, so the exchange makes no error."


def test_runs_that_end_at_different_times_are_refused(monkeypatch):
    system = oscillator()
    run, ends = System.run, iter([0.1, 0.1, 0.08, 0.1])
    monkeypatch.setattr(System, "run", lambda self, _, **given: run(self, next(ends), **given))
    with pytest.raises(CosimError, match=r"end at 0\.08 to 0\.1 s"):
        system.exchange_error(0.1, contributions=False)


class Spring(PythonComponent):
    """A spring of c N/m."""

    inputs, outputs = ("x",), ("force",)
    parameters = {"c": 1.0}  # noqa: RUF012

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        y[0] = -self.c * u[0]


@pytest.mark.parametrize("c", [1e4, 1e6])
def test_an_unstable_exchange_is_called_so(c):
    """Each step adds energy to the mass."""
    system = System()
    system.add("a", Mass, step="2 ms")
    system.add("b", Spring, step="2 ms", parameters={"c": c})
    system.connect("a.x", "b.x")
    system.connect("b.force", "a.force")
    found = system.exchange_error(1.0, contributions=False)
    assert "is unstable at these communication steps" in found.advice()
    assert "does not fall" not in found.advice()


def test_an_order_that_cannot_be_told_gives_the_difference_and_says_so():
    def noisy(self: Any, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG001
        y[:] = float(abs(h - 1e-3) < 1e-9), u[0]  # another value for h/2 only

    class Noisy(Mass):
        step = noisy

    system = System()
    for name in "ab":
        system.add(name, Noisy, step="2 ms")
    system.connect("a.x", "b.force")
    system.connect("b.x", "a.force")
    found: ExchangeError = system.exchange_error(0.1, contributions=False)
    assert found.signals[0].order is None
    assert "does not fall with the step" in found.advice()


@pytest.mark.parametrize(("internal", "fixed"), [("0.025", ()), ("0.02", ("b",)), ("0.05", ("b",))])
def test_what_a_fixed_internal_step_hides_is_said(
    tmp_path: Path, internal: str, fixed: tuple[str, ...], sentence
) -> None:
    """`b` integrates the ramp of `a`, whose values it holds: 1/2 h of 1/2, unless its step cannot be divided."""
    plain = following.build(tmp_path)
    attribute = b' providesIntermediateUpdate="true"'
    own = making.redescribed(
        plain, tmp_path / "Own.fmu", (attribute, attribute + f' fixedInternalStepSize="{internal}"'.encode())
    )
    with System() as system:
        system.allow_unconnected = True
        system.add("a", plain, step="0.1 s", start={"u": 1.0})
        system.add("b", own, step="0.1 s")
        system.connect("a.x", "b.u")
        found = system.exchange_error(1.0, record=["b.x"], contributions=False)
    assert found.fixed == fixed
    assert found.signals[0].exchange == pytest.approx(0.0 if fixed else 0.05, abs=1e-12)
    sentence(found.advice())
