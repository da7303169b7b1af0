# SPDX-License-Identifier: BSD-3-Clause
"""Backends of robots that are reached by a connection file: Franka arms, robots on ROS 2."""

from __future__ import annotations

from impedance_modules.backends.franka.franka_backend import FrankaBackend, FrankaOptions
from impedance_modules.backends.franka.franka_checks import refuse_unfit_robot
from impedance_modules.backends.preflight import PreflightResult
from impedance_modules.backends.ros2.ros2_backend import Ros2Backend, Ros2Options
from impedance_modules.backends.ros2.ros2_checks import refuse_unfit_connection
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.contact_detection import contact_checks
from impedance_modules.control.gripper_watch import ordered_grippers
from impedance_modules.errors import BadInput
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.connection_file import FrankaConnection, Ros2Connection

FRANKA_RATE = 1000.0
"""Of the robots' own loops [Hz]."""


def franka_backend(
    assembly: Assembly, connection: FrankaConnection, recover: bool, read_only: bool, approach: bool
) -> FrankaBackend:
    """Makes the backend of Franka arms, not yet connected.

    Args:
        assembly: The task.
        connection: Addresses of all limbs of the robot, and the watch.
        recover: Robots that a reflex has stopped are asked for automatic error recovery first.
        read_only: Nothing will be sent.
        approach: The robots' position mode may bring the arms to where the task begins.

    Raises:
        BadInput: The robot file is no Franka robot's, an address is missing, or the rate is no whole part of 1000 Hz.
    """
    refuse_unfit_robot(assembly.robot, connection.addresses)
    parts = FRANKA_RATE / assembly.rate
    if abs(parts - round(parts)) > 1e-9:
        raise BadInput(
            f"--rate {assembly.rate:g} Hz: a Franka robot sends {FRANKA_RATE:g} states per second, of which every"
            " second, third ... can be used (valid: 1000, 500, 250, 200, ...)"
        )
    options = FrankaOptions(
        assembly.rate, read_only, approach, recover, assembly.modules.posture, ordered_grippers(assembly.task)
    )
    limbs = {arm.limb.name: arm.limb for arm in assembly.modules.arms}

    def of_task(state: RobotState) -> tuple[PreflightResult, ...]:
        return contact_checks(assembly, state)

    return FrankaBackend(assembly.model, limbs, connection, options, of_task)


def ros2_backend(assembly: Assembly, connection: Ros2Connection, read_only: bool) -> Ros2Backend:
    """Makes the backend of a robot on ROS 2, not yet connected.

    Args:
        assembly: The task.
        connection: Topics, order of joints, who carries the weight, the watch.
        read_only: Nothing will be published.

    Raises:
        BadInput: The connection file does not fit the robot file or the task.
    """
    limbs = {arm.limb.name: arm.limb for arm in assembly.modules.arms}
    refuse_unfit_connection(assembly.robot, connection, limbs)
    options = Ros2Options(assembly.rate, read_only, assembly.modules.posture)

    def of_task(state: RobotState) -> tuple[PreflightResult, ...]:
        return contact_checks(assembly, state)

    return Ros2Backend(assembly.model, limbs, connection, options, of_task)
