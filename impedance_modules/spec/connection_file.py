# SPDX-License-Identifier: BSD-3-Clause
"""A connection file: where the robots of one laboratory are reached, and how their communication is watched.

Robot files say what a robot is, tasks what it does; a connection file says where it stands, and is passed with
``run --connection FILE``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from impedance_modules.errors import BadFile
from impedance_modules.spec.document import Document, read_document
from impedance_modules.spec.schema import schema_problems


@dataclass(frozen=True)
class ArmWatch:
    """Times by which the communication with Franka arms is watched.

    Attributes:
        patience: Age of the last state from which each period counts as one without a state [s].
        silent: Longest time for which a torque is sent that the run does not renew [s].
        answer: How long a state's own torque is waited for before the last one is sent again [s].
        least_rate: Fewest states per second of a robot that may be commanded [Hz].
        least_success: Smallest share of the commands at zero torque that the robot must receive in time.
    """

    patience: float = 0.01
    silent: float = 0.03
    answer: float = 0.0005
    least_rate: float = 900.0
    least_success: float = 0.8


@dataclass(frozen=True)
class FrankaConnection:
    """How Franka arms are reached.

    Attributes:
        addresses: Limb -> network address of its robot.
        realtime: Whether a computer without real-time capabilities is refused.
        watch: Of the communication.
    """

    addresses: Mapping[str, str]
    realtime: bool = True
    watch: ArmWatch = ArmWatch()


@dataclass(frozen=True)
class EffortController:
    """A ROS 2 controller that takes torques.

    Attributes:
        topic: Of its commands, a Float64MultiArray.
        joints: Joints of the robot file, in the order in which the controller was configured.
    """

    topic: str
    joints: tuple[str, ...]


@dataclass(frozen=True)
class Ros2Watch:
    """Times by which a robot on ROS 2 is watched.

    Attributes:
        patience: Age of the last state from which each period counts as one without a state [s].
        stale: Age of the last state, or of the last torque, from which zero torque is sent [s].
        oldest: Largest age of a state by its stamp, beyond that of the fastest one, that is used [s].
        least_share: Smallest rate of states over the control rate with which a run may begin.
    """

    patience: float = 0.01
    stale: float = 0.05
    oldest: float = 0.05
    least_share: float = 0.9


@dataclass(frozen=True)
class Ros2Connection:
    """How a robot on ROS 2 is reached.

    Attributes:
        gravity: Who carries the arms' weight: ``robot``, or ``controller``, which is this program.
        effort: Whether the reported efforts hold the arms' weight: ``with_weight`` or ``without_weight``.
        controllers: Where torques go.
        joint_states: Topic of the states.
        reliable: Whether states are subscribed to as reliable; a best-effort publisher is then not heard.
        names: Joint of the robot file -> name on the topic, where they differ.
        python: Path of the Python that has rclpy; empty for the run's own.
        watch: Of the communication.
    """

    gravity: str
    effort: str
    controllers: tuple[EffortController, ...]
    joint_states: str = "/joint_states"
    reliable: bool = False
    names: Mapping[str, str] = field(default_factory=dict)
    python: str = ""
    watch: Ros2Watch = Ros2Watch()


@dataclass(frozen=True)
class ConnectionSpec:
    """A whole connection file; a part is None where the file does not have it.

    Attributes:
        document: The file, which knows where every value stood.
    """

    franka: FrankaConnection | None
    ros2: Ros2Connection | None
    document: Document = field(repr=False)


def read_connection(path: Path) -> ConnectionSpec:
    """Reads a connection file.

    Raises:
        BadInput: The file cannot be read.
        BadFile: It is not a connection file; every problem is listed with its line.
    """
    document = read_document(path)
    problems = schema_problems(document, "connection")
    if problems:
        raise BadFile(problems)
    data = document.data
    return ConnectionSpec(
        franka=_franka(data["franka"]) if "franka" in data else None,
        ros2=_ros2(data["ros2"]) if "ros2" in data else None,
        document=document,
    )


def _franka(data: Mapping[str, Any]) -> FrankaConnection:
    watch = {key: float(value) for key, value in data.get("watch", {}).items()}
    return FrankaConnection(
        dict(data["addresses"]), data.get("realtime", "required") == "required", ArmWatch(**watch)
    )


def _ros2(data: Mapping[str, Any]) -> Ros2Connection:
    watch = {key: float(value) for key, value in data.get("watch", {}).items()}
    return Ros2Connection(
        gravity=data["gravity"],
        effort=data["effort"],
        controllers=tuple(
            EffortController(each["topic"], tuple(each["joints"])) for each in data["controllers"]
        ),
        joint_states=data.get("joint_states", "/joint_states"),
        reliable=data.get("reliability", "best_effort") == "reliable",
        names=dict(data.get("names", {})),
        python=data.get("python", ""),
        watch=Ros2Watch(**watch),
    )
