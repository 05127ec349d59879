"""Derivatives of what a run shows, by parameters and start values, through all its components. See `System.gradient`."""

from cosim.gradient.gradient import Gradient, GradientError, Trust, gradient
from cosim.gradient.metrics import Final, Mean, Metric, Peak, QuadraticCost, Rms

__all__ = ["Final", "Gradient", "GradientError", "Mean", "Metric", "Peak", "QuadraticCost", "Rms", "Trust", "gradient"]
