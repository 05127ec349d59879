"""Sampled models of vehicles under their control laws: what runs deviate by after a bump, over several periods."""

import control
import numpy as np
import pytest
from built import BuiltFmus
from deviations import deviation

from cosim import CosimError, Fmu, System

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")


@pytest.mark.parametrize(
    ("car", "law", "period", "fmi", "start"),
    [
        ("QuarterCarBench", "LqrBench", "2 ms", 2, {}),
        ("RideCarHmmwv", "Skyhook", "30 ms", 3, {}),
        ("RideCarHmmwv", "LqrHmmwv", "30 ms", 2, {}),
        ("RideCarHmmwv", "GpcImplicit", "10 ms", 3, {}),  # runs every 1 ms, samples every 10 ms; 60 hidden states
        ("RideCarSedan", "PreviewLqComfort5ms", "5 ms", 2, {"speed": 14.0}),  # remembers the road between the axles
    ],
)
def test_runs_deviate_as_the_model_says(
    built_fmus: BuiltFmus, car: str, law: str, period: str, fmi: int, start: dict[str, float]
) -> None:
    with System() as system:
        system.add("car", built_fmus.path(car, fmi))
        system.add("law", built_fmus.path(law, fmi), start=start)
        system.connect_matching("car", "law")
        system.connect_matching("law", "car")
        bump = "car.road.fl.height" if "RideCar" in car else "car.road.height"
        ahead = ["law.preview.fl[3]"] if start else []
        model = system.linearize([bump, *ahead], ["car.body.*", "law.force*"], discrete=period)
        seen, said = deviation(system, model, 1e-9, 12)  # small: GPC, designed for another car, is unstable on this one
    assert np.abs(seen).max(axis=0).max() > 0
    scale = np.array(
        [np.abs(seen[:, [o.split("_")[0] == part for o in model.output_labels]]).max() for part in ("car", "law")]
    )
    for column, name in enumerate(model.output_labels):
        size = scale[0 if name.startswith("car") else 1]
        np.testing.assert_allclose(said[:, column], seen[:, column], rtol=1e-4, atol=1e-5 * size)


def test_skyhook_damps_the_body(built_fmus: BuiltFmus) -> None:
    """Poles of the loop, and what became of the car's: the body's modes are better damped than without the law."""
    car = Fmu(built_fmus.path("RideCarHmmwv", 3)).linearize()
    with System() as system:
        system.add("car", built_fmus.path("RideCarHmmwv", 3))
        system.add("law", built_fmus.path("Skyhook", 3))
        system.connect_matching("car", "law")
        system.connect_matching("law", "car")
        loop = system.linearize(discrete=True)
    assert loop.dt == 0.03

    def body_modes(poles: np.ndarray) -> list[float]:
        slow = poles[(np.abs(poles) < 2 * np.pi * 3) & (poles.imag > 0)]
        return sorted((-slow.real / np.abs(slow)).tolist())

    passive = body_modes(control.poles(car))
    z = control.poles(loop)
    controlled = body_modes(np.log(z[np.abs(z) > 1e-6].astype(complex)) / loop.dt)
    assert len(passive) == len(controlled) == 3  # heave, pitch, roll
    assert all(c > p for p, c in zip(passive, controlled, strict=True))


def test_the_full_car_is_linearized_where_it_drives(built_fmus: BuiltFmus) -> None:
    fmu = Fmu(built_fmus.path("FullCarHmmwv", 2))
    model = fmu.linearize("force.*", ["body.z", "speed"], start={"target.speed": 15.0}, settle=0.2)
    assert model.shape == (2, 4)
    assert model.operating_point["speed"] == pytest.approx(15.0, rel=0.1)
    assert model.names["tire_fl_slip"] == "tire.fl.slip"


def test_laws_that_solve_programs_are_refused(built_fmus: BuiltFmus, raises) -> None:
    with raises(CosimError):
        Fmu(built_fmus.path("MpcBench", 3)).linearize()


def test_a_law_with_too_many_states_is_refused_at_once(built_fmus: BuiltFmus, raises) -> None:
    with raises(CosimError):
        Fmu(built_fmus.path("PreviewLqTunable", 3)).linearize()


def test_the_public_car_at_rest_stands_on_a_kink(built_fmus: BuiltFmus) -> None:
    with pytest.raises(CosimError, match=r"wheel\.\w+\.travel_rate = 0"):
        Fmu(built_fmus.path("FullCarHmmwvPublic", 2)).linearize()


def test_gpc_is_stable_on_the_car_it_was_designed_on(built_fmus: BuiltFmus) -> None:
    """The nonlinear car as it drives.

    No mode of the loop grows (distance and course neither grow nor decay), and a disturbed run deviates as the model
    says.
    """
    with System() as system:
        system.add("car", built_fmus.path("FullCarHmmwvModified", 3), start={"target.speed": 13.9})
        system.add("law", built_fmus.path("GpcImplicit", 3))
        system.connect_matching("car", "law")
        system.connect_matching("law", "car")
        model = system.linearize(["car.road.fl.height"], ["car.body.z", "car.body.az", "law.force.*"], discrete="10 ms")
        seen, said = deviation(system, model, 1e-6, 30)
    assert np.abs(control.poles(model)).max() == pytest.approx(1.0, abs=1e-6)
    largest = np.abs(seen).max(axis=0)
    np.testing.assert_allclose(said / largest, seen / largest, rtol=0, atol=2e-3)
