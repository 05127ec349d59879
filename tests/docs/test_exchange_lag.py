"""The page on other tools quotes a benchmark: the numbers are those that it prints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pages import ROOT, blocks

from benchmarks import exchange_lag

PAGE = ROOT / "docs" / "how-to" / "other-tools.md"
COMMAND = f"python -m benchmarks exchange_lag\n{str(exchange_lag.__doc__).splitlines()[0]}\n"


def test_the_page_shows_what_the_benchmark_prints(workplace: Path) -> None:  # noqa: ARG001
    (shown,) = (text.removeprefix(COMMAND) for text in blocks(PAGE, "text") if text.startswith(COMMAND))
    lines = dict(line.rsplit(": ", 1) for line in shown.splitlines())
    measured = exchange_lag.measure()
    assert list(lines) == list(measured)
    for name, value in measured.items():  # three digits are shown; platforms differ in the last ones
        assert float(lines[name]) == pytest.approx(value, rel=0.01), name


def test_the_lag_is_all_that_is_measured(workplace: Path) -> None:  # noqa: ARG001
    """FMPy's slaves in the order of this master give its run."""
    duration = 3.0
    master, wired = exchange_lag.by_master(exchange_lag.FmuSet(), duration)
    in_order = exchange_lag.by_fmpy(wired, duration, lag=False)
    np.testing.assert_allclose(in_order, master, rtol=0, atol=1e-9 * np.abs(master).max())
    late = exchange_lag.by_fmpy(wired, duration)
    assert np.abs(late - master)[:, :-1].max() > 0.01 * np.ptp(master[:, :-1])
