"""Metrics of a run as functions that JAX and PyTorch differentiate: their derivatives are those of `System.gradient`.

    ride = jax_function(system, {"ride": Rms("car.seat.az")}, ["controller.gain.*"], stop_time=8.0, interval="10 ms")
    value, slope = jax.value_and_grad(lambda gains: ride(gains)[0])(gains)

A call sets the parameters in the system and runs it; a series takes as many values as it has samples. What else is set
in the system (the road, start values) stays as it is, so change it between calls as you like. JAX is compiled
(`jax.jit`) and vectorized (`jax.vmap`, one run after the other); neither framework differentiates twice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from build_fmus.base import extras
from cosim.core.signals import Array
from cosim.core.time import TimeLike
from cosim.engine.execution import Record
from cosim.gradient.gradient import GradientError, GradientRun
from cosim.gradient.metrics import Metric
from cosim.system.wiring import Wiring


class _Metrics:
    """Metrics of a system by the values of its parameters."""

    def __init__(
        self,
        system: Any,
        metrics: Mapping[str, Metric],
        parameters: str | Iterable[str],
        stop_time: TimeLike,
        interval: TimeLike | None,
        threads: int | None,
    ) -> None:
        self.run = GradientRun(system, metrics, parameters, stop_time, interval, threads)
        self.count = len(self.run.elements)

    def _set(self, x: Array) -> Wiring:
        if x.shape != (self.count,):
            raise GradientError(f"{self.count} parameters have values of shape ({self.count},), not {x.shape}")
        for (component, variable), value in zip(self.run.parameters, self.run.by_name(x).values(), strict=True):
            component.set({variable.name: value})
        return self.run.system

    def values(self, x: Array) -> Array:
        """Metrics (m,) of a run."""
        with self.run.system.lock:
            system: Any = self._set(x)
            recording = system.run(self.run.stop_time, record=Record(self.run.names, self.run.interval))
        metrics = self.run.metrics.values()
        return np.array([m.of([recording[n] for n in m.names])[0] for m in metrics])

    def jacobian(self, x: Array) -> tuple[Array, Array]:
        """Metrics (m,) and their derivatives (m, parameters) of a run."""
        run = self.run
        with run.system.lock:
            system: Any = self._set(x)
            found = system.gradient(
                run.metrics, run.by, stop_time=run.stop_time, interval=run.interval, threads=run.threads
            )
        return found.values, found.jacobian


def jax_function(
    system: Any,
    metrics: Mapping[str, Metric],
    parameters: str | Iterable[str],
    *,
    stop_time: TimeLike,
    interval: TimeLike | None = None,
    threads: int | None = None,
) -> Callable[[Any], Any]:
    """A function of values (n,) of the parameters that gives the metrics (m,), which JAX differentiates backward.

    Arguments are those of `System.gradient`; values are in the order of the parameters. JAX computes in single
    precision unless `jax_enable_x64` is set; the run is in double precision always.

    Raises:
        MissingExtraError: without the extra [jax].
        GradientError: a parameter has no derivative; of a call: the run fails.
    """
    with extras.needed("jax", "a function for JAX"):
        import jax
        import jax.numpy as jnp

    of = _Metrics(system, metrics, parameters, stop_time, interval, threads)
    m, n = len(metrics), of.count

    def called(function: Callable[[Array], Any], x: Any, *shapes: tuple[int, ...]) -> Any:
        kind = jnp.result_type(float)
        shape = [jax.ShapeDtypeStruct(s, kind) for s in shapes]

        def run(given: Any) -> Any:
            found = function(np.asarray(given, dtype=float))
            return [np.asarray(a, dtype=kind) for a in (found if isinstance(found, tuple) else (found,))]

        return jax.pure_callback(run, shape, x, vmap_method="sequential")

    @jax.custom_vjp
    def function(x: Any) -> Any:
        return called(of.values, x, (m,))[0]

    def forward(x: Any) -> Any:
        return tuple(called(of.jacobian, x, (m,), (m, n)))

    def backward(jacobian: Any, by_metric: Any) -> Any:
        return (by_metric @ jacobian,)

    function.defvjp(forward, backward)
    return function


def torch_function(
    system: Any,
    metrics: Mapping[str, Metric],
    parameters: str | Iterable[str],
    *,
    stop_time: TimeLike,
    interval: TimeLike | None = None,
    threads: int | None = None,
) -> Callable[[Any], Any]:
    """A function of values (n,) of the parameters that gives the metrics (m,), which PyTorch differentiates backward.

    Arguments are those of `System.gradient`; values are in the order of the parameters. The metrics have the type and
    the device of the values; the run is in double precision always.

    Raises:
        MissingExtraError: without the extra [torch].
        GradientError: a parameter has no derivative; of a call: the run fails.
    """
    with extras.needed("torch", "a function for PyTorch"):
        import torch

    of = _Metrics(system, metrics, parameters, stop_time, interval, threads)

    class Function(torch.autograd.Function):  # type: ignore[misc, name-defined]
        @staticmethod
        def forward(ctx: Any, x: Any) -> Any:
            at = x.detach().cpu().double().numpy()
            if not ctx.needs_input_grad[0]:
                return x.new_tensor(of.values(at))
            values, jacobian = of.jacobian(at)
            ctx.save_for_backward(x.new_tensor(jacobian))
            return x.new_tensor(values)

        @staticmethod
        @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
        def backward(ctx: Any, *by_metric: Any) -> Any:
            return by_metric[0] @ ctx.saved_tensors[0]

    return Function.apply  # type: ignore[no-any-return]
