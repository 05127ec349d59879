"""Numbers: the reference results, in two importers, in both FMI versions and from rebuilt sources."""

from __future__ import annotations

import json
import lzma
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from api import Instance, Library, Model, Signals, Variable
from applies import applies_to, continuous
from built import CATALOG_NAMES
from fmpy.build import build_platform_binary

REFERENCES = Path(__file__).parents[1] / "references"
STEPS = 40  # where trajectories are compared with each other


def scale(values: np.ndarray, names: list[str]) -> np.ndarray:
    """Largest magnitude of each column, at least a tiny number.

    1 for residuals, which are rounding and relative already.
    """
    largest = np.maximum(np.abs(values).max(axis=0), 1e-12)
    return np.where([n.endswith(".residual") for n in names], 1.0, largest)


def fmpy_input(fmu: Library, signals: Signals) -> np.ndarray | None:
    """Inputs as FMPy takes them: held from row to row, with an event where a row begins."""
    if not signals.names:
        return None
    time = np.repeat(np.arange(len(signals.time)) * fmu.step, 2)[1:]  # the very numbers FMPy steps to
    values = np.repeat(signals.values, 2, axis=0)[:-1]
    kinds = {"real": np.double, "integer": np.int32, "boolean": np.bool_}
    table = np.zeros(
        len(time), dtype=[("time", np.double), *((n, kinds[fmu.variables[n].kind]) for n in signals.names)]
    )
    table["time"] = time
    for i, n in enumerate(signals.names):
        table[n] = values[:, i]
    return table


def simulate(fmu: Library, interface: str, path: Path | None = None, steps: int | None = None) -> np.ndarray:
    """Outputs that FMPy finds at the communication points, with the inputs of the documentation."""
    signals, h = fmu.stimulus, fmu.step
    steps = len(signals.time) - 1 if steps is None else steps
    options = (
        {"solver": "CVode", "relative_tolerance": 1e-11, "record_events": True} if interface == "ModelExchange" else {}
    )
    result = fmpy.simulate_fmu(
        str(path or fmu.path),
        fmi_type=interface,
        stop_time=steps * h,
        step_size=h,
        output_interval=h,
        input=fmpy_input(fmu, signals),
        output=fmu.outputs,
        **options,
    )
    # Where an input event doubles a row, the first one has the inputs before the event, as the reference has.
    _, first = np.unique(np.round(result["time"] / h).astype(int), return_index=True)
    return np.column_stack([result[n][first].astype(float) for n in fmu.outputs])


def replay(fmu: Library, inputs: Signals, parameters: dict[str, float] | None = None) -> np.ndarray:
    """Outputs at all rows of `inputs`, by the C interface."""
    with fmu.instance() as a:
        a.initialize({**(parameters or {}), **inputs.row(0)})
        first = a.get(fmu.outputs)
        return np.vstack([first, a.run(len(inputs.time) - 1, inputs)])


def test_cosimulation_in_fmpy_meets_the_reference(fmu: Library) -> None:
    reference = fmu.documentation_csv("ref")
    assert reference.names == fmu.outputs
    result = simulate(fmu, "CoSimulation")
    assert result.shape == reference.values.shape
    np.testing.assert_array_less(np.abs(result - reference.values) / scale(reference.values, fmu.outputs), 1e-9)


def written(name: str) -> str:
    """A committed reference result, a CSV."""
    return lzma.decompress((REFERENCES / f"{name}.csv.xz").read_bytes()).decode()


@pytest.mark.parametrize("name", CATALOG_NAMES)  # test components change with the tests
def test_committed_reference(fmu: Library) -> None:
    """Regression: numbers written down when they were last looked at (`tests/references/write.py` says how).

    The tolerance leaves room for the mathematical library and the linear algebra of the machine that wrote them: gains
    are computed with them, and so are the numbers, by the Python evaluation.
    """
    inputs, reference = (Signals.read(written(f"{fmu.name}_{what}")) for what in ("in", "ref"))
    assert reference.names == fmu.outputs
    assert sorted(inputs.names) == sorted(fmu.inputs)
    error = np.abs(replay(fmu, inputs) - reference.values) / scale(reference.values, fmu.outputs)
    hint = f"{fmu.name} gives other numbers; if that is meant, run tests/references/write.py and look at the difference"
    np.testing.assert_array_less(error, 1e-6, err_msg=hint)


@applies_to(continuous)
def test_model_exchange_agrees_with_cosimulation(pair: tuple[Library, Library]) -> None:
    """FMPy's CVode (relative tolerance 1e-11) against our fixed steps.

    The error of our solver is measured: halving the solver step changes the result by `change`. For order 2 and
    higher the remaining error is at most 4/3 of it; kinks lower the order locally, so 4 times the change (and
    2e-6 of scale for CVode's own error) is allowed. Booleans and Integers may switch a step apart and are left out.
    """
    for fmu in pair:
        solver = fmu.variables["solver.step"]
        columns = [i for i, n in enumerate(fmu.outputs) if fmu.variables[n].kind == "real"]
        names = [fmu.outputs[i] for i in columns]
        ours = replay(fmu, fmu.stimulus)[:, columns]
        finer = replay(fmu, fmu.stimulus, {"solver.step": (solver.start_value or 0) / 2})[:, columns]
        change = np.abs(ours - finer).max(axis=0)
        theirs = simulate(fmu, "ModelExchange")[:, columns]
        np.testing.assert_array_less(np.abs(ours - theirs).max(axis=0), 4 * change + 2e-6 * scale(theirs, names))


def test_both_versions_give_the_same_bits(pair: tuple[Library, Library]) -> None:
    two, three = (replay(fmu, fmu.stimulus) for fmu in pair)
    assert two.tobytes() == three.tobytes()


@applies_to(continuous)
def test_model_exchange_is_the_same_in_both_versions(pair: tuple[Library, Library]) -> None:
    results = []
    for fmu in pair:
        with fmu.instance("me") as a:
            a.initialize(fmu.stimulus.row(0))
            a.continuous_time()
            x = a.get_states()
            a.must("SetTime", 0.125)
            a.set_states(x * (1 + 1e-3) + 1e-6)
            results.append(np.concatenate([a.get_derivatives(), a.get(fmu.outputs), a.get(fmu.derivatives)]).tobytes())
    assert len(set(results)) == 1


@pytest.fixture(scope="module")
def ecos(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[dict[str, Any]], Any]]:
    """Answers of Ecos to jobs.

    In a process of its own: its library needs another one that only Python knows where to find.
    """
    folder = tmp_path_factory.mktemp("ecos")
    command = [sys.executable, str(Path(__file__).with_name("run_in_ecos.py"))]
    with (
        (folder / "errors").open("w") as errors,
        subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True, cwd=folder
        ) as process,
    ):

        def answer(job: dict[str, Any]) -> Any:
            assert process.poll() is None, (folder / "errors").read_text()
            print(json.dumps(job), file=process.stdin, flush=True)
            for line in process.stdout:
                if line.startswith("[[["):
                    return json.loads(line)
            raise AssertionError((folder / "errors").read_text())

        yield answer
        process.stdin.close()
        assert process.wait() == 0, (folder / "errors").read_text()


def test_a_second_importer_agrees(pair: tuple[Library, Library], ecos: Callable[[dict[str, Any]], Any]) -> None:
    """Ecos, an importer of another origin, runs ten steps with constant inputs."""
    fmu = pair[1]
    row = fmu.stimulus.row(5)
    ours = []
    for one in pair:
        with one.instance() as a:
            a.initialize()
            a.set(row)
            for _ in range(10):
                a.step(fmu.step)
            ours.append(a.get(fmu.outputs))
    kinds = {n: fmu.variables[n].kind for n in (*fmu.inputs, *fmu.outputs)}
    paths = [str(one.path) for one in pair]
    job = {"fmus": paths, "step": fmu.step, "steps": 10, "inputs": row, "outputs": fmu.outputs, "kinds": kinds}
    theirs = np.array([rows[-1] for rows in ecos(job)], dtype=float)
    np.testing.assert_array_equal(theirs, ours)


@pytest.mark.parametrize(("probe", "fmi"), [("ProbeRk4", 3), ("ProbeDiscrete", 2)])
def test_rebuilt_from_the_sources_inside(probe: str, fmi: int, load, tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """FMPy's own build of the sources in the archive gives the same trajectory.

    Each kind of component once, and each version.
    """
    if not any(shutil.which(x) for x in ("cc", "gcc", "clang", "cl")):
        pytest.skip("CMake needs a host C compiler")
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    fmu: Library = load(probe, fmi)
    folder = tmp_path / "unpacked"
    shutil.copytree(fmu.folder, folder)
    shutil.rmtree(folder / "binaries")
    build_platform_binary(folder)
    rebuilt = tmp_path / f"{probe}.fmu"
    rebuilt.write_bytes(b"")
    shutil.make_archive(str(tmp_path / probe), "zip", folder)
    (tmp_path / f"{probe}.zip").replace(rebuilt)
    other = Library(rebuilt)
    ours, theirs = (replay(f, fmu.stimulus) for f in (fmu, other))
    assert theirs.tobytes() == ours.tobytes()


def parameters_of_its_own(fmu: Model) -> list[Variable]:
    """All but the step of the solver."""
    return [fmu.variables[n] for n in fmu.names("parameter") if n != "solver.step"]


@applies_to(parameters_of_its_own)
def test_parameters_change_results_on_fresh_and_reset_instances(fmu: Library) -> None:
    """Every parameter takes effect when set before initialization; the same on a fresh and on a reset instance.

    What a reset leaves of a parameter shows in the run with the next one, or in the last one with none.
    """
    parameters = parameters_of_its_own(fmu)
    effective = 0
    with fmu.instance() as a:

        def run(values: dict[str, float]) -> bytes:
            a.reset()
            a.initialize({**values, **fmu.stimulus.row(0)})
            return np.vstack([a.get(fmu.outputs), a.run(STEPS)]).tobytes()

        base = run({})
        for v in parameters[:: max(1, len(parameters) // 20)]:
            value = changed_value(v)
            if value is None:
                continue
            after_reset = run({v.name: value})
            effective += after_reset != base
            if after_reset != base:
                with fmu.instance() as fresh:
                    fresh.initialize({v.name: value, **fmu.stimulus.row(0)})
                    assert np.vstack([fresh.get(fmu.outputs), fresh.run(STEPS)]).tobytes() == after_reset, v.name
        assert run({}) == base
    assert effective


def changed_value(v) -> float | None:  # type: ignore[no-untyped-def]
    """Another value of a parameter inside its range, None when there is no other."""
    start = v.start_value
    if v.kind == "boolean":
        return 1.0 - start
    candidates = [start * 1.01, start * 0.99, start + 0.5] if v.kind == "real" else [start + 1, start - 1]
    for value in candidates:
        if value != start and (v.low is None or value >= v.low) and (v.high is None or value <= v.high):
            return value
    return None


def test_smaller_communication_steps(fmu: Library) -> None:
    """One `doStep(h)` and two `doStep(h/2)` agree.

    To rounding for rk4 and ros2 with h/2 a multiple of the solver step and for discrete components, to solver error for
    am2, whose predictor restarts at every communication step.
    """
    h = fmu.step if not fmu.is_continuous else 4 * fmu.variables["solver.step"].start_value
    stimulus = fmu.stimulus
    with fmu.instance() as a, fmu.instance() as b:
        for one in (a, b):
            one.initialize(stimulus.row(0))
        for k in range(20):
            for one in (a, b):
                if stimulus.names:
                    one.set(stimulus.row(k))
            a.step(h)
            advance(b, [h / 2, h / 2])
        x, y = (one.get(reals(fmu)) for one in (a, b))
    tolerance = 1e-10 if "am2" not in (fmu.folder / "documentation" / "index.html").read_text() else 1e-3
    np.testing.assert_allclose(y, x, rtol=tolerance, atol=tolerance * max(1.0, np.abs(x).max()))


def test_variable_communication_steps(fmu: Library) -> None:
    """Uneven communication steps end where even ones do, inputs held (to solver error for continuous components)."""
    h = 8 * fmu.step
    with fmu.instance() as a, fmu.instance() as b:
        for one in (a, b):
            one.initialize(fmu.stimulus.row(0))
        a.step(h)
        advance(b, [h / 8, h / 4, h / 2, h / 16, h / 16])
        x, y = (one.get(reals(fmu)) for one in (a, b))
    np.testing.assert_allclose(y, x, rtol=1e-3, atol=1e-3 * max(1.0, np.abs(x).max()))


def advance(instance: Instance, steps: list[float]) -> None:
    """Several communication steps with the inputs as they are."""
    for h in steps:
        instance.step(h)


def reals(fmu: Library) -> list[str]:
    """Real outputs."""
    return [n for n in fmu.outputs if fmu.variables[n].kind == "real"]
