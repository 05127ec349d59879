"""Declarations of the catalog: what a component is called, the vehicles it is made of, and the FMUs that it needs.

A declaration stands at the maker of the component, as `@component(...)`. It is read from the text of the module, so
that a list of the catalog imports no equations.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

MODULES = (
    *("plants.quarter_car", "plants.ride_car", "plants.three_axle_trench", "plants.hydraulic_actuator"),
    *("plants.wishbone_car", "plants.linear_car", "plants.full_car", "plants.semi_active_damper"),
    *("controllers.lq.hmmwv", "controllers.lq.preview", "controllers.lq.bench", "controllers.lq.three_axle"),
    *("controllers.skyhook", "controllers.mpc.hmmwv", "controllers.mpc.bench", "controllers.mpc.three_axle"),
    *("controllers.semi_active", "controllers.mpc.semi_active"),
    *("controllers.force_tracking", "controllers.trench.crossing", "controllers.driver"),
    *("sensing.sensor_suite", "sensing.bench_encoders", "estimators.kalman_hmmwv"),
    *("sensing.preview_sensor", "sensing.preview_buffer"),
    *("roads.bumps", "roads.hole_bump", "roads.iso8608", "roads.shallow_trench", "roads.half_cylinder"),
    *("roads.standard", "roads.perryman3", "roads.proving_ground", "roads.random_road"),
    *("roads.bench", "sensing.ride_comfort", "roads.speed_command", "roads.speed_profile"),
    *("controllers.trench.pitch_reference", "controllers.gpc.identification"),
)
"""Modules with declarations, in the order in which the catalog lists the components of one vehicle."""

Maker = TypeVar("Maker", bound=Callable[..., Any])


class Declaration:
    """A component of the catalog. Used as a decorator with literal arguments, `@component(...)`, at its maker.

    The maker is a function that returns a `Component`. It is called with `options`, and its other parameters get, by
    their names:

    - `name`: name of the FMU
    - `vehicle`, `sensors`: contents of the vehicle file, and of the file of the sensors
    - `car`: the plant of the vehicle, from the first declaration for it in `plants`
    - `layout`: the wheels on the road, with the preview of the vehicle's controllers
    - `scan`: what the range sensors see
    - `radius`: of the wheels as they roll over a course [m]
    - `fmus`, `cache`: files of the FMUs that `@needs(...)` names, and the directory of derived data

    Args:
        name: of the FMU. `{v}` stands where published names have what the vehicle is called, `{s}` where only the names
            of FMUs of a user's vehicle have it.
        summary: one line; `{file}` stands for the vehicle file.
        of: names of the published vehicle files that it is made of, separated by spaces; none: of no vehicle.
        scanned: the layout contains what the range sensors see.
        options: further arguments of the maker.
    """

    module = maker = ""  # where it stands: the module in `fmu_sources`, and the name of the function
    needs: tuple[str, ...] = ()

    def __init__(self, name: str, summary: str, *, of: str = "", scanned: bool = False, **options: Any) -> None:
        self.name, self.summary, self.scanned, self.options = name, summary, scanned, options
        self.of = of.split() or [""]

    def __call__(self, maker: Maker) -> Maker:
        """The maker itself, because declarations are read and not run."""
        return maker


component = Declaration


def needs(*_names: str) -> Callable[[Maker], Maker]:
    """Declare the FMUs that must be built before the components of a maker; names as in `Declaration`."""
    return lambda maker: maker


@cache
def declarations(vehicle: str) -> list[Declaration]:
    """The declarations of components that are made of a published vehicle file; `""`: of no vehicle."""
    return [d for d in _all() if vehicle in d.of]


@cache
def _all() -> list[Declaration]:
    return [d for m in MODULES for d in read(Path(__file__).parent / f"{m.replace('.', '/')}.py", m)]


def read(path: Path, module: str) -> list[Declaration]:
    """The declarations in the text of a module.

    Raises:
        ValueError: an argument that is no literal.
    """
    found = []
    for function in ast.parse(path.read_bytes()).body:
        marks: dict[str, list[tuple[list[Any], dict[str, Any]]]] = {"component": [], "needs": []}
        for call in function.decorator_list if isinstance(function, ast.FunctionDef) else ():
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id in marks:
                marks[call.func.id].append(_literals(path, call))
        for arguments, options in marks["component"]:
            declaration = Declaration(*arguments, **options)
            declaration.module, declaration.maker = module, function.name  # type: ignore[attr-defined]
            declaration.needs = tuple(name for names, _ in marks["needs"] for name in names)
            found.append(declaration)
    return found


def _literals(path: Path, call: ast.Call) -> tuple[list[Any], dict[str, Any]]:
    """Positional and named arguments of a call."""
    try:
        return [ast.literal_eval(a) for a in call.args], {str(k.arg): ast.literal_eval(k.value) for k in call.keywords}
    except ValueError:
        raise ValueError(f"{path}:{call.lineno}: a declaration of the catalog takes literals only") from None
