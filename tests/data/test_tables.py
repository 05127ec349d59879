"""Signals from tables drive inputs: what they show when, in which units, where they come from, and what is refused."""

from __future__ import annotations

import re
import warnings
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from built import BuiltFmus
from oracles.exchange_rule import by_the_rule
from same import assert_same, bits

from cosim import (
    ComponentError,
    CosimError,
    PythonComponent,
    Record,
    Recording,
    System,
    SystemState,
    Table,
    TableError,
    WiringError,
)

TIME = np.arange(101) / 50


class Sink(PythonComponent):
    inputs = ("z [m]", "f [N]", "t [K]", "plain")
    outputs = ("seen [m]", "sum")
    kind = "discrete"
    default_step = "1 ms"

    def step(self, t, h, u, y):  # type: ignore[no-untyped-def]  # noqa: ARG002
        y[:] = u[0], u.sum()


def run(table: Table, stop: float = 1.0, *, step: Any = None, **options: Any) -> Recording:
    with System() as system:
        system.add("road", table, step=step)
        return system.run(stop, **options)


def test_linear_between_rows_and_held_from_row_to_row() -> None:
    rng = np.random.default_rng(7)
    time = np.concatenate([[0.0], np.cumsum(rng.uniform(0.0005, 0.05, 99))])
    z, n = rng.normal(size=100), rng.integers(-9, 9, 100)
    table = Table(
        {"time": time, "z": z, "n": n, "same": z, "on": n > 0},
        interpolation={"n": "held", "same": "held"},
        after="hold",
    )
    r = run(table, 4.0)
    np.testing.assert_allclose(r["road.z"], np.interp(r.time, time, z), rtol=0, atol=1e-14)
    row = np.searchsorted(time, r.time + 1e-12, "right") - 1
    for name, column in (("n", n), ("same", z), ("on", n > 0)):
        np.testing.assert_array_equal(r[f"road.{name}"], column[row])
    assert r.types == {"road.n": "integer", "road.on": "boolean"}


def random_table(seed: int) -> Table:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 200))
    time = np.cumsum(10.0 ** rng.uniform(-6, -1.5, n)) - 0.5 * rng.random()
    names = [f"x[{k}]" for k in range(1, int(rng.integers(3, 10)))]
    how = {name: str(rng.choice(["held", "linear"])) for name in names}
    columns = {n: rng.normal(size=len(time)) * 10.0 ** rng.integers(-200, 200) for n in names}
    return Table({"t": time, **columns}, interpolation=how, after="hold", shift=-time[0])  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(12))
def test_the_engine_reads_a_table_as_python_does(seed: int) -> None:
    """Any rates, offsets and choices of outputs, the recorded ones not in the order of the table."""
    rng = np.random.default_rng(seed)
    step, record = (
        Fraction(int(rng.integers(1, 40)), int(rng.integers(500, 3000))),
        ["road.x[2]", "road.x[1]", "road.*"],
    )
    found = run(random_table(seed), 2.0, step=step, record=Record(record, step / 2))
    with System() as system:
        system.add("road", random_table(seed), step=step)
        assert_same(found, by_the_rule(system, Fraction(2), found.names, step / 2))
    assert np.ptp(found.data, axis=0).max() > 0


def test_units_are_converted_where_it_is_connected(tmp_path: Path, raises) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time [ms],z [mm],f (kN),t [degC],ratio [-]\n0,1000,1,0,1\n500,2000,2,10,2\n1000,3000,3,20,3\n")
    with System() as system:
        system.add("road", Table(path))
        system.add("sink", Sink())
        for name in "zft":
            system.connect(f"road.{name}", f"sink.{name}")
        system.connect("road.ratio", "sink.plain")
        r = system.run(1.0, record=["sink.*", "sink.t", "sink.f", "sink.plain", "road.*"])
        at = int(np.searchsorted(r.time, 0.5))
        assert [r[n][at] for n in ("sink.seen", "sink.f", "sink.t", "sink.plain")] == [2.0, 2000.0, 283.15, 2.0]
        assert r.units["road.z"] == "mm"
        with raises(WiringError):
            system.connect("road.f", "sink.z")
        system.disconnect("sink.z")
        with raises(WiringError):
            system.connect("road.f", "sink.z")
    with System() as system:
        system.add("road", Table(path, units={"f": "N", "t": ""}, columns=["t", "f"]))
        assert [(v.name, v.unit_name) for v in system["road"].description.outputs.values()] == [("f", "N"), ("t", "")]


def test_arrays_are_connected_whole() -> None:
    class Wide(PythonComponent):
        inputs = ("u[1]", "u[2]")
        outputs = ("y",)
        default_step = "1 ms"

        def step(self, t, h, u, y):  # type: ignore[no-untyped-def]  # noqa: ARG002
            y[0] = u[0] - u[1]

    with System() as system:
        system.add("road", Table({"time": TIME, "p[1]": TIME, "p[2] [m]": -TIME}))
        system.add("wide", Wide())
        system.connect("road.p", "wide.u")
        assert system.run(1.0)["wide.y"][-1] == pytest.approx(2 * 0.999)


def test_others_settle_to_its_first_values(built_fmus: BuiltFmus) -> None:
    """Outputs that depend on them, and states that follow inputs: the car stands on its road."""
    with System(allow_unconnected=True) as system:
        system.add("road", Table({"time": TIME, "z [m]": 0.3 + TIME, "f [N]": 5.0 - TIME}))
        system.add("car", built_fmus.path("QuarterCarBench", 3), step="1 ms")
        system.connect("road.f", "car.force")
        mass = float(system["car"].start("body.mass"))
        assert system.run(0.1, record=["car.body.az"])["car.body.az"][0] == pytest.approx(5.0 / mass)
    with System(allow_unconnected=True) as system:
        system.add("road", Table({"time": TIME, "z [m]": 0.3 + 0.0 * TIME}))
        system.add("car", built_fmus.path("FullCarHmmwv", 3), step="1 ms")
        for corner in ("fl", "fr", "rl", "rr"):
            system.connect("road.z", f"car.road.{corner}.height")
        rise = system.run(0.1, record=["car.body.z"])["car.body.z"]
        assert np.ptp(rise) < 1e-9


def test_rounded_times_of_a_file_count_as_what_they_mean() -> None:
    """Some k * 0.001 differ from k/1000 by one bit; the row counts at its own instant all the same."""
    time = np.arange(1000) * 0.001
    assert np.any(time > np.arange(1000) / 1000)
    table = Table({"t": time, "n": np.arange(1000)}, interpolation="held")
    np.testing.assert_array_equal(run(table, 1.0)["road.n"][:1000], np.arange(1000))


@pytest.mark.parametrize(
    ("interval", "expected"), [(0.01, "1/1000"), (1 / 3000, "1/3000"), (0.00025, "1/4000"), (1e-9, "1/1000")]
)
def test_the_step_is_a_millisecond_or_that_of_finer_rows(interval: float, expected: str) -> None:
    with System() as system:
        component = system.add("road", Table({"t": 5 + np.arange(50) * interval, "z": np.zeros(50)}))
        assert component.step == Fraction(expected)
    uneven = Table({"t": np.geomspace(1e-6, 1e-4, 50), "z": np.zeros(50)})
    assert uneven.description.default_step == Fraction(1, 1000)


# ---------------------------------------------------------------------------------------------------- where it is from


def frame() -> pd.DataFrame:
    made = pd.DataFrame({"time": TIME, "z": np.sin(TIME), "on": TIME > 1, "n": np.arange(101)})
    made.attrs["units"] = {"z": "mm"}
    return made


def test_one_table_from_everywhere(tmp_path: Path) -> None:
    given = frame()
    recording = Recording(
        TIME,
        ["z", "on", "n"],
        given[["z", "on", "n"]].to_numpy(float),
        {"z": "mm"},
        types={"on": "boolean", "n": "integer"},
    )
    given.to_parquet(tmp_path / "pandas.parquet")
    csv = given.rename(columns={"z": "z [mm]"}).to_csv(tmp_path / "pandas.csv", index=False)
    assert csv is None
    german = "time;z [mm];on;n\n" + "".join(
        f"{t};{z};{o};{n}\n".replace(".", ",") for t, z, o, n in given.itertuples(index=False)
    )
    (tmp_path / "german.csv").write_text("# from a logger\n" + german)
    indexed = given.set_index("time")
    indexed.attrs["units"] = {"z": "mm"}
    dated = given.assign(time=pd.Timestamp("2020-02-02 12:00") + pd.to_timedelta(TIME, unit="s"))
    dated.attrs["units"] = {"z": "mm"}
    dated.to_parquet(tmp_path / "dated.parquet")
    sources = [
        given,
        {"time": TIME, "z [mm]": given["z"], "on": given["on"], "n": given["n"]},
        recording,
        recording.write(tmp_path / "a.parquet"),
        recording.write(tmp_path / "a.csv"),
        tmp_path / "pandas.csv",
        tmp_path / "german.csv",
        indexed,
        dated,
        dated.set_index("time").rename_axis("t"),
        Recording.read(recording.write(tmp_path / "a.nc")),
        Recording.read(recording.write(tmp_path / "a.mf4")),
    ]
    tables = [Table(s, interpolation={"n": "held"}, units={"z": "mm"} if s is sources[9] else None) for s in sources]
    for table in tables:
        assert [(v.name, v.unit_name) for v in table.description.outputs.values()] == [
            ("z", "mm"),
            ("on", ""),
            ("n", ""),
        ]
        kinds = [v.type for v in table.description.outputs.values()]
        assert kinds == ["real", "boolean", "integer"] or table is tables[4]  # a CSV of a recording has no types
        np.testing.assert_allclose(table.times, TIME, rtol=0, atol=1e-15)
        np.testing.assert_array_equal(bits(table.signals.columns[0].values), bits(given["z"].to_numpy()))
    assert tables[4].description.outputs["n"].type == "integer"  # whole numbers that are held


def test_units_in_the_metadata_of_parquet_fields(tmp_path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    fields = [
        pa.field("Time", pa.float64(), metadata={"unit": "ms"}),
        pa.field("z", pa.float32(), metadata={"units": "mm"}),
    ]
    parquet.write_table(pa.table([1000 * TIME, TIME.astype("f4")], schema=pa.schema(fields)), tmp_path / "a.parquet")
    table = Table(tmp_path / "a.parquet")
    np.testing.assert_allclose(table.times, TIME, rtol=1e-15)
    assert table.description.outputs["z"].unit_name == "mm"


def test_columns_that_are_not_taken_may_hold_anything(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text('when,z,note\n0,1,"a, b"\n1,2,\n')
    assert list(Table(path, time="when", columns=["z"]).description.outputs) == ["z"]
    pd.DataFrame({"t": [0.0, 1.0], "z": [1.0, 2.0], "note": ["x", None]}).to_parquet(tmp_path / "a.parquet")
    assert list(Table(tmp_path / "a.parquet", columns="z").description.outputs) == ["z"]


# ------------------------------------------------------------------------------------------------------ what is wrong

WRONG = (
    "time,z\n0,0\n1,\n",
    "time,z\n0,0\n\n1,0\n",
    "time,z\n0,0\n1,nan\n2,0\n",
    "time,z\n0,0\n1,inf\n",
    "time,z\n0,0\n1,1e999\n",
    "time,z\n0,0\n1,up\n",
    "time,z\n0,0\n1,0,0\n",
    "time,z\n0,0\n1\n",
    "time,z\n0,0\n2,0\n1,0\n",
    "time,z\n0,0\n1,0\n1,0\n",
    "# head\n\ntime,z\n0,0\nnan,0\n",
    "time,z [mmm]\n0,0\n1,0\n",
    "time,z [m/s^2]\n0,0\n1,0\n",
    "time [m],z\n0,0\n1,0\n",
    "x,z\n0,0\n1,0\n",
    "time\n0\n1\n",
    "time,z,z [m]\n0,0,0\n1,0,0\n",
    "time,z,\n0,0,0\n1,0,0\n",
    "time,z\n0,0\n",
    "time,z\n",
    "time," + "z" * 200_000 + "\n0,0\n",
    "",
    "\n\n# only this\n",
    "time,on\n0,true\n1,false\n2,2\n",
)


def test_mistakes_in_a_csv_are_named(tmp_path: Path, refused) -> None:
    paths = [tmp_path / f"track{i}.csv" for i in range(len(WRONG))]
    for path, text in zip(paths, WRONG, strict=True):
        path.write_text(text)
    refused(TableError, *(partial(Table, path) for path in paths))


def test_mistakes_in_other_sources_are_named(tmp_path: Path) -> None:
    z = np.zeros(101)
    gap = frame()
    gap.loc[7, "z"] = np.nan
    gap.to_parquet(tmp_path / "gap.parquet")
    frame().astype({"n": str}).to_parquet(tmp_path / "text.parquet")
    (tmp_path / "none.parquet").write_bytes(b"hello")
    (tmp_path / "latin.csv").write_bytes(b"time,\xe4\n0,0\n")
    late = frame().assign(time=pd.Timestamp("2020-01-01") + pd.to_timedelta(TIME[::-1], unit="s"))
    cases: list[tuple[Any, dict[str, Any], str]] = [
        (
            tmp_path / "gap.parquet",
            {},
            r"gap\.parquet, row 8: no value in column 'z'|gap\.parquet, row 8: column 'z' is nan",
        ),
        (tmp_path / "text.parquet", {}, r"text\.parquet.*column 'n'.*(not a number|text, not numbers)"),
        (tmp_path / "none.parquet", {}, r"none\.parquet: cannot be read as Parquet"),
        (tmp_path / "latin.csv", {}, r"latin\.csv: not a text file"),
        (tmp_path / "missing.csv", {}, r"missing\.csv: there is no such file"),
        (
            tmp_path / "a.xlsx",
            {},
            r"a\.xlsx: a table is \.csv or \.parquet; other recordings are read by Recording\.read",
        ),
        (gap, {}, r"DataFrame, row 8: column 'z' is nan"),
        (late, {}, r"DataFrame, row 2: the time goes back"),
        (frame().drop(columns="time"), {}, r"no column is the time .* among z, on, n"),
        (frame(), {"time": "tme"}, r"no column 'tme' for the time; did you mean 'time'"),
        (frame(), {"columns": ["y"]}, r"no column 'y'.*there are: time, z, on, n"),
        (frame(), {"units": {"y": "m"}}, r"no column 'y'"),
        (frame(), {"units": {"z": "furlong"}}, r"unknown unit 'furlong'"),
        ({"t": TIME, "z": z[:-1]}, {}, r"column 'z' has shape \(100,\)"),
        ({"t": TIME, "z": np.zeros((101, 2))}, {}, r"shape \(101, 2\)"),
        ({"t": TIME, "z": [None] * 101}, {}, r"row 1: no value in column 'z'"),
        ({"t": TIME, "z": ["a"] * 101}, {}, r"column 'z' holds text"),
        ({"t": TIME, "z": z * 1j}, {}, r"'z' holds complex numbers"),
        (3.0, {}, r"a table is a file .*, not a float"),
        (frame(), {"interpolation": "cubic"}, r"no interpolation 'cubic'.*linear, held"),
        (frame(), {"interpolation": {"y": "held"}}, r"no column 'y'.* to be interpolated"),
        (frame(), {"interpolation": {"on": "linear"}}, r"'on' holds Booleans, which are held"),
        (frame(), {"after": "repeat"}, r"'repeat'.*error, hold"),
        (frame(), {"shift": np.nan}, r"shift is nan"),
    ]
    for source, options, words in cases:
        with pytest.raises(TableError, match=words):
            Table(source, **options)


def test_a_run_longer_than_the_table(raises) -> None:
    """2 s and the length of one row more; refused before it runs, or where it ends if nobody said how long it runs."""
    table = {"t": TIME, "z": TIME}
    assert len(run(Table(table), 2.02)) == 2021
    with raises(TableError):
        run(Table(table), 2.1)
    with System() as system:
        system.add("road", Table(table))
        simulation = system.initialize()
        with raises(ComponentError) as error:
            simulation.advance(3)
    assert error.value.recording is not None
    assert error.value.recording.time[-1] == 2.02
    assert run(Table(table, after="hold"), 9)["road.z"][-1] == 2.0
    with raises(TableError):
        run(Table(table, shift=5.0), 6)
    moved = run(Table(table, shift=5.0), 6, start_time=5)
    np.testing.assert_allclose(moved["road.z"], moved.time - 5, atol=1e-12)


# ------------------------------------------------------------------------------------- what systems are used for


def wired(table: Table | None = None) -> System:
    system = System()
    system.add("road", table or Table(frame(), interpolation={"n": "held"}))
    system.add("sink", Sink(), step="3 ms")
    system.connect("road.z", "sink.z")
    system.connect("road.n", "sink.plain")
    return system


def test_states_travel(tmp_path: Path) -> None:
    with wired() as one, wired() as two:
        one.allow_unconnected = two.allow_unconnected = True
        whole = one.run(2.0)
        simulation = one.initialize()
        simulation.advance("0.7")
        state = simulation.save()
        state.write(tmp_path / "a.state")
        simulation.advance(2, final=True)
        assert_same(simulation.recording, whole)
        simulation.restore(state)
        simulation.advance(2, final=True)
        assert_same(simulation.recording, whole)
        again = SystemState.from_bytes((tmp_path / "a.state").read_bytes())
        rest = two.run(2.0, state=again)
        np.testing.assert_array_equal(bits(rest.data), bits(whole.data[whole.time >= 0.7]))
        with (
            wired(Table(frame().assign(z=0.0), interpolation={"n": "held"})) as other,
            pytest.raises(CosimError, match="road"),
        ):
            other.initialize(state=SystemState.from_bytes((tmp_path / "a.state").read_bytes()))


def test_a_system_with_a_table_is_not_exported_but_without_it(built_fmus: Any, tmp_path: Path) -> None:
    with System() as system:
        system.add("track", Table({"time": TIME, "height [mm]": TIME, "rate [mm/s]": 0 * TIME}, units={"rate": "m/s"}))
        system.add("car", built_fmus.path("QuarterCarHmmwv", 3))
        system.connect("track.height", "car.road.height")
        with pytest.raises(CosimError, match=r"'track'.*without=\['track'\]"):
            system.export_fmu(tmp_path / "A.fmu")
        with pytest.raises(WiringError, match="'track'"):
            system.isolate("track")
        system.isolate("*")
        system.allow_unconnected = True
        r = system.run(0.2, record=["car.*", "track.*"])
        system.reset()
    assert abs(r["car.body.z"]).max() > 0


def test_linear_models_take_its_outputs_as_they_are() -> None:
    class Filter(PythonComponent):
        inputs = ("u",)
        outputs = ("y",)
        kind = "discrete"
        default_step = "10 ms"

        def begin(self) -> None:
            self.x = 0.0

        def step(self, t, h, u, y):  # type: ignore[no-untyped-def]  # noqa: ARG002
            self.x = 0.5 * self.x + u[0]
            y[0] = self.x

    with System() as system, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        system.add("road", Table({"t": TIME, "z": TIME}), step="10 ms")
        system.add("filter", Filter())
        system.connect("road.z", "filter.u")
        model = system.linearize(discrete=True)
    assert [round(float(p.real), 9) for p in model.poles()] == [0.5]


def test_messages_are_one_line_whatever_a_file_holds(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time,\x1b[31mred\n0,0\n1," + "x" * 5000 + "\n")
    with pytest.raises(TableError) as error:
        Table(path)
    assert re.search(r"[\x00-\x1f]", str(error.value)) is None
    assert len(str(error.value)) < 600
