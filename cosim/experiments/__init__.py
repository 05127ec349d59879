"""The experiments of the five papers, and those of their cars.

`ride` compares the cars, `handling` steers them, `semi-active` compares dampers.

Each is a folder of the same layout, declared by its `EXPERIMENT`: `__init__` (EXPERIMENT), `runs` (wiring and
measuring), `published` (printed values of the paper, and the plan of the study), `claims`, `report`.
"""

EXPERIMENTS = {
    name: f"cosim.experiments.{name.replace('-', '_')}"
    for name in (
        "bench",
        "gpc",
        "gpc-readings",
        "handling",
        "hmmwv",
        "hmmwv-readings",
        "preview-lq",
        "ride",
        "semi-active",
        "three-axle",
        "trench",
        "trench-readings",
    )
}
"""Name on the command line -> module that has it."""

IDENTIFY = {"gpc": "cosim.experiments.gpc.identify:identify"}
"""Name of an experiment whose controllers are identified -> the command that does it."""
