"""FMI 3.0 lets a variable have further names: the master takes them wherever it takes names."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
from built import BuiltFmus
from foreign import sloped
from foreign.making import redescribed
from lxml import etree
from probes import Clock
from rich.console import Console

from cosim import Fmu, StopWhen, System, WiringError, describe

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")
ALIASES = {"y": "measured", "u": "command", "gain.y": "K", "pole": "smoothing", "clock": "instant"}


class Source(Clock):
    """The time, as a force."""

    outputs = ("y [N]",)


@pytest.fixture(scope="session", params=[False, True], ids=["scalars", "arrays"])
def aliased(request: pytest.FixtureRequest, built_fmus: BuiltFmus, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """ProbeDiscrete with further names of its variables.

    As scalars (`measured[1]` of `y[1]`, ...) and with real arrays (`measured` of `y`).
    """
    original = built_fmus.path("ProbeDiscrete", 3, arrays=request.param)
    with zipfile.ZipFile(original) as archive:
        text = archive.read("modelDescription.xml")
    root = etree.fromstring(text)
    for element in root.iterfind("ModelVariables/*"):
        base, bracket, index = element.get("name").partition("[")
        if base in ALIASES:
            etree.SubElement(element, "Alias", name=ALIASES[base] + bracket + index, description="again")
    path = tmp_path_factory.mktemp("aliased") / "ProbeDiscrete.fmu"
    return redescribed(original, path, (text, etree.tostring(root)))


def wired(fmu: Path, names: dict[str, str]) -> System:
    """A clock into the first measurement, a gain set, all by the names given."""
    system = System()
    system.add("clock", Source(), step="5 ms")
    law = system.add("law", fmu, parameters={names["smoothing"]: 0.5}, start={names["measured"]: [0.0, 3.0, 0.0]})
    law.set({names["K"]: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]})
    system.connect("clock.y", f"law.{names['measured']}[1]")
    return system


def test_names_and_aliases_are_the_same(aliased: Path) -> None:
    own = {alias: name for name, alias in ALIASES.items()}
    results = []
    for names in (own, {alias: alias for alias in ALIASES.values()}):
        with wired(aliased, names) as system:
            assert list(system.connections) == ["law.y[1]"]
            result = system.run(0.2, record=[f"law.{names['command']}", f"law.{names['instant']}"])
            assert result.names == ["law.u[1]", "law.u[2]", "law.clock"]
            np.testing.assert_array_equal(result[f"law.{names['command']}[2]"], result["law.u[2]"])
            assert "law.command[1]" in result
            results.append(result.data.tobytes())
    assert results[0] == results[1]
    assert np.ptp(result["law.command[1]"]) > 0


def test_patterns_stops_and_present_values_take_aliases(aliased: Path) -> None:
    with wired(aliased, {alias: alias for alias in ALIASES.values()}) as system:
        result = system.run(1.0, record="law.comm*", stop_when=[StopWhen("law.instant", ">=", 0.1)])
        assert result.names == ["law.u[1]", "law.u[2]"]
        assert result.time[-1] == pytest.approx(0.1)
        simulation = system.initialize(record=["law.command[1]"])
        simulation.advance(0.1)
        assert simulation["law.command[1]"] == simulation["law.u[1]"]
        simulation.set("law.smoothing", 0.25)
        with pytest.raises(WiringError, match=r"driven by clock\.y"):
            simulation.set("law.measured[1]", 1.0)
        assert system.disconnect("law.measured*") == ["law.y[1]"]


def test_wiring_by_equal_names_finds_aliases(aliased: Path) -> None:
    class Sensor(Clock):
        outputs = ("measured[2] [N]", "instant [s]", "y[3] [N]")

        def step(self, t: float, h: float, u: object, y: list[float]) -> None:  # noqa: ARG002
            y[:] = [t, t, t]

    with System() as system:
        system.add("sensor", Sensor(), step="5 ms")
        system.add("law", aliased)
        made = system.connect_matching("sensor", "law")
        assert sorted(c.target_name for c in made) == ["law.y[2]", "law.y[3]"]


def test_they_are_shown_and_meant_by_suggestions(aliased: Path) -> None:
    console = Console(width=200, record=True)
    console.print(describe(aliased))
    assert "also smoothing" in console.export_text()
    about = Fmu(aliased).description
    assert about.find("smoothing") is about.find("pole")
    with pytest.raises(WiringError, match=r"no variable 'smothing'.*'smoothing'"):
        about.find("smothing")
    assert "smoothing" not in about.variables


def test_two_names_of_one_scalar_are_set_together(tmp_path: Path) -> None:
    """FMI 2.0: variables of one value reference are aliases."""
    change = b'name="trouble" valueReference="5"', b'name="trouble" valueReference="4"'
    path = redescribed(sloped.build(2, tmp_path), tmp_path / "Twice.fmu", change)
    with System() as system:
        system.add("m", path, step="10 ms", parameters={"k": 0.5, "trouble": 0.5}, start={"p": 1.0, "q": 0.0})
        assert system.run(0, record=["m.a"])["m.a"] == pytest.approx([0.5 * np.sin(1.0)])
