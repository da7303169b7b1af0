# SPDX-License-Identifier: BSD-3-Clause
"""Message definitions: lists of fields, and what ROS derives from them, its checksum and full text.

A line of ``FIELD_LISTS`` is ``type name`` or ``type NAME=constant``. ROS computes a message's checksum from exactly
these, so a wrong one would not connect; the tests compare them with the checksums of real robots.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from impedance_modules.errors import BadInput, nearest

PRIMITIVES: frozenset[str] = frozenset(
    {"bool", "int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64", "string", "time"}
)

FIELD_LISTS: Mapping[str, str] = {
    "std_msgs/Header": "uint32 seq\ntime stamp\nstring frame_id",
    "std_msgs/Bool": "bool data",
    "std_msgs/Empty": "",
    "std_msgs/Float64": "float64 data",
    "std_msgs/String": "string data",
    "std_msgs/UInt16": "uint16 data",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": "Point position\nQuaternion orientation",
    "geometry_msgs/Twist": "Vector3 linear\nVector3 angular",
    "geometry_msgs/Wrench": "Vector3 force\nVector3 torque",
    "sensor_msgs/JointState": (
        "Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
    ),
    "baxter_core_msgs/JointCommand": (
        "int32 mode\nfloat64[] command\nstring[] names\n"
        "int32 POSITION_MODE=1\nint32 VELOCITY_MODE=2\nint32 TORQUE_MODE=3\nint32 RAW_POSITION_MODE=4"
    ),
    "baxter_core_msgs/AssemblyState": (
        "bool ready\nbool enabled\nbool stopped\nbool error\nuint8 estop_button\n"
        "uint8 ESTOP_BUTTON_UNPRESSED=0\nuint8 ESTOP_BUTTON_PRESSED=1\n"
        "uint8 ESTOP_BUTTON_UNKNOWN=2\nuint8 ESTOP_BUTTON_RELEASED=3\n"
        "uint8 estop_source\n"
        "uint8 ESTOP_SOURCE_NONE=0\nuint8 ESTOP_SOURCE_USER=1\nuint8 ESTOP_SOURCE_UNKNOWN=2\n"
        "uint8 ESTOP_SOURCE_FAULT=3\nuint8 ESTOP_SOURCE_BRAIN=4"
    ),
    "baxter_core_msgs/SEAJointState": (
        "Header header\nstring[] name\nfloat64[] commanded_position\nfloat64[] commanded_velocity\n"
        "float64[] commanded_acceleration\nfloat64[] commanded_effort\nfloat64[] actual_position\n"
        "float64[] actual_velocity\nfloat64[] actual_effort\nfloat64[] gravity_model_effort\n"
        "float64[] gravity_only\nfloat64[] hysteresis_model_effort\nfloat64[] crosstalk_model_effort\n"
        "float64 hystState"
    ),
    "baxter_core_msgs/EndpointState": (
        "Header header\ngeometry_msgs/Pose pose\ngeometry_msgs/Twist twist\ngeometry_msgs/Wrench wrench"
    ),
    "baxter_core_msgs/DigitalIOState": (
        "int8 state\nbool isInputOnly\nint8 OFF=0\nint8 ON=1\nint8 PRESSED=1\nint8 UNPRESSED=0"
    ),
    "baxter_core_msgs/CollisionAvoidanceState": (
        "std_msgs/Header header\nbool other_arm\nstring[] collision_object"
    ),
    "baxter_core_msgs/CollisionDetectionState": "std_msgs/Header header\nbool collision_state",
    "baxter_core_msgs/HeadState": "float32 pan\nbool isTurning\nbool isNodding\nbool isPanEnabled",
    "baxter_core_msgs/EndEffectorState": (
        "time timestamp\nuint32 id\nuint8 enabled\nuint8 calibrated\nuint8 ready\nuint8 moving\n"
        "uint8 gripping\nuint8 missed\nuint8 error\nuint8 reverse\nfloat32 position\nfloat32 force\n"
        "string state\nstring command\nstring command_sender\nuint32 command_sequence\n"
        "uint8 STATE_FALSE=0\nuint8 STATE_TRUE=1\nuint8 STATE_UNKNOWN=2\n"
        "float32 POSITION_CLOSED=0.0\nfloat32 POSITION_OPEN=100.0\n"
        "float32 FORCE_MIN=0.0\nfloat32 FORCE_MAX=100.0"
    ),
    "baxter_core_msgs/EndEffectorCommand": (
        "uint32 id\nstring command\nstring args\nstring sender\nuint32 sequence\n"
        "string CMD_NO_OP=no_op\nstring CMD_SET=set\nstring CMD_CONFIGURE=configure\nstring CMD_REBOOT=reboot\n"
        "string CMD_RESET=reset\nstring CMD_CALIBRATE=calibrate\nstring CMD_CLEAR_CALIBRATION=clear_calibration\n"
        "string CMD_PREPARE_TO_GRIP=prepare_to_grip\nstring CMD_GRIP=grip\nstring CMD_RELEASE=release\n"
        "string CMD_GO=go\nstring CMD_STOP=stop"
    ),
    "baxter_core_msgs/EndEffectorProperties": (
        "uint32 id\nuint8 ui_type\nstring manufacturer\nstring product\nstring serial_number\nstring hardware_rev\n"
        "string firmware_rev\nstring firmware_date\nbool has_calibration\nbool controls_grip\nbool senses_grip\n"
        "bool reverses_grip\nbool controls_force\nbool senses_force\nbool controls_position\nbool senses_position\n"
        "string properties\n"
        "uint8 NO_GRIPPER=0\nuint8 SUCTION_CUP_GRIPPER=1\nuint8 ELECTRIC_GRIPPER=2\nuint8 PASSIVE_GRIPPER=3"
    ),
    "baxter_core_msgs/URDFConfiguration": "time time\nstring link\nstring joint\nstring urdf",
}
"""Type -> its fields and constants, in the order in which ROS puts them on the wire."""


@dataclass(frozen=True)
class MessageField:
    """One field of a message.

    Attributes:
        kind: Full name of its type, without brackets, e.g. ``float64`` or ``std_msgs/Header``.
        name: As in the definition.
        written: Its type as the definition writes it, e.g. ``float64[]``; the checksum sees this.
        repeated: An array of any length.
    """

    kind: str
    name: str
    written: str
    repeated: bool


@dataclass(frozen=True)
class Definition:
    """A message's fields and constants, each in order.

    Attributes:
        ros_type: Package and name, e.g. ``std_msgs/Bool``.
        fields: What goes over the wire.
        constants: (type, name, value as written).
        text: The definition itself.
    """

    ros_type: str
    fields: tuple[MessageField, ...]
    constants: tuple[tuple[str, str, str], ...]
    text: str


@cache
def definition(ros_type: str) -> Definition:
    """Returns the definition of a message type.

    Raises:
        BadInput: The type is not one of ``message_texts.FIELD_LISTS``.
    """
    if ros_type not in FIELD_LISTS:
        valid = tuple(FIELD_LISTS)
        raise BadInput(f"no message type '{ros_type}'{nearest(ros_type, valid)} (valid: {', '.join(valid)})")
    text = FIELD_LISTS[ros_type]
    fields, constants = [], []
    for line in text.splitlines():
        written, _, rest = line.partition(" ")
        name, is_constant, value = rest.partition("=")
        if is_constant:
            constants.append((written, name, value))
        else:
            plain = written.removesuffix("[]")
            fields.append(MessageField(_full_type(plain, ros_type), name, written, plain != written))
    return Definition(ros_type, tuple(fields), tuple(constants), text)


@cache
def checksum(ros_type: str) -> str:
    """Computes the MD5 by which two ROS nodes know that they mean the same message.

    It is taken over the constants, then the fields, one per line, with the type of a message field replaced by
    that message's own MD5 (the rule of ROS's ``genmsg``).
    """
    parts = definition(ros_type)
    lines = [f"{kind} {name}={value}" for kind, name, value in parts.constants]
    for field in parts.fields:
        kind = field.written if field.kind in PRIMITIVES else checksum(field.kind)
        lines.append(f"{kind} {field.name}")
    return hashlib.md5("\n".join(lines).encode(), usedforsecurity=False).hexdigest()


@cache
def full_text(ros_type: str) -> str:
    """Returns a definition followed by those of all messages in it, as ROS sends it when nodes connect."""
    parts = [definition(ros_type).text]
    for kind in _contained(ros_type):
        parts.append(f"{'=' * 80}\nMSG: {kind}\n{definition(kind).text}")
    return "\n\n".join(parts) + "\n"


def _contained(ros_type: str) -> list[str]:
    """Lists the message types inside a message, at any depth, each once."""
    found: list[str] = []
    for field in definition(ros_type).fields:
        if field.kind in PRIMITIVES:
            continue
        for kind in (field.kind, *_contained(field.kind)):
            if kind not in found:
                found.append(kind)
    return found


def _full_type(plain: str, within: str) -> str:
    """Completes a short type: ``Header`` is everybody's, other short names are of the same package."""
    if plain in PRIMITIVES or "/" in plain:
        return plain
    return "std_msgs/Header" if plain == "Header" else f"{within.partition('/')[0]}/{plain}"
