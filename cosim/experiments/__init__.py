"""The experiments of the five papers, and `ride`, which compares their cars; each is a folder of one shape, whose
``EXPERIMENT`` says what it is.

``__init__`` (EXPERIMENT), ``runs`` (wiring and measuring), ``published`` (what the paper prints, and the plan of the
study), ``claims``, ``report``.
"""

EXPERIMENTS = {
    name: f"cosim.experiments.{name.replace('-', '_')}"
    for name in ("bench", "gpc", "hmmwv", "preview-lq", "ride", "three-axle", "trench")
}
"""Name on the command line -> module that has it."""

IDENTIFY = {"gpc": "cosim.experiments.gpc.identify:identify"}
"""Name of an experiment whose controllers are identified -> the command that does it."""
