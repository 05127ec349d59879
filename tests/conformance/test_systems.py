"""What the suite asks of components it asks of whole systems, too, each as one FMU in both versions of FMI.

Their tests are those of the other files, as they are; `LEFT_OUT` says which are not about systems, and why.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import test_calls
import test_compliance
import test_inputs
import test_package
import test_state
import test_time
from api import ERROR, OK, Library, Signals
from built import FMUS, BuiltFmus
from foreign import followers

from cosim import System
from cosim.experiments.bench import runs as bench
from cosim.study import FmuSet

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")
ROWS = 60

LEFT_OUT = {
    "test_further_descriptions_are_there": "systems have no terminals",
    "test_terminals_hold_every_signal_once_under_its_name": "systems have no terminals",
    "test_sources_are_complete": "the sources of members lie in folders of theirs and are included by others",
    "test_every_file_by_others_has_its_license": "those of members have folders of theirs",
    "test_build_options_are_for_compilers_that_know_them": "their sources compile without options",
    "test_foreign_states_are_refused": "the others are the components of the tests",
    "test_other_validators_find_the_reference_result": "systems have no reference result",
    "test_samples_are_counted_exactly": "about one component of the tests",
}
"""Test -> why no system is asked; besides those with `applies_to`, which are about what systems do not offer, or do by
their members.
"""

NOT_WITH_FOREIGN = {"test_units_are_defined_by_base_units": "they may have units that our table does not know"}
"""Test -> why it is about systems without FMUs of others."""

for _module in (test_calls, test_compliance, test_inputs, test_package, test_state, test_time):
    for _name, _test in vars(_module).items():
        _of = [m for m in getattr(_test, "pytestmark", []) if m.name == "parametrize" and "name" in m.args[0]]
        if _name.startswith("test_") and _name not in LEFT_OUT and not _of:
            globals()[_name] = _test


def _passive(_: Path) -> System:
    """The test bench on its road; its actuator is an input."""
    return bench.wire(FmuSet(FMUS), bench.Case("passive"))


def _law_and_plant(_: Path) -> System:
    """A sampled law with a quadratic program, on a bench whose road is an input."""
    system = System()
    system.add("plant", FMUS / "fmi3" / "QuarterCarBench.fmu")
    system.add("law", FMUS / "fmi2" / "MpcBench.fmu")
    system.connect_matching("plant", "law")
    system.connect_matching("law", "plant", "force")
    return system


def _sampled(_: Path) -> System:
    """Nothing but sampled components."""
    system = System()
    system.add("encoders", FMUS / "fmi3" / "BenchEncoders.fmu")
    system.add("law", FMUS / "fmi3" / "LqrBench.fmu")
    system.connect_matching("encoders", "law")
    return system


def _with_foreign(folder: Path) -> System:
    """FMUs of others in both versions, beside one of this project."""
    system = System()
    for version in (2, 3):
        system.add(f"f{version}", followers.build(version, folder), step=f"{version} ms")
    system.add("ours", FMUS / "fmi3" / "QuarterCarHmmwv.fmu", step="1 ms")
    system.connect("f2.y", "f3.u")
    system.connect("f2.count", "f3.count_in")
    return system


SYSTEMS: dict[str, Callable[[Path], System]] = {
    "Passive": _passive,
    "LawAndPlant": _law_and_plant,
    "Sampled": _sampled,
    "WithForeign": _with_foreign,
}


class SystemLibrary(Library):
    """A system's FMU: no Model Exchange; steps are whole numbers of its tick."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.is_continuous = False
        place = self.folder / "resources"
        self.resources = (place.as_uri() if self.fmi == 2 else f"{place}/").encode()
        self.tick = float(Fraction(self.xml.find(".//Component[@tick]").get("tick")))

    @property
    def stimulus(self) -> Signals:  # type: ignore[override]
        """Inputs that move a little about their start values."""
        at = np.arange(ROWS + 1)
        columns = [self._moved(n, at, i) for i, n in enumerate(self.inputs)]
        values = np.column_stack(columns) if columns else np.empty((len(at), 0))
        return Signals(at * self.step, values, self.inputs)

    def _moved(self, name: str, at: np.ndarray, i: int) -> np.ndarray:
        v = self.variables[name]
        start = v.start_value or 0.0
        if v.kind != "real":
            return np.full(len(at), start)
        moved = start + 0.01 * (1 + abs(start)) * np.sin(0.3 * at + i)
        return np.clip(moved, -np.inf if v.low is None else v.low, np.inf if v.high is None else v.high)


@pytest.fixture(scope="module")
def load(built_fmus: BuiltFmus, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, int], Library]:  # noqa: ARG001
    """Systems' FMUs by name and FMI version, each exported and loaded once."""
    loaded: dict[tuple[str, int], Library] = {}

    def get(name: str, fmi: int) -> Library:
        if (name, fmi) not in loaded:
            folder = tmp_path_factory.mktemp(name)
            with SYSTEMS[name](folder) as system:
                loaded[name, fmi] = SystemLibrary(system.export_fmu(folder / str(fmi) / f"{name}.fmu", fmi=fmi))
        return loaded[name, fmi]

    return get


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Over which systems a test is run."""
    if "name" in metafunc.fixturenames:
        without = NOT_WITH_FOREIGN.keys() & {metafunc.function.__name__}
        metafunc.parametrize("name", [n for n in SYSTEMS if not (without and n == "WithForeign")])


def outputs(a: Any) -> bytes:
    return a.get(a.library.outputs).tobytes()


def test_a_step_is_a_whole_number_of_ticks(fmu: SystemLibrary) -> None:
    """Many in one step end where as many steps of one do.

    Less or a part more is an error that names the tick and changes nothing.
    """
    with fmu.instance() as a, fmu.instance() as b:
        for one in (a, b):
            one.initialize(fmu.stimulus.row(0))
            one.set(fmu.stimulus.row(1))
        before = a.serialize()
        for part in (0.5, 1.5, 1e-6, 1 + 1e-6):
            assert a.do_step(0.0, part * fmu.tick) == ERROR
            assert "ticks" in a.last_message
            assert f"{fmu.tick:.9g}" in a.last_message
            assert a.serialize() == before
        assert a.do_step(0.0, 60 * fmu.tick) == OK
        for k in range(60):
            assert b.do_step(k * fmu.tick, fmu.tick) == OK
        assert outputs(a) == outputs(b)


def test_the_bill_of_materials_lists_members_with_what_they_are_made_of(load: Callable[[str, int], Library]) -> None:
    found = {}
    for name in ("LawAndPlant", "WithForeign"):
        bill = load(name, 3).folder / "extra" / "org.fmi-standard.fmi-ls-ref" / "bill-of-materials.cdx.json"
        for component in json.loads(bill.read_text())["components"]:
            if component["name"].endswith(".fmu"):
                found[component["name"]] = {c["name"] for c in component.get("components", [])}
    assert set(found) == {
        "QuarterCarBench.fmu",
        "MpcBench.fmu",
        "follower.fmu",
        "follower_2.fmu",
        "QuarterCarHmmwv.fmu",
    }
    assert {"suspension-fmus", "DAQP"} <= found["MpcBench.fmu"]
    assert found["follower.fmu"] == set()
