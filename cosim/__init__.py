"""How FMUs run together: the co-simulation master, its experiments and reports."""
