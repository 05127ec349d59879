"""The C interface of FMI 2.0 and 3.0 through cffi, and what differs between the two.

cffi in ABI mode: no compiler is needed, and a call with pre-bound arguments costs 0.2 us. Status values
are declared as unsigned int, which spares an enum conversion per call and makes one comparison find all that is no
success: negative values, which no FMU may return, are large ones.
"""

from __future__ import annotations

import platform
import re
import struct
import sys
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import cffi
import numpy as np

from cosim.core.errors import FmuError

OK, WARNING, DISCARD, ERROR, FATAL, PENDING = range(6)

_TYPES2 = {"Real": "double", "Integer": "int", "Boolean": "int", "String": "const char*"}
_TYPES3 = {
    "Float64": "double",
    "Float32": "float",
    "Int8": "int8_t",
    "UInt8": "uint8_t",
    "Int16": "int16_t",
    "UInt16": "uint16_t",
    "Int32": "int32_t",
    "UInt32": "uint32_t",
    "Int64": "int64_t",
    "UInt64": "uint64_t",
    "Boolean": "bool",
    "String": "const char*",
}

_BOTH = """
typedef void* Component; typedef uint32_t VR; typedef unsigned int Status; typedef {Boolean} Boolean;
void fmi{v}FreeInstance(Component);
Status fmi{v}SetDebugLogging(Component, Boolean, size_t, const char* const*);
Status fmi{v}ExitInitializationMode(Component);
Status fmi{v}Terminate(Component);
Status fmi{v}Reset(Component);
Status fmi{v}GetFMU{State}(Component, void**);
Status fmi{v}SetFMU{State}(Component, void*);
Status fmi{v}FreeFMU{State}(Component, void**);
Status fmi{v}SerializedFMU{State}Size(Component, void*, size_t*);
Status fmi{v}SerializeFMU{State}(Component, void*, char*, size_t);
Status fmi{v}{Deserialize}FMU{State}(Component, const char*, size_t, void**);
"""


def _common(v: int, types: dict[str, str], **words: str) -> str:
    """What FMI 2.0 and 3.0 have alike, and the functions that access values of each type."""
    size = ", size_t" if v == 3 else ""
    access = (
        f"Status fmi{v}Get{name}(Component, const VR*, size_t, {c}*{size});\n"
        f"Status fmi{v}Set{name}(Component, const VR*, size_t, {c} const*{size});\n"
        for name, c in types.items()
    )
    return _BOTH.format(v=v, Boolean=types["Boolean"], **words) + "".join(access)


_FMI2 = (
    _common(2, _TYPES2, State="state", Deserialize="DeSerialize")
    + """
typedef struct { void* logger; void* allocate; void* release; void* finished; void* environment; } Callbacks;
Component fmi2Instantiate(const char*, int, const char*, const char*, const Callbacks*, Boolean, Boolean);
Status fmi2SetupExperiment(Component, Boolean, double, double, Boolean, double);
Status fmi2EnterInitializationMode(Component);
Status fmi2GetDirectionalDerivative(Component, const VR*, size_t, const VR*, size_t, const double*, double*);
Status fmi2DoStep(Component, double, double, Boolean);
Status fmi2GetRealStatus(Component, int, double*);
Status fmi2GetBooleanStatus(Component, int, Boolean*);
Status fmi2GetStringStatus(Component, int, const char**);
void* calloc(size_t, size_t);
void free(void*);
"""
)
_FMI3 = (
    _common(3, _TYPES3, State="State", Deserialize="Deserialize")
    + """
Component fmi3InstantiateCoSimulation(const char*, const char*, const char*, bool, bool, bool, bool, const VR*, size_t,
                                      void*, void*, void*);
Status fmi3EnterInitializationMode(Component, bool, double, double, bool, double);
Status fmi3GetBinary(Component, const VR*, size_t, size_t*, const uint8_t**, size_t);
Status fmi3SetBinary(Component, const VR*, size_t, const size_t*, const uint8_t* const*, size_t);
Status fmi3GetDirectionalDerivative(Component, const VR*, size_t, const VR*, size_t, const double*, size_t, double*,
                                    size_t);
Status fmi3DoStep(Component, double, double, bool, bool*, bool*, bool*, double*);
"""
)

_EVENTS3 = """
Status fmi3EnterConfigurationMode(Component);
Status fmi3ExitConfigurationMode(Component);
Status fmi3EnterEventMode(Component);
Status fmi3EnterStepMode(Component);
Status fmi3UpdateDiscreteStates(Component, bool*, bool*, bool*, bool*, bool*, double*);
Status fmi3GetClock(Component, const VR*, size_t, bool*);
Status fmi3SetClock(Component, const VR*, size_t, const bool*);
Status fmi3GetIntervalDecimal(Component, const VR*, size_t, double*, int*);
Status fmi3GetIntervalFraction(Component, const VR*, size_t, uint64_t*, uint64_t*, int*);
Status fmi3GetShiftDecimal(Component, const VR*, size_t, double*);
Status fmi3GetShiftFraction(Component, const VR*, size_t, uint64_t*, uint64_t*);
"""  # what only FMUs with structural parameters or events have

_EXCHANGE = """
Status fmi{v}SetTime(Component, double);
Status fmi{v}SetContinuousStates(Component, const double*, size_t);
Status fmi{v}GetContinuousStates(Component, double*, size_t);
Status fmi{v}Get{derivatives}(Component, double*, size_t);
Status fmi{v}GetEventIndicators(Component, double*, size_t);
Status fmi{v}GetNominalsOfContinuousStates(Component, double*, size_t);
Status fmi{v}EnterContinuousTimeMode(Component);
Status fmi{v}CompletedIntegratorStep(Component, Boolean, Boolean*, Boolean*);
"""  # what is called by `engine/integrator.c`
_EXCHANGE2 = (
    _EXCHANGE.format(v=2, derivatives="Derivatives")
    + """
Status fmi2EnterEventMode(Component);
typedef struct { Boolean again, ends, nominals, values, timed; double next; } EventInfo;
Status fmi2NewDiscreteStates(Component, EventInfo*);
"""
)
_EXCHANGE3 = (
    _EXCHANGE.format(v=3, derivatives="ContinuousStateDerivatives")
    + """
Component fmi3InstantiateModelExchange(const char*, const char*, const char*, bool, bool, void*, void*);
Status fmi3GetNumberOfContinuousStates(Component, size_t*);
Status fmi3GetNumberOfEventIndicators(Component, size_t*);
"""
)

_CHECKED2 = "const char* fmi2GetVersion(void); const char* fmi2GetTypesPlatform(void);"
_CHECKED3 = """
const char* fmi3GetVersion(void);
Status fmi3GetAdjointDerivative(Component, const VR*, size_t, const VR*, size_t, const double*, size_t, double*,
                                size_t);
"""  # what is called by `cosim check` only

_parsed: dict[str, cffi.FFI] = {}


def ffi_of(version: str) -> cffi.FFI:
    """Types and functions of an FMI version, "2" or "3"; parsed when the first FMU of this version is opened."""
    if version not in _parsed:
        ffi = cffi.FFI()
        ffi.cdef(_FMI3 + _EVENTS3 + _EXCHANGE3 + _CHECKED3 if version == "3" else _FMI2 + _EXCHANGE2 + _CHECKED2)
        _parsed.setdefault(version, ffi)  # all threads use the same types
    return _parsed[version]


@cache
def c_library() -> Any:
    """The C library with calloc and free."""
    return ffi_of("2").dlopen("ucrtbase.dll" if sys.platform == "win32" else None)


def close(ffi: cffi.FFI, library: Any) -> None:
    """Close a library that `ffi` has opened.

    cffi itself keeps a list of all libraries ever opened, also closed ones, which grows by about ten kilobytes each.
    """
    ffi.dlclose(library)
    opened, caches = getattr(ffi, "_libraries", []), getattr(ffi, "_function_caches", [])
    if library in opened and len(opened) == len(caches):
        place = opened.index(library)
        del opened[place], caches[place]


# FMI type -> C type of one value, for buffers.
C_TYPES2 = {**_TYPES2, "Enumeration": "int"}
C_TYPES3 = {**_TYPES3, "Enumeration": "int64_t", "Binary": "const uint8_t*"}


def c_types(version: int) -> dict[str, str]:
    """C type of one value by FMI type."""
    return C_TYPES3 if version == 3 else C_TYPES2


DTYPES = {
    "double": np.float64,
    "float": np.float32,
    "int": np.intc,
    "bool": np.bool_,
    "int8_t": np.int8,
    "uint8_t": np.uint8,
    "int16_t": np.int16,
    "uint16_t": np.uint16,
    "int32_t": np.int32,
    "uint32_t": np.uint32,
    "int64_t": np.int64,
    "uint64_t": np.uint64,
}


def accessed_as(version: str, fmi_type: str) -> str:
    """The type by whose functions values of a type are set and read."""
    return {"2": "Integer", "3": "Int64"}[version] if fmi_type == "Enumeration" else fmi_type


# Without these nothing runs; what else is missing is named when it is called.
_REQUIRED = ("FreeInstance", "EnterInitializationMode", "ExitInitializationMode", "Terminate", "Reset")
_REQUIRED_EXCHANGE = ("SetTime", "EnterEventMode", "UpdateDiscreteStates", "EnterContinuousTimeMode")

Log = Callable[[int, str, str], None]  # (status, category, message)
Intermediate = tuple[int, int, Sequence[int]]
"""Addresses of fmi3IntermediateUpdateCallback and of its environment, and value references of what it sets."""


def platform_folder(version: str) -> tuple[str, str]:
    """(folder under binaries/, library suffix) of this machine for FMI "2" or "3"."""
    machine = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}.get(
        platform.machine().lower(), platform.machine().lower()
    )
    system, suffix = {"win32": ("windows", ".dll"), "darwin": ("darwin", ".dylib")}.get(sys.platform, ("linux", ".so"))
    if version == "3":
        return f"{machine}-{system}", suffix
    two = {("x86_64", "windows"): "win64", ("x86_64", "darwin"): "darwin64", ("x86_64", "linux"): "linux64"}
    return two.get((machine, system), f"{machine}-{system}"), suffix


def library_path(version: str, identifier: str) -> str:
    """Path of this machine's library in an archive."""
    folder, suffix = platform_folder(version)
    return f"binaries/{folder}/{identifier}{suffix}"


def required(version: str, interface: str) -> list[str]:
    """Names of the C functions that every FMU must have to be run by an interface ("cs" or "me")."""
    kind = "ModelExchange" if interface == "me" else "CoSimulation"
    more = (f"Instantiate{kind}",) if version == "3" else ("Instantiate", "SetupExperiment")
    own = _REQUIRED_EXCHANGE if interface == "me" else ("DoStep",)
    return [full_name(version, name) for name in (*more, *_REQUIRED, *own)]


def declared(version: str, interface: str) -> list[str]:
    """Names of all C functions that may be called of an FMU."""
    text = _FMI3 + _EVENTS3 if version == "3" else _FMI2
    if interface == "me":
        text += _EXCHANGE3 if version == "3" else _EXCHANGE2
    return re.findall(rf"\bfmi{version}\w+(?=\()", text)


_NAMES2 = {"GetContinuousStateDerivatives": "GetDerivatives", "UpdateDiscreteStates": "NewDiscreteStates"}


def name_in(version: str, name: str) -> str:
    """The name of a function of FMI 3.0 in a version, without prefix. FMI 2.0 also writes FMUstate and DeSerialize."""
    if version == "3":
        return name
    return _NAMES2.get(name, name).replace("FMUState", "FMUstate").replace("Deserialize", "DeSerialize")


def full_name(version: str, name: str) -> str:
    """The same with its prefix."""
    return f"fmi{version}{name_in(version, name)}"


def function(version: str, library: Any, name: str) -> Callable[..., int]:
    """A C function of an FMU's library. Raises FmuError when the library does not have it."""
    name = full_name(version, name)
    try:
        found: Callable[..., int] = getattr(library, name)
    except AttributeError:
        raise FmuError(f"its library lacks {name}; build or export it again") from None
    return found


_CONVERSION = re.compile(r"%(?:%|([-+ #0]*\d*(?:\.\d+)?)(hh|h|ll|l|z|j|t)?([a-zA-Z]))")
_VARIADIC_READABLE = not (sys.platform == "darwin" and platform.machine() == "arm64")
WORDS = REALS = 8
"""Variadic arguments of FMI 2 loggers that a plain callback reads: as many words, then as many reals. Calling
conventions pass both as if the function were not variadic (Windows passes reals as words).
"""


def formatted(message: str, words: Sequence[int], reals: Sequence[float]) -> str:
    """An FMI 2 log message, which is a printf format, with its arguments.

    A message with any other conversion, or with more arguments than are read, is returned as it is.
    """
    kinds = [m[3] for m in _CONVERSION.finditer(message) if m[3]]
    apart = sys.platform != "win32"  # reals have registers of their own
    n_reals = sum(k in "eEfFgG" for k in kinds) if apart else 0
    if (
        not kinds
        or not _VARIADIC_READABLE
        or n_reals > len(reals)
        or len(kinds) - n_reals > len(words)
        or not set(kinds) <= set("sdiuxXceEfFgG")
    ):
        return message
    next_word, next_real = iter(words), iter(reals)
    ffi = ffi_of("2")

    def replace(match: re.Match[str]) -> str:
        layout, length, kind = match.groups()
        if kind is None:
            return "%"
        if kind in "eEfFgG":
            real = next(next_real) if apart else struct.unpack("=d", struct.pack("=q", next(next_word)))[0]
            return f"%{layout}{kind}" % real
        word = next(next_word)
        if kind == "s":
            return f"%{layout}s" % text(ffi, ffi.cast("const char*", word))
        if kind == "c":
            return chr(word & 0xFF)
        wide = length in ("ll", "z", "j", "t") or (length == "l" and sys.platform != "win32")
        signed = ("int64_t" if wide else "int") if kind in "di" else ("uint64_t" if wide else "unsigned int")
        return f"%{layout}{kind if kind in 'xX' else 'd'}" % int(ffi.cast(signed, word))

    return _CONVERSION.sub(replace, message)


def text(ffi: Any, pointer: Any) -> str:
    """A C string as text; "" for NULL."""
    return "" if pointer == ffi.NULL else ffi.string(pointer).decode("utf-8", "replace")


def _quiet(*_: Any) -> None:
    """The onerror handler of cffi: nothing may be raised through an FMU's stack."""


def instantiate2(
    library: Any,
    process: Any,
    texts: tuple[str, str, str],
    log: Log,
    keep: list[Any],
    interface: str,
    logging: bool = True,
) -> Any:
    """Call fmi2Instantiate for an interface, "cs" or "me".

    `texts` = instance name, GUID, resource URI; objects that must outlive the instance are put into `keep`.
    """
    name, token, resources = texts
    ffi = ffi_of("2")

    arguments = ", ".join(["intptr_t"] * WORDS + ["double"] * REALS)

    @ffi.callback(f"void(void*, const char*, int, const char*, const char*, {arguments})", onerror=_quiet)
    def logger(_: Any, __: Any, status: int, category: Any, message: Any, *arguments: Any) -> None:
        log(status, text(ffi, category), formatted(text(ffi, message), arguments[:WORDS], arguments[WORDS:]))

    callbacks = ffi.new("Callbacks*")
    callbacks.logger = ffi.cast("void*", logger)
    callbacks.allocate = ffi.cast("void*", ffi.addressof(process, "calloc"))
    callbacks.release = ffi.cast("void*", ffi.addressof(process, "free"))
    keep += [logger, callbacks]
    kind = int(interface == "cs")
    return library.fmi2Instantiate(name.encode(), kind, token.encode(), resources.encode(), callbacks, 0, int(logging))


def instantiate3(
    library: Any,
    texts: tuple[str, str, str],
    log: Log,
    keep: list[Any],
    interface: str,
    logging: bool = True,
    event_mode: bool = False,
    early_return: bool = False,
    intermediate: Intermediate | None = None,
) -> Any:
    """Call fmi3InstantiateModelExchange or fmi3InstantiateCoSimulation.

    `texts` = name, token, resource path; `intermediate`: for intermediate updates.
    """
    name, token, resources = texts
    ffi = ffi_of("3")

    @ffi.callback("void(void*, int, const char*, const char*)", onerror=_quiet)
    def logger(_: Any, status: int, category: Any, message: Any) -> None:
        log(status, text(ffi, category), text(ffi, message))

    keep.append(logger)
    address = ffi.cast("void*", logger)
    arguments = (name.encode(), token.encode(), resources.encode(), False, logging)
    if interface == "me":
        return library.fmi3InstantiateModelExchange(*arguments, ffi.NULL, address)
    update, environment, inputs = intermediate or (0, 0, ())
    required, n = ffi.new("VR[]", list(inputs)), len(inputs)
    pointers = ffi.cast("void*", environment), address, ffi.cast("void*", update)
    return library.fmi3InstantiateCoSimulation(*arguments, event_mode, early_return, required, n, *pointers)
