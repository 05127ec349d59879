"""Designs: which points of the space of its parameters a sweep visits.

Each parameter has a range, a list of values, or a distribution; a method says how points fill the unit cube, which the
parameters map to their values. The same design has the same points everywhere.
"""

from __future__ import annotations

import math
import re
import runpy
import tomllib
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from build_fmus.base import extras, surface
from build_fmus.base.checks import Array, unknown
from cosim.study.case import CaseError

METHODS = {
    "lhs": "Latin hypercube",
    "sobol": "Sobol sequence, scrambled",
    "halton": "Halton sequence, scrambled",
    "random": "independent random numbers",
    "grid": "all combinations",
    "saltelli": "pairs of points for Sobol indices, samples x (parameters + 2) runs",
    "morris": "paths for Morris' elementary effects, samples x (parameters + 1) runs",
}
DISTRIBUTIONS = {
    "uniform": ("low", "high"),
    "normal": ("mean", "deviation"),
    "lognormal": ("median", "deviation of the logarithm"),
    "triangular": ("low", "mode", "high"),
    "truncnormal": ("mean", "deviation", "low", "high"),
}
MANY = 100_000  # runs that are made without a question
GRID = 5  # values of a range in a grid, unless said otherwise


class DesignError(CaseError):
    """A design that cannot be; the message names the parameter or the entry."""


@dataclass(frozen=True)
class Axis:
    """A parameter of a sweep: a field of the cases, or `component.variable` of the system.

    Attributes:
        name: as people write it.
        kind: "values", or the name of a distribution.
        numbers: its parameters, in the order of DISTRIBUTIONS.
        values: of a list.
        count: values in a grid, of a range.
        whole: only whole numbers. Of a range, all of them have the same probability: the quantile u gives number
            `floor(n u)` of the n in it, so LHS and Sobol designs have each equally often to within one slice, and the
            8 levels of Morris are split among them as evenly as 8 can be. Other distributions are rounded to the
            nearest whole number within their limits.
    """

    name: str
    kind: str = "uniform"
    numbers: tuple[float, ...] = ()
    values: tuple[Any, ...] = ()
    count: int = GRID
    whole: bool = False

    def __post_init__(self) -> None:
        n = self.numbers
        if self.kind == "values":
            if not self.values:
                raise DesignError(f"{self.name}: the list has no values")
            return
        if self.kind not in DISTRIBUTIONS:
            raise DesignError(f"{self.name}: {unknown('distribution', self.kind, DISTRIBUTIONS)}")
        names = DISTRIBUTIONS[self.kind]
        if len(n) != len(names):
            raise DesignError(f"{self.name}: {self.kind} needs {', '.join(names)}, not {len(n)} numbers")
        if not all(map(math.isfinite, n)):
            raise DesignError(f"{self.name}: {self.kind} needs finite numbers")
        said = dict(zip(names, n, strict=True))
        if "low" in said and said["low"] >= said["high"]:
            raise DesignError(
                f"{self.name}: the range {said['low']:g} to {said['high']:g} is empty or reversed; give LOW:HIGH"
            )
        if "mode" in said and not said["low"] <= said["mode"] <= said["high"]:
            raise DesignError(
                f"{self.name}: the mode {said['mode']:g} is not between {said['low']:g} and {said['high']:g}"
            )
        if self.whole and "low" in said and math.ceil(said["low"]) > said["high"]:
            raise DesignError(
                f"{self.name}: there is no whole number between {said['low']:g} and {said['high']:g}; give a wider"
                " range"
            )
        if any(v <= 0 for k, v in said.items() if k.startswith("deviation") or k == "median"):
            raise DesignError(
                f"{self.name}: {self.kind} needs a positive deviation" + " and median" * (self.kind == "lognormal")
            )

    def at(self, u: Array) -> list[Any]:
        """Values at quantiles `u` (n,) in [0, 1].

        Raises:
            DesignError: some would not be finite.
        """
        from scipy import special

        n = self.numbers
        if self.kind == "values":
            return [self.values[min(int(x * len(self.values)), len(self.values) - 1)] for x in u]
        if self.kind == "uniform" and self.whole:
            first, last = self.ends
            count = last - first + 1
            # the level 3/7 of 7 numbers is the fourth, however it was rounded
            numbers = np.floor(np.nextafter(u * count, np.inf))
            return [first + min(int(x), count - 1) for x in numbers]
        if self.kind == "uniform":
            found = n[0] + u * (n[1] - n[0])
        elif self.kind == "triangular":
            low, mode, high = n
            split = (mode - low) / (high - low)
            rising = low + np.sqrt(u * (high - low) * (mode - low))
            found = np.where(u < split, rising, high - np.sqrt((1 - u) * (high - low) * (high - mode)))
        elif self.kind == "truncnormal" and (n[2] - n[0] > FAR * n[1] or n[0] - n[3] > FAR * n[1]):
            found = _far_tail(n[0], n[1], n[2], n[3], u)
        else:
            a, b = (special.ndtr((x - n[0]) / n[1]) for x in n[2:]) if self.kind == "truncnormal" else (0.0, 1.0)
            z = special.ndtri(np.clip(a + u * (b - a), 1e-15, 1 - 1e-15))
            found = n[0] * np.exp(n[1] * z) if self.kind == "lognormal" else n[0] + n[1] * z
            if self.kind == "truncnormal":
                found = np.clip(found, n[2], n[3])
        if not np.isfinite(found).all():
            raise DesignError(
                f"{self.name}: values of {self} exceed the range of floating-point numbers; give less extreme numbers"
            )
        if not self.whole:
            return found.tolist()  # type: ignore[no-any-return]
        least, most = self.ends or (-math.inf, math.inf)
        return [int(min(max(math.floor(x + 0.5), least), most)) for x in found.tolist()]

    @property
    def ends(self) -> tuple[Any, ...]:
        """The smallest and largest value; for whole numbers the outermost in the range.

        Empty for a distribution without limits.
        """
        limits = {"uniform": (0, 1), "triangular": (0, 2), "truncnormal": (2, 3)}.get(self.kind, ())
        numbers = [self.numbers[k] for k in limits]
        return (math.ceil(numbers[0]), math.floor(numbers[1])) if numbers and self.whole else tuple(numbers)

    @property
    def length(self) -> int:
        """How many values it has in a grid."""
        if self.kind == "values":
            return len(self.values)
        return min(self.count, self.ends[1] - self.ends[0] + 1) if self.whole and self.kind == "uniform" else self.count

    def grid(self) -> list[Any]:
        """Values in a grid."""
        if self.kind == "values":
            return list(self.values)
        if self.kind != "uniform":
            raise DesignError(f"{self.name}: a grid needs a range or a list, not a {self.kind} distribution")
        if self.whole:
            return [round(x) for x in np.linspace(self.ends[0], self.ends[1], self.length)]
        return np.linspace(self.numbers[0], self.numbers[1], self.count).tolist()  # type: ignore[no-any-return]

    def __str__(self) -> str:
        if self.kind == "values":
            return ", ".join(map(str, self.values))
        if self.kind == "uniform":
            return f"{self.numbers[0]:g} to {self.numbers[1]:g}"
        return f"{self.kind}({', '.join(f'{x:g}' for x in self.numbers)})"


FAR = 5.0  # deviations, beyond which probabilities are too near to 0 or 1 for their difference to tell a value


def _far_tail(mean: float, deviation: float, low: float, high: float, u: Array) -> Array:
    """A normal distribution cut to an interval far from its mean, by logarithms of lower-tail probabilities."""
    from scipy import special

    upper = low > mean
    near, far = (low, high) if upper else (high, low)  # ends of the interval, counted from the mean
    most, least = (float(special.log_ndtr(-abs(x - mean) / deviation)) for x in (near, far))
    share = 1 - u if upper else u  # from the far end to the near one, as probability grows on the lower side
    ratio = math.exp(least - most)
    with np.errstate(divide="ignore"):  # the far end, where it is so far that nothing is left of its probability
        z = special.ndtri_exp(most + np.log(ratio + share * (1 - ratio)))
    found: Array = np.clip(mean - deviation * z if upper else mean + deviation * z, low, high)
    return found


_CALL = re.compile(r"([a-z]+)\((.*)\)")
_MEANT_AS_RANGE = re.compile(r"(-?[\d.]+)\s*(?:-|\u2013|to|\.\.+)\s*(-?[\d.]+)")
_WHOLE = re.compile(r"(-?\d+)\.\.(-?\d+)")


def axis(text: str) -> Axis:
    """Parse `NAME=LOW:HIGH`, `NAME=LOW:HIGH:COUNT` (a grid), `NAME=A,B,C`, `NAME=1..1000` or `NAME=normal(5000,200)`.

    Raises:
        DesignError: the text has none of these forms.
    """
    name, equals, spec = (part.strip() for part in text.partition("="))
    if not (name and equals and spec):
        raise DesignError(f"{text!r}: write NAME=LOW:HIGH, NAME=A,B,C or NAME=normal(MEAN,DEVIATION)")
    if call := _CALL.fullmatch(spec):
        return Axis(name, call[1], tuple(_number(name, x) for x in call[2].split(",")))
    if numbers := _WHOLE.fullmatch(spec):
        low, high = map(int, numbers.groups())
        if low == high:
            return Axis(name, "values", values=(low,))
        return Axis(name, "uniform", (low, high), count=high - low + 1, whole=True)
    if ":" in spec:
        parts = spec.split(":")
        if len(parts) > 3:
            raise DesignError(f"{name}: a range is LOW:HIGH, or LOW:HIGH:COUNT in a grid, not {spec!r}")
        count = _number(name, parts[2]) if len(parts) == 3 else GRID
        if not (math.isfinite(count) and count == int(count)):
            raise DesignError(f"{name}: {parts[2].strip()!r} is not a number of values")
        count = int(count)
        if count < 2:
            raise DesignError(f"{name}: a range in a grid needs two values at least")
        return Axis(name, "uniform", (_number(name, parts[0]), _number(name, parts[1])), count=count)
    return Axis(name, "values", values=tuple(_plain(v.strip()) for v in spec.split(",")))


def check_no_range(name: str, value: Any) -> None:
    """Refuse a text in place of a number that is meant as a range.

    Raises:
        DesignError: 2000-3500; the message says how a range is written.
    """
    if isinstance(value, str) and (meant := _MEANT_AS_RANGE.fullmatch(value)):
        raise DesignError(f"{name}: a range is written LOW:HIGH, for example {meant[1]}:{meant[2]}")


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise DesignError(f"{name}: {text.strip()!r} is not a number") from None


def _plain(text: str) -> Any:
    """A value of a list: a number, true or false, else a text."""
    if text in ("true", "false"):
        return text == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


@dataclass(frozen=True)
class Design:
    """Points of a sweep.

    Attributes:
        axes: parameters that vary.
        method: see METHODS; "list" for points that were listed.
        samples: how many points, or pairs and paths of them.
        seed: of the random numbers.
        listed: points that were given.
        fixed: values of other options of the cases.
    """

    axes: tuple[Axis, ...]
    method: str = "lhs"
    samples: int = 100
    seed: int = 1
    listed: tuple[tuple[Any, ...], ...] = ()
    fixed: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.axes:
            vary = surface.hint("axes", "--vary NAME=LOW:HIGH")
            raise DesignError(f"nothing varies: give {vary}{surface.hint(shell=', or a file with --design')}")
        names = [a.name for a in self.axes]
        if twice := sorted({n for n in names if names.count(n) > 1}):
            raise DesignError(f"{twice[0]} is given twice")
        if self.method not in (*METHODS, "list"):
            raise DesignError(unknown("method", self.method, METHODS))
        if self.samples < 1:
            raise DesignError(f"{self.samples} samples; give 1 or more")
        if self.seed < 0:
            raise DesignError(f"the seed is {self.seed}; give 0 or more")
        if both := sorted(set(names) & set(self.fixed)):
            raise DesignError(f"{both[0]} is both set and varied; leave one of them out")

    @property
    def runs(self) -> int:
        """How many points."""
        if self.method == "list":
            return len(self.listed)
        if self.method == "grid":
            return math.prod(a.length for a in self.axes)
        d = len(self.axes)
        return self.samples * {"saltelli": d + 2, "morris": d + 1}.get(self.method, 1)

    def cube(self) -> Array:
        """Points in the unit cube (runs, parameters), of all methods but lists and grids.

        Raises:
            DesignError: they do not fit into memory.
        """
        try:
            return self._cube()
        except MemoryError:
            raise DesignError(
                f"{self.runs} points do not fit into memory; take fewer {surface.name_of('samples')}"
            ) from None

    def _cube(self) -> Array:
        d, n = len(self.axes), self.samples
        random = np.random.default_rng(self.seed)
        if self.method == "random":
            return random.random((n, d))
        if self.method == "lhs":
            return _latin_hypercube(n, d, random.spawn(1)[0])  # as scipy takes one from it
        if self.method in ("saltelli", "morris"):
            with extras.needed("sensitivity", f"a design for the method of {self.method.capitalize()}"):
                from SALib.sample import morris, sobol
            if self.method == "saltelli":
                n = _power_of_two(n, "saltelli")
                return np.asarray(sobol.sample(self.problem, n, calc_second_order=False, seed=self.seed), dtype=float)
            return np.asarray(morris.sample(self.problem, n, num_levels=8, seed=self.seed), dtype=float)
        if self.method == "sobol":
            _power_of_two(n, "sobol")
        from scipy.stats import qmc

        kinds = {"sobol": qmc.Sobol, "halton": qmc.Halton}
        return np.asarray(kinds[self.method](d, seed=random).random(n), dtype=float)

    @property
    def problem(self) -> dict[str, Any]:
        """The unit cube as SALib describes it."""
        return {
            "num_vars": len(self.axes),
            "names": [a.name for a in self.axes],
            "bounds": [[0.0, 1.0]] * len(self.axes),
        }

    def columns(self) -> list[list[Any]]:
        """Values of each parameter at all points, in their order."""
        if self.method == "list":
            return [list(column) for column in zip(*self.listed, strict=True)]
        if self.method == "grid":
            grids = [a.grid() for a in self.axes]
            numbers = np.indices([len(g) for g in grids]).reshape(len(grids), -1)
            return [[g[i] for i in row] for g, row in zip(grids, numbers.tolist(), strict=True)]
        cube = self.cube()
        return [a.at(cube[:, k]) for k, a in enumerate(self.axes)]


def _latin_hypercube(n: int, d: int, random: np.random.Generator) -> Array:
    """Points (n, d), one in each of n slices of every parameter.

    They are those of `scipy.stats.qmc.LatinHypercube`, bit for bit, without loading `scipy.stats`, which takes 40 MB
    that a sweep of many runs needs for other purposes.
    """
    inside = random.uniform(size=(n, d))
    slices = np.tile(np.arange(1, n + 1), (d, 1))
    for row in slices:
        random.shuffle(row)
    return (slices.T - inside) / n


def _power_of_two(n: int, method: str) -> int:
    if n & (n - 1):
        raise DesignError(
            f"{n} samples: a Sobol sequence (--method {method}) is balanced for powers of two only, such as "
            f"{1 << (n.bit_length() - 1)} or {1 << n.bit_length()}"
        )
    return n


# -------------------------------------------------------------------------------------------------------------- files

_ENTRIES = ("method", "samples", "seed", "vary", "set", "cases")


def from_file(path: Path) -> Design:
    """The design of a TOML file, or of `DESIGN` in a Python file, a dict of the same structure.

        method = "sobol"            # as --method
        samples = 1024
        seed = 3
        [vary]                      # texts as on the command line, or lists of values
        "car.body.mass" = "4000:6000"
        damping = [6e3, 12e3]
        [set]                       # options of the cases that do not vary
        duration = 0.5
        [[cases]]                   # instead of vary: a list of points
        damping = 6e3

    Raises:
        DesignError: there is no such file, or an entry has none of these forms.
    """
    if path.suffix not in (".toml", ".py"):
        raise DesignError(f"{path}: a design is a .toml or a .py file")
    if not path.exists():
        raise DesignError(f"{path} does not exist")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise DesignError(f"{path}: cannot be read: {error.strerror}") from None
    try:
        found = tomllib.loads(content.decode()) if path.suffix == ".toml" else runpy.run_path(str(path)).get("DESIGN")
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, SyntaxError) as error:
        raise DesignError(f"{path}: not a {'TOML' if path.suffix == '.toml' else 'Python'} file: {error}") from None
    except Exception as error:  # of the user's code
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
        where = f", line {lines[-1]}" if lines else ""
        raise DesignError(f"{path}{where}: {type(error).__name__}: {error}") from None
    if not isinstance(found, Mapping):
        raise DesignError(f"{path}: DESIGN must be a dict with {', '.join(_ENTRIES)}")
    try:
        return _from_mapping(found)
    except DesignError as error:
        raise DesignError(f"{path}: {error}") from None


def _from_mapping(found: Mapping[str, Any]) -> Design:
    for entry in found:
        if entry not in _ENTRIES:
            raise DesignError(unknown("entry", entry, _ENTRIES))
    for entry, kind, what in (
        ("method", str, "a text"),
        ("samples", int, "a whole number"),
        ("seed", int, "a whole number"),
        ("vary", Mapping, "a table"),
        ("set", Mapping, "a table"),
        ("cases", Sequence, "a list of tables"),
    ):
        if entry in found and (not isinstance(found[entry], kind) or isinstance(found[entry], bool)):
            raise DesignError(f"{entry} must be {what}")
    fixed = dict(found.get("set", {}))
    rest = {k: found[k] for k in ("method", "samples", "seed") if k in found}
    if "cases" not in found:
        return Design(tuple(_axis(n, v) for n, v in found.get("vary", {}).items()), fixed=fixed, **rest)
    if "vary" in found or rest:
        raise DesignError("cases define the whole design: leave out vary, method, samples and seed, or the cases")
    cases = found["cases"]
    if not cases or not all(isinstance(c, Mapping) and c for c in cases):
        raise DesignError("cases must be tables with the values of each case")
    names = list(cases[0])
    for number, case in enumerate(cases, start=1):
        if set(case) != set(names):
            raise DesignError(f"case {number} names {', '.join(case)}; the first one names {', '.join(names)}")
    points = tuple(tuple(case[n] for n in names) for case in cases)
    axes = tuple(Axis(n, "values", values=tuple(dict.fromkeys(p[k] for p in points))) for k, n in enumerate(names))
    return Design(axes, "list", len(points), listed=points, fixed=fixed)


def _axis(name: str, given: Any) -> Axis:
    if isinstance(given, str):
        return axis(f"{name}={given}")
    if isinstance(given, Sequence):
        return Axis(name, "values", values=tuple(given))
    raise DesignError(f"{name}: give a text such as '4000:6000', or a list of values")


def whole(design: Design, names: Sequence[str]) -> Design:
    """The design in which some parameters are whole numbers."""
    return replace(design, axes=tuple(replace(a, whole=True) if a.name in names else a for a in design.axes))
