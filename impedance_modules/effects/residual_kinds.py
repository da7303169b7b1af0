# SPDX-License-Identifier: BSD-3-Clause
r"""The residuals in which an effect can show, and with which sign.

A torque passes from the command to the motion through three stages:

    command --drive--> motor torque --actuator--> effort (gear to link) --link--> motion

A residual is what goes in at one place, minus what the nominal model says comes out at another: the torque
that the real joint consumes in between (diagnosis.md 6). With u the torque asked for (command plus what the
robot adds by itself), e the measured effort, and ID the rigid model's inverse dynamics:

    actuator   u - e - (I_r \ddot\theta + D \dot\theta)     effort from a joint sensor
    link       e - ID(q, v, a)                                effort from a joint sensor
    motor      e - ID(q, v, a) - I_r a - D v                  effort from the motor
    whole      u - ID(q, v, a) - I_r a - D v                  no effort recorded
    drive      u - e                                          effort from the motor, and a command
    velocity   v_reported - dq/dt                             [rad/s]
"""

from __future__ import annotations

from typing import Literal

from impedance_modules.effects.effect_description import Port

Residual = Literal["actuator", "link", "motor", "whole", "drive", "velocity"]

RESIDUALS: tuple[Residual, ...] = ("actuator", "link", "motor", "whole", "drive", "velocity")

Stage = Literal["drive", "actuator", "link"]

COVERS: dict[Residual, frozenset[Stage]] = {
    "actuator": frozenset({"drive", "actuator"}),
    "link": frozenset({"link"}),
    "motor": frozenset({"actuator", "link"}),
    "whole": frozenset({"drive", "actuator", "link"}),
    "drive": frozenset({"drive"}),
    "velocity": frozenset(),
}
"""Which stages lie between the two places that a residual compares."""

EFFORT_SIGN: dict[Residual, float] = {
    "actuator": -1.0,
    "link": 1.0,
    "motor": 1.0,
    "whole": 0.0,
    "drive": -1.0,
    "velocity": 0.0,
}
"""Sign with which the measured effort enters a residual."""

STAGE_OF_PORT: dict[Port, Stage] = {
    "actuator": "actuator",
    "link": "link",
    "timing": "drive",
    "contact": "link",
}
"""Stage in which an effect of a port consumes its torque; a sensor consumes none."""


def uses_motion(residual: Residual) -> bool:
    """Says whether a residual evaluates the rigid model of the links."""
    return "link" in COVERS[residual]
