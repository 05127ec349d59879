"""The rule of exchange, executed in Python: instants, values, stop conditions, and whether the exchange is stable."""
