"""Which files mistakes are made in, and the tests that should notice each: the one place that says so."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Group:
    """Files and their tests, as patterns from the project's folder.

    `leave`: kinds of mistakes that are not made in them. `slower`: tests that are tried on what the others did not
        notice.
    """

    name: str
    sources: tuple[str, ...]
    tests: tuple[str, ...]
    leave: tuple[str, ...] = ()
    slower: tuple[str, ...] = ()

    def files(self, root: Path = ROOT) -> list[str]:
        """The files, by name from the folder of the project."""
        return [name for name in _found(self.sources, root) if Path(name).name != "__init__.py"]

    def test_files(self, root: Path = ROOT) -> list[str]:
        """Files of the tests, but for the slower ones."""
        return _found(self.tests, root)

    def slower_files(self, root: Path = ROOT) -> list[str]:
        """Files of the slower tests."""
        return _found(self.slower, root)


def _found(patterns: tuple[str, ...], root: Path) -> list[str]:
    return sorted({p.relative_to(root).as_posix() for pattern in patterns for p in root.glob(pattern)})


def _experiment(name: str, *tests: str) -> Group:
    return Group(name, (f"cosim/experiments/{name}/[!e]*.py",), tests or (f"tests/experiments/test_{name}_numbers.py",))


GROUPS = (
    _experiment("gpc", "tests/experiments/test_gpc_numbers.py", "tests/experiments/test_gpc_verdicts.py"),
    _experiment("trench"),
    _experiment("bench"),
    Group("environment", ("cosim/experiments/*/environment.py",), ("tests/learning/test_re[gw]*.py",)),
    Group(
        "hmmwv",
        ("cosim/experiments/hmmwv/[!e]*.py", "cosim/experiments/hmmwv/*/*.py"),
        ("tests/experiments/test_hmmwv_numbers.py", "tests/experiments/test_hmmwv_wiring.py"),
        slower=("tests/experiments/test_hmmwv_judging.py", "tests/experiments/test_verdicts.py"),
    ),
    _experiment("preview_lq"),
    _experiment("three_axle"),
    _experiment("semi_active"),
    Group(
        "ride",
        tuple(f"cosim/experiments/ride/{n}.py" for n in ("runs", "search", "results", "claims", "report", "web")),
        ("tests/experiments/test_ride_numbers.py",),
        slower=("tests/experiments/test_ride_wiring.py",),
    ),
    Group(
        "metrics",
        ("cosim/experiments/metrics/*.py", "cosim/core/signals.py"),
        ("tests/cosim_metrics/test_metrics.py", "tests/cosim_metrics/test_crossing.py"),
    ),
    Group(
        "study",
        tuple(f"cosim/study/{n}.py" for n in ("results", "pages", "claims")),
        ("tests/study/test_claim_lists.py", "tests/study/test_results_and_pages.py", "tests/study/test_study_parts.py"),
    ),
    Group(
        "sweep",
        tuple(f"cosim/study/{n}.py" for n in ("sweep_report", "sweep_statistics", "design")),
        ("tests/study/test_sweep_pages.py", "tests/study/test_design.py"),
    ),
    Group("calibration", ("cosim/study/calibration.py",), ("tests/optimisation/test_calibration.py",)),
    Group("least squares", ("cosim/study/least_squares.py",), ("tests/optimisation/test_least_squares.py",)),
    Group("report", ("cosim/report/*.py",), ("tests/report/*.py",)),
    Group("comfort", ("fmu_sources/models/comfort.py",), ("tests/models/test_comfort.py",)),
    Group("weights", ("fmu_sources/controllers/lq/preview_weights.py",), ("tests/control/lq/test_preview_lq.py",)),
    Group("observer", ("fmu_sources/controllers/mpc/observer.py",), ("tests/control/mpc/test_mpc.py",)),
    Group("estimators", ("fmu_sources/estimators/*.py",), ("tests/estimators/*.py",)),
)
