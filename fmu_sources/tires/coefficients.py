"""The coefficients of a Magic Formula tire: names as in `.tir` files, each with its section and meaning.

A row is `NAME[=default] text`. Without a default a file must give the coefficient. Coefficients of Magic Formula 5.2
(and PAC2002) are those of 6.1 but for what `ONLY` says. Turn slip, that is all of the section TURNSLIP_COEFFICIENTS, is
left out.
"""

from __future__ import annotations

from dataclasses import dataclass

_TABLE = """
[VERTICAL]
FNOMIN nominal load
[DIMENSION]
UNLOADED_RADIUS radius of the unloaded tire
[OPERATING_CONDITIONS]
INFLPRES=200000 inflation pressure
NOMPRES=200000 nominal inflation pressure
[MODEL]
LONGVL=16.7 speed of the rolling resistance coefficients
[STRUCTURAL]
LONGITUDINAL_STIFFNESS=1e9 of the carcass: without PTX1 the relaxation length is slip stiffness by this
LATERAL_STIFFNESS=1e9 of the carcass: without PTY1 the relaxation length is cornering stiffness by this
[LONG_SLIP_RANGE]
KPUMIN=-1.5 least longitudinal slip; beyond it forces stay as they are there
KPUMAX=1.5 largest longitudinal slip
[SLIP_ANGLE_RANGE]
ALPMIN=-1.5 least slip angle; beyond it forces stay as they are there
ALPMAX=1.5 largest slip angle
[INCLINATION_ANGLE_RANGE]
CAMMIN=-0.5 least inclination; beyond it forces stay as they are there
CAMMAX=0.5 largest inclination
[VERTICAL_FORCE_RANGE]
FZMIN=0 least load whose coefficients are known; below it forces shrink with the load
FZMAX=1e9 largest load whose coefficients are known; above it forces grow with the load
[SCALING_COEFFICIENTS]
LFZO=1 scale of the nominal load
LCX=1 scale of the shape factor of Fx
LMUX=1 scale of the longitudinal friction
LEX=1 scale of the curvature of Fx
LKX=1 scale of the slip stiffness
LHX=1 scale of the horizontal shift of Fx
LVX=1 scale of the vertical shift of Fx
LGAX=1 scale of the inclination for Fx (5.2)
LCY=1 scale of the shape factor of Fy
LMUY=1 scale of the lateral friction
LEY=1 scale of the curvature of Fy
LKY=1 scale of the cornering stiffness
LKYC=1 scale of the camber stiffness
LHY=1 scale of the horizontal shift of Fy
LVY=1 scale of the vertical shift of Fy
LGAY=1 scale of the inclination for Fy (5.2)
LTR=1 scale of the pneumatic trail
LRES=1 scale of the residual moment
LKZC=1 scale of the camber moment stiffness
LGAZ=1 scale of the inclination for Mz (5.2)
LXAL=1 scale of the influence of the slip angle on Fx
LYKA=1 scale of the influence of the slip on Fy
LVYKA=1 scale of the side force that the slip induces
LS=1 scale of the lever arm of Fx
LSGKP=1 scale of the longitudinal relaxation length
LSGAL=1 scale of the lateral relaxation length
LMX=1 scale of the overturning moment
LVMX=1 scale of the shift of the overturning moment
LMY=1 scale of the rolling resistance
LIP=1 scale of the inflation pressure
[LONGITUDINAL_COEFFICIENTS]
PCX1 shape factor
PDX1 friction at the nominal load
PDX2=0 friction with load
PDX3=0 friction with inclination squared
PEX1=0 curvature at the nominal load
PEX2=0 curvature with load
PEX3=0 curvature with load squared
PEX4=0 curvature when driving
PKX1 slip stiffness per load at the nominal load
PKX2=0 slip stiffness with load
PKX3=0 exponent of the slip stiffness with load
PHX1=0 horizontal shift at the nominal load
PHX2=0 horizontal shift with load
PVX1=0 vertical shift per load at the nominal load
PVX2=0 vertical shift with load
PPX1=0 slip stiffness with pressure
PPX2=0 slip stiffness with pressure squared
PPX3=0 friction with pressure
PPX4=0 friction with pressure squared
RBX1=0 combined slip: slope
RBX2=0 combined slip: slope with slip
RBX3=0 combined slip: slope with inclination squared
RCX1=0 combined slip: shape
REX1=0 combined slip: curvature
REX2=0 combined slip: curvature with load
RHX1=0 combined slip: shift
PTX1=0 relaxation length by load at the nominal load
PTX2=0 relaxation length with load
PTX3=0 exponent of the relaxation length with load
[OVERTURNING_COEFFICIENTS]
QSX1=0 shift
QSX2=0 with inclination
QSX3=0 with the side force
QSX4=0 with load and side force: size
QSX5=0 with load: shape
QSX6=0 with load: stiffness
QSX7=0 with inclination, inside of the sine
QSX8=0 with side force: shape
QSX9=0 with side force: stiffness
QSX10=0 with inclination and load: size
QSX11=0 with inclination and load: stiffness
PPMX1=0 with pressure
[LATERAL_COEFFICIENTS]
PCY1 shape factor
PDY1 friction at the nominal load
PDY2=0 friction with load
PDY3=0 friction with inclination squared
PEY1=0 curvature at the nominal load
PEY2=0 curvature with load
PEY3=0 curvature by the sign of the slip angle
PEY4=0 curvature with inclination
PEY5=0 curvature with inclination squared
PKY1 largest cornering stiffness by the nominal load, negative
PKY2 load of the largest cornering stiffness by the nominal load
PKY3=0 cornering stiffness with inclination
PKY4=2 curvature of the cornering stiffness over load
PKY5=0 load of the largest cornering stiffness with inclination squared
PKY6=0 camber stiffness per load at the nominal load
PKY7=0 camber stiffness with load
PHY1=0 horizontal shift at the nominal load
PHY2=0 horizontal shift with load
PHY3=0 horizontal shift with inclination (5.2)
PVY1=0 vertical shift per load at the nominal load
PVY2=0 vertical shift with load
PVY3=0 vertical shift with inclination
PVY4=0 vertical shift with inclination and load
PPY1=0 cornering stiffness with pressure
PPY2=0 load of the largest cornering stiffness with pressure
PPY3=0 friction with pressure
PPY4=0 friction with pressure squared
PPY5=0 camber stiffness with pressure
RBY1=0 combined slip: slope
RBY2=0 combined slip: slope with slip angle
RBY3=0 combined slip: slip angle of the steepest slope
RBY4=0 combined slip: slope with inclination squared
RCY1=0 combined slip: shape
REY1=0 combined slip: curvature
REY2=0 combined slip: curvature with load
RHY1=0 combined slip: shift
RHY2=0 combined slip: shift with load
RVY1=0 side force by slip at the nominal load
RVY2=0 side force by slip with load
RVY3=0 side force by slip with inclination
RVY4=0 side force by slip with slip angle
RVY5=0 side force by slip: shape
RVY6=0 side force by slip: stiffness
PTY1=0 largest relaxation length by the radius
PTY2=0 load of the largest relaxation length by the nominal load
[ROLLING_COEFFICIENTS]
QSY1=0 rolling resistance
QSY2=0 with longitudinal force
QSY3=0 with speed
QSY4=0 with the fourth power of the speed
QSY5=0 with inclination squared
QSY6=0 with inclination squared and load
QSY7=0 exponent of the load
QSY8=0 exponent of the pressure
[ALIGNING_COEFFICIENTS]
QBZ1=0 trail: slope at the nominal load
QBZ2=0 trail: slope with load
QBZ3=0 trail: slope with load squared
QBZ4=0 trail: slope with inclination
QBZ5=0 trail: slope with the size of the inclination
QBZ6=0 trail: slope with inclination squared
QBZ9=0 residual moment: slope
QBZ10=0 residual moment: slope by that of the side force
QCZ1=0 trail: shape
QDZ1=0 trail: peak at the nominal load
QDZ2=0 trail: peak with load
QDZ3=0 trail: peak with inclination
QDZ4=0 trail: peak with inclination squared
QDZ6=0 residual moment: peak
QDZ7=0 residual moment: peak with load
QDZ8=0 residual moment: peak with inclination
QDZ9=0 residual moment: peak with inclination and load
QDZ10=0 residual moment: peak with inclination squared (6.1)
QDZ11=0 residual moment: peak with inclination squared and load (6.1)
QEZ1=0 trail: curvature at the nominal load
QEZ2=0 trail: curvature with load
QEZ3=0 trail: curvature with load squared
QEZ4=0 trail: curvature by the sign of the slip angle
QEZ5=0 trail: curvature with inclination
QHZ1=0 trail: shift at the nominal load
QHZ2=0 trail: shift with load
QHZ3=0 trail: shift with inclination
QHZ4=0 trail: shift with inclination and load
PPZ1=0 trail: peak with pressure
PPZ2=0 residual moment: camber with pressure
SSZ1=0 lever arm of Fx by the radius
SSZ2=0 lever arm of Fx with side force
SSZ3=0 lever arm of Fx with inclination
SSZ4=0 lever arm of Fx with inclination and load
"""

_UNITS = {
    **dict.fromkeys(("FNOMIN", "FZMIN", "FZMAX"), "N"),
    "UNLOADED_RADIUS": "m",
    **dict.fromkeys(("INFLPRES", "NOMPRES"), "Pa"),
    "LONGVL": "m/s",
    **dict.fromkeys(("LONGITUDINAL_STIFFNESS", "LATERAL_STIFFNESS"), "N/m"),
}


@dataclass(frozen=True)
class Coefficient:
    """A coefficient: section of the file, default (None: must be given), unit and meaning."""

    section: str
    default: float | None
    unit: str
    text: str


def _read() -> dict[str, Coefficient]:
    found, section = {}, ""
    for line in _TABLE.split("\n"):
        if line.startswith("["):
            section = line.strip("[]")
        elif line:
            left, text = line.split(" ", 1)
            name, _, default = left.partition("=")
            found[name] = Coefficient(section, float(default) if default else None, _UNITS.get(name, "1"), text)
    return found


COEFFICIENTS = _read()
"""By name, in the order of the table."""

FORCE_SECTIONS = {c.section for c in COEFFICIENTS.values() if c.section.endswith("_COEFFICIENTS")}
"""Sections of which every entry should be known: a misspelt coefficient would change the forces silently."""

OTHER_NAMES = {"IP": "INFLPRES", "IP_NOM": "NOMPRES", "LKG": "LKYC", "LFZ0": "LFZO", "QPX1": "PPMX1"}
"""Names that PAC2002 has for coefficients."""

LEFT_OUT = ("PTX4", "PTY3", "QTZ1", "MBELT", "LGYR", "LCZ", "LMP", "LMUV", "LAMU", "QSX12", "QSX13", "QSX14")
"""Known entries without influence: damping at low speed, gyroscopic moment, vertical stiffness, turn slip, parking,
sliding speed, and the overturning moment of 6.2.
"""

ONLY = {
    5: ("PKY4", "PKY5", "PKY6", "PKY7", "PEY5", "QDZ10", "QDZ11", "RBX3", "RBY4"),
    6: ("LGAX", "LGAY", "LGAZ", "PHY3"),
}
"""By version: coefficients of the other one, which this one has not."""

POSITIVE = (
    *("FNOMIN", "UNLOADED_RADIUS", "LONGVL", "INFLPRES", "NOMPRES", "LONGITUDINAL_STIFFNESS", "LATERAL_STIFFNESS"),
    *("LFZO", "LMUX", "LMUY", "LCX", "LCY", "LKX", "LKY", "LIP", "PCX1", "PDX1", "PKX1", "PCY1", "PKY2", "PKY4"),
)
"""Coefficients that must be above 0."""

TYPICAL = {
    "UNLOADED_RADIUS": (0.05, 5.0),
    "FNOMIN": (10.0, 1e6),
    "LONGVL": (0.1, 200.0),
    **dict.fromkeys(("INFLPRES", "NOMPRES"), (1e4, 5e6)),
    **dict.fromkeys(("PDX1", "PDY1"), (0.0, 10.0)),
}
"""Least and largest size of what is not 0; beyond it a file has other units."""
LARGEST = 1e6
"""Size that no coefficient without a unit reaches."""

EXPONENTS = ("PKX3", "PTX3", "QSY7", "QSY8")
"""Coefficients in exponents, whose size is at most `LARGEST_EXPONENT`."""
LARGEST_EXPONENT = 20.0
