# SPDX-License-Identifier: BSD-3-Clause
r"""What a motor got where the robot feeds joint torque back to it: a recorded command becomes a motor's torque.

    \tau_m(t) = u(t - d) + g + k (u(t - d) + g - \tau_s(t - l)),   l: the loop's delay and half of its sampling

k, d and l are the robot file's, u and \tau_s are recorded, g is the weight that the robot adds. From here on a command
means \tau_m - g, d earlier: rotor, friction and every effect of the drive stay what they are without a loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.log import Log
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.data.rigid_dynamics import inverse_dynamics
from impedance_modules.diagnosis.data.time_base import delayed
from impedance_modules.errors import BadInput
from impedance_modules.spec.robot_spec import ROBOT_LOOP_PERIOD, InnerTorqueLoopSpec


def with_motor_torques(logs: Sequence[Log], model: NominalModel) -> tuple[Log, ...]:
    """Replaces the commands of all recordings by what the motors got, where the robot has an inner torque loop.

    Raises:
        BadInput: A command was recorded without the torque that the loop feeds back.
    """
    loop = model.inner_loop
    if loop is None:
        return tuple(logs)
    return tuple(
        log if log.command is None else replace(log, command=_motor_torque(log, log.command, loop, model))
        for log in logs
    )


def _motor_torque(log: Log, command: Array, loop: InnerTorqueLoopSpec, model: NominalModel) -> Array:
    if log.effort is None or log.effort_source != "joint_sensor":
        raise BadInput(
            f"{log.name}: robot '{model.robot}' feeds the torque of its joint sensors back to its motors"
            " (inner_torque_loop), so that a command alone does not say what a motor got (valid: a recording with"
            " effort of a joint sensor beside effort_command; or a robot file without that key)"
        )
    time = np.arange(log.samples) / log.rate
    ahead = model.command_delay - loop.delay - 0.5 * ROBOT_LOOP_PERIOD
    carried = np.zeros_like(command)
    if log.gravity_compensation == "robot":
        rest = np.zeros_like(log.position)
        carried = inverse_dynamics(model.tree, delayed(log.position, time, -model.command_delay), rest, rest)
    missing = command + carried - delayed(log.effort, time, -ahead)
    return command + loop.gain * missing
