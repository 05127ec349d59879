"""Metrics of a run as functions of JAX and PyTorch: values, derivatives, what is composed with them, mistakes."""

from __future__ import annotations

import runpy
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from built import BuiltFmus

from build_fmus.base import extras
from cosim import System, Table
from cosim.gradient import GradientError, Peak, Rms
from cosim.gradient.frameworks import jax_function, torch_function

NAMES = ["car.body.mass", "car.suspension.damping"]
AT = np.array([2.6, 7.0])
METRICS = {"ride": Rms("car.body.az"), "travel": Peak("car.suspension.deflection")}
OPTIONS: dict[str, Any] = {"stop_time": 0.5, "interval": "5 ms"}
ROOT = Path(__file__).parents[2]


@pytest.fixture
def system(built_fmus: BuiltFmus) -> Iterator[System]:
    with System(allow_unconnected=True) as made:
        made.add("car", built_fmus.path("QuarterCarBench", 3), step="1 ms", start={"body.z": 0.01})
        yield made


def expected(system: System) -> tuple[np.ndarray, np.ndarray]:
    system["car"].set({"body.mass": AT[0], "suspension.damping": AT[1]})
    found = system.gradient(METRICS, NAMES, **OPTIONS)
    return found.values, found.jacobian


@pytest.mark.parametrize("make", [jax_function, torch_function])
def test_without_the_extra_a_sentence_names_it(
    make: Callable[..., Any], system: System, monkeypatch: pytest.MonkeyPatch, raises
) -> None:
    import builtins

    known = builtins.__import__

    def refusing(name: str, *arguments: Any, **more: Any) -> Any:
        if name.partition(".")[0] in ("jax", "torch"):
            raise ModuleNotFoundError(f"No module named '{name}'", name=name)
        return known(name, *arguments, **more)

    monkeypatch.setattr(builtins, "__import__", refusing)
    monkeypatch.setattr(extras, "find_spec", lambda _: None)
    with raises(extras.MissingExtraError):
        make(system, METRICS, NAMES, **OPTIONS)


@pytest.mark.full
def test_jax_differentiates_a_run(system: System) -> None:
    jax = pytest.importorskip("jax", reason="pip install 'suspension-fmus[jax]'")
    jax.config.update("jax_enable_x64", True)
    values, jacobian = expected(system)
    function = jax_function(system, METRICS, NAMES, **OPTIONS)
    np.testing.assert_array_equal(function(AT), values)
    np.testing.assert_array_equal(jax.jit(function)(AT), values)
    np.testing.assert_allclose(jax.jacrev(function)(AT), jacobian, rtol=1e-14)
    loss = jax.value_and_grad(lambda x: (function(2.0 * x) ** 2).sum())
    value, slope = jax.jit(loss)(AT / 2.0)
    assert value == pytest.approx((values**2).sum())
    np.testing.assert_allclose(slope, 4.0 * values @ jacobian, rtol=1e-12)
    np.testing.assert_array_equal(jax.vmap(function)(np.stack([AT, AT]))[1], values)
    with pytest.raises(Exception, match="2 parameters have values of shape"):
        function(np.zeros(3))


@pytest.mark.full
def test_torch_differentiates_a_run(system: System) -> None:
    torch = pytest.importorskip("torch", reason="pip install 'suspension-fmus[torch]'")
    values, jacobian = expected(system)
    function = torch_function(system, METRICS, NAMES, **OPTIONS)
    np.testing.assert_array_equal(function(torch.tensor(AT)).numpy(), values)
    x = torch.tensor(AT / 2.0, requires_grad=True)
    loss = (function(2.0 * x) ** 2).sum()
    loss.backward()
    assert loss.item() == pytest.approx((values**2).sum())
    np.testing.assert_allclose(x.grad.numpy(), 4.0 * values @ jacobian, rtol=1e-12)
    single = function(torch.tensor(AT, dtype=torch.float32))
    assert single.dtype == torch.float32
    np.testing.assert_allclose(single.numpy(), values, rtol=1e-5)
    with pytest.raises(GradientError, match="2 parameters have values of shape"):
        function(torch.zeros(3, dtype=torch.float64))


@pytest.mark.full
@pytest.mark.parametrize("framework", ["jax", "torch"])
def test_a_series_takes_its_samples(framework: str, system: System) -> None:
    module = pytest.importorskip(framework, reason=f"pip install 'suspension-fmus[{framework}]'")
    force = np.linspace(-1.0, 1.0, 6)
    system.add("driver", Table({"time": 0.1 * np.arange(6), "force [N]": force}))
    system.connect("driver.force", "car.force")
    names = ["car.body.mass", "driver.force"]
    at = np.array([2.6, *force[::-1]])
    if framework == "jax":
        module.config.update("jax_enable_x64", True)
        jacobian = np.asarray(module.jacrev(jax_function(system, METRICS, names, **OPTIONS))(at))
    else:
        function = torch_function(system, METRICS, names, **OPTIONS)
        jacobian = module.autograd.functional.jacobian(function, module.tensor(at)).numpy()
    np.testing.assert_array_equal(system["driver"].start("force"), force[::-1])
    np.testing.assert_allclose(jacobian, system.gradient(METRICS, names, **OPTIONS).jacobian, rtol=1e-14)
    assert (jacobian != 0.0).all()


@pytest.mark.full
@pytest.mark.parametrize("framework", ["jax", "torch"])
def test_the_example_trains_a_policy(framework: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside the same policy without derivatives: both near the LQR, from a cost four times as large."""
    pytest.importorskip(framework, reason=f"pip install 'suspension-fmus[{framework}]'")
    monkeypatch.chdir(ROOT)
    example = runpy.run_path(str(ROOT / "docs" / "examples" / "learn_by_gradients.py"))
    bench = example["Bench"]()
    gains, runs = example["follow"](example[f"with_{framework}"](bench))
    other, more = example["evolve"](bench, 20)
    lqr, passive, one, two = (
        bench.index(g, example["UNSEEN"][:3]) for g in (bench.published, np.zeros(4), gains, other)
    )
    assert one < 1.02 * lqr < 0.3 * passive
    assert two < 1.2 * lqr
    assert 4 * runs < more
    bench.system.close()
