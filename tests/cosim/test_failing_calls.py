"""Functions of FMUs that return what is no success: the run says which one, at what time, and keeps what it has."""

from __future__ import annotations

import pytest
from foreign import failing

from cosim import ComponentError, CosimError, FmuWarning, System

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")

STATUSES = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("failing")


def one(path, function, status, *, after=0, **how):
    """A system of one FMU, whose function returns a status from the call after `after` others on."""
    system = System()
    parameters = {"function": failing.FUNCTIONS.index(function), "status": STATUSES.index(status), "after": after}
    system.add("m", path, step="10 ms", parameters=parameters, **how)
    return system


@pytest.mark.parametrize("isolated", [False, True], ids=["in process", "isolated"])
@pytest.mark.parametrize("status", ["Discard", "Error", "Fatal"])
@pytest.mark.parametrize("interface", ["cs", "me"])
@pytest.mark.parametrize("version", [2, 3])
def test_a_failing_end_is_told_and_keeps_the_results(folder, version, interface, status, isolated):
    path = failing.build(version, folder)
    with one(path, "nothing", "OK", interface=interface) as system:
        whole = system.run(0.1, record=["m.x"])
    system = one(path, "Terminate", status, interface=interface, isolated=isolated)
    with (
        system,
        pytest.warns(FmuWarning, match=rf"component 'm': fmi{version}Terminate returned {status}; the results"),
    ):
        recording = system.run(0.1, record=["m.x"])
    assert (recording["m.x"] == whole["m.x"]).all()


@pytest.mark.parametrize("status", ["Discard", "Error", "Fatal"])
@pytest.mark.parametrize("version", [2, 3])
def test_an_exported_system_tells_a_failing_end(folder, caplog, version, status):
    path = folder / f"System{version}{status}.fmu"
    with one(failing.build(version, folder), "Terminate", status) as system:
        system.export_fmu(path)
    with System() as system:
        system.add("whole", path, step="10 ms")
        system.run(0.1, record=["whole.m.x"])
    assert f"component 'm': fmi{version}Terminate returned {status}; the results of the run are complete" in caplog.text


EXCHANGE = failing.FUNCTIONS[failing.FUNCTIONS.index("SetTime") :]
CALLED = {
    "cs": ("GetReal", "EnterInitializationMode", "ExitInitializationMode", "DoStep"),
    "me": ("GetReal", "EnterInitializationMode", "ExitInitializationMode", *EXCHANGE),
}


@pytest.mark.parametrize("status", ["Error", "Fatal"])
@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(("interface", "function"), [(i, f) for i, functions in CALLED.items() for f in functions])
def test_a_function_that_fails_is_named(folder, version, interface, function, status):
    called = {
        "GetDerivatives": "Get.*Derivatives",
        "UpdateDiscreteStates": "DiscreteStates",
        "GetReal": "Get(Real|Float64)",
    }
    system = one(failing.build(version, folder), function, status, interface=interface)
    with (
        system,
        pytest.raises(CosimError, match=rf"'m'.*fmi{version}\w*{called.get(function, function)} returned {status}"),
    ):
        system.run(0.1, record=["m.x"])


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("function", ["GetDerivatives", "SetContinuousStates", "UpdateDiscreteStates"])
def test_differences_for_a_linear_model_name_the_call_that_is_fatal(folder, version, function):
    named = {"GetDerivatives": "Derivatives", "UpdateDiscreteStates": "DiscreteStates"}.get(function, function)
    system = one(failing.build(version, folder), function, "Fatal", after=1, interface="me")
    text = rf"component 'm': fmi{version}\w*{named} returned Fatal"
    with system, pytest.raises(CosimError, match=text):
        system.linearize()


OTHER_COUNTS = {
    "fmi3GetNumberOfContinuousStates returns 0, and ModelStructure lists 1 continuous states": {"states": 0},
    "fmi3GetNumberOfEventIndicators returns 2, and ModelStructure lists 1 event indicators": {"indicators": 2},
}


@pytest.mark.parametrize("isolated", [False, True], ids=["in process", "isolated"])
@pytest.mark.parametrize("text", OTHER_COUNTS)
def test_an_fmu_with_other_numbers_of_values_than_its_description_is_refused(folder, text, isolated):
    """It would write beyond the memory that it gets."""
    path = failing.build(3, folder, **OTHER_COUNTS[text])
    system = one(path, "nothing", "OK", interface="me", isolated=isolated)
    with system, pytest.raises(ComponentError, match=f"component 'm': its integration failed at t = 0 s: {text}"):
        system.run(0.1)


@pytest.mark.parametrize("text", OTHER_COUNTS)
def test_an_exported_system_refuses_it_too(folder, text):
    exported = folder / f"Other{'States' in text}.fmu"
    with one(failing.build(3, folder, **OTHER_COUNTS[text]), "nothing", "OK", interface="me") as system:
        system.export_fmu(exported)
    with System() as system:
        system.add("whole", exported, step="10 ms")
        with pytest.raises(ComponentError, match=text):
            system.run(0.1)
