"""Comparison of recordings bit by bit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cosim import ComponentError, Recording


def bits(array: Any) -> np.ndarray:
    """Floats as integers: -0.0 is not 0.0, and every NaN is itself."""
    return np.ascontiguousarray(array, dtype=float).view(np.int64)


def assert_same(one: Recording, other: Recording, label: str = "") -> None:
    """The same samples of the same variables, ended in the same way."""
    assert one.names == other.names, label
    assert one.stopped_by == other.stopped_by, label
    np.testing.assert_array_equal(bits(one.time), bits(other.time), label)
    np.testing.assert_array_equal(bits(one.data), bits(other.data), label)


def outcome(run: Callable[[], Recording]) -> tuple[str, Recording | None]:
    """What a run says when it fails, and its recording."""
    try:
        return "", run()
    except ComponentError as error:
        return str(error), error.recording
    except Exception as error:
        return f"{type(error).__name__}: {error}", None
