"""`cosim run` with signals in and results out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from built import FMUS, BuiltFmus
from programs import refused, run

from cosim import Recording

RIDE = """
from cosim import System

STOP_TIME = 1.0
RECORD = ["car.body.z", "car.road.height", "car.tire.deflection"]

def system(mass: float = 500.0):
    made = System()
    made.add("road", "fmus/fmi3/RoadBenchBump.fmu", start={"bump.start": 0.3})
    made.add("car", "fmus/fmi3/QuarterCarHmmwv.fmu", step="1 ms", start={"force": 0.0})
    made.connect_matching("road", "car")
    return made
"""
TIME = np.arange(1001) / 1000


@pytest.fixture
def folder(built_fmus: BuiltFmus, tmp_path: Path) -> Path:  # noqa: ARG001
    (tmp_path / "fmus").symlink_to(FMUS, target_is_directory=True)
    (tmp_path / "ride.py").write_text(RIDE)
    frame = pd.DataFrame(
        {
            "time [s]": TIME,
            "car.road.height [mm]": 50 * np.sin(9 * TIME),
            "car.road.rate [m/s]": 0.45 * np.cos(9 * TIME),
        }
    )
    frame.to_csv(tmp_path / "track.csv", index=False)
    frame.to_parquet(tmp_path / "track.parquet")
    frame[:500].to_csv(tmp_path / "short.csv", index=False)
    frame.rename(columns={"car.road.height [mm]": "car.rod.height"}).to_csv(tmp_path / "strange.csv", index=False)
    return tmp_path


def test_a_measured_signal_drives_an_input_and_the_result_is_parquet(folder: Path) -> None:
    """From CSV and Parquet the same; it takes the place of the road that the system has."""
    for source in ("track.csv", "track.parquet"):
        run(folder, "cosim", "run", "ride.py", "--input", source, "--output", f"out/{source}.parquet")
    one, other = (Recording.read(folder / "out" / f"track.{e}.parquet") for e in ("csv", "parquet"))
    np.testing.assert_array_equal(one.data, other.data)
    assert set(one.units.values()) == {"m"}
    np.testing.assert_allclose(one["car.road.height"][:-1], 0.05 * np.sin(9 * one.time[:-1]), rtol=0, atol=1e-15)
    assert abs(one["car.body.z"]).max() > 1e-3
    run(folder, "cosim", "run", "ride.py", "--display-units", "--output", "mm.nc")
    assert Recording.read(folder / "mm.nc").units["car.tire.deflection"] == "mm"


def test_a_shorter_file_is_held_on_request(folder: Path, sentence) -> None:
    said = refused(folder, "cosim", "run", "ride.py", "--input", "short.csv")
    sentence(said)
    run(folder, "cosim", "run", "ride.py", "--input", "short.csv", "--hold-input", "--output", "a.csv")
    held = Recording.read(folder / "a.csv")["car.road.height"]
    assert np.ptp(held[500:]) == 0.0


def test_a_text_of_measure_is_in_the_table(folder: Path) -> None:
    (folder / "said.py").write_text(f"{RIDE}\n\ndef measure(run):\n    return {{'ok': 1.0, 'verdict': 'good'}}\n")
    lines = run(folder, "cosim", "run", "said.py").stdout.splitlines()
    assert [line.split() for line in lines[1:3]] == [["ok", "1"], ["verdict", "good"]]


def test_a_plot_may_name_a_pattern(folder: Path) -> None:
    said = run(folder, "cosim", "run", "ride.py", "--plot", "car.tire.*").stdout
    assert "car.tire.deflection [m]" in said


@pytest.mark.parametrize(
    ("command", "arguments"),
    [("error", ["--variable", "car.bodi"]), ("wiring", ["--svg", "y.png"])],
    ids=["error", "wiring"],
)
def test_mistakes_in_other_commands(command: str, arguments: list[str], folder: Path, sentence) -> None:
    before = set(folder.rglob("*"))
    sentence(refused(folder, "cosim", command, "ride.py", *arguments))
    assert not [p for p in set(folder.rglob("*")) - before if p.suffix == ".png"]


@pytest.mark.parametrize(
    "arguments",
    [
        ["--output", "x.txt"],
        ["--input", "strange.csv"],
        ["--input", "nowhere.csv"],
        ["--input", "ride.py"],
        ["--input", "short.csv", "--input", "track.csv"],
        ["--plot", "car.body.zz"],
        ["--fmus", "/nope"],
        ["--isolate", "car", "--memory-limit", "-1"],
        ["--isolate", "car", "--step-timeout", "0"],
    ],
    ids=" ".join,
)
def test_mistakes(arguments: list[str], folder: Path, sentence) -> None:
    """Before anything runs."""
    before = set(folder.rglob("*"))
    sentence(refused(folder, "cosim", "run", "ride.py", *arguments))
    assert [p for p in set(folder.rglob("*")) - before if p.suffix in (".csv", ".txt", ".part")] == []
