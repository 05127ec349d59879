"""Solvers of the MPC's quadratic programs: time per step, residual, and error of the command.

The command is compared with that of an independent solver.

The programs are those of published runs: a controller's inputs are recorded from a co-simulation and fed to its Python
evaluation, which gives the data of each step. The C code that is timed is that of the FMUs. Each run is repeated and
each step counts with its fastest repetition, so that other work on the machine does not show.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from build_fmus.component import Component
from build_fmus.qp import Osqp
from build_fmus.qp_solve import CompiledPrograms
from build_fmus.reference import Evaluator
from cosim import Record, Recording
from cosim.experiments import three_axle, trench
from cosim.experiments.bench import EXPERIMENT as BENCH
from cosim.experiments.bench.published import SCENARIOS, at
from cosim.experiments.hmmwv import EXPERIMENT as HMMWV
from cosim.experiments.hmmwv.runs import ROADS as HMMWV_ROADS
from cosim.experiments.hmmwv.runs import Case as HmmwvCase
from cosim.experiments.hmmwv.runs import stop_time
from cosim.experiments.hmmwv.wiring import BUMPS, bump_parameters
from cosim.experiments.three_axle.published import PLACES
from cosim.experiments.three_axle.runs import Case as ThreeAxleCase
from cosim.experiments.trench.published import matrix
from cosim.experiments.trench.runs import MPC as TRENCH_MPC
from cosim.study import FmuSet, Runner
from fmu_sources.catalog import Context, default_catalog
from fmu_sources.controllers.mpc import bench, hmmwv
from fmu_sources.controllers.mpc.qp import CondensedQp
from fmu_sources.controllers.mpc.settings import Mpc
from fmu_sources.controllers.mpc.three_axle import combined_gains, ride_model, three_axle_mpc
from fmu_sources.models.hmmwv_states import FORCE_LIMIT
from fmu_sources.plants import quarter_car, ride_car
from fmu_sources.vehicles import load_quarter_car, load_ride_car, load_three_axle
from tests.oracles.qp import solve_reference

BACKENDS = ("osqp", "daqp")
REPETITIONS = 3
HIGHER = (2.0, 4.0)  # times the published bumps
STEP_SIZES = (0.1, 0.3, 1.0)


@dataclass(frozen=True)
class Problems:
    """Data of all steps of some runs (steps, n_data) of one controller, run by run."""

    make: Callable[[], Component]
    mpc: Mpc
    runs: list[np.ndarray]
    limit: float  # command that errors are related to


def make(name: str) -> Component:
    """A component of the catalog."""
    return default_catalog()[name].make(Context(FmuSet().directory, FmuSet().directory / ".cache"))


def problems(
    name: str,
    mpc: Mpc,
    recordings: list[tuple[Recording, dict[str, float]]],
    limit: float,
    parameters: dict[str, float] | None = None,
) -> Problems:
    """Programs of recorded runs.

    Each input is looked up under its own name, or has the value given beside the recording.
    """
    declared = make(name)
    declared.choose_backend("daqp")
    component = declared.model()
    inputs = component.elements("input")
    runs = []
    for recording, values in recordings:
        source = {n.split(".", 1)[1]: n for n in recording if not n.startswith("controller.")}
        every = round(component.sample_time / (recording.time[1] - recording.time[0]))  # type: ignore[operator]
        evaluator, data = Evaluator(component, parameters), []
        for k in range(0, len(recording) - 1, every):
            for e in inputs:
                if e.name in values:
                    evaluator.u[e.slot] = values[e.name]
                elif e.name in source:
                    evaluator.u[e.slot] = recording[source[e.name]][k]
            args = (recording.time[k], evaluator.x, evaluator.u, evaluator.p)
            data.append(np.asarray(component.functions["programs"](*args)).ravel())
            evaluator.step(component.sample_time)  # type: ignore[arg-type]
        runs.append(np.array(data))
    return Problems(lambda: make(name), mpc, runs, limit)


def timed(given: Problems, backend: str) -> dict[str, float]:
    """Times [ms], iterations, residual and error of the command over all steps."""
    declared = given.make()
    declared.choose_backend(backend)
    component = declared.model()
    program = component.programs[0]
    n, m = program.n, program.m
    qp = CondensedQp(given.mpc)
    nu = len(given.mpc.model.inputs)
    unit = qp.columns[:nu] / given.limit
    times, results = [], []
    for data in given.runs:
        fastest = np.full(len(data), np.inf)
        for _ in range(REPETITIONS):
            solver, solutions = CompiledPrograms(component), []
            for k, row in enumerate(data):
                begin = time.perf_counter_ns()
                solution = solver.solve(row)
                fastest[k] = min(fastest[k], time.perf_counter_ns() - begin)
                solutions.append(solution)
        times.append(fastest * 1e-6)
        for row, solution in zip(data, solutions, strict=True):
            case = round(row[-1])
            exact = solve_reference(
                program.hessians[case], row[:n], program.constraints[case], row[n : n + m], row[n + m : n + 2 * m]
            )
            error = np.abs((solution[:nu] - exact.z[:nu]) * unit).max()
            results.append((solution[n + m], solution[n + m + 1], solution[n + m + 2], error))
    took, (status, iterations, residual, error) = np.concatenate(times), np.array(results).T
    return {
        "steps": len(took),
        "mean [ms]": float(took.mean()),
        "p99 [ms]": float(np.quantile(took, 0.99)),
        "p99 / half the sample time": float(np.quantile(took, 0.99) / (0.5e3 * given.mpc.model.period)),
        "iterations, most": float(iterations.max()),
        "iterations, limit": float(program.backend.most_iterations),
        "residual, largest": float(residual.max()),
        "command error, largest": float(error.max()),
        "steps not solved": float((status > 0).sum()),
    }


def bench_runs(system: str) -> list[tuple[Recording, dict[str, float]]]:
    """The published runs of the bench."""
    runs = Runner(BENCH, FmuSet())
    cases = [at(scenario, system) for scenario in SCENARIOS]
    recordings = [(runs.record(c), dict[str, float]()) for c in cases]
    runs.close()
    return recordings


def hmmwv_runs() -> list[tuple[Recording, dict[str, float]]]:
    """Every published run of paper 001 under MPC, on hydraulic actuators.

    All places of the bumps and all stretches off road, with and without preview, with true and with estimated states,
    and with the preview of the range sensors.
    """
    runs = Runner(HMMWV, FmuSet())
    recordings = []
    variants = [("mpc", "true", "generated"), ("mpc", "estimated", "generated"), ("mpc-preview", "true", "generated")]
    variants += [("mpc-preview", "estimated", "generated"), ("mpc-preview", "estimated", "sensed")]
    for controller, states, preview in variants:
        for case in (HmmwvCase(road, controller, states=states, preview=preview) for road in HMMWV_ROADS):
            for variant in range(case.variants):
                one = replace(case, variant=variant)
                states_from = "kalman" if states == "estimated" else "car"
                ahead = next(n for n in ("buffer", "map", "road") if n in runs.system(one).components)
                names = [f"{states_from}.*", f"{ahead}.preview.*"]
                recording = runs.record(one, record=Record(names, "30 ms"))
                recordings.append((recording, {"use_preview": float(controller == "mpc-preview")}))
    runs.close()
    return recordings


def higher_bumps() -> list[tuple[Recording, dict[str, float]]]:
    """Not published: the speed bumps two and four times as high, on ideal actuators; far more bounds act."""
    runs = Runner(HMMWV, FmuSet())
    recordings = []
    for controller in ("mpc", "mpc-preview"):
        case = HmmwvCase("track", controller, actuators="ideal")
        for scale in HIGHER:
            system = runs.system(case)
            system["road"].set(bump_parameters({place: scale * h for place, h in BUMPS["track"].items()}))
            recording = system.run(stop_time(system, case), record=Record(["car.*", "road.preview.*"], "30 ms"))
            recordings.append((recording, {"use_preview": float(controller == "mpc-preview")}))
    runs.close()
    return recordings


def three_axle_runs() -> list[tuple[Recording, dict[str, float]]]:
    """The published runs of the 6x6 over shallow trenches under MPC, with and without preview."""
    names = ["car.*", "road.preview.*", "reference.*"]
    recordings = []
    with Runner(three_axle.EXPERIMENT, FmuSet()) as runner:
        for preview, controller in enumerate(("mpc", "mpc-preview")):
            for place in PLACES:
                recording = runner.record(ThreeAxleCase(*place, controller), record=names)
                recordings.append((recording, {"use_preview": float(preview), "case": 0.0}))
    return recordings


def trench_runs() -> list[tuple[Recording, dict[str, float]]]:
    """The 36 controlled crossings of trenches."""
    with Runner(trench.EXPERIMENT, FmuSet()) as runner:
        names = ["car.*", "crossing.*"]
        recordings = [runner.record(case, record=Record(names, "5 ms")) for case in matrix("mpc")]
    return [(recording, {"use_preview": 1.0}) for recording in recordings]


def step_sizes() -> dict[str, dict[str, float]]:
    """OSQP on the HMMWV's programs over higher bumps, by its step size."""
    car = ride_car(load_ride_car("ride_car_hmmwv"), name="RideCarHmmwv")
    given = problems("MpcHmmwv", hmmwv.hmmwv_mpc(car), higher_bumps(), FORCE_LIMIT)

    def made(rho: float) -> Problems:
        return replace(given, make=lambda: hmmwv.mpc_hmmwv(car, backend=Osqp(rho=rho)))

    return {f"MpcHmmwv, higher bumps, osqp, step size {rho:g}": timed(made(rho), "osqp") for rho in STEP_SIZES}


def measure() -> dict[str, dict[str, float]]:
    """All controllers with all back ends."""
    small = quarter_car(load_quarter_car("quarter_car_bench"), name="QuarterCarBench")
    car = ride_car(load_ride_car("ride_car_hmmwv"), name="RideCarHmmwv")
    given = {
        "MpcBench": problems("MpcBench", bench.bench_mpc(small), bench_runs("mpc"), bench.FORCE_LIMIT),
        "MpcBenchMoves": problems(
            "MpcBenchMoves", bench.bench_mpc(small, "moves"), bench_runs("mpc-moves"), bench.FORCE_LIMIT
        ),
        "MpcHmmwv": problems("MpcHmmwv", hmmwv.hmmwv_mpc(car), hmmwv_runs(), FORCE_LIMIT),
    }
    results = {f"{name}, {backend}": timed(p, backend) for name, p in given.items() for backend in BACKENDS}
    results |= step_sizes()
    large = ride_car(load_three_axle("three_axle"), name="ThreeAxleRide")
    mpc = three_axle_mpc(combined_gains(ride_model(large))[0])
    limit = max(i.max for i in mpc.inputs)
    for title, runs, parameters in (
        ("shallow trenches", three_axle_runs, {"estimator": 1, "hold_height": False}),
        ("trenches", trench_runs, TRENCH_MPC),
    ):
        settings = {k: float(v) for k, v in parameters.items()}
        found = timed(problems("MpcThreeAxle", mpc, runs(), limit, settings), "daqp")
        results[f"MpcThreeAxle, {title}, daqp"] = found
    return results
