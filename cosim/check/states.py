"""Checks of the state machine: calls that a state allows succeed, others return an error; none ends the process."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from cosim.check.bench import Bench
from cosim.check.calls import Ended, Instance, Refused, good, shown
from cosim.check.model import Var
from cosim.check.rules import Found, check, names, note, warning
from cosim.fmu.calls import DISCARD, ERROR, FATAL, OK, name_in, text

_MACHINE2 = "3.2.3 and 4.2.4 State Machine of Calling Sequence"
_MACHINE3 = "2.3 State Machine and Semantics; 3.2 and 4.2"


ENOUGH = 2.0  # s of steps that are enough of a life


@check(
    "states.version",
    "the library returns the FMI version of its description",
    fmi2="2.1.4 Inquire Platform and Version Number of Header Files",
    fmi3="2.2.5 Inquire Version Number of Header Files",
    advice="Return the version of the header files.",
)
def version(bench: Bench) -> Found:
    library = bench.fmu.library(bench.kind)
    for function, expected in (
        (f"fmi{bench.version}GetVersion", bench.version + ".0"),
        ("fmi2GetTypesPlatform", "default"),
    ):
        if not hasattr(library, function):
            continue
        bench.fmu.say(function)
        said = text(bench.fmu.ffi, getattr(library, function)())
        if said != expected:
            found = f"{function} returns {said!r}; it must return {expected!r}"
            yield warning(found) if said.startswith(expected) else found


@check(
    "states.life",
    "an instance completes its life cycle: instantiation, initialization, steps, termination, and is freed",
    fmi2=_MACHINE2,
    fmi3=_MACHINE3,
    advice="See the logged message, if there is one; an FMU must run with its start values and without connections.",
)
def life(bench: Bench) -> Found:
    with bench.instance() as a:
        read = bench.watched()
        a.enter_initialization()
        a.get(readable_in_initialization(bench))
        a.exit_initialization()
        times: list[float] = []
        try:
            if a.kind == "me":
                a.handle_events()
            while len(times) < 10 and sum(times) < ENOUGH:
                begin = time.perf_counter()
                a.step(bench.step)
                times.append(time.perf_counter() - begin)
                a.get(read)
        except Ended:
            yield note(f"it asks to end the simulation at {a.time:.9g} s, with start values and inputs as they are")
        except Refused as refused:
            if refused.status == DISCARD and a.time > bench.model.start_time:
                yield note(str(refused))
                return
            raise
        if times:
            bench.measures["time of a step"] = f"{sorted(times)[len(times) // 2] * 1e6:.0f} us"
        a.terminate()


def _states(bench: Bench) -> list[str]:
    return [
        "instantiated",
        "initialization mode",
        *(["step mode"] if bench.kind == "cs" else ["event mode", "continuous-time mode"]),
        "terminated",
    ]


def put_into(a: Instance, state: str) -> Instance:
    """Bring a new instance into a state."""
    if state == "instantiated":
        return a
    a.enter_initialization()
    if state == "initialization mode":
        return a
    a.exit_initialization()
    if state == "event mode":
        return a
    if a.kind == "me":
        a.handle_events()
    if state == "terminated":
        a.terminate()
    return a


Call = Callable[[Bench, Instance], int]
ANY, RUNNING = (
    ("instantiated", "initialization mode", "event mode", "continuous-time mode", "step mode", "terminated"),
    ("event mode", "continuous-time mode", "step mode"),
)
READ = ANY[1:]


def readable_in_initialization(bench: Bench) -> list[Var]:
    """Variables that may be read in initialization mode.

    In FMI 2.0 (3.2.3, 4.2.4) these are outputs, continuous states and their derivatives.
    """
    m = bench.model
    found = bench.watched()
    if bench.version == "3":
        return found
    structural = {*m.states, *m.listed("Derivative"), *m.listed("InitialUnknown")}
    return [v for v in found if v.causality == "output" or v in structural]


def _get(bench: Bench, a: Instance) -> int:
    read = readable_in_initialization(bench) if a.state == "initialization mode" else bench.watched()
    return _worst(a.get_raw(access, group)[0] for access, group in bench.fmu.groups(read).items())


def _worst(statuses: Iterable[int]) -> int:
    """The gravest status; nothing is called after Fatal."""
    worst = OK
    for status in statuses:
        worst = max(worst, status)
        if status == FATAL:
            break
    return worst


def _set_inputs(bench: Bench, a: Instance) -> int:
    """Inputs to their start values; in continuous-time mode only the continuous ones may change."""
    between = a.state != "continuous-time mode"
    return _set_to_start(bench, a, [v for v in bench.settable("input") if between or v.variability == "continuous"])


def _set_parameters(bench: Bench, a: Instance) -> int:
    return _set_to_start(bench, a, bench.settable("parameter"))


def _set_to_start(bench: Bench, a: Instance, variables: list[Var]) -> int:
    groups = bench.fmu.groups(variables).items()
    return _worst(a.set_raw(access, group, [x for v in group for x in v.starts() or ()]) for access, group in groups)


def _logging(bench: Bench, a: Instance) -> int:
    categories = [a.ffi.new("char[]", x.encode()) for x in bench.model.categories]
    status = a.call("SetDebugLogging", True, len(categories), categories)
    return max(status, a.call("SetDebugLogging", False, 0, None))


def _save(bench: Bench, a: Instance) -> int:  # noqa: ARG001
    state = a.ffi.new("void**")
    status = a.call("GetFMUState", state)
    if good(status):
        status = max(status, a.call("SetFMUState", state[0]))
        status = max(status, a.call("FreeFMUState", state))
    return status


def _vector(name: str) -> Call:
    def call(bench: Bench, a: Instance) -> int:
        n = bench.model.n_indicators if name == "GetEventIndicators" else bench.model.n_states
        if n == 0:
            return 0
        return a.call(name, a.buffer("double", n), n)

    return call


def _time(bench: Bench, a: Instance) -> int:  # noqa: ARG001
    return a.call("SetTime", a.time)


def _completed(bench: Bench, a: Instance) -> int:  # noqa: ARG001
    _values, flags = a.flags(2)
    return a.call("CompletedIntegratorStep", True, *flags)


def _directional(bench: Bench, a: Instance) -> int:
    knowns = bench.continuous_inputs()[:1]
    unknowns = [v for v in bench.model.of("output") if v.is_float and v.variability == "continuous"][:1]
    if not knowns or not unknowns:
        return 0
    try:
        a.directional(unknowns, knowns, [1.0] * knowns[0].size)
    except Refused as refused:
        return -1 if refused.status is None else refused.status
    return 0


def _events(bench: Bench, a: Instance) -> int:  # noqa: ARG001
    return a.update_discrete_states()[0]


def allowed(bench: Bench) -> list[tuple[str, tuple[str, ...], Call]]:
    """(what is called, states in which it is allowed, the call) of what every correct importer may do."""
    i, me = bench.interface, bench.kind == "me"
    found: list[tuple[str, tuple[str, ...], Call]] = [
        ("Get of variables", READ, _get),
        (
            "Set of inputs",
            (*(("instantiated",) if bench.version == "3" else ()), "initialization mode", *RUNNING),
            _set_inputs,
        ),
        ("Set of parameters", ("instantiated", "initialization mode"), _set_parameters),
        ("SetDebugLogging", ANY, _logging),
    ]
    if i.saves:
        found.append((f"Get, Set and Free of the {name_in(bench.version, 'FMUState')}", ANY, _save))
    if i.directional:
        found.append(("GetDirectionalDerivative", (*READ[:1], *RUNNING), _directional))
    if me:
        evaluated = ("initialization mode", "event mode", "continuous-time mode")
        vectors = {
            name_in(bench.version, "GetContinuousStateDerivatives"): evaluated,
            "GetContinuousStates": evaluated,
            "GetNominalsOfContinuousStates": evaluated[1:],
            "GetEventIndicators": evaluated,
        }
        found += [
            *((name, where, _vector(name)) for name, where in vectors.items()),
            ("SetTime", ("continuous-time mode",), _time),
            (name_in(bench.version, "UpdateDiscreteStates"), ("event mode",), _events),
        ]
        if i.wants_completed_steps(bench.version):
            found.append(("CompletedIntegratorStep", ("continuous-time mode",), _completed))
    return found


@check(
    "states.allowed",
    "every function succeeds in every state where it is allowed",
    fmi2=_MACHINE2,
    fmi3=_MACHINE3,
    advice="Allow what the state machine allows; functions that a capability flag promises must work.",
)
def every_allowed(bench: Bench) -> Found:
    for state in _states(bench):
        for what, where, call in allowed(bench):
            if state not in where or (
                what.startswith("Get of") and state == "terminated" and bench.version == "2" and bench.kind == "me"
            ):
                continue
            status, where_, said = bench.alone(_tried, bench, state, call)
            if good(status) or status == DISCARD:
                continue
            text = f"{what} {where_} returns {shown(status)}{': ' + said if said else ''}"
            if bench.version == "2" and state == "initialization mode" and what in CONTRADICTORY:
                yield warning(f"{text}; by the table of FMI 2.0, 3.2.3, this is allowed, by its figure it is not")
            else:
                yield text
    for state in _states(bench):  # and a second life from each
        bench.alone(_live_again, state)


CONTRADICTORY = ("GetDerivatives", "GetContinuousStates", "GetEventIndicators")
"""Functions that the table of FMI 2.0 allows in initialization mode, and its figure of the state machine does not."""


def _live_again(a: Instance, state: str) -> None:
    put_into(a, state)
    a.reset()
    a.initialize()


def _tried(a: Instance, bench: Bench, state: str, call: Call) -> tuple[int, str, str]:
    """Status of a call in a state, where that is, and what the FMU says."""
    put_into(a, state)
    where = a.where
    a.messages.clear()
    status = call(bench, a)
    said = a.said()
    return status, where, said


def _step(bench: Bench, a: Instance) -> int:
    return a.do_step(a.time, bench.step)


def _enter(bench: Bench, a: Instance) -> int:  # noqa: ARG001
    return a.call("EnterInitializationMode", *(() if a.version == "2" else a.setup()))


def _plain(name: str) -> Call:
    return lambda bench, a: a.call(name)


@check(
    "states.forbidden",
    "a function that is not allowed in a state returns an error",
    fmi2="2.1.3 Status Returned by Functions; " + _MACHINE2,
    fmi3="2.2.4 Status Returned by Functions; " + _MACHINE3,
    advice=(
        "Check the state at the top of each function, and return Error with a message. Importers make mistakes, too."
    ),
    worst="warning",
)
def forbidden(bench: Bench) -> Found:
    still = ("instantiated", "initialization mode", "terminated")
    calls: list[tuple[str, tuple[str, ...], Call]] = [
        ("ExitInitializationMode", tuple(s for s in ANY if s != still[1]), _plain("ExitInitializationMode")),
        ("EnterInitializationMode", ANY[1:], _enter),
        ("Terminate", still, _plain("Terminate")),
    ]
    if bench.kind == "cs":
        calls.append(("DoStep", still, _step))
    else:
        calls += [
            *((name, still, _plain(name)) for name in ("EnterContinuousTimeMode", "EnterEventMode")),
            ("SetContinuousStates", ("instantiated", "terminated"), _vector("SetContinuousStates")),
        ]
    taken: dict[str, list[str]] = {}
    for what, where, call in calls:
        for state in where:
            if state not in _states(bench):
                continue
            status, *_ = bench.alone(_tried, bench, state, call)
            if status not in (ERROR, DISCARD):
                taken.setdefault(f"{what} returns {shown(status)}", []).append(state)
    if taken:
        yield (
            "; ".join(f"{text} in {' and in '.join(where_)}" for text, where_ in taken.items())
            + ", where it is not allowed"
        )


@check(
    "states.step",
    "invalid step sizes and steps beyond stopTime are rejected",
    fmi2="4.2.2 Computation",
    fmi3="2.2.5.1 Advancing Time; 4.2 (fmi3DoStep)",
    advice="Return an error for steps that are not above 0 or not finite, and for steps beyond stopTime.",
    kinds=("cs",),
    worst="warning",
)
def wrong_steps(bench: Bench) -> Found:
    taken = []
    for h in (-bench.step, float("nan"), float("inf")):
        if bench.alone(lambda a, h: good(a.initialize().do_step(a.time, h)), h):
            taken.append(f"{h:g}")
    if taken:
        yield f"DoStep accepts a communicationStepSize of {', '.join(taken)}"

    def beyond_stop(a: Instance) -> bool:
        a.enter_initialization(stop=bench.model.start_time + bench.step).exit_initialization()
        a.step(bench.step)
        return good(a.do_step(a.time, bench.step))

    if bench.alone(beyond_stop):
        yield "DoStep accepts a step beyond stopTime; it must return an error"


@check(
    "states.null",
    "FreeInstance ignores NULL",
    fmi2="2.1.5 Creation, Destruction and Logging of FMU Instances (fmi2FreeInstance)",
    fmi3="2.3.1 Super State: FMU State Setable (fmi3FreeInstance)",
    advice="Return at once when the instance is NULL.",
)
def free_null(bench: Bench) -> Found:
    with bench.instance() as a:
        a.raw("FreeInstance")(a.ffi.NULL)
    yield from ()


@check(
    "states.arguments",
    "NULL arguments and unknown log categories do not cause a crash",
    fmi2="2.1.3 Status Returned by Functions",
    fmi3="2.2.1 Requirements for Implementations of the C-API (NULL)",
    advice="Guard against NULL: the standard forbids it to importers, and recommends it to FMUs.",
    worst="note",
)
def null_arguments(bench: Bench) -> Found:
    floats = "Real" if bench.version == "2" else "Float64"
    with bench.instance() as a:
        put_into(a, "step mode" if bench.kind == "cs" else "continuous-time mode")
        values = a.buffer("double", 1)
        reference = a.references([v for v in bench.watched() if v.access == floats][:1]) or [0]
        a.transfer(f"Get{floats}", reference, 1, None, 1)
        a.transfer(f"Get{floats}", None, 1, values, 1)
        a.transfer(f"Set{floats}", None, 1, values, 1)
        nonsense = a.ffi.new("char[]", b"no category, %s %n")
        a.call("SetDebugLogging", True, 1, [nonsense])
    yield from ()


@check(
    "states.token",
    "instantiation with a wrong token fails",
    fmi2="2.1.5 Creation, Destruction and Logging of FMU Instances (fmuGUID)",
    fmi3="2.3.1 Super State: FMU State Setable (instantiationToken)",
    advice="Compare the token with the one that was compiled in, and return NULL with a message where they differ.",
    worst="warning",
)
def token(bench: Bench) -> Found:
    a = bench.instance(token=bench.model.token + "-of-another")
    if a.handle is not None:
        a.free()
        yield note("it can be instantiated with a wrong " + ("GUID" if bench.version == "2" else "instantiationToken"))


@check(
    "states.statuses",
    "functions return valid FMI statuses, and errors are logged",
    fmi2="2.1.3 Status Returned by Functions",
    fmi3="2.2.4 Status Returned by Functions and Logging Mechanism",
    advice="Log a message before an Error is returned, while logging is on.",
    worst="warning",
)
def explained(bench: Bench) -> Found:
    silent = []
    for what in ("ExitInitializationMode", "Terminate"):
        status, where, said = bench.alone(_tried, bench, "instantiated", _plain(what))
        if status == ERROR and not said:
            silent.append(what)
        if status < 0 or status > 5:
            yield f"{what} {where} returns {shown(status)}"
    if silent:
        yield note(f"{names(silent)}: Error is returned without a message, although logging is on")
