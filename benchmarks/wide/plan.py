# SPDX-License-Identifier: BSD-3-Clause
"""Everything that one simulated recording needs, as plain data: it is sent to the engine's process as it stands.

Nothing here imports MuJoCo, Drake or the package under test.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.arm_model import Joints, Link
from benchmarks.blind.records import Faults

Array = NDArray[np.float64]

PERIOD = 0.001
"""Of the robot's own control loop [s]."""
STEP = 0.0005
"""Of the physics [s]."""
SETTLE = 0.5
"""Time [s] that the arm is held before the recording starts."""


@dataclass(frozen=True)
class Control:
    """The controller that moves the arm.

    Attributes:
        law: ``impedance``, ``computed_torque``, ``position_loop`` or ``policy``.
        stiffness, damping, integral: (n,) gains [N.m/rad, N.m.s/rad, N.m/(rad.s)].
        inertia: (n,) that the gains were made for [kg.m^2].
        weight: Who carries the weight: ``robot`` (from its present reading), ``robot_late``, ``command`` or ``none``.
        late: Age of the position from which ``robot_late`` computes it [s].
        blur: Standard deviation of that position's own noise [rad].
        limit: (n,) largest command [N.m].
        delay: From a command to its torque [s].
    """

    law: str
    stiffness: Array
    damping: Array
    integral: Array
    inertia: Array
    weight: str
    late: float
    blur: float
    limit: Array
    delay: float


@dataclass(frozen=True)
class Sensing:
    """Sensors of position and torque.

    Attributes:
        effort_source: ``joint_sensor``, ``motor`` or None.
        noise: ``white``, ``coloured``, ``quantised`` or ``growing_with_load``.
        position_grid, effort_grid: [rad], (n,) [N.m].
        position_noise, effort_noise: Standard deviations [rad], (n,) [N.m].
    """

    effort_source: str | None
    noise: str
    position_grid: float
    effort_grid: Array
    position_noise: float
    effort_noise: Array


@dataclass(frozen=True)
class Plan:
    """One recording to be simulated.

    Attributes:
        links: True links, parents first, the first hanging on ``world``.
        believed: Links of the URDF: what the controller computes with.
        hand: Link that pushes act on.
        joints: True drives; an infinite stiffness is a rigid drive.
        nominal: Drives that the controller believes in.
        faults: What is wrong.
        gravity: (3,) true gravity in the world [m/s^2].
        pushes: (m, 5) start, end [s] and force [N] on the hand.
        friction_law: ``constraint``, ``lugre``, ``dahl`` or ``regularised``.
        engine: ``mujoco_implicit``, ``mujoco_runge_kutta`` or ``drake``.
        reference: (samples, n) desired position at the control rate [rad].
        control: The controller.
        sensing: The sensors.
        seed: Of the noise; None for ideal sensors.
    """

    links: tuple[Link, ...]
    believed: tuple[Link, ...]
    hand: str
    joints: Joints
    nominal: Joints
    faults: Faults
    gravity: Array
    pushes: Array
    friction_law: str
    engine: str
    reference: Array
    control: Control
    sensing: Sensing
    seed: int | None

    @property
    def rigid(self) -> bool:
        """Motors sit on the links without a spring between."""
        return bool(np.all(np.isinf(self.joints.stiffness)))


@dataclass(frozen=True)
class RawLog:
    """What happened at the control rate, (samples, n) each: readings, command, target; and the true motion."""

    position: Array
    effort: Array
    command: Array
    target: Array
    true_position: Array
    true_velocity: Array
