"""Benchmarks of the FMUs and of the co-simulation master: ratios measured in one run."""
