"""Whether an FMU keeps to the standard: checks of what it says and of what it does, for FMUs of any origin.

`check()` runs them and returns a `Report`; the command is `cosim check`. The FMU runs in processes of its own, so that
one that crashes, hangs or eats the memory is a finding and nothing else.
"""

from cosim.check.report import Report, Result
from cosim.check.rules import CHECKS, Check, Finding
from cosim.check.runner import Options, Workers, check

__all__ = ["CHECKS", "Check", "Finding", "Options", "Report", "Result", "Workers", "check"]
