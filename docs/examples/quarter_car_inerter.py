"""A component of your own, built into an FMU: a quarter car with an inerter.

See `docs/tutorials/first-component.md`.

python docs/examples/quarter_car_inerter.py      # writes QuarterCarInerter.fmu (FMI 3.0) here
"""

from math import pi, sin
from pathlib import Path

from build_fmus.compile import ObjectCache, resolve_platforms
from build_fmus.component import Component
from build_fmus.package import build_fmu


def quarter_car_inerter() -> Component:
    """Body and wheel joined by spring, damper and inerter, above one tire; heights count from rest."""
    c = Component(
        "QuarterCarInerter",
        kind="continuous",
        description="Quarter car with an inerter beside the spring",
        source="Smith (2002), Synthesis of mechanical networks: the inerter",
    )
    body = c.parameter("body.mass", 2800.0, "kg", "sprung mass", min=1.0, source="001 appendix 1.C")
    wheel = c.parameter("wheel.mass", 270.0, "kg", "unsprung mass", min=0.1, source="001 appendix 1.C")
    k = c.parameter("suspension.stiffness", 240e3, "N/m", "suspension stiffness", min=0.0, source="001 appendix 1.C")
    d = c.parameter("suspension.damping", 12e3, "N.s/m", "suspension damping", min=0.0, source="001 appendix 1.C")
    b = c.parameter("suspension.inertance", 150.0, "kg", "force per relative acceleration", min=0.0, source="assumed")
    tire = c.parameter("tire.stiffness", 1e6, "N/m", "tire stiffness", min=1.0, source="001 appendix 1.C")

    road = c.input("road.height", "m", "road height under the tire")
    zb = c.state("body.z", "m", "body height above rest", output=True, nominal=0.1)
    vb = c.state("body.vz", "m/s", "vertical body velocity", output=True)
    zw = c.state("wheel.z", "m", "wheel height above rest", output=True, nominal=0.1)
    vw = c.state("wheel.vz", "m/s", "vertical wheel velocity", output=True)

    on_body = -k * (zb - zw) - d * (vb - vw)  # N, spring and damper
    on_wheel = tire * (road - zw) - on_body  # N
    # The inerter couples the accelerations: (body + b) ab - b aw = on_body, (wheel + b) aw - b ab = on_wheel.
    determinant = (body + b) * (wheel + b) - b**2
    ab = ((wheel + b) * on_body + b * on_wheel) / determinant
    aw = ((body + b) * on_wheel + b * on_body) / determinant

    c.derivative(zb, vb)
    c.derivative(vb, ab)
    c.derivative(zw, vw)
    c.derivative(vw, aw)
    c.output("body.az", ab, "m/s2", "vertical body acceleration")
    c.reference_input({"road.height": lambda t: 0.02 * sin(2 * pi * 1.5 * t)})  # for the reference result
    return c


if __name__ == "__main__":
    fmu = build_fmu(quarter_car_inerter(), 3, resolve_platforms("host"), ObjectCache(Path("build/objects")))
    Path("QuarterCarInerter.fmu").write_bytes(fmu)
