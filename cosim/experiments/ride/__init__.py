"""Test courses of a proving ground: absorbed power, 6 W speed and 2.5 g speed of every car with every controller.

Beside the common layout: `course` makes roads of OpenCRG files; `search` finds the speeds at which a limit is reached,
`results` has what it found.
"""

from cosim.experiments.layout import experiment

EXPERIMENT = experiment(
    __name__, "Every car over the courses of a proving ground: absorbed power, 6 W speed, obstacles at 2.5 g"
)
