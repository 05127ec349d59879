"""Handling of the full cars: steady cornering, steps, sines, lane changes, braking in a turn, rollover.

Beside the common layout: `design` fits controllers of the suspension to a car; `metrics` defines what is measured.
"""

from cosim.experiments.layout import experiment

EXPERIMENT = experiment(__name__, "Handling of the full cars: steering, lane changes, braking in a turn, rollover")
