# SPDX-License-Identifier: BSD-3-Clause
"""Messages as plain frozen types, whatever transport carries them: those of ROS, then those of Baxter.

Fields stand in the order of the wire (``message_definitions.FIELD_LISTS``). Angles in rad, rates in rad/s, torques in
N.m, lengths in m, forces in N. Times are whole nanoseconds since 1970, so that nothing is rounded; a float64 array is a
tuple of floats.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

Floats = tuple[float, ...]
Names = tuple[str, ...]


class Message:
    """What all messages have: the name of their ROS type."""

    __slots__ = ()
    ros_type: ClassVar[str]


@dataclass(frozen=True, slots=True)
class Header(Message):
    """When and in which frame something was measured; ``stamp`` in ns on the sender's clock."""

    ros_type: ClassVar[str] = "std_msgs/Header"
    seq: int
    stamp: int
    frame_id: str


@dataclass(frozen=True, slots=True)
class Bool(Message):
    """A truth value."""

    ros_type: ClassVar[str] = "std_msgs/Bool"
    data: bool


@dataclass(frozen=True, slots=True)
class Empty(Message):
    """A signal without content."""

    ros_type: ClassVar[str] = "std_msgs/Empty"


@dataclass(frozen=True, slots=True)
class Float64(Message):
    """A number."""

    ros_type: ClassVar[str] = "std_msgs/Float64"
    data: float


@dataclass(frozen=True, slots=True)
class String(Message):
    """A text."""

    ros_type: ClassVar[str] = "std_msgs/String"
    data: str


@dataclass(frozen=True, slots=True)
class UInt16(Message):
    """A whole number from 0 to 65535."""

    ros_type: ClassVar[str] = "std_msgs/UInt16"
    data: int


@dataclass(frozen=True, slots=True)
class Point(Message):
    """A place [m]."""

    ros_type: ClassVar[str] = "geometry_msgs/Point"
    x: float
    y: float
    z: float


@dataclass(frozen=True, slots=True)
class Vector3(Message):
    """Three numbers along the axes of a frame."""

    ros_type: ClassVar[str] = "geometry_msgs/Vector3"
    x: float
    y: float
    z: float


@dataclass(frozen=True, slots=True)
class Quaternion(Message):
    """An orientation as a unit quaternion."""

    ros_type: ClassVar[str] = "geometry_msgs/Quaternion"
    x: float
    y: float
    z: float
    w: float


@dataclass(frozen=True, slots=True)
class PoseMessage(Message):
    """Where a frame is and how it is turned."""

    ros_type: ClassVar[str] = "geometry_msgs/Pose"
    position: Point
    orientation: Quaternion


@dataclass(frozen=True, slots=True)
class Twist(Message):
    """Linear [m/s] and angular velocity [rad/s]."""

    ros_type: ClassVar[str] = "geometry_msgs/Twist"
    linear: Vector3
    angular: Vector3


@dataclass(frozen=True, slots=True)
class Wrench(Message):
    """Force [N] and torque [N.m]."""

    ros_type: ClassVar[str] = "geometry_msgs/Wrench"
    force: Vector3
    torque: Vector3


@dataclass(frozen=True, slots=True)
class JointState(Message):
    """Angles [rad], rates [rad/s] and spring-deflection torques [N.m] of some joints, named one by one."""

    ros_type: ClassVar[str] = "sensor_msgs/JointState"
    header: Header
    name: Names
    position: Floats
    velocity: Floats
    effort: Floats


@dataclass(frozen=True, slots=True)
class JointCommand(Message):
    """What some joints shall do; ``mode`` says whether ``command`` is angles, rates or torques."""

    ros_type: ClassVar[str] = "baxter_core_msgs/JointCommand"
    POSITION_MODE: ClassVar[int] = 1
    VELOCITY_MODE: ClassVar[int] = 2
    TORQUE_MODE: ClassVar[int] = 3
    RAW_POSITION_MODE: ClassVar[int] = 4
    mode: int
    command: Floats
    names: Names


@dataclass(frozen=True, slots=True)
class AssemblyState(Message):
    """Whether the robot has power on its motors, and why not."""

    ros_type: ClassVar[str] = "baxter_core_msgs/AssemblyState"
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


@dataclass(frozen=True, slots=True)
class SEAJointState(Message):
    """The series-elastic joints of one arm in full: what was commanded, measured, and added by the robot."""

    ros_type: ClassVar[str] = "baxter_core_msgs/SEAJointState"
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


@dataclass(frozen=True, slots=True)
class EndpointState(Message):
    """The robot's own estimate of a hand's pose, twist and wrench."""

    ros_type: ClassVar[str] = "baxter_core_msgs/EndpointState"
    header: Header
    pose: PoseMessage
    twist: Twist
    wrench: Wrench


@dataclass(frozen=True, slots=True)
class DigitalIOState(Message):
    """A button or a lamp."""

    ros_type: ClassVar[str] = "baxter_core_msgs/DigitalIOState"
    PRESSED: ClassVar[int] = 1
    UNPRESSED: ClassVar[int] = 0
    state: int
    is_input_only: bool


@dataclass(frozen=True, slots=True)
class CollisionAvoidanceState(Message):
    """What the arm's force field is pushing away from."""

    ros_type: ClassVar[str] = "baxter_core_msgs/CollisionAvoidanceState"
    header: Header
    other_arm: bool
    collision_object: Names


@dataclass(frozen=True, slots=True)
class CollisionDetectionState(Message):
    """Whether the arm has just felt an impact or a squeeze and pauses."""

    ros_type: ClassVar[str] = "baxter_core_msgs/CollisionDetectionState"
    header: Header
    collision_state: bool


@dataclass(frozen=True, slots=True)
class HeadState(Message):
    """The head's pan angle [rad] and what it is doing."""

    ros_type: ClassVar[str] = "baxter_core_msgs/HeadState"
    pan: float
    is_turning: bool
    is_nodding: bool
    is_pan_enabled: bool


@dataclass(frozen=True, slots=True)
class EndEffectorState(Message):
    """A gripper's state; opening and force in percent of their largest."""

    ros_type: ClassVar[str] = "baxter_core_msgs/EndEffectorState"
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


@dataclass(frozen=True, slots=True)
class URDFConfiguration(Message):
    """A part of the robot description that is added at run time."""

    ros_type: ClassVar[str] = "baxter_core_msgs/URDFConfiguration"
    time: int
    link: str
    joint: str
    urdf: str


MESSAGE_TYPES: Mapping[str, type[Message]] = {
    kind.ros_type: kind
    for kind in (
        Header,
        Bool,
        Empty,
        Float64,
        String,
        UInt16,
        Point,
        Vector3,
        Quaternion,
        PoseMessage,
        Twist,
        Wrench,
        JointState,
        JointCommand,
        AssemblyState,
        SEAJointState,
        EndpointState,
        DigitalIOState,
        CollisionAvoidanceState,
        CollisionDetectionState,
        HeadState,
        EndEffectorState,
        URDFConfiguration,
    )
}
"""ROS type -> plain type."""
