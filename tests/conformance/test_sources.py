"""Where values come from: the FMU says of every parameter what its declaration says."""

from __future__ import annotations

import components
from built import FMUS, BuiltFmus

from build_fmus.builder import Options
from build_fmus.component import Model
from cosim import Fmu
from fmu_sources.catalog import Context, default_catalog


def declared(name: str) -> Model:
    """The component that an FMU under test is made of."""
    if name in components.MAKERS:
        return components.MAKERS[name]().model()
    options = Options(FMUS)
    return default_catalog()[name].make(Context(options.out, options.cache)).model()


def test_every_parameter_has_the_source_that_was_declared(name: str, built_fmus: BuiltFmus) -> None:
    files = [built_fmus.path(name, 2), built_fmus.path(name, 3)]
    if name in components.MAKERS:
        files.append(built_fmus.path(name, 3, arrays=True))
    sources = {n: v.source for v in declared(name).variables if v.role == "parameter" for n in v.element_names()}
    for file in files:
        about = Fmu(file).description
        assert {n: p.source for n, p in about.parameters.items()} == sources
        assert not any(v.source for n, v in about.variables.items() if n not in about.parameters)
