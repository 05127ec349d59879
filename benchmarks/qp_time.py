"""How long the solvers of quadratic programs take, on closed-loop runs of condensed MPC problems of several sizes.

The plants are random chains of damped oscillators under filtered noise that the controller sees ahead: no vehicle, but
the structure of one (moves, rates, soft bounds on outputs with one slack), with constraints active in a good part of
the steps.
"""

from __future__ import annotations

import ctypes
import time
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
from scipy.linalg import block_diag, expm

from build_fmus.component import Component
from build_fmus.qp import INFINITE, Backend, Daqp, Osqp
from build_fmus.qp_solve import CompiledPrograms
from tests.oracles.qp import solve_reference


@dataclass(frozen=True)
class Size:
    """One MPC problem.

    Attributes:
        outputs: with soft bounds; 0 for hard bounds on inputs and rates alone.
        horizon, moves: steps that are predicted, steps in which inputs move.
        period: sample time [s].
        step_size: of OSQP, the best of 0.01, 0.1, ... 100.
    """

    title: str
    inputs: int
    outputs: int
    horizon: int
    moves: int
    period: float
    step_size: float


SIZES = (
    Size("bench, Np 20", 1, 0, 20, 20, 0.01, 10.0),
    Size("bench, Np 50", 1, 0, 50, 50, 0.01, 10.0),
    Size("four corners, Np 15", 4, 4, 15, 15, 0.03, 10.0),
    Size("three axles, Np 50", 6, 9, 50, 3, 0.005, 1.0),
)


@dataclass(frozen=True)
class Run:
    """Matrices of a program and its data (q, l, u, case) at every step of a closed-loop run."""

    hessian: np.ndarray
    rows: np.ndarray
    data: np.ndarray


@cache
def closed_loop(size: Size, steps: int = 200) -> Run:
    """Let the controller drive the plant, solved by quadprog."""
    rng = np.random.default_rng(7)
    nu, ny, N, M = size.inputs, size.outputs, size.horizon, size.moves
    masses = max(2, nu)
    stiffness = 40.0 * (2 * np.eye(masses) - np.eye(masses, k=1) - np.eye(masses, k=-1))
    A = np.block([[np.zeros((masses, masses)), np.eye(masses)], [-stiffness, -0.05 * stiffness - 0.3 * np.eye(masses)]])
    n = 2 * masses
    B = np.vstack([np.zeros((masses, nu)), 10 * rng.normal(size=(masses, nu))])
    E = np.vstack([np.zeros((masses, masses)), 30 * np.eye(masses)])
    discrete = expm(size.period * np.block([[A, B, E], [np.zeros((nu + masses, n + nu + masses))]]))
    Ad, Bd, Ed = discrete[:n, :n], discrete[:n, n : n + nu], discrete[:n, n + nu :]
    C = np.vstack([np.eye(n), rng.normal(size=(max(0, ny - n), n))])[: max(ny, n)]

    powers = [np.eye(n)]
    for _ in range(N):
        powers.append(Ad @ powers[-1])
    free = np.vstack([C @ P for P in powers[1:]])
    by_input = _convolution(C, powers, Bd, N)
    by_noise = _convolution(C, powers, Ed, N)
    moves = np.kron(np.vstack([np.eye(M), np.tile(np.eye(M)[-1:], (N - M, 1))]), np.eye(nu))  # the last one is held
    gain = by_input @ moves
    weights = np.tile(np.linspace(1.0, 5.0, len(C)), N)
    variables = nu * M
    hessian = gain.T @ (weights[:, None] * gain) + 0.02 * np.eye(variables)
    rates = np.eye(variables) - np.eye(variables, k=-nu)
    blocks = [np.eye(variables), rates]
    soft = np.tile(np.arange(len(C)) < ny, N)
    if ny:
        column = np.ones((int(soft.sum()), 1))
        blocks = [np.hstack([b, np.zeros((len(b), 1))]) for b in blocks]
        blocks += [np.hstack([gain[soft], -column]), np.hstack([gain[soft], column]), np.eye(variables + 1)[-1:]]
        hessian = block_diag(hessian, 1e3)
    unit = 1 / np.sqrt(np.diag(hessian))
    hessian, rows = hessian * unit * unit[:, None], np.vstack(blocks) * unit

    noise = np.zeros((steps + N, masses))
    for k in range(1, len(noise)):
        noise[k] = 0.95 * noise[k - 1] + 0.3 * rng.normal(size=masses)
    x, last, data = np.zeros(n), np.zeros(nu), []
    for k in range(steps):
        predicted = free @ x + by_noise @ noise[k : k + N].ravel()
        q = gain.T @ (weights * predicted)
        first = np.zeros(variables)
        first[:nu] = last
        lower = [np.full(variables, -1.0), first - 0.5]
        upper = [np.full(variables, 1.0), first + 0.5]
        if ny:
            q = np.append(q, 0.0)
            none = np.full(int(soft.sum()), INFINITE)
            lower += [-none, -0.3 - predicted[soft], np.zeros(1)]
            upper += [0.3 - predicted[soft], none, np.array([INFINITE])]
        data.append(np.concatenate([q * unit, *lower, *upper, [0.0]]))
        m = len(rows)
        z = solve_reference(hessian, q * unit, rows, data[-1][len(q) : len(q) + m], data[-1][len(q) + m : -1]).z * unit
        last = z[:nu]
        x = Ad @ x + Bd @ last + Ed @ noise[k]
    return Run(hessian, rows, np.array(data))


def _convolution(C: np.ndarray, powers: list[np.ndarray], B: np.ndarray, N: int) -> np.ndarray:
    """Outputs over the horizon by inputs over the horizon."""
    rows, columns = len(C), B.shape[1]
    result = np.zeros((N * rows, N * columns))
    for i in range(N):
        for j in range(i + 1):
            result[i * rows : (i + 1) * rows, j * columns : (j + 1) * columns] = C @ powers[i - j] @ B
    return result


def solved(size: Size, backend: Backend) -> dict[str, float]:
    """Solve every step of a closed-loop run (OSQP with soft rows, which can take a second per step: the first 40)."""
    run = closed_loop(size)
    n, m = len(run.hessian), len(run.rows)
    c = Component(
        "Program", kind="discrete", sample_time=size.period, description="", source="benchmark", symbols=ca.MX
    )
    q, lower, upper = (c.input(k, "1", k, shape=(s,)) for k, s in (("q", n), ("l", m), ("u", m)))
    c.quadratic_program(
        "solver", hessians=[run.hessian], constraints=[run.rows], linear=q, lower=lower, upper=upper, backend=backend
    )
    few = backend.name == "osqp" and size.outputs > 0
    return replay(c, run.data[:40] if few else run.data, 1 if few else 3)


def replay(component: Component, data: np.ndarray, repetitions: int = 3) -> dict[str, float]:
    """Solve the one program of a component for all rows of `data`, warm from the row before.

    The best of some repetitions of each solve counts; every tenth solution is compared with quadprog's.
    """
    (program,) = component.programs
    n, m = program.n, program.m
    programs = CompiledPrograms(component.model())
    call, scratch = programs._library.solve, programs._scratch.ctypes.data
    memory, solution = programs.memory, np.zeros(n + m + 3)
    seconds, iterations, failures, residual, error = [], [], 0, 0.0, 0.0
    for k, row in enumerate(data):
        before, best = memory.copy(), np.inf
        pointers = [ctypes.c_void_p(a.ctypes.data) for a in (memory, np.ascontiguousarray(row), solution)]
        for _ in range(repetitions):
            memory[:] = before
            begin = time.perf_counter()
            call(scratch, *pointers)
            best = min(best, time.perf_counter() - begin)
        seconds.append(best)
        iterations.append(solution[-2])
        failures += solution[-3] != 0
        residual = max(residual, solution[-1])
        if k % 10 == 0:
            case = round(min(max(row[-1], 0), len(program.hessians) - 1))
            matrices = program.hessians[case], row[:n], program.constraints[case]
            z = solve_reference(*matrices, row[n : n + m], row[n + m : -1]).z
            error = max(error, float(np.abs(solution[:n] - z).max() / max(1.0, np.abs(z).max())))
    p50, p99 = np.percentile(seconds, [50, 99])
    assert component.sample_time is not None
    return {
        "median [us]": 1e6 * p50,
        "99th percentile [us]": 1e6 * p99,
        "99th percentile / sample time": p99 / component.sample_time,
        "iterations, 99th percentile": float(np.percentile(iterations, 99)),
        "failures [%]": 100 * failures / len(data),
        "largest residual": residual,
        "largest error of z": error,
    }


def measure() -> dict[str, dict[str, float]]:
    """Both solvers on all sizes."""
    rows = {}
    for size in SIZES:
        n, m = len(closed_loop(size).hessian), len(closed_loop(size).rows)
        for backend in (Daqp(), Osqp(rho=size.step_size, eps=1e-7)):
            rows[f"QP {size.title} ({n} x {m}), {backend.name}"] = solved(size, backend)
    return rows
