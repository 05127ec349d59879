"""Linear-quadratic control with preview of the disturbance: continuous and exact sampled design.

Marzbanrad, Hojjat, Zohoor, Nikravesh, "Optimal Preview Control Design of an Active Suspension Based on a Full Car
Model". Equation numbers in this folder are that paper's.

The plant is linear, with states x, controls u, disturbances w (the road under each wheel) and weighted outputs y:

    dx/dt = A x + B u + E w,    y = C x + D u + F w                                                       (9), (20)

The index is the mean of a quadratic form in x, u and w. With output weights it is the mean of
sum rho_i y_i^2 + sum rho_j u_j^2, as in (10); in general it is (13) with one more term, 2 u' Nuw w:

    J = mean of x' Q1 x + 2 x' N u + u' R u + 2 x' Q12 w + w' Q2 w + 2 u' Nuw w                                (13)

The way from a plant to a controller:

    index = output_index(plant, output_weights, control_weights)       # (10) -> (13)
    lq = continuous_lq(plant, index)                                   # (14)-(18): u = -lq.K x + u_ff
    weights = lq.foh_weights(step=0.005, count=80)                     # u_ff from heights 5 ms apart
    u_ff = weights.command(road_ahead, horizons=[24, 51, 24, 51])      # one horizon per wheel, in steps

or, for a controller that is evaluated every `period` seconds and holds its command and its road in between,
`sampled_lq(plant, index, period)`. Both control laws are optimal for a disturbance known over the whole future. A
horizon that ends earlier takes the disturbance to be 0 beyond its end, or with hold_tail to stay at the last value
known.

In (17) the driving term is printed as (P E + Q12) w; here it is (P E + Q12 - K' Nuw) w, which differs when D' W F is
not 0. So Theorem 2, of an index in outputs with a known error, is Theorem 1 with that error among the disturbances.

- `plant`: linear plants and quadratic indices
- `continuous`: Theorem 1, with preview of a disturbance that is linear between nodes
- `sampled`: the exact control law of a controller with a sample time
- `tunable`: both as expressions of the weights, for an FMU that designs its control law
- `modes`: whether a control law exists, and which mode stands in the way
- `riccati`: Newton steps on a Riccati equation
- `matrices`: checks and symmetry of matrices
"""

from fmu_sources.controllers.lq.design.continuous import ContinuousLq, FohWeights, continuous_lq
from fmu_sources.controllers.lq.design.plant import LinearPlant, LqError, QuadraticIndex, output_index
from fmu_sources.controllers.lq.design.sampled import SampledLq, sampled_lq

__all__ = [
    "ContinuousLq",
    "FohWeights",
    "LinearPlant",
    "LqError",
    "QuadraticIndex",
    "SampledLq",
    "continuous_lq",
    "output_index",
    "sampled_lq",
]
