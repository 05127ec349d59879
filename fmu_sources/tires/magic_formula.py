"""Forces and moments of a rolling tire by the Magic Formula, versions 5.2 (PAC2002) and 6.1.

The equations are those of H. B. Pacejka, Tire and Vehicle Dynamics, third edition, 2012, section 4.3 (6.1), and of the
second edition, 2006, section 4.3 (5.2), without turn slip. Every force has the form

    y(x) = D sin(C atan(B x - E (B x - atan(B x)))),     x = slip + S_H,     Y = y + S_V

with peak D, shape C, slope B C D and curvature E <= 1 from load, inclination and pressure; at combined slip it is
weighted by G(slip of the other direction), a cosine of the same form that is 1 without that slip.

Axes are those of the contact patch in ISO 8855: x along the wheel, y to its left, z up. A positive slip angle means
that the contact patch slides to the left, which gives a force to the right; a positive inclination leans the top to the
right. Loads beyond those of the file (FZMIN, FZMAX) take the coefficients of the nearest one, and forces stay in
proportion to the load; slips and inclinations beyond those of the file give the forces of the nearest ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import casadi as ca

from build_fmus.component import Component
from fmu_sources.tires.coefficients import COEFFICIENTS, EXPONENTS, LARGEST_EXPONENT, ONLY, POSITIVE
from fmu_sources.tires.tir_file import Tire

LEAST_LOAD = 0.01  # by the nominal load; below it the coefficients stay those of this load
_CONSTANTS = {
    "least_relaxation": (0.1, "m", "shorter ones, as at light loads, would need shorter steps of the solver"),
    "parking_speed": (2.5, "m/s", "below it sliding is damped"),
    "parking_damping": (770.0, "N.s/m", "at standstill and the nominal load"),
    "slow": (1.0, "m/s", "within it of standstill, moments that have the sign of the speed are less"),
}
_TINY, _LEAST = 1e-20, 1e-6


@dataclass(frozen=True)
class Forces:
    """Of the road on a tire in its contact patch [N, N.m], and its relaxation lengths [m].

    Attributes:
        fx, fy: along the wheel, and to its left.
        mx, my, mz: overturning, rolling resistance (at forward rolling negative), aligning; about x, y, z.
        relaxation_x, relaxation_y: lengths after which longitudinal and lateral slip follow.
    """

    fx: Any
    fy: Any
    relaxation_x: Any
    relaxation_y: Any
    mx: Any = 0.0
    my: Any = 0.0
    mz: Any = 0.0


def tire_of(c: Component, tire: Tire | None) -> MagicFormula | None:
    """The tire of a file, its coefficients declared as parameters `tire.NAME`; None without a file."""
    if tire is None:
        return None
    declared = {
        name: c.parameter(
            f"tire.{name}",
            tire.values[name],
            k.unit,
            f"{k.section.lower().replace('_', ' ')}: {k.text}",
            source=f"tire file {tire.name}",
            min=_LEAST if name in POSITIVE else -LARGEST_EXPONENT if name in EXPONENTS else None,
            max=LARGEST_EXPONENT if name in EXPONENTS else None,
            nominal=max(1.0, abs(tire.values[name])),
        )
        for name, k in COEFFICIENTS.items()
        if name not in ONLY[tire.version]
    }
    for name, (value, unit, text) in _CONSTANTS.items():
        declared[name] = c.constant(f"tire.{name}", value, unit, text, source="assumed")
    return MagicFormula(tire, declared)


class MagicFormula:
    """The tire of a file; `symbols` of its coefficients, without them its numbers."""

    def __init__(self, tire: Tire, symbols: Mapping[str, Any] | None = None) -> None:
        self._old, self._side = tire.version == 5, tire.side
        self._by_carcass = tuple(not tire.values[f"PT{axis}1"] for axis in "XY")
        constants = {name: value for name, (value, _, _) in _CONSTANTS.items()}
        self._p = SimpleNamespace(**{**constants, **tire.values, **(symbols or {})})

    def forces(self, load: Any, slip: Any, slip_angle: Any, inclination: Any, speed: Any, side: int = 1) -> Forces:
        """Forces and moments.

        Args:
            load: vertical force on the tire [N], not negative.
            slip: longitudinal slip, positive driving.
            slip_angle: tangent of the slip angle, positive where the contact patch slides to the left.
            inclination: of the wheel to the road [rad], positive where its top leans to the right.
            speed: forward speed of the wheel [m/s].
            side: of the car on which the tire is, 1 left, -1 right; where it was not measured it is mirrored.
        """
        p, side = self._p, side * self._side
        nominal = p.LFZO * p.FNOMIN
        known = ca.fmax(ca.fmax(load, p.FZMIN), LEAST_LOAD * nominal)
        known = ca.fmin(known, p.FZMAX)
        s = SimpleNamespace(load=known, nominal=nominal, ratio=known * (1 / nominal))
        s.dfz = s.ratio - 1
        s.dpi = p.LIP * p.INFLPRES / p.NOMPRES - 1
        s.kappa = _within(slip, p.KPUMIN, p.KPUMAX)
        s.tan = side * _within(slip_angle, ca.tan(p.ALPMIN), ca.tan(p.ALPMAX))
        s.alpha = ca.atan(s.tan) if self._old else s.tan
        s.cos = _cos_atan(s.tan)
        angle = _within(inclination, p.CAMMIN, p.CAMMAX)
        s.gamma = side * (angle if self._old else ca.sin(angle))
        pace = speed / p.slow
        s.rolling = ca.if_else(ca.fabs(pace) < 20, ca.tanh(pace), ca.sign(pace))  # equal beyond, without a function
        self._longitudinal(s)
        lateral = self._lateral(s, s.gamma)
        fy = lateral.weight * lateral.pure + lateral.induced
        mz = self._aligning(s, lateral, fy)
        mx = self._overturning(s, fy)
        my = self._rolling_resistance(s, speed)
        part = load / known
        return Forces(
            part * s.fx,
            side * part * fy,
            *self._relaxation(s, lateral),
            side * part * mx,
            part * my,
            side * part * mz,
        )

    def parked(self, forces: Forces, load: Any, speed: Any, sliding_x: Any, sliding_y: Any) -> Forces:
        """Forces with those against the sliding velocities [m/s] of the contact patch at low `speed` [m/s].

        At standstill a tire with relaxation is a spring, and a car on it would swing for long; this damps it as the
        rubber does. It fades out with the speed, so that a rolling tire has none of it.
        """
        p = self._p
        pace = ca.fabs(speed / p.parking_speed)
        fade = ca.if_else(pace < 1, (1 + ca.cos(ca.pi * pace)) / 2, 0)
        rate = p.parking_damping * load / (p.LFZO * p.FNOMIN) * fade
        return replace(forces, fx=forces.fx - rate * sliding_x, fy=forces.fy - rate * sliding_y)

    def _longitudinal(self, s: Any) -> None:
        """Fx at combined slip [N], with its slip stiffness: (4.E9) to (4.E18), (4.E50) to (4.E57)."""
        p, gamma = self._p, s.gamma * (self._p.LGAX if self._old else 1)
        shift = (p.PHX1 + p.PHX2 * s.dfz) * p.LHX
        lift = s.load * (p.PVX1 + p.PVX2 * s.dfz) * p.LVX * p.LMUX
        friction = (p.PDX1 + p.PDX2 * s.dfz) * (1 + p.PPX3 * s.dpi + p.PPX4 * s.dpi**2) * (1 - p.PDX3 * gamma**2)
        peak, shape, x = friction * p.LMUX * s.load, p.PCX1 * p.LCX, s.kappa + shift
        curvature = (p.PEX1 + p.PEX2 * s.dfz + p.PEX3 * s.dfz**2) * (1 - p.PEX4 * ca.sign(x)) * p.LEX
        s.stiffness = s.load * (p.PKX1 + p.PKX2 * s.dfz) * ca.exp(p.PKX3 * s.dfz) * p.LKX
        s.stiffness *= 1 + p.PPX1 * s.dpi + p.PPX2 * s.dpi**2
        pure = peak * ca.sin(_phase(s.stiffness / (shape * peak), shape, curvature, x)) + lift
        slope = (p.RBX1 + p.RBX3 * s.gamma**2) * _cos_atan(p.RBX2 * s.kappa) * p.LXAL
        s.fx = _weight(slope, p.RCX1, p.REX1 + p.REX2 * s.dfz, s.alpha, p.RHX1) * pure

    def _lateral(self, s: Any, gamma: Any) -> Any:
        """Fy without longitudinal slip [N], what slip makes of it, and its cornering stiffness.

        Equations (4.E19) to (4.E30), (4.E58) to (4.E67); of 5.2, camber shifts the curve by PHY3.
        """
        p, of = self._p, SimpleNamespace()
        leaning = gamma * p.LGAY if self._old else gamma
        of.friction = (p.PDY1 + p.PDY2 * s.dfz) * (1 + p.PPY3 * s.dpi + p.PPY4 * s.dpi**2) * p.LMUY
        of.friction *= 1 - p.PDY3 * leaning**2
        peak, shape = of.friction * s.load, p.PCY1 * p.LCY
        top = (p.PKY2 + p.PKY5 * gamma**2) * (1 + p.PPY2 * s.dpi)
        of.stiffness = p.PKY1 * s.nominal * (1 + p.PPY1 * s.dpi) * (1 - p.PKY3 * ca.fabs(leaning)) * p.LKY
        of.stiffness *= ca.sin(p.PKY4 * ca.atan(s.ratio / top))
        softness = 1 / of.stiffness  # quotients are dear
        camber_lift = s.load * (p.PVY3 + p.PVY4 * s.dfz) * leaning * p.LMUY * (1 if self._old else p.LKYC)
        of.lift = s.load * (p.PVY1 + p.PVY2 * s.dfz) * p.LVY * p.LMUY + camber_lift
        if self._old:
            camber_shift = p.PHY3 * leaning
        else:
            camber = s.load * (p.PKY6 + p.PKY7 * s.dfz) * (1 + p.PPY5 * s.dpi) * p.LKYC
            camber_shift = (camber * gamma - camber_lift) * softness
        of.shift = (p.PHY1 + p.PHY2 * s.dfz) * p.LHY + camber_shift
        x = s.alpha + of.shift
        curvature = (p.PEY1 + p.PEY2 * s.dfz) * p.LEY
        curvature *= 1 + p.PEY5 * gamma**2 - (p.PEY3 + p.PEY4 * leaning) * ca.sign(x)
        of.softness, of.slope, of.shape = softness, of.stiffness / (shape * peak), shape
        of.pure = peak * ca.sin(_phase(of.slope, shape, curvature, x)) + of.lift
        slope = (p.RBY1 + p.RBY4 * gamma**2) * _cos_atan(p.RBY2 * (s.alpha - p.RBY3)) * p.LYKA
        of.weight = _weight(slope, p.RCY1, p.REY1 + p.REY2 * s.dfz, s.kappa, p.RHY1 + p.RHY2 * s.dfz)
        most = peak * (p.RVY1 + p.RVY2 * s.dfz + p.RVY3 * gamma) * _cos_atan(p.RVY4 * s.alpha)
        induced = most * ca.sin(p.RVY5 * ca.atan(p.RVY6 * s.kappa)) * p.LVYKA
        of.induced = _unless_zero((p.RVY5, p.RVY6), induced)
        return of

    def _aligning(self, s: Any, lateral: Any, fy: Any) -> Any:
        """Mz at combined slip [N.m]: (4.E31) to (4.E49), (4.E71) to (4.E78)."""
        p, old = self._p, self._old
        gamma = s.gamma * p.LGAZ if old else s.gamma
        size = ca.fabs(gamma)
        # Slip angles that stand for the whole slip.
        by_slip = (s.stiffness * lateral.softness * s.kappa) ** 2
        at = s.alpha + p.QHZ1 + p.QHZ2 * s.dfz + (p.QHZ3 + p.QHZ4 * s.dfz) * gamma
        ar = s.alpha + lateral.shift + lateral.lift * lateral.softness
        at, ar = (ca.sign(x) * ca.sqrt(x**2 + by_slip + _TINY) for x in (at, ar))
        # Pneumatic trail.
        slope = (p.QBZ1 + p.QBZ2 * s.dfz + p.QBZ3 * s.dfz**2) * p.LKY / p.LMUY
        slope *= 1 + p.QBZ4 * gamma + p.QBZ5 * size + p.QBZ6 * gamma**2  # files of 6.1 have QBZ4, the book QBZ6
        peak = s.ratio * p.UNLOADED_RADIUS * (p.QDZ1 + p.QDZ2 * s.dfz) * (1 - p.PPZ1 * s.dpi) * p.LTR
        peak *= (1 + p.QDZ3 * (gamma if old else size) + p.QDZ4 * gamma**2) * s.rolling
        curvature = p.QEZ1 + p.QEZ2 * s.dfz + p.QEZ3 * s.dfz**2
        curvature *= 1 + (p.QEZ4 + p.QEZ5 * gamma) * 2 / ca.pi * ca.atan(slope * p.QCZ1 * at)
        trail = peak * ca.cos(_phase(slope, p.QCZ1, curvature, at)) * s.cos
        # What remains at no side force.
        camber = (p.QDZ8 + p.QDZ9 * s.dfz) * (1 + p.PPZ2 * s.dpi) * gamma
        if not old:
            camber = (camber + (p.QDZ10 + p.QDZ11 * s.dfz) * gamma * size) * p.LKZC
        most = s.load * p.UNLOADED_RADIUS * ((p.QDZ6 + p.QDZ7 * s.dfz) * p.LRES + camber) * p.LMUY * s.rolling
        residual_slope = p.QBZ9 * p.LKY / p.LMUY + p.QBZ10 * lateral.slope * lateral.shape
        residual = most * _cos_atan(residual_slope * ar) * s.cos
        lever = p.SSZ1 + p.SSZ2 * (fy * (1 / s.nominal)) + (p.SSZ3 + p.SSZ4 * s.dfz) * gamma
        if old:
            on_trail = fy - lateral.induced
        else:
            upright = self._lateral(s, 0)  # the book takes the side force of an upright wheel
            on_trail = upright.weight * upright.pure
        return residual - trail * on_trail + p.UNLOADED_RADIUS * lever * p.LS * s.fx

    def _overturning(self, s: Any, fy: Any) -> Any:
        """Mx [N.m]: (4.E69)."""
        p, side = self._p, fy * (1 / s.nominal)
        shift, whole = p.QSX1 * p.LVMX, p.QSX3 * side - p.QSX2 * s.gamma * (1 + p.PPMX1 * s.dpi)
        if self._old:
            return p.UNLOADED_RADIUS * s.load * (shift + p.LMX * whole)
        by_load = p.QSX4 * ca.cos(p.QSX5 * ca.atan(p.QSX6 * s.ratio) ** 2)
        by_both = by_load * ca.sin(p.QSX7 * s.gamma + p.QSX8 * ca.atan(p.QSX9 * side))
        whole += _unless_zero((p.QSX4, p.QSX7, p.QSX8), by_both)
        by_load = p.QSX10 * ca.atan(p.QSX11 * s.ratio)
        whole += _unless_zero((p.QSX10, p.QSX11), by_load * s.gamma)
        return p.UNLOADED_RADIUS * s.load * p.LMX * (shift + whole)

    def _rolling_resistance(self, s: Any, speed: Any) -> Any:
        """My [N.m], against the rolling: (4.E70)."""
        p, pace, load = self._p, ca.fabs(speed / self._p.LONGVL), s.ratio
        whole = p.QSY1 + p.QSY2 * s.fx * (1 / s.nominal) + p.QSY3 * pace + p.QSY4 * pace**4
        whole += (p.QSY5 + p.QSY6 * load) * s.gamma**2
        by_load = load**p.QSY7 * (1 + s.dpi) ** p.QSY8
        return -s.load * p.UNLOADED_RADIUS * p.LMY * whole * s.rolling * by_load

    def _relaxation(self, s: Any, lateral: Any) -> tuple[Any, Any]:
        """Relaxation lengths [m]: by PTX and PTY (5.2), or slip stiffness by stiffness of the carcass (6.1)."""
        p = self._p
        if not self._by_carcass[0]:
            x = s.ratio * (p.PTX1 + p.PTX2 * s.dfz) * ca.exp(p.PTX3 * s.dfz) * p.UNLOADED_RADIUS
        else:
            x = s.stiffness / p.LONGITUDINAL_STIFFNESS
        if not self._by_carcass[1]:
            y = p.PTY1 * ca.sin(2 * ca.atan(s.ratio / p.PTY2)) * p.UNLOADED_RADIUS * p.LFZO
            y *= 1 - p.PKY3 * ca.fabs(s.gamma)
        else:
            y = ca.fabs(lateral.stiffness) / p.LATERAL_STIFFNESS
        return ca.fmax(p.least_relaxation, x * p.LSGKP), ca.fmax(p.least_relaxation, y * p.LSGAL)


def _within(value: Any, least: Any, most: Any) -> Any:
    return ca.fmin(ca.fmax(value, least), most)


def _phase(slope: Any, shape: Any, curvature: Any, x: Any) -> Any:
    """Angle of the Magic Formula; a curvature above 1 counts as 1."""
    bx = slope * x
    return shape * ca.atan(bx - ca.fmin(1, curvature) * (bx - ca.atan(bx)))


def _weight(slope: Any, shape: Any, curvature: Any, x: Any, shift: Any) -> Any:
    """What a slip leaves of the force across it, never negative."""
    of_slip, without = (ca.cos(_phase(slope, shape, curvature, v)) for v in (x + shift, shift))
    return ca.fmax(0, of_slip / ca.if_else(shift == 0, 1, without))


def _unless_zero(coefficients: tuple[Any, ...], value: Any) -> Any:
    """A value that is 0, with all derivatives, where all these coefficients are: files without them pay nothing."""
    without = coefficients[0] == 0
    for other in coefficients[1:]:
        without = ca.logic_and(without, other == 0)
    return ca.if_else(without, 0, value)


def _cos_atan(x: Any) -> Any:
    """cos(atan(x)), cheaper."""
    return 1 / ca.sqrt(1 + x**2)
