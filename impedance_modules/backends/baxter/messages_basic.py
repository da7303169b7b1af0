# SPDX-License-Identifier: BSD-3-Clause
"""The messages that all of ROS shares: numbers, texts, places, poses. See ``messages.py``."""

from __future__ import annotations

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
class Pose(Message):
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
