"""LQR and MPC of paper 001 with their published weights, designed on a full car near rest instead of the ride car."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from build_fmus.base import surface
from build_fmus.component import Component
from cosim.experiments.built import built
from cosim.fmu.file import FmuFile
from cosim.study.case import CaseError
from fmu_sources.controllers.lq.hmmwv import TABLE_1_1, TABLE_1_1_KILONEWTON, lqr_gain
from fmu_sources.controllers.mpc.hmmwv import mpc_hmmwv
from fmu_sources.plants import full_car, linear_ride_car
from fmu_sources.vehicles import load_full_car

RIGID = "wheel.rigid_body"
"""Parameter of cars of kind `full_car`: 1 in all runs of the study."""
DESIGNED = {"hmmwv": "hmmwv", "modified": "hmmwv_modified"}
"""Cars that can be linearized -> vehicle files with their equations; the numbers are those of the FMU."""


@cache
def near_rest(car: str, file: Path) -> Component:
    """The linear ride car of one of `DESIGNED`, with the parameters of its FMU and `RIGID`, as the car is driven.

    Then its weight leans out of the vertical; the states of paper 001 know the road below alone (`over_the_road`).

    Raises:
        CaseError: the FMU is of a car with other equations, such as tires by file.
    """
    vehicle, given = load_full_car(DESIGNED[car]), FmuFile(file).description.parameters
    names = [e.name for e in full_car(vehicle, "FullCar").model().elements("parameter")]
    if missing := [n for n in names if n not in given]:
        raise CaseError(
            f"{file.stem} has no parameter {missing[0]}, so no control law is designed on it: give"
            f" {surface.given(design='paper')}"
        )
    values = {**{n: float(given[n].start) for n in names}, RIGID: 1.0}  # type: ignore[arg-type]
    return linear_ride_car(vehicle, f"RideCar{car.capitalize()}", values, plane=True)


@cache
def lqr_parameters(car: str, file: Path, *, cheap: bool) -> dict[str, float]:
    """Parameters of the FMU of the LQR; `cheap`: force weighted in kN."""
    gain, _ = lqr_gain(near_rest(car, file), TABLE_1_1_KILONEWTON if cheap else TABLE_1_1)
    return {f"gain[{i + 1},{j + 1}]": float(value) for i, row in enumerate(gain) for j, value in enumerate(row)}


@cache
def designed_mpc(car: str, file: Path, fmi: int) -> Path:
    """The FMU of the MPC."""
    return built(mpc_hmmwv(near_rest(car, file), name=f"Mpc{car.capitalize()}"), fmi)
