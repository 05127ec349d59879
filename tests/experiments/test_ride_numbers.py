"""Numbers in the report of ride, from recordings and runs made by hand whose answers are known.

Also how its searches find speeds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import made_up
import numpy as np
import pytest
from altered import altered, failed

from cosim.experiments.ride import EXPERIMENT, published
from cosim.experiments.ride.claims import CLAIMS
from cosim.experiments.ride.published import HEIGHTS, POWERS, plan, systems
from cosim.experiments.ride.report import report
from cosim.experiments.ride.results import CAR_NAMES, Driven, Speeds, name
from cosim.experiments.ride.runs import CARS, METRICS, Case, measure, passive, recorded, remarks
from cosim.experiments.ride.search import EXPONENT, LONGEST, STEEP, TOLERANCE, WITHIN, SpeedLimit, crossing, rise
from cosim.experiments.ride.web import live
from cosim.study import FmuSet, Results
from cosim.study.case import CaseError, values
from fmu_sources.models.corners import CORNERS

# ----------------------------------------------------------------------------------------------- a run: metrics by hand

G = 9.80665
SPEED = 9.0  # m/s
AXLES = {"fl": 1.5, "fr": 1.5, "rl": -1.3, "rr": -1.3}
STARTS = {f"road.wheel.{k}.x": x for k, x in AXLES.items()}
T = np.round(np.arange(0.0, 38.0, 1e-3), 6)
X = SPEED * T - 12.0  # of the CG: on the course with all wheels from 1.3 m on, until 303.3 m
ON = (X >= 1.3) & (X <= 303.3)
FREQUENCY = 4.0  # Hz


def analog_power(frequency: float, amplitude: float, third: bool) -> float:
    """Mean absorbed power [W] of a sine [m/s2], from the printed filters."""
    s, feet = 2j * math.pi * frequency, amplitude / 0.3048
    second = 12 * s / (s**2 + 30.02 * s + 901.3)
    gain = 14.5 * s * (s + 44) / ((s + 63) * (s**2 + 24 * s + 750)) if third else second
    return abs(gain * feet) ** 2 / 2


def recording(case: Case, **changes: Any) -> made_up.MadeUpRun:
    """A seat in a sine of 2 m/s2 with one sample of 30 m/s2 before and behind the course, and other signals by hand."""
    az = 2.0 * np.sin(2 * np.pi * FREQUENCY * T)
    az[-2], body = 30.0, np.where(ON, 1.5, 40.0)
    first = np.arange(len(T)) < len(T) // 2
    signals: dict[str, Any] = {"speed.x": X, "car.x": X, "car.seat.az": az, "car.body.az": body}
    for i, k in enumerate(CORNERS, start=1):
        signals[f"car.suspension.{k}.deflection"] = np.where(ON, 0.01 * i * np.where(first, 1, -1), 9.0)
        signals[f"car.suspension.{k}.velocity"] = np.where(ON, 0.1 * np.where(first, 1, -1), 9.0)
        signals[f"controller.force.{k}"] = np.where(ON, 100.0 * i, 9e9)
        signals[f"actuator_{k}.force"] = np.where(ON, 200.0 * i, 9e9)
        signals[f"actuator_{k}.power"] = np.where(ON, 1000.0 * i, 9e9)
    signals |= changes
    return made_up.run(case, T, {n: s for n, s in signals.items() if n in recorded(case) or n in changes}, STARTS)


def sedan(controller: str = "comfort-preview", **fields: Any) -> Case:
    return Case("sedan", controller, "ideal", speed_kmh=3.6 * SPEED, **fields)


def test_metrics_of_a_run() -> None:
    found = measure(recording(sedan()))
    half = first_half()
    assert found.pop("arrived") is True
    assert found.pop("absorbed_power_nrmm") == pytest.approx(analog_power(FREQUENCY, 2.0, third=True), rel=5e-3)
    assert found.pop("absorbed_power") == pytest.approx(analog_power(FREQUENCY, 2.0, third=False), rel=5e-3)
    assert found.pop("iso2631_rms") == pytest.approx(2.0 / math.sqrt(2) * 0.967, rel=0.01)  # Wk at 4 Hz
    assert found.pop("seat_rms") == pytest.approx(math.sqrt(2.0), rel=2e-3)
    assert found.pop("seat_peak") == pytest.approx(2.0, rel=1e-4)  # a sample is not quite at the top
    assert found == pytest.approx(
        {
            "speed": SPEED,
            "body_rms": 1.5,
            "travel_rms": 0.01 * math.sqrt(30 / 4),
            "travel_peak": 0.04,
            "force_rms": 100.0 * math.sqrt(30 / 4),
            "power_given": 0.1 * 1000.0 * half,
        },
        rel=1e-6,
    )


def first_half() -> float:
    """Part of the course in which the actuators give power."""
    return float(np.mean(np.arange(len(T))[ON] < len(T) // 2))


def test_hydraulic_actuators_give_their_own_force_and_take_power() -> None:
    found = measure(recording(Case("hmmwv", "lqr", "hydraulic", speed_kmh=3.6 * SPEED)))
    assert found["force_rms"] == pytest.approx(200.0 * math.sqrt(30 / 4))
    assert found["power_given"] == pytest.approx(0.1 * 2000.0 * first_half())
    assert found["power_supply"] == pytest.approx(10000.0)


def test_cars_without_actuators_have_no_forces() -> None:
    for case in (sedan("passive"), Case("hmmwv", "zero", "ideal", speed_kmh=3.6 * SPEED)):
        assert not {"force_rms", "power_given", "power_supply"} & measure(recording(case)).keys()


def test_an_obstacle_counts_from_before_it_until_a_second_behind_it() -> None:
    """The half-round is at 30 m: CG from 30 - 1.5 - 3 m to 30 + 1.3 + 9 + 1 m."""
    case = sedan(course="half-round")
    for x, counts in ((25.49, False), (25.51, True), (41.29, True), (41.31, False)):
        az = np.zeros(len(T))
        az[np.argmin(np.abs(X - x))] = -17.0
        assert measure(recording(case, **{"car.seat.az": az}))["seat_peak"] == (17.0 if counts else 0.0), x


def test_a_car_that_does_not_arrive_has_no_metrics() -> None:
    case = Case("full-car", "passive", speed_kmh=3.6 * SPEED)
    stuck = recording(case, **{"car.x": np.minimum(X, 200.0)})
    assert measure(stuck) == {"arrived": False, "speed": pytest.approx(SPEED * 212 / (SPEED * T[-1]), rel=1e-3)}
    assert remarks(stuck) == ["the car did not come to the end of the course"]
    assert remarks(recording(case)) == []
    (told,) = remarks(recording(case, **{"car.suspension.fl.deflection": np.where(ON, 0.61, 0.0)}))
    assert "by up to 610 mm" in told
    assert EXPERIMENT.measures.failed(case, ValueError("broke")) == {"arrived": False, "reason": "broke"}


def test_how_metrics_are_shown() -> None:
    row = dict.fromkeys(METRICS, 1234.5)
    assert {m.heading: m.shown(row[k]) for k, m in METRICS.items()} == {
        "absorbed power, third order [W]": "1234.50",
        "absorbed power, second order [W]": "1234.50",
        "ISO 2631-1 weighted rms [m/s2]": "1234.500",
        "largest acceleration of the seat [g]": f"{1234.5 / G:.2f}",
        "rms acceleration of the seat [m/s2]": "1234.500",
        "rms acceleration of the CG [m/s2]": "1234.500",
        "suspension travel, rms [mm]": "1234500.0",
        "suspension travel, largest [mm]": "1234500",
        "actuator force, rms [kN]": "1.23",
        "power that actuators give to the car [kW]": "1.23",
        "power drawn from the hydraulic supply [kW]": "1.23",
    }


def test_cases_that_cannot_be(raises) -> None:
    for fields in (
        {"car": "sedan", "controller": "mpc"},
        {"car": "hmmwv", "controller": "passive"},
        {"car": "sedan", "actuators": "hydraulic"},
        {"course": "half-round", "seed": 2},
        {"course": "1in", "height": 0.1},
        {"course": "3in"},
    ):
        with raises(CaseError):
            Case(**fields)
    assert passive(Case("hmmwv", "mpc", "ideal")) == Case("hmmwv", "passive", "hydraulic")
    assert passive(Case("6x6", "mpc", seed=3)) == Case("6x6", "passive", seed=3)


# ------------------------------------------------------------------------------------------------------------ searches


class Counted:
    """A function of the speed that counts how often it is asked."""

    def __init__(self, function: Callable[[float], float]) -> None:
        self.function, self.speeds = function, []  # type: ignore[var-annotated]

    def __call__(self, v: float) -> float:
        self.speeds.append(v)
        return self.function(v)


@pytest.mark.parametrize("exponent", [1.2, 2.5, 6.0])
@pytest.mark.parametrize("guess", [4.0, 16.0, 22.0, 90.0, 500.0])
def test_a_crossing_is_found_from_any_guess(exponent: float, guess: float) -> None:
    power = Counted(lambda v: 6.0 * (v / 21.7) ** exponent)
    found, why = crossing(power, 6.0, guess)
    assert why == "found"
    assert found == pytest.approx(21.7, rel=TOLERANCE)
    assert len(power.speeds) == len(set(power.speeds)) <= 9  # nothing is run twice, and never many


@pytest.mark.parametrize("edge", [5.2, 33.3, 110.0])
def test_runs_that_fail_count_as_above_the_limit(edge: float) -> None:
    """No straight line leads there: halved until it is close."""
    found, why = crossing(lambda v: 1.0 if v < edge else math.inf, 6.0, 20.0)
    assert why == "found"
    assert found == pytest.approx(edge, rel=TOLERANCE)


def test_what_is_known_is_not_asked_for_again_but_used() -> None:
    """Two runs on both sides, and the exponent that they tell.

    One more meets the limit, and one on its other side ends the search.
    """
    power = Counted(lambda v: 6.0 * (v / 21.7) ** 3)
    crossing(power, 6.0, 21.0, known=[20.0, 24.0])
    assert power.speeds[:2] == [20.0, 24.0]
    assert len(power.speeds) <= 4
    far = Counted(lambda v: 6.0 * (v / 21.7) ** 4)
    assert crossing(far, 6.0, 16.0, exponent=4.0)[0] == pytest.approx(21.7, rel=TOLERANCE)
    assert len(far.speeds) == 3
    alone = Counted(lambda v: 6.0 * (v / 21.7) ** 4)
    assert crossing(alone, 6.0, 99.0, known=[21.69])[0] == pytest.approx(21.7, rel=TOLERANCE)
    assert len(alone.speeds) == 2


@pytest.mark.parametrize("guess", [12.0, 19.0, 25.0, 33.0])
def test_a_flat_curve_is_crossed_where_it_crosses(guess: float) -> None:
    """Within 2 % of the limit from 20 to 29 km/h, which is reached at 25: the value says nothing of the speed there."""
    flat = Counted(lambda v: 6.0 * (v / 25.0) ** 0.1 if 18 < v < 31 else 6.0 * (v / 25.0) ** 3)
    found, why = crossing(flat, 6.0, guess)
    assert why == "found"
    assert found == pytest.approx(25.0, rel=TOLERANCE)
    below, above = (max(v for v in flat.speeds if v < 25.0), min(v for v in flat.speeds if v >= 25.0))
    assert above / below <= 1 + TOLERANCE
    assert len(flat.speeds) <= 9


def test_of_several_speeds_the_one_next_to_the_guess_is_found() -> None:
    """Above the limit from 10 to 20 km/h, below it to 40 km/h, above it from there on."""
    waves = Counted(lambda v: 8.0 if 10 < v < 20 or v > 40 else 5.0)
    for guess, expected in ((11.0, 10.0), (36.0, 40.0)):
        found, _ = crossing(waves, 6.0, guess)
        assert found == pytest.approx(expected, rel=TOLERANCE)
    found, _ = crossing(waves, 6.0, 38.0, known=[8.0, 12.0, 30.0, 50.0])
    assert found == pytest.approx(40.0, rel=TOLERANCE)
    steps = Counted(lambda v: 5.0 if v < 15 or 22 < v < 30 else 8.0)
    found, _ = crossing(steps, 6.0, 22.0, known=[10.0, 20.0, 24.0, 40.0])  # 14 and 31 are the middles
    assert found == pytest.approx(30.0, rel=TOLERANCE)


def test_a_value_that_almost_gets_there_is_not_followed_in_small_steps() -> None:
    almost = Counted(lambda v: 5.8 * (1 - 0.1 / v))
    assert crossing(almost, 6.0, 10.0) == (None, "never")
    assert len(almost.speeds) <= 11  # in steps of 2 % it would be 126


def test_the_exponent_is_that_of_the_runs_next_to_the_limit() -> None:
    assert rise({10.0: 1.0, 20.0: 4.0, 30.0: 13.5}, 6.0) == pytest.approx(math.log(13.5 / 4) / math.log(1.5))
    assert rise({10.0: 5.9, 10.1: 8.0}, 6.0) == STEEP[1]
    assert rise({10.0: 5.0, 12.0: 4.9}, 6.0) == STEEP[0]
    assert rise({10.0: 5.0, 12.0: math.inf, 13.0: 0.0}, 6.0, 3.3) == 3.3
    assert rise({}, 6.0) == EXPONENT


def test_limits_that_are_never_or_always_reached(raises) -> None:
    low, high = WITHIN
    never, always = Counted(lambda _: 1.0), Counted(lambda _: 9.0)
    assert crossing(never, 6.0, 30.0) == (None, "never")
    assert crossing(always, 6.0, 30.0) == (None, "always")
    assert max(never.speeds) == high
    assert min(always.speeds) == low
    assert never.speeds[1] == pytest.approx(30.0 * LONGEST)
    with raises(ValueError):
        crossing(lambda _: math.nan, 6.0, 30.0)


class FakeRunner:
    """Power that rises with the square of the speed, from 6 W at a speed for each seed.

    The seat sees 1 m/s2 per km/h.
    """

    at = {1: 20.0, 2: 22.0, 3: 19.0}  # noqa: RUF012

    def __init__(self) -> None:
        self.cases: list[Case] = []

    def metrics(self, case: Case) -> dict[str, Any]:
        self.cases.append(case)
        if case.speed_kmh > 60:
            return {"arrived": False, "reason": "diverged"}
        third = 6.0 * (case.speed_kmh / self.at[case.seed]) ** 2
        return {
            "arrived": True,
            "absorbed_power_nrmm": third,
            "absorbed_power": third / 1.2,
            "seat_peak": case.speed_kmh,
        }


def test_a_search_goes_from_seed_to_seed_and_from_one_definition_to_the_other() -> None:
    runner = FakeRunner()
    case = sedan("passive")
    found = SpeedLimit(case, POWERS, 3, 50.0)(runner)
    assert found["why"] == {m: ["found"] * 3 for m in POWERS}
    for metric, factor in zip(POWERS, (1.0, math.sqrt(1.2)), strict=True):
        assert found["speeds"][metric] == pytest.approx([20.0 * factor, 22.0 * factor, 19.0 * factor], rel=TOLERANCE)
    assert len(runner.cases) == len(set(runner.cases)) == len(found["runs"]) <= 17  # no run twice
    assert [(r["seed"], r["speed_kmh"]) for r in found["runs"]] == sorted((c.seed, c.speed_kmh) for c in runner.cases)
    assert found["runs"][0].items() >= values(min(runner.cases, key=lambda c: (c.seed, c.speed_kmh))).items()


def test_a_search_for_an_obstacle_has_one_seed_and_passes_failed_runs() -> None:
    found = SpeedLimit(sedan("passive", course="half-round"), ("seat_peak",), 1, 70.0)(FakeRunner())
    assert found["speeds"]["seat_peak"] == [pytest.approx(2.5 * G, rel=TOLERANCE)]
    assert [r["arrived"] for r in found["runs"]][-1] is False


# ------------------------------------------------------------------------------------------------------------ the plan


def test_every_car_under_every_law_that_fits_it() -> None:
    assert len(systems()) == len(set(systems())) == 37
    assert {s[:2] for s in systems()} == {(c, law) for c, car in CARS.items() for law in car.controllers}
    assert [s for s in systems("hmmwv") if s[1] in ("passive", "mpc")] == [
        ("hmmwv", "passive", "hydraulic"),
        ("hmmwv", "mpc", "hydraulic"),
        ("hmmwv", "mpc", "ideal"),
    ]
    searches = plan(seeds=2)
    assert len(searches) == len(set(searches)) == 37 * (3 + 1 + len(HEIGHTS))
    for search in searches:
        rougher = search.case.course in ("2in", "4in")
        several = (search.case.course == "1in" and search.case.sides == "alike") or (
            rougher and "mpc" not in search.case.controller
        )
        assert search.seeds == (2 if several else 1), search.label
    assert {s.label for s in plan(car="6x6")} >= {"6W-6x6-mpc-1in-1kmh", "2.5g-6x6-mpc-half-round-1kmh-101.6mm"}
    with pytest.raises(CaseError, match="trabant"):
        plan(car="trabant")


def test_guesses_are_where_a_search_may_go() -> None:
    for search in plan():
        assert WITHIN[0] <= search.guess <= WITHIN[1]
        assert search.cost > 0


# --------------------------------------------------------------------------------------- a study: every cell by hand


def speed_of(search: SpeedLimit, metric: str, seed: int) -> float | None:
    """Speeds by hand, no two alike.

    Slower on rougher courses and higher obstacles, faster with preview and by the second order.
    """
    c = search.case
    order = list(CARS).index(c.car)
    base = (
        10.0
        + 3 * order
        + list(CARS[c.car].controllers).index(c.controller) * 0.5
        + (0.2 if c.actuators == "hydraulic" else 0.0)
    )
    if (c.car, c.controller) == ("sedan", "comfort-preview"):
        return None
    if c.course == "half-round":
        return base * 0.2 / c.height
    base /= {"1in": 1, "2in": 2, "4in": 4}[c.course]
    return (
        base
        * (1.1 if metric == "absorbed_power" else 1.0)
        * (1 + 0.01 * (seed - 2))
        * (0.9 if c.sides == "apart" else 1.0)
    )


def found_by_hand(search: SpeedLimit) -> dict[str, Any]:
    rows = []
    found: dict[str, list[float | None]] = {m: [] for m in search.metrics}
    for seed in range(1, search.seeds + 1):
        for metric in search.metrics:
            v = speed_of(search, metric, seed)
            found[metric].append(v)
        own = found[search.metrics[0]][-1] or 100.0
        for share, times in (
            (0.5, 0.25),
            (0.985, 0.97),
            (1.0, 1.0),
            (1.0835, 0.97 * 1.21),
            (1.1, 1.21),
        ):  # each limit between two runs
            power = 6.0 * times if found[search.metrics[0]][-1] else 1.0 * times
            case = replace(
                search.case,
                speed_kmh=own * share,
                **({"seed": seed} if search.case.course in ("1in", "2in", "4in") else {}),
            )
            metrics = {
                "arrived": True,
                "absorbed_power_nrmm": power,
                "absorbed_power": power / 1.21,
                "seat_peak": 2.5 * G * times,
                "iso2631_rms": share,
                "travel_rms": 0.01 * share,
                "travel_peak": 0.1 * share,
                "power_given": 2e3 * share,
            }
            forces = {} if case.controller == "passive" else {"force_rms": 1e3 * share}
            rows.append({**values(case), **metrics, **forces})
    why = {m: ["found" if v is not None else "never" for v in found[m]] for m in search.metrics}
    return {"speeds": found, "why": why, "runs": rows}


@pytest.fixture(scope="module")
def study() -> Results:
    return made_up.study(EXPERIMENT, lambda _: {}, found=found_by_hand)


def six_watt_rows(page: Any) -> dict[tuple[str, str, str], dict[str, Any]]:
    tables = {car: f"six-watts-{car}" for car in CARS}
    there = {t.id for s in page.sections for t in s.tables}
    return {
        (CAR_NAMES[car], r["course"], r["system"]): r
        for car, table in tables.items()
        if table in there
        for r in made_up.table(page, table)
    }


def test_speeds_of_six_watts(page: Any) -> None:
    rows = six_watt_rows(page)
    assert len(rows) == 37 * 3
    row = rows["HMMWV (001)", "2in", "MPC, hydraulic"]  # base 10 + 5 x 0.5 + 0.2, over 2, first seed
    assert row["6 W, third order [km/h]"] == "6.3"
    assert row["6 W, second order [km/h]"] == "6.9"
    assert [
        row[m.heading]
        for k, m in METRICS.items()
        if k in ("iso2631_rms", "travel_rms", "travel_peak", "force_rms", "power_given")
    ] == [1.0, 10.0, 100.0, 1.0, 2.0]
    assert "power drawn from the hydraulic supply [kW]" not in row  # nothing of it in these runs
    assert rows["6x6 (003)", "1in", "passive"]["actuator force, rms [kN]"] is None  # of its laws it has one
    assert rows["sedan (004)", "1in", "preview LQ comfort"]["6 W, third order [km/h]"] == "never"
    assert rows["HMMWV (001)", "1in", "no actuators"]["6 W, third order [km/h]"] == "10.5 (10.4 to 10.6)"


def test_parameters_are_those_of_the_fmus(page: Any) -> None:
    found = {p.name: (p.value, p.unit) for p in page.parameters}
    assert found["limit of absorbed power"] == (6.0, "W")
    assert found["closeness of speeds"] == (0.02, "1")
    seats = {n: v for n, v in found.items() if " seat." in n}
    assert {n.split()[0] for n in seats} == {car.plant for car in CARS.values()}
    assert all(unit == "m" and -3 < float(value) < 3 for value, unit in seats.values()), seats
    assert found["RideCarHmmwv wheel radius"] == (CARS["hmmwv"].radius, "m")


def test_curves_over_roughness_have_bands_of_the_seeds(page: Any) -> None:
    curve = made_up.series(page, "map-full-car", "over courses", "GPC explicit")
    assert curve.x_values == pytest.approx([24.62, 44.30, 83.83], abs=0.01)
    assert np.asarray(curve.y) == pytest.approx([20.0, 10.0, 5.0])
    assert np.asarray(curve.low) == pytest.approx([19.8, 9.9, 4.95])
    assert np.asarray(curve.high) == pytest.approx([20.2, 10.1, 5.05])
    alone = made_up.series(page, "map-6x6", "over courses", "MPC")  # base 17, one seed on the rougher courses
    assert np.asarray(alone.low) == pytest.approx([17 * 0.99, 8.5 * 0.99, 4.25 * 0.99])
    assert np.asarray(alone.high) == pytest.approx([17 * 1.01, 8.5 * 0.99, 4.25 * 0.99])
    with pytest.raises(StopIteration):
        made_up.series(page, "map-sedan", "over courses", "preview LQ comfort")  # it never reaches 6 W


def test_curves_of_power_over_speed(page: Any) -> None:
    curve = made_up.series(page, "power-6x6", "4in rms", "LQR")  # base 16.5, over 4, first seed
    own = 16.5 / 4 * 0.99
    assert curve.x_values == pytest.approx([share * own for share in (0.5, 0.985, 1.0, 1.0835, 1.1)])
    assert np.asarray(curve.y) == pytest.approx([1.5, 5.82, 6.0, 5.82 * 1.21, 7.26])
    limit = made_up.series(page, "power-6x6", "4in rms", "6 W")
    assert np.asarray(limit.y).tolist() == [6.0, 6.0]
    assert limit.x_values == pytest.approx(
        [0.5 * 16.0 / 4 * 0.99, 1.1 * 17.5 / 4 * 0.99]
    )  # from the slowest run to the fastest


def test_obstacles(page: Any) -> None:
    rows = {(r["car"], r["system"]): r for r in made_up.table(page, "obstacles")}
    assert rows["6x6 (003)", "LQR"] == {
        "car": "6x6 (003)",
        "system": "LQR",
        **{f"{h * 1e3:.0f} mm [km/h]": f"{16.5 * 0.2 / h:.1f}" for h in HEIGHTS},
    }
    assert rows["sedan (004)", "preview LQ comfort"]["102 mm [km/h]"] == "never"
    curve = made_up.series(page, "map-hmmwv", "over half-rounds", "skyhook, hydraulic")
    assert curve.x_values == pytest.approx([101.6, 152.4, 203.2, 254.0, 304.8])
    assert np.asarray(curve.y) == pytest.approx([11.2 * 0.2 / h for h in HEIGHTS])


def test_definitions_and_sides(page: Any) -> None:
    rows = {(r["car"], r["system"], r["course"]): r for r in made_up.table(page, "definitions")}
    row = rows["6x6 (003)", "LQR", "1in"]
    assert (row["third order [km/h]"], row["second order [km/h]"], row["third over second [-]"]) == pytest.approx(
        (16.5, 18.15, 0.909), abs=0.051
    )
    assert row["third over second [-]"] == 0.909
    assert ("sedan (004)", "preview LQ comfort", "1in") not in rows
    sides = {(r["car"], r["system"]): r for r in made_up.table(page, "sides")}
    row = sides["6x6 (003)", "LQR"]
    assert (row["alike [km/h]"], row["correlated [km/h]"]) == pytest.approx((16.5 * 0.99, 16.5 * 0.99 * 0.9))
    assert row["change [%]"] == -10.0
    assert sides["sedan (004)", "preview LQ comfort"]["change [%]"] is None


def test_of_a_speed_that_one_side_has_alone_there_is_no_change(study: Results, fmus: FmuSet) -> None:
    search = first(study, "6x6", "lqr", "1in")
    assert search.case.sides == "alike"
    speeds_of = study.found(search)["speeds"]
    page = report(altered(study, {search: {"speeds": {**speeds_of, "absorbed_power_nrmm": [None, 16.0, 16.0]}}}), fmus)
    row = next(r for r in made_up.table(page, "sides") if (r["car"], r["system"]) == ("6x6 (003)", "LQR"))
    assert (row["alike [km/h]"], row["change [%]"]) == (None, None)
    assert row["correlated [km/h]"] == pytest.approx(16.5 * 0.99 * 0.9)


def test_main_result(page: Any) -> None:
    """Of each car as it is and with the controller with which it is fastest."""
    (panel,) = page.figure.panels
    pair = ["dash", "solid"]
    assert [s.dash for s in panel.series] == [*pair * 4, "dash", *pair]  # the public car has one law
    curve = made_up.series(page, "main-result", "", "6x6 (003), MPC with preview")
    assert curve.x_values == pytest.approx([24.62, 44.30, 83.83], abs=0.01)
    assert np.asarray(curve.y) == pytest.approx([17.5, 8.6625, 4.33125])


def test_main_result_takes_the_fastest_of_the_laws(study: Results, fmus: FmuSet) -> None:
    search = first(study, "6x6", "lqr", "1in")
    own = study.found(search)["speeds"]
    faster = altered(study, {search: {"speeds": {**own, "absorbed_power_nrmm": [41.0] * search.seeds}}})
    page = report(faster, fmus)
    assert "6x6 (003) 16.0 km/h (passive) and 41.0 km/h (LQR);" in page.lead
    assert "6x6 (003), LQR" in [s.name for s in page.figure.panels[0].series]  # type: ignore[union-attr]


def judged(study: Results) -> dict[str, tuple[bool, str]]:
    return {c.id: (c.verdict == "holds", c.result) for c in CLAIMS.judge(study)}


def test_checks_hold(study: Results) -> None:
    found = judged(study)
    assert all(ok for ok, _ in found.values()), found
    total = sum(len(s.metrics) * s.seeds for s in study.tasks if s.case.controller != "comfort-preview")  # type: ignore[union-attr]
    assert found["search"][1] == f"{total} of {total} speeds"
    assert found["definitions"][1] == "0.91 to 0.91 of it"
    assert found["rougher-is-slower"][1] == found["higher-is-slower"][1] == "37 of 37"
    assert found["preview-is-faster"][1] == "1.04 to 1.04 times as fast"


def first(study: Results, car: str, controller: str, course: str) -> SpeedLimit:
    return next(
        s
        for s in study.tasks
        if isinstance(s, SpeedLimit) and (s.case.car, s.case.controller, s.case.course) == (car, controller, course)
    )


@pytest.mark.parametrize(
    ("check", "where", "change"),
    [
        ("rougher-is-slower", ("6x6", "lqr", "2in"), 3.0),
        ("higher-is-slower", ("6x6", "lqr", "half-round"), 0.1),
        ("definitions", ("6x6", "lqr", "1in"), 1.5),
        ("preview-is-faster", ("hmmwv", "mpc-preview", "1in"), 0.5),
        ("search", ("6x6", "lqr", "1in"), 1.3),
    ],
)
def test_checks_fail_when_they_should(study: Results, check: str, where: tuple[str, str, str], change: float) -> None:
    search = first(study, *where)
    metric = search.metrics[0]
    found = study.found(search)
    changed = {**found["speeds"], metric: [change * v for v in found["speeds"][metric]]}
    assert not judged(altered(study, {search: {"speeds": changed}}))[check][0]
    assert judged(study)[check][0]


def test_a_speed_has_runs_on_both_sides(study: Results) -> None:
    search = first(study, "6x6", "lqr", "half-round")
    speed, limit = study.found(search)["speeds"]["seat_peak"][0], 2.5 * G
    case = values(search.case) | {"seed": 1}

    def holds(*rows: dict[str, Any]) -> bool:
        return judged(altered(study, {search: {"runs": [{**case, **r} for r in rows]}}))["search"][0]

    below = {"arrived": True, "speed_kmh": 0.99 * speed, "seat_peak": 0.9 * limit}
    above = {"arrived": False, "speed_kmh": 1.01 * speed}  # one that failed is above
    assert holds(below, above)
    assert not holds(below)
    assert not holds(above)
    assert not holds(below, {**above, "speed_kmh": 1.03 * speed})
    assert not holds({**below, "seat_peak": 0.99 * limit})  # which may be far from it on a flat curve
    assert holds(below, {**below, "seat_peak": limit})
    claim = next(c for c in CLAIMS.judge(study) if c.id == "search")
    assert claim.published == "runs on both sides within 2 % of the speed"


def test_a_rise_is_no_fall_however_small(study: Results) -> None:
    """One that searches cannot tell is not counted as a fall either; the reason says how small it is."""
    slow, fast = first(study, "6x6", "lqr", "1in"), first(study, "6x6", "lqr", "2in")
    own = study.found(fast)["speeds"]
    for factor, holds in ((0.99, True), (1.0, False), (1.015, False), (1.04, False)):
        median = Driven(slow, study).speeds("absorbed_power_nrmm").median
        assert median is not None
        rougher = {**own, "absorbed_power_nrmm": [factor * median] * fast.seeds}
        changed = altered(study, {fast: {"speeds": rougher}})
        assert judged(changed)["rougher-is-slower"][0] is holds
        reason = next(c for c in CLAIMS.judge(changed) if c.id == "rougher-is-slower").reason
        assert ("it rises by 1.5 %, no more than searches can differ" in reason) == (factor == 1.015)
        both = {"absorbed_power": [10.0] * slow.seeds, "absorbed_power_nrmm": [factor * 10.0] * slow.seeds}
        assert judged(altered(study, {slow: {"speeds": both}}))["definitions"][0] is holds


def test_a_passive_car_with_its_pump_off_has_a_reason_of_its_own(study: Results) -> None:
    search = first(study, "hmmwv", "passive", "2in")
    changed = {**study.found(search)["speeds"], "absorbed_power_nrmm": [30.0] * search.seeds}
    claim = next(c for c in CLAIMS.judge(altered(study, {search: {"speeds": changed}})) if c.id == "rougher-is-slower")
    assert claim.reason.startswith("not of HMMWV (001), passive, hydraulic: with its pump off")


def test_a_study_of_one_car_is_not_judged(fmus: FmuSet) -> None:
    alone = made_up.study(EXPERIMENT, lambda _: {}, found=found_by_hand, car="6x6")
    page = report(alone, fmus)
    assert not page.claims
    assert {car for car, _, _ in six_watt_rows(page)} == {"6x6 (003)"}
    assert not judged(alone)["preview-is-faster"][0]


def test_a_failed_search_leaves_its_row_out(study: Results, fmus: FmuSet) -> None:
    search = first(study, "6x6", "lqr", "1in")
    page = report(failed(study, search), fmus)
    rows = six_watt_rows(page)
    assert ("6x6 (003)", "1in", "LQR") not in rows
    assert ("6x6 (003)", "2in", "LQR") in rows
    assert made_up.series(page, "map-6x6", "over courses", "LQR").x_values == pytest.approx([44.30, 83.83], abs=0.01)


def test_speeds_in_words() -> None:
    assert Speeds((10.0, 12.0, 11.0), ("found",) * 3).words == "11.0 (10.0 to 12.0)"
    assert Speeds((10.0,), ("found",)).words == "10.0"
    assert Speeds((), ("always",)).words == "at any speed"
    assert Speeds((10.0,), ("found", "never", "never")).median is None
    assert Speeds((10.0, 12.0), ("found", "never", "found")).words == "11.0 (10.0 to 12.0; 1 never)"
    assert Speeds((10.0, 11.0), ("found", "never", "found")).median == 10.5
    assert Speeds((10.0,), ("found", "never", "never")).words == "never"
    assert name(("hmmwv", "zero", "hydraulic")) == "zero force, hydraulic"
    assert name(("sedan", "road-holding-delay", "ideal")) == "LQ road holding, rear wheels preview"
    assert name(("sedan", "road-holding-preview", "ideal")) == "preview LQ road holding"


def test_the_run_nearest_to_the_limit(study: Results) -> None:
    search = first(study, "6x6", "lqr", "1in")
    driven = Driven(search, study)
    found = driven.nearest("absorbed_power_nrmm")
    assert found is not None
    assert found["absorbed_power_nrmm"] == 6.0
    assert [r["seed"] for r in driven.runs()] == [1] * 5
    rows = study.found(search)["runs"]
    some = altered(study, {search: {"runs": [{**r, "arrived": r["speed_kmh"] < 17} for r in rows]}})
    assert [r["speed_kmh"] for r in Driven(search, some).runs()] == pytest.approx(
        [share * 16.5 * 0.99 for share in (0.5, 0.985, 1.0)]
    )
    assert driven.speeds("absorbed_power").median == pytest.approx(16.5 * 1.1)
    assert published.SEEDS_RUN == 3


# -------------------------------------------------------------------------------------------------------- the live page

GROUPS = ["1 in rms", "2 in rms", "4 in rms", "half-round"]
LIVE = {
    "hmmwv": ["passive, hydraulic", "LQR", "MPC", "MPC with preview"],
    "hmmwv-dampers": ["passive", "skyhook", "SH-ADD", "MPC"],
    "sedan": ["passive", "LQ comfort", "LQ comfort, rear wheels preview", "preview LQ comfort"],
    "6x6": ["passive", "LQR", "MPC", "MPC with preview"],
    "full-car": ["passive", "GPC implicit", "GPC explicit", "GPC with preview"],
    "public": ["passive"],
}


@pytest.mark.parametrize("car", CARS)
def test_systems_of_the_live_page(car: str) -> None:
    """A car under its laws, on every course of the project."""
    law = "comfort-preview" if car == "sedan" else list(CARS[car].controllers)[-1]  # of the laws that are shown
    shown = live(Case(car, law, speed_kmh=30.0))
    assert [(c.title, c.group) for c in shown.cases] == [(t, g) for g in GROUPS for t in LIVE[car]]
    assert [c.case.course for c in shown.cases] == [c for c in ("1in", "2in", "4in", "half-round") for _ in LIVE[car]]
    assert {(c.case.car, c.case.speed_kmh) for c in shown.cases} == {(car, 30.0)}
    assert {c.case.actuators for c in shown.cases if c.case.controller != "passive"} <= {"ideal"}
    assert shown.page.text.lower().startswith(f"{CAR_NAMES[car].lower()}: ")
    assert shown.page.text[0].isupper() or car == "6x6"
    assert ("without a controller" if car == "public" else "its controllers side by side") in shown.page.text
    first = CARS[car].corners[0]
    assert (
        shown.page.plots
        == ["car.seat.az", f"car.suspension.{first}.deflection", f"controller.force.{first}"][: 2 + (car != "public")]
    )


def test_what_the_case_says_holds_for_the_page() -> None:
    """A law that is not among those that are shown comes beside them.

    What is of one kind of course counts on that one.
    """
    shown = live(Case("hmmwv", "skyhook", "hydraulic", "2in", seed=3, sides="apart"))
    assert [c.title for c in shown.cases[:5]] == [
        f"{n}, hydraulic" for n in ("passive", "LQR", "MPC", "MPC with preview", "skyhook")
    ]
    assert {(c.case.course, c.case.seed, c.case.sides) for c in shown.cases} == {
        ("1in", 3, "apart"),
        ("2in", 3, "apart"),
        ("4in", 3, "apart"),
        ("half-round", 1, "alike"),
    }
    heights = {c.case.course: c.case.height for c in live(Case(course="half-round", height=0.1)).cases}
    assert heights == {"1in": 0.2032, "2in": 0.2032, "4in": 0.2032, "half-round": 0.1}


def test_a_measured_course_in_the_live_page() -> None:
    shown = live(Case("hmmwv", "mpc", course="measured.crg"))
    assert [(c.title, c.group, c.case.course) for c in shown.cases] == [(t, "", "measured.crg") for t in LIVE["hmmwv"]]
    assert [c.label for c in shown.page.controls] == ["speed"]
    assert "over the measured course of a file" in shown.page.text


def test_words(page: Any, sentence) -> None:
    sentence(made_up.words(page))


def test_the_live_page(sentence) -> None:
    sentence(made_up.live_words(live(Case())))
