"""Files of users: roads, vehicles, weights, laws; recordings, the rows of a run that died, stored results.

A case is a line with its kind, then the file.
"""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from crg_files import crg

from build_fmus.base import safe_files
from cosim import CosimError, Recording, Table, TableError
from cosim.recording.spool import SUFFIX, Spool, recover
from cosim.study.store import NotStored, RunStore, Store
from fmu_sources.controllers.gpc.control_law import GpcLaw
from fmu_sources.controllers.lq.preview_weights import WeightsError, load_weights
from fmu_sources.roads.errors import RoadError
from fmu_sources.roads.layout import RoadLayout, WheelPosition
from fmu_sources.roads.user_file import road_from_file
from fmu_sources.vehicles.loader import VehicleError, load_vehicle

from . import mutate

SOURCES = Path(__file__).parents[2] / "fmu_sources"
KEY = {"case": {"speed": 50.0, "road": "sine"}}


class Refused(Exception):  # noqa: N818
    """A file was refused as its reader says that it does."""


ALLOWED = (Refused,)

# -------------------------------------------------------------------------------------------------------------- seeds


@cache
def _seeds() -> dict[str, tuple[bytes, ...]]:
    import tempfile

    x = np.linspace(0, 3, 31)
    rows = [f"{a:.1f},{0.02 * np.sin(a):.5f},{0.03 * np.cos(a):.5f}" for a in x]
    head = "distance [m],left [m],right [m]\n"
    semicolons = "\n".join(r.replace(",", ";").replace(".", ",") for r in rows)
    recording = Recording(x, ["car.x", "gain.y[2,3]"], np.column_stack([np.sin(x), np.cos(x)]), {"car.x": "m"})
    with tempfile.TemporaryDirectory() as folder:
        csv = recording.to_csv(Path(folder) / "a.csv").read_bytes()
        spool = Spool(Path(folder) / "rows", recording.names, recording.units)
        spool.add(recording.time, recording.data)
        spool.close(keep=True)
        spooled = (Path(folder) / "rows").read_bytes()
        store = RunStore(Store(Path(folder) / "runs"), "salt")
        store.put(KEY, {"metrics": {"rms": 1.5, "worst": float("nan")}, "signals": {"z": [1.0, 2.0]}})
        (lines,) = store.store.directory.iterdir()
        stored = lines.read_bytes()
        store.store.flush()
        (batch,) = store.store.directory.iterdir()
        batched = batch.read_bytes()
        safe_files.keep_json(Path(folder) / "run.json", {"rms": 1.5, "worst": float("nan")})
        kept = (Path(folder) / "run.json").read_bytes()
    vehicles = sorted((SOURCES / "vehicles").glob("*.toml"))
    weights = sorted((SOURCES / "controllers" / "lq").rglob("*.toml"))
    return {
        "road.csv": (
            (head + "\n".join(rows)).encode(),
            b"left [mm]\tdistance [m]\tright [mm]\n1\t0\t2\n2\t1\t3\n",
            (head.replace(",", ";") + semicolons).encode(),
        ),
        "road.crg": (
            _crg("LRFI", ""),
            _crg("LDFI", "REFERENCE_LINE_START_S = 0.01\n"),
            _crg("KRBI", "REFERENCE_LINE_END_U = 4.0\n"),
            _crg("KDBI", "", "$ROAD_CRG_MODS\nSCALE_Z_GRID = 2\n$\n"),
        ),
        "vehicle.toml": tuple(p.read_bytes() for p in vehicles),
        "weights.toml": tuple(p.read_bytes() for p in weights),
        "law.json": (_law().encode(),),
        "recording.csv": (csv,),
        "table.csv": (
            csv,
            b"# logger\nt [ms];z (mm);on\n0,0;1,5;true\n1,5;2,5;false\n2;3;true\n",
            b"time\tp[1]\tp[2] [N]\n0\t1\t2\n1\t2\t3\n",
        ),
        "rows": (spooled,),
        "run.json": (kept,),
        "runs.lines": (stored,),
        "runs.parquet": (batched,),
    }


def _crg(form: str, more: str, blocks: str = "") -> bytes:
    """A course of three long sections."""
    file = crg(
        [[0.01 * i * k for k in range(4)] for i in range(9)],
        [f"long section at v = {v},m" for v in (-1.0, 0.0, 1.0)],
        form=form,
        channels=("reference line slope,m/m",),
        head=more,
        more=blocks,
    )
    return file if isinstance(file, bytes) else file.encode()


def _law() -> str:
    """A law of one control and one output, order and horizons of two."""
    return json.dumps(
        {
            "format": "gpc-law/1",
            "variant": "preview",
            "hold": False,
            "order": 2,
            "h_p": 2,
            "h_c": 2,
            "output_weight": [1.0],
            "control_weight": 1e-7,
            "gain_y": [[1.0, 2.0]],
            "gain_u": [[1.0, 2.0]],
            "gain_d": [[1.0, 2.0]],
            "gain_preview": [[1.0, 2.0]],
            "provenance": {"plant": "x"},
        }
    )


# -------------------------------------------------------------------------------------------------------------- trial


def _road(path: Path) -> None:
    road_from_file(path, RoadLayout((WheelPosition("fl", 0.0, 0.9),), 2, 0.01))


def _weights(path: Path) -> None:
    load_weights(path).as_dict()


def _law_of(path: Path) -> None:
    GpcLaw.from_json(path.read_text(encoding="utf-8")).to_json()


def _recording(path: Path) -> None:
    """One that can be read is read again as it was written."""
    read = Recording.read(path)
    again = Recording.read(read.to_csv(path.with_name("again.csv")))
    np.testing.assert_array_equal(read.data, again.data)
    np.testing.assert_array_equal(read.time, again.time)


def _table(path: Path) -> None:
    """One that can be read shows numbers at its begin and at its end."""
    table = Table(path, after="hold")
    outputs = list(table.description.outputs.values())
    for t in table.times[[0, -1]]:
        table.restore(t)
        assert np.isfinite(table.times).all()
        assert len(table.get(outputs)) == len(outputs)


def _rows(path: Path) -> None:
    recover(path.rename(path.with_name("a.csv" + SUFFIX)))


def _run(path: Path) -> None:
    """A result that is found is the one that was stored."""
    folder = path.parent / "store"
    folder.mkdir()
    path.rename(folder / path.name)
    store = RunStore(Store(folder), "salt")
    assert store.get(KEY)["metrics"]["rms"] == 1.5
    safe_files.keep_json(path, store.get(KEY))


def _kept(path: Path) -> None:
    """A value that is found is the one that was kept."""
    assert safe_files.kept_json(path)["rms"] == 1.5


_READERS: dict[
    str, tuple[Callable[[Path], object], type[Exception], bool]
] = {  # what it raises, and whether it names the file
    "road.csv": (_road, RoadError, True),
    "road.crg": (_road, RoadError, True),
    "vehicle.toml": (load_vehicle, VehicleError, True),
    "weights.toml": (_weights, WeightsError, True),
    "law.json": (_law_of, ValueError, False),
    "recording.csv": (_recording, ValueError, True),
    "table.csv": (_table, TableError, True),
    "rows": (_rows, CosimError, True),
    "run.json": (_kept, safe_files.CacheMiss, False),
    "runs.lines": (_run, NotStored, False),
    "runs.parquet": (_run, NotStored, False),
}


def make(rng: random.Random) -> bytes:
    kind = rng.choice(list(_READERS))
    seed = rng.choice(_seeds()[kind])
    return (
        kind.encode()
        + b"\n"
        + mutate.several(
            rng, seed, mutate.BYTES if kind in ("rows", "run.json", "runs.lines") or b"\0" in seed else mutate.TEXTS
        )
    )


def run(case: bytes, folder: Path) -> None:
    first, _, content = case.partition(b"\n")
    reader, error, named = _READERS[first.decode()]
    path = folder / first.decode()
    path.write_bytes(content)
    try:
        reader(path)
    except error as refused:
        if named and str(folder) not in str(refused):
            raise AssertionError(f"the message does not name the file: {refused}") from refused
        raise Refused(str(refused)) from None
