"""Recordings as files and in other libraries: the same bits, names, units and types come back.

What cannot be is refused by name.
"""

from __future__ import annotations

import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from same import bits

from build_fmus.base.units import DisplayUnit
from cosim import FormatError, PythonComponent, Record, Recording, System
from cosim.recording import reading
from cosim.recording.formats import FORMATS
from cosim.recording.spool import recover

ENDINGS = sorted(FORMATS)
TYPED = [e for e in ENDINGS if e != ".csv"]
NAMES = ["car.body.az", "law.y[2]", "law.on", "a/b.n", "law.y[1]", "x.m[1,2]", "x.m[1,1]", "part.z[3]", "Größe.h"]
UNITS = {"car.body.az": "m/s2", "law.y[2]": "m", "law.y[1]": "m", "part.z[3]": "rad", "Größe.h": "N.s/m"}
TYPES = {"law.on": "boolean", "a/b.n": "integer"}


@pytest.fixture
def recording() -> Recording:
    """Awkward numbers, names and orders: whole arrays and parts of one, units that some have, each type."""
    rng = np.random.default_rng(1)
    data = rng.normal(size=(1001, len(NAMES))) * 10.0 ** rng.integers(-300, 300, size=(1001, len(NAMES)))
    data[:5, 0] = [np.nan, np.inf, -np.inf, -0.0, 5e-324]
    data[:, 2], data[:, 3] = rng.integers(0, 2, 1001), rng.integers(-(2**53), 2**53, 1001)
    return Recording(np.arange(1001) / 300, list(NAMES), np.asfortranarray(data), dict(UNITS), types=dict(TYPES))


def assert_alike(one: Recording, other: Recording, *, types: bool = True) -> None:
    assert one.names == other.names
    np.testing.assert_array_equal(bits(one.time), bits(other.time))
    np.testing.assert_array_equal(bits(one.data), bits(other.data))
    assert {n: u for n, u in one.units.items() if u} == {n: u for n, u in other.units.items() if u}
    assert one.types == other.types or not types


@pytest.mark.parametrize("ending", ENDINGS)
def test_what_is_read_is_what_was_written(recording: Recording, ending: str, tmp_path: Path) -> None:
    path = recording.write(tmp_path / "new" / f"a{ending.upper()}")
    assert path.is_file()
    assert_alike(Recording.read(path), recording, types=ending in TYPED)
    first = path.read_bytes()
    assert recording.write(path).read_bytes() == first  # nothing in it depends on when it was written
    assert [p.name for p in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize(("samples", "variables"), [(0, 3), (4, 0), (1, 1), (0, 0)])
def test_recordings_with_little_in_them(ending: str, samples: int, variables: int, tmp_path: Path) -> None:
    names = [f"a.x[{k}]" for k in range(1, variables + 1)]
    small = Recording(np.arange(samples) / 10, names, np.ones((samples, variables)), dict.fromkeys(names, "m"))
    assert_alike(Recording.read(small.write(tmp_path / f"a{ending}")), small)


def test_names_with_the_marks_of_a_csv_file(tmp_path: Path) -> None:
    names = ["a.x;y", "a.x,y", 'a."x"', "a.x\ty", "a.x\u2028y", "a.x\x85y", "a.#x"]
    odd = Recording(np.arange(2.0), names, np.ones((2, len(names))), {})
    assert_alike(Recording.read(odd.write(tmp_path / "a.csv")), odd)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_failed_write_leaves_the_older_file(recording: Recording, ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{ending}"
    path.write_bytes(b"older")
    recording.data = None  # type: ignore[assignment]
    with pytest.raises((TypeError, AttributeError)):
        recording.write(path)
    assert path.read_bytes() == b"older"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["x.txt", "x", "x.parquet.gz", "x.mat", ".csv"])
def test_an_ending_without_a_format_is_refused_before_the_run(name: str, tmp_path: Path, raises) -> None:
    with System() as system:
        system.add("ramp", Ramp(), step="10 ms")
        with raises(FormatError):
            system.run(1.0, output=tmp_path / name)
    assert list(tmp_path.iterdir()) == []
    assert Ramp.steps == 0


@pytest.mark.parametrize("ending", ENDINGS)
def test_files_that_are_none(
    recording: Recording,  # noqa: ARG001
    ending: str,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],  # noqa: ARG001
    raises,
) -> None:
    path = tmp_path / f"a{ending}"
    with raises(FormatError, match=re.escape(f"{path}")):
        Recording.read(path)
    for content in (b"", b"hello\n", b"\x00" * 200):
        path.write_bytes(content)
        with pytest.raises(FormatError, match=re.escape(str(path))):
            Recording.read(path)


def test_files_of_others_without_a_time(tmp_path: Path, raises) -> None:
    pd.DataFrame({"x": [1.0]}).to_parquet(tmp_path / "a.parquet")
    with raises(FormatError):
        Recording.read(tmp_path / "a.parquet")
    xr.Dataset({"x": ("k", [1.0])}).to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    with raises(FormatError):
        Recording.read(tmp_path / "a.nc")
    pd.DataFrame({"time": [0.0], "note": ["x"]}).to_parquet(tmp_path / "b.parquet")
    with raises(FormatError):
        Recording.read(tmp_path / "b.parquet")


def test_one_name_twice(tmp_path: Path, raises) -> None:
    twice = Recording(np.zeros(1), ["a.x", "a.x"], np.zeros((1, 2)))
    with raises(FormatError):
        twice.write(tmp_path / "a.nc")


# ---------------------------------------------------------------------------------------------------- other libraries


def test_pandas(recording: Recording, tmp_path: Path) -> None:
    frame = recording.to_pandas()
    assert (frame.index.name, list(frame.columns)) == ("time", NAMES)
    assert (str(frame["law.on"].dtype), str(frame["a/b.n"].dtype), str(frame["car.body.az"].dtype)) == (
        "bool",
        "int64",
        "float64",
    )
    assert frame.attrs["units"] == {"time": "s", **UNITS}
    np.testing.assert_array_equal(bits(frame["car.body.az"].to_numpy()), bits(recording["car.body.az"]))
    read = pd.read_parquet(recording.write(tmp_path / "a.parquet"))
    assert read.attrs["units"] == {"time": "s", **UNITS}
    pd.testing.assert_frame_equal(read.set_index("time"), frame, check_column_type=False)


def test_xarray_has_arrays_whole(recording: Recording, tmp_path: Path) -> None:
    data = recording.to_xarray()
    assert set(data.data_vars) == {"car.body.az", "law.y", "law.on", "a/b.n", "x.m", "part.z[3]", "Größe.h"}
    assert (data["law.y"].dims, data["x.m"].dims) == (("time", "law.y_1"), ("time", "x.m_1", "x.m_2"))
    assert (data["law.y"].attrs, data.time.attrs) == ({"units": "m"}, {"units": "s"})
    np.testing.assert_array_equal(data["law.y"].sel({"law.y_1": 2}), recording["law.y[2]"])
    np.testing.assert_array_equal(data["x.m"].sel({"x.m_1": 1, "x.m_2": 2}), recording["x.m[1,2]"])
    assert data["law.on"].dtype == bool
    with xr.open_dataset(recording.write(tmp_path / "a.nc"), engine="h5netcdf") as read:
        xr.testing.assert_equal(read, data.rename({"a/b.n": "a_b.n"}))
        assert read["law.y"].attrs["units"] == "m"
        assert json.loads(read.attrs["names"]) == NAMES


def test_mf4_as_its_library_shows_it(recording: Recording, tmp_path: Path) -> None:
    from asammdf import MDF

    with MDF(recording.write(tmp_path / "a.mf4")) as mdf:
        signal = mdf.get("law.y[2]")
        assert signal.unit == "m"
        np.testing.assert_array_equal(signal.samples, recording["law.y[2]"])
        np.testing.assert_array_equal(signal.timestamps, recording.time)
        assert mdf.get("a/b.n").samples.dtype == np.int64


def test_a_plot_has_one_diagram_for_each_unit_and_loses_no_peak(raises) -> None:
    time = np.arange(100_000) / 1000
    data = np.column_stack([np.sin(time), np.cos(time), time > 50])
    data[77_777, 0] = 9.0
    drawn = Recording(time, ["a.x", "a.y", "a.on"], data, {"a.x": "m", "a.y": "m"}, types={"a.on": "boolean"})
    figure = drawn.plot(title="ride")
    assert [t.name for t in figure.data] == drawn.names
    assert [t.yaxis for t in figure.data] == ["y", "y", "y2"]
    assert (figure.layout.yaxis.title.text, figure.layout.xaxis2.title.text) == ("[m]", "time [s]")
    curve = figure.data[0]
    assert len(curve.x) < 10_000
    assert (max(curve.y), curve.x[np.argmax(curve.y)]) == (9.0, 77.777)
    assert (curve.x[0], curve.x[-1]) == (time[0], time[-1])
    assert [t.name for t in drawn.plot("a.?").data] == ["a.x", "a.y"]
    with raises(KeyError):
        drawn.plot("a.z")


def test_a_notebook_shows_a_table(recording: Recording) -> None:
    text = recording._repr_html_()
    assert "1001 samples of 9 variables from 0 to 3.33333333 s" in text
    assert "<td>Größe.h</td><td>N.s/m</td>" in text
    hostile = Recording(np.zeros(1), ["<script>x</script>\x1b"] + [f"a{k}.x" for k in range(40)], np.ones((1, 41)))
    assert "<script" not in hostile._repr_html_()
    assert "and 16 more" in hostile._repr_html_()
    assert "0 samples" in Recording(np.empty(0), ["a.x"], np.empty((0, 1)))._repr_html_()


# ---------------------------------------------------------------------------------------------------------- units


def test_other_units_on_request(raises) -> None:
    data = np.column_stack([[0.0, np.pi], [1.0, 10.0], [273.15, 300.0], [1.0, 2.0]])
    names = ["car.pitch", "car.v", "oil.t", "law.n"]
    one = Recording(
        np.arange(2.0),
        names,
        data,
        {"car.pitch": "rad", "car.v": "m/s", "oil.t": "K"},
        types={"law.n": "integer"},
        display={"car.pitch": DisplayUnit("deg", 180 / np.pi)},
    )
    shown = one.in_units()
    assert (shown.units["car.pitch"], shown.units["car.v"], shown.types) == ("deg", "m/s", {"law.n": "integer"})
    np.testing.assert_allclose(shown["car.pitch"], [0, 180])
    np.testing.assert_array_equal(bits(shown.in_units()["car.pitch"]), bits(shown["car.pitch"]))  # once
    chosen = one.in_units({"car.v": "km/h", "oil.*": "degC"})
    assert chosen.units == {"car.pitch": "rad", "car.v": "km/h", "oil.t": "degC"}
    np.testing.assert_allclose(chosen["car.v"], [3.6, 36])
    np.testing.assert_allclose(chosen["oil.t"], [0, 26.85])
    np.testing.assert_array_equal(one["car.v"], [1.0, 10.0])
    for units in ({"car.v": "kmh"}, {"car.v": "deg"}, {"law.n": "m"}, {"car.w": "m"}):
        with raises(KeyError):
            one.in_units(units)


# ------------------------------------------------------------------------------------------------------------- runs


class Ramp(PythonComponent):
    """Its time, a number of steps, and a parameter that makes it die."""

    outputs = ("t [s]",)
    kind = "discrete"
    steps = 0

    def step(self, t, h, u, y):  # type: ignore[no-untyped-def]  # noqa: ARG002
        Ramp.steps += 1
        y[0] = t


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_run_writes_what_it_returns(ending: str, tmp_path: Path) -> None:
    with System() as system:
        system.add("ramp", Ramp(), step="10 ms")
        recording = system.run(1.0, output=tmp_path / f"a{ending}")
    assert_alike(Recording.read(tmp_path / f"a{ending}"), recording)
    assert list(tmp_path.iterdir()) == [tmp_path / f"a{ending}"]


def test_rows_of_a_run_that_died_become_the_file_that_was_to_be(tmp_path: Path) -> None:
    code = f"""if True:
        import os, time
        from cosim import PythonComponent, System
        class Dies(PythonComponent):
            outputs = ("t [s]",)
            kind = "discrete"
            def step(self, t, h, u, y):
                y[0] = t
                time.sleep(0.02)
                if t > 0.5:
                    os._exit(3)
        with System() as system:
            system.add("d", Dies(), step="10 ms")
            system.run(1, output={str(tmp_path / "a.parquet")!r})
    """
    done = subprocess.run([sys.executable, "-c", code], check=False)
    assert done.returncode == 3
    path, recording = recover(tmp_path / "a.parquet.part")
    assert path == tmp_path / "a.parquet"
    assert_alike(Recording.read(path), recording)
    assert recording.units == {"d.t": "s"}
    assert len(recording) > 10


def test_display_units_of_fmus_go_into_the_file(built_fmus, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    """The run returns SI; the file has what the FMU wants displayed."""
    with System() as system:
        system.add("car", built_fmus.path("FullCarHmmwv", 3), start={"target.speed": 10.0})
        system.allow_unconnected = True
        record = Record(["car.body.pitch", "car.body.z"], display_units=True)
        recording = system.run(0.1, record=record, output=tmp_path / "a.csv")
    assert recording.units["car.body.pitch"] == "rad"
    read = Recording.read(tmp_path / "a.csv")
    assert read.units["car.body.pitch"] == "deg"
    np.testing.assert_allclose(read["car.body.pitch"], np.degrees(recording["car.body.pitch"]), rtol=1e-14)


def damaged(content: bytes, seed: int) -> bytes:
    """Bytes of a file changed, at the end cut off too."""
    rng = random.Random(seed)
    changed = bytearray(content)
    for _ in range(rng.choice((1, 4, 16, 64))):
        changed[rng.randrange(len(changed))] = rng.randrange(256)
    return bytes(changed[: rng.randrange(len(changed))] if seed % 3 == 2 else changed)


@pytest.mark.parametrize("ending", [".nc", ".h5", ".mf4"])
def test_damaged_files_end_in_a_sentence_or_a_recording(ending: str, tmp_path: Path) -> None:
    """Whatever their libraries make of them, in a process of their own."""
    small = Recording(np.arange(20) / 10, ["a.x[1]", "a.x[2]"], np.ones((20, 2)))
    whole = small.write(tmp_path / f"whole{ending}").read_bytes()
    for seed in (1, 2):
        path = tmp_path / f"a{ending}"
        path.write_bytes(damaged(whole, seed))
        try:
            Recording.read(path)
        except FormatError as error:
            assert str(error).startswith(f"{path}: cannot be read as")  # noqa: PT017


@pytest.mark.parametrize(
    ("deed", "end", "seconds", "slack"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "exit code -11", 60.0, 10.0),
        ("exec('while True: pass')", "exit code -", 1.0, 600.0),
        ("import time; time.sleep(600)", "within 1 s", 1.0, 1.0),
        ("bytearray(2**62)", "memory", 60.0, 10.0),
        ("import os; os._exit(3)", "exit code 3", 60.0, 10.0),
    ],
)
@pytest.mark.skipif(os.name == "nt", reason="Windows has no limit of processor time, and other exit codes")
def test_a_library_that_hangs_or_ends_its_process(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, deed: str, end: str, seconds: float, slack: float
) -> None:
    monkeypatch.setattr(reading, "SECONDS", seconds)
    monkeypatch.setattr(reading, "_SLACK", slack)
    path = tmp_path / "a.nc"
    path.write_bytes(b"")
    with pytest.raises(reading.NotRead, match=end):
        reading.read_apart(path, f"from cosim.recording.reading import answer; answer(lambda path: exec({deed!r}))")


@pytest.mark.skipif(os.name == "nt", reason="sends a signal of POSIX")
def test_ctrl_c_ends_a_read_and_its_process(tmp_path: Path) -> None:
    path, pid = tmp_path / "a.nc", tmp_path / "pid"
    path.write_bytes(b"")
    deed = (
        f"import os, signal, time; signal.signal(signal.SIGINT, signal.SIG_IGN); open({str(pid)!r},"
        " 'w').write(str(os.getpid())); time.sleep(600)"
    )
    inner = f"from cosim.recording.reading import answer; answer(lambda path: exec({deed!r}))"
    program = (
        "from pathlib import Path; from cosim.recording import reading;"
        f" reading.read_apart(Path({str(path)!r}), {inner!r})"
    )
    reader = subprocess.Popen([sys.executable, "-c", program], stderr=subprocess.PIPE, text=True)
    while not (pid.exists() and pid.read_text()):
        assert reader.poll() is None
        time.sleep(0.05)
    reader.send_signal(signal.SIGINT)
    assert "KeyboardInterrupt" in reader.communicate(timeout=300)[1]
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid.read_text()), 0)


def test_reading_imports_nothing_from_the_working_folder(
    recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = recording.write(tmp_path / "a.nc")
    (tmp_path / "h5netcdf.py").write_text("raise SystemExit('imported')")
    monkeypatch.chdir(tmp_path)
    assert_alike(Recording.read("a.nc"), recording)
    assert path.is_file()
