"""Weights of the preview LQ index (10): files in TOML, checked when read."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator
from pydantic_core import PydanticCustomError

from build_fmus.base.checks import did_you_mean, plain
from build_fmus.component import text_fault

_HERE = Path(__file__).parent / "weights"


class WeightsError(ValueError):
    """A weights file that cannot be used; the message names file, field and remedy."""

    def __init__(self, message: str) -> None:
        super().__init__(plain(message))


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Axles(_Strict):
    front: float = Field(ge=0.0, allow_inf_nan=False, description="both front wheels")
    rear: float = Field(ge=0.0, allow_inf_nan=False, description="both rear wheels")


class _Acceleration(_Strict):
    heave: float = Field(ge=0.0, allow_inf_nan=False, description="rho_1 [s4/m2]")
    pitch: float = Field(ge=0.0, allow_inf_nan=False, description="rho_2 [s4/rad2]")
    roll: float = Field(ge=0.0, allow_inf_nan=False, description="rho_3 [s4/rad2]")


class _Forces(_Strict):
    front: float = Field(gt=0.0, allow_inf_nan=False, description="both front actuators")
    rear: float = Field(gt=0.0, allow_inf_nan=False, description="both rear actuators")


class PreviewLqWeights(_Strict):
    """One set of weights; symmetric left and right, as in the paper."""

    name: str = Field(min_length=1)
    source: str = Field(min_length=1)
    acceleration: _Acceleration = Field(description="accelerations of the body")
    suspension: _Axles = Field(description="suspension deflections [1/m2]")
    tire: _Axles = Field(description="tire deflections [1/m2]")
    force: _Forces = Field(description="actuator forces [1/N2]")

    @field_validator("name", "source")
    @classmethod
    def _can_be_held(cls, given: str) -> str:
        if fault := text_fault(given):
            raise PydanticCustomError("source", "{text}", {"text": fault})
        return given

    def by_name(self) -> dict[str, float]:
        """All weights: `acceleration.heave`, `tire.front`, ..."""
        return {
            f"{kind}.{name}": value
            for kind in self._kinds()
            for name, value in getattr(self, kind).model_dump().items()
        }

    @classmethod
    def descriptions(cls) -> dict[str, str]:
        """What each weight is of, by its name."""
        return {
            f"{kind}.{name}": f"{cls.model_fields[kind].description}, {info.description}"
            for kind, group in cls._kinds().items()
            for name, info in group.model_fields.items()
        }

    def outputs(self, corners: Sequence[str]) -> list[float]:
        """Weights in the order of the outputs: accelerations, suspension and tire deflections by corner."""
        return [self.by_name()[n] for n in output_weights(corners)]

    def controls(self, corners: Sequence[str]) -> list[float]:
        """Weights of the actuator forces by corner."""
        return [self.by_name()[n] for n in control_weights(corners)]

    def as_dict(self) -> dict[str, Any]:
        """JSON values."""
        return self.model_dump()

    @classmethod
    def _kinds(cls) -> dict[str, type[BaseModel]]:
        found = {name: info.annotation for name, info in cls.model_fields.items()}
        return {name: kind for name, kind in found.items() if isinstance(kind, type) and issubclass(kind, BaseModel)}


def output_weights(corners: Sequence[str]) -> list[str]:
    """Name of the weight of each output of the index: accelerations, suspension and tire deflections by corner."""
    return [
        *(f"acceleration.{n}" for n in _Acceleration.model_fields),
        *(f"{kind}.{_axle(k)}" for kind in ("suspension", "tire") for k in corners),
    ]


def control_weights(corners: Sequence[str]) -> list[str]:
    """Name of the weight of the actuator force of each corner."""
    return [f"force.{_axle(k)}" for k in corners]


def _axle(corner: str) -> str:
    return "front" if corner.startswith("f") else "rear"


def load_weights(name_or_path: str | Path) -> PreviewLqWeights:
    """Load weights by the name of a file of this project, or by path.

    Raises:
        WeightsError: no such file, TOML syntax, unknown, missing or negative weight.
    """
    path = Path(name_or_path)
    if path.suffix != ".toml":
        path = _HERE / f"{name_or_path}.toml"
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        names = sorted(p.stem for p in _HERE.glob("*.toml"))
        hint = did_you_mean(path.stem, names)
        raise WeightsError(
            f"{path}: no such weights file{hint} (there are {', '.join(names)}, or give a path)"
        ) from None
    except (ValueError, RecursionError, OSError) as error:  # ValueError: syntax, encoding, numbers without an end
        raise WeightsError(f"{path}: {error}") from None
    try:
        return PreviewLqWeights.model_validate(data)
    except ValidationError as error:
        raise WeightsError("\n".join(f"{path}: {_sentence(e)}" for e in error.errors())) from None


def _sentence(error: Any) -> str:
    field = ".".join(map(str, error["loc"]))
    if error["type"] == "extra_forbidden":
        known = [
            *(n for n in PreviewLqWeights.model_fields if n not in PreviewLqWeights._kinds()),
            *PreviewLqWeights.descriptions(),
        ]
        hint = did_you_mean(field, known) or f" (there are {', '.join(known)})"
        return f"{field}: unknown field{hint}"
    if error["type"] == "missing":
        return f"{field}: missing"
    return f"{field} = {error['input']!r}: {error['msg']}"
