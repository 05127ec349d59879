"""Dry friction of a suspension, its sign smoothed (paper 001, F_f of appendix 1.C)."""

from __future__ import annotations

from typing import Any

import casadi as ca

from build_fmus.component import Component


def declare_friction(c: Component) -> Any:
    """Declare the switch; off, so that the linear model about rest is that of the frictionless plant."""
    return c.parameter(
        "friction.acting",
        False,
        None,
        "whether the friction of the suspension acts; off: the linear model of 001 (1.6)",
        tunable=True,
        source="option; 001 section 1.2 takes friction as a model error",
    )


def friction_force(friction: Any, velocity: Any, acting: Any) -> Any:
    """Friction force [N] that opposes `velocity` [m/s]: F_f v / sqrt(v^2 + v_s^2).

    It has the sign of v, so it only dissipates.
    """
    return ca.if_else(acting, friction.force * velocity / ca.sqrt(velocity**2 + friction.speed**2), 0)


def friction_loss(friction: Any, velocity: Any, acting: Any) -> Any:
    """Function [W] whose derivative by the velocity is `friction_force`, for equations derived from energies."""
    return ca.if_else(acting, friction.force * ca.sqrt(velocity**2 + friction.speed**2), 0)
