"""The `.fmu` archive: everything an importer, a rebuilder and a reader needs, byte for byte reproducible."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

from build_fmus import description_xml, generate, licenses, reference, related, xcp
from build_fmus.base import extras, safe_files
from build_fmus.base.archives import zipped
from build_fmus.compile import ObjectCache, Platform, find_toolchain
from build_fmus.component import Component, DeclarationError, Model
from build_fmus.icon import icon_png
from build_fmus.stability import check_solver

with extras.needed("build", extras.BUILDING):
    import jinja2

FMI_HEADERS = {  # from the fmpy wheel
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}


def build_fmu(
    component: Component,
    fmi: int,
    platforms: Sequence[Platform],
    cache: ObjectCache,
    *,
    arrays: bool = False,
    clocks: bool = False,
) -> bytes:
    """Compile and pack one component for one FMI version. The component's declaration ends with this.

    Args:
        component: to build.
        fmi: 2 or 3.
        platforms: that the FMU gets binaries for.
        cache: of compiled objects and libraries.
        arrays: array variables instead of scalar elements (FMI 3.0 only).
        clocks: a discrete component can be sampled in event mode, at the ticks of a periodic clock, and as otherwise
            (FMI 3.0 only).

    Raises:
        DeclarationError: the declaration is incomplete, or an expression does not have the dimension that is declared.
        SolverStepError: the solver step is unstable at an operating point.
        CompileError: no toolchain, or the compiler failed.
    """
    return _pack(component.model(), fmi, platforms, cache, arrays=arrays and fmi == 3, clocks=clocks and fmi == 3)


def _pack(
    component: Model, fmi: int, platforms: Sequence[Platform], cache: ObjectCache, *, arrays: bool, clocks: bool
) -> bytes:
    if failed := component.failed_checks():
        raise DeclarationError(f"{component.name}: its own start values fail a check: {failed[0]}")
    component.dimensions.check()
    check_solver(component)
    files = source_files(component, fmi, arrays=arrays, clocks=clocks)
    sources = [n for n in files if n.endswith(".c")]
    token = generate.identity(component, arrays=arrays, clocks=clocks)
    content: dict[str, bytes] = {f"sources/{name}": data for name, data in files.items()}
    content["sources/lanes.json"] = generate.lane_table(component, files["model.c"], arrays=arrays, token=token)
    content["modelDescription.xml"] = description_xml.model_description(
        component, fmi, token=token, sources=sources, arrays=arrays, clocks=clocks
    )
    with safe_files.scratch_files(files) as folder:
        paths = [folder / n for n in sources]
        compilers = {}
        for p in platforms:
            path = f"binaries/{p.fmi2_name if fmi == 2 else p.name}/{component.name}{p.suffix}"
            compilers[path] = find_toolchain(p.name)
            content[path] = cache.library(compilers[path], paths, [folder], component.name).read_bytes()
    icon = icon_png(component.kind)
    if fmi == 2:
        content["model.png"] = icon
    else:
        content["sources/buildDescription.xml"] = description_xml.build_description(component.name, sources)
        content["terminalsAndIcons/terminalsAndIcons.xml"] = description_xml.terminals_and_icons(
            component, arrays=arrays
        )
        content["terminalsAndIcons/icon.png"] = icon
    result = reference.simulate(component)
    content |= _documentation(component, fmi, result)
    parts = licenses.of_sources(
        files, generate.third_party(component), uses_casadi=generate.written_functions(component).uses_casadi
    )
    parts += licenses.of_windows(n for n in content if n.endswith(".dll"))
    content |= licenses.texts(component.name, parts)
    if component.provenance:
        provenance = json.dumps(dict(component.provenance), indent=1, sort_keys=True)
        content["resources/provenance.json"] = f"{provenance}\n".encode()
    inputs, references = (f"documentation/{component.name}_{what}.csv" for what in ("in", "ref"))
    experiment = related.Experiment(
        float(result.time[-1]), float(result.time[1]), inputs if result.input_names else None, references
    )
    content |= xcp.files(component, content)
    content |= related.files(component.name, content, parts, compilers, experiment=experiment)
    return zipped(content)


def source_files(component: Model, fmi: int, *, arrays: bool = False, clocks: bool = False) -> dict[str, bytes]:
    """C files and headers of a component's FMU, by file name."""
    token = generate.identity(component, arrays=arrays, clocks=clocks)
    code = generate.generate_c(component, arrays=arrays, token=token, clocks=clocks, first=True)
    files = {"model.c": code.encode()}
    runtime = (*generate.RUNTIME_SOURCES, f"fmi{fmi}.c", *generate.RUNTIME_HEADERS)
    files |= {name: (generate.RUNTIME_DIR / name).read_bytes() for name in runtime}
    files |= generate.solver_files(component) | generate.profile_files(component)
    files = generate.with_mathematics(files)
    return files | fmi_headers(fmi)


def fmi_headers(fmi: int) -> dict[str, bytes]:
    """The headers of a version of FMI, by file name."""
    import fmpy  # half a second, of every command of an experiment if it were imported above

    headers = Path(fmpy.__file__).parent / "c-code"
    return {name: (headers / name).read_bytes() for name in FMI_HEADERS[fmi]}


def _documentation(component: Model, fmi: int, result: reference.ReferenceResult) -> dict[str, bytes]:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("build_fmus", "templates"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    page = environment.get_template("documentation.html").render(
        component=component,
        fmi=f"{fmi}.0",
        rows=description_xml.variable_rows(component),
        papers=generate.cited(component),
        version=metadata.version("suspension-fmus"),
        dependencies={e.name: component.dependencies[e.name] for e in component.output_elements()},
    )
    return {
        "documentation/index.html": page.encode(),
        f"documentation/{component.name}_in.csv": result.input_csv().encode(),
        f"documentation/{component.name}_ref.csv": result.output_csv().encode(),
    }
