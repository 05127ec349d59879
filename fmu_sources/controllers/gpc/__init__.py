"""Generalized predictive control of the full car (paper 000).

- `arx`: ARX models with measured disturbances: simulation and identification
- `prediction`: multi-step prediction with such a model
- `control_law`: the control laws of a prediction
- `component`: a controller as a discrete component, with the timing of the paper
- `identification`: from a vehicle FMU to controllers: excitation, recording, design
"""
