"""The declaration language: one Python object per component, from which everything else is derived.

A component declares its variables with CasADi symbols and relates them by expressions. The C code, both
`modelDescription.xml` files, exact dependencies, directional derivatives, the linear model, the documentation page
and the Python reference evaluation all come from this one object.

Continuous component:

    c = Component("Mass", kind="continuous", description="A mass pushed by a force", source="Newton")
    m = c.parameter("mass", 2.0, "kg", "mass", min=1e-3, source="assumed")
    f = c.input("force", "N", "applied force")
    x = c.state("x", "m", "position", output=True)
    v = c.state("v", "m/s", "velocity", output=True)
    c.derivative(x, v)
    c.derivative(v, f / m)
    c.output("a", f / m, "m/s2", "acceleration")

Discrete component: `kind="discrete"`, `sample_time=...` and `Component.update` instead of `derivative`.
At a sample instant t the outputs are evaluated from the inputs at t and the state before the update, then the state is
updated; outputs hold until the next sample (see `docs/explanation/architecture.md`, the co-simulation algorithm).

Users declare a component with the builder `Component`. `component.model()` freezes what it has collected into
a `Model`, once; the generator, the model description, the Python evaluation and the checks read that. Everything
derived is computed by the model when it is first asked for, and since nothing changes any more, nothing derived can be
out of date.

Modules of the package, each above those that it uses:

- `declare`: `Component`, the builder;
- `model`: `Model`, which ties the rest together;
- `linear`: the linear model about an operating point;
- `structure`: exact dependencies, positions and velocities, constant outputs;
- `functions`: the CasADi functions of starts, derivatives or updates, outputs, directional derivatives and checks;
- `dimensions`: whether expressions have the dimensions that their variables declare;
- `declaration`: all that was declared, as data, with the order of elements and vectors;
- `variables`: one variable and its scalar elements; what is wrong with a declaration.
"""

from build_fmus.component.declare import Component
from build_fmus.component.dimensions import Dimensions, Violation
from build_fmus.component.linear import Linearization
from build_fmus.component.model import Model
from build_fmus.component.variables import (
    LONGEST_SOURCE,
    BaseType,
    DeclarationError,
    Element,
    Kind,
    Role,
    Solver,
    Variable,
    source_fault,
    text_fault,
)

__all__ = [
    "LONGEST_SOURCE",
    "BaseType",
    "Component",
    "DeclarationError",
    "Dimensions",
    "Element",
    "Kind",
    "Linearization",
    "Model",
    "Role",
    "Solver",
    "Variable",
    "Violation",
    "source_fault",
    "text_fault",
]
