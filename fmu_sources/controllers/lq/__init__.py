"""Linear-quadratic control, with and without preview of the road.

- `design`: optimal control laws of a linear plant: continuous, sampled, with preview
- `preview`: preview control of the car with seven degrees of freedom as a component (paper 004)
- `preview_weights`: weights of its index: files in TOML, the published ones in `weights/`
- `hmmwv`: regulator of the HMMWV on its relative states (paper 001)
- `three_axle`: regulator of the 6x6 with pitch reference (paper 003)
- `bench`: regulator of the quarter-car bench (paper 002)
"""
