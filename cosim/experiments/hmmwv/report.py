"""Claims, tables and figures of paper 001 as a report."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from cosim.experiments.hmmwv import EXPERIMENT, published, pump, refinement
from cosim.experiments.hmmwv.averages import OF_MEDIANS, Averages
from cosim.experiments.hmmwv.claims import CLAIMS, PREVIEW_GAIN, SENTENCES, unsettled
from cosim.experiments.hmmwv.preview.report import chain_section, generated_section
from cosim.experiments.hmmwv.published import ERRORS_MS, LENGTHS, PUBLISHED, PUMP, estimated
from cosim.experiments.hmmwv.runs import CONTROLLERS, ROADS, SHIFTS, STRETCHES, TRAVEL_LIMIT, Case
from cosim.experiments.hmmwv.statements import NAMES, ROAD_NAMES, roughness_range
from cosim.experiments.hmmwv.tracking.report import section as tracking_section
from cosim.experiments.hmmwv.wiring import BUMPS, CONTROL_PERIOD, EXCHANGE, SPEED_KMH
from cosim.report import Figure, Panel, Parameter, Result, Series, Table, bars, curve, level
from cosim.report.model import Look
from cosim.study import Content, FmuSet, StudyReport, parameters
from fmu_sources.models.comfort import ABSORBED_POWER_LIMIT

_LIMIT = "limit of the driver"
_LOOKS: dict[str, Look] = {
    NAMES["passive"]: ("gray", "solid"),
    NAMES["zero"]: ("sky", "dot"),
    NAMES["skyhook"]: ("orange", "dash"),
    NAMES["lqr"]: ("blue", "dashdot"),
    NAMES["lqr-kilonewton"]: ("purple", "longdash"),
    NAMES["mpc"]: ("vermilion", "solid"),
    NAMES["mpc-preview"]: ("green", "solid"),
    _LIMIT: ("black", "dot"),
}
_X = "distance of the CG [m]"


def _parameters(fmus: FmuSet) -> list[Parameter]:
    paper = "001 section 1.6"
    names = ("RideCarHmmwv", "HydraulicActuator", "ForceTracking", "Skyhook")
    return [
        *(p for name in names for p in parameters(fmus.path(name), prefix=f"{name} ")),
        Parameter("speed", round(SPEED_KMH, 3), "km/h", paper),
        Parameter("sample time of the controllers", 1e3 * CONTROL_PERIOD, "ms", "001 section 1.3"),
        Parameter("exchange of car and actuators", f"{1e3 * EXCHANGE:g} ms", "-", "assumed; table of refinement"),
        Parameter("limit of absorbed power", ABSORBED_POWER_LIMIT, "W", paper),
    ]


def _reproduced(study: Averages, claims: Any) -> list[Result]:
    """How many statements are reproduced under each condition."""
    found = {c.id: c for c in claims}
    return [
        Result(
            f"statements on the controlled car reproduced in full, {at.words(study)}",
            sum(found[id].conditions[i].verdict == "reproduced" for id in SENTENCES),
            f"of {len(SENTENCES)}",
        )
        for i, at in enumerate(published.CONDITIONS)
    ]


report = StudyReport(
    EXPERIMENT,
    "Active suspension of a HMMWV with hydraulic actuators",
    lambda study: CLAIMS.judge(study.results),
    _parameters,
    _LOOKS,
    view=lambda results, _: Averages(results),
    results=_reproduced,
    provenance=lambda _: {"bump positions per control period": SHIFTS, "off-road stretches": STRETCHES},
)


@report.lead
def _main_result(study: Averages) -> Content:
    passive, mpc, preview = (study.power(Case("off-road", c)) for c in ("passive", "mpc", "mpc-preview"))
    yield f"""Off road at {SPEED_KMH:.1f} km/h, the driver absorbs {passive:.1f} W in the passive car, {mpc:.2f} W with
    MPC and {preview:.2f} W with MPC and preview, if the pump holds its pressure at any flow, and
    {study.power(PUMP(Case("off-road", "mpc"))):.1f} W with MPC and {PUMP.words(study)}; the limit that a driver bears
    is {ABSORBED_POWER_LIMIT:g} W."""
    powers = {NAMES[c]: [study.distribution("absorbed_power", Case(road, c)) for road in ROADS] for c in CONTROLLERS}
    limit = level(_LIMIT, [-0.5, len(ROADS) - 0.5], ABSORBED_POWER_LIMIT)
    yield Figure(
        "main-result",
        "Absorbed power by road and controller",
        "Pump without limit. Bars: medians over the places of the bump or the stretches off road; lines: from the"
        " lowest to the highest.",
        [bars("road [?]", "absorbed power [W]", [ROAD_NAMES[r] for r in ROADS], powers, limit)],
    )


@report.section("Runs of the study")
def _about(study: Averages) -> Content:
    yield f"""A HMMWV drives at 20 mph ({SPEED_KMH:.1f} km/h) over speed bumps and off road. Each wheel has a hydraulic
    actuator whose servo valve is commanded every millisecond by a force tracking controller; a controller of the whole
    vehicle gives the forces every 30 ms. The passive car is the same car with the pump off; the car without actuators
    is the one of zero force with ideal actuators. The figure of merit is the power that a driver absorbs. Every box is
    a native FMU; the statements of Donahue and Hedrick stand beside what these runs give. Statements on the car are
    judged under two conditions: with a pump that holds its pressure at any flow, and with what the pump delivers,
    {PUMP.words(study)} (four times that in all). Neither is the paper's vehicle, whose accumulator is not described.
    Figures are medians over the places of a bump on the controllers' grid of 30 ms, or over the stretches of an
    off-road course."""


@report.section("Absorbed power")
def _overview(study: Averages) -> Content:
    yield f"""Over bumps the figure is the peak of a moving mean over 1 s, off road the mean of the run, both from the
    heave of the CG. Over bumps it is the median over {SHIFTS} places of the bump between two samples of the controller,
    off road over {STRETCHES} stretches of a class E road.

    Ideal actuators give the force that the controller requests, at once. Hydraulics cost much of the benefit: the force
    tracking follows the desired force in the middle of a bump only after its valve has come back from saturation."""
    rows = []
    for road, controller in product(ROADS, CONTROLLERS):
        case = Case(road, controller)
        power = study.distribution("absorbed_power", case)
        ideal = None if controller == "passive" else round(study.power(Case(road, controller, actuators="ideal")), 2)
        rows.append(
            {
                "road": ROAD_NAMES[road],
                "controller": NAMES[controller],
                "absorbed power [W]": round(power.median, 2),
                "lowest [W]": round(power.low, 2),
                "highest [W]": round(power.high, 2),
                "with ideal actuators [W]": ideal,
                "ISO 2631 rms [m/s2]": round(study.mean("iso2631_rms", case), 2),
                "travel rms [mm]": round(1e3 * study.mean("travel_rms", case), 1),
                "largest travel [mm]": round(1e3 * study.largest("travel_peak", case), 0),
                f"travel beyond {1e3 * TRAVEL_LIMIT:g} mm [%]": round(100 * study.mean("travel_over", case), 2),
                "tire off the ground [%]": round(100 * study.mean("lift_off", case), 1),
                "force rms [N]": round(study.mean("force_rms", case), 0),
            }
        )
    yield Table.of(
        "absorbed-power",
        "Absorbed power and what goes with it",
        rows,
        "Pump without limit. Absorbed power: median, lowest and highest over the places of the bump or the stretches."
        " Travel beyond the limit: part of the time that any corner is there. Tire off the ground: part of the time"
        " that a tire has lost its static load.",
    )


report.section("Force tracking")(lambda study: tracking_section(study.results))


def _power_panel(study: Averages, road: str, controllers: tuple[str, ...]) -> Panel:
    curves = [curve(NAMES[c], study.signals(Case(road, c)), "power_window", x="x", thin=True) for c in controllers]
    limit = level(_LIMIT, curves[0].x, ABSORBED_POWER_LIMIT)
    return Panel(ROAD_NAMES[road], _X, "absorbed power over 1 s [W]", [*curves, limit])


@report.section("Test track")
def _test_track(study: Averages) -> Content:
    ahead = study.gain(Case("track", "mpc"), [Case("track", c) for c in published.WITHOUT_PREVIEW])
    yield f"""Two bumps, 57 and 38 mm high, 6 m apart. Skyhook, LQR and zero force remove the damping of the closed
    cylinders. MPC is {ahead.median:.0f} % below the best of them; the paper calls it slightly better.

    The valves saturate where a wheel meets a bump: the wheel moves faster than oil can pass, so the cylinder resists
    whatever force is requested."""
    signals = study.signals(Case("track", "mpc"))
    saturated = np.where(signals["saturated"] > 0, signals["force"], np.nan)
    forces = [
        curve("desired, smoothed", signals, "smoothed", x="x", color="black"),
        curve("actuator", signals, "force", x="x", color="vermilion"),
        Series("valve saturated", signals["x"], saturated, color="purple", mode="markers"),
    ]
    yield Figure(
        "figure-1-9",
        "Test track (figure 1.9 of the paper)",
        "Absorbed power of the last second over the distance, and what the front left actuator does under MPC.",
        [_power_panel(study, "track", PUBLISHED), Panel("force at the front left wheel, MPC", _X, "force [N]", forces)],
    )


@report.section("Off road")
def _off_road(study: Averages) -> Content:
    limit = 1e3 * TRAVEL_LIMIT
    mpc, kilonewton = Case("off-road", "mpc"), Case("off-road", "lqr-kilonewton")
    (power, peak, over), (others, highest, often) = (
        (study.power(c), 1e3 * study.largest("travel_peak", c), 100 * study.mean("travel_over", c))
        for c in (mpc, kilonewton)
    )
    low, high = roughness_range(study)
    window = (
        f"With spectra of {low:.2f} to {high:.2f} times that of class E, if power grows in proportion, MPC alone stays"
        if low < high
        else "On no spectrum, if power grows in proportion, does MPC alone stay"
    )
    yield f"""A random road of ISO 8608 class E, smoothed over the contact of the tire; the figure shows the first of
    five stretches. The paper does not describe its terrain, and the class decides the verdicts on
    {ABSORBED_POWER_LIMIT:g} W. {window} below {ABSORBED_POWER_LIMIT:g} W on every stretch.

    The LQR whose weights are read with the force in kN absorbs {others:.2f} W, MPC {power:.2f} W:
    {"it beats MPC" if others < power else "MPC beats it"}. Its suspension moves up to {highest:.0f} mm and is beyond
    the {limit:g} mm of Table 1.3 {often:.1f} % of the time. MPC's own goes to {peak:.0f} mm and is beyond them
    {over:.2f} % of the time, since that limit is soft. With {PUMP.words(study)} the LQR in kN is at
    {study.power(PUMP(kilonewton)):.1f} W and MPC at {study.power(PUMP(mpc)):.1f} W."""
    shown = (*PUBLISHED, "lqr-kilonewton")
    travels = [curve(NAMES[c], study.signals(Case("off-road", c)), "travel", 1e3, x="x", thin=True) for c in shown]
    x = travels[0].x_values
    band = ([x[0], x[-1], np.nan, x[0], x[-1]], [limit, limit, np.nan, -limit, -limit])
    limits = Series("limit of travel", *band, color="black", dash="dash")
    yield Figure(
        "figure-1-10",
        "Off road (figure 1.10 of the paper)",
        "Absorbed power of the last second, and travel of the front left suspension.",
        [
            _power_panel(study, "off-road", shown),
            Panel("suspension", _X, "travel, front left [mm]", [*travels, limits]),
        ],
    )


@report.section("Preview")
def _preview(study: Averages) -> Content:
    base = study.power(Case("bump", "mpc"))
    taken = study.gain(Case("bump", "mpc-preview"), [Case("bump", "mpc")])
    by_length = {0: base} | {n: study.power(Case("bump", "mpc-preview", preview_steps=n)) for n in LENGTHS}
    displaced = {ms: Case("bump", "mpc-preview", preview_error_ms=ms) for ms in ERRORS_MS}
    errors = {ms: study.distribution("absorbed_power", case) for ms, case in displaced.items()}
    meters = [1e-3 * ms * SPEED_KMH / 3.6 for ms in ERRORS_MS]
    most, least = (base * (1 - edge / 100) for edge in (PREVIEW_GAIN.low, PREVIEW_GAIN.high))
    inside = ", ".join(f"{ms:+d}" for ms, found in errors.items() if least <= found.median <= most)
    worse = ", ".join(f"{ms:+d}" for ms, found in errors.items() if found.median > base)
    longest = max(by_length)
    enough = next((n for n, power in by_length.items() if power <= 1.1 * by_length[longest]), longest)
    span = f"{PREVIEW_GAIN.low:g} to {PREVIEW_GAIN.high:g} %"
    late = f". Of those tried, {inside} ms leave {span} (positive: the preview shows the bump too late)"
    yield f"""Preview takes {taken.median:.0f} % off the absorbed power over one 76 mm bump, the paper measured 15 %. A
    preview of {enough} steps of {1e3 * CONTROL_PERIOD:.0f} ms is within 10 % of one of {longest}.

    The paper's preview was generated: a known profile at a distance that the car integrates from its speed, with an
    error that it shows to grow along the track{late if inside else f"; none that was tried leaves {span}"}{
        f"; at {worse} ms it is worse than none" if worse else ""
    }.
    {"The measurements of the paper fit a misplaced preview." if inside else ""}"""
    yield Figure(
        "figure-1-11",
        "One 76 mm bump (figure 1.11 of the paper)",
        "Absorbed power of the last second.",
        [_power_panel(study, "bump", PUBLISHED)],
    )
    look: dict[str, Any] = {"color": "green", "mode": "line+markers"}
    middle, low, high = ([getattr(d, at) for d in errors.values()] for at in ("median", "low", "high"))
    by_position = [
        Series("MPC with displaced preview", meters, middle, low, high, **look),
        level("without preview", meters, base, color="vermilion"),
        level("15 % better", meters, 0.85 * base, low=[least] * 2, high=[most] * 2, color="black", dash="dash"),
    ]
    known = [Series("MPC by length of preview", [*by_length], [*by_length.values()], **look)]
    yield Figure(
        "preview-length-and-error",
        "Length and position error of the preview, one 76 mm bump",
        "Beyond its length a preview continues at its last height. Band: over the places of the bump between two"
        " samples of the controller.",
        [
            Panel("length", "preview [steps]", "absorbed power [W]", known),
            Panel("position error", "preview too late by [m]", "absorbed power [W]", by_position),
        ],
        columns=2,
    )
    rows = (
        {
            "preview too late by [ms]": ms,
            "by [m]": round(m, 3),
            "absorbed power [W]": round(p, 2),
            "share of MPC without preview [%]": round(100 * p / base, 0),
        }
        for ms, p, m in zip(errors, middle, meters, strict=True)
    )
    yield Table.of("preview-error", "Position error of the preview, one 76 mm bump", rows, OF_MEDIANS)


@report.section("Estimated states and sensed preview")
def _estimates(study: Averages) -> Content:
    yield """Estimated states come from the Kalman filter downstream of 22 noisy sensors, the generated preview from a
    profile at the distance of the speedometer, the sensed preview from two range sensors, corrected for the pose of the
    body and buffered."""
    rows = []
    for road, c in product(ROADS, published.ESTIMATED):
        true, found = study.power(Case(road, c)), study.power(estimated(c, road))
        row: dict[str, Any] = {"road": ROAD_NAMES[road], "controller": NAMES[c], "true states [W]": round(true, 2)}
        row |= {"estimated states [W]": round(found, 2), "difference [%]": round(100 * (found / true - 1), 1)}
        sensed = round(study.power(estimated(c, road, sensed=True)), 2) if c == "mpc-preview" else None
        rows.append({**row, "with sensed preview [W]": sensed})
    yield Table.of("estimates", "Absorbed power with true and with estimated states", rows, OF_MEDIANS)


report.section("Generated preview")(lambda study: generated_section(study.results))
report.section("Sensed preview")(lambda study: chain_section(study.results))
report.section("Effect of the hydraulics, and the pump that is needed")(pump.section)


@report.section("Influence of the assumptions")
def _assumptions(study: Averages) -> Content:
    yield f"""The paper emulates the passive car with the pump off and the valves unpowered. How far an unpowered spool
    stays open is not given; {study.null_opening_mm:g} mm is assumed here. A closed one would lock the struts. The
    absorbed power of the passive car, and with it every ratio to it, depends on this opening; each such claim says by
    how much.

    Tires lift off here, as real ones do. Tires that take tension make the big bump far worse for the passive car."""
    roads = ("track", "bump")
    openings = (
        {
            "road": ROAD_NAMES[road],
            "null opening [mm]": mm,
            "absorbed power [W]": round(study.power(Case(road, "passive", null_opening_mm=mm)), 1),
        }
        for road, mm in product(roads, published.NULL_OPENINGS_MM)
    )
    yield Table.of("null-opening", "The passive car over the opening of its unpowered spools", openings)
    options = (
        {
            "road": ROAD_NAMES[road],
            "controller": NAMES[c],
            "as in all other tables [W]": round(study.power(Case(road, c)), 2),
            "tires that take tension [W]": round(study.power(Case(road, c, lift_off=False)), 2),
            "dry friction [W]": round(study.power(Case(road, c, friction=True)), 2),
        }
        for road, c in product(roads, PUBLISHED)
    )
    title = "Absorbed power with other tires and with friction in the suspension"
    yield Table.of("tires-and-friction", title, options)


report.section("Refinement of the steps")(lambda study: refinement.section(study, unsettled(study)))


@report.section("Differences from the paper")
def _limits(study: Averages) -> Content:
    heights = " and ".join(f"{1e3 * h:g} mm" for h in BUMPS["track"].values())
    yield f"""The paper measured on a vehicle; these are runs of a model with seven degrees of freedom, linear but for
    tires that lift off; without those it is also what the controllers and the filter are designed on.

    Roads: the bumps' shape, which bumps stood where and the off-road terrain are not in the paper. A bump is a parabola
    0.305 m long smoothed over 0.25 m of contact, {heights} high on the track; off road is class E of ISO 8608. The bump
    of {1e3 * BUMPS["bump"][1]:g} mm is higher than the 60 mm of travel, which the road reports: what the contact does
    not smooth away, body and tires must take.

    The weights of the LQR are taken in SI units with the force in newtons, so that it hardly requests force; taken in
    kilonewtons the regulator works up to its limit of 8 kN (section off road; on the track it absorbs
    {study.power(Case("track", "lqr-kilonewton")):.1f} W). The force rate of MPC is 5000 N per step of 30 ms; read as
    printed, per second, MPC would hardly move.

    The human response filter of the paper takes acceleration in ft/s2; the print says m/s2, with which every car would
    be below 6 W."""
