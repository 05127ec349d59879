"""Read a tire property file (`.tir`); every mistake in it becomes one sentence with the file, the line and the remedy.

Magic Formula 5.2 (`FITTYP` 5, 6, 21, 51 or 52, or `PROPERTY_FILE_FORMAT = 'PAC2002'` or `'MF_05'`) and 6.1 (`FITTYP`
60 or 61; 62 with a warning) are read. SI units are needed, as vendors write them. What has no influence is warned of.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from build_fmus.base.checks import did_you_mean, plain
from fmu_sources.tires.coefficients import (
    COEFFICIENTS,
    EXPONENTS,
    FORCE_SECTIONS,
    LARGEST,
    LARGEST_EXPONENT,
    LEFT_OUT,
    ONLY,
    OTHER_NAMES,
    POSITIVE,
    TYPICAL,
)

_UNITS = {"LENGTH": ("meter", "m"), "FORCE": ("newton", "n"), "ANGLE": ("radians", "radian", "rad"),
          "MASS": ("kg",), "TIME": ("second", "s", "sec"), "PRESSURE": ("pascal", "pa")}  # fmt: skip
_FIT_TYPES = {**dict.fromkeys((5, 6, 21, 51, 52), 5), **dict.fromkeys((60, 61, 62), 6)}  # 6 is older than 60
_LARGEST_ANGLE = 1.5  # rad
_RANGES = (("KPUMIN", "KPUMAX"), ("ALPMIN", "ALPMAX"), ("CAMMIN", "CAMMAX"))
_FORMATS = {"PAC2002": 5, "MF_05": 5, "MF_52": 5, "MF05": 5, "MF52": 5, "MF_61": 6, "MF61": 6}
_MOST = 1_000_000  # bytes; a tire file has some ten thousand
_ENTRY = re.compile(r"\s*([A-Za-z_][\w.]*)\s*=\s*(.*)")


class TireError(ValueError):
    """A tire file that cannot be used. The message names the file, the line and what to do."""

    def __init__(self, message: str) -> None:
        super().__init__(plain(message))


class TireWarning(UserWarning):
    """An entry of a tire file that has no influence."""


@dataclass(frozen=True)
class Tire:
    """A tire of a file.

    Attributes:
        version: of the Magic Formula: 5 for 5.2 and PAC2002, 6 for 6.1.
        side: on which side of a car it was measured, 1 left, -1 right; on the other side its forces are mirrored.
        values: coefficients by name, with the defaults of those that the file does not give.
        name: of the file.
    """

    version: int
    side: int
    values: Mapping[str, float]
    name: str


def read_tire(path: Path) -> Tire:
    """Read a tire file.

    Raises:
        TireError: no such file, no such format, other units than SI, an entry that is missing, given twice, no finite
            number, or out of limits.

    Warns of entries among the coefficients of forces that are unknown, or of another version.
    """
    entries = _entries(path)
    for name, known in _UNITS.items():
        line, given = entries.get(("UNITS", name), (0, known[0]))
        if _text(given).lower() not in known:
            raise TireError(f"{path}:{line}: {name} = {given}: only SI units are read; export the file with {known[0]}")
    version = _version(path, entries)
    found: dict[str, float] = {}
    for (section, written), (line, given) in entries.items():
        name = OTHER_NAMES.get(written, written)
        if name in COEFFICIENTS and (section == COEFFICIENTS[name].section or section not in FORCE_SECTIONS):
            if name in found:
                raise TireError(f"{path}:{line}: {name} is given a second time, in [{section}]; remove one")
            found[name] = _number(path, line, name, given)
            if name in ONLY[version] and found[name] != COEFFICIENTS[name].default:
                other = "6.1" if version == 5 else "5.2"
                _warn(f"{path}:{line}: {name} belongs to Magic Formula {other} and has no influence; see FITTYP")
        elif section in FORCE_SECTIONS and name not in LEFT_OUT:
            near = did_you_mean(name, [n for n, c in COEFFICIENTS.items() if c.section == section])
            _warn(f"{path}:{line}: {name} has no influence: no coefficient of [{section}] is called so{near}")
    missing = [n for n, c in COEFFICIENTS.items() if c.default is None and n not in found]
    if missing:
        raise TireError(f"{path}: {', '.join(missing)} missing; a Magic Formula tire needs them")
    pressure = found.get("NOMPRES") or found.get("INFLPRES")
    if pressure:
        found = {"INFLPRES": pressure, "NOMPRES": pressure, **found}
    values = {n: found.get(n, c.default or 0.0) for n, c in COEFFICIENTS.items()}
    _check_sizes(path, found)
    _limit(values)
    _check(path, values)
    _warn_of_signs(path, found, values)
    line, mode = entries.get(("MODEL", "USE_MODE"), (0, "4"))
    if not re.fullmatch(r"\d*4(\.0*)?", _text(mode)):
        _warn(
            f"{path}:{line}: USE_MODE = {mode} has no influence: all forces and moments are computed, at combined slip"
            " and with relaxation lengths, without turn slip"
        )
    line, side = entries.get(("MODEL", "TYRESIDE"), (0, "LEFT"))
    sides = {"LEFT": 1, "RIGHT": -1, "SYMMETRIC": 1, "UNKNOWN": 1}
    if _text(side).upper() not in sides:
        raise TireError(f"{path}:{line}: TYRESIDE = {side}: must be 'LEFT' or 'RIGHT'")
    return Tire(version, sides[_text(side).upper()], values, path.name)


def _entries(path: Path) -> dict[tuple[str, str], tuple[int, str]]:
    """Section and name in capitals -> line and value as written."""
    try:
        if path.stat().st_size > _MOST:
            raise TireError(f"{path}: more than {_MOST // 1000} kB; this is no tire property file")
        raw = path.read_bytes()
    except OSError as error:
        raise TireError(f"{path}: cannot be read: {error.strerror}") from None
    wide = raw.startswith((b"\xff\xfe", b"\xfe\xff"))
    text = raw.decode("utf-16" if wide else "utf-8-sig", "replace")  # comments may be in any encoding
    entries: dict[tuple[str, str], tuple[int, str]] = {}
    section = ""
    for number, written in enumerate(text.splitlines(), 1):
        line = written.split("$")[0].split("!")[0].strip()
        if line.startswith("["):
            section = line.strip("[]").strip().upper()
        elif entry := _ENTRY.fullmatch(line):
            key = section, entry[1].upper()
            if key in entries:
                raise TireError(
                    f"{path}:{number}: {key[1]} is given a second time, after line {entries[key][0]}; remove one"
                )
            entries[key] = number, entry[2].strip()
        elif line and section in FORCE_SECTIONS:
            raise TireError(f"{path}:{number}: {line[:40]}: write it as NAME = VALUE")
    entries = {key: entry for key, entry in entries.items() if entry[1]}  # vendors leave open what is not known
    if not entries:
        raise TireError(f"{path}: no line has the form NAME = VALUE; this is no tire property file")
    return entries


def _version(path: Path, entries: Mapping[tuple[str, str], tuple[int, str]]) -> int:
    """Version of the Magic Formula."""
    if fit := entries.get(("MODEL", "FITTYP")):
        types = {str(n): n for n in _FIT_TYPES}
        if value := types.get(re.sub(r"\.0*$", "", _text(fit[1]))):
            if value == 62:
                _warn(f"{path}:{fit[0]}: FITTYP = 62: read as 6.1, 6.2 has another radius and overturning moment")
            return _FIT_TYPES[value]
        what = f"{path}:{fit[0]}: FITTYP = {fit[1]}"
    elif given := entries.get(("MODEL", "PROPERTY_FILE_FORMAT")):
        if (format_ := _text(given[1]).upper()) in _FORMATS:
            return _FORMATS[format_]
        what = f"{path}:{given[0]}: PROPERTY_FILE_FORMAT = {given[1]}"
    else:
        what = f"{path}: neither FITTYP nor PROPERTY_FILE_FORMAT in [MODEL]"
    raise TireError(f"{what}: Magic Formula 5.2 (FITTYP 5, 6, 21, 51, 52, PAC2002) and 6.1 (60 to 62) are read")


def _text(given: str) -> str:
    return given.strip().strip("'\"").strip()


def _number(path: Path, line: int, name: str, given: str) -> float:
    try:
        value = float(_text(given))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise TireError(f"{path}:{line}: {name} = {given}: must be a finite number")
    return value


def _warn(text: str) -> None:
    warnings.warn(plain(text), TireWarning, stacklevel=3)


def _limit(values: dict[str, float]) -> None:
    """What was measured on one side of 0 alone holds on the other too; slip angles stay below 90 degrees."""
    for least, most in _RANGES:
        values[least] = values[least] or -values[most]
        values[most] = values[most] or -values[least]
    values["ALPMIN"] = max(values["ALPMIN"], -_LARGEST_ANGLE)
    values["ALPMAX"] = min(values["ALPMAX"], _LARGEST_ANGLE)


def _check_sizes(path: Path, found: Mapping[str, float]) -> None:
    """Refuse numbers that no tire has in SI units."""
    for name, value in found.items():
        known = COEFFICIENTS[name]
        low, high = TYPICAL.get(name, (0.0, LARGEST if known.unit == "1" else 1e12))
        if value and not low <= abs(value) <= high:
            unit = "" if known.unit == "1" else f" {known.unit}"
            raise TireError(
                f"{path}: {name} = {value:g}{unit}: its size must be {low:g} to {high:g}; SI units are needed"
            )


def _warn_of_signs(path: Path, found: Mapping[str, float], v: Mapping[str, float]) -> None:
    """Stiffness and friction that change their sign at a load for which the file was made."""
    nominal = v["LFZO"] * v["FNOMIN"]
    for load in (v[n] for n in ("FZMIN", "FZMAX") if n in found):
        dfz = load / nominal - 1
        signs = {
            "PKX1 + PKX2 dfz": v["PKX1"] + v["PKX2"] * dfz,
            "PDX1 + PDX2 dfz": v["PDX1"] + v["PDX2"] * dfz,
            "(PDY1 + PDY2 dfz) / PDY1": 1 + v["PDY2"] * dfz / v["PDY1"],
            "sin(PKY4 atan(load / (PKY2 FNOMIN)))": math.sin(v["PKY4"] * math.atan(load / nominal / v["PKY2"])),
        }
        for name, value in signs.items():
            if value <= 0 < load:
                _warn(f"{path}: {name} = {value:g} at the load {load:g} N: forces there have the wrong sign")


def _check(path: Path, values: Mapping[str, float]) -> None:
    """Refuse what makes forces undefined or of the wrong sign."""
    for name in (*POSITIVE, *(["PTY2"] if values["PTY1"] else [])):
        if values[name] <= 0:
            raise TireError(f"{path}: {name} = {values[name]:g}: must be above 0")
    for name in EXPONENTS:
        if abs(values[name]) > LARGEST_EXPONENT:
            raise TireError(f"{path}: {name} = {values[name]:g}: an exponent of at most {LARGEST_EXPONENT:g} is needed")
    if values["PKY1"] >= 0 or not values["PDY1"]:
        raise TireError(
            f"{path}: PKY1 = {values['PKY1']:g}, PDY1 = {values['PDY1']:g}: PKY1 must be below 0, so that the side"
            " force opposes the slip (W axes), and PDY1 not 0"
        )
    for least, most in _RANGES:
        if not values[least] < 0 < values[most]:
            raise TireError(f"{path}: {least} = {values[least]:g}, {most} = {values[most]:g}: 0 must lie between them")
    if not 0 <= values["FZMIN"] < values["FZMAX"]:
        raise TireError(f"{path}: FZMIN = {values['FZMIN']:g} must be at least 0 and below FZMAX")
