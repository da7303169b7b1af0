# SPDX-License-Identifier: BSD-3-Clause
"""What the double listens to. Every request is handed to its next tick."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from impedance_modules.backends.baxter.ros import messages
from impedance_modules.backends.baxter.ros.transport import Transport
from impedance_modules.backends.baxter.simulator.simulated_baxter import FakeBaxter
from impedance_modules.backends.baxter.simulator.suppression import SUPPRESSIBLE

FAULT_TOPIC = "/fake_baxter/fault"
"""Takes a String in the words of ``faults``."""


def listen(
    node: Transport, robot: FakeBaxter, set_rate: Callable[[int], None], obey: Callable[[str], None]
) -> None:
    """Subscribes to everything that the robot listens to.

    Args:
        node: Of the robot.
        robot: Whose limbs and power are commanded.
        set_rate: Takes a wished rate of the joint states [Hz].
        obey: Takes a fault in words.
    """
    post = robot.post
    node.subscribe("/robot/set_super_enable", messages.Bool, lambda m, _: post(partial(robot.enable, m.data)))
    node.subscribe("/robot/set_super_reset", messages.Empty, lambda _, __: post(robot.reset))
    node.subscribe("/robot/set_super_stop", messages.Empty, lambda _, __: post(robot.stop))
    node.subscribe(
        "/robot/joint_state_publish_rate", messages.UInt16, lambda m, _: post(partial(set_rate, m.data))
    )
    node.subscribe(FAULT_TOPIC, messages.String, lambda m, _: post(partial(obey, m.data)))
    for limb in robot.limbs:
        _listen_for(node, robot, limb)


def _listen_for(node: Transport, robot: FakeBaxter, limb: str) -> None:
    drive, post, place = robot.limbs[limb], robot.post, f"/robot/limb/{limb}"

    def ask(name: str) -> Callable[[messages.Empty, float], None]:
        return lambda _, __: post(lambda: robot.suppressions[limb].ask(name, robot.now))

    node.subscribe(
        f"{place}/joint_command",
        messages.JointCommand,
        lambda m, _: post(partial(robot.command, limb, m.mode, m.names, m.command)),
    )
    node.subscribe(
        f"{place}/joint_command_timeout",
        messages.Float64,
        lambda m, _: post(partial(drive.set_time_out, m.data)),
    )
    node.subscribe(
        f"{place}/set_speed_ratio",
        messages.Float64,
        lambda m, _: post(partial(drive.set_speed_ratio, m.data)),
    )
    for name in SUPPRESSIBLE:
        node.subscribe(f"{place}/{name}", messages.Empty, ask(name))
