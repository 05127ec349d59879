"""Passive, semi-active and active suspension as a report."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product

import numpy as np

from cosim.experiments.semi_active import EXPERIMENT
from cosim.experiments.semi_active.claims import CLAIMS, COMFORT, ROAD_HOLDING, best
from cosim.experiments.semi_active.published import FAMILIES, NAMES, REFINED, SYSTEMS, at, family, without_hysteresis
from cosim.experiments.semi_active.runs import BANDS, DAMPER, METRICS, invariant
from cosim.experiments.steps import with_finer_steps
from cosim.report import Figure, Panel, Parameter, Series, Table, bars, curve
from cosim.report.fronts import non_dominated
from cosim.report.model import Look
from cosim.study import Content, FmuSet, Results, StudyReport, parameters
from cosim.study.pages import cells, compared

_LOOKS: dict[str, Look] = {
    "passive": "black",
    "semi-active": "blue",
    "active": "vermilion",
    "skyhook": ("blue", "dash"),
    "skyhook, on-off": "sky",
    "groundhook": ("green", "dash"),
    "groundhook, on-off": ("green", "solid"),
    "ADD": "orange",
    "SH-ADD": "purple",
    "clipped LQR": ("vermilion", "dash"),
    "MPC": ("vermilion", "dot"),
    "LQR, active": ("gray", "solid"),
    "without hysteresis": ("gray", "dot"),
}
_SHOWN = {
    "hooks and ADD": ("passive", "skyhook-on-off", "add", "sh-add"),
    "road holding and optimal control": ("passive", "groundhook-on-off", "lqr", "mpc", "lqr, ideal"),
}
_GAINS = {
    "acceleration": ("body acceleration", "1/s", 1.0),
    "tire": ("tire deflection", "ms", 1e3),
}  # words, unit, factor


def _parameters(fmus: FmuSet) -> list[Parameter]:
    return [*parameters(fmus.path("RideCarHmmwv")), *parameters(fmus.path(DAMPER), prefix="damper: ")]


report = StudyReport(EXPERIMENT, "Passive, semi-active and active suspension of one car", CLAIMS, _parameters, _LOOKS)


@report.lead
def _main_result(study: Results) -> Content:
    base = study[at("passive")][COMFORT]
    semi, active = (best(study, kind, COMFORT, ROAD_HOLDING) for kind in ("semi-active", "active"))
    yield f"""With the road holding of the passive HMMWV, the body's rms acceleration is {compared(semi, base)} with the
    best semi-active control law and {compared(active, base)} with the best active one."""
    curves = []
    for kind in FAMILIES:
        points = np.array([[study[c][ROAD_HOLDING], study[c][COMFORT]] for c in family(kind)])
        points = points[non_dominated(points)]
        points = points[np.argsort(points[:, 0])]
        curves.append(Series(kind, 1e3 * points[:, 0], points[:, 1], mode="line+markers"))
    panel = Panel("", METRICS[ROAD_HOLDING].heading, METRICS[COMFORT].heading, curves)
    yield Figure(
        "main-result",
        "Comfort against road holding",
        "Down and left is better. Only runs that no run of the same kind surpasses in both.",
        [panel],
    )


@report.section("Runs of the study")
def _about(_: Results) -> Content:
    yield """The HMMWV of paper 001 with seven degrees of freedom drives over a random road (ISO 8608) and a bump. Only
    what is between body and wheels differs: its own dampers; semi-active dampers, whose current the control law sets;
    or ideal actuators, which give any force that the same control law requests. All have the same springs. Passive
    dampers from soft to hard, hooks from sky to ground and weights of the LQR from acceleration to tires make the
    fronts."""
    yield """The curves of the damper are assumed, from a quarter to about twice the damping of the HMMWV; with a
    measured damper the numbers change. They, and the force weight of LQR and MPC, were chosen after first runs. The
    damper's temperature is left out. The MPC and the LQR have the same index, the MPC
    as sum over its samples, the LQR as exact integral: with ideal actuators, whose force the index hardly weighs, the
    acceleration between the samples is larger under the MPC."""


def _table(study: Results, systems: Iterable[str], road: str, id: str, title: str) -> Table:
    shown = [k for k in METRICS if k != "power_coil"]
    rows = [{"system": NAMES[s], **cells(METRICS, study[at(s, road)], shown)} for s in systems]
    return Table.of(id, title, rows, "Powers are means over time, of all four corners.")


@report.section("All systems")
def _systems(study: Results) -> Content:
    yield """On-off control laws switch a damper's force at full size, which the acceleration of the body shows;
    continuous ones do not. Groundhook damps the hop of the wheels and hardly the body, whose slow motion deflects the
    tires too: over all frequencies it does not hold the road best."""
    yield _table(study, SYSTEMS, "random", "random", "Random road, class D, 50 km/h")
    yield _table(study, SYSTEMS, "bump", "bump", "Bump of 76 mm, 50 km/h")


@report.section("Frequency responses")
def _responses(study: Results) -> Content:
    frequency, gain = invariant()
    yield f"""On a rig, all wheels get the same random road, so that this car only heaves. Gains are square roots of
    ratios of spectra, which count all power that the road causes, as a control law that switches makes harmonics. At
    {frequency:.1f} Hz no suspension can change the acceleration of the body: {gain:.1f} 1/s."""
    panels = []
    for (title, systems), (quantity, (words, unit, factor)) in product(_SHOWN.items(), _GAINS.items()):
        curves = [curve(NAMES[s], study.signals(at(s, "rig")), quantity, factor, x="frequency") for s in systems]
        label = f"{words} [{unit}]"
        panels.append(Panel(title, "frequency [Hz]", label, curves, x_scale="log", y_scale="log"))
    caption = "Per velocity of the road, on the rig, class D at 50 km/h."
    yield Figure("responses", "Gain of body and tire over frequency", caption, panels, columns=2)
    rows = [
        {"system": NAMES[s]}
        | {
            f"{quantity} {low:g} to {high:g} Hz [{unit}]": f"{factor * study[at(s, 'rig')][f'{quantity}_{band}']:.2f}"
            for quantity, (_, unit, factor) in _GAINS.items()
            for band, (low, high) in BANDS.items()
        }
        for s in SYSTEMS
    ]
    yield Table.of("bands", "Gains by band of frequency", rows, "Rms over the band.")


@report.section("Energy")
def _energy(study: Results) -> Content:
    yield """The current only sets the resistance, and the car does the work. Semi-active dampers need the power of
    their coils. Actuators without losses need what they give to the car; none of what they take is counted as
    regained."""
    systems = [s for s in SYSTEMS if s != "passive"]
    bought = {"from outside": [study[at(s)]["power_bought"] for s in systems]}
    panel = bars("system [?]", "power [W]", [NAMES[s] for s in systems], bought)
    yield Figure("energy", "Power from outside", "Random road, mean of all four corners.", [panel])
    rows = [
        {"system": NAMES[s]}
        | {
            f"power given to the car, {words} [W]": f"{study[case]['power_given']:.3g}"
            for words, case in (("with hysteresis", at(s)), ("without", without_hysteresis(s)))
        }
        for s in FAMILIES["semi-active"]
    ]
    caption = "With hysteresis the damper returns a little where the velocity changes its sign."
    yield Table.of("passivity", "Power that dampers give to the car", rows, caption)


@report.section("Force of a damper")
def _force(study: Results) -> Content:
    panels = []
    for system in ("skyhook-on-off", "mpc"):
        shown = study.signals(at(system))
        points = Series(NAMES[system], shown["velocity"], np.array(shown["force"]) / 1e3, mode="markers")
        panels.append(Panel(NAMES[system], "velocity [m/s]", "force [kN]", [points]))
    yield Figure("force", "Force over velocity, front left", "Four seconds of the random road.", panels, columns=2)


@report.section("Steps")
def _refinement(study: Results) -> Content:
    rows = [
        {"steps": steps, **cells(METRICS, row, (COMFORT, ROAD_HOLDING, "power_taken"))}
        for steps, row in with_finer_steps(study, at(REFINED)).items()
    ]
    yield Table.of("refinement", f"Results with finer steps, {NAMES[REFINED]}", rows, "Random road.")
