"""Forces of pure slip at the nominal load against the package `pacejka`, which has the curve of four factors alone."""

from math import atan, sin, tan

import pytest

from fmu_sources.tires.magic_formula import MagicFormula
from fmu_sources.tires.tir_file import read_tire
from fmu_sources.vehicles import loader

pytestmark = pytest.mark.judges
pacejka = pytest.importorskip("pacejka", reason="pip install 'suspension-fmus[judges]' installs the package pacejka")


@pytest.mark.parametrize("name", ["hmmwv", "sedan", "truck"])
def test_curves_at_the_nominal_load(name):
    tire = read_tire(loader._HERE.parent / "tires" / f"{name}.tir")
    v, load = tire.values, tire.values["FNOMIN"]
    plain = {n: 0.0 for n in v if n.startswith(("PH", "PV", "R")) or n in ("PEX4", "PEY3", "PEY4")}
    law = MagicFormula(type(tire)(tire.version, 1, {**v, **plain}, tire.name))
    cornering = -v["PKY1"] * load * sin(v["PKY4"] * atan(1 / v["PKY2"]))
    peer = {
        axis: pacejka.Tire("peer", mu_peak=v[f"PD{axis}1"], cornering_stiffness_per_rad=cornering, c_x=v["PCX1"],
                           longitudinal_stiffness=v["PKX1"] * load, load_sensitivity_n=1.0, f_z0=load, e_x=v["PEX1"],
                           c_y=v["PCY1"], e_y=v["PEY1"])
        for axis in "XY"
    }  # fmt: skip
    for slip in (-0.5, -0.05, 0.01, 0.1, 0.4):
        _, fx = peer["X"].calculate_forces(load, 0.0, slip, friction_circle=False)
        assert float(law.forces(load, slip, 0.0, 0.0, 30.0).fx) == pytest.approx(fx, rel=1e-10)
        # 5.2 takes the angle, 6.1 its tangent, the package what it is given.
        fy, _ = peer["Y"].calculate_forces(load, slip, 0.0, friction_circle=False, alpha_unit="rad")
        angle = -slip if tire.version == 6 else -tan(slip)
        assert float(law.forces(load, 0.0, angle, 0.0, 30.0).fy) == pytest.approx(fy, rel=1e-10)
