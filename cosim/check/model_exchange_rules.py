"""What an FMU for Model Exchange must do: states that are set count, and calls change nothing else."""

from __future__ import annotations

import math

from cosim.check.bench import Bench, attempt, same
from cosim.check.calls import Instance
from cosim.check.derivatives import Vector, are_close, evaluating, other_values
from cosim.check.rules import Found, check, names, require, warning


@check(
    "exchange.states",
    "state and derivative vectors have the variables and the order of ModelStructure",
    fmi2="2.2.8 Definition of the Model Structure (Derivatives); 3.2.2 Evaluation of Model Equations",
    fmi3="2.4.8 Model Structure (ContinuousStateDerivative); 3.2.1",
    advice="Return states and derivatives in the order of ModelStructure.",
    kinds=("me",),
)
def state_vector(bench: Bench) -> Found:
    m = bench.model
    states, derivatives = m.states, m.listed("Derivative")
    require(derivatives, "it has no continuous states")
    readable = set(bench.fmu.readable(m.variables))
    all_readable = len(states) == len(derivatives) and {*states, *derivatives} <= readable
    require(all_readable, "not all states can be read as variables")
    with evaluating(bench) as a:
        x, dx = a.get_states(), a.get_derivatives()
        for what, vector, variables in (("state", x, states), ("derivative", dx, derivatives)):
            read = a.get(variables)
            flat = [(v, value) for v in variables for value in read[v]]
            wrong = [
                (v, value, got)
                for (v, value), got in zip(flat, vector, strict=True)
                if not same(float(value), got, 1e-6)
            ]
            if wrong:
                v, value, got = wrong[0]
                more = f", and {len(wrong) - 1} more differ" if len(wrong) > 1 else ""
                yield f"{what} {v.name!r} is {value:.9g} as a variable and {got:.9g} in the vector{more}"
                return
        # What is set is what is there.
        new = other_values(x)
        if attempt(a.set_states, new) and not all(same(p, q) for p, q in zip(a.get_states(), new, strict=True)):
            yield "states are not read back as they were set"


@check(
    "exchange.pure",
    "derivatives depend on time, states and inputs only, in whatever order these are set",
    fmi2="3.2.1 Providing Independent Variables and Re-initialization of Caching",
    fmi3="3.2.1 Providing Independent Variables and Re-initialization of Caching",
    advice=(
        "Invalidate cached values whenever time, states or inputs are set; change nothing else when something is"
        " evaluated."
    ),
    kinds=("me",),
)
def pure(bench: Bench) -> Found:
    require(bench.model.n_states, "it has no continuous states")
    with evaluating(bench) as a:
        x, before = a.get_states(), a.get_derivatives()
        twice = a.get_derivatives()
        if not are_close(before, twice):
            yield "derivatives differ when they are read twice"
            return
        other = other_values(x)
        attempt(a.set_states, other)
        attempt(a.get_derivatives)
        t = a.time
        attempt(a.must, "SetTime", t + bench.step)
        attempt(a.get_derivatives)
        a.must("SetTime", t)
        a.set_states(x)
        if not are_close(before, a.get_derivatives()):
            yield "derivatives differ after other states and times were tried and the first ones set again"
            return
    bench.several()

    def at_new_states(a: Instance, evaluated: bool) -> Vector | None:
        a.initialize()
        x = a.get_states()
        if evaluated:
            a.get_derivatives()
        return attempt(lambda: a.set_states(other_values(x)) and a.get_derivatives())  # type: ignore[no-any-return]

    # States that are set count, whether anything was evaluated before or not.
    found = [bench.alone(at_new_states, evaluated) for evaluated in (False, True)]
    if found[0] is not None and found[1] is not None and not are_close(found[0], found[1]):
        yield "derivatives at new states depend on whether they were evaluated at old ones before"


@check(
    "exchange.nominals",
    "nominal values of the states are above 0 and agree with the description",
    fmi2="3.2.2 Evaluation of Model Equations (nominals)",
    fmi3="2.3.3 State: Initialization Mode (fmi3GetNominalsOfContinuousStates)",
    advice="Return 1 where no nominal value is known.",
    kinds=("me",),
)
def nominals(bench: Bench) -> Found:
    m = bench.model
    require(m.n_states, "it has no continuous states")
    with bench.instance() as a:
        a.initialize()
        found = a.get_nominals()
    declared = [(s, s.nominal if s.nominal is not None else 1.0) for s in m.states for _ in range(s.size)]
    for (s, expected), nominal in zip(declared, found, strict=False):
        if not (nominal > 0 and math.isfinite(nominal)):
            yield f"the nominal value of {s.name!r} is {nominal:g}; it must be above 0"
            return
        if s.nominal is not None and not same(nominal, expected, 1e-6):
            yield warning(f"the nominal value of {s.name!r} is {nominal:g}, in the description {expected:g}")
            return


@check(
    "exchange.counts",
    "the numbers of states and event indicators agree with the description, and their values are finite",
    fmi2="3.2.2 Evaluation of Model Equations (event indicators)",
    fmi3="2.3.2 State: Instantiated (fmi3GetNumberOf...); 2.4.8 Model Structure",
    advice="List every state derivative and every event indicator.",
    kinds=("me",),
)
def counts(bench: Bench) -> Found:
    m = bench.model
    with bench.instance() as a:
        if bench.version == "3" and not m.structural:
            for function, what, expected in (
                ("GetNumberOfContinuousStates", "continuous states", m.n_states),
                ("GetNumberOfEventIndicators", "event indicators", m.n_indicators),
            ):
                n = a.ffi.new("size_t*")
                a.must(function, n)
                if n[0] != expected:
                    yield f"{function} returns {n[0]}; ModelStructure lists {expected} {what}"
        a.initialize()
        for what, vector in (
            ("event indicator", a.get_indicators()),
            ("state", a.get_states()),
            ("derivative", a.get_derivatives()),
        ):
            wrong = [i for i, value in enumerate(vector) if not math.isfinite(value)]
            if wrong:
                yield f"{what} number {wrong[0] + 1} is {vector[wrong[0]]} at the start"


@check(
    "exchange.together",
    "Co-Simulation and Model Exchange begin with the same outputs",
    fmi2="2.2.7 Definition of Model Variables (start)",
    fmi3="2.3.3 State: Initialization Mode",
    advice="One model, two interfaces: initialization is the same for both.",
    kinds=("me",),
    worst="warning",
)
def together(bench: Bench) -> Found:
    require("cs" in bench.model.interfaces and "cs" in bench.fmu.libraries, "it has one interface only")
    outputs = [v for v in bench.watched() if v.causality == "output" and v.is_number]
    found = [Bench(bench.fmu, kind).alone(lambda a: a.enter_initialization().get(outputs)) for kind in ("cs", "me")]
    wrong = [v.name for v in found[0] if not are_close(found[0][v], found[1][v])]
    if wrong:
        yield f"in initialization mode {names(wrong)} {'differ' if len(wrong) > 1 else 'differs'} between the two"
