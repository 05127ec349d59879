"""What several components, and those who judge them, have in common.

================  ==============================================================================
``relative``      linear models of a car in relative states: deflections and velocities
``hmmwv_states``  the relative states of the HMMWV, as its laws and its Kalman filter name them
``comfort``       weighting filters and figures of ride comfort
================  ==============================================================================
"""
