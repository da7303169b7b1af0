# SPDX-License-Identifier: BSD-3-Clause
"""Names of a Baxter's topics, parameters and nodes, its rates and time-outs. Facts of the robot, no behaviour.

Sources: Rethink's SDK (baxter_interface, baxter_common 1.2.0), its wiki, and graph scans of real robots.
"""

from __future__ import annotations

from collections.abc import Callable

LimbTopic = Callable[[str], str]
"""Topic of a limb, by the limb's name."""

ROBOT_STATE = "/robot/state"
JOINT_STATES = "/robot/joint_states"
STATE_RATE_REQUEST = "/robot/joint_state_publish_rate"
ENABLE = "/robot/set_super_enable"
RESET = "/robot/set_super_reset"
STOP = "/robot/set_super_stop"

SOFTWARE_VERSION = "/rethink/software_version"
DESCRIPTIONS = ("/robot_description", "/robot/armnav_robot_description")
"""Parameters that hold the calibrated URDF; the first one set counts."""

REALTIME_NODE = "/realtime_loop"
"""The node that publishes the arms' joint states; the grippers' come from another one."""

SUPPORTED_SOFTWARE = "1.2."
"""Beginning of the software versions whose messages and behaviour are those described here."""

DEFAULT_STATE_RATE = 100
"""Rate of the joint states unless another one is requested [Hz]."""

USUAL_RATE = 500.0
"""Rate that a run asks for unless told otherwise [Hz]; Rethink calls up to 800 Hz reliable."""

DEFAULT_TIMEOUT = 0.2
"""The robot's own command time-out [s]."""

SHORTEST_TIMEOUT = 0.05
"""Command time-out that a run sets at any rate above 100 Hz [s]: five cycles of the default rate. A shorter one would
make every scheduling delay of an ordinary kernel end torque mode."""

TIMEOUT_CYCLES = 5
"""At least so many control cycles fit into the time-out that a run sets."""


joint_command: LimbTopic = "/robot/limb/{}/joint_command".format
"""Topic on which a limb is commanded."""

command_timeout: LimbTopic = "/robot/limb/{}/joint_command_timeout".format
"""Topic that sets after how long without a command a limb leaves torque mode."""

speed_ratio: LimbTopic = "/robot/limb/{}/set_speed_ratio".format
"""Topic that sets how fast a limb's position mode moves, 0 to 1."""

sea_state: LimbTopic = "/robot/limb/{}/gravity_compensation_torques".format
"""Topic of all states of a limb's series-elastic joints."""

endpoint_state: LimbTopic = "/robot/limb/{}/endpoint_state".format
"""Topic of the robot's own forward kinematics of a limb."""

collision_state: LimbTopic = "/robot/limb/{}/collision_detection_state".format
"""Topic that says whether a limb has detected an impact or a squeeze."""

cuff: LimbTopic = "/robot/digital_io/{}_lower_cuff/state".format
"""Topic of the switch in a limb's cuff."""

gripper_command: LimbTopic = "/robot/end_effector/{}_gripper/command".format
"""Topic on which a limb's gripper is commanded."""

gripper_state: LimbTopic = "/robot/end_effector/{}_gripper/state".format
"""Topic of what a limb's gripper reports."""

gripper_properties: LimbTopic = "/robot/end_effector/{}_gripper/properties".format
"""Topic that says what kind of gripper a limb has."""


def suppression(limb: str, name: str) -> str:
    """Topic that switches one of a limb's safety functions off; the effect ends by itself after 0.2 s."""
    return f"/robot/limb/{limb}/{name}"


def suppress_avoidance(limb: str) -> str:
    """Topic that switches a limb's collision avoidance off, likewise."""
    return suppression(limb, "suppress_collision_avoidance")


def timeout_for(rate: float) -> float:
    """Command time-out to set before torque mode at a control rate [Hz], [s]."""
    return max(TIMEOUT_CYCLES / rate, SHORTEST_TIMEOUT)
