"""`python .ci/release.py FOLDER`: all that a release publishes, the same bytes from the same sources and compilers.

- `suspension-fmus-VERSION-fmus.zip`: every FMU in FMI 2.0 and 3.0 for all five platforms, what they are, their bill
  of materials, their checksums, and the pages in which systems run live;
- a wheel for each platform, with its engine and all FMUs for it, and the source distribution;
- `SHA256SUMS` of these.
"""

from __future__ import annotations

import argparse
import hashlib
import runpy
import sys
import tempfile
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import backend

from build_fmus import related
from build_fmus.base import safe_files
from build_fmus.base.archives import zipped
from build_fmus.base.layout import fmu_path
from build_fmus.builder import Options
from build_fmus.compile import PLATFORMS
from cosim.engine import library
from cosim.experiments.live_pages import write_pages
from cosim.fmu import prebuilt
from cosim.study import FmuSet
from fmu_sources import cli

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PAGES = ("LICENSE", "docs/how-to/other-tools.md", "docs/changelog.md")
REFERENCE = "docs/reference/fmus.md"  # written of what is released
BILL = "bill-of-materials.cdx.json"
SUMS = "SHA256SUMS"
README = """{name} {version}: {n} FMUs, each in FMI 2.0 (fmi2) and FMI 3.0 (fmi3), with binaries for
{platforms}.

{description}

{reference} lists every variable, docs/how-to/other-tools.md says how to set them up in the tool that you have, and
which platforms have been run and how. Each FMU has its sources, its documentation and the licenses of all its parts
inside.
{live}`sha256sum --check {sums}` looks whether the files are whole; {bill} lists what is in them.
"""


LIVE = """Open live/*.html in a browser: systems that run there, with no server and nothing to install.
"""


def live_pages(built: Path, names: list[str]) -> dict[str, bytes]:
    """Pages in which systems of these FMUs run."""
    with tempfile.TemporaryDirectory() as folder:
        return {f"live/{p.name}": p.read_bytes() for p in write_pages(FmuSet(built), Path(folder), names)}


WHEELS = {  # platform -> tag of its wheel, with the oldest system that the compiler aims at
    "x86_64-linux": "manylinux_2_17_x86_64",
    "aarch64-linux": "manylinux_2_17_aarch64",
    "x86_64-windows": "win_amd64",
    "x86_64-darwin": "macosx_11_0_x86_64",
    "aarch64-darwin": "macosx_11_0_arm64",
}


def built_fmus(folder: Path, names: list[str]) -> dict[str, bytes]:
    """The FMUs in a folder by path."""
    return {f"fmi{v}/{n}.fmu": fmu_path(folder, v, n).read_bytes() for v in (2, 3) for n in names}


def wheel(platform: str, names: list[str], options: argparse.Namespace) -> str:
    """Build the FMUs for a platform, what is compiled is shared with those for all, and write its wheel."""
    own = options.fmus / ".wheels" / platform
    (own / ".cache").mkdir(parents=True, exist_ok=True)
    with suppress(FileExistsError):
        (own / ".cache" / "objects").symlink_to((options.fmus / ".cache" / "objects").resolve())
    cli.build(names, Options(own, platform=platform))
    engine = f"cosim/engine/prebuilt/{library.prebuilt_name(platform)}"
    more = {
        engine: library.compiled(platform).read_bytes(),
        f"cosim/fmu/prebuilt/{prebuilt.STORE.name}": prebuilt.store(built_fmus(own, names)),
    }
    return backend.build_wheel(str(options.folder), more=more, platform=WHEELS[platform])


def fmu_archive(built: Path, names: list[str]) -> bytes:
    """The zip of all FMUs, from the folder in which they were built."""
    fmus = built_fmus(built, names)
    live = live_pages(built, names)
    text = README.format(
        n=len(names),
        live=LIVE if live else "",
        platforms=", ".join(PLATFORMS),
        sums=SUMS,
        bill=BILL,
        reference=REFERENCE,
        **{k: PROJECT[k] for k in ("name", "version", "description")},
    )
    pages = {"README.txt": text.encode(), **{n: (ROOT / n).read_bytes() for n in PAGES}, **live}
    pages[REFERENCE] = runpy.run_path(str(ROOT / "docs" / "write_fmus.py"))["reference"](built, names).encode()
    content = {**pages, **fmus, BILL: bill(fmus)}
    return zipped({**content, SUMS: sums(content)})


def bill(fmus: Mapping[str, bytes]) -> bytes:
    """What the FMUs are: each by its hash and with the parts that its own bill lists."""
    release = {"type": "application", "name": PROJECT["name"], "version": PROJECT["version"]}
    return related.bill(release, [related.archived(path, data) for path, data in fmus.items()])


def sums(content: Mapping[str, bytes]) -> bytes:
    """Checksums as `sha256sum` writes and reads them."""
    return "".join(f"{hashlib.sha256(data).hexdigest()}  {name}\n" for name, data in sorted(content.items())).encode()


def main() -> None:
    """Build what is out of date, and write the files of the release."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="receives the files")
    parser.add_argument(
        "--fmus",
        type=Path,
        default=ROOT / "build" / "platforms",
        help="where FMUs for all platforms are built and kept",
    )
    parser.add_argument("names", nargs="*", help="FMUs (default: all)")
    options = parser.parse_args()
    names = options.names or list(cli.load_catalog(cli.UserFiles()))
    cli.build(
        names, Options(options.fmus, platform="all"), report=lambda name, what: print(f"  {what} {name}", flush=True)
    )
    options.folder.mkdir(parents=True, exist_ok=True)
    files = {f"{PROJECT['name']}-{PROJECT['version']}-fmus.zip": fmu_archive(options.fmus, names)}
    for name in (*(wheel(p, names, options) for p in PLATFORMS), backend.build_sdist(str(options.folder))):
        files[name] = (options.folder / name).read_bytes()
    for name, data in {**files, SUMS: sums(files)}.items():
        safe_files.write(options.folder / name, data)
        print(f"{options.folder / name}: {len(data) / 1e6:.1f} MB" if name != SUMS else options.folder / name)


if __name__ == "__main__":
    main()
