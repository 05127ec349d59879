"""Command line `build-fmus`: ties the catalog of components to the build pipeline."""

from __future__ import annotations

import functools
import json
import re
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
from rich.table import Table

from build_fmus import builder
from build_fmus.base import safe_files, terminal
from build_fmus.base.layout import FMUS
from build_fmus.base.sources import code_hash
from build_fmus.base.terminal import PATH, SETTINGS, Command, Names, console, show, version_option
from build_fmus.builder import Options
from build_fmus.compile import PLATFORMS
from build_fmus.qp_sources import THIRD_PARTY as SOLVERS
from build_fmus.target.toolchain import TARGETS

PRECISIONS = ("double", "single")
FMI = {"2": (2,), "3": (3,), "both": (2, 3)}


@dataclass(frozen=True)
class UserFiles:
    """Files of the user that FMUs are made of, instead of the published catalog."""

    vehicle: Path | str | None = None  # a file, or with a road the name of a vehicle of this project
    road: Path | None = None
    preview: tuple[int, float] | None = None  # of the road: heights ahead, and the time between them [s]
    weights: Path | None = None
    source: Path | None = None  # Python file with components of the user's own
    maker: str = "make"  # function in it
    name: str | None = None  # of the FMU made of the road or weights file
    period: float = 1e-3  # sample time of the controller made of the weights file [s]

    @property
    def paths(self) -> list[Path]:
        """The files that are given."""
        return [p for p in (self.vehicle, self.road, self.weights, self.source) if isinstance(p, Path)]


def load_catalog(user: UserFiles | None = None) -> dict[str, Any]:
    """The default catalog, or the one of a user's files."""
    from fmu_sources.catalog import default_catalog

    published = default_catalog()
    user = user or UserFiles()
    if not user.paths:
        return published
    from fmu_sources import own_catalog

    entries: dict[str, Any] = {}
    vehicle = user.vehicle if isinstance(user.vehicle, Path) else None
    if vehicle is not None:
        entries = own_catalog.own_catalog(vehicle, own_catalog.catalog_suffix(vehicle))
        if taken := sorted(entries.keys() & published):
            raise ValueError(f"{vehicle} would replace the published {', '.join(taken)}; rename the file")
        needed = {n for e in entries.values() for n in e.needs}
        entries = {n: e for n, e in published.items() if n in needed} | entries

    def add(path: Path, name: str, make: Callable[[str], Any]) -> None:
        name = user.name or name
        if name in published or name in entries:
            raise ValueError(f"{path} would replace the FMU {name}; rename the file, or choose a name with --name")
        entries[name] = make(name)

    if (road := user.road) is not None:
        name = own_catalog.road_name(road, user.vehicle)
        add(road, name, lambda name: own_catalog.road_entry(road, name, user.vehicle or "hmmwv_modified", user.preview))
    if (weights := user.weights) is not None:
        name = own_catalog.weights_name(weights, vehicle)
        add(weights, name, lambda name: own_catalog.preview_lq_entry(weights, name, user.period, vehicle))
    if user.source is not None:
        own = own_catalog.own_entry(user.source, user.maker)
        if own.name in published:
            raise ValueError(f"{user.source} would replace the published {own.name}; give the component another name")
        entries[own.name] = own
    return entries


def build_entry(user: UserFiles, name: str, options: Options, versions: tuple[int, ...]) -> None:
    """Make one catalog entry and write its FMUs (runs in worker processes)."""
    from build_fmus.compile import ObjectCache, resolve_platforms
    from build_fmus.package import build_fmu
    from fmu_sources.catalog import PAPERS, Context

    with safe_files.ignore_cache(options.ignore_cache_before):
        component = load_catalog(user)[name].make(Context(options.out, options.cache))
        component.bibliography = PAPERS
        if options.qp is not None:
            component.choose_backend(options.qp)
        cache, platforms = ObjectCache(options.cache / "objects"), resolve_platforms(options.platform)
        for fmi in versions:
            data = build_fmu(component, fmi, platforms, cache, arrays=options.arrays, clocks=options.clocks)
            safe_files.write(options.target(name, fmi), data)


def build_libraries(
    names: Sequence[str], target: str, options: Options, user: UserFiles | None = None, precision: str = "double"
) -> list[Path]:
    """Build the C libraries of catalog entries for a target (all of a user's file when `names` is empty).

    Returns their folders, `OUT/target/TARGET/NAME`, in single precision `OUT/target/TARGET-single/NAME`.
    """
    from build_fmus.target.library import build_library
    from fmu_sources.catalog import PAPERS, Context, find

    catalog = load_catalog(user)
    if not names and not (user and user.paths):
        raise ValueError(f"--target {target}: name the components to build, such as LqrHmmwv")
    for name in names:
        find(catalog, name)
    folders = []
    for name in names or [n for n in catalog if n not in load_catalog()]:
        component = catalog[name].make(Context(options.out, options.cache))
        component.bibliography = PAPERS
        if options.qp is not None:
            component.choose_backend(options.qp)
        folders.append(build_library(component, TARGETS[target], options.out / "target", precision))
    return folders


def build(
    names: Sequence[str],
    options: Options,
    *,
    user: UserFiles | None = None,
    force: bool = False,
    report: Callable[[str, str], None] = lambda _name, _what: None,
) -> list[str]:
    """Build catalog entries (all when `names` is empty); returns the names that were not up to date."""
    from fmu_sources.catalog import find

    user = user or UserFiles()
    catalog = load_catalog(user)
    for name in names:
        find(catalog, name)
    try:
        options.cache.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=options.cache).close()
    except OSError as error:
        reason = error.strerror or error
        raise OSError(f"cannot write to {options.out} ({reason}); choose another directory with --out") from None
    task = functools.partial(build_entry, user)
    return builder.build(
        catalog, names or list(catalog), options, sources=code_of_makers(), task=task, report=report, force=force
    )


def code_of_makers() -> Callable[[builder.Buildable], str]:
    """Hash of the code that makes the component of an entry.

    All entries depend on the code that makes and builds components. An entry that needs other FMUs also depends on the
    master, which identifies its controller, and a component in a user's file on the modules that the file imports.
    """
    root = Path(__file__).parent
    makers = builder.source_hash(root, *(root.parent / p for p in ("build_fmus", "cosim/core")))
    imports = functools.cache(code_hash)

    def code(entry: builder.Buildable) -> str:
        modules = [root / "controllers" / "gpc" / "identification.py"] if entry.needs else []
        modules += [path for path in entry.files if path.suffix == ".py"]
        return makers + imports(tuple(modules)) if modules else makers

    return code


@click.command(cls=Command, context_settings=SETTINGS)
@click.argument("names", nargs=-1, help="FMUs to build (default: all)")
@click.option("--fmi", type=Names(FMI), default="both", help="FMI version")
@click.option(
    "--platform",
    type=Names(("host", "all", *PLATFORMS)),
    default="host",
    help="build binaries for these platforms, separated by commas",
)
@click.option(
    "--vehicle",
    help="build plant, roads and control laws of this vehicle file (TOML); with --road also the name of a published"
    " vehicle",
)
@click.option("--preview", help="preview of the road of --road: heights x milliseconds between them, such as 16x30")
@click.option("--road", type=PATH, help="build a road FMU from this road file (CSV or OpenCRG)")
@click.option(
    "--from",
    "from_",
    help="build your own component from this Python file, FILE.py or FILE.py:FUNCTION (default function: make)",
)
@click.option(
    "--weights",
    type=PATH,
    help="build a preview LQ controller with a weights file (TOML), for the sedan or the car of --vehicle",
)
@click.option("--period", type=float, default=1e-3, help="sample time of the controller of --weights [s]")
@click.option("--name", help="name of the FMU built by --road or --weights")
@click.option("--out", type=PATH, default=FMUS, help="write fmi2/ and fmi3/ to this directory")
@click.option("--fmi3-arrays/--no-fmi3-arrays", default=False, help="declare vectors and matrices as FMI 3.0 arrays")
@click.option(
    "--clocks", is_flag=True, help="give discrete FMI 3.0 FMUs a clock and event mode, for importers that use them"
)
@click.option("--qp", type=Names(SOLVERS), help="solver of quadratic programs (default: each component's own)")
@click.option(
    "--target",
    type=Names(TARGETS),
    help="build C libraries for this processor instead of FMUs, with their measurements",
)
@click.option("--precision", type=Names(PRECISIONS), default="double", help="numbers of the C libraries of --target")
@click.option(
    "--force/--no-force", default=False, help="build everything from scratch, without caches, even if up to date"
)
@click.option("--list", "list_", is_flag=True, help="list the catalog and stop")
@version_option
def app(
    names: tuple[str, ...],
    fmi: str,
    platform: str,
    vehicle: str | None,
    preview: str | None,
    road: Path | None,
    from_: str | None,
    weights: Path | None,
    period: float,
    name: str | None,
    out: Path,
    fmi3_arrays: bool,
    clocks: bool,
    qp: str | None,
    target: str | None,
    precision: str,
    force: bool,
    list_: bool,
) -> None:
    """Build FMUs from the component declarations."""
    versions = FMI.get(fmi)
    if versions is None:
        raise ValueError(f"--fmi {fmi}: choose {_or(FMI)}")
    if qp is not None and qp not in SOLVERS:
        raise ValueError(f"--qp {qp}: choose {_or(SOLVERS)}")
    file, _, maker = (from_ or "").partition(":")
    user = UserFiles(
        _vehicle(vehicle, road),
        road,
        _preview(preview, road),
        weights,
        Path(file) if file else None,
        maker or "make",
        name,
        period,
    )
    for path in user.paths:
        if not path.is_file():
            raise FileNotFoundError(f"{path}: {'this is a folder' if path.is_dir() else 'no such file'}")
    if name is not None and (road is None) == (weights is None):
        raise ValueError("--name applies to --road and --weights only; give one of these files too")
    if list_:
        table = Table("FMU", "description", "needs first", box=None)
        for entry in load_catalog(user).values():
            table.add_row(entry.name, entry.summary, ", ".join(entry.needs))
        show(table)
        return
    start = time.perf_counter()
    total = {"built": 0, "up to date": 0}

    def report(name: str, what: str) -> None:
        total[what] += 1
        if what == "built":
            console.print(f"  built {name}")

    options = Options(out, versions, platform, fmi3_arrays, clocks, qp)
    if target is not None:
        if target not in TARGETS:
            raise ValueError(f"--target {target}: choose {_or(TARGETS)}")
        if precision not in PRECISIONS:
            raise ValueError(f"--precision {precision}: choose {_or(PRECISIONS)}")
        show_libraries(build_libraries(names, target, options, user, precision))
        return
    if precision != "double":
        raise ValueError(f"--precision {precision} applies to --target only; FMUs have double precision")
    build(names, options, user=user, force=force, report=report)
    seconds = time.perf_counter() - start
    console.print(f"{total['built']} built, {total['up to date']} up to date in {out}/ ({seconds:.1f} s)")


def show_libraries(folders: Sequence[Path]) -> None:
    """Print where libraries are and what they need."""
    table = Table("library", "flash [B]", "RAM [B]", "stack [B]", "folder", box=None)
    for folder in folders:
        metrics = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
        numbers = (metrics[k] for k in ("flash_bytes", "ram_bytes", "stack_bytes"))
        table.add_row(metrics["component"], *("not measured" if n is None else str(n) for n in numbers), str(folder))
    show(table)


def _or(names: Iterable[str]) -> str:
    *first, last = names
    return f"{', '.join(first)} or {last}"


def _vehicle(given: str | None, road: Path | None) -> Path | str | None:
    """A file, or beside a road the name of a published vehicle."""
    if given is None or Path(given).exists():
        return given if given is None else Path(given)
    from fmu_sources.vehicles import vehicle_names

    if given not in vehicle_names():
        raise FileNotFoundError(f"{given}: no such file, nor a vehicle of this project ({', '.join(vehicle_names())})")
    if road is None:
        raise ValueError(
            f"--vehicle {given} is a vehicle of this project: `build-fmus` makes its FMUs. Give a file of your own, or"
            " --road"
        )
    return given


def _preview(given: str | None, road: Path | None) -> tuple[int, float] | None:
    """`16x30` as 16 heights 0.030 s apart."""
    if given is None:
        return None
    if road is None:
        raise ValueError("--preview applies to --road only; give a road file too")
    match = re.fullmatch(r"(\d+)\s*x\s*(\d+(?:\.\d*)?)(?:\s*ms)?", given.strip())
    if not match or int(match[1]) < 2 or float(match[2]) <= 0:
        raise ValueError(f"--preview {given!r}: give heights x milliseconds between them, at least two, such as 16x30")
    return int(match[1]), float(match[2]) / 1e3


def main(program: str = "build-fmus", arguments: list[str] | None = None) -> None:
    """Entry point; `program` is what it was called as, `arguments` are the command line's unless given."""
    called = functools.partial(app, arguments, prog_name=program)
    failures = (ValueError, KeyError, OSError, RuntimeError)
    terminal.run(program, called, failures, "interrupted; finished FMUs are kept")


if __name__ == "__main__":
    main()
