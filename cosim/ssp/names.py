"""Words of the standard and of the tools that extend it: namespaces, annotations, types of files."""

from __future__ import annotations

from build_fmus.base.checks import unknown
from cosim.core.errors import SspError

_BASE = "http://ssp-standard.org/SSP1/SystemStructure"
SSD, SSC, SSV, SSM, SSB = (
    f"{{{_BASE}{n}}}" for n in ("Description", "Common", "ParameterValues", "ParameterMapping", "SignalDictionary")
)
OWN = "{urn:suspension-fmus:ssp:1}"
OSP = "{http://opensimulationplatform.com/SSP/OSPAnnotations}"
OMS = "{https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd}"
_SHORT = {"ssd": SSD, "ssc": SSC, "ssv": SSV, "ssm": SSM, "ssb": SSB, "sf": OWN, "osp": OSP, "oms": OMS}
PREFIXES = {prefix: name[1:-1] for prefix, name in _SHORT.items()}
"""Some readers know elements by these prefixes, not by their namespaces."""

OURS, OF_OSP, OF_OPENMODELICA = "suspension-fmus", "com.opensimulationplatform", "org.openmodelica"
"""Types of annotations."""

FMU, DEFINITION, PACKAGE = (
    "application/x-fmu-sharedlibrary",
    "application/x-ssp-definition",
    "application/x-ssp-package",
)
"""Types of components."""
PARAMETERS, MAPPING, DICTIONARY = (
    "application/x-ssp-parameter-set",
    "application/x-ssp-parameter-mapping",
    "application/x-ssp-signal-dictionary",
)

ENTRY = "SystemStructure.ssd"
VERSIONS = ("1.0", "2.0")
FMI_OF = {"1.0": "2", "2.0": "3"}
"""Which version of FMI goes into an SSP of which version."""
IMPLEMENTATIONS = {"any": None, "CoSimulation": "cs", "ModelExchange": "me"}
"""Interfaces of a component, as System.add has them."""


def version_of(version: str) -> str:
    """A version of SSP that can be written. Raises SspError."""
    text = str(version)
    if text not in VERSIONS:
        raise SspError(unknown("version of SSP", text, VERSIONS))
    return text
