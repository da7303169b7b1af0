# SPDX-License-Identifier: BSD-3-Clause
"""One plain frozen type per message, whatever transport carries it.

Fields stand in the order of the wire (``message_texts.py``) and mean what the robot means by them: angles in
rad, rates in rad/s, torques in N.m, lengths in m, forces in N. Times are whole nanoseconds since 1970, so that
nothing is rounded; a float64 array is a tuple of floats.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from impedance_modules.backends.baxter.messages_basic import (
    Bool,
    Empty,
    Float64,
    Floats,
    Header,
    Message,
    Names,
    Point,
    Pose,
    Quaternion,
    String,
    Twist,
    UInt16,
    Vector3,
    Wrench,
)


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
    """The robot's own idea of a hand: where it is, how it moves, what it feels."""

    ros_type: ClassVar[str] = "baxter_core_msgs/EndpointState"
    header: Header
    pose: Pose
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
    """A piece of robot description that somebody adds at run time."""

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
        Pose,
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
