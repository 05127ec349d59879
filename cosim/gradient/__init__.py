"""Derivatives of what a run shows, by parameters and start values: see `System.gradient`."""

from cosim.gradient.gradient import Gradient, GradientError, Trust
from cosim.gradient.metrics import Final, Mean, Metric, Peak, QuadraticCost, Rms

__all__ = ["Final", "Gradient", "GradientError", "Mean", "Metric", "Peak", "QuadraticCost", "Rms", "Trust"]
