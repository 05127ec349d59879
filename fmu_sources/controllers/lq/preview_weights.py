"""Weights of the preview LQ index (10): files in TOML, checked when read."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from build_fmus.checks import did_you_mean, plain

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
    heave: float = Field(ge=0.0, allow_inf_nan=False, description="rho_1, s4/m2")
    pitch: float = Field(ge=0.0, allow_inf_nan=False, description="rho_2, s4/rad2")
    roll: float = Field(ge=0.0, allow_inf_nan=False, description="rho_3, s4/rad2")


class _Forces(_Strict):
    front: float = Field(gt=0.0, allow_inf_nan=False, description="both front actuators, 1/N2")
    rear: float = Field(gt=0.0, allow_inf_nan=False, description="both rear actuators, 1/N2")


class PreviewLqWeights(_Strict):
    """One set of weights; symmetric left and right, as in the paper."""

    name: str = Field(min_length=1)
    source: str = Field(min_length=1)
    acceleration: _Acceleration
    suspension: _Axles  # deflections, 1/m2
    tire: _Axles  # deflections, 1/m2
    force: _Forces

    def outputs(self, corners: Sequence[str]) -> list[float]:
        """Weights in the order of the outputs: accelerations, suspension and tire deflections by corner."""
        a = self.acceleration
        return [
            a.heave, a.pitch, a.roll,
            *(_of(self.suspension, k) for k in corners), *(_of(self.tire, k) for k in corners),
        ]  # fmt: skip

    def controls(self, corners: Sequence[str]) -> list[float]:
        """Weights of the actuator forces by corner."""
        return [_of(self.force, k) for k in corners]

    def as_dict(self) -> dict[str, Any]:
        """JSON values."""
        return self.model_dump()


def _of(axles: _Axles | _Forces, corner: str) -> float:
    return axles.front if corner.startswith("f") else axles.rear


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
        known = _fields(PreviewLqWeights)
        hint = did_you_mean(field, known) or f" (there are {', '.join(known)})"
        return f"{field}: unknown field{hint}"
    if error["type"] == "missing":
        return f"{field}: missing"
    return f"{field} = {error['input']!r}: {error['msg']}"


def _fields(model: type[BaseModel], prefix: str = "") -> list[str]:
    names: list[str] = []
    for name, info in model.model_fields.items():
        kind = info.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            names += _fields(kind, f"{prefix}{name}.")
        else:
            names.append(prefix + name)
    return names
