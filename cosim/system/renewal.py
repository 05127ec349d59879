"""Components written in Python, as new for every run: a copy of what was added, or a new one from its factory.

What several components of a system share (a bus, an array), their copies share too. A component with attributes that
cannot be copied (sockets, threads) is refused, unless it overrides `begin`: then the object itself runs, and `begin`
sets its state. Values that belong to a class are never copied; a list, dict, set or array of a class that a run has
changed is refused at the next run.
"""

from __future__ import annotations

import copy
import weakref
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.core import plain
from cosim.core.component import PythonComponent, uncopyable
from cosim.core.errors import CosimError, WiringError

_OF_CLASSES: weakref.WeakKeyDictionary[type, dict[str, tuple[Any, Any]]] = weakref.WeakKeyDictionary()
_DECLARED = ("description", "_inputs", "_outputs")  # attributes that copies share: they never change


@dataclass(eq=False)
class PythonSource:
    """What a component in Python is made of: the object that was added, or a factory and what it made last."""

    added: PythonComponent
    factory: Callable[[], Any] | None = None
    used: bool = False

    @classmethod
    def of(cls, given: Any) -> PythonSource | None:
        """From what was given to `System.add`; None for what is no component in Python. Raises WiringError."""
        factory = None
        if isinstance(given, type) or (callable(given) and not hasattr(given, "bind")):
            factory, given = given, _made(given)
        if not isinstance(given, PythonComponent):
            return None
        if not hasattr(given, "description"):
            name = type(given).__name__
            raise WiringError(
                f"{name}.__init__ does not call super().__init__(), which reads the declarations of {name}: call it"
                " first"
            )
        return cls(given, factory)


def _made(factory: Callable[[], Any]) -> Any:
    name = getattr(factory, "__name__", repr(factory))
    try:
        made = factory()
    except TypeError as error:
        raise WiringError(
            f"cannot make a component with {name}(): {error}; add {name}(...), or lambda: {name}(...) as a factory"
        ) from error
    if not isinstance(made, PythonComponent):
        raise WiringError(
            f"{name}() returns {type(made).__name__}, not a PythonComponent: give a component, or a class or function "
            "that makes one"
        )
    return made


def renewed(sources: Mapping[str, PythonSource]) -> dict[str, PythonComponent]:
    """The components of the next run, by name. Raises CosimError naming what cannot be as new."""
    for name, source in sources.items():
        _check_classes(name, type(source.added))
    copied = {n: s.added for n, s in sources.items() if s.factory is None}
    made = {n: _from_factory(n, s) for n, s in sources.items() if s.factory is not None}
    try:
        return made | _copies(copied, {})
    except Exception:
        itself = {n: c for n, c in copied.items() if _must_run_itself(n, c)}
        return made | itself | _copies({n: c for n, c in copied.items() if n not in itself}, itself)


def _must_run_itself(name: str, component: PythonComponent) -> bool:
    """Whether it cannot be copied, and sets its state in `begin`. Raises CosimError when it does not."""
    found = uncopyable({k: v for k, v in vars(component).items() if k not in _DECLARED}, component)
    if not found or type(component).begin is not PythonComponent.begin:
        return bool(found)
    attribute, why = next(iter(found.items()))
    raise CosimError(
        f"'{name}' ({type(component).__name__}) cannot be reset for each run: its attribute {attribute} cannot be"
        f" copied ({why}); set its state in begin(), or add a factory that makes it: system.add('{name}', lambda:"
        f" {type(component).__name__}(...))"
    )


def _copies(
    components: Mapping[str, PythonComponent], others: Mapping[str, PythonComponent]
) -> dict[str, PythonComponent]:
    """Copies that share among each other, and with `others`, what the components share."""
    copies: dict[str, PythonComponent] = {n: object.__new__(type(c)) for n, c in components.items()}
    values = {f"{n} {k}": v for n, c in components.items() for k, v in vars(c).items() if k not in _DECLARED}
    fixed = [x for c in components.values() for x in (c.description, *c.description.variables.values())]
    fixed += [x for c in others.values() for x in (c, *vars(c).values())]
    onto = [*((x, x) for x in fixed), *((c, copies[n]) for n, c in components.items())]
    new = plain.copied(values, onto)
    for n, c in components.items():
        own = {k: new.get(f"{n} {k}", v) for k, v in vars(c).items()}
        vars(copies[n]).update(own)
    return copies


def _from_factory(name: str, source: PythonSource) -> PythonComponent:
    if source.used:
        assert source.factory is not None
        old, new = source.added, _made(source.factory)
        if new.identity() != old.identity():
            raise CosimError(f"'{name}': its factory made a component with other variables than before")
        old.close()
        for attribute in _DECLARED:
            setattr(new, attribute, getattr(old, attribute))
        source.added = new
    source.used = True
    return source.added


def _check_classes(name: str, cls: type) -> None:
    """Refuse lists, dicts, sets and arrays of a class that have changed since its first run: they would survive."""
    for owner in cls.__mro__[: cls.__mro__.index(PythonComponent)]:
        if owner not in _OF_CLASSES:
            values = {k: v for k, v in vars(owner).items() if isinstance(v, list | dict | set | bytearray | np.ndarray)}
            lost = uncopyable(values)
            _OF_CLASSES[owner] = {k: (v, copy.deepcopy(v)) for k, v in values.items() if k not in lost}
        for attribute, (value, before) in _OF_CLASSES[owner].items():
            if vars(owner).get(attribute) is value and not _same(value, before):
                raise CosimError(
                    f"'{name}': {owner.__name__}.{attribute} is a class attribute that a run has changed, so the"
                    f" next run would differ: set self.{attribute} in __init__ or begin"
                )


def _same(a: Any, b: Any) -> bool:
    try:
        return np.array_equal(a, b, equal_nan=a.dtype.kind in "fc") if isinstance(a, np.ndarray) else bool(a == b)
    except (ValueError, TypeError):  # arrays within lists do not compare
        return repr(a) == repr(b)
