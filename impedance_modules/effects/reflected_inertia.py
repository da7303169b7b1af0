# SPDX-License-Identifier: BSD-3-Clause
r"""Rotor inertia seen at the joint through the gear, I_r = N^2 I_rotor.

Equation (thesis 3.2, 3.12): I_r \ddot\theta + D \dot\theta = \tau_m - \tau_s. The parameter ``Ia`` [kg.m^2] is
the joint's whole reflected inertia: it replaces the robot file's number. Zero makes the joint an ideal
torque source, as in the thesis's comparison of section 3.3.
"""

from __future__ import annotations

from impedance_modules.robot.model import with_reflected_inertia
from impedance_modules.spec.patch import EffectSpec
from impedance_modules.spec.robot import RobotSpec

ID = "reflected_inertia"
SYMBOL = "Ia"


def wear(robot: RobotSpec, effect: EffectSpec) -> RobotSpec:
    """Returns the robot with the effect's reflected inertia.

    Raises:
        BadInput: A joint is unknown or a value negative.
    """
    values = {joint: symbols[SYMBOL].value for joint, symbols in effect.parameters.items()}
    return with_reflected_inertia(robot, values)
