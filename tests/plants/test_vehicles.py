"""Vehicle files: what is read, and what a user is told."""

import math
import pickle
from functools import partial

import pytest

from build_fmus.component import Component
from fmu_sources.vehicles import (
    VehicleError,
    declare,
    load_actuator,
    load_full_car,
    load_ride_car,
    load_three_axle_trench,
    load_vehicle,
    vehicle_names,
)
from fmu_sources.vehicles.quantities import Section


def write(tmp_path, text, name="mine.toml"):
    path = tmp_path / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", vehicle_names())
def test_bundled_vehicles_load_travel_to_other_processes_and_every_value_has_a_source(name):
    def sources(section):
        for field in type(section).model_fields:
            value = getattr(section, field)
            if isinstance(value, Section):
                yield from sources(value)
            elif hasattr(value, "source"):
                yield value.source

    vehicle = load_vehicle(name)
    assert pickle.loads(pickle.dumps(vehicle)) == vehicle
    found = list(sources(vehicle))
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


def value(name, given, measure, **more):
    """A file that gives one value, by its name."""
    section, _, field = name.rpartition(".")
    parts = {"value": given, "unit": f'"{measure}"', "source": '"x"', **more}
    return f"[{section}]\n{field} = {{ {', '.join(f'{k} = {v}' for k, v in parts.items() if v is not None)} }}"


FRONT, REAR = "suspension.front", "suspension.rear"
MISTAKES = {
    "hmmwv": (
        value("body.mass", -5.0, "kg"),
        value("body.mas", 5.0, "kg"),
        "[boddy]\nmass = 3",
        value("body.mass", 5e3, "lb"),
        value("tire.stiffness", 350, "N/m m"),
        value("tire.stiffness", 350, "N.s/m"),
        "[body]\nmass = 5000.0",
        value("body.mass", 5e3, "kg", source=None),
        value("body.mass", 5e3, "kg", source='" "'),
        value("body.mass", 5e3, "kg", source='"\\u0000"'),
        value("body.mass", 5e3, "kg", source=f'"{"x" * 5000}"'),
        value("body.mass", "nan", "kg"),
        value("body.mass", 5e3, "kg", unit=None, units='"kg"'),
        "[body\nmass",
        'kind = "bicycle"',
    ),
    "actuator_hmmwv": (
        value("supply.pressure", 0.0, "bar"),
        value("supply.pressure", -5.0, "MPa"),
        value("cylinder.volume", -1.2, "l"),
        value("cylinder.volume", 1.2, "kg"),
        value("fluid.density", 0, "kg/m3"),
        value("valve.time_constant", 0, "ms"),
        value("valve.bandwidth", 0, "Hz"),
        value("cylinder.leakage", -1e-12, "m5/(N.s)"),
    ),
    "hmmwv_public": (
        value(f"{FRONT}.spring.compression", [0.0, 0.02, 0.01], "m"),
        value("tire.force", [0.0, 1e5], "N"),
        value(f"{REAR}.points.upper_ball", [1.4, 28.17], "in"),
        value(f"{FRONT}.points.upper_ball", [-2.088, 17.9, 9.0], "in"),
        value(f"{FRONT}.points.lower_rear", [8.79, 12.09, 0.0], "in"),
        value(f"{FRONT}.travel.least", -0.3, "m"),
        value(f"{FRONT}.points.wheel_center", [0, 0, 0], "in"),
        value("tire.force", "[0.0, nan, 1.0]", "N"),
    ),
    "sedan": (
        value("wheel.front.half_trak", 0.7, "m"),
        "[suspension.left]",
        value("wheel.rear.mass", -1, "kg"),
        value(f"{REAR}.friction.force", 0.2, "kN"),
        value(f"{REAR}.friction.force", 0.2, "kN") + "\nvelocity = 1",
    ),
    "three_axle": (value("wheel.front.mass", 400, "kg"), value("tire.a3.stiffness", 0, "N/mm")),
}


def test_mistakes_are_named(tmp_path, refused):
    given = [f'base = "{base}"\n{text}\n' for base, texts in MISTAKES.items() for text in texts]
    files = [write(tmp_path, text, f"mine{i}.toml") for i, text in enumerate(given)]
    refused(VehicleError, *(partial(load_vehicle, file) for file in files))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('base = "hmmwv"\n' + value("body.mass", '"heavy"', "kg"), r"body\.mass\.value: .*heavy"),
        ('base = "sedan"\ntires_lift_off = "perhaps"', r"tires_lift_off: .*bool.*perhaps"),
    ],
)
def test_other_types_are_named(tmp_path, text, words):
    with pytest.raises(VehicleError, match=rf"mine\.toml: {words}"):
        load_vehicle(write(tmp_path, text))


def test_file_problems_are_named(tmp_path, raises, refused):
    refused(
        VehicleError,
        lambda: load_vehicle("hmmwv_modifed"),
        lambda: load_full_car("quarter_car_hmmwv"),
        lambda: load_actuator("hmmwv"),
        lambda: load_ride_car("three_axle"),
        lambda: load_three_axle_trench("three_axle"),
        lambda: load_vehicle(write(tmp_path, 'base = "mine.toml"\n')),
        lambda: load_vehicle(write(tmp_path, 'base = "hmwv"\n')),
    )
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
    refused(
        VehicleError,
        lambda: load_vehicle(binary),
        lambda: load_vehicle(write(tmp_path, 'kind = "full_car"\nname = "x"\ndescription = "x"\n')),
    )


def test_fields_become_fmi_parameters():
    c = Component("Test", kind="continuous", description="", source="none")
    p = declare(c, load_full_car("hmmwv_modified"))
    variable = c.variable("suspension.rear.spring")
    assert variable.start == (400e3,)
    assert (variable.unit, variable.display_unit, variable.min) == ("N/m", "N/mm", 0.0)
    assert variable.source.startswith("000 Table 1")
    assert p.suspension.rear.spring.name() == "suspension.rear.spring"
