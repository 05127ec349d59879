"""The GPC controller FMUs: the law they evaluate, their timing, their gains as parameters."""

from __future__ import annotations

import json
import zipfile

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from scipy.constants import degree, g

from build_fmus.base import safe_files
from build_fmus.reference import simulate
from fmu_sources.controllers.gpc import identification
from fmu_sources.controllers.gpc.component import FORCE_LIMIT, TICKS_PER_SAMPLE, gpc_controller
from fmu_sources.controllers.gpc.control_law import GpcLaw
from fmu_sources.controllers.gpc.identification import DesignSettings, IdentificationSettings, identify, published_laws
from fmu_sources.models.corners import CORNERS

VARIANTS = ("implicit", "explicit", "preview")


def random_law(variant: str, hold: bool = False) -> GpcLaw:
    rng = np.random.default_rng(4)
    rd = 0 if variant == "implicit" else 4
    return GpcLaw(
        variant, rng.normal(size=(4, 24)) * 100, rng.normal(size=(4, 32)) * 0.05, rng.normal(size=(4, 8 * rd)) * 1e4,
        rng.normal(size=(4, 8 * rd)) * 1e4, 8, 8, 8, np.array([50.0, 10.0, 1.0]), np.array(1e-7), hold=hold,
    )  # fmt: skip


class ByHand:
    """The control law with its histories, fed tick by tick at the sample times of equations (15), (19), (21)."""

    def __init__(self, law: GpcLaw) -> None:
        self.law = law
        self.y, self.u, self.d = np.zeros((8, 3)), np.zeros((8, 4)), np.zeros((8, 4))
        self.tick, self.command = 0, np.zeros(4)

    def step(self, inputs: dict[str, float]) -> np.ndarray:
        y = np.array([inputs["body.az"] / g, inputs["body.pitch"] / degree, inputs["body.roll"] / degree])
        d = np.array([inputs.get(f"road.{k}.height", 0.0) for k in CORNERS])
        if self.tick == 0:
            self.y0, self.d0 = y, d
        if self.tick % TICKS_PER_SAMPLE == 0:
            known = {} if self.law.variant == "implicit" else {"d_hist": self.d}
            if self.law.variant == "preview":
                ahead = [[inputs[f"preview.{k}[{j}]"] for k in CORNERS] for j in range(1, 9)]
                known["d_future"] = np.array(ahead) - self.d0
            self.command = np.clip(self.law.command(self.y, self.u, **known), -FORCE_LIMIT, FORCE_LIMIT)
            self.u = np.vstack([self.command, self.u[:-1]])
            self.d = np.vstack([d - self.d0, self.d[:-1]])
        if self.tick % TICKS_PER_SAMPLE == 1:
            self.y = np.vstack([y - self.y0, self.y[:-1]])
        self.tick += 1
        return self.command


@pytest.mark.parametrize(("variant", "hold"), [*((v, False) for v in VARIANTS), ("explicit", True)])
def test_component_equals_the_law(variant: str, hold: bool) -> None:
    law = random_law(variant, hold)
    component = gpc_controller(law, name="Gpc").model()
    result = simulate(component, steps=300)
    by_hand = ByHand(law)
    expected = np.array([by_hand.step(dict(zip(result.input_names, row, strict=True))) for row in result.inputs[:-1]])
    np.testing.assert_allclose(result.outputs[1:], expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("variant", VARIANTS)
def test_fmu_equals_the_law(built_fmus, tmp_path, variant: str) -> None:
    path = built_fmus.path(f"Gpc{variant.capitalize()}", 2)
    law = GpcLaw.from_dict(json.loads(zipfile.ZipFile(path).read("resources/provenance.json")))
    description = read_model_description(path)
    folder = extract(path, tmp_path)
    fmu = FMU2Slave(
        guid=description.guid,
        unzipDirectory=folder,
        instanceName="gpc",
        modelIdentifier=description.coSimulation.modelIdentifier,
    )
    references = {v.name: v.valueReference for v in description.modelVariables}
    forces = [references[f"force.{k}"] for k in CORNERS]
    stimulus = simulate(gpc_controller(law, name="Gpc").model(), steps=300)
    inputs = [references[n] for n in stimulus.input_names]
    by_hand, got, expected = ByHand(law), [], []
    fmu.instantiate()
    fmu.setupExperiment()
    fmu.enterInitializationMode()
    fmu.setReal(inputs, stimulus.inputs[0].tolist())
    fmu.exitInitializationMode()
    for k, row in enumerate(stimulus.inputs[:-1]):
        fmu.setReal(inputs, row.tolist())
        fmu.doStep(k * 1e-3, 1e-3)
        got.append(fmu.getReal(forces))
        expected.append(by_hand.step(dict(zip(stimulus.input_names, row, strict=True))))
    fmu.terminate()
    fmu.freeInstance()
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_no_feedthrough_but_preview() -> None:
    for variant in VARIANTS:
        component = gpc_controller(random_law(variant), name="Gpc").model()
        for corner in CORNERS:
            on = set(component.dependencies[f"force.{corner}"])
            ahead = {f"preview.{k}[{j}]" for k in CORNERS for j in range(1, 9)} if variant == "preview" else set()
            assert on - {"time"} == ahead


def test_commands_are_limited() -> None:
    law = random_law("implicit")
    component = gpc_controller(law, name="Gpc").model()
    quiet = simulate(component, parameters={"limit": 1.0}, steps=100)
    assert np.abs(quiet.outputs).max() == 1.0


def test_laws_are_those_of_the_fmus(built_fmus) -> None:
    """The laws in the FMUs come out again from the plant FMU, exactly: same seed, same numbers."""
    files = {
        n: built_fmus.path(f, 3)
        for n, f in (("plant", "FullCarHmmwvModified"), ("road", "RoadPerryman3"), ("speed", "SpeedProfile"))
    }
    laws = published_laws(**files)
    for variant, law in laws.items():
        with zipfile.ZipFile(built_fmus.path(f"Gpc{variant.capitalize()}", 3)) as z:
            stored = json.loads(z.read("resources/provenance.json"))
        assert stored == json.loads(law.to_json())


def test_kept_laws_are_used_only_as_they_were_kept(tmp_path, monkeypatch) -> None:
    """An edited gain is not used; neither is what was kept before a build that is told to use nothing old."""
    identified = []

    class Models:
        def law(self, variant: str) -> GpcLaw:
            return random_law(variant)

    monkeypatch.setattr(identification, "identify", lambda *_: identified.append(1) or Models())
    files = {n: tmp_path / n for n in ("plant", "road", "speed")}
    for path in files.values():
        path.write_bytes(path.name.encode())

    def laws() -> dict[str, GpcLaw]:
        return published_laws(**files, cache=tmp_path)

    first = laws()
    (kept,) = (tmp_path / "laws").iterdir()
    assert {v: x.to_json() for v, x in laws().items()} == {v: x.to_json() for v, x in first.items()}
    assert len(identified) == 1
    assert "50.0" in kept.read_text()  # the weight of the heave
    kept.write_text(kept.read_text().replace("50.0", "51.0", 1))
    with pytest.warns(safe_files.DamagedWarning, match=kept.name):
        laws()
    assert len(identified) == 2
    with safe_files.ignore_cache(safe_files.filesystem_time(tmp_path) + 10**9):
        laws()
    assert len(identified) == 3
    files["road"].write_bytes(b"another road")
    laws()
    assert len(identified) == 4


def test_other_orders_and_horizons(built_fmus) -> None:
    files = (built_fmus.path(n, 3) for n in ("FullCarHmmwvModified", "RoadPerryman3", "SpeedProfile"))
    models = identify(*files, IdentificationSettings(seed=1, order=6, samples=300))
    law = models.law("preview", DesignSettings(h_p=12, h_c=5, R=1e-6))
    component = gpc_controller(law, name="Gpc").model()
    assert component.variable("preview.fl").shape == (12,)
    assert component.variable("gain.y").shape == (4, 18)


def test_bad_settings_are_named() -> None:
    with pytest.raises(ValueError, match="order"):
        IdentificationSettings(order=0)
    with pytest.raises(ValueError, match="excitation"):
        IdentificationSettings(excitation=0.0)
