"""Control laws, by method.

- `skyhook`: dampers between body and sky (paper 001)
- `semi_active`: skyhook, groundhook, ADD, SH-ADD and clipped LQR for semi-active dampers
- `force_tracking`: hydraulic force tracking by dynamic surface control (paper 001)
- `driver`: driver of a full car, who follows a path and a speed
- `lq`: linear-quadratic regulators and optimal preview control (papers 001 to 004)
- `mpc`: model predictive control of any plant, and the published control laws (papers 001 to 003)
- `gpc`: generalized predictive control, identified from a plant's FMU (paper 000)
- `trench`: cases and references for crossing trenches (paper 003)
- `design_checks`: checks of arguments that the designs share

Models that control laws, filters and plants have in common are in `fmu_sources.models`.
"""
