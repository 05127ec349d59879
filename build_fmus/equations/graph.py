"""The operations behind CasADi functions, each different one once."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from build_fmus.base import extras
from build_fmus.equations.operators import ELEMENTWISE, IF_ELSE

with extras.needed("build", extras.BUILDING):
    import casadi as ca

COPY = (ca.OP_RESHAPE, ca.OP_ASSIGN)  # the same numbers in the same order
GATHER = -2  # elements of a vector, in another order
SCATTER = -3  # a vector of zeros with some elements set
# what the sizes of operands decide beside their elements
_MATRICES = (ca.OP_MTIMES, ca.OP_HORZREPMAT, ca.OP_TRANSPOSE, ca.OP_SOLVE)
_AS_THEY_ARE = (
    *_MATRICES,
    ca.OP_VERTCAT,
    ca.OP_HORZCAT,
    ca.OP_MMIN,
    ca.OP_MMAX,
    ca.OP_GETNONZEROS_PARAM,
    ca.OP_SETNONZEROS_PARAM,
)


class UnknownOperationError(ValueError):
    """An operation of CasADi that is left to CasADi's own code generator."""


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """One operation: its result has `size` numbers, those of a matrix column by column.

    `data` belongs to the operation: the number or numbers of a constant, vector and first position of an input,
    positions of elements, sizes of matrices.
    """

    operation: int
    arguments: tuple[int, ...]
    size: int
    data: Any = None


@dataclass(frozen=True)
class Result:
    """Elements of a function's result from `start` on."""

    index: int
    start: int
    node: int


@dataclass
class Graph:
    """Operations of all functions of a component; equal ones are one node, whichever function they come from."""

    nodes: list[Node] = field(default_factory=list)
    _known: dict[Hashable, int] = field(default_factory=dict)

    def joined(self, parts: Sequence[int]) -> int | None:
        """The node that consists of the given ones, if there is one; the only one itself."""
        if len(parts) == 1:
            return parts[0]
        size = sum(self.nodes[n].size for n in parts)
        keys = ((operation, tuple(parts), size, None) for operation in (ca.OP_VERTCAT, ca.OP_HORZCAT))
        return next((self._known[k] for k in keys if k in self._known), None)

    def read(self, function: ca.Function, inputs: Sequence[str]) -> list[Result]:
        """Add the operations of a function of the given vectors; return its results in the function's order.

        Raises:
            UnknownOperationError: the function has an operation that this package cannot write in C.
        """
        kind = function.class_name()
        if kind == "SXFunction":
            return self._read_scalars(function, inputs)
        if kind == "MXFunction":
            return self._read_matrices(function, inputs)
        raise UnknownOperationError(kind)

    def _add(
        self, operation: int, arguments: tuple[int, ...], size: int, data: Any = None, key: Hashable = None
    ) -> int:
        if operation == ca.OP_ADD and (choice := self._choice(*arguments)):
            operation, arguments = IF_ELSE, choice
        where = (operation, arguments, size, data if key is None else key)
        found = self._known.get(where)
        if found is None:
            found = self._known[where] = len(self.nodes)
            self.nodes.append(Node(operation, arguments, size, data))
        return found

    def _choice(self, a: int, b: int) -> tuple[int, int, int] | None:
        """Condition and both values of a sum that stands for a choice."""
        first, second = self.nodes[a], self.nodes[b]
        if not first.operation == second.operation == ca.OP_IF_ELSE_ZERO:
            return None
        (c, x), (d, y) = first.arguments, second.arguments
        if self._negates(d, c):
            return c, x, y
        return (d, y, x) if self._negates(c, d) else None

    def _negates(self, a: int, b: int) -> bool:
        return self.nodes[a].operation == ca.OP_NOT and self.nodes[a].arguments == (b,)

    def _number(self, value: float) -> int:
        return self._add(ca.OP_CONST, (), 1, value, key=float(value).hex())

    def _read_scalars(self, function: ca.Function, inputs: Sequence[str]) -> list[Result]:
        registers: dict[int, int] = {}
        results = []
        for k in range(function.n_instructions()):
            operation, out = function.instruction_id(k), function.instruction_output(k)
            arguments = function.instruction_input(k)
            if operation == ca.OP_INPUT:
                vector, slot = arguments
                registers[out[0]] = self._add(operation, (), 1, (inputs[vector], slot))
            elif operation == ca.OP_CONST:
                registers[out[0]] = self._number(function.instruction_constant(k))
            elif operation == ca.OP_OUTPUT:
                results.append(Result(out[0], out[1], registers[arguments[0]]))
            elif operation == ca.OP_ASSIGN:
                registers[out[0]] = registers[arguments[0]]
            elif operation in ELEMENTWISE:
                registers[out[0]] = self._add(operation, tuple(registers[a] for a in arguments), 1)
            else:
                raise UnknownOperationError(f"operation {operation} of {function.name()}")
        return results

    def _read_matrices(self, function: ca.Function, inputs: Sequence[str]) -> list[Result]:
        registers: dict[int, int] = {}
        results = []
        for k in range(function.n_instructions()):
            operation, out = function.instruction_id(k), function.instruction_output(k)
            arguments = [registers[a] for a in function.instruction_input(k)] if operation != ca.OP_INPUT else []
            matrix = function.instruction_MX(k)
            if operation == ca.OP_OUTPUT:
                info = matrix.info()
                results.append(Result(info["ind"], info["offset"], arguments[0]))
            else:
                registers[out[0]] = self._matrix(operation, matrix, arguments, inputs)
        return results

    def _matrix(self, operation: int, matrix: ca.MX, arguments: list[int], inputs: Sequence[str]) -> int:
        size = matrix.nnz()
        if operation == ca.OP_INPUT:
            info = matrix.info()
            return self._add(operation, (), size, (inputs[info["ind"]], info["offset"]))
        if operation == ca.OP_CONST:
            return self._constant(np.array(matrix.to_DM().nonzeros(), dtype=float))
        if operation in COPY:
            return arguments[0]
        if operation in ELEMENTWISE:
            return self._add(operation, tuple(arguments), size)
        if operation in (ca.OP_GETNONZEROS, ca.OP_SETNONZEROS):
            return self._elements(operation, matrix, arguments)
        if operation in (ca.OP_PROJECT, ca.OP_TRANSPOSE) and not (matrix.is_dense() and matrix.dep().is_dense()):
            return self._moved(operation, matrix, arguments[0])
        if operation in (ca.OP_GETNONZEROS_PARAM, ca.OP_SETNONZEROS_PARAM) and "ParamVector" not in matrix.class_name():
            raise UnknownOperationError(f"elements of {matrix}")
        if operation == ca.OP_SOLVE and ("LinsolCall" not in matrix.class_name() or matrix.info()["tr"]):
            raise UnknownOperationError(f"triangular or transposed equations of {matrix}")
        if operation in _AS_THEY_ARE:
            dense = all(matrix.dep(i).is_dense() for i in range(matrix.n_dep())) and matrix.is_dense()
            if operation in (*_MATRICES, ca.OP_MMIN, ca.OP_MMAX) and not dense:
                raise UnknownOperationError(f"a sparse operand of {matrix}")
            shapes = tuple(matrix.dep(i).shape for i in range(matrix.n_dep())) if operation in _MATRICES else None
            return self._add(operation, tuple(arguments), size, shapes)
        raise UnknownOperationError(f"operation {operation}: {matrix}")

    def _constant(self, values: np.ndarray) -> int:
        if len({v.hex() for v in values.tolist()}) < 2:  # one number, however often
            number = values.tolist()[0] if values.size else 0.0
            return self._add(ca.OP_CONST, (), values.size, number, key=number.hex())
        return self._add(ca.OP_CONST, (), values.size, values, key=values.tobytes())

    def _elements(self, operation: int, matrix: ca.MX, arguments: list[int]) -> int:
        info = matrix.info()
        if "nz" in info:
            places: Any = tuple(info["nz"])
        elif "slice" in info:
            places = _range(info["slice"])
        elif "outer" in info:
            places = tuple(j + i for j in _range(info["outer"]) for i in _range(info["inner"]))
        else:
            raise UnknownOperationError(f"elements of {matrix}")
        if operation == ca.OP_GETNONZEROS:
            return self._gathered(arguments[0], places)
        if any(k < 0 for k in places) or info["add"]:
            raise UnknownOperationError(f"elements of {matrix}")
        return self._add(operation, tuple(arguments), matrix.nnz(), progression(places))

    def _gathered(self, source: int, places: Sequence[int]) -> int:
        if any(k < 0 for k in places):
            raise UnknownOperationError("elements that are not there")
        places = progression(places)
        if places == range(self.nodes[source].size):
            return source
        return self._add(GATHER, (source,), len(places), places)

    def _moved(self, operation: int, matrix: ca.MX, source: int) -> int:
        """Elements of a sparse matrix in the order of a transposed one, or among the zeros of a full one."""
        before = matrix.dep().sparsity()
        if operation == ca.OP_TRANSPOSE:
            _, order = before.transpose(True)
            return self._gathered(source, tuple(order))
        if not matrix.is_dense():
            raise UnknownOperationError(f"another pattern of {matrix}")
        rows, columns = before.get_triplet()
        places = progression([r + c * matrix.shape[0] for r, c in zip(rows, columns, strict=True)])
        return self._add(SCATTER, (source,), matrix.nnz(), places)


def _range(given: dict[str, int]) -> range:
    return range(given["start"], given["stop"], given["step"])


def progression(places: Sequence[int]) -> range | tuple[int, ...]:
    """Positions as a range where they are evenly spaced."""
    first, count = (places[0] if len(places) else 0), len(places)
    step = places[1] - first if count > 1 else 1
    if step and all(p == first + i * step for i, p in enumerate(places)):
        return range(first, first + count * step, step)
    return tuple(places)
