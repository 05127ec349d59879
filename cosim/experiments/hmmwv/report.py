"""Claims, tables and figures of paper 001 as a report."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

import numpy as np

from cosim.experiments.hmmwv import EXPERIMENT, pump, refinement
from cosim.experiments.hmmwv.averages import OF_MEDIANS, Averages
from cosim.experiments.hmmwv.claims import CLAIMS, PREVIEW_GAIN, SENTENCES, unsettled
from cosim.experiments.hmmwv.preview.report import chain_section, generated_section
from cosim.experiments.hmmwv.published import (
    CONDITIONS,
    ERRORS_MS,
    ESTIMATED,
    LENGTHS,
    NULL_OPENINGS_MM,
    PUBLISHED,
    PUMP,
    WITHOUT_LIMIT,
    WITHOUT_PREVIEW,
    estimated,
)
from cosim.experiments.hmmwv.runs import CONTROLLERS, ROADS, SHIFTS, STRETCHES, TRAVEL_LIMIT, Case
from cosim.experiments.hmmwv.statements import NAMES, ROAD_NAMES, gain, roughness_range
from cosim.experiments.hmmwv.tracking.report import section as tracking_section
from cosim.experiments.hmmwv.wiring import BUMPS, CONTROL_PERIOD, EXCHANGE, SPEED_KMH
from cosim.report import Figure, Panel, Parameter, Report, Result, Section, Series, Table, keep_peaks
from cosim.report.model import Scalar
from cosim.study import FmuSet, Results, make_lead, parameters, provenance, sections
from fmu_sources.models.comfort import ABSORBED_POWER_LIMIT

_LOOKS = {
    "passive": ("gray", "solid"),
    "zero": ("sky", "dot"),
    "skyhook": ("orange", "dash"),
    "lqr": ("blue", "dashdot"),
    "lqr-kilonewton": ("purple", "longdash"),
    "mpc": ("vermilion", "solid"),
    "mpc-preview": ("green", "solid"),
}
_LIMIT = "limit of the driver"
_X, _POWER = "distance of the CG [m]", "absorbed power over 1 s [W]"


def report(study: Results, fmus: FmuSet) -> Report:
    """The whole report of a study."""
    averages = Averages(study)
    judged = CLAIMS.judge(study)
    verdicts = {c.id: c for c in judged}
    makers = (
        _on_vehicle(_overview),
        tracking_section,
        *map(_on_vehicle, (_test_track, _off_road, _preview, _estimates)),
        generated_section,
        chain_section,
        *map(_on_vehicle, (pump.section, _assumptions)),
        _refinement,
        _on_vehicle(_limits),
    )
    lead, figure = make_lead(averages, _main_result)
    about = Section(
        "Runs of the study",
        [
            f"A HMMWV drives at 20 mph ({SPEED_KMH:.1f} km/h) over speed bumps and off road. Each wheel has a hydraulic"
            " actuator whose servo valve is commanded every millisecond by a force tracking controller; a controller"
            " of the whole vehicle gives the forces every 30 ms. The passive car is the same car with the pump off;"
            " the car without actuators is the one of zero force with ideal actuators. The figure of merit is the"
            " power that a driver absorbs. Every box is a native FMU; the statements of Donahue and Hedrick stand"
            " beside what these runs give. Statements on the car are judged under two conditions: with a pump"
            f" that holds its pressure at any flow, and with what the pump delivers, {PUMP.words(averages)} (four times"
            " that in all). Neither is the paper's vehicle, whose accumulator is not described."
            " Figures are medians over the places of a bump on the controllers' grid of 30 ms, or over the stretches"
            " of an off-road course."
        ],
    )
    return Report(
        experiment=EXPERIMENT.name,
        title="Active suspension of a HMMWV with hydraulic actuators",
        lead=lead,
        figure=figure,
        claims=judged,
        results=[
            Result(
                f"statements on the controlled car reproduced in full, {at.words(averages)}",
                sum(verdicts[p.id].conditions[i].verdict == "reproduced" for p in SENTENCES),
                f"of {len(SENTENCES)}",
            )
            for i, at in enumerate(CONDITIONS)
        ],
        sections=[about, *sections(study, makers)],
        parameters=_parameters(fmus),
        provenance=provenance(EXPERIMENT, fmus)
        | {
            "bump positions per control period": SHIFTS,
            "off-road stretches": STRETCHES,
        },
    )


def _on_vehicle(maker: Callable[[Averages], Section]) -> Callable[[Results], Section]:
    """A maker of a section from averages as one from results, under the same name."""

    @wraps(maker)
    def made(study: Results) -> Section:
        return maker(Averages(study))

    return made


def _refinement(study: Results) -> Section:
    """Refinement of the steps."""
    return refinement.section(Averages(study), unsettled(study))


def _series(name: str, x: Any, y: Any) -> Series:
    color, dash = _LOOKS[name]
    return Series(NAMES[name], *keep_peaks(x, y), color=color, dash=dash)  # type: ignore[arg-type]


def _main_result(study: Averages) -> tuple[str, Figure]:
    """Absorbed power by road and controller."""
    passive, mpc, preview = (study.power(Case("off-road", c)) for c in ("passive", "mpc", "mpc-preview"))
    lead = (
        f"Off road at {SPEED_KMH:.1f} km/h, the driver absorbs {passive:.1f} W in the passive car, {mpc:.2f} W with MPC"
        f" and {preview:.2f} W with MPC and preview, if the pump holds its pressure at any flow, and"
        f" {study.power(PUMP(Case('off-road', 'mpc'))):.1f} W with MPC and {PUMP.words(study)}; the limit that a driver"
        f" bears is {ABSORBED_POWER_LIMIT:g} W."
    )
    bars = []
    for c in CONTROLLERS:
        powers = [study.distribution("absorbed_power", Case(road, c)) for road in ROADS]
        (median, low, high) = zip(*((p.median, p.low, p.high) for p in powers), strict=True)
        color, dash = _LOOKS[c]
        at = range(len(ROADS))
        bars.append(Series(NAMES[c], at, median, low, high, color=color, dash=dash, mode="bar"))  # type: ignore[arg-type]
    limit = Series(_LIMIT, [-0.5, len(ROADS) - 0.5], [ABSORBED_POWER_LIMIT] * 2, color="black", dash="dot")
    panel = Panel("", "road [?]", "absorbed power [W]", [*bars, limit], x_names=[ROAD_NAMES[r] for r in ROADS])
    caption = (
        "Pump without limit. Bars: medians over the places of the bump or the stretches off road; lines: from the"
        " lowest to the highest."
    )
    return lead, Figure("main-result", "Absorbed power by road and controller", caption, [panel])


def _overview(study: Averages) -> Section:
    """Absorbed power."""
    rows: list[list[Scalar]] = []
    for road in ROADS:
        for controller in CONTROLLERS:
            case = Case(road, controller)
            power = study.distribution("absorbed_power", case)
            ideal = None if controller == "passive" else study.power(Case(road, controller, actuators="ideal"))
            rows.append(
                [
                    ROAD_NAMES[road],
                    NAMES[controller],
                    round(power.median, 2),
                    round(power.low, 2),
                    round(power.high, 2),
                    None if ideal is None else round(ideal, 2),
                    round(study.mean("iso2631_rms", case), 2),
                    round(1e3 * study.mean("travel_rms", case), 1),
                    round(1e3 * study.largest("travel_peak", case), 0),
                    round(100 * study.mean("travel_over", case), 2),
                    round(100 * study.mean("lift_off", case), 1),
                    round(study.mean("force_rms", case), 0),
                ]
            )
    return Section(
        "Absorbed power",
        [
            (
                "Over bumps the figure is the peak of a moving mean over 1 s, off road the mean of the run, both from"
                f" the heave of the CG. Over bumps it is the median over {SHIFTS} places of the bump between two"
                f" samples of the controller, off road over {STRETCHES} stretches of a class E road."
            ),
            (
                "Ideal actuators give the force that the controller requests, at once. Hydraulics cost much of the"
                " benefit: the force tracking follows the desired force in the middle of a bump only"
                " after its valve has come"
                " back from saturation."
            ),
        ],
        tables=[
            Table(
                "absorbed-power",
                "Absorbed power and what goes with it",
                [
                    "road",
                    "controller",
                    "absorbed power [W]",
                    "lowest [W]",
                    "highest [W]",
                    "with ideal actuators [W]",
                    "ISO 2631 rms [m/s2]",
                    "travel rms [mm]",
                    "largest travel [mm]",
                    f"travel beyond {1e3 * TRAVEL_LIMIT:g} mm [%]",
                    "tire off the ground [%]",
                    "force rms [N]",
                ],
                rows,
                "Pump without limit. Absorbed power: median, lowest and highest over the places of the bump or the"
                " stretches. Travel beyond the limit: part of the time that any corner is there. Tire off the ground:"
                " part of the time that a tire has lost its static load.",
            )
        ],
    )


def _power_panel(study: Averages, road: str, controllers: tuple[str, ...]) -> Panel:
    curves = []
    for c in controllers:
        h = study.signals(Case(road, c))
        curves.append(_series(c, h["x"], h["power_window"]))
    x = curves[0].x_values
    limit = Series(_LIMIT, [x[0], x[-1]], [ABSORBED_POWER_LIMIT] * 2, color="black", dash="dot")
    return Panel(ROAD_NAMES[road], _X, _POWER, [*curves, limit])


def _test_track(study: Averages) -> Section:
    """Test track."""
    tracking = study.signals(Case("track", "mpc"))
    ahead = gain("track", "mpc", WITHOUT_PREVIEW)(study, WITHOUT_LIMIT)
    saturated = np.where(tracking["saturated"] > 0, tracking["force"], np.nan)
    return Section(
        "Test track",
        [
            (
                "Two bumps, 57 and 38 mm high, 6 m apart. Skyhook, LQR and zero force remove the damping of the closed"
                f" cylinders. MPC is {ahead.median:.0f} % below the best of them; the paper calls it slightly better."
            ),
            (
                "The valves saturate where a wheel meets a bump: the wheel moves faster than oil can pass, so the"
                " cylinder resists whatever force is requested."
            ),
        ],
        figures=[
            Figure(
                "figure-1-9",
                "Test track (figure 1.9 of the paper)",
                "Absorbed power of the last second over the distance, and what the front left actuator does under MPC.",
                [
                    _power_panel(study, "track", PUBLISHED),
                    Panel(
                        "force at the front left wheel, MPC",
                        _X,
                        "force [N]",
                        [
                            Series("desired, smoothed", tracking["x"], tracking["smoothed"], color="black"),
                            Series("actuator", tracking["x"], tracking["force"], color="vermilion"),
                            Series("valve saturated", tracking["x"], saturated, color="purple", mode="markers"),
                        ],
                    ),
                ],
            ),
        ],
    )


def _off_road(study: Averages) -> Section:
    """Off road."""
    travels = []
    shown = (*PUBLISHED, "lqr-kilonewton")
    for c in shown:
        h = study.signals(Case("off-road", c))
        travels.append(_series(c, h["x"], 1e3 * h["travel"]))
    x, limit = travels[0].x_values, 1e3 * TRAVEL_LIMIT
    band = ([x[0], x[-1], np.nan, x[0], x[-1]], [limit, limit, np.nan, -limit, -limit])
    mpc, kilonewton = Case("off-road", "mpc"), Case("off-road", "lqr-kilonewton")
    (power, peak, over), (others, highest, often) = (
        (study.power(c), 1e3 * study.largest("travel_peak", c), 100 * study.mean("travel_over", c))
        for c in (mpc, kilonewton)
    )
    low, high = roughness_range(study)
    window = (
        f"With spectra of {low:.2f} to {high:.2f} times that of class E, if power grows in proportion, MPC alone stays"
        " below "
        if low < high
        else "On no spectrum, if power grows in proportion, does MPC alone stay below "
    )
    return Section(
        "Off road",
        [
            (
                "A random road of ISO 8608 class E, smoothed over the contact of the tire; the figure shows the first"
                " of five stretches. The paper does not describe its terrain, and the class decides the verdicts on"
                f" {ABSORBED_POWER_LIMIT:g} W. {window}{ABSORBED_POWER_LIMIT:g} W on every stretch."
            ),
            f"The LQR whose weights are read with the force in kN absorbs {others:.2f} W, MPC {power:.2f} W: "
            + ("it beats MPC" if others < power else "MPC beats it")
            + f". Its suspension moves up to {highest:.0f} mm and is beyond the {limit:g} mm of Table 1.3 {often:.1f} %"
            f" of the time. MPC's own goes to {peak:.0f} mm and is beyond them {over:.2f} % of the time, since that"
            f" limit is soft. With {PUMP.words(study)} the LQR in kN is at {study.power(PUMP(kilonewton)):.1f} W and"
            f" MPC at {study.power(PUMP(mpc)):.1f} W.",
        ],
        figures=[
            Figure(
                "figure-1-10",
                "Off road (figure 1.10 of the paper)",
                "Absorbed power of the last second, and travel of the front left suspension.",
                [
                    _power_panel(study, "off-road", shown),
                    Panel(
                        "suspension",
                        _X,
                        "travel, front left [mm]",
                        [*travels, Series("limit of travel", *band, color="black", dash="dash")],
                    ),
                ],
            )
        ],
    )


def _preview(study: Averages) -> Section:
    """Preview."""
    base = study.power(Case("bump", "mpc"))
    taken = gain("bump", "mpc-preview", ("mpc",))(study, WITHOUT_LIMIT)
    lengths = [0, *LENGTHS]
    by_length = [base, *(study.power(Case("bump", "mpc-preview", preview_steps=n)) for n in LENGTHS)]
    cases = [Case("bump", "mpc-preview", preview_error_ms=ms) for ms in ERRORS_MS]
    by_error = [study.power(c) for c in cases]
    spread = np.array([(d.low, d.high) for d in (study.distribution("absorbed_power", c) for c in cases)])
    meters = [1e-3 * ms * SPEED_KMH / 3.6 for ms in ERRORS_MS]
    most, least = (base * (1 - edge / 100) for edge in (PREVIEW_GAIN.low, PREVIEW_GAIN.high))
    inside = [ms for ms, p in zip(ERRORS_MS, by_error, strict=True) if least <= p <= most]
    worse = [ms for ms, p in zip(ERRORS_MS, by_error, strict=True) if p > base]
    enough = next((n for n, p in zip(lengths, by_length, strict=True) if p <= 1.1 * by_length[-1]), lengths[-1])
    return Section(
        "Preview",
        [
            (
                f"Preview takes {taken.median:.0f} % off the absorbed power over one 76 mm bump, the paper measured 15"
                f" %. A preview of {enough} steps of {1e3 * CONTROL_PERIOD:.0f} ms is within 10 % of one of"
                f" {lengths[-1]}."
            ),
            "The paper's preview was generated: a known profile at a distance that the car integrates from its speed,"
            " with an error "
            + (
                f"that it shows to grow along the track. Of those tried, {', '.join(f'{ms:+d}' for ms in inside)} ms"
                f" leave {PREVIEW_GAIN.low:g} to {PREVIEW_GAIN.high:g} % (positive: the preview shows the bump too"
                " late)"
                if inside
                else (
                    "that it shows to grow along the track; none that was tried leaves "
                    f"{PREVIEW_GAIN.low:g} to {PREVIEW_GAIN.high:g} %"
                )
            )
            + (f"; at {', '.join(f'{ms:+d}' for ms in worse)} ms it is worse than none. " if worse else ". ")
            + ("The measurements of the paper fit a misplaced preview." if inside else ""),
        ],
        figures=[
            Figure(
                "figure-1-11",
                "One 76 mm bump (figure 1.11 of the paper)",
                "Absorbed power of the last second.",
                [_power_panel(study, "bump", PUBLISHED)],
            ),
            Figure(
                "preview-length-and-error",
                "Length and position error of the preview, one 76 mm bump",
                "Beyond its length a preview continues at its last height. Band: over the places of the bump between"
                " two samples of the controller.",
                [
                    Panel(
                        "length",
                        "preview [steps]",
                        "absorbed power [W]",
                        [Series("MPC by length of preview", lengths, by_length, color="green", mode="line+markers")],
                    ),
                    Panel(
                        "position error",
                        "preview too late by [m]",
                        "absorbed power [W]",
                        [
                            Series(
                                "MPC with displaced preview",
                                meters,
                                by_error,
                                low=spread[:, 0],
                                high=spread[:, 1],
                                color="green",
                                mode="line+markers",
                            ),
                            Series("without preview", [meters[0], meters[-1]], [base] * 2, color="vermilion"),
                            Series(
                                "15 % better",
                                [meters[0], meters[-1]],
                                [0.85 * base] * 2,
                                low=[least] * 2,
                                high=[most] * 2,
                                color="black",
                                dash="dash",
                            ),
                        ],
                    ),
                ],
                columns=2,
            ),
        ],
        tables=[
            Table(
                "preview-error",
                "Position error of the preview, one 76 mm bump",
                ["preview too late by [ms]", "by [m]", "absorbed power [W]", "share of MPC without preview [%]"],
                [
                    [ms, round(m, 3), round(p, 2), round(100 * p / base, 0)]
                    for ms, m, p in zip(ERRORS_MS, meters, by_error, strict=True)
                ],
                OF_MEDIANS,
            )
        ],
    )


def _estimates(study: Averages) -> Section:
    """Estimated states and sensed preview."""
    rows: list[list[Scalar]] = []
    for road in ROADS:
        for controller in ESTIMATED:
            true, estimated_power = study.power(Case(road, controller)), study.power(estimated(controller, road))
            sensed = study.power(estimated(controller, road, sensed=True)) if controller == "mpc-preview" else None
            rows.append(
                [
                    ROAD_NAMES[road],
                    NAMES[controller],
                    round(true, 2),
                    round(estimated_power, 2),
                    round(100 * (estimated_power / true - 1), 1),
                    None if sensed is None else round(sensed, 2),
                ]
            )
    return Section(
        "Estimated states and sensed preview",
        [
            (
                "Estimated states come from the Kalman filter downstream of 22 noisy sensors, the generated preview"
                " from a profile at the distance of the speedometer, the sensed preview from two range sensors,"
                " corrected for the pose of the body and buffered."
            ),
        ],
        tables=[
            Table(
                "estimates",
                "Absorbed power with true and with estimated states",
                [
                    "road",
                    "controller",
                    "true states [W]",
                    "estimated states [W]",
                    "difference [%]",
                    "with sensed preview [W]",
                ],
                rows,
                OF_MEDIANS,
            )
        ],
    )


def _assumptions(study: Averages) -> Section:
    """Influence of the assumptions."""
    openings: list[list[Scalar]] = [
        [ROAD_NAMES[road], mm, round(study.power(Case(road, "passive", null_opening_mm=mm)), 1)]
        for road in ("track", "bump")
        for mm in NULL_OPENINGS_MM
    ]
    options: list[list[Scalar]] = [
        [
            ROAD_NAMES[road],
            NAMES[c],
            round(study.power(Case(road, c)), 2),
            round(study.power(Case(road, c, lift_off=False)), 2),
            round(study.power(Case(road, c, friction=True)), 2),
        ]
        for road in ("track", "bump")
        for c in PUBLISHED
    ]
    return Section(
        "Influence of the assumptions",
        [
            (
                "The paper emulates the passive car with the pump off and the valves unpowered. How far an unpowered"
                f" spool stays open is not given; {study.null_opening_mm:g} mm is assumed here. A closed one would lock"
                " the struts. The absorbed power of the passive car, and with it every ratio to it, depends on this"
                " opening; each such claim says by how much."
            ),
            (
                "Tires lift off here, as real ones do. Tires that take tension make the big bump far worse for the"
                " passive car."
            ),
        ],
        tables=[
            Table(
                "null-opening",
                "The passive car over the opening of its unpowered spools",
                ["road", "null opening [mm]", "absorbed power [W]"],
                openings,
            ),
            Table(
                "tires-and-friction",
                "Absorbed power with other tires and with friction in the suspension",
                ["road", "controller", "as in all other tables [W]", "tires that take tension [W]", "dry friction [W]"],
                options,
            ),
        ],
    )


def _limits(study: Averages) -> Section:
    """Differences from the paper."""
    return Section(
        "Differences from the paper",
        [
            (
                "The paper measured on a vehicle; these are runs of a model with seven degrees of freedom, linear but"
                " for tires that lift off; without those it is also what the controllers and the filter are"
                " designed on."
            ),
            (
                "Roads: the bumps' shape, which bumps stood where and the off-road terrain are not in the paper. A"
                " bump is a parabola 0.305 m long smoothed over 0.25 m of contact,"
                f" {' and '.join(f'{1e3 * h:g} mm' for h in BUMPS['track'].values())} high on the track; off road is"
                f" class E of ISO 8608. The bump of {1e3 * BUMPS['bump'][1]:g} mm is higher than the 60 mm of travel,"
                " which the road reports: what the contact does not smooth away, body and tires must take."
            ),
            (
                "The weights of the LQR are taken in SI units with the force in newtons, so that it hardly requests"
                " force; taken in kilonewtons the regulator works up to its limit of 8 kN (section off road; on the"
                f" track it absorbs {study.power(Case('track', 'lqr-kilonewton')):.1f} W). The force rate of MPC is"
                " 5000 N per step of 30 ms; read as printed, per second, MPC would hardly move."
            ),
            (
                "The human response filter of the paper takes acceleration in ft/s2; the print says m/s2, with which"
                " every car would be below 6 W."
            ),
        ],
    )


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
