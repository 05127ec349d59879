"""Independent solutions that tests, and benchmarks, compare the project's with."""
