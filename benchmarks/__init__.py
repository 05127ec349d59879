"""Benchmarks of the FMUs and of the co-simulation master: ratios measured in one run."""

import time
from collections.abc import Callable
from typing import Any

from build_fmus.base.one_thread import one_thread

one_thread()


def spent(call: Callable[..., Any], *arguments: Any, **named: Any) -> float:
    """Processor time of one call [s], so that other work on the machine hardly counts."""
    begin = time.process_time()
    call(*arguments, **named)
    return time.process_time() - begin
