# SPDX-License-Identifier: BSD-3-Clause
"""Everything a plant wears, as frozen numbers and as torques that it asks at every stage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.effects.motion import WornTorque

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SensorErrors:
    r"""What the robot reports beside the truth, for all n joints.

        q_reported = q + offset        effort_reported = gain (effort + crosstalk effort) + bias
        v_reported = low pass of v with ``lag``         t_reported = clock t

    Attributes:
        offset: (n,) [rad].
        gain: (n,) of the effort sensors.
        bias: (n,) [N.m].
        crosstalk: (n, n) share of column j's effort in row i's reading.
        lag: (n,) time constant beyond the robot file's [s].
        clock: Reported seconds per second.
    """

    offset: Array
    gain: Array
    bias: Array
    crosstalk: Array
    lag: Array
    clock: float


@dataclass(frozen=True)
class WornPlant:
    """What reality does and the controller's model does not know.

    Attributes:
        torques: On motors and links, in the order in which they are asked.
        gap: (n,) full backlash between motor and link [rad].
        coupling: (n, n) rotor inertia that couples two motors [kg.m^2]; symmetric, zero diagonal.
        added_mass: (n, 6, 6) inertia without weight of what each joint's link takes along, linear then angular,
            in the joint's own axes; symmetric, positive semidefinite.
        drive_gain: (n,) motor torque per torque asked for; needed to start in equilibrium.
        spring_stiffness, spring_preload: (n,) parallel springs that a robot which carries its own weight
            compensates too [N.m/rad], [N.m].
        sensors: Errors of its sensors.
        command_delay: Delay [s] of the command line itself, without what ``torques`` adds.
        gravity_turn: (3, 3) turns gravity's direction into the tilted base's axes.
    """

    torques: tuple[WornTorque, ...]
    gap: Array
    coupling: Array
    added_mass: Array
    drive_gain: Array
    spring_stiffness: Array
    spring_preload: Array
    sensors: SensorErrors
    command_delay: float
    gravity_turn: Array
