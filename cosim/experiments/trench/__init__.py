"""Paper 003: a 6x6 crosses a trench, passive or under control; any length and speed.

`runs` wires, runs and measures; `linear` is a part with runs of its own, the linear vehicle beside this one;
`published` has what the paper prints (`published.csv`) and the runs that stand beside it; `claims` judges;
`report` lays out.
"""

from cosim.experiments.layout import experiment
from cosim.experiments.trench import linear, runs

EXPERIMENT = experiment(
    __name__,
    "A 6x6 crosses trenches with preview MPC (paper 003)",
    interval=runs.step,
    page="cosim.experiments.trench.report:page",
    parts=[linear.PART],
)
