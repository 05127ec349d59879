"""Generalized predictive control of the full car (paper 000).

==================  ====================================================================
``arx``             ARX models with measured disturbances: simulation and identification
``law``             multi-step prediction and the control laws of an ARX model
``component``       a law as a discrete component, with the timing of the paper
``identification``  from a vehicle FMU to laws: excitation, recording, design
==================  ====================================================================
"""
