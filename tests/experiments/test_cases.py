"""Cases of the experiments that do not exist: each is refused with a sentence."""

from __future__ import annotations

import math
from typing import Any

import pytest

from cosim.experiments import EXPERIMENTS
from cosim.study import CaseError, load

CHOICES: dict[str, list[dict[str, Any]]] = {
    "bench": [
        {"controller": "mcp"},
        {"road": "bumpy"},
        {"duration": 0.0},
        {"road": "random", "offset": -1.0},
        {"height_mm": 1000.0},
        {"height_mm": math.nan},
        {"offset": 5.0},
        {"road": "random", "height_mm": 10.0},
        {"controller": "passive", "encoders": True},
    ],
    "gpc": [
        {"road": "sinus"},
        {"controller": "previw"},
        {"speed_kmh": 0.0},
        {"speed_kmh": 500.0},
        {"speed_kmh": math.nan},
        {"R": -1.0},
        {"controller": "preview", "hold": True},
    ],
    "hmmwv": [
        {"road": "trak"},
        {"controller": "skyhok"},
        {"actuators": "electric"},
        {"controller": "passive", "actuators": "ideal"},
        {"speed_kmh": 0.0},
        {"speed_kmh": math.nan},
        {"variant": 6},
        {"road": "off-road", "variant": 5},
        {"duration": 1e3},
        {"null_opening_mm": 0.0},
        {"states": "guessed"},
        {"controller": "zero", "states": "estimated"},
        {"actuators": "ideal", "states": "estimated"},
        {"controller": "mpc", "preview_steps": 3},
        {"preview": "sensed"},
        {"preview_steps": 16},
        {"preview": "sensed", "states": "estimated", "preview_error_ms": 5.0},
        {"preview_error_ms": 1e3},
        {"pump_l_min": 60.0},
        {"actuators": "ideal", "flow_limit": True},
        {"flow_limit": True, "pump_l_min": 0.0},
        {"solver_parts": 0},
    ],
    "preview-lq": [
        {"input": "booth"},
        {"weights": "confort"},
        {"controller": "previw"},
        {"shape": "square"},
        {"preview_time": -0.1},
        {"speed_kmh": 500.0},
        {"controller": "delay", "preview_time": 0.2},
        {"controller": "passive", "hold_tail": True},
    ],
    "three-axle": [
        {"controller": "mpc-previw"},
        {"estimator": "rode"},
        {"speed_kmh": 100.0},
        {"depth": -0.1},
        {"speed_kmh": math.nan},
        {"controller": "lqr", "estimator": "road"},
        {"controller": "passive", "hold_height": True},
    ],
    "trench": [
        {"length": 0.0},
        {"length": -1.0},
        {"length": 9.0},
        {"length": math.nan},
        {"speed_kmh": 0.0},
        {"depth": 0.0},
        {"friction": -0.1},
        {"mass": math.inf},
        {"mass_factor": 0.0},
        {"cg_offset": 2.0},
        {"solver_parts": 0},
        {"exchange_parts": 17},
        {"controller": "mcp"},
    ],
}


@pytest.mark.parametrize(
    ("name", "choice"), [(name, choice) for name, choices in CHOICES.items() for choice in choices]
)
def test_cases_that_do_not_exist(name: str, choice: dict[str, Any], raises) -> None:
    with raises(CaseError):
        load(EXPERIMENTS[name]).case(**choice)
