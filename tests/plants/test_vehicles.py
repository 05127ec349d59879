"""Vehicle files: what is read, and what a user is told."""

import math

import pytest

from build_fmus.component import Component
from fmu_sources.vehicles import VehicleError, declare, load_full_car, load_vehicle, vehicle_names
from fmu_sources.vehicles.schema import Section


def write(tmp_path, text, name="mine.toml"):
    path = tmp_path / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", vehicle_names())
def test_bundled_vehicles_load_and_every_value_has_a_source(name):
    def sources(section):
        for field in type(section).model_fields:
            value = getattr(section, field)
            if isinstance(value, Section):
                yield from sources(value)
            elif hasattr(value, "source"):
                yield value.source

    found = list(sources(load_vehicle(name)))
    assert len(found) >= 6
    assert all(found)


def test_table_1_of_paper_000():
    basic, modified = load_full_car("hmmwv"), load_full_car("hmmwv_modified")
    assert [v.body.mass.value for v in (basic, modified)] == [2210.0, 5000.0]
    assert [v.suspension.front.spring.value for v in (basic, modified)] == [150e3, 250e3]
    assert [v.suspension.rear.spring.value for v in (basic, modified)] == [150e3, 400e3]
    assert [v.suspension.front.damper.value for v in (basic, modified)] == [30e3, 15e3]
    assert [v.suspension.rear.damper.value for v in (basic, modified)] == [30e3, 30e3]
    assert modified.tire == basic.tire


def test_units_are_converted(tmp_path):
    path = write(
        tmp_path,
        'base = "hmmwv"\n[wheel]\nradius = { value = 450.0, unit = "mm", source = "me" }\n'
        '[steering]\nmax_angle = { value = 20, unit = "deg", source = "me" }\n',
    )
    vehicle = load_full_car(path)
    assert vehicle.wheel.radius.value == pytest.approx(0.45, rel=1e-15)
    assert vehicle.steering.max_angle.value == pytest.approx(math.radians(20), rel=1e-15)
    assert vehicle.wheel.mass.value == 110.0


def test_base_may_be_a_path_beside_the_file(tmp_path):
    write(tmp_path, 'base = "hmmwv"\nname = "first"\n', "first.toml")
    second = write(tmp_path, 'base = "first.toml"\nname = "second"\n', "second.toml")
    assert load_full_car(second).name == "second"
    assert load_full_car(str(second)).body.mass.value == 2210.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[body]\nmass = { value = -5.0, unit = "kg", source = "x" }', ["body.mass", "-5 kg", "at least 10 kg"]),
        ('[body]\nmas = { value = 5.0, unit = "kg", source = "x" }', ["body.mas", "did you mean 'mass'"]),
        ("[boddy]\nmass = 3", ["boddy", "did you mean 'body'"]),
        ('[body]\nmass = { value = 5e3, unit = "lb", source = "x" }', ["body.mass", "'lb'", "'kg' is expected"]),
        ('[tire]\nstiffness = { value = 350, unit = "N/m m", source = "x" }', ["stiffness", "did you mean 'N/mm'"]),
        ('[tire]\nstiffness = { value = 350, unit = "N.s/m", source = "x" }', ["tire.stiffness", "'N/m' is expected"]),
        ("[body]\nmass = 5000.0", ["body.mass", 'value = ..., unit = "kg"']),
        ('[body]\nmass = { value = 5e3, unit = "kg" }', ["body.mass.source", "where the value comes from"]),
        (
            '[body]\nmass = { value = 5e3, unit = "kg", source = " " }',
            ["body.mass.source: empty; say where the value comes from"],
        ),
        (
            '[body]\nmass = { value = 5e3, unit = "kg", source = "\\u0000" }',
            ["body.mass.source: contains the character '\\x00'"],
        ),
        (
            f'[body]\nmass = {{ value = 5e3, unit = "kg", source = "{"x" * 5000}" }}',
            ["body.mass.source: has 5000 characters"],
        ),
        ('[body]\nmass = { value = nan, unit = "kg", source = "x" }', ["body.mass.value", "finite"]),
        ('[body]\nmass = { value = "heavy", unit = "kg", source = "x" }', ["body.mass.value", "heavy"]),
        ('[body]\nmass = { value = 5e3, units = "kg", source = "x" }', ["body.mass.units", "did you mean 'unit'"]),
        ("[body\nmass", ["not a TOML file", "line 2"]),
        ('kind = "bicycle"', ["'bicycle'", "'full_car'"]),
    ],
)
def test_mistakes_are_named(tmp_path, text, words):
    path = write(tmp_path, f'base = "hmmwv"\n{text}\n')
    with pytest.raises(VehicleError) as error:
        load_vehicle(path)
    for word in (str(path), *words):
        assert word in str(error.value)


def test_file_problems_are_named(tmp_path, raises):
    with raises(VehicleError):
        load_vehicle("hmmwv_modifed")
    with raises(VehicleError):
        load_full_car("quarter_car_hmmwv")
    with raises(VehicleError):
        load_vehicle(write(tmp_path, 'base = "mine.toml"\n'))
    with raises(VehicleError):
        load_vehicle(write(tmp_path, 'base = "hmwv"\n'))
    long = "a" * 300
    with raises(VehicleError, match=f"{long}"):
        load_vehicle(write(tmp_path, f'base = "{long}"\n'))
    with raises(VehicleError, match=f"{long}"):
        load_vehicle(long)
    for endless in ("x = " + "[" * 100_000, "x = " + "9" * 5000):
        with pytest.raises(VehicleError, match=r"mine\.toml"):
            load_vehicle(write(tmp_path, endless))
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with raises(VehicleError):
        load_vehicle(binary)
    with raises(VehicleError):
        load_vehicle(write(tmp_path, 'kind = "full_car"\nname = "x"\ndescription = "x"\n'))


def test_fields_become_fmi_parameters():
    c = Component("Test", kind="continuous", description="", source="none")
    p = declare(c, load_full_car("hmmwv_modified"))
    variable = c.variable("suspension.rear.spring")
    assert variable.start == (400e3,)
    assert (variable.unit, variable.display_unit, variable.min) == ("N/m", "N/mm", 0.0)
    assert variable.source.startswith("000 Table 1")
    assert p.suspension.rear.spring.name() == "suspension.rear.spring"
