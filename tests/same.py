"""Comparison of the two engines bit by bit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cosim import ComponentError, Recording, System

ENGINES = ("python", "compiled")
Run = Callable[[System, str], Recording]


def bits(array: Any) -> np.ndarray:
    """Floats as integers: -0.0 is not 0.0, and every NaN is itself."""
    return np.ascontiguousarray(array, dtype=float).view(np.int64)


def assert_same(one: Recording, other: Recording) -> None:
    """The same samples of the same variables, ended in the same way."""
    assert one.names == other.names
    assert one.stopped_by == other.stopped_by
    np.testing.assert_array_equal(bits(one.time), bits(other.time))
    np.testing.assert_array_equal(bits(one.data), bits(other.data))


def outcome(run: Callable[[], Recording]) -> tuple[str, Recording | None]:
    """What a run says when it fails, and its recording."""
    try:
        return "", run()
    except ComponentError as error:
        return str(error), error.recording
    except Exception as error:
        return f"{type(error).__name__}: {error}", None


def assert_same_outcome(run: Callable[[str], Recording]) -> tuple[str, Recording | None]:
    """`run(engine)` by both engines: the same message and the same recording, which are returned."""
    (said, recording), (also, other) = (outcome(lambda e=engine: run(e)) for engine in ENGINES)
    assert said == also
    assert (recording is None) == (other is None)
    if recording is not None and other is not None:
        assert_same(recording, other)
    return said, recording
