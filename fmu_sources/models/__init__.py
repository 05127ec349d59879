"""What several components, and those who judge them, have in common.

- `corners`: names of the corners of vehicles, and the order of all vectors over wheels
- `double_wishbone`: kinematics of double wishbones from their hardpoints, and splines that hold them
- `relative`: linear models of a car in relative states: deflections and velocities
- `hmmwv_states`: the relative states of the HMMWV, as its controllers and its Kalman filter name them
- `bench_states`: the states of the quarter-car bench that its controllers feed back
- `comfort`: weighting filters and figures of ride comfort
"""
