"""Signals from tables as components of a system: columns of CSV and Parquet files, DataFrames, arrays and recordings.

- `source`: reads a table from wherever it is, and refuses what is no signal, by line and column;
- `table`: the component, in Python and bound to the engine's C;
- `inputs`: drives the inputs of a system that a table's columns name.
"""

from cosim.tables.inputs import drive
from cosim.tables.source import TableError
from cosim.tables.table import Table

__all__ = ["Table", "TableError", "drive"]
