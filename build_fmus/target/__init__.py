"""Sampled components as C libraries for firmware: one C file, one header, a static library and its measurements."""
