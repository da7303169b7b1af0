# SPDX-License-Identifier: BSD-3-Clause
"""Messages as plain frozen types, whatever transport carries them: those of ROS, then those of Baxter.

Fields stand in the order of the wire (``message_definitions.FIELD_LISTS``). Angles in rad, rates in rad/s, torques in
N.m, lengths in m, forces in N. Times are whole nanoseconds since 1970, so that nothing is rounded; a float64 array is a
tuple of floats.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, dataclass_transform

Floats = tuple[float, ...]
Names = tuple[str, ...]


MESSAGE_TYPES: dict[str, type[Message]] = {}
"""ROS type -> plain type: every subclass of `Message` enters itself."""


@dataclass_transform(frozen_default=True)
class Message:
    """What all messages have: the name of their ROS type. A subclass is a frozen dataclass of its fields."""

    ros_type: ClassVar[str]

    def __init_subclass__(cls, *, ros_type: str) -> None:
        dataclass(frozen=True)(cls)
        cls.ros_type = ros_type
        MESSAGE_TYPES[ros_type] = cls


class Header(Message, ros_type="std_msgs/Header"):
    """When and in which frame something was measured; ``stamp`` in ns on the sender's clock."""

    seq: int
    stamp: int
    frame_id: str


class Bool(Message, ros_type="std_msgs/Bool"):
    """A truth value."""

    data: bool


class Empty(Message, ros_type="std_msgs/Empty"):
    """A signal without content."""


class Float64(Message, ros_type="std_msgs/Float64"):
    """A number."""

    data: float


class String(Message, ros_type="std_msgs/String"):
    """A text."""

    data: str


class UInt16(Message, ros_type="std_msgs/UInt16"):
    """A whole number from 0 to 65535."""

    data: int


class Point(Message, ros_type="geometry_msgs/Point"):
    """A place [m]."""

    x: float
    y: float
    z: float


class Vector3(Message, ros_type="geometry_msgs/Vector3"):
    """Three numbers along the axes of a frame."""

    x: float
    y: float
    z: float


class Quaternion(Message, ros_type="geometry_msgs/Quaternion"):
    """An orientation as a unit quaternion."""

    x: float
    y: float
    z: float
    w: float


class PoseMessage(Message, ros_type="geometry_msgs/Pose"):
    """Where a frame is and how it is turned."""

    position: Point
    orientation: Quaternion


class Twist(Message, ros_type="geometry_msgs/Twist"):
    """Linear [m/s] and angular velocity [rad/s]."""

    linear: Vector3
    angular: Vector3


class Wrench(Message, ros_type="geometry_msgs/Wrench"):
    """Force [N] and torque [N.m]."""

    force: Vector3
    torque: Vector3


class JointState(Message, ros_type="sensor_msgs/JointState"):
    """Angles [rad], rates [rad/s] and spring-deflection torques [N.m] of some joints, named one by one."""

    header: Header
    name: Names
    position: Floats
    velocity: Floats
    effort: Floats


class JointCommand(Message, ros_type="baxter_core_msgs/JointCommand"):
    """What some joints shall do; ``mode`` says whether ``command`` is angles, rates or torques."""

    POSITION_MODE: ClassVar[int] = 1
    VELOCITY_MODE: ClassVar[int] = 2
    TORQUE_MODE: ClassVar[int] = 3
    RAW_POSITION_MODE: ClassVar[int] = 4
    mode: int
    command: Floats
    names: Names


class AssemblyState(Message, ros_type="baxter_core_msgs/AssemblyState"):
    """Whether the robot has power on its motors, and why not."""

    BUTTON_UNPRESSED: ClassVar[int] = 0
    BUTTON_PRESSED: ClassVar[int] = 1
    BUTTON_UNKNOWN: ClassVar[int] = 2
    BUTTON_RELEASED: ClassVar[int] = 3
    SOURCE_NONE: ClassVar[int] = 0
    SOURCE_USER: ClassVar[int] = 1
    SOURCE_UNKNOWN: ClassVar[int] = 2
    SOURCE_FAULT: ClassVar[int] = 3
    SOURCE_BRAIN: ClassVar[int] = 4
    ready: bool
    enabled: bool
    stopped: bool
    error: bool
    estop_button: int
    estop_source: int


class SEAJointState(Message, ros_type="baxter_core_msgs/SEAJointState"):
    """The series-elastic joints of one arm in full: what was commanded, measured, and added by the robot."""

    header: Header
    name: Names
    commanded_position: Floats
    commanded_velocity: Floats
    commanded_acceleration: Floats
    commanded_effort: Floats
    actual_position: Floats
    actual_velocity: Floats
    actual_effort: Floats
    gravity_model_effort: Floats
    gravity_only: Floats
    hysteresis_model_effort: Floats
    crosstalk_model_effort: Floats
    hyst_state: float


class EndpointState(Message, ros_type="baxter_core_msgs/EndpointState"):
    """The robot's own estimate of a hand's pose, twist and wrench."""

    header: Header
    pose: PoseMessage
    twist: Twist
    wrench: Wrench


class DigitalIOState(Message, ros_type="baxter_core_msgs/DigitalIOState"):
    """A button or a lamp."""

    PRESSED: ClassVar[int] = 1
    UNPRESSED: ClassVar[int] = 0
    state: int
    is_input_only: bool


class CollisionAvoidanceState(Message, ros_type="baxter_core_msgs/CollisionAvoidanceState"):
    """What the arm's force field is pushing away from."""

    header: Header
    other_arm: bool
    collision_object: Names


class CollisionDetectionState(Message, ros_type="baxter_core_msgs/CollisionDetectionState"):
    """Whether the arm has just detected an impact or a squeeze and pauses."""

    header: Header
    collision_state: bool


class HeadState(Message, ros_type="baxter_core_msgs/HeadState"):
    """The head's pan angle [rad] and what it is doing."""

    pan: float
    is_turning: bool
    is_nodding: bool
    is_pan_enabled: bool


class EndEffectorState(Message, ros_type="baxter_core_msgs/EndEffectorState"):
    """A gripper's state; opening and force in percent of their largest."""

    STATE_FALSE: ClassVar[int] = 0
    STATE_TRUE: ClassVar[int] = 1
    STATE_UNKNOWN: ClassVar[int] = 2
    timestamp: int
    id: int
    enabled: int
    calibrated: int
    ready: int
    moving: int
    gripping: int
    missed: int
    error: int
    reverse: int
    position: float
    force: float
    state: str
    command: str
    command_sender: str
    command_sequence: int


class EndEffectorCommand(Message, ros_type="baxter_core_msgs/EndEffectorCommand"):
    """A command to a gripper; ``args`` is a JSON object, opening, forces and speed in percent of their largest."""

    id: int
    command: str
    args: str
    sender: str
    sequence: int


class EndEffectorProperties(Message, ros_type="baxter_core_msgs/EndEffectorProperties"):
    """What kind of gripper is mounted, and what it can."""

    NO_GRIPPER: ClassVar[int] = 0
    SUCTION_CUP_GRIPPER: ClassVar[int] = 1
    ELECTRIC_GRIPPER: ClassVar[int] = 2
    PASSIVE_GRIPPER: ClassVar[int] = 3
    id: int
    ui_type: int
    manufacturer: str
    product: str
    serial_number: str
    hardware_rev: str
    firmware_rev: str
    firmware_date: str
    has_calibration: bool
    controls_grip: bool
    senses_grip: bool
    reverses_grip: bool
    controls_force: bool
    senses_force: bool
    controls_position: bool
    senses_position: bool
    properties: str


class URDFConfiguration(Message, ros_type="baxter_core_msgs/URDFConfiguration"):
    """A part of the robot description that is added at run time."""

    time: int
    link: str
    joint: str
    urdf: str
